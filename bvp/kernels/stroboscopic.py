"""The stroboscopic map of a forced orbit, linearised: the product of its flights and saltation matrices.

A perturbation of the state at a fixed time, not at an impact, is carried on. An impact with the normal c adds the term of rank one

    S = R + (f+ - R f-) c / (c . v-),      R = 1 - (1 + r) push rate

(Mueller, Chaos, Solitons & Fractals 5 (1995) 1671), with the accelerations in f+ and f- that contain the loads. All 2 n multipliers appear.
Of half a period the map is that of x -> -x over it, whose square is that of the period.
"""

import math
from typing import NamedTuple

import numpy as np

from bvp.kernels.compiled import inlined, kernel
from bvp.kernels.contact_mode import apply_impact
from bvp.kernels.dense import determinant, eigenvalues
from bvp.kernels.flight import copy_1, inner, set_1, set_2
from bvp.kernels.forced import is_loaded_cut
from bvp.kernels.forced_sticking import orbit_flight
from bvp.kernels.loads import loaded_rate
from bvp.kernels.newton import reflector
from bvp.kernels.periodic_qr import product_eigenvalues
from bvp.kernels.summed_chatter import chatter_frame, is_summed, take_impact


class Stroboscopic(NamedTuple):
    """The map of an orbit: n degrees of freedom."""

    matrix: np.ndarray  # (2 n, 2 n)
    work: np.ndarray  # (2 n, 2 n) scratch
    values: np.ndarray  # (2, 2 n) real and imaginary parts of the multipliers
    lines: np.ndarray  # (4, N) scratch
    late: np.ndarray  # (N,) scratch
    chain: np.ndarray  # (k + 1, 2 n, 2 n) scratch
    inverse: np.ndarray  # (k + 1,) int64 zeros
    corner: np.ndarray  # (3, 3) scratch


def make_stroboscopic(segment):
    """Arrays for a forced problem."""
    size, width, flights = segment.flight.enter.shape[0], segment.gap.shape[1], int(segment.shape[0]) + 1
    return Stroboscopic(
        np.empty((size, size)), np.empty((size, size)), np.empty((2, size)), np.empty((4, width)), np.empty(width),
        np.empty((flights, size, size)), np.zeros(flights, dtype=np.int64), np.empty((3, 3)),
    )  # fmt: skip


@inlined
def rates_at(segment, i, before, after, coming, going):
    """after (N,): the node after impact i. coming, going (N,): f- and f+, the rates of the nodes before and after it."""
    loaded_rate(orbit_flight(segment, i), before, coming)
    take_impact(segment.sticking, segment, i, before, after)
    # The last impact of half a period is the mirror image of the first one: the same stop is closed.
    loaded_rate(orbit_flight(segment, i + 1 if i < segment.shape[0] else 0), after, going)


@kernel
def stroboscopic_map(segment, flights, ends, found):
    """Fill found.matrix for an orbit. flights (k + 1, N, N), ends (k + 1, N): of `bvp.kernels.multipoint.evaluate`."""
    matrix, work, lines = found.matrix, found.work, found.lines
    size = matrix.shape[0]
    after, going, coming, column = lines[0], lines[1], lines[2], lines[3]
    set_2(matrix, 0.0)
    for r in range(size):
        matrix[r, r] = 1.0
    for i in range(ends.shape[0]):
        for r in range(size):
            for c in range(size):
                work[r, c] = inner(flights[i, r, :size], matrix[:, c])
        for r in range(size):
            copy_1(work[r], matrix[r])
        if segment.contact[i, 0] < 0:
            continue
        rates_at(segment, i, ends[i], after, coming, going)
        speed = inner(segment.gap[i, :size], coming[:size])
        if is_summed(segment.sticking, i):
            for c in range(size):
                set_1(column, 0.0)
                for r in range(size):
                    column[r] = matrix[r, c]
                lateness = -inner(segment.gap[i, :size], column[:size]) / speed
                chatter_frame(segment.sticking, i, column, lateness, coming, going, after)
                for r in range(size):
                    matrix[r, c] = after[r]
            continue
        apply_impact(segment.gap_rate, segment.push, i, segment.jump[i], coming, coming)
        for c in range(size):
            for r in range(size):
                column[r] = matrix[r, c]
            lateness = inner(segment.gap[i, :size], column[:size]) / speed
            kick = segment.jump[i] * inner(segment.gap_rate[i, :size], column[:size])
            for r in range(size):
                matrix[r, c] += (going[r] - coming[r]) * lateness - segment.push[i, r] * kick
    for r in range(size):
        for c in range(size):
            matrix[r, c] *= segment.closing[0]


@inlined
def is_in_pieces(segment):
    """Whether an orbit without impacts is solved in pieces (`bvp.kernels.cuts`)."""
    return segment.shape[0] > 0 and is_loaded_cut(segment, 0)


@inlined
def _times(product, factor):
    """A product of real numbers and conjugate pairs, times one of its factors over sqrt(1 + |factor|^2)."""
    length = math.hypot(1.0, math.hypot(factor.real, factor.imag))
    return product * (factor / length if length < math.inf else complex(math.copysign(1.0, factor.real), 0.0))


