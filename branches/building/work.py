"""The work of one seed: a pure function of plain data, which runs in any process.

A seed is one of five. ``energy``: find every orbit at an energy. ``mode``: find the families that begin at a linear mode. ``name``: find
the family that has a name. ``orbit``: follow the family of an orbit, and find the families that are born at its bifurcations.
``grazing``: find the families that meet at a grazing orbit.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from functools import lru_cache

import numpy as np

from branches.between_events import missed_events
from branches.branch import Branch, BranchEvent
from branches.building.plan import Answer, BuildPlan, Grazing, Link, Seed
from branches.catalogue.members import COMPARED, kept_orbit, orbit_of_event, presented, unknowns_of
from branches.catalogue.packing import pack_family
from branches.catalogue.rows import EventOrbit
from branches.events import DigitWork
from branches.family import RESONANCES
from branches.full_family import Course, longest_course
from branches.grazing.following import SolvedProblem, leaves_upward, meetings_at
from branches.grazing.touching import Candidate, touching
from branches.linear_modes import beginnings, linear_modes
from branches.naming.search import Limits
from branches.presentation import Presentation, first_of, presentations, segment_images, symmetries, with_canonical_sequence
from branches.search.discovery import discover_orbits
from branches.search.known import Boxes
from branches.search.orbit_search import WITHOUT_ORIGIN
from branches.sequences import PERIODIC, impacts_per_period, parse_sequence
from branches.switching import TYPES, emanating_families
from branches.tracing import SETTINGS, cut_branch, follow_family
from bvp.closures import cycle_of
from bvp.multipoint import MultipointProblem, NotConverged
from bvp.system import ImpactSystem
from continuation.control import Settings

__all__ = ["ends_of", "is_half", "is_searched", "work"]

BESIDE = (0.0, 3e-4, -3e-4)
"""Relative distances of the energies that are searched until a search is complete. Near an energy at which a family grazes, neighbouring
starts separate, and a search cannot be complete."""

_MULTIPLIED = max(q for _, q in RESONANCES)
"""Largest q of the resonances that are events of a family."""

_TUPLED = 3
"""Largest cover of the families that are switched to from one without a reversal."""

NEARLY = (1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 1e-5, 1e-6)
"""Relative differences of states and flight times up to which an orbit nearly has a symmetry."""

SMOOTH_STARTS = 192
"""Angles of the second scan of an energy with smooth forces: other energies meet the same families."""

_BEYOND = "what meets the family here lies beyond the bounds"

_OTHER = "what was found next to the event is no family that has its orbit, but"
"""Note of a dead end; the ends and the sequence of the orbit that was found follow."""


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
        return _at_energy(system, float(seed.value), seed.plan, seed.known)
    if seed.kind == "mode":
        return _at_mode(system, seed)
    if seed.kind == "name":
        return _of_name(system, str(seed.value), seed.plan)
    if seed.kind == "grazing":
        return _across_grazing(system, seed)
    return _follow(system, seed)


def _at_energy(system: ImpactSystem, energy: float, plan: BuildPlan, known: Boxes | None = None) -> Answer:
    bounds, ends = plan.bounds, ends_of(system)
    seeds = []
    smooth = system.smooth_forces is not None
    for beside in (energy * (1.0 + place) for place in (BESIDE[:1] if smooth else BESIDE)):
        if not bounds.energy[0] <= beside <= bounds.energy[1]:
            continue
        there = known if beside == energy else None
        found = discover_orbits(
            system, beside, quarter_period=bounds.quarter_period, impacts=bounds.impacts, ends=ends, known=there,
            budget=SMOOTH_STARTS if smooth else None,
        )  # fmt: skip
        # What is found is primitive, and between its own reversals.
        images = [with_canonical_sequence(system, segment_images(orbit.problem, orbit.solution.y)) for orbit in found.orbits]
        seeds += [_seed_of(system, some, plan) for some in images]
        if found.complete:
            break
    return Answer(tuple(seeds), incomplete=() if found.complete else (energy,))


def _of_name(system: ImpactSystem, name: str, plan: BuildPlan) -> Answer:
    from branches.naming.families import resolve
    from branches.naming.matching import AmbiguousName, NameNotFound

    limits = Limits(plan.named.energy, plan.named.quarter_period, plan.named.impacts)
    try:
        found, _ = resolve(name, system, reference_points=plan.reference_points, limits=limits, energy=limits.energy)
    except (NameNotFound, AmbiguousName) as error:
        return Answer((), failed=(str(error),))
    return Answer((_seed(found.problem, found.solution.y, plan)._replace(wide=True, further=1),))


def ends_of(system: ImpactSystem) -> tuple[str, ...]:
    """All pairs of ends between which a system's symmetric orbits are searched."""
    if system.smooth_forces is not None:
        return ("origin-origin",)
    return ("origin-origin", *WITHOUT_ORIGIN) if system.has_odd_symmetry else WITHOUT_ORIGIN


