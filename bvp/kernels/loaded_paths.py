"""Paths of gaps under periodic loads: the flight as a free one of a larger state, which contains the states of the loads.

A load's state is (cos, sin)(k w t). For each block and each harmonic, either the particular solution X (cos, sin) is taken off the modal
state, or, near resonance, the block contains a state of the load of its own. The bounds and searches of `bvp.kernels.extrema` take such a
flight as any other. They observe the orbit: its clearance, the speeds of its impacts, its flight times.

The bounds of a larger block, and of modes that damp, are poor in long flights. Such a flight is searched in pieces. The states of a block
with loads are scaled so that its matrix is nearly balanced.
"""

import math
from typing import NamedTuple

import numpy as np

from bvp.kernels import multipoint as entry
from bvp.kernels import smooth  # noqa: F401  a kind of flight
from bvp.kernels.compiled import chosen, inlined, kernel
from bvp.kernels.extrema import INSTANT, TIE, Observed, clearance, nearer, nearest_turn, note_contact, slack_of, tie_of
from bvp.kernels.flight import Flight, flow_state, growth_rate, inner, row_dot, set_1, set_2, times_matrix
from bvp.kernels.forced import motion_size, refresh
from bvp.kernels.forced_sticking import (
    add_modal,
    flight_in,
    flight_mode,
    is_closed,
    least_force,
    lift_off,
    mode_count,
    orbit_flight,
    set_rates,
    watch_forces,
)
from bvp.kernels.free_closure import whole_time
from bvp.kernels.loads import NEAR_RESONANCE, LoadedFlight, off_resonance
from bvp.kernels.smooth_loads import SmoothLoadedFlight
from bvp.kernels.sticking import INTERACTION_LEVEL
from bvp.kernels.summed_chatter import chatter_room, is_summed

PIECES = 1000
"""A piece is not shorter than this part of a flight where bounds grow."""

AT_ONCE = 1e-12
"""Part of an orbit by which one of two impacts at once may come before or after the other, where they do not act on each other."""

GROWTH = 2.0
"""What a state can grow or decay by in a piece, as a logarithm."""

FADED = 40.0
"""Decay, as a logarithm, after which a mode is rounding: pieces grow with the time, and their number with the logarithm of a rate."""


class Extended(NamedTuple):
    """A flight with its loads' states, E states in B blocks. H harmonics."""

    flight: Flight
    observed: Observed  # of the S gaps
    state: np.ndarray  # (E,)
    place: np.ndarray  # (2 n,) int64 where each modal coordinate is
    copies: np.ndarray  # (H, n) int64 where the load's own state in each block is; -1: none
    last: np.ndarray  # (1,) int64 where the states of the loads begin that no block contains
    steady: np.ndarray  # (H, 2, 2 n) X, by cos and sin; 0 where the load joined the block
    unit: np.ndarray  # (2 n,) of the state of each modal coordinate
    strength: np.ndarray  # (H, n) what multiplies the load's own state in each block
    work: np.ndarray  # (3, E) scratch


def make_extended(blocks, size, harmonics, gaps, joined):
    """Arrays for a system with the given blocks, 2 n states, H harmonics and S gaps; `joined`: with room for the loads in each block."""
    room = 2 * harmonics * blocks if joined else 0
    states, count = size + room + 2 * harmonics + 1, blocks + room + harmonics
    flight = Flight(np.zeros((count, 2), dtype=np.int64), np.zeros(count), np.zeros(count), np.zeros((states, states)))
    observed = Observed(np.zeros((gaps, 4, states)), np.zeros((2, gaps)))
    return Extended(
        flight, observed, np.zeros(states), np.zeros(size, dtype=np.int64), np.full((harmonics, blocks), -1, dtype=np.int64),
        np.zeros(1, dtype=np.int64), np.zeros((harmonics, 2, size)), np.ones(size), np.ones((harmonics, blocks)), np.zeros((3, states)),
    )  # fmt: skip


@inlined
def member(i, j, r):
    """Where the modal coordinate r of a block (i, j) is: the two of a pair can be far apart, those of a larger block follow each other."""
    return j if j >= 0 and r == 1 else i + r


