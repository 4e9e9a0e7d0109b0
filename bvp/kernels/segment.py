"""What the kernels know of a multipoint problem: its flights' modes, its contacts, its two ends."""

from typing import NamedTuple

import numpy as np
from numba import int64

from bvp.kernels.compiled import inlined, kernel, part, sized
from bvp.kernels.flight import Flight

ORIGIN, REST, STOP, PERIODIC = 0, 1, 2, 3
"""Kinds of an end."""


class Segment(NamedTuple):
    """What the kernels know of a problem. N = 2 n entries a state, k inner impacts. Row k of the node arrays is the
    impact at the far end or, for a periodic orbit, the closing one; row k + 1 is the impact at the start (zero where there is none)."""

    flight: Flight
    gap: np.ndarray  # (k + 2, N) rows g of the contacts hit
    gap_rate: np.ndarray  # (k + 2, N) rows g B
    push: np.ndarray  # (k + 2, N) directions of the impulses
    jump: np.ndarray  # (k + 2,) 1 + restitution
    bound: np.ndarray  # (k + 2,)
    side: np.ndarray  # (k + 2,) +1 upper, -1 lower
    start_map: np.ndarray  # (N, s) Z
    start_offset: np.ndarray  # (N,) c
    end_map: np.ndarray  # (c, N) L
    end_offset: np.ndarray  # (c,) l
    weights: np.ndarray  # (N,) H = sum(weights z^2)/2
    shape: np.ndarray  # (5,) int64: inner impacts k; periodic 0/1; quarter periods solved 1, 2 or 4; kind of start; kind of end


@inlined
def start_state(start_map, start_offset, y, out):
    """out = Z s + c."""
    for r in range(out.shape[0]):
        total = start_offset[r]
        for j in range(start_map.shape[1]):
            total += start_map[r, j] * y[j]
        out[r] = total


@inlined
def total_time(matrix, start_map, shape, y):
    """Sum of the flight times in the unknowns y, or in a change of them."""
    total = 0.0
    at = start_map.shape[1]
    for _ in range(shape[0] + 1):
        total += y[at]
        at += matrix.shape[1] + 1
    return total


