"""One step along a family of impacting orbits in three compiled calls: predict, correct, tangent; admissibility and half-waves; half
map and multipliers. Together they give the raw values that test functions are made of.

`bvp.kernels.result.RESULT` names the entries of the result array.
"""

import math

import numpy as np
from numba import int64

from bvp.kernels.arrays import set_1
from bvp.kernels.compiled import kernel, part
from bvp.kernels.cycle import count_impacts, unfold
from bvp.kernels.extrema import Observed, clearance, sign_changes
from bvp.kernels.flight import flow_state
from bvp.kernels.halfmap import half_map
from bvp.kernels.multipoint import (
    ORIGIN,
    PERIODIC,
    REST,
    STOP,
    Metric,
    Segment,
    constraint_row,
    correct,
    factorise,
    locate,
    metric_direction,
    null_vector,
    start_state,
)
from bvp.kernels.pencil import landings, pencil, sweep, trivial_directions
from bvp.kernels.result import (
    ABSORBER_END,
    ABSORBER_START,
    BRANCHING,
    CLEARANCE,
    CLEARANCE_FLIGHT,
    CLEARANCE_SIDE,
    CLEARANCE_STOP,
    CLEARANCE_TIME,
    CONTRACTION,
    CONVERGED,
    DETERMINANT,
    ENERGY,
    FIRST_QUARTER,
    FLIGHT,
    FLIGHT_INDEX,
    GAVE_UP,
    HALF_A,
    HALF_B,
    HALF_C,
    HALF_D,
    IN_PHASE,
    ITERATIONS,
    LARGER_IMAGINARY,
    LARGER_REAL,
    MAGNIFIED,
    QUARTER_PERIOD,
    RESIDUAL,
    SECOND_QUARTER,
    SINGULAR,
    SLOPE,
    SMALLER_IMAGINARY,
    SMALLER_REAL,
    SPEED,
    SPEED_NODE,
    TRACE,
    TRIVIAL,
    TURN,
    WAVES_ABSORBER,
    WAVES_PRIMARY,
)

__all__ = ["end_states", "observe", "orbit_observe", "orbit_stability", "orbit_step", "pack", "stability_2", "tangent_at"]