@inlined
def joins(flight, k, h):
    """Whether harmonic h has to join block k: it acts near resonance, where its particular solution would be large, or on a block that is
    larger than a pair. A harmonic one is far from real rates; so is a constant one, where a fast rate would make a block's bounds poor."""
    free, loads = flight.free, flight.loads
    i, j = free.pairs[k, 0], free.pairs[k, 1]
    acts = False
    for r in range(2 if j >= 0 else -j):
        of_row = member(i, j, r)
        acts = acts or loads.modal[0, h, 0, of_row] != 0.0 or loads.modal[0, h, 1, of_row] != 0.0
    nu = loads.harmonics[h] * loads.clock[0]
    distance, size, product = off_resonance(free, k, nu)
    fast = product > 0.0 and -free.mean[k] > NEAR_RESONANCE * loads.clock[0]
    far = j >= 0 and free.delta[k] > 0.0 and (nu > 0.0 or fast)
    return acts and (j < -1 or (not far and NEAR_RESONANCE * abs(distance) <= size))


@chosen
def any_resonance(flight):
    """Whether a load has to join a block."""


@any_resonance.of(SmoothLoadedFlight)
@inlined
def no_resonance(flight):
    """See `any_resonance`: there are no blocks."""
    return False


@any_resonance.of(LoadedFlight)
@inlined
def any_linear_resonance(flight):
    """See `any_resonance`."""
    for k in range(flight.free.pairs.shape[0]):
        for h in range(flight.loads.harmonics.shape[0]):
            if joins(flight, k, h):
                return True
    return False


@chosen
def extend_flight(flight, gaps, extended):
    """Fill flight, rows and places of `extended` for the loads as they are. gaps (S, n): rows on displacements."""


@extend_flight.of(SmoothLoadedFlight)
@inlined
def extend_smooth_flight(flight, gaps, extended):
    """See `extend_flight`: rows on (u, v) of the gaps and their rates."""
    n = gaps.shape[1]
    for s in range(gaps.shape[0]):
        for i in range(n):
            extended.observed.rows[s, 0, i] = gaps[s, i]
            extended.observed.rows[s, 1, n + i] = gaps[s, i]


@extend_flight.of(LoadedFlight)
@inlined
def extend_linear_flight(flight, gaps, extended):
    """See `extend_flight`."""
    free, loads = flight.free, flight.loads
    pairs, mean, delta, matrix = extended.flight
    rows, steady, place, copies = extended.observed.rows, extended.steady, extended.place, extended.copies
    harmonics = loads.harmonics.shape[0]
    blocks = free.pairs.shape[0]
    room = pairs.shape[0] > blocks + harmonics
    set_2(matrix, 0.0)
    set_1(mean, 0.0)
    set_1(delta, 0.0)
    copies[:] = -1
    at = 0
    count = 0
    for k in range(blocks):
        i = free.pairs[k, 0]
        j = free.pairs[k, 1]
        if k > 0 and i == free.pairs[k - 1, 0]:  # the same block again, to fill the room for blocks
            continue
        size = 2 if j >= 0 else -j
        first = at
        # A pair with loads gets the entries of equal size off its diagonal that a rotation has.
        balance = 1.0
        if j >= 0:
            extended.unit[i] = 1.0
            for h in range(harmonics):
                if joins(flight, k, h) and free.matrix[i, j] != 0.0:
                    balance = max(math.sqrt(abs(free.matrix[j, i] / free.matrix[i, j])), loads.clock[0] / abs(free.matrix[i, j]))
        for r in range(size):
            of_row = member(i, j, r)
            place[of_row] = at + r
            extended.unit[of_row] = balance if j >= 0 and r == 1 else 1.0
        for r in range(size):
            of_row = member(i, j, r)
            for c in range(size):
                of_column = member(i, j, c)
                matrix[at + r, at + c] = free.matrix[of_row, of_column] * extended.unit[of_column] / extended.unit[of_row]
        at += size
        for h in range(harmonics):
            nu = loads.harmonics[h] * loads.clock[0]
            real, imaginary = loads.modal[0, h, 0], loads.modal[0, h, 1]
            if joins(flight, k, h):
                copies[h, k] = at
                strength = 0.0
                for r in range(size):
                    of_row = member(i, j, r)
                    strength = max(strength, (abs(real[of_row]) + abs(imaginary[of_row])) / extended.unit[of_row])
                strength = strength / loads.clock[0] if strength > 0.0 else 1.0
                extended.strength[h, k] = strength
                for r in range(size):
                    of_row = member(i, j, r)
                    matrix[first + r, at] = real[of_row] / (extended.unit[of_row] * strength)
                    matrix[first + r, at + 1] = imaginary[of_row] / (extended.unit[of_row] * strength)
                    steady[h, 0, of_row] = 0.0
                    steady[h, 1, of_row] = 0.0
                matrix[at, at + 1] = -nu
                matrix[at + 1, at] = nu
                at += 2
                continue
            # Equation (38): X = (i nu - B)^-1 (C - i S); 0 where no load acts.
            far, _, _ = off_resonance(free, k, nu)
            part = 1.0 / far if far != 0.0 else complex(0.0, 0.0)
            b = complex(real[i], -imaginary[i])
            found = complex(-free.mean[k], nu) * part * b
            if j >= 0:
                other = complex(real[j], -imaginary[j])
                found = part * (complex(-free.matrix[j, j], nu) * b + free.matrix[i, j] * other)
                second = part * (free.matrix[j, i] * b + complex(-free.matrix[i, i], nu) * other)
                steady[h, 0, j] = second.real
                steady[h, 1, j] = -second.imag
            steady[h, 0, i] = found.real
            steady[h, 1, i] = -found.imag
        pairs[count, 0] = first
        if at == first + size:
            pairs[count, 1] = first + 1 if j >= 0 else j
            mean[count] = free.mean[k]
            delta[count] = free.delta[k]
        else:
            pairs[count, 1] = first - at
            mean[count] = size * free.mean[k] / (at - first)
        count += 1
        while room and at < first + size + 2 * harmonics:
            pairs[count, 0] = at
            pairs[count, 1] = -1
            at += 1
            count += 1
    for h in range(harmonics):
        nu = loads.harmonics[h] * loads.clock[0]
        pairs[count, 0] = at
        pairs[count, 1] = at + 1
        delta[count] = -nu * nu
        matrix[at, at + 1] = -nu
        matrix[at + 1, at] = nu
        at += 2
        count += 1
    while count < pairs.shape[0]:
        # Room that no block needs: the last state, which stays 0.
        pairs[count, 0] = matrix.shape[0] - 1
        pairs[count, 1] = -1
        count += 1
    n = gaps.shape[1]
    extended.last[0] = at - 2 * harmonics
    for s in range(gaps.shape[0]):
        row = rows[s, 0]
        set_1(row, 0.0)
        for r in range(2 * n):
            total = 0.0
            for i in range(n):
                total += gaps[s, i] * flight.leave[i, r]
            add_modal(extended, r, total, row)
        set_rates(extended, s)


