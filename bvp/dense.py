"""Small dense matrices by the compiled core: the same bits on every machine, where numpy's depend on the processor."""

from __future__ import annotations

from typing import Any

import numpy as np
import saltus_core as core

__all__ = ["cholesky", "eigenvalues", "inner", "jacobi", "length", "orthonormal", "product", "quadratic", "roots", "singular", "solve"]


def _numbers(values: Any) -> np.ndarray:
    return np.ascontiguousarray(values, dtype=float)


def product(*factors: np.ndarray) -> np.ndarray:
    """The product of matrices from left to right; the first factor can be a row, the last one a column.

    Examples
    --------
    >>> product(np.array([1.0, 2.0]), np.eye(2), np.array([3.0, 4.0]))
    array(11.)
    """
    found = _numbers(factors[0]) if factors[0].ndim == 2 else _numbers(factors[0])[None, :]
    for factor in factors[1:]:
        found = core.product(found, _numbers(factor) if factor.ndim == 2 else _numbers(factor)[:, None])
    if factors[-1].ndim == 1:
        found = found[:, 0]
    return found if factors[0].ndim == 2 else found[0, ...]


def quadratic(matrix: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """x . matrix x for each column x of an (n, k), (k,)."""
    return product(columns.T, matrix, columns).diagonal().copy()


def inner(a: np.ndarray, b: np.ndarray) -> float:
    """The inner product of two vectors."""
    return float(product(a, b))


def length(vector: np.ndarray) -> float:
    """The Euclidean norm of a vector."""
    return float(np.sqrt(product(vector, vector)))


def solve(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """The solution of matrix x = right, for one right side (n,) or for several (n, k).

    Raises
    ------
    numpy.linalg.LinAlgError
        For a singular matrix.
    """
    columns = _numbers(right if right.ndim == 2 else right[:, None])
    try:
        found = core.solve(_numbers(matrix), columns)
    except RuntimeError as error:
        raise np.linalg.LinAlgError(str(error)) from None
    return found if right.ndim == 2 else found[:, 0]


def cholesky(matrix: np.ndarray) -> np.ndarray:
    """The lower triangular L of a symmetric matrix L L'.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the matrix is not positive definite.
    """
    try:
        return np.asarray(core.cholesky(_numbers(matrix)))
    except RuntimeError as error:
        raise np.linalg.LinAlgError(str(error)) from None


def eigenvalues(matrix: np.ndarray) -> np.ndarray:
    """Those of a square matrix, complex."""
    return np.asarray(core.eigenvalues(_numbers(matrix)))


def roots(coefficients: np.ndarray) -> np.ndarray:
    """The roots of a polynomial, complex; coefficients of its powers descending, of which the first ones can be zero.

    Examples
    --------
    >>> sorted(roots(np.array([0.0, 1.0, 0.0, -1.0])).real.tolist())
    [-1.0, 1.0]
    """
    kept = coefficients[np.argmax(coefficients != 0.0) :]
    companion = np.eye(len(kept) - 1, k=-1)
    companion[:1] = -kept[1:] / kept[0]
    return eigenvalues(companion)


def orthonormal(columns: np.ndarray) -> np.ndarray:
    """The orthogonal Q (n, n) of columns = Q R, (n, k): its first columns span those, and the others are orthogonal to them."""
    return np.asarray(core.orthonormal(_numbers(columns)))


def singular(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The singular values of a matrix (m, k), descending, as many as the smaller of m and k, and orthonormal rows (k, k): the directions
    in which it has them first.

    Examples
    --------
    >>> values, rows = singular(np.array([[0.0, 3.0, 0.0]]))
    >>> values.tolist(), np.abs(rows[0]).tolist()
    ([3.0], [0.0, 1.0, 0.0])
    """
    values, rows = core.singular_directions(_numbers(matrix))
    return values[: min(matrix.shape)], rows


def jacobi(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues (not sorted) and orthogonal eigenvectors of a symmetric matrix by cyclic Jacobi rotations.

    An entry is left alone where it is below the rounding of the geometric mean of its two diagonal entries, so graded matrices
    keep the relative accuracy of their small eigenvalues.

    Raises
    ------
    RuntimeError
        If the sweeps do not converge.
    """
    values, vectors = core.symmetric_eigenvalues(_numbers(matrix))
    return values, vectors