@kernel
def _tests_of_pieces(segment, flights, ends, found, out):
    """See `stroboscopic_tests`: the map of an orbit in pieces is not formed, and the factors 1 + mu and 1 - mu_i mu_j are bounded."""
    chain, values = found.chain, found.values
    size = values.shape[1]
    n = size // 2
    displacement = 0.0
    velocity = 0.0
    for i in range(ends.shape[0]):
        for r in range(n):
            displacement = max(displacement, abs(ends[i, r]))
            velocity = max(velocity, abs(ends[i, n + r]))
    unit = velocity / displacement if displacement > 0.0 and velocity > 0.0 else 1.0
    for i in range(ends.shape[0]):
        sign = segment.closing[0] if i == ends.shape[0] - 1 else 1.0
        for r in range(size):
            for c in range(size):
                factor = 1.0 if (r < n) == (c < n) else unit if r < n else 1.0 / unit
                chain[i, r, c] = sign * factor * flights[i, r, c]
    out[:] = math.nan
    if product_eigenvalues(chain, found.inverse, found.corner, found.matrix, values) < 1:
        values[:] = math.nan
        return
    doubled = complex(1.0, 0.0)
    paired = complex(1.0, 0.0)
    for i in range(size):
        own = complex(values[0, i], values[1, i])
        doubled = _times(doubled, 1.0 + own)
        for j in range(i):
            paired = _times(paired, 1.0 - own * complex(values[0, j], values[1, j]))
    out[0] = doubled.real
    out[1] = paired.real


@kernel
def stroboscopic_tests(segment, flights, ends, speeds, found, out):
    """out[0] = det(M + 1), out[1] = the product of 1 - mu_i mu_j over the pairs i < j of multipliers, made smooth at grazings: times the
    product of the impact speeds, and times its power 2 n - 1. Without a clock one multiplier is 1 for all orbits, and has no part in the
    pairs. The multipliers go to found.values."""
    if is_in_pieces(segment):
        _tests_of_pieces(segment, flights, ends, found, out)
        return
    stroboscopic_map(segment, flights, ends, found)
    matrix, work, values = found.matrix, found.work, found.values
    size = matrix.shape[0]
    for r in range(size):
        for c in range(size):
            work[r, c] = matrix[r, c] + (1.0 if r == c else 0.0)
    out[0] = determinant(work) * speeds
    for r in range(size):
        copy_1(matrix[r], work[r])
    out[1] = math.nan
    if not eigenvalues(work, values[0], values[1]):
        values[:] = math.nan
        return
    trivial = -1
    nearest = math.inf
    for i in range(size if segment.closing[1] == 0.0 else 0):
        distance = math.hypot(values[0, i] - 1.0, values[1, i])
        if distance < nearest:
            trivial, nearest = i, distance
    product = complex(1.0, 0.0)
    for i in range(size):
        for j in range(i):
            if i == trivial or j == trivial:
                continue
            product *= 1.0 - complex(values[0, i], values[1, i]) * complex(values[0, j], values[1, j])
    out[1] = product.real * speeds ** (size - 1)


@kernel
def chatter_frames(segment, i, scale, left, right, found):
    """See `saltation_frames`, for a chatter whose rates are in the scratch of `found`."""
    after, going, coming, normal = found.lines[0], found.lines[1], found.lines[2], found.lines[3]
    size = scale.shape[0]
    length = 0.0
    for r in range(size):
        normal[r] = segment.gap[i, r] * scale[r]
        length = max(length, abs(coming[r]) / scale[r])
    _, factor = reflector(normal, 0, size)
    change = found.late
    for c in range(size):
        set_1(change, 0.0)
        for r in range(size):
            left[r, c] = coming[r] / scale[r] / length if c == 0 else (1.0 if r == c else 0.0) - factor * normal[r] * normal[c]
            change[r] = left[r, c] * scale[r]
        # A state that is moved along the flow arrives earlier.
        chatter_frame(segment.sticking, i, change, -1.0 / length if c == 0 else 0.0, coming, going, after)
        for r in range(size):
            right[r, c] = after[r] / scale[r]


@kernel
def saltation_frames(segment, i, before, scale, left, right, found):
    """The saltation matrix of impact i as right left^-1, (2 n, 2 n) in states divided by their scale: it takes (f-, the directions in
    c . u = constant) to (f+, their images under R). Nothing is divided by the speed of the impact."""
    lines = found.lines
    size = scale.shape[0]
    after, going, coming, normal = lines[0], lines[1], lines[2], lines[3]
    rates_at(segment, i, before, after, coming, going)
    if is_summed(segment.sticking, i):
        chatter_frames(segment, i, scale, left, right, found)
        return
    length = 0.0
    for r in range(size):
        coming[r] /= scale[r]
        going[r] /= scale[r]
        normal[r] = segment.gap[i, r] * scale[r]
        length = max(length, abs(coming[r]))
    # The reflection of the normal to the first axis: its other columns are orthonormal, and at right angles to the normal.
    _, factor = reflector(normal, 0, size)
    for c in range(size):
        if c == 0:
            for r in range(size):
                left[r, 0] = coming[r] / length
                right[r, 0] = going[r] / length
            continue
        kick = 0.0
        for r in range(size):
            left[r, c] = (1.0 if r == c else 0.0) - factor * normal[r] * normal[c]
            kick += segment.gap_rate[i, r] * scale[r] * left[r, c]
        kick *= segment.jump[i]
        for r in range(size):
            right[r, c] = left[r, c] - kick * segment.push[i, r] / scale[r]