@part
def unpack(pairs, rows, scalars, start_map, shape):
    """The `Segment` whose arrays stand in the rows of one array and the entries of another (see `pack`)."""
    size = rows.shape[1]
    nodes = shape[0] + 2
    blocks = pairs.shape[0]
    at = 3 * nodes + size
    closers = rows.shape[0] - at - 2
    side = 2 * blocks + 2 * nodes
    return Segment(
        Flight(pairs, scalars[:blocks], scalars[blocks : 2 * blocks], rows[3 * nodes : at]),
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


@part
def sized_rows(segment):
    """The same segment, known to be of states of four entries."""
    return Segment(
        Flight(sized(segment.flight.pairs, 2), segment.flight.mean, segment.flight.delta, sized(segment.flight.matrix, 4)),
        sized(segment.gap, 4),
        sized(segment.gap_rate, 4),
        sized(segment.push, 4),
        segment.jump,
        segment.bound,
        segment.side,
        segment.start_map,
        sized(segment.start_offset, 4),
        sized(segment.end_map, 4),
        segment.end_offset,
        sized(segment.weights, 4),
        segment.shape,
    )


def pack(segment):
    """(pairs, rows, scalars, start_map, shape): few arrays, for calls that should cost little."""
    flight = segment.flight
    single = segment.start_offset[None], segment.weights[None]
    rows = np.vstack([segment.gap, segment.gap_rate, segment.push, flight.matrix, *single, segment.end_map])
    scalars = np.concatenate([flight.mean, flight.delta, segment.jump, segment.bound, segment.side, segment.end_offset])
    return flight.pairs, np.ascontiguousarray(rows), scalars, segment.start_map, segment.shape


RESULT = tuple(
    """
    converged iterations contraction residual energy quarter_period slope turn branching clearance clearance_flight clearance_stop
    clearance_side clearance_time speed speed_node flight flight_index absorber_start absorber_end waves_absorber waves_primary
    first_quarter second_quarter in_phase gave_up a b c d magnified trace determinant larger_real larger_imaginary smaller_real
    smaller_imaginary trivial singular speeds steepness conditioning
    """.split()
)
(
    CONVERGED, ITERATIONS, CONTRACTION, RESIDUAL, ENERGY, QUARTER_PERIOD, SLOPE, TURN, BRANCHING, CLEARANCE, CLEARANCE_FLIGHT,
    CLEARANCE_STOP, CLEARANCE_SIDE, CLEARANCE_TIME, SPEED, SPEED_NODE, FLIGHT, FLIGHT_INDEX, ABSORBER_START, ABSORBER_END,
    WAVES_ABSORBER, WAVES_PRIMARY, FIRST_QUARTER, SECOND_QUARTER, IN_PHASE, GAVE_UP, HALF_A, HALF_B, HALF_C, HALF_D, MAGNIFIED, TRACE,
    DETERMINANT, LARGER_REAL, LARGER_IMAGINARY, SMALLER_REAL, SMALLER_IMAGINARY, TRIVIAL, SINGULAR,
    SPEEDS, STEEPNESS, CONDITIONING,
) = range(42)  # fmt: skip


@part
def count_impacts(shape):
    """Impacts in the whole period."""
    k = shape[0]
    if shape[1] == 1:
        return k + 1
    turn = 2 * k + (1 if shape[4] == STOP else 0) + (1 if shape[3] == STOP else 0)
    return turn * 2 if shape[2] == 1 else turn


@kernel
def _put(before, after, row, count, ahead, first, source_before, source_after, node, sign, flip_q, flip_p, duration):
    """Add one impact; `ahead` is the free time since the last one."""
    half = before.shape[1] // 2
    for r in range(half):
        before[count, r] = sign * flip_q * source_before[r]
        before[count, half + r] = sign * flip_p * source_before[half + r]
        after[count, r] = sign * flip_q * source_after[r]
        after[count, half + r] = sign * flip_p * source_after[half + r]
    row[count] = node
    if count == 0:
        first = ahead
    else:
        duration[count - 1] = ahead
    return count + 1, first


@inlined
def unfold(segment, y, ends, before, after, duration, row, work):
    """Impacts of the whole period in order of time: states before and after each (P, N), the free time after it (P,), and the
    row of the node arrays that describes its contact (P,). `ends` (k + 1, N) holds the state at the end of each flight. Returns
    (impacts, time from the start to the first one)."""
    size = segment.flight.matrix.shape[0]
    half = size // 2
    k = segment.shape[0]
    s = segment.start_map.shape[1]
    start = work[0, :size]
    mirror = work[1, :size]
    start_state(segment.start_map, segment.start_offset, y, start)
    count = int64(0)
    first = 0.0
    if segment.shape[1] == 1:
        for i in range(k + 1):
            at = s if i == 0 else s + 1 + (i - 1) * (size + 1) + size
            duration[i] = y[at]
            source = start if i == 0 else y[at - size : at]
            node = k if i == 0 else i - 1
            row[i] = node
            for r in range(size):
                after[i, r] = source[r]
                before[i, r] = ends[k if i == 0 else i - 1, r]
        return k + 1, 0.0
    reflect_q = -1.0 if segment.shape[4] == ORIGIN else 1.0
    sign = 1.0
    ahead = 0.0
    for _ in range(2 if segment.shape[2] == 1 else 1):
        for i in range(k + 1):
            at = s + i * (size + 1)
            ahead += y[at]
            if i < k:
                count, first = _put(
                    before, after, row, count, ahead, first, ends[i], y[at + 1 : at + 1 + size], i, sign, 1.0, 1.0, duration
                )
                ahead = 0.0
        if segment.shape[4] == STOP:
            for r in range(half):
                mirror[r] = ends[k, r]
                mirror[half + r] = -ends[k, half + r]
            count, first = _put(before, after, row, count, ahead, first, ends[k], mirror, k, sign, 1.0, 1.0, duration)
            ahead = 0.0
        for i in range(k, -1, -1):
            at = s + i * (size + 1)
            ahead += y[at]
            if i > 0:
                count, first = _put(
                    before, after, row, count, ahead, first, y[at - size : at], ends[i - 1], i - 1, sign,
                    reflect_q, -reflect_q, duration,
                )
                ahead = 0.0
        if segment.shape[2] == 1:
            sign = -sign
        if segment.shape[3] == STOP:
            for r in range(half):
                mirror[r] = start[r]
                mirror[half + r] = -start[half + r]
            count, first = _put(before, after, row, count, ahead, first, mirror, start, k + 1, sign, 1.0, 1.0, duration)
            ahead = 0.0
    if count > 0:
        duration[count - 1] = ahead + first
    return count, first
