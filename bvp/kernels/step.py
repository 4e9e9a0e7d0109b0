"""One step along a family of impacting orbits, equation (33): predict, correct, tangent.

Then the flights of the orbit are looked at: admissibility, speeds of the impacts, half-waves.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy import int64

from bvp.kernels import multipoint as entry
from bvp.kernels.compiled import chosen, inlined, kernel
from bvp.kernels.cuts import is_cut, is_smooth
from bvp.kernels.extrema import INSTANT, TIE, clearance, nearer, note_contact, sign_changes, slack_of, tie_of
from bvp.kernels.flight import inner, row_dot, set_1
from bvp.kernels.flights import energy_slope, path_state, rate, slope_times, twice_energy
from bvp.kernels.multipoint import (
    ORIGIN,
    PERIODIC,
    REST,
    STOP,
    Factor,
    Segment,
    start_state,
    total_time,
    unpack,
)
from bvp.kernels.newton import conditioning, correct

_LONG_ENOUGH = 1e-4
"""Length of a step whose third derivative has digits: its rounding eps/length^3, over a step of the longest length 0.025, is 1e-9."""

_AT_MIDDLE = 1e-12
"""Part of the time to the middle by which an impact that is in the second half can be early, by rounding."""

UNPACED = 1 << 20
"""In place of the power of two in the arclength of a system without a frequency: the unit of time is the quarter period."""

_SHIFT = 0.1
"""Part of a step by which a prediction may be longer than its projection on the tangent."""


@inlined
def tangent_at(segment, y, factor, sign, smallest, old_direction, metric, tangent, result):
    """Tangent at a solution y, of unit length in the metric and turned like `old_direction` (all zero: as it comes). sign, smallest: of
    the factorisation there, whose null vector is in factor.work[4]."""
    unknowns = y.shape[0]
    null = factor.work[4]
    energy, alpha = locate(segment, y, metric.position)
    change, length = metric_direction(segment, y, metric.position, energy, alpha, null, metric.direction)
    turn = 0.0
    first = True
    for r in range(metric.direction.shape[0]):
        metric.direction[r] /= length
        turn += metric.direction[r] * old_direction[r]
        if old_direction[r] != 0.0:
            first = False
    flip = 1.0 / length
    if turn < 0.0 and not first:
        flip = -flip
        sign = -sign
        turn = -turn
    for j in range(unknowns):
        tangent[j] = null[j] * flip
    result[entry.ENERGY] = energy
    result[entry.QUARTER_PERIOD] = alpha
    result[entry.SLOPE] = change * flip
    result[entry.TURN] = 1.0 if first else turn
    result[entry.BRANCHING] = sign * smallest
    result[entry.STEEPNESS] = 1.0 / length


class Request(NamedTuple):
    """The input of a step."""

    ds: float  # length; 0: correct the given point itself
    target: float  # nan; a number: hold y on row . y = target in place of the length, the row being in factor.work[5]
    most: int  # most iterations; `bvp.kernels.newton.LINEARISED`


class Landing(NamedTuple):
    """The output of a step."""

    y: np.ndarray  # (u,)
    tangent: np.ndarray  # (2 u,) tangent, then curvature; (3 u,) with the third derivative behind them
    result: np.ndarray  # (len(RESULT),)


@inlined
def take_step(segment, factor, y, tangent, request, metric, landing):
    """Take a step from y along its `tangent`: tangent, curvature, and the third derivative where there is one (see `Landing`).

    metric (4, N + 2): scratch, whose first row receives the position of the new point. The entries of the landing's result up to
    `branching` are filled."""
    ds, target, most = request
    out, out_tangent, result = landing
    unknowns = y.shape[0]
    old = Metric(metric[2], metric[3])
    new = Metric(metric[0], metric[1])
    row = factor.work[5, :unknowns]
    residual = factor.work[6, : unknowns - 1]
    along = tangent[:unknowns]
    curvature = tangent[unknowns : 2 * unknowns]
    if target != target:
        set_1(row, 0.0)
    set_1(old.direction, 0.0)
    oriented = False
    for j in range(unknowns):
        out[j] = y[j] + ds * (along[j] + 0.5 * ds * curvature[j])
        if along[j] != 0.0:
            oriented = True
    if oriented:
        energy, alpha = locate(segment, y, old.position)
        metric_direction(segment, y, old.position, energy, alpha, along, old.direction)
    if ds != 0.0:
        constraint_row(segment, y, energy, alpha, old.position, old.direction, row)
        target = ds
        for j in range(unknowns):
            target += row[j] * y[j]
        if is_smooth(segment.flight) and tangent.shape[0] > 2 * unknowns:
            _predict_cubic(y, tangent, ds, row, out)
    good, iterations, contraction, worst, sign, smallest = correct(segment, out, row, target, factor, residual, most, 2e-15)
    result[entry.CONVERGED] = 1.0 if good else 0.0
    result[entry.ITERATIONS] = iterations
    result[entry.CONTRACTION] = contraction
    result[entry.RESIDUAL] = worst
    if not good:
        return
    result[entry.CONDITIONING] = conditioning(segment, factor, residual)
    tangent_at(segment, out, factor, sign, smallest, old.direction, new, out_tangent[:unknowns], result)
    for j in range(unknowns):
        out_tangent[unknowns + j] = (out_tangent[j] - along[j]) / ds if ds != 0.0 else 0.0
    if is_smooth(segment.flight) and out_tangent.shape[0] > 2 * unknowns:
        _derivatives_of_cubic(y, along, out, ds, old.position, new.position, result[entry.TURN], out_tangent)


@inlined
def _predict_cubic(y, tangent, ds, row, out):
    """out = y + s t + s^2/2 y'' + s^3/6 y''' at the s at which it is on the plane row . (out - y) = ds."""
    unknowns = y.shape[0]
    first = 0.0
    second = 0.0
    third = 0.0
    for j in range(unknowns):
        first += row[j] * tangent[j]
        second += 0.5 * row[j] * tangent[unknowns + j]
        third += row[j] * tangent[2 * unknowns + j] / 6.0
    s = ds
    for _ in range(3):
        s -= (s * (first + s * (second + s * third)) - ds) / (first + s * (2.0 * second + 3.0 * s * third))
    if abs(s - ds) < _SHIFT * abs(ds):
        for j in range(unknowns):
            out[j] = y[j] + s * (tangent[j] + s * (0.5 * tangent[unknowns + j] + s * tangent[2 * unknowns + j] / 6.0))


@inlined
def _derivatives_of_cubic(y, along, out, ds, position, new_position, turn, tangent):
    """Second and third derivative at the end of a step, behind the `tangent` there: of the cubic with the values and tangents at both
    ends of the step, over the arclength between them. After a short step rounding decides the third: it is zero."""
    unknowns = y.shape[0]
    if abs(ds) < _LONG_ENOUGH:
        set_1(tangent[2 * unknowns :], 0.0)
        return
    chord = 0.0
    for r in range(position.shape[0]):
        chord += (new_position[r] - position[r]) ** 2
    half = 0.5 * (1.0 - turn)  # sin(theta/2)^2
    length = math.copysign(math.sqrt(chord) * (1.0 + half * (1.0 / 6.0 + 0.075 * half)), ds)  # chord (theta/2)/sin(theta/2)
    for j in range(unknowns):
        mean = (out[j] - y[j]) / length
        late = (tangent[j] - mean) / length
        third = (late - (mean - along[j]) / length) / length
        tangent[unknowns + j] = 2.0 * (late + length * third)
        tangent[2 * unknowns + j] = 6.0 * third


@kernel
def orbit_step(packed, factor, y, tangent, request, metric, landing):
    """See `take_step`."""
    take_step(unpack(packed), factor, y, tangent, request, metric, landing)


@kernel
def end_states(segment, y, work, out):
    """States at the end of each flight, (k + 1, N)."""
    size = segment.flight.matrix.shape[0]
    z = work[0, :size]
    start_state(segment.start_map, segment.start_offset, y, z)
    at = segment.start_map.shape[1]
    for i in range(segment.shape[0] + 1):
        if i > 0:
            z = y[at - size : at]
        path_state(segment.flight, z, y[at], out[i])
        at += size + 1


class Metric(NamedTuple):
    """Position and direction of the family in the coordinates (start state / sqrt(2 h), log h, log alpha)."""

    position: np.ndarray  # (N + 2,)
    direction: np.ndarray  # (N + 2,)


@inlined
def stretch(segment, position, alpha, power):
    """Multiply the displacements of a state by the unit of the arclength (1), or divide them (-1): a power of two, or 1/alpha."""
    unit = alpha**-power if segment.shape[5] == UNPACED else 2.0 ** (power * segment.shape[5])
    for r in range(segment.flight.matrix.shape[1] // 2):
        position[r] *= unit


@chosen
def locate(segment, y, out):
    """(start displacements times the unit of `shape`, and velocities, / sqrt(2 h); log h, log alpha) and (h, alpha)."""


@locate.of(Segment)
@inlined
def locate_free(segment, y, out):
    """See `locate`."""
    size = segment.flight.matrix.shape[1]
    start_state(segment.start_map, segment.start_offset, y, out[:size])
    energy = 0.5 * twice_energy(segment.flight, segment.weights, out[:size])
    alpha = total_time(segment.flight.matrix, segment.start_map, segment.shape, y) / segment.shape[2]
    speed = math.sqrt(2.0 * energy)
    for r in range(size):
        out[r] /= speed
    stretch(segment, out, alpha, 1)
    out[size] = math.log(energy)
    out[size + 1] = math.log(alpha) if alpha > 0.0 else -math.inf
    return energy, alpha


@chosen
def metric_direction(segment, y, position, energy, alpha, tangent, out):
    """Change of `locate` along `tangent`; returns (d h, length)."""


@metric_direction.of(Segment)
@inlined
def metric_direction_free(segment, y, position, energy, alpha, tangent, out):
    """See `metric_direction`."""
    # Equation (33): dp/dy times the tangent.
    size = segment.flight.matrix.shape[1]
    s = segment.start_map.shape[1]
    speed = math.sqrt(2.0 * energy)
    change = 0.0
    stretch(segment, position, alpha, -1)
    slope = energy_slope(segment.flight, segment.weights, position[:size], speed)
    for r in range(size):
        total = row_dot(segment.start_map, r, tangent[:s])
        out[r] = total / speed
        change += slope_times(slope, r, 1.0) * total
    for r in range(size):
        out[r] -= position[r] * change / (2.0 * energy)
    stretch(segment, position, alpha, 1)
    stretch(segment, out, alpha, 1)
    out[size] = change / energy
    out[size + 1] = total_time(segment.flight.matrix, segment.start_map, segment.shape, tangent) / segment.shape[2] / alpha
    if segment.shape[5] == UNPACED:
        for r in range(size // 2):
            out[r] -= position[r] * out[size + 1]
    return change, math.sqrt(inner(out, out))


@chosen
def constraint_row(segment, y, energy, alpha, position, direction, row):
    """Row r with r . dy = <direction, change of `locate` along dy>: the pseudo-arclength condition in the unknowns."""


@constraint_row.of(Segment)
@inlined
def constraint_row_free(segment, y, energy, alpha, position, direction, row):
    """See `constraint_row`."""
    # Equation (33): the row of the unknowns' changes.
    size = segment.flight.matrix.shape[1]
    s = segment.start_map.shape[1]
    speed = math.sqrt(2.0 * energy)
    along = inner(direction[:size], position[:size])
    later = direction[size + 1] - (inner(direction[: size // 2], position[: size // 2]) if segment.shape[5] == UNPACED else 0.0)
    set_1(row, 0.0)
    radial = direction[size] / energy - along / (2.0 * energy)
    stretch(segment, position, alpha, -1)
    stretch(segment, direction, alpha, 1)
    slope = energy_slope(segment.flight, segment.weights, position[:size], speed)
    for j in range(s):
        total = 0.0
        for r in range(size):
            total += segment.start_map[r, j] * (direction[r] / speed + slope_times(slope, r, radial))
        row[j] = total
    stretch(segment, position, alpha, 1)
    stretch(segment, direction, alpha, -1)
    at = s
    for _ in range(segment.shape[0] + 1):
        row[at] = later / segment.shape[2] / alpha
        at += size + 1


@kernel
def bends(segment, observed, stop, i, end):
    """Whether flight i begins (end 0) or ends (end 1) with an impact at another stop. Such an impact bends the path of this stop's gap,
    so the gap can have an extremum there that is not a turning point inside a flight."""
    k = segment.shape[0]
    if end == 0:
        node = i - 1 if i > 0 else k + 1
        hit = i > 0 or segment.shape[3] == STOP or segment.shape[3] == PERIODIC
    else:
        node = i
        hit = i < k or segment.shape[4] == STOP or segment.shape[4] == PERIODIC
    if not hit or is_cut(segment.flight, segment.side, node):
        return False
    apart = 0.0
    size = 0.0
    for r in range(segment.gap.shape[1]):
        apart += abs(observed.rows[stop, 0, r] - segment.gap[node, r])
        size += abs(observed.rows[stop, 0, r])
    return apart > 1e-9 * size


@inlined
def half_waves(segment, rows, y, work, result):
    """Sign changes along the orbit at y of the velocity with the given rows, and its signs at the first and last instants at which it has
    one (0: it has none). A search that gives up is noted in `result`.

    Velocities are zero at rest. After a flight with large accelerations they are so to more than their rounding. At an origin a velocity
    can be zero, too. Its signs are those that the count takes, beside the origin."""
    size = segment.flight.matrix.shape[1]
    k = segment.shape[0]
    start = work[0, :size]
    start_state(segment.start_map, segment.start_offset, y, start)
    changes = 0
    sign = int64(0)
    at = segment.start_map.shape[1]
    for i in range(k + 1):
        z = start if i == 0 else y[at - size : at]
        from_rest = i == 0 and segment.shape[3] == REST
        to_rest = i == k and segment.shape[4] == REST
        found, sign = sign_changes(segment.flight, rows[0], rows[1], rows[2], z, y[at], sign, from_rest, to_rest, work[1, :size])
        if found < 0:
            result[entry.GAVE_UP] = 1.0
        changes += found
        at += size + 1
    return changes, sign if changes % 2 == 0 else -sign, sign


@inlined
def observe(segment, observed, y, ends, work, result):
    """Fill `result` from `clearance` to `gave_up` for the orbit at y: admissibility, impact speeds, flight times, half-waves.

    ends (k + 1, N): the state at the end of each flight. work: scratch."""
    size = segment.flight.matrix.shape[1]
    k = segment.shape[0]
    start = work[0, :size]
    start_state(segment.start_map, segment.start_offset, y, start)
    stops = observed.bounds.shape[1]
    best = math.inf
    earliest = math.inf
    place = result[entry.CLEARANCE_FLIGHT : entry.CLEARANCE_TIME + 1]
    set_1(place, 0.0)
    result[entry.GAVE_UP] = 0.0
    slowest = math.inf
    slowest_node = -1
    shortest = math.inf
    shortest_index = 0
    total = total_time(segment.flight.matrix, segment.start_map, segment.shape, y)
    middle = 0.5 * total if segment.shape[2] == 2 else total
    elapsed = 0.0
    early = 0
    impacts = 0
    at = segment.start_map.shape[1]
    reach = math.sqrt(twice_energy(segment.flight, segment.weights, start))
    speeds = 1.0
    if segment.shape[3] == STOP:
        slowest = -segment.side[k + 1] * row_dot(segment.gap_rate, k + 1, start)
        slowest_node = k + 1
        speeds = slowest / reach
    for i in range(k + 1):
        z = start if i == 0 else y[at - size : at]
        duration = y[at]
        elapsed += duration
        if duration < shortest - TIE * elapsed:
            shortest_index = i
        shortest = min(shortest, duration)
        cut = is_cut(segment.flight, segment.side, i)
        if i < k and not cut:
            impacts += 1
            if elapsed < middle * (1.0 - _AT_MIDDLE):
                early += 1
        if cut and i == k and segment.shape[4] == PERIODIC:
            # The start of a closed orbit without impacts is a maximum as long as this is above 0.
            rate(segment.flight, start, work[1, :size])
            slowest = -row_dot(segment.gap, k, work[1, :size])
            slowest_node = k
        if not cut and (i < k or segment.shape[4] == STOP or segment.shape[4] == PERIODIC):
            speed = segment.side[i] * row_dot(segment.gap_rate, i, ends[i])
            speeds *= speed / reach
            if speed < slowest - TIE * reach:
                slowest_node = i
            slowest = min(slowest, speed)
        slack = INSTANT * duration
        last = duration - slack if i == k and segment.shape[4] == PERIODIC else math.inf
        for stop in range(stops if duration > 0.0 else 0):
            # Equation (26) between the turning points of the gap.
            gap = observed.rows[stop]
            tie = max(tie_of(gap[0], gap[1], z, z, duration), tie_of(gap[0], gap[1], ends[i], ends[i], duration))
            distance, side, time = clearance(segment.flight, observed, stop, z, duration, tie, last, work[1:3])
            if math.isnan(distance):
                result[entry.GAVE_UP] = 1.0
            for end in range(2):
                resting = (end == 0 and i == 0 and segment.shape[3] == REST) or (end == 1 and i == k and segment.shape[4] == REST)
                if resting or (stops > 1 and bends(segment, observed, stop, i, end)):
                    w = row_dot(observed.rows[stop], 0, z) if end == 0 else row_dot(observed.rows[stop], 0, ends[i])
                    above = w - observed.bounds[0, stop]
                    below = observed.bounds[1, stop] - w
                    towards = 1.0 if below < above + tie else -1.0
                    instant = 0.0 if end == 0 else duration
                    distance, side, time = nearer(
                        distance, side, time, min(below, above), towards, instant, tie, slack_of(instant, last, slack)
                    )
            moment = 0.0 if time > last else elapsed - duration + time
            best, earliest = note_contact(place, best, earliest, moment, i, stop, distance, side, time, tie, slack)
        at += size + 1
    result[entry.CLEARANCE] = best
    result[entry.SPEED] = slowest
    result[entry.SPEED_NODE] = slowest_node
    result[entry.SPEEDS] = speeds
    result[entry.FLIGHT] = shortest
    result[entry.FLIGHT_INDEX] = shortest_index
    result[entry.FIRST_QUARTER] = impacts if segment.shape[2] == 1 else early
    result[entry.SECOND_QUARTER] = impacts if segment.shape[2] == 1 else impacts - early
    result[entry.ABSORBER_START] = math.nan
    result[entry.ABSORBER_END] = math.nan
    result[entry.IN_PHASE] = -1.0
    set_1(result[entry.WAVES_ABSORBER : entry.WAVES_PRIMARY + 1], -1.0)
    if segment.shape[2] == 4 or observed.rows.shape[0] == stops:
        return
    at_start = int64(1)
    at_end = int64(1)
    for coordinate in range(2):
        # The quarter of an orbit has half of its half-waves but one.
        waves, first, last = half_waves(segment, observed.rows[stops + coordinate], y, work, result)
        result[entry.WAVES_ABSORBER + coordinate] = 2 * waves + 1 if segment.shape[2] == 1 else waves
        at_start *= first
        at_end *= last
    absorber = observed.rows[stops]
    if segment.shape[3] == ORIGIN:
        result[entry.ABSORBER_START] = row_dot(absorber, 0, start)
        result[entry.IN_PHASE] = 1.0 if at_start > 0 else 0.0
    if segment.shape[4] == ORIGIN:
        result[entry.ABSORBER_END] = row_dot(absorber, 0, ends[k])
        if not at_end > 0:
            result[entry.IN_PHASE] = 0.0


@kernel
def orbit_observe(packed, observed, y, ends, work, result):
    """See `observe`."""
    observe(unpack(packed), observed, y, ends, work, result)


class CompiledProblem(NamedTuple):
    """The data of a problem for a kernel that takes several steps (`bvp.kernels.compiled.call_at`)."""

    addresses: np.ndarray  # (3,) int64 of the kernels that take a step, that observe, and `orbit_stability` (n = 2); 0: not wanted
    packed: Any  # a segment as these kernels take it
    factor: Factor
    observed: Any
    work: np.ndarray  # scratch
    period: Any
