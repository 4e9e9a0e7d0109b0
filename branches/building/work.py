"""What is done for one seed: a pure function of plain data, which runs in any process.

A seed is one of three. ``energy``: find every orbit at an energy. ``mode``: find the families that begin at a linear mode. ``orbit``:
follow the family of an orbit, and find the families that meet it at its events.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

from branches.branch import Branch, BranchEvent
from branches.building.bounds import Bounds
from branches.catalogue.closures import event_orbit, orbit_of_event, seen_from, unknowns_of
from branches.catalogue.rows import EventOrbit
from branches.discovery.search import discover
from branches.grazing import neighbours
from branches.identity import canonical_orbit
from branches.linear_modes import families_at, linear_modes
from branches.switching import TYPES, births
from branches.tracing import follow_family
from branches.words import impacts_per_period
from bvp.multipoint import MultipointProblem, NotConverged

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["Answer", "Link", "Seed", "work"]

_FEW = 3
"""Points followed of a family that is only looked at, to follow it later from its own seed."""


class Seed(NamedTuple):
    """A piece of work.

    kind: "energy", "mode" or "orbit". value: the energy; (index of the mode, its turns); or the orbit as an `EventOrbit`.
    bounds: `Bounds`. link: how the orbit's family was reached, None where it was found by itself.
    """

    kind: str
    value: Any
    bounds: Bounds
    link: Link | None = None


@dataclass(frozen=True)
class Link:
    """Where two nodes of the graph meet, before it is known which family is on the other side.

    source: id of the family or linear mode. event, type: of the event there. kind: of the edge. note: in words. here, there: the event's
    orbit as the two families have it.
    """

    source: str
    event: str
    type: str
    kind: str
    h: float
    alpha: float
    stop: str | None = None
    note: str | None = None
    here: EventOrbit | None = None
    there: EventOrbit | None = None


class Answer(NamedTuple):
    """What came of a seed.

    branch: the family that was followed, with its `whole` known. seeds: what is to be followed next. ends: links without a family on
    the other side, with the reason as their note. beyond: how many neighbours lie outside the bounds. failed: what could not be done, in
    words.
    counts: of the stages of a search.
    """

    branch: Branch | None
    seeds: tuple[Seed, ...]
    ends: tuple[Link, ...] = ()
    beyond: int = 0
    failed: tuple[str, ...] = ()
    counts: dict[str, Any] | None = None


@lru_cache(maxsize=4)
def _system(description: str) -> ImpactSystem:
    import json

    from bvp.system import ImpactSystem

    return ImpactSystem.from_description(json.loads(description))


def work(description: str, seed: Seed) -> Answer:
    """Do the work of a seed.

    Parameters
    ----------
    description : str
        The system as `ImpactSystem.describe` gives it, in JSON.
    seed : Seed
    """
    system = _system(description)
    if seed.kind == "energy":
        return _at_energy(system, float(seed.value), seed.bounds)
    if seed.kind == "mode":
        index, turns = seed.value
        return _at_mode(system, index, turns, seed.bounds)
    return _follow(system, seed)


def _at_energy(system: ImpactSystem, energy: float, bounds: Bounds) -> Answer:
    found = discover(system, energy, quarter_period=bounds.quarter_period, impacts=bounds.impacts, ends=ends_of(system))
    seeds = [Seed("orbit", event_orbit(*canonical_orbit(orbit.problem, orbit.solution.y)), bounds) for orbit in found.orbits]
    return Answer(None, tuple(seeds), counts={"energy": energy, "settled": found.settled, **found.counts})


def ends_of(system: ImpactSystem) -> tuple[str, ...]:
    """All pairs of ends between which a system's symmetric orbits are searched."""
    reversed_ = ("rest-rest", "rest-stop", "stop-stop")
    return ("origin-origin", *reversed_) if system.has_odd_symmetry else reversed_


def _at_mode(system: ImpactSystem, index: int, turns: int, bounds: Bounds) -> Answer:
    mode = linear_modes(system)[index]
    seeds = []
    for found in families_at(mode, turns, bounds.impacts, points=_FEW, energy=bounds.energy):
        assert found.branch is not None
        there = None if found.there is None else event_orbit(found.there.problem, found.there.y)
        note = f"{turns} turns: {found.kind}"
        link = Link(mode.label, "", "GR", "linear mode", found.h, mode.alpha, ",".join(found.stops), note, None, there)
        seeds.append(_seed(found.branch, link, bounds))
    return Answer(None, tuple(seeds))


