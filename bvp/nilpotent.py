"""Arrays in infinitesimals e_1, ..., e_d with e_k^2 = 0: they carry exact mixed derivatives along d directions.

An array f has the coefficients f[S] (2^d, ...), where bit k of the index S is set if e_(k+1) is a factor. The coefficient of all of them is
the derivative along all directions. Coefficients may be complex, since it is linear in each direction.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np

from bvp.kernels.expressions import Program, run
from bvp.programs import scratch_size

__all__ = ["composed", "constant", "exponential", "inverse", "partitions", "parts", "product"]

_CONVERGENCE = 0.25
"""Size of a matrix up to which a Taylor polynomial of degree 15 is its exponential to rounding, also in three infinitesimals."""


@cache
def parts(whole: int) -> tuple[int, ...]:
    """All subsets of a set of bits."""
    return tuple(part for part in range(whole + 1) if part & whole == part)


@cache
def partitions(whole: int) -> tuple[tuple[int, ...], ...]:
    """All ways to split a set of bits into sets that are not empty."""
    if not whole:
        return ((),)
    low = whole & -whole
    return tuple((low | part, *rest) for part in parts(whole ^ low) for rest in partitions(whole ^ low ^ part))


def constant(value: Any, count: int) -> np.ndarray:
    """A constant, with `count` coefficients.

    Examples
    --------
    >>> constant(3.0, 2)
    array([3., 0.])
    """
    value = np.asarray(value)
    return np.concatenate([value[None], np.zeros((count - 1, *value.shape))])


def product(f: np.ndarray, g: np.ndarray, of: Callable[[Any, Any], Any] = np.multiply) -> np.ndarray:
    """The product of two arrays, `of` being that of their coefficients.

    Examples
    --------
    >>> product(np.array([2.0, 1.0]), np.array([3.0, 5.0]))
    array([ 6., 13.])
    """
    return np.array([sum(of(f[part], g[whole ^ part]) for part in parts(whole)) for whole in range(len(f))])


def inverse(f: np.ndarray) -> np.ndarray:
    """The inverse of a matrix.

    Examples
    --------
    >>> inverse(np.array([[[2.0]], [[1.0]]])).ravel()
    array([ 0.5 , -0.25])
    """
    found = [np.linalg.inv(f[0])]
    for whole in range(1, len(f)):
        found.append(-found[0] @ sum(f[part] @ found[whole ^ part] for part in parts(whole) if part))
    return np.array(found)


def exponential(f: np.ndarray, t: np.ndarray) -> np.ndarray:
    """exp(f t) for a matrix f and a number t: the first columns of the exponential of the block-triangular matrix which multiplies by f t.
    Where f has no infinitesimals, those of t give a factor, a polynomial.

    References
    ----------
    N. J. Higham, Functions of Matrices, SIAM (2008), sections 3.2, 4.2 and 10.3.

    Examples
    --------
    >>> exponential(np.array([[[0.0]], [[2.0]]]), np.array([1.5, 0.0])).ravel()
    array([1., 3.])
    """
    count, size = len(f), f.shape[-1]
    if not f[1:].any():
        late = np.array([0.0, *t[1:]])
        found = term = constant(_exponential(f[0] * t[0].real), count).astype(np.result_type(f, t))
        for k in range(1, count.bit_length()):
            term = product(f[0] @ term, late[:, None, None]) / k
            found = found + term
        return found
    rates = product(f, t[:, None, None])
    blocks = np.zeros((count, size, count, size), dtype=rates.dtype)
    for whole in range(count):
        for part in parts(whole):
            blocks[whole, :, part] = rates[whole ^ part]
    whole_matrix: np.ndarray = _exponential(blocks.reshape(count * size, -1))
    return whole_matrix[:, :size].reshape(count, size, size)


def _exponential(matrix: np.ndarray) -> np.ndarray:
    """exp(matrix), by squaring and a Taylor polynomial of degree 15 in the scheme of Paterson and Stockmeyer. The threads of LAPACK take
    longer than the sums of small matrices."""
    powers = [np.eye(len(matrix)), matrix, matrix @ matrix]
    powers += [powers[2] @ matrix, powers[2] @ powers[2]]
    size = float(np.abs(powers[4]).sum(axis=0).max()) ** 0.25
    if not math.isfinite(size):
        return np.full(matrix.shape, math.nan, dtype=matrix.dtype)
    squarings = max(0, math.ceil(math.log2(size / _CONVERGENCE))) if size else 0
    powers = [power * 0.5 ** (squarings * k) for k, power in enumerate(powers)]
    found = np.zeros_like(matrix)
    for k in range(12, -4, -4):
        found = found @ powers[4] + sum(powers[j] / math.factorial(k + j) for j in range(4))
    for _ in range(squarings):
        found = found @ found
    return found


def derivative_tables(program: Program, values: np.ndarray, variables: int, order: int) -> list[np.ndarray]:
    """The outputs of a program of D expressions and their derivatives by order: (D,), (D, m), (D, m, m), ..."""
    out = np.zeros(len(program.outputs))
    run(program, values, np.zeros(scratch_size(program, len(values))), out)
    sizes = [variables**k for k in range(order + 1)]
    count = len(out) // sum(sizes)
    parts = np.split(out, np.cumsum(sizes)[:-1] * count)
    return [part.reshape((count, *(variables,) * k)) for k, part in enumerate(parts)]


def composed(derivatives: Sequence[np.ndarray], x: np.ndarray) -> np.ndarray:
    """A function of x (2^d, P) from its value (D,) and its derivatives (D, P), (D, P, P), ... up to order d at x[0].

    Examples
    --------
    The square at 3, along 1 and 2:

    >>> square = np.array([9.0]), np.array([[6.0]]), np.array([[[2.0]]])
    >>> composed(square, np.array([[3.0], [1.0], [2.0], [0.0]])).ravel()
    array([ 9.,  6., 12.,  4.])
    """
    return np.array([sum(_along(derivatives, x, blocks) for blocks in partitions(whole)) for whole in range(len(x))])


def _along(derivatives: Sequence[np.ndarray], x: np.ndarray, blocks: tuple[int, ...]) -> np.ndarray:
    """A derivative along coefficients of x."""
    found = derivatives[len(blocks)]
    for block in blocks:
        found = found @ x[block]
    return found