def is_searched(system: ImpactSystem) -> bool:
    """Whether the orbits at an energy can be searched. If not, a build has the families of the linear modes, and those that they meet."""
    if system.smooth_forces is not None:
        return system.degrees_of_freedom == 2 and len(system.stops) < 2 and system.has_odd_symmetry
    return system.degrees_of_freedom == 2 and len(system.stops) == 1


def _at_mode(system: ImpactSystem, source: Seed) -> Answer:
    (index, cover), plan = source.value, source.plan
    if system.smooth_forces is not None:
        return _at_smooth_mode(system, index, plan)
    mode = next(mode for mode in linear_modes(system) if mode.index == index)
    seeds: list[Seed] = []
    failed: list[str] = []
    over = f"{cover} turn{'s' if cover > 1 else ''}"
    low, high = plan.bounds.energy
    # Where energies are not searched, a family that begins outside the bounds is found inside by following it.
    energy = (low, high) if is_searched(system) else (0.0, math.inf)
    try:
        begun = beginnings(mode, cover, plan.bounds.impacts, energy=energy)
    except ValueError as error:  # the mode touches two stops at one instant
        return Answer((), failed=(f"{mode.name}: {error}",) if cover == 1 else ())
    for found in begun:
        assert found.there is not None and found.beside is not None
        if not low <= found.h <= high:
            try:
                seeds += _inside(found.beside, plan)
            except (RuntimeError, NotConverged) as error:
                failed.append(f"{mode.name}, {'-'.join(found.ends)}:{found.sequence}: {error}")
            continue
        link = Link(mode.name, "", "GR", "linear mode", found.h, mode.alpha, ",".join(found.stops), f"{over}: {found.kind}")
        seed = _seed(found.beside.problem, found.beside.y, plan)
        seeds.append(_reached(seed, link, source, found.there.problem, found.there.y))
    return Answer(tuple(seeds), failed=tuple(failed))


def _at_smooth_mode(system: ImpactSystem, index: int, plan: BuildPlan) -> Answer:
    """The family of smooth motion that begins at a linear mode, from its first orbit inside the plan's energies."""
    from branches.naming.at_modes import orbit_at_mode
    from branches.naming.matching import NameNotFound

    # Where it reaches a stop is not known before: it is followed from a low energy.
    low, high = plan.bounds.energy
    try:
        orbit = orbit_at_mode(f"mode:{index + 1}", system, (0.0 if system.stops else low, high))
        if orbit.h < low:
            return Answer(tuple(_inside(SolvedProblem(orbit.problem, orbit.solution.y, orbit.residual), plan)))
    except (NameNotFound, RuntimeError, NotConverged) as error:
        return Answer((), failed=(str(error),))
    if orbit.alpha > plan.bounds.quarter_period:
        return Answer((), beyond=1)
    return Answer((_seed(orbit.problem, orbit.solution.y, plan),))


def _inside(beside: SolvedProblem, plan: BuildPlan) -> list[Seed]:
    """The seed of a family that begins outside the energies of a plan: its first orbit inside, if it comes there."""
    (low, high), problem = plan.bounds.energy, beside.problem
    h = problem.energy(beside.y)
    branch = follow_family(problem, beside.y, energy=(min(low, h), max(high, h)), quarter_period=plan.bounds.quarter_period)
    inside = np.flatnonzero((branch.points["h"] >= low) & (branch.points["h"] <= high))
    if not len(inside):
        return []
    first = int(inside[np.argmin(np.abs(inside - branch.start))])
    return [_seed(problem, branch.unknowns(first), plan)._replace(further=0 if problem.periodic else None)]


def _seed(problem: MultipointProblem, y: np.ndarray, plan: BuildPlan) -> Seed:
    """The seed of the family of an orbit, in its canonical presentation."""
    return _seed_of(problem.system, presentations(problem, y), plan)


def _seed_of(system: ImpactSystem, images: list[Presentation], plan: BuildPlan) -> Seed:
    return Seed("orbit", kept_orbit(system, first_of(images)), plan, images=tuple(images))


