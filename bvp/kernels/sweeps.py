"""Eigenvalues of a graded product of triangular factors in a frame that it carries into itself (`bvp.kernels.deflation`).

The orbit carries a frame Q into Q+: M Q = Q+ R with the product R of triangular factors, graded. In the frame Q the map is W R, with
W = Q' Q+ orthogonal and, as the frame settles, block diagonal: its eigenvalues are those of the diagonal blocks of W R. A block whose
eigenvalues are of like size is small enough to be formed.
"""

import math
from typing import NamedTuple

import numpy as np

from bvp.kernels.compiled import inlined, kernel, square
from bvp.kernels.dense import eigenvalues
from bvp.kernels.monodromy import FORMED_LIMIT, GRADE

APART = 1e-15
"""Two diagonal blocks are separate if their coupling is below this."""


class SweepWork(NamedTuple):
    """What the sweeps of m eigenvalues need. The map is turn times product, whose row j is scaled by 2^-exponent[j]."""

    frame: np.ndarray  # (m, m)
    older: np.ndarray  # (m, m)
    turn: np.ndarray  # (m, m)
    product: np.ndarray  # (m, m)
    exponent: np.ndarray  # (m,)
    block: np.ndarray  # (m^2,) scratch for a matrix
    scratch: np.ndarray  # (4, N, N)


def make_sweep_work(count, size):
    """Work space for `count` eigenvalues of maps of N = size entries."""
    frame, older, turn, product = np.zeros((4, count, count))
    return SweepWork(frame, older, turn, product, np.zeros(count), np.zeros(count * count), np.zeros((4, size, size)))


@inlined
def _is_apart(turn, cut, size):
    """Whether the blocks before and behind a cut are not coupled."""
    for r in range(cut, size):
        for c in range(cut):
            if not abs(turn[r, c]) < APART:
                return False
    return True


@inlined
def _two_eigenvalues(turn, product, exponent, first, largest, block, values):
    """Those of a 2 x 2 block. The smaller real one is determinant / larger, which avoids cancellation."""
    last = first + 1
    unit = 2.0**largest
    middle = 0.5 * (block[0, 0] + block[1, 1])
    difference = 0.5 * (block[0, 0] - block[1, 1])
    square = difference * difference + block[0, 1] * block[1, 0]
    if square < 0.0:
        for i in range(2):
            values[0, first + i] = middle * unit
            values[1, first + i] = math.copysign(math.sqrt(-square), i - 0.5) * unit
        return
    larger = middle + math.copysign(math.sqrt(square), middle)
    determinant = turn[first, first] * turn[last, last] - turn[first, last] * turn[last, first]
    determinant *= product[first, first] * product[last, last] * 2.0 ** (exponent[first] + exponent[last] - largest)
    values[0, first] = larger * unit
    values[0, last] = determinant / larger if larger != 0.0 else 0.0
    values[1, first] = 0.0
    values[1, last] = 0.0


@kernel
def _block_eigenvalues(work, first, last, values):
    """Eigenvalues of the diagonal block first .. last - 1 into these columns of `values`. Returns whether they need no further sweep."""
    turn, product, exponent = work.turn, work.product, work.exponent
    size = last - first
    # Rows of like size: no eigenvalue drowns in the rounding of another.
    largest = -math.inf
    row_most = -math.inf
    diagonal_least = math.inf
    for r in range(first, last):
        largest = max(largest, exponent[r])
        most = 0.0
        for c in range(first, last):
            most = max(most, abs(product[r, c]))
        row_most = max(row_most, math.log2(most) + exponent[r])
        diagonal_least = min(diagonal_least, math.log2(abs(product[r, r])) + exponent[r])
    is_level = size == 1 or row_most - diagonal_least < math.log2(GRADE)
    block = square(work.block, size)
    norm = 0.0
    for r in range(size):
        for c in range(size):
            total = 0.0
            for k in range(first, last):
                total += turn[first + r, k] * product[k, first + c] * 2.0 ** (exponent[k] - largest)
            block[r, c] = total
            norm = max(norm, abs(total))
    if size == 1:
        values[0, first] = block[0, 0] * 2.0**largest
        values[1, first] = 0.0
        return True
    if size == 2:
        _two_eigenvalues(turn, product, exponent, first, largest, block, values)
    elif eigenvalues(block, values[0, first:last], values[1, first:last]):
        for j in range(first, last):
            values[0, j] *= 2.0**largest
            values[1, j] *= 2.0**largest
    else:
        for j in range(first, last):
            values[0, j] = math.nan
            values[1, j] = math.nan
        return is_level
    most = 0.0
    least = math.inf
    for j in range(first, last):
        modulus = math.hypot(values[0, j], values[1, j])
        most = max(most, modulus)
        least = min(least, modulus)
    return is_level or (most <= GRADE * least and norm * 2.0**largest < FORMED_LIMIT * least)


@inlined
def block_multipliers(work, size, values):
    """Eigenvalues of the diagonal blocks of the first `size` rows and columns, which are not coupled, into `values`. Returns whether they
    need no further sweep."""
    settled = True
    first = 0
    for cut in range(1, size + 1):
        if cut < size and not _is_apart(work.turn, cut, size):
            continue
        settled = _block_eigenvalues(work, first, cut, values) and settled
        first = cut
    return settled
