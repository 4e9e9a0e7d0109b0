"""What is seen along the flights of an orbit: admissibility, speeds of the impacts, half-waves."""

import math

from numba import int64

from bvp.kernels import segment as entry
from bvp.kernels.arrays import set_1
from bvp.kernels.compiled import kernel, part, sized
from bvp.kernels.extrema import Observed, clearance, sign_changes
from bvp.kernels.segment import ORIGIN, PERIODIC, REST, STOP, sized_rows, start_state, total_time, unpack


@kernel
def bends(segment, observed, stop, i, end):
    """Whether flight i begins (end 0) or ends (1) with an impact at another stop than the given one, which bends the path of its
    gap there: an extremum that is no turning point inside a flight."""
    k = segment.shape[0]
    if end == 0:
        node = i - 1 if i > 0 else k + 1
        hit = i > 0 or segment.shape[3] == STOP or segment.shape[3] == PERIODIC
    else:
        node = i
        hit = i < k or segment.shape[4] == STOP or segment.shape[4] == PERIODIC
    if not hit:
        return False
    apart = 0.0
    size = 0.0
    for r in range(observed.gap.shape[1]):
        apart += abs(observed.gap[stop, r] - segment.gap[node, r])
        size += abs(observed.gap[stop, r])
    return apart > 1e-9 * size


@part
def turns_of(segment, observed, coordinate, z, duration, sign, scratch, result):
    """`sign_changes` of one observed velocity along a flight; a search that gives up is noted in `result`."""
    found, last = sign_changes(
        segment.flight, observed.velocity[coordinate],
        observed.velocity_rate[coordinate], observed.velocity_second[coordinate], z, duration, sign, scratch,
    )  # fmt: skip
    if found < 0:
        result[entry.GAVE_UP] = 1.0
    return found, last


