"""Branch points to full accuracy: a regular system of which a simple branch point is a solution."""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

__all__ = ["refine_branch_point"]

_DIFFERENCE = 1e-5
"""Step of the differences; their error only slows Newton's method down."""

_ROUNDS = 12

_SHRUNK = 0.1
"""Part of the step before it that a step is at most, where the second derivatives will do for the next."""

_STAGNATED = 1e-10
"""Newton's last step, in units of the unknowns' sizes: far above rounding, and its successor is below."""


class Equations(Protocol):
    """F(y) and F'(y) of n equations in n + 1 unknowns."""

    def residual(self, y: np.ndarray) -> np.ndarray:
        """F(y), (n,)."""

    def jacobian(self, y: np.ndarray) -> np.ndarray:
        """F'(y), (n, n + 1)."""


def refine_branch_point(
    equations: Equations, y: np.ndarray, scale: np.ndarray | None = None, farthest: float = 1e-2
) -> np.ndarray | None:
    """The branch point next to a place that is near one.

    On a branch near a branch point the equations are nearly singular: a located one is as accurate as the square root of rounding,
    and its smallest singular value as large. With the left null vector psi as unknown the system

        F(y) + m psi = 0,    F'(y)^T psi = 0,    psi . psi = 1

    has a simple branch point as a regular solution, with m = 0. Newton's method on it takes psi . F'' from differences of the Jacobian,
    and keeps it while the steps shrink.

    Parameters
    ----------
    equations : Equations
    y : ndarray (n + 1,)
        Near the branch point.
    scale : ndarray (n + 1,), optional
        Sizes of the unknowns; else 1.
    farthest : float
        How far it may be, in units of the sizes.

    Returns
    -------
    ndarray or None
        None where the iteration does not settle, or on no solution of F = 0, or leaves.

    References
    ----------
    G. Moore, The numerical treatment of non-trivial bifurcation points, Numer. Funct. Anal. Optim. 2 (1980) 441.

    Examples
    --------
    >>> from continuation import GenericProblem
    >>> pitchfork = GenericProblem(lambda y: np.array([y[0]*(y[1] - y[0]**2)]), lambda y: np.array([[y[1] - 3*y[0]**2, y[0]]]))
    >>> [abs(round(float(x), 12)) for x in refine_branch_point(pitchfork, np.array([2e-3, 1e-3]))]
    [0.0, 0.0]
    """
    place = np.asarray(y, dtype=float)
    scale = np.ones(place.size) if scale is None else scale
    psi = np.linalg.svd(np.asarray(equations.jacobian(place), dtype=float) * scale)[0][:, -1]
    n = psi.size
    excess, last, length = 0.0, math.inf, 0.0
    matrix = np.zeros((2 * n + 2, 2 * n + 2))
    for _ in range(_ROUNDS):
        jacobian = np.asarray(equations.jacobian(place), dtype=float) * scale
        matrix[:n, : n + 1] = jacobian
        matrix[:n, n + 1 : -1] = excess * np.eye(n)
        matrix[:n, -1] = psi
        if not 0.0 < length <= _SHRUNK * last:
            matrix[n : 2 * n + 1, : n + 1] = _bend(equations, place, psi, scale, jacobian)
        matrix[n : 2 * n + 1, n + 1 : -1] = jacobian.T
        matrix[-1, n + 1 : -1] = psi
        miss = np.concatenate(
            [np.asarray(equations.residual(place)) + excess * psi, jacobian.T @ psi, [0.5 * (float(psi @ psi) - 1.0)]]
        )
        try:
            step = np.linalg.solve(matrix, -miss)
        except np.linalg.LinAlgError:
            return None
        place = place + scale * step[: n + 1]
        psi = psi + step[n + 1 : -1]
        excess += float(step[-1])
        if not np.linalg.norm((place - y) / scale) < farthest:
            return None
        last, length = length or math.inf, float(np.linalg.norm(step[: n + 1]))
        if length < _STAGNATED:
            return place if abs(excess) < _STAGNATED else None
    return None


def _bend(equations: Equations, place: np.ndarray, psi: np.ndarray, scale: np.ndarray, here: np.ndarray) -> np.ndarray:
    """psi . F''(place), (n + 1, n + 1), for unknowns in units of their sizes; `here`: F'(place) for these."""
    columns = []
    own = psi @ here
    for j in range(place.size):
        apart = np.zeros(place.size)
        apart[j] = _DIFFERENCE * scale[j]
        columns.append((scale * (psi @ np.asarray(equations.jacobian(place + apart))) - own) / _DIFFERENCE)
    return np.stack(columns, axis=1)
