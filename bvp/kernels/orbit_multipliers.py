"""Multipliers of an orbit under loads whose impacts take no direction away: eigenvalues of the product of its flights and saltations."""

import math
from typing import NamedTuple

import numpy as np

from bvp.kernels.compiled import kernel
from bvp.kernels.flight import inner, set_2
from bvp.kernels.forced import LoadedSegment
from bvp.kernels.newton import set_scale
from bvp.kernels.periodic_qr import product_eigenvalues
from bvp.kernels.stroboscopic import Stroboscopic, saltation_frames


class OrbitMap(NamedTuple):
    """An orbit with k + 1 flights, and scratch."""

    segment: LoadedSegment
    impacts: np.ndarray  # (..,) int64 flights that end with an impact
    inverse: np.ndarray  # (2 k + 2,) int64 of `product_eigenvalues`
    chain: np.ndarray  # (2 k + 2, 2 n, 2 n)
    right: np.ndarray  # (2 n, 2 n)
    corner: np.ndarray  # (3, 3)
    product: np.ndarray  # (2 n, 2 n)
    scale: np.ndarray  # (2 n,)
    work: Stroboscopic


def make_orbit_map(segment, impacts, work):
    """Arrays for a forced problem."""
    size, flights = segment.flight.enter.shape[0], int(segment.shape[0]) + 1
    square = np.empty((size, size))
    return OrbitMap(
        segment, impacts, np.tile(np.array([1, 0], np.int64), flights), np.empty((2 * flights, size, size)), square, np.empty((3, 3)),
        np.empty_like(square), np.empty(size), work,
    )  # fmt: skip


@kernel
def orbit_multipliers(found, y, factor, slowest, values):
    """values (2, 2 n): real and imaginary parts of the multipliers, in no order, of the orbit y that was evaluated last.

    The saltation matrices are right left^-1 (`bvp.kernels.stroboscopic.saltation_frames`). slowest: the impact speed, over the size of the
    velocities, below which an impact grazes. Returns whether they are found: no impact grazes, and the iteration converges. What
    is too large for a number is infinite."""
    segment, chain, scale, right = found.segment, found.chain, found.scale, found.right
    size = scale.shape[0]
    n = size // 2
    flights = segment.shape[0] + 1
    displacement, velocity, _ = set_scale(segment, y, factor)
    for r in range(n):
        scale[r] = displacement
        scale[n + r] = velocity
    for j in range(found.impacts.shape[0]):
        i = found.impacts[j]
        if segment.side[i] * inner(segment.gap[i, :n], factor.before[i, n:size]) < slowest * velocity:
            return False
    for i in range(flights):
        left, flown = chain[2 * i], chain[2 * i + 1]
        after = (i + 1) % flights
        set_2(left, 0.0)
        set_2(right, 0.0)
        for r in range(size):
            left[r, r] = 1.0
            right[r, r] = 1.0
        for j in range(found.impacts.shape[0]):
            if found.impacts[j] == i:
                saltation_frames(segment, i, factor.before[i], scale, left, right, found.work)
        for r in range(size):
            for c in range(size):
                total = 0.0
                for e in range(size):
                    total += factor.flights[after, r, e] * scale[e] * right[e, c]
                flown[r, c] = total / scale[r] * (segment.closing[0] if i == flights - 1 else 1.0)
    if product_eigenvalues(chain, found.inverse, found.corner, found.product, values) < 1:
        return False
    for r in range(size):
        if math.isnan(values[0, r]) or math.isnan(values[1, r]):
            return False
    return True
