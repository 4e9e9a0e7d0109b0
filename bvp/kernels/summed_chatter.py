"""Chatter that is summed to its end, as one impact of an orbit under periodic loads, and its derivative, equation (44).

After each impact the gap opens with the speed v, and is hit again after the time t that solves

    v + t * integral of (1 - x) a(x t) dx = 0,   0 <= x <= 1,

with the acceleration a of the gap in flight. This form does not cancel in short bounces: the gap itself does not appear, so a bounce ends
where it began. The nodes after the impacts are a power series in restitution^k (Koenigs). With q = restitution^stride below 1/2,
Neville's scheme takes one power after the other away, as in `bvp.kernels.sticking`. It is linear, so that it takes the derivatives of the
nodes to the derivative of their limit. A derivative by the restitution contains that of q.
"""

import math
from typing import NamedTuple

import numpy as np

from bvp.kernels.compiled import chosen, inlined, kernel, shared
from bvp.kernels.contact_mode import apply_impact, impact_columns
from bvp.kernels.flight import copy_1, fastest_rate, inner, row_dot, set_1
from bvp.kernels.forced_sticking import Sticking, Unstuck, contact_force, orbit_flight
from bvp.kernels.loads import loaded_flight, loaded_rate
from bvp.kernels.sticking import stride_of

ORDERS = 12
"""Most orders of the series that are summed."""

REST = 1e-18
"""Size of the product of the powers that the orders take away, at which no further one is needed."""

LONGEST = 1.0
"""Duration of a chatter, times the fastest rate, above which it is not summed."""

SUM_ERROR = 1e-10
"""Largest error of the end of a chatter: the change of the last node by the last order, its state in units of arclength."""

LEAST_ERROR = 1e-30

ROUNDS = 12
"""Most updates of the time of a bounce; it takes four."""

_nodes, _weights = np.polynomial.legendre.leggauss(8)
PLACES = tuple(0.5 * (1.0 + _nodes))
WEIGHTS = tuple(0.5 * _weights)


class Chatter(NamedTuple):
    """What chatter needs besides the orbit: k + 2 rows of nodes of N entries."""

    summed: np.ndarray  # (k + 2,) int64 1: the impact of the row is the first one of a chatter
    slope: np.ndarray  # (k + 2, N, N) derivative of the node at its end by the node before its first impact
    error: np.ndarray  # (k + 2,) estimated error of the end: the change of the node by the last order
    table: np.ndarray  # (ORDERS + 1, 1 + N, N) scratch: the last node of each order, and its derivatives row by row
    new: np.ndarray  # (1 + N, N) scratch
    work: np.ndarray  # (N, N) scratch
    lines: np.ndarray  # (4, N) scratch


@inlined
def impact_blocks(segment, i, before, landing):
    """landing (N, N) = the derivative of the node after impact i, from that of the node `before` it."""
    size = segment.flight.enter.shape[0]
    jump = segment.jump[i]
    speed = row_dot(segment.gap_rate, i, before)
    impact_columns(segment.gap_rate, segment.push, i, jump, landing)
    for j in range(segment.released.columns.shape[0] if segment.contact[i, 1] >= 0 else 0):
        change = segment.released.slopes[j, segment.contact[i, 1]] * speed
        for r in range(size):
            landing[r, size + 1 + j] -= change * segment.push[i, r]
    for j in range(segment.push_slope.shape[0]):
        for r in range(size):
            landing[r, size + 1 + j] -= jump * speed * segment.push_slope[j, i, r]


