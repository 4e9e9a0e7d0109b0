"""The first orbits of a family that leaves an orbit in a direction."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from bvp.dense import inner, length, product, singular, solve
from bvp.functions import hypot
from continuation.problem import Step
from continuation.switching import oriented

__all__ = ["DISTANCE", "across_null_space", "first_orbits", "is_denied", "shares_fold"]

DISTANCE = 0.02
"""Distance from the event to the first orbit looked for on a new family, in units of the orbit's size; halved where there is none."""

_GAP = 1e-6
"""Singular values below this fraction of the largest count as zero at a located bifurcation."""

_CONVERGED = 1e-5
"""Largest last Newton correction of a first orbit, relative to its distance from the bifurcation. It is loose because rounding is large
near a singular point; following the family corrects the orbit again."""

_CROSSING = 1e-4
"""Slope of the parameter at the event beside that of a chord, below which it is rounding."""

_NUDGE = 1e-7
"""Part of the orbit's size by which the slope there is measured: the residual beside is its square, which is rounding."""

_BEND = 0.1
"""How far the middle of a family's first piece may be from the middle of its chord, as a part of the chord."""


def is_denied(problem: Any, y: np.ndarray) -> bool:
    """Whether the Jacobian of the wider problem of a bifurcation is regular there; False where it cannot be computed."""
    matrix = problem.jacobian(y) * problem.scales(y)
    if not np.isfinite(matrix).all():
        return False
    values, _ = singular(matrix)
    return bool(values[-1] > _GAP * values[0])


def shares_fold(family: Any, y: np.ndarray) -> bool:
    """Whether the parameter has an extremum along each of several families through an orbit: no null vector of the Jacobian changes it."""
    scale = family.problem.scales(y)
    values, rows = singular(family.jacobian(y) * scale)
    null = rows[np.append(values <= _GAP * values[0], True)]
    found = [_parameter(family, y, way * scale) for way in null]
    return len(found) > 1 and all(abs(slope) <= _CROSSING * abs(value) for value, slope in found)


def across_null_space(problem: Any, y: np.ndarray, known: np.ndarray, what: str) -> np.ndarray:
    """The direction (u,) in the null space of the Jacobian at a located bifurcation that is at right angles to the known one.

    Raises
    ------
    RuntimeError
        Where the null space has one dimension; `what` names the bifurcation.
    """
    scale = problem.scales(y)
    matrix = problem.jacobian(y) * scale
    if not np.isfinite(matrix).all():
        raise RuntimeError(f"{what}: a flight of the wider problem cannot be computed, or its derivatives")
    values, rows = singular(matrix)
    if values[-1] > _GAP * values[0]:
        raise RuntimeError(
            f"{what} is no bifurcation of the wider problem: its smallest singular value is {values[-1] / values[0]:.1e}"
        )
    null = rows[-2:]
    along = product(null, known / scale)
    across = np.array([-along[1], along[0]]) / hypot(along[0], along[1])
    direction: np.ndarray = oriented(product(across, null)) * scale
    return direction


def first_orbits(family: Any, y: np.ndarray, direction: np.ndarray, *, at_an_angle: bool = False) -> Iterator[Step]:
    """The first orbits on both sides, where there are any. at_an_angle: the families cross so, and the new one can fold at any distance
    from there. Else its parameter has an extremum there, by symmetry."""
    for side in (direction, -direction):
        step = _first(family, y, side, at_an_angle)
        if step is not None:
            yield step


def _first(family: Any, y: np.ndarray, direction: np.ndarray, at_an_angle: bool) -> Step | None:
    """A corrected orbit at a small distance in a direction, with its tangent pointing on."""
    problem = family.problem
    scale = problem.scales(y)
    way = direction / scale / length(direction / scale)
    ds = DISTANCE
    value, slope = _parameter(family, y, way * scale) if at_an_angle else (0.0, 0.0)
    found = None
    for _ in range(12):
        there, half = (_beside(problem, y, way, scale, distance) for distance in (ds, 0.5 * ds))
        # On a smooth family from here the orbit at half the distance is about half way; another family nearby has none there.
        if there is not None and half is not None and np.max(np.abs(half - 0.5 * there)) < _BEND * np.max(np.abs(there)):
            begin = family.begin(y + there * scale)
            if begin.converged and inner(begin.tangent[: problem.unknowns], there / scale) < 0.0:
                begin = family.step(begin.y, -begin.tangent, 0.0)
            if begin.converged:
                solution = begin.extra
                if solution["clearance"] > 0.0 and solution["speed"] > 0.0 and solution["flight"] > 0.0:
                    found = begin
                    chord = (begin.parameter - value) / ds
                    if slope * begin.slope >= 0.0 or abs(slope) < _CROSSING * abs(chord):
                        return begin
                    # The family folds before this orbit, near the extremum of a parabola: half way to it is the next try.
                    ds *= min(1.0, 0.5 * abs(slope / (slope - chord)))
        ds *= 0.5
    return found


def _parameter(family: Any, y: np.ndarray, way: np.ndarray) -> tuple[float, float]:
    """The reported parameter at an orbit, and its derivative along a way."""
    here, *beside = (family.uncorrected(y + part * way).parameter for part in (0.0, _NUDGE, -_NUDGE))
    return here, (beside[0] - beside[1]) / (2.0 * _NUDGE)


def _beside(problem: Any, y: np.ndarray, way: np.ndarray, scale: np.ndarray, distance: float) -> np.ndarray | None:
    """The way from an orbit, in units of the scales, to the one at a distance along a unit direction; None where Newton fails.

    The distance counts all unknowns. A branch's arclength measures the start state only, and in it a new family can leave almost along
    the old one.
    """
    apart = distance * way
    for _ in range(12):
        there = y + apart * scale
        matrix = np.vstack([problem.jacobian(there) * scale, way])
        residual = np.concatenate([problem.residual(there), [inner(way, apart) - distance]])
        try:
            change = solve(matrix, -residual)
        except np.linalg.LinAlgError:
            return None
        apart = apart + change
        if not np.max(np.abs(apart)) < 4.0 * distance:
            return None
        if np.max(np.abs(change)) < _CONVERGED * distance:
            return apart
    return None