@chosen
def extended_state(flight, node, extended):
    """Fill the state of `extended` from a node."""


@extended_state.of(SmoothLoadedFlight)
@inlined
def node_itself(flight, node, extended):
    """See `extended_state`: the path of the flight is kept."""


@extended_state.of(LoadedFlight)
@inlined
def linear_extended_state(flight, node, extended):
    """See `extended_state`."""
    loads = flight.loads
    size = flight.enter.shape[0]
    state = extended.state
    set_1(state, 0.0)
    q = flight.lines[0]
    times_matrix(flight.enter, node, q)
    last = extended.last[0]
    for h in range(loads.harmonics.shape[0]):
        angle = loads.harmonics[h] * 2.0 * math.pi * loads.load_periods * node[size]
        cosine = math.cos(angle)
        sine = math.sin(angle)
        for r in range(size):
            q[r] -= extended.steady[h, 0, r] * cosine + extended.steady[h, 1, r] * sine
        for k in range(extended.copies.shape[1]):
            at = extended.copies[h, k]
            if at >= 0:
                state[at] = cosine * extended.strength[h, k]
                state[at + 1] = sine * extended.strength[h, k]
        state[last + 2 * h] = cosine
        state[last + 2 * h + 1] = sine
    for r in range(size):
        state[extended.place[r]] = q[r] / extended.unit[r]


@inlined
def rates_of(flight):
    """How fast the bounds of a flight's states grow, and how fast states can decay."""
    pairs, mean, delta, matrix = flight
    _, growth = growth_rate(flight)
    decay = 0.0
    for k in range(pairs.shape[0]):
        i = pairs[k, 0]
        for r in range(i, i - pairs[k, 1]):
            decay = max(decay, -matrix[r, r])
        decay = max(decay, (math.sqrt(delta[k]) if delta[k] > 0.0 else 0.0) - mean[k])
    return growth, decay


@chosen
def loaded_clearance(flight, extended, stop, node, start, duration, growth, decay, tie, last):
    """`bvp.kernels.extrema.clearance` of a flight of `extended`, which begins at a node, from the time `start` on. growth, decay: those of
    `rates_of`."""


@loaded_clearance.of(SmoothLoadedFlight)
@inlined
def smooth_clearance(flight, extended, stop, node, start, duration, growth, decay, tie, last):
    """See `loaded_clearance`."""
    return clearance(flight.taylor, extended.observed, stop, node, duration, tie, last, extended.work)


