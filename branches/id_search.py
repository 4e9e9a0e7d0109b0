"""Ids to families, where the orbits do not start at the origin: every orbit between their ends, at more and more energies."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from branches.discovery.found import Found
from branches.discovery.scope import require_one_stop, require_two_degrees
from branches.discovery.search import discover
from branches.labels import parse
from branches.name_errors import NameNotFound
from branches.name_search import Limits, passes
from branches.words import PERIODIC, canonical, impacts_per_period, split_family_id

if TYPE_CHECKING:
    from branches.branch import Branch
    from branches.labels import Name
    from bvp.system import ImpactSystem

__all__ = ["find_by_id"]

ROUNDS = 6
"""Times that energies are put between those that were searched: 63 energies at most."""

KEPT = "expected a catalogue that has it (--catalogue FILE)"


def find_by_id(system: ImpactSystem, name: Name, limits: Limits, energy: tuple[float, float]) -> tuple[Found, Branch]:
    """An orbit of the family with an id, and the family.

    Parameters
    ----------
    system : ImpactSystem
    name : Name
        With a family.
    limits : Limits
        Quarter periods and energies that are searched.
    energy : (float, float)
        The range in which the family will be followed.

    Raises
    ------
    NameNotFound
        Where no orbit of it is found, or its orbits have no reversal, so that no search finds them.
    ValueError
        For a system whose orbits cannot be searched.
    """
    from branches.tracing import follow_family

    assert name.family is not None
    ends, word, _ = split_family_id(name.family)
    if ends == PERIODIC:
        raise NameNotFound(f"{name.family} has orbits without a reversal, which no search finds; {KEPT}")
    require_two_degrees(system, "families are searched by id for", KEPT)
    require_one_stop(system, "families are searched by id for")
    impacts = math.ceil(impacts_per_period(word, ends) / 2)
    pair = "-".join(sorted((end.rstrip("+-") for end in ends), key=("origin", "rest", "stop").index))
    wanted = canonical(word, ends, odd_symmetry=system.has_odd_symmetry)
    low, high = max(energy[0], 1e-3 * limits.energy[0]), min(energy[1], limits.energy[1] if energy[1] == math.inf else energy[1])
    span = min(low, limits.energy[0]), max(high, limits.energy[1])
    followed: list[Branch] = []
    for round_ in range(ROUNDS):
        parts = 2 ** (round_ + 1)
        for k in range(1, parts, 2) if name.h is None else (1,):
            h = low * (high / low) ** (k / parts) if name.h is None else name.h
            for orbit in discover(system, h, quarter_period=limits.quarter_period, impacts=impacts, ends=(pair,)).orbits:
                found = Found(orbit.problem, orbit.solution, parse(orbit.label) if orbit.label else None)
                same = canonical(orbit.problem.word, orbit.problem.ends, odd_symmetry=system.has_odd_symmetry) == wanted
                if not same or any(passes(branch, found) for branch in followed):
                    continue
                branch = follow_family(orbit.problem, orbit.solution.y, energy=span)
                if branch.has_id(name.family):
                    return found, branch
                followed.append(branch)
        if name.h is not None:
            break
    there = ", ".join(list(dict.fromkeys(branch.id for branch in followed))[:5])
    raise NameNotFound(
        f"no orbit {name.family} found for h in {low:g}:{high:g}, quarter period up to {limits.quarter_period:g}; "
        + (f"with these ends and this sequence of impacts there are {there}" if there else KEPT)
    )
