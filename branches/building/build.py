"""Building a catalogue: follow each orbit found and look for the neighbours of each family, until nothing new is found.

Seeds are taken in the order in which they were found, for any number of workers. The result of a seed and the seeds that it gives are
kept in one transaction. So a build that was interrupted continues where it was.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Hashable, Iterable
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.building.frontier import Frontier
from branches.building.plan import Answer, BuildPlan, KnownGrazings, Link, Seed, energies_of, open_ranges, plain_seed, read_seed
from branches.building.work import work
from branches.catalogue.database import CatalogueError, readable
from branches.catalogue.members import FamilyPlace, KnownFamilies, distance_from_orbit, event_orbit, orbit_of_event, unknowns_of
from branches.catalogue.rows import Edge, EventOrbit, FamilyRow, Node
from branches.events import DigitWork
from branches.identity import canonical_orbit
from branches.linear_modes import linear_modes
from branches.presentation import presentations
from branches.sequences import impacts_per_period, parse_sequence
from bvp.multipoint import MultipointProblem

if TYPE_CHECKING:
    from branches.branch import Branch
    from branches.catalogue.catalogue import Catalogue
    from branches.presentation import Presentation

__all__ = ["Progress", "build", "refuse_other_plan"]

FEWEST, LEVELS = 3, 8
"""Levels at least and at most."""

AHEAD = 6
"""Seeds that are worked on or wait for a worker, for each worker."""

_SAME = 1e-8
"""Relative difference of the energies of one event on two families."""

_RANGE = 1e-6
"""Relative tolerance for the ends of a family that was followed twice."""

_UNFOLDED = "unfolded "

_COUNTED_LATER = ("digits", "missed")

_NOT_FOLLOWED = "only families without a reversal meet this one here, and they meet none with one: they are not followed"

_LOST = "the family that is born here cannot be distinguished from this one: next to the event their difference is lost in rounding"


@dataclass(frozen=True)
class Progress:
    """The progress of a build: families kept, seeds queued, points, events, and the number of the level of energies."""

    families: int
    queued: int
    points: int
    events: int
    level: int


def build(
    catalogue: Catalogue,
    plan: BuildPlan,
    executor: Executor,
    workers: int = 2,
    on_progress: Callable[[Progress], object] | None = None,
) -> dict[str, Any]:
    """Find and follow every family of a plan, and keep them in a catalogue.

    Parameters
    ----------
    catalogue : Catalogue
        Opened for writing. If it contains an earlier build with the same plan, this one continues that build. Families that were saved
        one by one are followed again within the plan's limits. A saved family without an orbit inside the limits is refused.
    plan : BuildPlan
    executor : concurrent.futures.Executor
        Where the work is done.
    workers : int
        Number of workers of the executor. The result does not depend on it.
    on_progress : callable, optional

    Returns
    -------
    dict
        ``families``, ``points``, ``events``, ``edges``, ``levels`` (energies searched and families new at each), ``complete`` (whether
        the last level found nothing new, and no range of energies is open), ``open`` (ranges (low, high) without a complete search: see
        `branches.building.plan.open_ranges`), ``incomplete`` (energies at which a search is not complete), ``beyond`` (neighbours outside
        the bounds), ``halves`` (families of which one side of a branch point was followed, the other being its image), ``lost``
        (bifurcations at which no new family was found), ``digits`` (``orbits`` solved in fifty digits to decide their stability,
        and the ``seconds`` that it took), ``missed`` (events that a family needs and does not have), ``failed`` (work that
        failed); all as texts.

    Raises
    ------
    CatalogueError
        For a catalogue that was built with another plan, or that holds a saved family outside the limits.
    """
    return _Build(catalogue, plan, executor, workers, on_progress).run()


def refuse_other_plan(catalogue: Catalogue, plan: BuildPlan) -> bool:
    """Whether a build of this plan was begun in a catalogue.

    Raises
    ------
    CatalogueError
        Where one of another plan was.
    """
    earlier = catalogue.progress("plan")
    if earlier is None:
        return False
    if earlier != json.loads(json.dumps(plan.plain())):
        with readable(catalogue.path, "the plan of its build"):
            there = _in_words(earlier)
        received = _in_words(plan.plain())
        raise CatalogueError(f"{catalogue.path} was built for {there}; received {received}; expected the same, or another file")
    return True


class _Build:
    def __init__(
        self,
        catalogue: Catalogue,
        plan: BuildPlan,
        executor: Executor,
        workers: int,
        on_progress: Callable[[Progress], object] | None,
    ) -> None:
        self.catalogue = catalogue
        self.plan = plan
        self.system = catalogue.system
        self.on_progress = on_progress
        self.known = KnownFamilies()
        self.grazings = KnownGrazings()
        self.joins: dict[tuple[str, bool], list[tuple[str, float, EventOrbit]]] = {}
        self.problems: dict[tuple[Any, ...], MultipointProblem] = {}
        self.places: dict[str, tuple[int, FamilyPlace | None]] = {}
        self.images: dict[str, tuple[Presentation, ...]] = {}
        self.last: list[tuple[str, Seed]] = []
        self.points = self.events = 0
        begun = {"level": -1, "families": 0}
        self.report: dict[str, Any] = {
            "beyond": 0, "failed": [], "halves": 0, "lost": [], "incomplete": [], "levels": [], "begun": begun,
            "digits": DigitWork()._asdict(), "missed": [],
        }  # fmt: skip
        description = json.dumps(self.system.describe(), sort_keys=True)
        self.frontier: Frontier[tuple[str, Seed], Answer] = Frontier(
            executor, partial(_named, description), self._is_known, lambda item: item[0], AHEAD * workers, _kin
        )
        self.count = 0

    def run(self) -> dict[str, Any]:
        """Search at each level of energies until one adds no family."""
        if not self._take_up():
            self._begin()
        levels = self.report["levels"]
        for level in range(len(levels), LEVELS):
            if level >= FEWEST and not levels[-1]["new"]:
                break
            energies = energies_of(level, self.plan.bounds.energy)
            if self.report["begun"]["level"] != level:
                with self.catalogue.transaction():
                    self.report["begun"] = {"level": level, "families": len(self.known)}
                    self._note()
                    self._queue(("energy", energy) for energy in energies)
            self._empty(level)
            levels.append({"energies": len(energies), "new": len(self.known) - self.report["begun"]["families"]})
            self._note()
        self._connect_last()
        still_open = open_ranges(len(levels), self.plan.bounds.energy, self.report["incomplete"])
        report = {name: value for name, value in self.report.items() if name != "begun"}
        report = {
            "families": len(self.known), "points": self.points, "events": self.events, "edges": len(self.catalogue.edges()),
            "complete": levels[-1]["new"] == 0 and not still_open, "open": still_open, **report,
        }  # fmt: skip
        self.catalogue.note("built", report)
        return report

    # -- where it starts ------------------------------------------------------------------------------------------------------

    def _begin(self) -> None:
        """The first seeds: names, linear modes, and families that were saved before."""
        plan = self.plan
        with self.catalogue.transaction():
            self.catalogue.note("plan", plan.plain())
            self._note()
            saved = [self._saved(self.catalogue.branch(row.id)) for row in self.catalogue.families()]
            for row in self.catalogue.families():
                self.catalogue.remove(row.id)
            modes = linear_modes(self.system)
            for mode in modes:
                if mode.label:
                    self.catalogue.add_node(Node(mode.label, "linear mode", mode.label, mode.energies, mode.alpha))
            covers = [
                (mode.index, cover)
                for mode in modes
                for cover in range(1, math.floor(plan.bounds.quarter_period / mode.alpha * (1.0 + 1e-12)) + 1)
            ]
            self._queue([("name", name) for name in plan.names] + [("mode", value) for value in covers])
            self._extend(saved)

    def _saved(self, branch: Branch) -> Seed:
        """The seed of a family that was saved: from its orbit inside the plan's limits that is nearest to the one it was started from."""
        plan, h, alpha = self.plan, branch.points["h"], branch.points["alpha"]
        impacts = impacts_per_period(branch.problem.sequence, branch.ends)
        for bounds, wide, further in ((plan.bounds, False, None), (plan.named, True, 0)):
            low, high = bounds.energy
            inside = [i for i in range(len(h)) if low <= h[i] <= high and bounds.holds(alpha=float(alpha[i]), impacts=impacts)]
            if inside:
                place = min(inside, key=lambda i: abs(i - branch.start))
                orbit = event_orbit(*canonical_orbit(branch.problem, branch.unknowns(place)))
                return Seed("orbit", orbit, plan, wide, further)
        raise CatalogueError(
            f"{self.catalogue.path} holds the family {branch.id}, h {h.min():.6g}:{h.max():.6g}, quarter period from {alpha.min():.6g}, "
            f"{impacts / 2:g} impacts in half a period, which a build for {_in_words(plan.plain())} would lose; "
            "expected wider limits, or another file"
        )

    def _take_up(self) -> bool:
        """Continue the build of an earlier run; False if there is none."""
        if not refuse_other_plan(self.catalogue, self.plan):
            return False
        with readable(self.catalogue.path, "what its build has come to"):
            noted = self.catalogue.progress("report")
            # An older version did not count everything: its report lacks those entries.
            full = {name: value for name, value in self.report.items() if name in _COUNTED_LATER} | noted
            if {name: type(value) for name, value in full.items()} != {name: type(value) for name, value in self.report.items()}:
                raise TypeError
            self.report = full
        for row in self.catalogue.families():
            self._remember(row.id, self.catalogue.branch(row.id))
        with readable(self.catalogue.path, "what its build has unfolded"):
            for mark, wide, further in self.catalogue.notes(_UNFOLDED):
                self.grazings.add(None if mark is None else tuple(mark), (wide, further))
        with readable(self.catalogue.path, "the work that its build has left"):
            pending = [(key, read_seed(value, self.plan)) for key, value in self.catalogue.work()]
            self.count = 1 + max((int(key) for key, _ in pending), default=-1)
        self.last = [(key, seed) for key, seed in pending if _is_last(seed)]
        self.frontier.extend((key, seed) for key, seed in pending if not _is_last(seed))
        return True

    # -- the queue ------------------------------------------------------------------------------------------------------------

    def _queue(self, found: Iterable[tuple[str, Any]]) -> None:
        with self.catalogue.transaction():
            self._extend(Seed(kind, value, self.plan) for kind, value in found)

    def _extend(self, seeds: Iterable[Seed]) -> None:
        """Connect each seed of a known family to it, and queue the other seeds."""
        named = []
        for seed in seeds:
            place = self.known.place(self.system, seed.images) if seed.images else None
            if place is not None:
                self._connect(seed.link, place.id)
                continue
            name = f"{self.count:07d}"
            self.count += 1
            named.append((name, seed))
            if seed.images:
                self.places[name] = (self.known.count(seed.images), None)
        self.catalogue.add_work((name, plain_seed(seed)) for name, seed in named)
        self.frontier.extend(item for item in named if not _is_last(item[1]))
        self.last += [item for item in named if _is_last(item[1])]

    def _empty(self, level: int) -> None:
        for (name, seed), answer in self.frontier:
            with self.catalogue.transaction():
                self._take(name, seed, answer)
                self.catalogue.finish(name)
            if self.on_progress is not None:
                self.on_progress(Progress(len(self.known), len(self.frontier), self.points, self.events, level))

    def _connect_last(self) -> None:
        """Connect the seeds that are not followed to the families known at the end. A grazing without a neighbour gets a dead end."""
        with self.catalogue.transaction():
            unknown: dict[tuple[str, str], Link] = {}
            for name, seed in self.last:
                place = self.known.place(self.system, self._images(name, seed))
                if place is None:
                    self.report["beyond"] += 1
                    if seed.link is not None:
                        unknown[seed.link.source, seed.link.event] = seed.link
                else:
                    self._connect(seed.link, place.id)
                self.catalogue.finish(name)
            for (source, event), link in unknown.items():
                edges = self.catalogue.edges(source)
                if not any((source, event) in ((edge.source, edge.source_event), (edge.target, edge.target_event)) for edge in edges):
                    self._connect(replace(link, kind="dead end", note=_NOT_FOLLOWED, there=None), None)
            self.last = []
            self._note()

    def _note(self) -> None:
        self.catalogue.note("report", self.report)

    def _count(self, **more: Any) -> None:
        """Add numbers and list items to the entries of the report."""
        if any(more.values()):
            for name, value in more.items():
                self.report[name] += value
            self._note()

    # -- one seed -------------------------------------------------------------------------------------------------------------

    def _is_known(self, item: tuple[str, Seed]) -> bool:
        name, seed = item
        if seed.kind == "grazing":
            return self.grazings.has(seed.value.mark, _asked(seed))
        if seed.kind != "orbit":
            return False
        count, place = self.places.get(name, (0, None))
        images = self._images(name, seed)
        if place is None and count < self.known.count(images):
            place = self.known.place(self.system, images, count)
            self.places[name] = (self.known.count(images), place)
        return place is not None

    def _images(self, name: str, seed: Seed) -> tuple[Presentation, ...]:
        if seed.images:
            return seed.images
        if name not in self.images:  # The build continues an earlier run, which did not store the images.
            self.images[name] = tuple(presentations(*self._solved(seed.value)))
        return self.images[name]

    def _solved(self, orbit: EventOrbit) -> tuple[MultipointProblem, np.ndarray]:
        key = (orbit.ends, orbit.sequence)
        if key not in self.problems:
            self.problems[key] = MultipointProblem(self.system, orbit.ends, parse_sequence(orbit.sequence))
        return self.problems[key], unknowns_of(self.problems[key], orbit)

    def _take(self, name: str, seed: Seed, answer: Answer | None) -> None:
        """Store the result of one seed: add or connect its family, queue the seeds found, and count failures.

        `answer` is None if the seed was not followed because its family or its grazing was already known."""
        _, place = self.places.pop(name, (0, None))
        self.images.pop(name, None)
        if seed.kind == "grazing":
            if answer is None:
                return
            self.grazings.add(seed.value.mark, _asked(seed))
            self.catalogue.note(f"{_UNFOLDED}{name}", [seed.value.mark, *_asked(seed)])
        elif answer is None:
            assert place is not None
            self._connect(seed.link, place.id)
            return
        self._count(**{key: getattr(answer, key) for key in ("beyond", "failed", "halves", "lost", "incomplete")})
        if answer.branch is not None and answer.branch.digit_work.orbits:
            self.report["digits"] = (DigitWork(**self.report["digits"]) + answer.branch.digit_work)._asdict()
            self._note()
        if answer.branch is not None and answer.packed is not None:
            id = next((id for id in answer.branch.full_family.ids if id in self.catalogue), None)
            if id is not None:
                # Near a branch point two families are too close: only following the orbit shows which one it belongs to.
                if not self._covers(self.catalogue.family(id), answer.branch, seed):
                    at = float(answer.branch.points["h"][answer.branch.start])
                    self._count(failed=[f"{id}: a piece of it, followed from h = {at:.10g}, is not kept"])
            else:
                id = self.catalogue.add(answer.packed)
                self._remember(id, answer.branch)
                self._count(missed=answer.missed)
                for link in answer.ends:
                    self._connect(link, link.target)
                self._extend(answer.seeds)
            reached = seed.link
            if reached is not None and reached.source == id and reached.kind == "switch":
                # The corrector converged to the family that the seed came from.
                self._connect(replace(reached, kind="dead end", note=_LOST), None)
                self._count(lost=[f"{id}: {reached.event} at h = {reached.h:.10g}: {_LOST}"])
            else:
                self._connect(reached, id)
        else:
            for link in answer.ends:
                self._connect(link, link.target)
            self._extend(answer.seeds)

    def _covers(self, row: FamilyRow, branch: Branch, seed: Seed) -> bool:
        """Whether a kept family covers the energies and quarter periods of another branch of it, within the bounds."""
        bounds, h, alpha = seed.bounds, branch.points["h"], branch.points["alpha"]
        inside = (h >= bounds.energy[0]) & (h <= bounds.energy[1]) & (alpha <= bounds.quarter_period)
        return not inside.any() or all(
            kept[0] * (1.0 - _RANGE) <= values[inside].min() and values[inside].max() <= kept[1] * (1.0 + _RANGE)
            for kept, values in ((row.h, h), (row.alpha, alpha))
        )

    def _remember(self, id: str, branch: Branch) -> None:
        self.known.add(id, branch)
        for grazing, types in ((True, ("GR",)), (False, ("BP", "SB"))):
            met = [event for event in branch.events if event.type in types]
            self.joins[id, grazing] = [(event.id, event.h, orbit_of_event(branch, event)) for event in met]
        self.points += len(branch)
        self.events += len(branch.events)

    def _connect(self, link: Link | None, target: str | None) -> None:
        if link is None:
            return
        if link.kind == "linear mode" and any(edge.source == target for edge in self.catalogue.edges(link.source)):
            return  # the edge from the mode is there, and says more
        self.catalogue.connect(
            Edge(
                link.source, link.event, link.type, link.kind, target, link.h, link.alpha, self._event_there(link, target or ""), link.stop,
                link.note, link.here, link.there,
            )  # fmt: skip
        )

    def _event_there(self, link: Link, target: str) -> str:
        """Id of the target's event at the meeting with the source; "" if it has none."""
        slack = max(_SAME, link.width)
        same = [(id, orbit) for id, h, orbit in self.joins.get((target, link.type == "GR"), ()) if abs(h / link.h - 1.0) < slack]
        if len(same) < 2 or link.there is None:
            return same[0][0] if same else ""
        # Two families can meet more than once at one energy. An orbit and its image are equal for this purpose: the first will do.
        problem, y = self._solved(link.there)
        apart = [distance_from_orbit(problem, y, np.array(orbit.start)) for _, orbit in same]
        return next(id for (id, _), far in zip(same, apart, strict=True) if far < 10.0 * max(min(apart), _SAME))


def _named(description: str, item: tuple[str, Seed]) -> Answer:
    return work(description, item[1])


def _kin(item: tuple[str, Seed]) -> Hashable:
    """What seeds that may be of one family, or of one grazing orbit, have in common."""
    seed = item[1]
    if seed.kind == "grazing":
        return None if seed.value.mark is None else ("grazing", *(f"{number:.6e}" for number in seed.value.mark))
    return (seed.images[0].ends, seed.images[0].sequence) if seed.images else None


def _asked(seed: Seed) -> tuple[bool, int]:
    """In which limits a grazing orbit is unfolded, and how many generations of families without a reversal may come of it."""
    return seed.wide, (seed.further or 0) if seed.is_closed else seed.plan.generations + 1


def _is_last(seed: Seed) -> bool:
    """Whether a seed is only connected, in the end."""
    return seed.further is not None and seed.further < 0


def _in_words(plan: dict[str, Any]) -> str:
    bounds = plan["bounds"]
    low, high = bounds["energy"]
    within = f"h {low:g}:{high:g}, quarter period up to {bounds['quarter_period']:g}, up to {bounds['impacts']} impacts"
    return f"{within}, {len(plan['names'])} names"
