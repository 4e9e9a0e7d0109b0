"""Branch switching at a branch point: the point to full accuracy, the directions of the branches, and the first points along them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import zip_longest
from typing import Protocol

import numpy as np

from bvp.dense import inner, length, product, roots, singular, solve
from bvp.functions import cos, hypot
from continuation.control import Settings
from continuation.problem import Event, Problem, Step

_DISTANCE = 1e-4  # a singular point must lie within this distance, to first order, in the metric
_DIFFERENCE = 1e-4  # step of the central differences: rounding eps/step and truncation step^2 are both below 1e-8
_PARALLEL = 1e-3  # sine of the angle below which two directions are one
_NEWTON_DIFFERENCE = 1e-5  # step of the differences in Newton's method; their error only slows it down
_ROUNDS = 12  # of Newton's method
_SHRUNK = 0.1  # second derivatives are kept after a step that is at most this part of the one before
_STAGNATED = 1e-10  # Newton's last step, in units of the unknowns' sizes: far above rounding, and its successor is below
_ZERO, _FULL = 1e-8, 1e-4  # singular values, as parts of the largest: zero below the first, not zero above the second
_LARGE = 0.999  # part of the largest entry from which an entry is as large: those that a symmetry makes equal differ by rounding
_REAL = 1e-4  # imaginary part, over its modulus, below which a root is real: larger than the differences' error


class SwitchError(RuntimeError):
    """No other branch could be started; the message says why."""


def oriented(vector: np.ndarray) -> np.ndarray:
    """A null vector with a sign that rounding does not choose: the first of its largest entries is positive."""
    size = np.abs(vector)
    return np.copysign(1.0, vector[np.argmax(size > _LARGE * np.max(size))]) * vector


def branch_directions(
    problem: Problem, y: np.ndarray, tangent: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The four unit directions in which two branches leave a branch point.

    On the null space of F'(y), spanned by a and b, the directions x a + z b of the branches solve the algebraic branching
    equation c11 x^2 + 2 c12 x z + c22 z^2 = 0 with cij = psi . F''(y)[., .], where psi is the left null vector.

    Parameters
    ----------
    problem : Problem
        Its `jacobian` is used, its `second_derivative` and `weights` if it has them.
    y : ndarray (n + 1,)
        The branch point.
    tangent : ndarray (n + 1,)
        Tangent of the branch that it was found on.

    Returns
    -------
    tuple of ndarray
        (other, -other, known, -known): the tangent that is not parallel to the given one first; each of unit length in the
        metric.

    Raises
    ------
    SwitchError
        The null space is not two-dimensional, or the branching equation has not two different real solutions.

    References
    ----------
    H. B. Keller, Numerical solution of bifurcation and nonlinear eigenvalue problems, in: P. H. Rabinowitz (ed.), Applications
    of Bifurcation Theory, Academic Press (1977) 359.

    Examples
    --------
    The pitchfork x (a - x^2) = 0 at the origin: the other branch leaves along x.

    >>> from continuation import GenericProblem
    >>> pitchfork = GenericProblem(lambda y: np.array([y[0]*(y[1] - y[0]**2)]), lambda y: np.array([[y[1] - 3*y[0]**2, y[0]]]))
    >>> other, _, known, _ = branch_directions(pitchfork, np.zeros(2), np.array([0.0, 1.0]))
    >>> [float(abs(round(x, 9))) for x in other], [float(abs(round(x, 9))) for x in known]
    ([1.0, 0.0], [0.0, 1.0])
    """
    y = np.asarray(y, dtype=float)
    weights = getattr(problem, "weights", None)
    scale = np.ones(y.size) if weights is None else 1.0 / np.sqrt(np.asarray(weights, dtype=float))
    jacobian = np.asarray(problem.jacobian(y), dtype=float) * scale
    values, right = singular(jacobian)
    n = values.size
    psi = singular(jacobian.T)[1][-1]
    basis = (scale * right[n - 1], scale * right[n])

    def curvature(a: np.ndarray, b: np.ndarray) -> float:
        second = getattr(problem, "second_derivative", None)
        if second is not None:
            return inner(psi, np.asarray(second(y, a, b), dtype=float))
        step = _DIFFERENCE * (1.0 + length(y)) / length(b)
        difference = np.asarray(problem.jacobian(y + step * b)) - np.asarray(problem.jacobian(y - step * b))
        return float(product(psi, difference, a)) / (2.0 * step)

    c11, c12, c22 = curvature(basis[0], basis[0]), curvature(basis[0], basis[1]), curvature(basis[1], basis[1])
    size = math.sqrt(c11 * c11 + 2 * c12 * c12 + c22 * c22)
    if not values[-1] <= _DISTANCE * size:
        raise SwitchError(
            "no branch point: the null space of the Jacobian is one-dimensional there "
            f"(smallest singular value {values[-1]:.3g})"
        )
    if n > 1 and values[-2] <= _DISTANCE * size:
        raise SwitchError(
            "the null space of the Jacobian has more than two dimensions there "
            f"(singular values {values[-2]:.3g}, {values[-1]:.3g})"
        )
    discriminant = c12 * c12 - c11 * c22
    if not discriminant > _PARALLEL**2 * size * size:
        raise SwitchError(
            "the algebraic branching equation has no two different real solutions there "
            f"(discriminant {discriminant:.3g}): an isolated point, or branches that touch"
        )
    root = math.sqrt(discriminant)
    lead = -(c12 + math.copysign(root, c12))  # without cancellation: the roots are lead : c11 and c22 : lead
    directions = []
    for x, z in ((lead, c11), (c22, lead)):
        vector = x * basis[0] + z * basis[1]
        directions.append(scale * oriented(vector / scale) / length(vector / scale))
    known = np.asarray(tangent, dtype=float) / scale
    alignment = [abs(inner(known, vector / scale)) for vector in directions]
    if alignment[0] > alignment[1]:
        directions.reverse()
    other, same = directions
    return other, -other, same, -same