def _seed(branch: Branch, link: Link | None, bounds: Bounds) -> Seed:
    """The seed of a family from a short branch of it."""
    plain = [i for i in range(len(branch)) if all(event.point != i for event in branch.events)]
    problem, y = canonical_orbit(branch.problem, branch.unknowns(plain[-1] if plain else branch.start))
    return Seed("orbit", event_orbit(problem, y), bounds, link)


def _follow(system: ImpactSystem, seed: Seed) -> Answer:
    bounds = seed.bounds
    orbit: EventOrbit = seed.value
    problem = MultipointProblem(system, orbit.ends, tuple(orbit.word) if len(system.stops) == 1 else _letters(orbit.word))
    y = unknowns_of(problem, orbit)
    try:
        branch = follow_family(problem, y, energy=bounds.energy, quarter_period=bounds.quarter_period)
    except (RuntimeError, NotConverged) as error:
        return Answer(None, (), failed=(f"{'-'.join(orbit.ends)}:{orbit.word}: {error}",))
    source = branch.id
    seeds: list[Seed] = []
    ends: list[Link] = []
    failed: list[str] = []
    beyond = 0
    for event in branch.events:
        if event.type == "GR":
            some, over, dead = _across_grazing(branch, event, bounds)
        elif event.type in TYPES:
            times = {"PD": 2, "RT": event.p_q[1] if event.p_q else 1}.get(event.type, 1)
            if not bounds.holds(alpha=times * event.alpha, impacts=times * impacts_per_period(branch.problem.word, branch.ends)):
                beyond += 1
                continue
            some, over, dead = _across_bifurcation(branch, event, bounds)
        else:
            continue
        seeds += some
        ends += dead
        beyond += over
    for end in branch.ended:
        if end.reason not in ("EVENT", "CLOSED"):
            failed.append(f"{source}: {end.reason}: {end.text}")
    return Answer(branch, tuple(seeds), tuple(ends), beyond, tuple(failed))


def _letters(word: str) -> tuple[str, ...]:
    from branches.words import parse_word

    return parse_word(word)


def _across_grazing(branch: Branch, event: BranchEvent, bounds: Bounds) -> tuple[list[Seed], int, list[Link]]:
    """The families that meet the branch at a grazing: seeds, how many are outside the bounds, and dead ends."""
    seeds, dead, beyond = [], [], 0
    here = orbit_of_event(branch, event)
    found = neighbours(branch, event, points=_FEW, energy=_wider(bounds.energy))
    for item in found:
        link = Link(branch.id, event.id, "GR", item.kind, event.h, event.alpha, event.stop, item.reason or None, here)
        if item.branch is None:
            if item.kind == "linear mode":
                dead.append(link)
            continue
        if not bounds.holds(alpha=item.alpha, impacts=item.impacts):
            beyond += 1
            continue
        assert item.there is not None
        there = event_orbit(item.there.problem, item.there.y)
        seeds.append(_seed(item.branch, replace(link, there=there), bounds))
    if not seeds and not beyond and not dead:
        reasons = "; ".join(dict.fromkeys(item.reason for item in found if item.reason)) or "no other word fits"
        dead.append(Link(branch.id, event.id, "GR", "dead end", event.h, event.alpha, event.stop, reasons, here))
    return seeds, beyond, dead


def _across_bifurcation(branch: Branch, event: BranchEvent, bounds: Bounds) -> tuple[list[Seed], int, list[Link]]:
    """The families that are born or cross at a bifurcation."""
    here = orbit_of_event(branch, event)
    link = Link(branch.id, event.id, event.type, "switch", event.h, event.alpha, None, event.note, here)
    try:
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always", RuntimeWarning)
            found = births(branch, event)
    except (RuntimeError, ValueError) as error:
        return [], 0, [replace(link, kind="dead end", note=str(error))]
    seeds, beyond = [], 0
    dead = [replace(link, kind="dead end", note=str(warning.message)) for warning in told]
    for birth in found:
        problem, y = canonical_orbit(birth.problem, birth.step.y)
        if not bounds.holds(alpha=problem.quarter_period(y), impacts=impacts_per_period(problem.word, problem.ends)):
            beyond += 1
            continue
        # Where a family of more symmetry, or of several turns, is crossed, the equations are singular and the crossing has the square root
        # of their accuracy: the same event on that family is regular, and the edge is made from there.
        crossed = None
        if not birth.turns:
            there = seen_from(branch.problem, branch.unknowns(event.point), problem.ends, tuple(problem.word))
            crossed = replace(link, there=there)
        seeds.append(Seed("orbit", event_orbit(problem, y), bounds, crossed))
    return seeds, beyond, dead


def _wider(energy: tuple[float, float]) -> tuple[float, float]:
    """A range in which the first orbits beyond an event at a bound are found too."""
    return 0.5 * energy[0], 2.0 * energy[1]
