"""Half map and multipliers of an orbit with two degrees of freedom."""

import math
from typing import NamedTuple

import numpy as np

from bvp.kernels import segment as entry
from bvp.kernels.arrays import set_1, set_2
from bvp.kernels.compiled import kernel, part, sized
from bvp.kernels.halfmap import half_map
from bvp.kernels.pencil import landings, pencil, trivial_directions
from bvp.kernels.segment import count_impacts, sized_rows, unfold, unpack
from bvp.kernels.sweep import sweep


class Period(NamedTuple):
    """Scratch for the P impacts of a whole period, n = 2, N = 4."""

    before: np.ndarray  # (P, N)
    after: np.ndarray  # (P, N)
    duration: np.ndarray  # (P,)
    contact: np.ndarray  # (P,) int64
    maps: np.ndarray  # (P, N, N)
    left: np.ndarray  # (P, N, N)
    right: np.ndarray  # (P, N, N)
    along: np.ndarray  # (P, N)
    rows: np.ndarray  # (N + 3, N)
    square: np.ndarray  # (5, N, N)
    plane: np.ndarray  # (4, 2, 2)


def make_period(impacts):
    """Scratch for so many impacts."""
    square = (impacts, 4, 4)
    return Period(
        np.zeros((impacts, 4)),
        np.zeros((impacts, 4)),
        np.zeros(impacts),
        np.zeros(impacts, np.int64),
        np.zeros(square),
        np.zeros(square),
        np.zeros(square),
        np.zeros((impacts, 4)),
        np.zeros((7, 4)),
        np.zeros((5, 4, 4)),
        np.zeros((4, 2, 2)),
    )


@part
def sized_period(period):
    """The same scratch, known to be for states of four entries."""
    return Period(
        sized(period.before, 4), sized(period.after, 4), period.duration, period.contact, sized(period.maps, 4), sized(period.left, 4),
        sized(period.right, 4), sized(period.along, 4), sized(period.rows, 4), sized(period.square, 4), sized(period.plane, 2),
    )  # fmt: skip


@part
def stability_2(segment, y, ends, scratch, result):
    """Half map, and multipliers of the reduced saddle-point matrix, for two degrees of freedom."""
    narrow = sized_rows(segment)
    size = scratch.before.shape[1]
    impacts = count_impacts(segment.shape)
    # the second half period of an orbit solved as a quarter has the very factors of the first one: all changes its sign
    turns = 2 if segment.shape[2] == 1 else 1
    nodes = impacts // turns
    if segment.shape[2] != 4:
        phi = scratch.plane[0]
        result[entry.MAGNIFIED] = half_map(narrow, y, ends, scratch.rows, scratch.square, scratch.plane[1:], phi)
        result[entry.HALF_A] = phi[0, 0]
        result[entry.HALF_B] = phi[0, 1]
        result[entry.HALF_C] = phi[1, 0]
        result[entry.HALF_D] = phi[1, 1]
    else:
        set_1(result[entry.HALF_A : entry.HALF_D + 1], math.nan)
        result[entry.MAGNIFIED] = 1.0
    unfold(segment, y, ends, scratch.before, scratch.after, scratch.duration, scratch.contact, scratch.rows)
    if nodes == 0:
        set_1(result[entry.TRACE : entry.SINGULAR + 1], math.nan)
        return
    cycle_before = scratch.before[:nodes]
    cycle_after = scratch.after[:nodes]
    cycle_row = scratch.contact[:nodes]
    cycle_time = scratch.duration[:nodes]
    maps = scratch.maps[:nodes]
    left = scratch.left[:nodes]
    right = scratch.right[:nodes]
    along = scratch.along[:nodes]
    scale = scratch.rows[0]
    # velocities by sqrt(2 h), not by those at the impacts: an impact may be the only slow part of an orbit
    displacement = 0.0
    energy = 0.0
    for r in range(size):
        energy += narrow.weights[r] * cycle_after[0, r] ** 2
    for i in range(nodes):
        for r in range(size // 2):
            displacement = max(displacement, abs(cycle_after[i, r]))
    for r in range(size // 2):
        scale[r] = displacement if displacement > 0.0 else 1.0
        scale[size // 2 + r] = math.sqrt(energy)
    landings(narrow.flight, narrow.gap_rate, narrow.push, narrow.jump, cycle_before, cycle_time, cycle_row, scale, maps, along)
    factor = scratch.plane[0, 0]
    pencil(narrow.weights, narrow.gap, True, cycle_after, cycle_row, scale, maps, along, left, right, scratch.square, factor)
    dimension = 2
    frame = scratch.plane[0]
    older = scratch.plane[1]
    product = scratch.plane[2]
    exponent = scratch.plane[3, 0]
    set_2(frame, 0.0)
    for r in range(dimension):
        frame[r, r] = 1.0
    singular = 0
    for _ in range(4):
        for r in range(dimension):
            for c in range(dimension):
                older[r, c] = frame[r, c]
        singular = sweep(left, right, cycle_row, cycle_row, True, turns, scratch.square, frame, product, exponent)
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
    result[entry.TRACE] = trace
    result[entry.DETERMINANT] = determinant
    difference = 0.5 * (c11 - c22)
    square = difference * difference + c12 * c21
    if square >= 0.0:
        larger = 0.5 * trace + math.copysign(math.sqrt(square), trace)
        result[entry.LARGER_REAL] = larger
        result[entry.LARGER_IMAGINARY] = 0.0
        result[entry.SMALLER_REAL] = determinant / larger if larger != 0.0 else 0.0
        result[entry.SMALLER_IMAGINARY] = 0.0
    else:
        result[entry.LARGER_REAL] = 0.5 * trace
        result[entry.LARGER_IMAGINARY] = -math.sqrt(-square)
        result[entry.SMALLER_REAL] = 0.5 * trace
        result[entry.SMALLER_IMAGINARY] = math.sqrt(-square)
    flow, level = trivial_directions(
        narrow.flight, narrow.weights, narrow.gap, cycle_after, cycle_row, turns, scale, maps, along, scratch.rows[1:]
    )
    result[entry.TRIVIAL] = max(flow, level)
    result[entry.SINGULAR] = singular


@kernel
def orbit_stability(pairs, rows, scalars, start_map, shape, y, ends, period, result):
    """Half map and multipliers of the orbit at y, n = 2: the entries of RESULT from `a` on."""
    segment = unpack(pairs, rows, scalars, start_map, shape)
    stability_2(segment, y, sized(ends, 4), sized_period(period), result)