def other_branch_starts(
    problem: Problem, event: Event, settings: Settings | None = None, distance: float | None = None
) -> tuple[Step, ...]:
    """Corrected first points on the other branch at a branch point, one on each side.

    Parameters
    ----------
    problem : Problem
    event : Event
        The branch point.
    settings : Settings, optional
        `initial_step` is the distance if none is given; `maximum_turn` bounds the turn of the first step.
    distance : float, optional
        Of the new points from the branch point, in arclength. It is halved up to ten times where the corrector fails.

    Returns
    -------
    tuple of Step
        One for each side on which the other branch has points, with tangents that point away from the branch point: follow each
        with ``follow(problem, step, 0)``.

    Raises
    ------
    SwitchError
        Not two branches there (see `branch_directions`), or no point could be corrected on either side.
    ValueError
        A distance that is not positive.
    """
    settings = Settings() if settings is None else settings
    distance = settings.initial_step if distance is None else distance
    if not distance > 0:
        raise ValueError(f"distance = {distance!r}: expected a number above 0")
    forward, backward, known, _ = branch_directions(problem, event.point.y, event.point.tangent)
    weights = getattr(problem, "weights", None)
    metric = np.ones(known.size) if weights is None else np.asarray(weights, dtype=float)
    steps = []
    for direction in (forward, backward):
        for halvings in range(11):
            step = problem.step(event.point.y, direction, distance * 0.5**halvings)
            enough = cos(settings.maximum_turn)
            if step.converged and step.turn >= enough and step.turn > abs(inner(step.tangent, metric * known)):
                steps.append(step)
                break
    if not steps:
        raise SwitchError(f"no point of the other branch could be corrected within {distance:.3g} of the branch point")
    return tuple(steps)


