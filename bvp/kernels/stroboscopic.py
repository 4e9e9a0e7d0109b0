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
from bvp.kernels.flight import copy_1, inner, set_1, set_2
from bvp.kernels.forced import is_loaded_cut, motion_size
from bvp.kernels.forced_sticking import orbit_flight
from bvp.kernels.loads import loaded_rate
from bvp.kernels.newton import reflector
from bvp.kernels.periodic_qr import product_eigenvalues
from bvp.kernels.summed_chatter import chatter_frame, is_summed, take_impact

_SMALL = 1e-100
"""Products below it are scaled."""


class Stroboscopic(NamedTuple):
    """The map of an orbit: n degrees of freedom, k + 1 flights. All but the multipliers is scratch."""

    values: np.ndarray  # (2, 2 n) real and imaginary parts of the multipliers
    matrix: np.ndarray  # (2 n, 2 n)
    scale: np.ndarray  # (2 n,)
    right: np.ndarray  # (2 n, 2 n)
    lines: np.ndarray  # (4, N)
    late: np.ndarray  # (N,)
    chain: np.ndarray  # (2 k + 2, 2 n, 2 n)
    inverse: np.ndarray  # (2 k + 2,) int64 of `product_eigenvalues`
    corner: np.ndarray  # (3, 3)
    factors: np.ndarray  # (n (2 n - 1),) complex, 2 n at least
    means: np.ndarray  # (5,) complex