@part
def observe(segment, observed, y, ends, work, result):
    """Admissibility, impact speeds, flight times and half-waves of the orbit at y (`ends`: states at the end of each flight)."""
    size = segment.flight.matrix.shape[1]
    k = segment.shape[0]
    s = segment.start_map.shape[1]
    start = work[0, :size]
    scratch = work[1, :size]
    start_state(segment.start_map, segment.start_offset, y, start)
    best = math.inf
    set_1(result[entry.CLEARANCE_FLIGHT : entry.CLEARANCE_TIME + 1], 0.0)
    result[entry.GAVE_UP] = 0.0
    slowest = math.inf
    slowest_node = -1
    shortest = math.inf
    shortest_index = 0
    changes_absorber = 0
    changes_primary = 0
    sign_absorber = int64(0)
    sign_primary = int64(0)
    total = total_time(segment.flight.matrix, segment.start_map, segment.shape, y)
    middle = 0.5 * total if segment.shape[2] == 2 else total
    elapsed = 0.0
    early = 0
    at = s
    reach = 0.0
    for r in range(size):
        reach += segment.weights[r] * start[r] * start[r]
    reach = math.sqrt(reach)
    speeds = 1.0
    if segment.shape[3] == STOP:
        slowest = 0.0
        for r in range(size):
            slowest -= segment.side[k + 1] * segment.gap_rate[k + 1, r] * start[r]
        slowest_node = k + 1
        speeds = slowest / reach
    half_waves = segment.shape[2] != 4 and observed.velocity.shape[0] == 2
    for i in range(k + 1):
        z = start if i == 0 else y[at - size : at]
        duration = y[at]
        if duration < shortest:
            shortest = duration
            shortest_index = i
        elapsed += duration
        if i < k and elapsed < middle:
            early += 1
        if i < k or segment.shape[4] == STOP or segment.shape[4] == PERIODIC:
            speed = 0.0
            for r in range(size):
                speed += segment.side[i] * segment.gap_rate[i, r] * ends[i, r]
            speeds *= speed / reach
            if speed < slowest:
                slowest = speed
                slowest_node = i
        if duration > 0.0:
            for stop in range(observed.gap.shape[0]):
                distance, side, time = clearance(segment.flight, observed, stop, z, duration, work[1:3])
                if math.isnan(distance):
                    result[entry.GAVE_UP] = 1.0
                for end in range(2):
                    resting = (end == 0 and i == 0 and segment.shape[3] == REST) or (
                        end == 1 and i == k and segment.shape[4] == REST
                    )
                    if resting or (observed.gap.shape[0] > 1 and bends(segment, observed, stop, i, end)):
                        w = 0.0
                        for r in range(size):
                            w += observed.gap[stop, r] * (z[r] if end == 0 else ends[i, r])
                        reach = min(observed.upper[stop] - w, w - observed.lower[stop])
                        if reach < distance:
                            distance = reach
                            side = 1.0 if observed.upper[stop] - w < w - observed.lower[stop] else -1.0
                            time = 0.0 if end == 0 else duration
                if distance < best:
                    best = distance
                    result[entry.CLEARANCE_FLIGHT] = i
                    result[entry.CLEARANCE_STOP] = stop
                    result[entry.CLEARANCE_SIDE] = side
                    result[entry.CLEARANCE_TIME] = time
            if half_waves:
                for coordinate in range(2):
                    sign = sign_absorber if coordinate == 0 else sign_primary
                    found, sign = turns_of(segment, observed, coordinate, z, duration, sign, scratch, result)
                    if coordinate == 0:
                        changes_absorber += found
                        sign_absorber = sign
                    else:
                        changes_primary += found
                        sign_primary = sign
        at += size + 1
    result[entry.CLEARANCE] = best
    result[entry.SPEED] = slowest
    result[entry.SPEED_NODE] = slowest_node
    result[entry.SPEEDS] = speeds
    result[entry.FLIGHT] = shortest
    result[entry.FLIGHT_INDEX] = shortest_index
    if segment.shape[2] == 1:
        changes_absorber = 2 * changes_absorber + 1
        changes_primary = 2 * changes_primary + 1
        early = k
    result[entry.WAVES_ABSORBER] = changes_absorber if half_waves else -1
    result[entry.WAVES_PRIMARY] = changes_primary if half_waves else -1
    result[entry.FIRST_QUARTER] = early
    result[entry.SECOND_QUARTER] = k if segment.shape[2] == 1 else k - early
    result[entry.ABSORBER_START] = math.nan
    result[entry.ABSORBER_END] = math.nan
    result[entry.IN_PHASE] = -1.0
    if half_waves:
        first_absorber = 0.0
        first_primary = 0.0
        last_absorber = 0.0
        last_primary = 0.0
        for r in range(size):
            first_absorber += observed.velocity[0, r] * start[r]
            first_primary += observed.velocity[1, r] * start[r]
            last_absorber += observed.velocity[0, r] * ends[k, r]
            last_primary += observed.velocity[1, r] * ends[k, r]
        if segment.shape[3] == ORIGIN:
            result[entry.ABSORBER_START] = first_absorber
            result[entry.IN_PHASE] = 1.0 if first_absorber * first_primary > 0.0 else 0.0
        if segment.shape[4] == ORIGIN:
            result[entry.ABSORBER_END] = last_absorber
            if not last_absorber * last_primary > 0.0:
                result[entry.IN_PHASE] = 0.0


@part
def unpack_observed(observed, bounds):
    """The `Observed` whose rows stand one after the other in an array."""
    stops = bounds.shape[1]
    watched = (observed.shape[0] - 4 * stops) // 3
    at = 4 * stops
    return Observed(
        observed[:stops],
        observed[stops : 2 * stops],
        observed[2 * stops : 3 * stops],
        observed[3 * stops : at],
        bounds[0],
        bounds[1],
        observed[at : at + watched],
        observed[at + watched : at + 2 * watched],
        observed[at + 2 * watched :],
    )


@kernel
def orbit_observe(pairs, rows, scalars, start_map, shape, observed, bounds, y, ends, work, result):
    """Admissibility and half-waves of the orbit at y: the entries of RESULT from `clearance` to `gave_up`.

    observed (4 S + 6, N): the rows of `Observed` one after the other (4 S of the gaps, then the velocities where there are any),
    bounds (2, S)."""
    observe(unpack(pairs, rows, scalars, start_map, shape), unpack_observed(observed, bounds), y, ends, work, result)


@kernel
def two_dof_orbit_observe(pairs, rows, scalars, start_map, shape, observed, bounds, y, ends, work, result):
    """See `orbit_observe`; N = 4."""
    segment = sized_rows(unpack(pairs, rows, scalars, start_map, shape))
    observe(segment, unpack_observed(sized(observed, 4), bounds), y, sized(ends, 4), work, result)
