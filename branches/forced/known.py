"""Whether two events are one, and whether a family of forced orbits is known already: it has the first orbit that is found at an event."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from scipy.optimize import brentq

from branches.forced.branch import ForcedBranch, ForcedEvent
from branches.forced.family import parameter_family
from branches.forced.identity import impact_flux, invariants
from branches.forced.primitive import kind_of
from bvp.forced import ForcedProblem

__all__ = ["events_at", "has_orbit", "meeting_place"]

_SAME = 1e-7
"""Largest difference, beside the value, of the parameter at an event that two families share."""

_FLUX = 2e-3
"""Largest relative difference of the impact flux of the orbit there."""

_FLOOR = 1e-6
"""Change of a number along a branch, beside the number, that is rounding."""

_ON = 1e-6
"""Distance of two orbits, in units of the change along the branch, that are one."""

_MARGIN = 0.2
"""Part of the arclength between two points by which an orbit is sought beyond them."""


def meeting_place(branch: ForcedBranch, point: int) -> tuple[float, float]:
    """The parameter and the impact flux at a point. Of parts that do not interact, several families of one kind begin at one value."""
    return float(branch.parameter[point]), impact_flux(branch.problem, branch.unknowns[point])


def events_at(branch: ForcedBranch, types: Sequence[str], place: tuple[float, float], width: float = 0.0) -> list[ForcedEvent]:
    """The events of some types of a branch at the place of another family's event, the bracket of which has a width."""
    near = [(event, *meeting_place(branch, event.point)) for event in branch.events if event.type in types]
    slack = max(_SAME, width) * float(np.abs(branch.parameter).max())
    return [event for event, value, flux in near if abs(value - place[0]) <= slack and math.isclose(flux, place[1], rel_tol=_FLUX)]


@lru_cache(maxsize=32)
def _curve(branch: ForcedBranch) -> np.ndarray:
    """The invariants of all orbits of a branch, (N, 5)."""
    return np.array([invariants(branch.problem, y) for y in branch.unknowns])


def has_orbit(branch: ForcedBranch, problem: ForcedProblem, y: np.ndarray) -> bool:
    """Whether a branch has an orbit, or an image of it: the nearest one of the branch, between two points, is that. Impacts are the same if
    they are those of the mirror image."""
    if kind_of(problem) != kind_of(branch.problem) or len(branch) < 2:
        return False
    curve = _curve(branch)
    unit = np.maximum(np.ptp(curve, axis=0), _FLOOR * np.abs(curve).max(axis=0) + _FLOOR**2)
    away, chords = (invariants(problem, y) - curve) / unit, np.diff(curve, axis=0) / unit
    parts = np.clip(np.sum(away[:-1] * chords, axis=1) / np.maximum(np.sum(chords**2, axis=1), _FLOOR**2), 0.0, 1.0)
    i = int(np.argmin(np.linalg.norm(away[:-1] - parts[:, None] * chords, axis=1)))
    family, tangent = parameter_family(branch.problem), np.pad(branch.tangents[i], (0, branch.problem.unknowns))

    def apart(distance: float) -> np.ndarray:
        step = family.step(branch.unknowns[i], tangent, distance)
        if not step.converged:
            raise ValueError("no orbit")
        return np.subtract(away[i], (invariants(branch.problem, step.y) - curve[i]) / unit)

    length = float(branch.arclength[i + 1] - branch.arclength[i])
    try:
        nearest = brentq(lambda distance: float(apart(distance) @ chords[i]), -_MARGIN * length, (1.0 + _MARGIN) * length)
        return bool(np.linalg.norm(apart(nearest)) <= _ON)
    except ValueError:
        return False