def make_stroboscopic(segment):
    """Arrays for a forced problem."""
    size, width, flights = segment.flight.enter.shape[0], segment.gap.shape[1], int(segment.shape[0]) + 1
    return Stroboscopic(
        np.empty((2, size)), np.empty((size, size)), np.empty(size), np.empty((size, size)), np.empty((4, width)), np.empty(width),
        np.empty((2 * flights, size, size)), np.zeros(2 * flights, dtype=np.int64), np.empty((3, 3)),
        np.empty(max(size, size * (size - 1) // 2), dtype=complex), np.empty(5, dtype=complex),
    )  # fmt: skip


@inlined
def rates_at(segment, i, before, after, coming, going):
    """after (N,): the node after impact i. coming, going (N,): f- and f+, the rates of the nodes before and after it."""
    loaded_rate(orbit_flight(segment, i), before, coming)
    take_impact(segment.sticking, segment, i, before, after)
    # The last impact of half a period is the mirror image of the first one: the same stop is closed.
    loaded_rate(orbit_flight(segment, i + 1 if i < segment.shape[0] else 0), after, going)


@inlined
def is_in_pieces(segment):
    """Whether an orbit without impacts is solved in pieces (`bvp.kernels.cuts`)."""
    return segment.shape[0] > 0 and is_loaded_cut(segment, 0)


@inlined
def map_factors(segment, flights, ends, found):
    """Fill found.chain with the factors of the map, in states divided by found.scale, and found.inverse. Returns how many there are.

    Each flight is one, and each saltation matrix is right left^-1 (`saltation_frames`)."""
    chain, inverse, scale, right = found.chain, found.inverse, found.scale, found.right
    size = scale.shape[0]
    count = ends.shape[0]
    plain = is_in_pieces(segment)
    for i in range(count):
        after = i + 1 if i + 1 < count else 0
        flown = chain[i] if plain else chain[2 * i + 1]
        set_2(right, 0.0)
        for r in range(size):
            right[r, r] = 1.0
        inverse[i if plain else 2 * i + 1] = 0
        if not plain:
            left = chain[2 * i]
            inverse[2 * i] = 1
            for r in range(size):
                copy_1(right[r], left[r])
            if segment.contact[i, 0] >= 0:
                saltation_frames(segment, i, ends[i], scale, left, right, found)
        for r in range(size):
            for c in range(size):
                total = 0.0
                for e in range(size):
                    total += flights[after, r, e] * scale[e] * right[e, c]
                flown[r, c] = total / scale[r] * (segment.closing[0] if i == count - 1 else 1.0)
    return count if plain else 2 * count


@kernel
def map_eigenvalues(segment, flights, ends, found):
    """found.values: the multipliers of an orbit, in no order; its scales are in found.scale. Returns whether they are found. What is too
    large for a number is infinite. found.matrix: the map in some frame, for its size."""
    values = found.values
    count = map_factors(segment, flights, ends, found)
    if product_eigenvalues(found.chain[:count], found.inverse[:count], found.corner, found.matrix, values) < 1:
        return False
    for r in range(values.shape[1]):
        if math.isnan(values[0, r]) or math.isnan(values[1, r]):
            return False
    return True


@kernel
def bounded_product(factors, means):
    """A number with the sign and the zeros of the product of real numbers and conjugate pairs, (m,) complex, between -1 and 1.

    Let e_j be the mean of all products of m - j factors. The number is e_0/sqrt(e_0^2 + .. + e_4^2): beside one small factor about m times
    this factor, however large the others are, and a smooth function of all. 1.0 without factors; nan if a factor is. means (5,) complex:
    scratch for e_0 to e_4."""
    for j in range(5):
        means[j] = 0.0
    means[0] = 1.0
    count = factors.shape[0]
    for i in range(count):
        factor = factors[i]
        length = math.hypot(1.0, math.hypot(factor.real, factor.imag))
        if math.isnan(length):
            return math.nan
        # The division of complex numbers would square it.
        inverse = 1.0 / length
        part = factor * inverse if length < math.inf else complex(math.copysign(1.0, factor.real), 0.0)
        largest = 0.0
        for j in range(4, 0, -1):
            means[j] = means[j] * part + means[j - 1] * inverse
            largest = max(largest, abs(means[j].real) + abs(means[j].imag))
        means[0] *= part
        largest = max(largest, abs(means[0].real) + abs(means[0].imag))
        if 0.0 < largest < _SMALL:
            for j in range(5):
                means[j] *= 1.0 / largest
    total = 0.0
    ways = 1.0
    for j in range(min(count, 4) + 1):
        total += (means[j].real / ways) ** 2
        ways *= (count - j) / (j + 1.0)
    return means[0].real / math.sqrt(total) if total > 0.0 else 0.0


@kernel
def stroboscopic_tests(segment, y, flights, ends, found, out):
    """out[0] has the zeros of det(M + 1), out[1] those of the product of 1 - mu_i mu_j over the pairs i < j of multipliers, each as
    `bounded_product`. At a grazing a multiplier goes through infinity: the sign of the impact speeds keeps both continuous. Without a clock
    one multiplier is 1 for all orbits, and has no part in the pairs. The multipliers go to found.values."""
    values, factors, scale = found.values, found.factors, found.scale
    size = scale.shape[0]
    n = size // 2
    sign = 1.0
    displacement, velocity, _ = motion_size(segment, y, ends)
    for r in range(n):
        scale[r] = displacement
        scale[n + r] = velocity
    for i in range(ends.shape[0]):
        if segment.contact[i, 0] >= 0 and segment.side[i] * inner(segment.gap[i, :n], ends[i, n:size]) < 0.0:
            sign = -sign
    out[:] = math.nan
    if not map_eigenvalues(segment, flights, ends, found):
        values[:] = math.nan
        return
    trivial = -1
    nearest = math.inf
    for i in range(size):
        factors[i] = complex(1.0 + values[0, i], values[1, i])
        distance = math.hypot(values[0, i] - 1.0, values[1, i])
        if segment.closing[1] == 0.0 and distance < nearest:
            trivial, nearest = i, distance
    out[0] = sign * bounded_product(factors[:size], found.means)
    count = 0
    for i in range(size):
        for j in range(i):
            if i == trivial or j == trivial:
                continue
            if values[1, i] == 0.0 and values[1, j] == 0.0:
                factors[count] = complex(1.0 - values[0, i] * values[0, j], 0.0)
            else:
                factors[count] = 1.0 - complex(values[0, i], values[1, i]) * complex(values[0, j], values[1, j])
            count += 1
    out[1] = sign * bounded_product(factors[:count], found.means)


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
