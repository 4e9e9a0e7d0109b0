"""Half map and multipliers of an orbit with two degrees of freedom."""

import math

import numpy as np

from bvp.kernels.arrays import set_1
from bvp.kernels.compiled import allocating, part
from bvp.kernels.cycle import count_impacts, unfold
from bvp.kernels.halfmap import half_map
from bvp.kernels.pencil import landings, pencil
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
from bvp.kernels.sweep import sweep
from bvp.kernels.trivial import trivial_directions

__all__ = ["orbit_stability"]


@part
def stability_2(segment, y, ends, work, result):
    """Half map, and multipliers of the reduced saddle-point matrix, for two degrees of freedom."""
    size = segment.matrix.shape[0]
    impacts = count_impacts(segment.shape)
    # the second half period of an orbit solved as a quarter has the very factors of the first one: all changes its sign
    turns = 2 if segment.shape[2] == 1 else 1
    nodes = impacts // turns
    states = np.empty((2, impacts, size))
    cycle_time = np.empty(impacts)
    cycle_row = np.empty(impacts, np.int64)
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
    unfold(segment, y, ends, states[0], states[1], cycle_time, cycle_row, work)
    if nodes == 0:
        set_1(result[TRACE : SINGULAR + 1], math.nan)
        return
    cycle_before = states[0, :nodes]
    cycle_after = states[1, :nodes]
    cycle_row = cycle_row[:nodes]
    cycle_time = cycle_time[:nodes]
    factors = np.empty((3, nodes, size, size))
    maps = factors[0]
    left = factors[1]
    right = factors[2]
    vectors = np.empty((nodes + 1, size))
    along = vectors[:nodes]
    scale = vectors[nodes]
    scratch = np.empty((4, size, size))
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
        singular = sweep(left, right, height, height, turns, scratch, frame, product, exponent)
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
        segment.pairs, segment.matrix, segment.weights, segment.gap, cycle_after, cycle_row, turns, scale, maps, along
    )
    result[TRIVIAL] = max(flow, level)
    result[SINGULAR] = singular


@allocating
def orbit_stability(pairs, rows, scalars, start_map, shape, y, ends, work, result):
    """Half map and multipliers of the orbit at y, n = 2: the entries of RESULT from `a` on."""
    segment = unpack(pairs, rows, scalars, start_map, shape)
    stability_2(segment, y, ends, work, result)