@loaded_clearance.of(LoadedFlight)
@inlined
def linear_clearance(flight, extended, stop, node, start, duration, growth, decay, tie, last):
    """See `loaded_clearance`: in pieces, in which no mode decays by more than GROWTH until it has faded."""
    begin = extended.work[2]
    longest = max(GROWTH / growth, duration / PIECES) if growth > 0.0 else duration
    width = GROWTH / decay if decay > 0.0 else duration
    best = math.inf
    best_side = 0.0
    best_time = 0.0
    sign = 0
    steps = 0
    at = start
    while at < duration:
        width = min(width, longest)
        if at + width >= duration:
            width = duration - at
        flow_state(extended.flight, extended.state, at, begin)
        distance, side, time, sign, steps = nearest_turn(
            extended.flight, extended.observed, stop, begin, width, sign, steps, tie, last - at, extended.work
        )
        if math.isnan(distance):
            return math.nan, 0.0, 0.0
        best, best_side, best_time = nearer(best, best_side, best_time, distance, side, at + time, tie, slack_of(at + time, last, 0.0))
        if at + width == at:
            break
        at += width
        width = max(width, at * GROWTH / FADED)
    return best, best_side, best_time


class Watched(NamedTuple):
    """What is observed of a forced orbit: S stops."""

    gaps: np.ndarray  # (S, n) rows c
    stops: np.ndarray  # (k + 2,) int64 stop of each node; -1: none
    bounds: np.ndarray  # (2, S) int64 entries of the lower and upper bounds
    plain: Extended
    joined: Extended


@kernel
def forced_observe(segment, watched, y, ends, work, result):
    """Fill `result` from `clearance` to `flight_index` for the orbit at y, and `speeds`: the product of the impact speeds, each over the
    largest velocity.

    ends (k + 1, N): the node at the end of each flight. work: not used, here as for other problems."""
    refresh(segment, y[: segment.gap.shape[1]])
    joined = False
    for mode in range(1 + mode_count(segment.sticking)):
        joined = joined or any_resonance(flight_in(segment.sticking, segment.flight, mode))
    if joined:
        observe_with(segment, watched, watched.joined, y, ends, result)
    else:
        observe_with(segment, watched, watched.plain, y, ends, result)


@kernel
def no_order(segment, watched, i):
    """True where flight i lies between impacts at two stops that do not act on each other."""
    before = i - 1 if i > 0 else segment.shape[0]
    if before == i or segment.contact[i, 0] < 0 or segment.contact[before, 0] < 0 or watched.stops[before] == watched.stops[i]:
        return False
    change = 0.0
    size = 0.0
    for r in range(segment.gap_rate.shape[1]):
        part = segment.gap_rate[i, r] * segment.push[before, r]
        change += part
        size += abs(part)
    return abs(change) <= INTERACTION_LEVEL * size