def _reached(seed: Seed, link: Link, source: Seed, problem: MultipointProblem, y: np.ndarray) -> Seed:
    """A seed that was reached from another one, where the orbit y is one of both families."""
    plan, image = seed.plan, seed.images[0]
    inside = plan.bounds.holds(alpha=image.quarter_period, impacts=impacts_per_period(image.sequence, image.ends))
    if inside and image.ends != PERIODIC:
        further = None
    elif inside and not source.is_closed:
        # A family without a reversal gives no further ones: nothing bounds their number, because they meet others where they graze.
        further = 0
    else:
        further = -1 if source.further is None else source.further - 1
    there = presented(problem, y, image.ends, image.sequence)
    return seed._replace(link=replace(link, there=there), wide=source.wide and not inside, further=further)


def _follow(system: ImpactSystem, seed: Seed) -> Answer:
    bounds = seed.bounds
    orbit: EventOrbit = seed.value
    problem = MultipointProblem(system, orbit.ends, parse_sequence(orbit.sequence))
    y = unknowns_of(problem, orbit)
    try:
        branch = _followed(problem, y, bounds.energy, bounds.quarter_period)
        wider = branch.full_family.reach(bounds.energy, bounds.quarter_period)
        if wider is not None:
            branch = _followed(problem, y, *wider)
            branch = cut_branch(branch, bounds.energy, outermost=True) or branch
    except (RuntimeError, NotConverged) as error:
        return Answer((), failed=(f"{'-'.join(orbit.ends)}:{orbit.sequence}: {error}",))
    seeds: list[Seed] = []
    ends: list[Link] = []
    lost: list[str] = []
    beyond = 0
    for event in branch.events:
        if not bounds.energy[0] <= event.h <= bounds.energy[1]:
            continue
        if event.type == "GR":
            seeds.append(_grazing(branch, event, seed))
            continue
        if event.type in TYPES:
            times = {"PD": 2, "RT": event.p_q[1] if event.p_q else 1}.get(event.type, 1)
            if not bounds.holds(alpha=times * event.alpha, impacts=times * impacts_per_period(branch.problem.sequence, branch.ends)):
                beyond += 1
                continue
            some, over, dead = _across_bifurcation(branch, event, seed)
        else:
            continue
        seeds += some
        ends += dead
        beyond += over
        lost += [f"{link.source}: {link.event} at h = {link.h:.10g}: {link.note}" for link in dead]
        if over and not some and not dead:
            ends.append(_end(branch, event, _BEYOND))
    halves, failed = _ends_cut(branch)
    missed = tuple(f"{branch.id}: {found.text}" for found in missed_events(branch) if not found.hidden)
    kept = branch.only_columns(COMPARED)  # all are packed
    return Answer(tuple(seeds), kept, pack_family(branch), tuple(ends), beyond, failed, halves, tuple(lost), missed=missed)


def _ends_cut(branch: Branch) -> tuple[int, tuple[str, ...]]:
    """Whether an end is cut because the family continues there as its own image (1 or 0), and texts about its other cut ends."""
    cut = [i for i, end in enumerate(branch.ended) if end.reason not in ("EVENT", "CLOSED", "IMAGE", "REPEATED")]
    failed = [i for i in cut if not is_half(branch, i)]
    reasons = tuple(f"{branch.id}: {branch.ended[i].reason}: {branch.ended[i].text}" for i in failed)
    return int(len(failed) < len(cut)), reasons


def is_half(branch: Branch, end: int) -> bool:
    """Whether a branch that ends at `end` (0 or 1) with refused steps has an orbit of higher symmetry next to this end.

    Such an orbit is a branch point, where the family meets one of higher symmetry. The symmetry exchanges the two sides of the family,
    so the other side is the image of this branch.
    """
    last = len(branch) - 1
    place, inside = (0, last) if end == 0 else (last, 0)
    length = branch.points["arclength"]
    middle = int(np.argmin(np.abs(length - 0.5 * (length[place] + length[inside]))))
    there, own = (cycle_of(branch.problem, branch.unknowns(i)) for i in (place, middle))
    return any(symmetries(there, nearly).order > symmetries(own, nearly).order for nearly in NEARLY)