class Equations(Protocol):
    """n equations in n + 1 unknowns: F(y), (n,), and F'(y), (n, n + 1).

    Optional, found by name: ``curvature_blocks``, index arrays of unknowns. No second derivative of F is by unknowns of two blocks, so that
    one difference of F' serves a column of each block. Unknowns in no block act on all, and need a difference each.
    """

    def residual(self, y: np.ndarray) -> np.ndarray: ...

    def jacobian(self, y: np.ndarray) -> np.ndarray: ...


def refine_branch_point(
    equations: Equations, y: np.ndarray, scale: np.ndarray | None = None, farthest: float = 1e-2
) -> np.ndarray | None:
    """The branch point next to a place that is near one.

    On a branch near a branch point the equations are nearly singular: a located one is as accurate as the square root of rounding,
    and its smallest singular value as large. With the left null vector psi as unknown the system

        F(y) + m psi = 0,    F'(y)^T psi = 0,    psi . psi = 1

    has a simple branch point as a regular solution, with m = 0. Newton's method on it takes psi . F'' from differences of the Jacobian,
    and keeps it while the steps shrink. For equations with ``curvature_blocks`` it needs as many as the largest block has unknowns, and one
    for each unknown in no block.

    `scale`: sizes of the unknowns (n + 1,), by default 1. The result is None if the iteration does not converge, converges to no solution
    of F = 0, or goes more than `farthest` away, in units of the sizes.

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
    psi = singular((np.asarray(equations.jacobian(place), dtype=float) * scale).T)[1][-1]
    n = psi.size
    excess, last, moved_by = 0.0, math.inf, 0.0
    blocks: Sequence[np.ndarray] = getattr(equations, "curvature_blocks", (np.arange(n + 1),))
    alone = np.setdiff1d(np.arange(n + 1), np.concatenate(blocks))
    groups = []  # for each difference of F': the unknowns moved, and the places in psi . F'' that it gives
    for members in zip_longest(*blocks):
        pairs = [(j, block) for j, block in zip(members, blocks, strict=True) if j is not None]
        moved = [j for j, _ in pairs]
        groups.append((moved, np.concatenate([block for _, block in pairs]), np.repeat(moved, [len(block) for _, block in pairs])))
    groups += [([j], np.arange(n + 1), np.full(n + 1, j)) for j in alone.tolist()]
    matrix = np.zeros((2 * n + 2, 2 * n + 2))
    for _ in range(_ROUNDS):
        plain = np.asarray(equations.jacobian(place), dtype=float)
        jacobian = plain * scale
        matrix[:n, : n + 1] = jacobian
        matrix[:n, n + 1 : -1] = excess * np.eye(n)
        matrix[:n, -1] = psi
        if not 0.0 < moved_by <= _SHRUNK * last:
            slope = product(psi, jacobian)
            bend = np.repeat((scale * product(psi, plain) - slope)[:, None], n + 1, axis=1)  # psi . F''; rounding where it is 0
            for moved, rows, columns in groups:
                apart = np.zeros(n + 1)
                apart[moved] = _NEWTON_DIFFERENCE * scale[moved]
                bend[rows, columns] = (scale * product(psi, np.asarray(equations.jacobian(place + apart))) - slope)[rows]
            bend[alone] = bend[:, alone].T
            matrix[n : 2 * n + 1, : n + 1] = bend / _NEWTON_DIFFERENCE
        matrix[n : 2 * n + 1, n + 1 : -1] = jacobian.T
        matrix[-1, n + 1 : -1] = psi
        residual = np.concatenate(
            [np.asarray(equations.residual(place)) + excess * psi, product(jacobian.T, psi), [0.5 * (inner(psi, psi) - 1.0)]]
        )
        try:
            step = solve(matrix, -residual)
        except np.linalg.LinAlgError:
            return None
        place = place + scale * step[: n + 1]
        psi = psi + step[n + 1 : -1]
        excess += float(step[-1])
        if not length((place - y) / scale) < farthest:
            return None
        last, moved_by = moved_by or math.inf, length(step[: n + 1])
        if moved_by < _STAGNATED:
            return place if abs(excess) < _STAGNATED else None
    return None


def tripling_direction(equations: Equations, y: np.ndarray, known: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Direction in which the branch of period-tripled solutions crosses the known branch at a 1:3 resonance.

    There a pair of multipliers passes exp(+-2 pi i/3). The equations of the 3-fold cover have two left null vectors psi, and the null
    space of the Jacobian is spanned by the known tangent a and two more vectors. Directions v solve psi . F''[v, v] = 0 for both: two
    conics. They meet in a and in three other points, which are images of each other under a shift by one period. With v = x a + z that
    is x A z + Q(z) = 0 for z in the plane of the two vectors, so z is a root of the cubic det(A z, Q(z)).

    Parameters
    ----------
    equations : Equations
    y, known, scale : ndarray (n + 1,)
        The branch point, the tangent of the known branch, and sizes of the unknowns.

    Returns
    -------
    ndarray (n + 1,)
        One of the three; the branch goes on both ways.

    Raises
    ------
    SwitchError
        The null space has not three dimensions, or the cubic vanishes.

    References
    ----------
    V. I. Arnold, Geometrical Methods in the Theory of Ordinary Differential Equations, Springer (1983), section 34.
    """
    jacobian = np.asarray(equations.jacobian(y), dtype=float) * scale
    values, right = singular(jacobian)
    if not (values[-2] < _ZERO * values[0] and values[-3] > _FULL * values[0]):
        raise SwitchError(
            "the null space of the Jacobian has not three dimensions there "
            f"(singular values {values[-3]:.3g}, {values[-2]:.3g}, {values[-1]:.3g})"
        )
    psi = singular(jacobian.T)[1][-2:]
    null = right[-3:]
    along = product(null, known / scale)
    frame = product(singular(along[None, :])[1], null)  # the known tangent first, then two at right angles to it

    def second(a: np.ndarray) -> np.ndarray:
        apart = _DIFFERENCE * scale * a
        change = np.asarray(equations.jacobian(y + apart)) - np.asarray(equations.jacobian(y - apart))
        table: np.ndarray = product(psi, change * scale, frame.T) / (2.0 * _DIFFERENCE)
        return table

    by_known, by_first, by_second = (second(vector) for vector in frame)
    linear = 2.0 * by_known[:, 1:]
    q11, q12, q22 = by_first[:, 1], by_first[:, 2], by_second[:, 2]

    # Determinants of each of the two columns of A with each coefficient of Q.
    (c11, c12, c22), (d11, d12, d22) = [[float(a[0] * q[1] - a[1] * q[0]) for q in (q11, q12, q22)] for a in linear.T]
    cubic = np.array([c11, d11 + 2.0 * c12, 2.0 * d12 + c22, d22])
    if not np.max(np.abs(cubic)) > _ZERO * np.max(np.abs(linear)) ** 2:
        raise SwitchError("the directions of tripled solutions are not decided at second order there")
    # z = (r, 1); a root at infinity, where the cubic's leading entry vanishes, is one of three.
    found = roots(cubic)
    real = found[np.abs(found.imag) <= _REAL * np.abs(found)].real
    if real.size == 0:
        raise SwitchError("the directions of tripled solutions are not real there")
    z = np.array([real[0], 1.0]) / hypot(real[0], 1.0)
    forced = product(linear, z)
    bent = q11 * z[0] ** 2 + 2.0 * q12 * z[0] * z[1] + q22 * z[1] ** 2
    size = inner(forced, forced)
    if size == 0.0:
        raise SwitchError("the multipliers do not pass through their place there")
    direction: np.ndarray = scale * product(np.array([-inner(forced, bent) / size, *z]), frame)
    return direction
