"""Leaving a branch where its solutions triple: a branch point with a null space of three dimensions."""

from __future__ import annotations

import numpy as np

from continuation.branch_point import Equations
from continuation.switching import SwitchError

__all__ = ["tripling_direction"]

_DIFFERENCE = 1e-4
"""Step of the central differences, in units of the unknowns' sizes."""

_ZERO, _FULL = 1e-8, 1e-4
"""Singular values below the first, as parts of the largest, are zero; above the second they are not."""

_REAL = 1e-4
"""Imaginary part, over its modulus, below which a root is real: the differences' error, well below what tells three roots apart."""


def tripling_direction(equations: Equations, y: np.ndarray, known: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Direction in which the branch of tripled solutions crosses the one that is known.

    Where a pair of multipliers passes exp(+-2 pi i/3), the equations of three turns have two left null vectors psi, and the null space of
    the Jacobian is spanned by the known tangent a and two more vectors. Directions v solve psi . F''[v, v] = 0 for both: two conics, which
    meet in a and in three points more, images of each other under a turn. With v = x a + z that is x A z + Q(z) = 0 for z in the plane of
    the two, so that z is a root of the cubic det(A z, Q(z)).

    Parameters
    ----------
    equations : continuation.branch_point.Equations
    y : ndarray (n + 1,)
        The branch point.
    known : ndarray (n + 1,)
        Tangent of the known branch.
    scale : ndarray (n + 1,)
        Sizes of the unknowns.

    Returns
    -------
    ndarray (n + 1,)
        One of the three, in the unknowns; the branch goes on both ways.

    Raises
    ------
    SwitchError
        The null space has not three dimensions, or the cubic vanishes.

    References
    ----------
    V. I. Arnold, Geometrical Methods in the Theory of Ordinary Differential Equations, Springer (1983), section 34.
    """
    left, values, right = np.linalg.svd(np.asarray(equations.jacobian(y), dtype=float) * scale)
    if not (values[-2] < _ZERO * values[0] and values[-3] > _FULL * values[0]):
        raise SwitchError(
            "the null space of the Jacobian has not three dimensions there "
            f"(singular values {values[-3]:.3g}, {values[-2]:.3g}, {values[-1]:.3g})"
        )
    psi = left[:, -2:].T
    null = right[-3:]
    along = null @ (known / scale)
    frame = np.linalg.svd(along[None, :])[2] @ null  # the known tangent first, then two at right angles to it

    def second(a: np.ndarray) -> np.ndarray:
        apart = _DIFFERENCE * scale * a
        change = np.asarray(equations.jacobian(y + apart)) - np.asarray(equations.jacobian(y - apart))
        table: np.ndarray = psi @ (change * scale) @ frame.T / (2.0 * _DIFFERENCE)
        return table

    by_known, by_first, by_second = (second(vector) for vector in frame)
    linear = 2.0 * by_known[:, 1:]
    q11, q12, q22 = by_first[:, 1], by_first[:, 2], by_second[:, 2]

    def cross(a: np.ndarray, b: np.ndarray) -> float:
        return float(a[0] * b[1] - a[1] * b[0])

    a1, a2 = linear.T
    cubic = np.array(
        [
            cross(a1, q11),
            cross(a2, q11) + 2.0 * cross(a1, q12),
            2.0 * cross(a2, q12) + cross(a1, q22),
            cross(a2, q22),
        ]
    )
    if not np.max(np.abs(cubic)) > _ZERO * np.max(np.abs(linear)) ** 2:
        raise SwitchError("the directions of tripled solutions are not decided at second order there")
    # z = (r, 1); a root at infinity, where the cubic's leading entry vanishes, is one of three.
    roots = np.roots(cubic)
    real = roots[np.abs(roots.imag) <= _REAL * np.abs(roots)].real
    if real.size == 0:
        raise SwitchError("the directions of tripled solutions are not real there")
    z = np.array([real[0], 1.0]) / np.hypot(real[0], 1.0)
    forced = linear @ z
    bent = q11 * z[0] ** 2 + 2.0 * q12 * z[0] * z[1] + q22 * z[1] ** 2
    size = float(forced @ forced)
    if size == 0.0:
        raise SwitchError("the multipliers do not pass through their place there")
    direction: np.ndarray = scale * (np.array([-float(forced @ bent) / size, *z]) @ frame)
    return direction
