"""Half map and multipliers of an orbit with two degrees of freedom."""

import math
from typing import NamedTuple

import numpy as np

from bvp.kernels.arrays import set_1, set_2
from bvp.kernels.compiled import kernel, part
from bvp.kernels.cycle import count_impacts, unfold
from bvp.kernels.halfmap import planar_half_map
from bvp.kernels.pencil import planar_landings, planar_pencil
from bvp.kernels.result import (
    DETERMINANT,
    HALF_A,
    HALF_B,
    HALF_C,
    HALF_D,
    LARGER_IMAGINARY,
    LARGER_REAL,
    MAGNIFIED,
    SINGULAR,
    SMALLER_IMAGINARY,
    SMALLER_REAL,
    TRACE,
    TRIVIAL,
)
from bvp.kernels.segment import unpack
from bvp.kernels.sweep import planar_sweep
from bvp.kernels.trivial import planar_trivial_directions

__all__ = ["Period", "make_period", "orbit_stability"]


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
def stability_2(segment, y, ends, scratch, result):
    """Half map, and multipliers of the reduced saddle-point matrix, for two degrees of freedom."""
    size = scratch.before.shape[1]
    impacts = count_impacts(segment.shape)
    # the second half period of an orbit solved as a quarter has the very factors of the first one: all changes its sign
    turns = 2 if segment.shape[2] == 1 else 1
    nodes = impacts // turns
    if segment.shape[2] != 4:
        phi = scratch.plane[0]
        result[MAGNIFIED] = planar_half_map(segment, y, ends, scratch.rows, scratch.square, scratch.plane[1:], phi)
        result[HALF_A] = phi[0, 0]
        result[HALF_B] = phi[0, 1]
        result[HALF_C] = phi[1, 0]
        result[HALF_D] = phi[1, 1]
    else:
        set_1(result[HALF_A : HALF_D + 1], math.nan)
        result[MAGNIFIED] = 1.0
    unfold(segment, y, ends, scratch.before, scratch.after, scratch.duration, scratch.contact, scratch.rows)
    if nodes == 0:
        set_1(result[TRACE : SINGULAR + 1], math.nan)
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
        energy += segment.weights[r] * cycle_after[0, r] ** 2
    for i in range(nodes):
        for r in range(size // 2):
            displacement = max(displacement, abs(cycle_after[i, r]))
    for r in range(size // 2):
        scale[r] = displacement if displacement > 0.0 else 1.0
        scale[size // 2 + r] = math.sqrt(energy)
    planar_landings(
        segment.pairs, segment.mean, segment.delta, segment.matrix, segment.gap_rate, segment.push, segment.jump, cycle_before,
        cycle_time, cycle_row, scale, maps, along,
    )  # fmt: skip
    planar_pencil(
        segment.weights, segment.gap, cycle_after, cycle_row, scale, maps, along, left, right, scratch.square, scratch.plane[0, 0]
    )
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
        singular = planar_sweep(left, right, cycle_row, turns, scratch.square, frame, product, exponent)
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
    flow, level = planar_trivial_directions(
        segment.pairs, segment.matrix, segment.weights, segment.gap, cycle_after, cycle_row, turns, scale, maps, along, scratch.rows[1:]
    )
    result[TRIVIAL] = max(flow, level)
    result[SINGULAR] = singular


@kernel
def orbit_stability(pairs, rows, scalars, start_map, shape, y, ends, period, result):
    """Half map and multipliers of the orbit at y, n = 2: the entries of RESULT from `a` on."""
    segment = unpack(pairs, rows, scalars, start_map, shape)
    stability_2(segment, y, ends, period, result)
