"""Symmetric eigenproblems of small matrices to the accuracy that their entries allow: frequencies and shapes of undamped
modes."""

from __future__ import annotations

import numpy as np

__all__ = ["EPSILON", "exact_product", "jacobi", "undamped_modes"]

EPSILON = float(np.finfo(float).eps)
_SUBNORMAL = float(np.finfo(float).tiny) / EPSILON
"""A square below this has no digits left in products with it; a motion in a period of 1e145 is uniform."""

SWEEPS = 60
"""Jacobi sweeps before it is said that they do not converge; ten are many."""


def undamped_modes(mass: np.ndarray, stiffness: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Squared frequencies and shapes of K phi = w^2 M phi.

    Jacobi's method on the pencil scaled by the mass keeps small frequencies accurate beside large ones (Demmel & Veselic,
    SIAM J. Matrix Anal. Appl. 13 (1992) 1204); two steps of Ogita & Aishima's refinement (Japan J. Indust. Appl. Math. 35
    (2018) 1007) on the given matrices remove what the scaling left. A square below the rounding of its own Rayleigh quotient
    is 0, and so is one below 1e-292.

    Parameters
    ----------
    mass, stiffness : (n, n) ndarray
        Symmetric, mass positive definite.

    Returns
    -------
    squares : (n,) ndarray
        Ascending.
    shapes : (n, n) ndarray
        Columns with Phi^T M Phi = I; the component with the most kinetic energy is positive.

    Raises
    ------
    RuntimeError
        Where Jacobi's method does not converge.
    """
    n = mass.shape[0]
    scale = 1.0 / np.sqrt(np.diag(mass))
    lower = np.linalg.cholesky(scale[:, None] * mass * scale)
    half = np.linalg.solve(lower, scale[:, None] * stiffness * scale)
    reduced = np.linalg.solve(lower, half.T)
    shapes = scale[:, None] * np.linalg.solve(lower.T, jacobi(0.5 * (reduced + reduced.T))[1])
    for _ in range(2):
        shapes = _refine(mass, stiffness, shapes)
    norms = np.einsum("ik,ij,jk->k", shapes, mass, shapes)
    shapes = shapes / np.sqrt(norms)
    squares = np.einsum("ik,ij,jk->k", shapes, stiffness, shapes)
    rounding = 4.0 * n * EPSILON * np.einsum("ik,ij,jk->k", np.abs(shapes), np.abs(stiffness), np.abs(shapes))
    squares[np.abs(squares) <= np.maximum(rounding, _SUBNORMAL)] = 0.0
    shapes = np.where(squares == 0.0, _without_leaks(mass, shapes), shapes)
    order = np.argsort(squares, kind="stable")
    squares, shapes = squares[order], shapes[:, order]
    weight = np.abs(shapes) * np.sqrt(np.diag(mass))[:, None]
    for k in range(n):
        leading = int(np.argmax(weight[:, k] >= (1.0 - 1e-6) * weight[:, k].max()))
        if shapes[leading, k] < 0.0:
            shapes[:, k] = -shapes[:, k]
    return squares, shapes


def _without_leaks(mass: np.ndarray, shapes: np.ndarray) -> np.ndarray:
    """Shapes whose entries are 0 where they are rounding of the others, both in kinetic energy and in displacement: as free translations,
    which go any distance, they would carry bodies along that have no part in them."""
    size = np.abs(shapes)
    weight = size * np.sqrt(np.diag(mass))[:, None]
    leak = (weight <= 8.0 * len(mass) * EPSILON * weight.max(axis=0)) & (size <= np.sqrt(EPSILON) * size.max(axis=0))
    return np.where(leak, 0.0, shapes)


def exact_product(*factors: np.ndarray) -> np.ndarray:
    """The product of matrices (and rows) with 0 for every entry that is rounding of the terms it is summed from.

    What cancels exactly, as a gap between two bodies does in the translation of both, so takes nothing from a translation of any size.

    Examples
    --------
    >>> exact_product(np.array([1.0, -1.0]), np.array([[0.1 + 0.2, 1.0], [0.3, 0.0]]))
    array([0., 1.])
    """
    product, sizes = factors[0], np.abs(factors[0])
    for factor in factors[1:]:
        product, sizes = product @ factor, sizes @ np.abs(factor)
    terms = sum(factor.shape[0] for factor in factors[1:])
    return np.where(np.abs(product) <= 8.0 * terms * EPSILON * sizes, 0.0, product)


def jacobi(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues (not sorted) and orthogonal eigenvectors of a symmetric matrix by cyclic Jacobi rotations.

    An entry is left alone where it is below the rounding of the geometric mean of its two diagonal entries, so graded matrices
    keep the relative accuracy of their small eigenvalues.

    Raises
    ------
    RuntimeError
        After `SWEEPS` sweeps without convergence.
    """
    a = np.array(matrix, dtype=float)
    n = a.shape[0]
    vectors = np.eye(n)
    tiny = np.finfo(float).tiny
    for _ in range(SWEEPS):
        quiet = True
        for i in range(n - 1):
            for j in range(i + 1, n):
                coupling = a[i, j]
                if abs(coupling) <= tiny or abs(coupling) <= 0.5 * EPSILON * np.sqrt(abs(a[i, i])) * np.sqrt(abs(a[j, j])):
                    continue
                quiet = False
                theta = (a[j, j] - a[i, i]) / 2.0 / coupling
                tangent = 1.0 / (abs(theta) + np.hypot(1.0, theta))
                tangent = -tangent if theta < 0.0 else tangent
                cosine = 1.0 / np.hypot(1.0, tangent)
                sine = tangent * cosine
                low, high = a[i, i] - tangent * coupling, a[j, j] + tangent * coupling
                for rows in (a, vectors.T):
                    first, second = rows[i].copy(), rows[j].copy()
                    rows[i] = cosine * first - sine * second
                    rows[j] = sine * first + cosine * second
                a[:, i], a[:, j] = a[i], a[j]
                a[i, i], a[j, j], a[i, j], a[j, i] = low, high, 0.0, 0.0
        if quiet:
            return np.diag(a).copy(), vectors
    raise RuntimeError(f"Jacobi's method did not diagonalise a matrix of size {n} in {SWEEPS} sweeps")


def _refine(mass: np.ndarray, stiffness: np.ndarray, shapes: np.ndarray) -> np.ndarray:
    """One step of Ogita & Aishima; where a coupling is rounding noise only orthogonality is restored."""
    n = mass.shape[0]
    gram = shapes.T @ mass @ shapes
    defect = np.eye(n) - gram
    energy = shapes.T @ stiffness @ shapes
    squares = np.diag(energy) / np.diag(gram)
    coupling = energy + squares * defect
    size = np.abs(shapes)
    noise = size.T @ np.abs(stiffness) @ size + np.abs(squares) * (size.T @ np.abs(mass) @ size)
    gap = squares[None, :] - squares[:, None]
    real = (np.abs(coupling) > 4.0 * n * EPSILON * noise) & (np.abs(coupling) < 1e-3 * np.abs(gap))
    correction = np.where(real, coupling / np.where(real, gap, 1.0), 0.5 * defect)
    return shapes + shapes @ correction
