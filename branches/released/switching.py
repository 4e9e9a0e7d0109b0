"""Families of free orbits in a parameter that begin at an event of another one.

The orbit at the event belongs to a family in the energy, too, of the system there, with the same event. What begins there
(`branches.switching`), or meets it at a grazing (`branches.grazing.following`), has a first orbit beside the event at the same parameters.
From this orbit the family in the parameter is corrected onto the equations that are kept.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import chain

import numpy as np

from branches.admissible import unphysical
from branches.forced.branch import ForcedEvent
from branches.grazing.following import meetings_at
from branches.released.branch import ReleasedBranch
from branches.released.family import ReleasedFamily
from branches.released.presentation import released_orbit
from branches.switching import TYPES, emanating_families
from branches.tracing import follow_family
from bvp.multipoint import MultipointProblem
from bvp.released import ReleasedProblem
from continuation.problem import Step

__all__ = ["FREE_SWITCHES", "switch_released"]

FREE_SWITCHES = (*TYPES, "GR")
"""Events at which other families begin."""

_AROUND = 1e-3
"""Part of the energy by which the family in the energy is followed around the event."""

_BACK = (-_AROUND, _AROUND, -10.0 * _AROUND, 10.0 * _AROUND)
"""Arclengths at which an orbit is sought where the first one is beyond the event."""

_SAME = 1e-6
"""Largest relative difference in the energy between an event of the family in the parameter and that of the family in the energy."""


def switch_released(branch: ReleasedBranch, event: ForcedEvent) -> list[tuple[ReleasedProblem, Step]]:
    """Orbits near an event of the families in the parameter that begin or meet the branch there, each with its problem. A family goes on to
    both sides of its orbit. Errors are those of `branches.forced.tracing.switch_response`."""
    if event.type not in FREE_SWITCHES:
        raise ValueError(f"no other family begins at {event.id}; expected an event of type {', '.join(FREE_SWITCHES)}")
    found: list[tuple[ReleasedProblem, Step]] = []
    seen = set()
    for problem, y in _beside(branch, event):
        key = problem.ends, problem.sequence
        if key in seen or key == (branch.problem.ends, branch.problem.sequence) and event.type != "BP":
            continue  # its other side
        values = branch.problem.parameters(branch.unknowns[event.point])
        released, first = released_orbit(branch.problem, values, problem, y)
        begin = _first_step(ReleasedFamily(released), first)
        if begin is not None:
            seen.add(key)
            found.append((released, begin))
    if not found:
        raise RuntimeError(f"no family was found at {event.id}")
    return found


def _first_step(family: ReleasedFamily, first: np.ndarray) -> Step | None:
    """The orbit of a family near another one, that is one: a correction can pass the event."""
    begin = family.begin(first)
    beside = (family.step(begin.y, begin.tangent, ds) for ds in _BACK if begin.converged)
    return next((one for one in chain([begin], beside) if one.converged and unphysical(one.extra.problem, one.extra) is None), None)


def _beside(branch: ReleasedBranch, event: ForcedEvent) -> Iterable[tuple[MultipointProblem, np.ndarray]]:
    """First orbits beside the event, of the system there."""
    orbit = branch.orbit(event.point)
    if event.type == "GR":
        met = meetings_at(orbit.problem, orbit.solution.y, True)
        if met and all(one.kind == "linear mode" for one in met):
            raise RuntimeError(f"all impacts vanish at {event.id}: the linear mode {met[0].label} remains, which has none")
        return [(one.beside.problem, one.beside.y) for one in met if one.beside is not None]
    around = orbit.h * (1.0 - _AROUND), orbit.h * (1.0 + _AROUND)
    near = follow_family(orbit.problem, orbit.solution.y, energy=around)
    same = [one for one in near.events if one.type == event.type and abs(one.h / orbit.h - 1.0) < _SAME]
    return [(one.problem, one.step.y) for at in same for one in emanating_families(near, at)]