@kernel
def observe_with(segment, watched, extended, y, ends, result):
    """See `forced_observe`."""
    width = segment.gap.shape[1]
    n = watched.gaps.shape[1]
    entries = segment.released.entries
    bounds = extended.observed.bounds
    present = -1
    best = math.inf
    earliest = math.inf
    elapsed = 0.0
    place = result[entry.CLEARANCE_FLIGHT : entry.CLEARANCE_TIME + 1]
    set_1(place, 0.0)
    result[entry.GAVE_UP] = 0.0
    slowest = math.inf
    slowest_node = -1
    shortest = math.inf
    shortest_index = 0
    _, reach, _ = motion_size(segment, y, ends)
    speeds = 1.0
    whole = whole_time(segment, y)
    at = 0
    for i in range(ends.shape[0]):
        node = y[at : at + width]
        duration = y[at + width]
        at += width + 1
        elapsed += duration
        # Two impacts at once that do not act on each other have no order: a flight of no time between them is none that ends.
        lasting = duration + AT_ONCE * whole if no_order(segment, watched, i) else duration
        if lasting < shortest - TIE * elapsed:
            shortest_index = i
        shortest = min(shortest, lasting)
        if segment.contact[i, 0] >= 0:
            speed = segment.side[i] * row_dot(segment.gap_rate, i, ends[i])
            speeds *= speed / reach
            if speed < slowest - TIE * reach:
                slowest_node = i
            slowest = min(slowest, speed)
        mode = flight_mode(segment.sticking, i)
        if mode != present:
            extend_flight(flight_in(segment.sticking, segment.flight, mode), watched.gaps, extended)
            watch_forces(segment.sticking, extended, mode)
            present = mode
        extended_state(orbit_flight(segment, i), node, extended)
        growth, decay = rates_of(extended.flight)
        touched = watched.stops[i - 1 if i > 0 else segment.shape[0]]
        slack = INSTANT * duration
        last = duration - slack if i + 1 == ends.shape[0] else math.inf
        late = slack_of(duration, last, slack)
        for stop in range(bounds.shape[1] if duration > 0.0 else 0):
            bounds[0, stop] = entries[watched.bounds[0, stop]]
            bounds[1, stop] = entries[watched.bounds[1, stop]]
            closed = is_closed(segment.sticking, i, stop)
            if closed:
                # The contact force takes the place of the distance.
                bounds[0, stop] = 0.0
                bounds[1, stop] = math.inf
            longest = min(duration, GROWTH / growth) if growth > 0.0 else duration
            start = lift_off(segment.sticking, segment, i, stop, touched, extended, longest)
            flight = orbit_flight(segment, i)
            gap = watched.gaps[stop]
            tie = max(
                tie_of(gap, gap, node[:n], node[n : 2 * n], duration),
                tie_of(gap, gap, ends[i, :n], ends[i, n : 2 * n], duration),
            )
            distance, side, time = loaded_clearance(flight, extended, stop, node, start, duration, growth, decay, tie, last)
            if math.isnan(distance):
                result[entry.GAVE_UP] = 1.0
            if watched.stops[i] != stop and not closed:
                # The end of the flight can bend the path of this gap, or is a plain cut at its turning point.
                w = inner(watched.gaps[stop], ends[i, :n])
                rate = inner(watched.gaps[stop], ends[i, n : 2 * n])
                rate_after = inner(watched.gaps[stop], y[at + n : at + 2 * n]) if i + 1 < ends.shape[0] else (
                    segment.closing[0] * inner(watched.gaps[stop], y[n : 2 * n])
                )
                if rate >= 0.0 and rate_after <= 0.0:
                    distance, side, time = nearer(distance, side, time, bounds[1, stop] - w, 1.0, duration, tie, late)
                if rate <= 0.0 and rate_after >= 0.0:
                    distance, side, time = nearer(distance, side, time, w - bounds[0, stop], -1.0, duration, tie, late)
            if is_summed(segment.sticking, i) and watched.stops[i] != stop and not closed:
                # Chatter is short: another stop is beyond its bound at the end if it is hit meanwhile.
                w = inner(watched.gaps[stop], y[at : at + n]) if i + 1 < ends.shape[0] else (
                    segment.closing[0] * inner(watched.gaps[stop], y[:n])
                )
                below, above = bounds[1, stop] - w, w - bounds[0, stop]
                towards = 1.0 if below < above + tie else -1.0
                distance, side, time = nearer(distance, side, time, min(below, above), towards, duration, tie, late)
            moment = 0.0 if time > last else elapsed - duration + time
            best, earliest = note_contact(place, best, earliest, moment, i, stop, distance, side, time, tie, slack)
        later = y[at + 2 * n] if i + 1 < ends.shape[0] else y[2 * n] + segment.closing[1]
        room, digits = chatter_room(segment.sticking, segment, i, later - ends[i, 2 * n])
        if math.isnan(room) or math.isnan(digits):
            result[entry.GAVE_UP] = 1.0
        if min(room, digits) * segment.scale[0] < best:
            best = min(room, digits) * segment.scale[0]
            result[entry.CLEARANCE_FLIGHT] = i
            result[entry.CLEARANCE_STOP] = watched.stops[i]
            result[entry.CLEARANCE_SIDE] = 0.0
            result[entry.CLEARANCE_TIME] = duration if room < digits else 0.0
        # A stop that sticks for no time has no contact force.
        distance, nearest, part = least_force(segment.sticking, segment, i, node, ends[i]) if duration > 0.0 else (math.inf, 0, 0.0)
        if distance < best:
            best = distance
            result[entry.CLEARANCE_FLIGHT] = i
            result[entry.CLEARANCE_STOP] = nearest
            result[entry.CLEARANCE_SIDE] = -1.0
            result[entry.CLEARANCE_TIME] = part * duration
    result[entry.CLEARANCE] = best
    result[entry.SPEED] = slowest
    result[entry.SPEED_NODE] = slowest_node
    result[entry.SPEEDS] = speeds
    result[entry.FLIGHT] = shortest
    result[entry.FLIGHT_INDEX] = shortest_index
