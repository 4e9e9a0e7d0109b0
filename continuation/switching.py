"""Leaving a branch point along the other branch: the algebraic branching equation and corrected first points."""

from __future__ import annotations

import math

import numpy as np

from continuation.problem import Event, Problem, Step
from continuation.settings import Settings

_DISTANCE = 1e-4  # a singular point must lie within this distance, to first order, in the metric
_DIFFERENCE = 1e-4  # step of the central differences: rounding eps/step and truncation step^2 are both below 1e-8
_PARALLEL = 1e-3  # sine of the angle below which two directions are one


class SwitchError(RuntimeError):
    """No other branch could be started; the message says why."""


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
    left, values, right = np.linalg.svd(np.asarray(problem.jacobian(y), dtype=float) * scale)
    n = values.size
    psi = left[:, -1]
    basis = (scale * right[n - 1], scale * right[n])

    def curvature(a: np.ndarray, b: np.ndarray) -> float:
        second = getattr(problem, "second_derivative", None)
        if second is not None:
            return float(psi @ np.asarray(second(y, a, b), dtype=float))
        step = _DIFFERENCE * (1.0 + float(np.linalg.norm(y))) / float(np.linalg.norm(b))
        difference = np.asarray(problem.jacobian(y + step * b)) - np.asarray(problem.jacobian(y - step * b))
        return float(psi @ (difference @ a)) / (2.0 * step)

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
        directions.append(vector / float(np.linalg.norm(vector / scale)))
    known = np.asarray(tangent, dtype=float) / scale
    alignment = [abs(float(known @ (vector / scale))) for vector in directions]
    if alignment[0] > alignment[1]:
        directions.reverse()
    other, same = directions
    return other, -other, same, -same


def switch(problem: Problem, event: Event, settings: Settings | None = None, distance: float | None = None) -> tuple[Step, ...]:
    """Corrected first points on the other branch at a branch point, one on each side.

    Parameters
    ----------
    problem : Problem
        The problem that the event was found in.
    event : Event
        The branch point.
    settings : Settings, optional
        `initial_step` is the distance if none is given; `maximum_turn` bounds the turn of the first step.
    distance : float, optional
        Distance of the new points from the branch point, in arclength. It is halved up to ten times where the corrector fails.

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
        ds = distance
        for _ in range(11):
            step = problem.step(event.point.y, direction, ds)
            if step.converged and step.turn >= math.cos(settings.maximum_turn):
                along_known = abs(float(step.tangent @ (metric * known)))
                if step.turn > along_known:
                    steps.append(step)
                    break
            ds *= 0.5
    if not steps:
        raise SwitchError(f"no point of the other branch could be corrected within {distance:.3g} of the branch point")
    return tuple(steps)