def _followed(problem: MultipointProblem, y: np.ndarray, energy: tuple[float, float], quarter_period: float) -> Branch:
    """The family of an orbit in both directions. If steps jump to another family at a branch point, it is followed again with finer steps.
    `digit_work` counts all runs."""
    work = DigitWork()

    def follow(start: np.ndarray, settings: Settings) -> Course[Branch]:
        nonlocal work
        branch = follow_family(problem, start, energy=energy, quarter_period=quarter_period, settings=settings)
        work += branch.digit_work
        return Course(branch, branch.points["arclength"], branch.unknowns, any(end.reason == "MINIMUM_STEP" for end in branch.ended))

    branch = longest_course(problem, follow, y, SETTINGS).result
    return replace(branch, digit_work=work)


def _grazing(branch: Branch, event: BranchEvent, source: Seed) -> Seed:
    """The seed of a grazing orbit that a family ends at."""
    here = orbit_of_event(branch, event)
    mark = touching(branch.problem, branch.unknowns(event.point)).mark()
    link = Link(branch.id, event.id, "GR", "", event.h, event.alpha, event.stop, here=here)
    return source._replace(kind="grazing", value=Grazing(here, leaves_upward(branch, event.point), mark), link=link, images=())


def _across_grazing(system: ImpactSystem, source: Seed) -> Answer:
    """The families that meet at a grazing orbit: seeds, how many are outside the limits, and dead ends."""
    seeds, dead, beyond = [], [], 0
    template, orbit = source.link, source.value.orbit
    assert template is not None
    problem = MultipointProblem(system, orbit.ends, parse_sequence(orbit.sequence))

    def accept(alpha: float, choice: Candidate) -> bool:
        nonlocal beyond
        inside = source.bounds.holds(alpha=alpha, impacts=choice.impacts)
        beyond += not inside
        return inside

    found = meetings_at(problem, unknowns_of(problem, orbit), source.value.rising, accept=accept, energy=source.bounds.energy)
    for item in found:
        link = replace(template, kind=item.kind, note=item.reason or None)
        if item.beside is not None:
            assert item.there is not None
            seed = _seed(item.beside.problem, item.beside.y, source.plan)
            seeds.append(_reached(seed, link, source, item.there.problem, item.there.y))
        elif item.kind == "linear mode":
            dead.append(replace(link, target=item.label or None))
        elif item.kind != "dead end":
            beyond += 1
    if not seeds and not dead:
        reasons = "; ".join(dict.fromkeys(item.reason for item in found if item.reason)) or "no other sequence fits"
        dead.append(replace(template, kind="dead end", note=_BEYOND if beyond else reasons))
    return Answer(tuple(seeds), ends=tuple(dead), beyond=beyond)


def _end(branch: Branch, event: BranchEvent, note: str | None) -> Link:
    """The dead end of a family at an event without a neighbour; the note says why."""
    here, width = orbit_of_event(branch, event), event.bracket[1] - event.bracket[0]
    return Link(branch.id, event.id, event.type, "dead end", event.h, event.alpha, None, note, here=here, width=width)


def _across_bifurcation(branch: Branch, event: BranchEvent, source: Seed) -> tuple[list[Seed], int, list[Link]]:
    """The families that emanate from a bifurcation, or cross there."""
    link = replace(_end(branch, event, event.note), kind="switch")
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", RuntimeWarning)
            found = emanating_families(branch, event)
    except (RuntimeError, ValueError) as error:
        return [], 0, [replace(link, kind="dead end", note=str(error))]
    seeds, beyond = [], 0
    dead = [replace(link, kind="dead end", note=str(warning.message)) for warning in caught]
    for family in found:
        seed = _seed(family.problem, family.step.y, source.plan)
        image = seed.images[0]
        if not source.bounds.holds(alpha=image.quarter_period, impacts=impacts_per_period(image.sequence, image.ends)):
            beyond += 1
            continue
        seed = _reached(seed, link, source, branch.problem, branch.unknowns(event.point))
        assert seed.link is not None
        if 0 < family.cover <= (_TUPLED if family.problem.periodic else _MULTIPLIED):
            # The family that is crossed has more symmetry, or is of a multiple cover. Its own event there has the edge.
            seeds.append(seed._replace(link=None))
        elif seed.link.there is None:
            # The corrector fell onto another family that is near: it is followed, but does not emanate here.
            dead.append(replace(link, kind="dead end", note=f"{_OTHER} {'-'.join(image.ends)}:{''.join(image.sequence)}"))
            seeds.append(seed._replace(link=None))
        else:
            seeds.append(seed)
    return seeds, beyond, dead