@part
def tangent_at(segment, y, factor, old_direction, metric, tangent, result):
    """Tangent at a solution y, of unit length in the metric and turned like `old_direction` (all zero: as it comes)."""
    unknowns = y.shape[0]
    sign, smallest = factorise(segment, y, factor)
    null_vector(segment, factor, tangent)
    energy, alpha = locate(segment, y, metric.position)
    change, length = metric_direction(segment, y, metric.position, energy, alpha, tangent, metric.direction)
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
        for r in range(metric.direction.shape[0]):
            metric.direction[r] = -metric.direction[r]
    for j in range(unknowns):
        tangent[j] *= flip
    result[ENERGY] = energy
    result[QUARTER_PERIOD] = alpha
    result[SLOPE] = change * flip
    result[TURN] = 1.0 if first else turn
    result[BRANCHING] = sign * smallest


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
def observe(segment, observed, y, ends, work, result):
    """Admissibility, impact speeds, flight times and half-waves of the orbit at y (`ends`: states at the end of each flight)."""
    size = segment.matrix.shape[0]
    k = segment.shape[0]
    s = segment.start_map.shape[1]
    start = work[0, :size]
    scratch = work[1, :size]
    start_state(segment, y, start)
    best = math.inf
    set_1(result[CLEARANCE_FLIGHT : CLEARANCE_TIME + 1], 0.0)
    result[GAVE_UP] = 0.0
    slowest = math.inf
    slowest_node = -1
    shortest = math.inf
    shortest_index = 0
    changes_absorber = 0
    changes_primary = 0
    sign_absorber = int64(0)
    sign_primary = int64(0)
    total = 0.0
    at = s
    for _ in range(k + 1):
        total += y[at]
        at += size + 1
    middle = 0.5 * total if segment.shape[2] == 2 else total
    elapsed = 0.0
    early = 0
    at = s
    if segment.shape[3] == STOP:
        slowest = 0.0
        for r in range(size):
            slowest -= segment.side[k + 1] * segment.gap_rate[k + 1, r] * start[r]
        slowest_node = k + 1
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
            if speed < slowest:
                slowest = speed
                slowest_node = i
        if duration > 0.0:
            for stop in range(observed.gap.shape[0]):
                distance, side, time = clearance(
                    segment.pairs, segment.mean, segment.delta, segment.matrix, observed, stop, z, duration, scratch
                )
                if math.isnan(distance):
                    result[GAVE_UP] = 1.0
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
                    result[CLEARANCE_FLIGHT] = i
                    result[CLEARANCE_STOP] = stop
                    result[CLEARANCE_SIDE] = side
                    result[CLEARANCE_TIME] = time
            if half_waves:
                found, sign_absorber = sign_changes(
                    segment.pairs, segment.mean, segment.delta, segment.matrix, observed.velocity[0],
                    observed.velocity_rate[0], observed.velocity_second[0], z, duration, sign_absorber, scratch,
                )
                changes_absorber += found
                if found < 0:
                    result[GAVE_UP] = 1.0
                found, sign_primary = sign_changes(
                    segment.pairs, segment.mean, segment.delta, segment.matrix, observed.velocity[1],
                    observed.velocity_rate[1], observed.velocity_second[1], z, duration, sign_primary, scratch,
                )
                changes_primary += found
                if found < 0:
                    result[GAVE_UP] = 1.0
        at += size + 1
    result[CLEARANCE] = best
    result[SPEED] = slowest
    result[SPEED_NODE] = slowest_node
    result[FLIGHT] = shortest
    result[FLIGHT_INDEX] = shortest_index
    if segment.shape[2] == 1:
        changes_absorber = 2 * changes_absorber + 1
        changes_primary = 2 * changes_primary + 1
        early = k
    result[WAVES_ABSORBER] = changes_absorber if half_waves else -1
    result[WAVES_PRIMARY] = changes_primary if half_waves else -1
    result[FIRST_QUARTER] = early
    result[SECOND_QUARTER] = k if segment.shape[2] == 1 else k - early
    result[ABSORBER_START] = math.nan
    result[ABSORBER_END] = math.nan
    result[IN_PHASE] = -1.0
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
            result[ABSORBER_START] = first_absorber
            result[IN_PHASE] = 1.0 if first_absorber * first_primary > 0.0 else 0.0
        if segment.shape[4] == ORIGIN:
            result[ABSORBER_END] = last_absorber
            if not last_absorber * last_primary > 0.0:
                result[IN_PHASE] = 0.0