@kernel
def next_bounce(segment, i, z, slope):
    """Fly from a node z (N,) after impact i to the next impact at the same stop; z and its derivative slope (N, N) become those before it.
    Returns False where there is none."""
    sticking, flight = segment.sticking, orbit_flight(segment, i)
    chatter = sticking.chatter
    row, rate, place, turn = chatter.lines[0], chatter.lines[1], chatter.lines[2], chatter.lines[3]
    width = z.shape[0]
    stop = sticking.closed.shape[1] + i
    loads = segment.flight.loads
    speed = row_dot(segment.gap_rate, i, z)
    press = contact_force(sticking, loads, 0, stop, z, row)
    t = -2.0 * speed / press
    # Bounces without speed last for no time, and change with the restitution all the same. Beyond 0 they go on as a power series.
    sense = segment.jump[i] - 1.0
    if not (segment.side[i] * press > 0.0 and 0.0 <= t * sense < math.inf):
        return False
    bend = 1.0
    for _ in range(ROUNDS):
        # Equation (44), and its derivatives by t and by the node.
        total = 0.0
        by_time = 0.0
        set_1(turn, 0.0)
        for g in range(8):
            x = PLACES[g]
            loaded_flight(flight, z, x * t, place, chatter.work)
            value = contact_force(sticking, loads, 0, stop, place, row)
            loaded_rate(flight, place, rate)
            weight = WEIGHTS[g] * (1.0 - x)
            total += weight * value
            by_time += weight * x * inner(row, rate)
            for r in range(width):
                for c in range(width):
                    turn[c] += weight * t * row[r] * chatter.work[r, c]
        bend = total + t * by_time
        change = -(speed + t * total) / bend
        t += change
        if abs(change) <= 2e-16 * abs(t):
            break
    if not 0.0 <= t * sense < math.inf:
        return False
    for c in range(width):
        turn[c] = -(turn[c] + segment.gap_rate[i, c]) / bend
    loaded_flight(flight, z, t, place, chatter.work)
    loaded_rate(flight, place, rate)
    for r in range(width):
        for c in range(width):
            chatter.work[r, c] += rate[r] * turn[c]
    for c in range(width):
        for r in range(width):
            row[r] = inner(chatter.work[r], slope[:, c])
        for r in range(width):
            slope[r, c] = row[r]
    copy_1(place, z)
    return True


@inlined
def extrapolate_nodes(segment, i, orders, ratio, stride):
    """Take the next node and its derivatives in chatter.new, of which there were `orders` before, into the table. The limit is then in
    `new`. Returns the change by the last order."""
    chatter, size = segment.sticking.chatter, segment.flight.enter.shape[0]
    table, new, older = chatter.table, chatter.new, chatter.lines[0]
    width = new.shape[1]
    restitution = segment.jump[i] - 1.0
    power = 1.0
    change = 0.0
    for level in range(orders + 1):
        power *= ratio
        last = level == orders
        for r in range(1 + width):
            for c in range(width):
                old = table[level, r, c]
                if r == 0:
                    older[c] = old
                value = new[r, c]
                table[level, r, c] = value
                if not last:
                    new[r, c] = (value - power * old) / (1.0 - power)
                    if r == 0 and c <= size and level == orders - 1:  # behind the clock are parameters, which stay
                        change = max(change, abs(new[r, c] - value) / (segment.scale[c] if c < size else 1.0))
        if last:
            break
        # The derivatives of the node by a parameter contain that of q^(level + 1).
        for j in range(segment.released.columns.shape[0]):
            exponent = (level + 1.0) * stride
            by = segment.released.slopes[j, segment.contact[i, 1]] * exponent * restitution ** (exponent - 1.0)
            if by != 0.0:
                for r in range(width):
                    # new = (value - power old)/(1 - power)
                    new[1 + r, size + 1 + j] += by * (new[0, r] - older[r]) / (1.0 - power)
    return change


@shared("none")
def sum_chatter(segment, i, before, after):
    """after (N,) = the node at the end of the chatter that begins with impact i at the node `before` it; its derivative and its error go to
    `Chatter`. NaN where the bounces do not go on."""
    chatter = segment.sticking.chatter
    slope, new = chatter.slope[i], chatter.new
    width = before.shape[0]
    restitution = segment.jump[i] - 1.0
    stride = stride_of(restitution) if restitution > 0.5 else 1
    ratio = restitution**stride
    for r in range(width):
        for c in range(width):
            slope[r, c] = 1.0 if r == c else 0.0
    copy_1(before, after)
    orders = 0
    left = 1.0
    error = math.inf
    while True:
        impact_blocks(segment, i, after, slope)
        apply_impact(segment.gap_rate, segment.push, i, segment.jump[i], after, after)
        copy_1(after, new[0])
        for r in range(width):
            copy_1(slope[r], new[1 + r])
        error = extrapolate_nodes(segment, i, orders, ratio, stride)
        if orders == ORDERS or left < REST:
            break
        orders += 1
        left *= ratio**orders
        for k in range(stride):
            if k > 0:
                impact_blocks(segment, i, after, slope)
                apply_impact(segment.gap_rate, segment.push, i, segment.jump[i], after, after)
            if not next_bounce(segment, i, after, slope):
                set_1(after, math.nan)
                return
    chatter.error[i] = error
    copy_1(new[0], after)
    for r in range(width):
        copy_1(new[1 + r], slope[r])