@part
def stability_2(segment, y, ends, cycle_before, cycle_after, cycle_time, cycle_row, scale, left, right, work, result):
    """Half map, and multipliers of the reduced saddle-point matrix, for two degrees of freedom."""
    size = segment.matrix.shape[0]
    phi = np.empty((2, 2))
    if segment.shape[2] != 4:
        result[MAGNIFIED] = half_map(segment, y, ends, work, phi)
        result[HALF_A] = phi[0, 0]
        result[HALF_B] = phi[0, 1]
        result[HALF_C] = phi[1, 0]
        result[HALF_D] = phi[1, 1]
    else:
        set_1(result[HALF_A : HALF_D + 1], math.nan)
        result[MAGNIFIED] = 1.0
    unfold(segment, y, ends, cycle_before, cycle_after, cycle_time, cycle_row, work)
    nodes = cycle_after.shape[0]
    if nodes == 0:
        set_1(result[TRACE : SINGULAR + 1], math.nan)
        return
    # velocities by sqrt(2 h), not by those at the impacts: an impact may be the only slow part of an orbit
    displacement = 0.0
    energy = 0.0
    for r in range(size):
        energy += segment.weights[r] * cycle_after[0, r] ** 2
    for i in range(nodes):
        for r in range(size // 2):
            displacement = max(displacement, abs(cycle_after[i, r]))
    for r in range(size // 2):
        scale[r] = displacement if displacement > 0.0 else 1.0
        scale[size // 2 + r] = math.sqrt(energy)
    maps = np.empty((nodes, size, size))
    along = np.empty((nodes, size))
    landings(
        segment.pairs, segment.mean, segment.delta, segment.matrix, segment.gap_rate, segment.push, segment.jump, cycle_before,
        cycle_time, cycle_row, scale, maps, along,
    )  # fmt: skip
    pencil(segment.weights, segment.gap, True, cycle_after, cycle_row, scale, maps, along, left, right)
    dimension = size - 2
    frame = np.zeros((dimension, dimension))
    older = np.empty((dimension, dimension))
    for r in range(dimension):
        frame[r, r] = 1.0
    product = np.empty((dimension, dimension))
    exponent = np.empty(dimension)
    height = np.full(nodes, dimension)
    singular = 0
    for _ in range(4):
        for r in range(dimension):
            for c in range(dimension):
                older[r, c] = frame[r, c]
        singular = sweep(left, right, height, height, frame, product, exponent)
        coupling = abs(older[0, 1] * frame[0, 0] + older[1, 1] * frame[1, 0])
        grade = abs(product[0, 1]) + abs(product[0, 0])
        if coupling < 1e-15 or grade < 30.0 * abs(product[1, 1]) * 2.0 ** (exponent[1] - exponent[0]):
            break
    w11 = older[0, 0] * frame[0, 0] + older[1, 0] * frame[1, 0]
    w12 = older[0, 0] * frame[0, 1] + older[1, 0] * frame[1, 1]
    w21 = older[0, 1] * frame[0, 0] + older[1, 1] * frame[1, 0]
    w22 = older[0, 1] * frame[0, 1] + older[1, 1] * frame[1, 1]
    p11 = product[0, 0] * 2.0 ** exponent[0]
    p12 = product[0, 1] * 2.0 ** exponent[0]
    p22 = product[1, 1] * 2.0 ** exponent[1]
    c11 = w11 * p11
    c12 = w11 * p12 + w12 * p22
    c21 = w21 * p11
    c22 = w21 * p12 + w22 * p22
    trace = c11 + c22
    determinant = (w11 * w22 - w12 * w21) * product[0, 0] * product[1, 1] * 2.0 ** (exponent[0] + exponent[1])
    result[TRACE] = trace
    result[DETERMINANT] = determinant
    difference = 0.5 * (c11 - c22)
    square = difference * difference + c12 * c21
    if square >= 0.0:
        larger = 0.5 * trace + math.copysign(math.sqrt(square), trace)
        result[LARGER_REAL] = larger
        result[LARGER_IMAGINARY] = 0.0
        result[SMALLER_REAL] = determinant / larger if larger != 0.0 else 0.0
        result[SMALLER_IMAGINARY] = 0.0
    else:
        result[LARGER_REAL] = 0.5 * trace
        result[LARGER_IMAGINARY] = -math.sqrt(-square)
        result[SMALLER_REAL] = 0.5 * trace
        result[SMALLER_IMAGINARY] = math.sqrt(-square)
    flow, level = trivial_directions(
        segment.pairs, segment.matrix, segment.weights, segment.gap, cycle_after, cycle_row, scale, maps, along
    )
    result[TRIVIAL] = max(flow, level)
    result[SINGULAR] = singular


@kernel
def unpack(pairs, rows, scalars, start_map, shape):
    """The `Segment` whose arrays stand in the rows of one array and the entries of another (see `pack`)."""
    size = rows.shape[1]
    nodes = shape[0] + 2
    blocks = pairs.shape[0]
    at = 3 * nodes + size
    closers = rows.shape[0] - at - 2
    side = 2 * blocks + 2 * nodes
    return Segment(
        pairs,
        scalars[:blocks],
        scalars[blocks : 2 * blocks],
        rows[3 * nodes : at],
        rows[:nodes],
        rows[nodes : 2 * nodes],
        rows[2 * nodes : 3 * nodes],
        scalars[2 * blocks : 2 * blocks + nodes],
        scalars[2 * blocks + nodes : side],
        scalars[side : side + nodes],
        start_map,
        rows[at],
        rows[at + 2 : at + 2 + closers],
        scalars[side + nodes :],
        rows[at + 1],
        shape,
    )


def pack(segment):
    """(pairs, rows, scalars, start_map, shape): few arrays, for calls that should cost little."""
    rows = np.vstack(
        [
            segment.gap,
            segment.gap_rate,
            segment.push,
            segment.matrix,
            segment.start_offset[None],
            segment.weights[None],
            segment.end_map,
        ]
    )
    scalars = np.concatenate(
        [segment.mean, segment.delta, segment.jump, segment.bound, segment.side, segment.end_offset]
    )
    return segment.pairs, np.ascontiguousarray(rows), scalars, segment.start_map, segment.shape


@kernel
def orbit_step(pairs, rows, scalars, start_map, shape, factor, y, tangent, ds, most, metric, out, out_tangent, result):
    """Step from y by ds (ds = 0: correct y itself) and give the tangent where it lands.

    tangent, out_tangent (2 u,): tangent and curvature. `most`: most iterations. metric (4, N + 2): position and direction there,
    then at y. out (u,). result: the entries of RESULT up to `branching`."""
    segment = unpack(pairs, rows, scalars, start_map, shape)
    unknowns = y.shape[0]
    old = Metric(metric[2], metric[3])
    new = Metric(metric[0], metric[1])
    row = factor.work[5, :unknowns]
    residual = factor.work[6, : unknowns - 1]
    along = tangent[:unknowns]
    curvature = tangent[unknowns:]
    set_1(row, 0.0)
    set_1(old.direction, 0.0)
    target = 0.0
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
    good, iterations, contraction, worst = correct(segment, out, row, target, factor, residual, most, 2e-15)
    result[CONVERGED] = 1.0 if good else 0.0
    result[ITERATIONS] = iterations
    result[CONTRACTION] = contraction
    result[RESIDUAL] = worst
    if not good:
        return
    tangent_at(segment, out, factor, old.direction, new, out_tangent[:unknowns], result)
    for j in range(unknowns):
        out_tangent[unknowns + j] = (out_tangent[j] - along[j]) / ds if ds != 0.0 else 0.0


@kernel
def orbit_observe(pairs, rows, scalars, start_map, shape, observed, bounds, y, ends, work, result):
    """Admissibility and half-waves of the orbit at y: the entries of RESULT from `clearance` to `gave_up`.

    observed (4 S + 6, N): the rows of `Observed` one after the other (4 S of the gaps, then the velocities where there are any),
    bounds (2, S)."""
    segment = unpack(pairs, rows, scalars, start_map, shape)
    stops = bounds.shape[1]
    watched = (observed.shape[0] - 4 * stops) // 3
    at = 4 * stops
    functionals = Observed(
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
    observe(segment, functionals, y, ends, work, result)


@kernel
def orbit_stability(pairs, rows, scalars, start_map, shape, y, ends, work, result):
    """Half map and multipliers of the orbit at y, n = 2: the entries of RESULT from `a` on."""
    segment = unpack(pairs, rows, scalars, start_map, shape)
    size = rows.shape[1]
    nodes = count_impacts(shape)
    before = np.empty((nodes, size))
    after = np.empty((nodes, size))
    duration = np.empty(nodes)
    node = np.empty(nodes, np.int64)
    left = np.empty((nodes, size, size))
    right = np.empty((nodes, size, size))
    scale = np.empty(size)
    stability_2(segment, y, ends, before, after, duration, node, scale, left, right, work, result)


@kernel
def end_states(segment, y, work, out):
    """States at the end of each flight, (k + 1, N)."""
    size = segment.matrix.shape[0]
    z = work[0, :size]
    start_state(segment, y, z)
    at = segment.start_map.shape[1]
    for i in range(segment.shape[0] + 1):
        if i > 0:
            z = y[at - size : at]
        flow_state(segment.pairs, segment.mean, segment.delta, segment.matrix, z, y[at], out[i])
        at += size + 1