@chosen
def take_impact(sticking, segment, i, before, after):
    """after (N,) = the node after impact i, or at the end of the chatter that it begins. `before` is the node before it."""


@take_impact.of(Unstuck)
@inlined
def take_impact_once(sticking, segment, i, before, after):
    """One impact."""
    apply_impact(segment.gap_rate, segment.push, i, segment.jump[i], before, after)


@take_impact.of(Sticking)
@inlined
def take_impact_or_chatter(sticking, segment, i, before, after):
    """See `take_impact`."""
    if sticking.chatter.summed[i] == 1:
        sum_chatter(segment, i, before, after)
    else:
        apply_impact(segment.gap_rate, segment.push, i, segment.jump[i], before, after)


@chosen
def take_impact_blocks(sticking, segment, i, before, landing, rate):
    """landing (N, N) and rate (N,) before impact i become those after it, after `take_impact`."""


@take_impact_blocks.of(Unstuck)
@inlined
def take_blocks_once(sticking, segment, i, before, landing, rate):
    """One impact."""
    apply_impact(segment.gap_rate, segment.push, i, segment.jump[i], rate, rate)
    impact_blocks(segment, i, before, landing)


@take_impact_blocks.of(Sticking)
@inlined
def take_blocks_or_chatter(sticking, segment, i, before, landing, rate):
    """See `take_impact_blocks`."""
    if sticking.chatter.summed[i] == 1:
        slope, line = sticking.chatter.slope[i], sticking.chatter.lines[0]
        for c in range(landing.shape[1] + 1):
            for r in range(landing.shape[0]):
                if c < landing.shape[1]:
                    line[r] = inner(slope[r], landing[:, c])
                else:
                    line[r] = inner(slope[r], rate)
            for r in range(landing.shape[0]):
                if c < landing.shape[1]:
                    landing[r, c] = line[r]
                else:
                    rate[r] = line[r]
    else:
        apply_impact(segment.gap_rate, segment.push, i, segment.jump[i], rate, rate)
        impact_blocks(segment, i, before, landing)


@chosen
def is_summed(sticking, i):
    """Whether impact i begins a chatter that is summed."""


@is_summed.of(Unstuck)
@inlined
def is_single(sticking, i):
    """It does not."""
    return False


@is_summed.of(Sticking)
@inlined
def is_chatter(sticking, i):
    """See `is_summed`."""
    return sticking.chatter.summed[i] == 1


@chosen
def chatter_frame(sticking, i, change, lateness, coming, going, out):
    """out (N,) = what a change of the state, (N,) with 0 for all but (u, v), has become behind a chatter.

    Both are at one time. lateness: by how much the chatter begins later. coming, going (N,): rates of the nodes before and after it."""


@chatter_frame.of(Unstuck)
@inlined
def no_chatter_frame(sticking, i, change, lateness, coming, going, out):
    """There is none."""


@chatter_frame.of(Sticking)
@inlined
def chatter_frame_of(sticking, i, change, lateness, coming, going, out):
    """See `chatter_frame`."""
    slope = sticking.chatter.slope[i]
    size = sticking.pull.shape[2]
    for r in range(out.shape[0]):
        out[r] = inner(slope[r], change) + lateness * inner(slope[r], coming)
    late = out[size] / going[size]
    for r in range(size):
        out[r] -= late * going[r]


@chosen
def chatter_room(sticking, segment, i, lasted):
    """(How much longer the chatter of impact i could last, in units of the fastest rate; by how many digits its sum is better than
    `SUM_ERROR`): infinite without chatter, NaN where it has no sum. lasted: part of the period."""


@chatter_room.of(Unstuck)
@inlined
def any_room(sticking, segment, i, lasted):
    """There is no chatter."""
    return math.inf, math.inf


@chatter_room.of(Sticking)
@inlined
def room_of_chatter(sticking, segment, i, lasted):
    """See `chatter_room`."""
    if sticking.chatter.summed[i] == 0:
        return math.inf, math.inf
    loads = segment.flight.loads
    fastest = fastest_rate(orbit_flight(segment, i).free)
    for h in range(loads.harmonics.shape[0]):
        fastest = max(fastest, loads.harmonics[h] * loads.clock[0])
    room = LONGEST - lasted * 2.0 * math.pi * loads.load_periods / loads.clock[0] * fastest
    return room, math.log10(SUM_ERROR / max(sticking.chatter.error[i], LEAST_ERROR))
