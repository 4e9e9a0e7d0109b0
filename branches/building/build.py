"""Building a catalogue: follow each orbit found and look for the neighbours of each family, until nothing new is found.

Seeds are taken in the order in which they were found, for any number of workers. The result of a seed and the seeds that it gives are
kept in one transaction. So a build that was interrupted continues where it was.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Hashable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property, partial
from operator import attrgetter
from typing import Any

import numpy as np

from branches.branch import Branch
from branches.building.frontier import Frontier
from branches.building.plan import (
    Answer,
    BuildPlan,
    KnownGrazings,
    Link,
    Seed,
    level_energies,
    open_ranges,
    plain_seed,
    read_seed,
    refuse_other_plan,
    saved_seed,
)
from branches.building.work import is_searched, work
from branches.catalogue.catalogue import Catalogue
from branches.catalogue.database import readable
from branches.catalogue.members import FamilyPlace, KnownFamilies, distances_from_orbit, orbit_of_event, unknowns_of
from branches.catalogue.rows import Edge, EventOrbit, FamilyRow, Node
from branches.events import DigitWork
from branches.linear_modes import MOST_COVERS, linear_modes
from branches.presentation import Presentation, presentations
from branches.sequences import parse_sequence
from bvp.multipoint import MultipointProblem
from bvp.resting import has_constant_force

__all__ = ["Progress", "build"]

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


@dataclass
class _Piece:
    """A seed in the queue, with its key in the catalogue's table of work.

    place : where its orbit is on a known family. unfolded : whether its grazing orbit is a known one. tested : how many families with its
    ends and sequence, or how many grazing orbits, were tested for that.
    """

    key: str
    seed: Seed
    images: tuple[Presentation, ...] = ()
    tested: int = 0
    place: FamilyPlace | None = None
    unfolded: bool = False

    @property
    def is_last(self) -> bool:
        """Whether it is only connected, in the end."""
        return self.seed.further is not None and self.seed.further < 0

    @property
    def kin(self) -> Hashable:
        """What pieces that may be of one family, or of one grazing orbit, have in common."""
        if self.seed.kind == "grazing":
            return self._rounded_mark
        return (self.images[0].ends, self.images[0].sequence) if self.images else None

    @cached_property
    def _rounded_mark(self) -> Hashable:
        mark = self.seed.value.mark
        return None if mark is None else ("grazing", *(f"{number:.6e}" for number in mark))


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


@dataclass
class _Build:
    catalogue: Catalogue
    plan: BuildPlan
    executor: Executor
    workers: int
    on_progress: Callable[[Progress], object] | None

    def __post_init__(self) -> None:
        self.system = self.catalogue.system
        self.known = KnownFamilies()
        self.grazings = KnownGrazings()
        self.joins: dict[tuple[str, bool], list[tuple[str, float, EventOrbit]]] = {}
        self.last: list[_Piece] = []
        self.points = self.events = 0
        self.report: dict[str, Any] = {
            "beyond": 0, "failed": [], "halves": 0, "lost": [], "incomplete": [], "levels": [],
            "begun": {"level": -1, "families": 0}, "digits": DigitWork()._asdict(), "missed": [],
        }  # fmt: skip
        description = json.dumps(self.system.describe(), sort_keys=True)
        self.frontier: Frontier[_Piece, Answer] = Frontier(
            self.executor, partial(work, description), self._is_known, AHEAD * self.workers, attrgetter("kin"), self._handed
        )
        self.count = 0

    def run(self) -> dict[str, Any]:
        """Search at each level of energies until one adds no family. Where energies are not searched, there is one level, without any."""
        if not self._take_up():
            self._begin()
        levels, searched = self.report["levels"], is_searched(self.system)
        for level in range(len(levels), LEVELS if searched else 1):
            if level >= FEWEST and not levels[-1]["new"]:
                break
            energies = level_energies(level, self.plan.bounds.energy) if searched else []
            if self.report["begun"]["level"] != level:
                with self.catalogue.transaction():
                    self.report["begun"] = {"level": level, "families": len(self.known)}
                    self._note()
                    self._extend(Seed("energy", energy, self.plan) for energy in energies)
            self._empty(level)
            levels.append({"energies": len(energies), "new": len(self.known) - self.report["begun"]["families"]})
            self._note()
        self._connect_last()
        bounds = self.plan.bounds.energy
        still_open = open_ranges(len(levels), bounds, self.report["incomplete"]) if searched else [bounds]
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
            saved = [saved_seed(self.catalogue, self.catalogue.branch(row.id), plan) for row in self.catalogue.families()]
            for row in self.catalogue.families():
                self.catalogue.remove(row.id)
            modes = linear_modes(self.system)
            for mode in modes:
                self.catalogue.add_node(Node(mode.name, "linear mode", mode.name, mode.energies, mode.alpha))
            most = [min(MOST_COVERS, math.floor(plan.bounds.quarter_period / mode.alpha * (1.0 + 1e-12))) for mode in modes]
            covers = [(mode.index, cover) for mode, last in zip(modes, most, strict=True) for cover in range(1, last + 1)]
            if self.system.smooth_forces is not None:
                covers = [(k, 1) for k, frequency in enumerate(self.system.modes.frequencies) if frequency > 0.0]
                if self.system.why_not_inside() is not None:  # no mode, but motion from rest on a stop in one degree of freedom
                    covers = [(0, 1)] if self.system.degrees_of_freedom == 1 and has_constant_force(self.system) else []
            self._extend([Seed("name", name, plan) for name in plan.names] + [Seed("mode", cover, plan) for cover in covers] + saved)

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
        self._wait([_Piece(key, seed) for key, seed in pending])
        return True

    # -- the queue ------------------------------------------------------------------------------------------------------------

    def _extend(self, seeds: Iterable[Seed]) -> None:
        """Connect each seed of a known family to it, and queue the other seeds."""
        new = []
        for seed in seeds:
            place = self.known.place(self.system, seed.images) if seed.images else None
            if place is not None:
                self._connect(seed.link, place.id)
                continue
            new.append(_Piece(f"{self.count:07d}", seed, seed.images, self.known.count(seed.images) if seed.images else 0))
            self.count += 1
        self.catalogue.add_work((piece.key, plain_seed(piece.seed)) for piece in new)
        self._wait(new)

    def _wait(self, pieces: Sequence[_Piece]) -> None:
        self.last += [piece for piece in pieces if piece.is_last]
        self.frontier.extend(piece for piece in pieces if not piece.is_last)

    def _empty(self, level: int) -> None:
        for piece, answer in self.frontier:
            with self.catalogue.transaction():
                self._take(piece, answer)
                self.catalogue.finish(piece.key)
            if self.on_progress is not None:
                self.on_progress(Progress(len(self.known), len(self.frontier), self.points, self.events, level))

    def _connect_last(self) -> None:
        """Connect the seeds that are not followed to the families known at the end. A grazing without a neighbour gets a dead end."""
        with self.catalogue.transaction():
            unknown: dict[tuple[str, str], Link] = {}
            for piece in self.last:
                link, place = piece.seed.link, self.known.place(self.system, self._images(piece))
                if place is not None:
                    self._connect(link, place.id)
                else:
                    self.report["beyond"] += 1
                    if link is not None:
                        unknown[link.source, link.event] = link
                self.catalogue.finish(piece.key)
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

    def _is_known(self, piece: _Piece) -> bool:
        seed = piece.seed
        if seed.kind == "grazing":
            if not piece.unfolded and piece.tested < len(self.grazings):
                piece.unfolded = self.grazings.has(seed.value.mark, seed.unfolded_within)
                piece.tested = len(self.grazings)
            return piece.unfolded
        if seed.kind != "orbit":
            return False
        count = self.known.count(self._images(piece))
        if piece.place is None and piece.tested < count:
            piece.place = self.known.place(self.system, piece.images, piece.tested)
            piece.tested = count
        return piece.place is not None

    def _handed(self, piece: _Piece) -> Seed:
        """What a worker is given of a piece. To a search, the known families at its energy are no news."""
        seed = piece.seed
        if seed.kind == "energy":
            return seed._replace(known=self.known.boxes_at(float(seed.value)))
        return seed

    def _images(self, piece: _Piece) -> tuple[Presentation, ...]:
        if not piece.images:  # The build continues an earlier run, which did not store the images.
            piece.images = tuple(presentations(*self._solved(piece.seed.value)))
        return piece.images

    def _solved(self, orbit: EventOrbit) -> tuple[MultipointProblem, np.ndarray]:
        problem = MultipointProblem(self.system, orbit.ends, parse_sequence(orbit.sequence))
        return problem, unknowns_of(problem, orbit)

    def _take(self, piece: _Piece, answer: Answer | None) -> None:
        """Store the result of one seed. `answer` is None if the seed was not followed because its family or grazing was already known."""
        seed = piece.seed
        if answer is None:
            if piece.place is not None:
                self._connect(seed.link, piece.place.id)
            return
        if seed.kind == "grazing":
            self.grazings.add(seed.value.mark, seed.unfolded_within)
            self.catalogue.note(f"{_UNFOLDED}{piece.key}", [seed.value.mark, *seed.unfolded_within])
        self._count(**{key: getattr(answer, key) for key in ("beyond", "failed", "halves", "lost", "incomplete")})
        if answer.branch is None:
            self._continue_from(answer)
        else:
            self._join(seed.link, self._keep(seed, answer, answer.branch))

    def _continue_from(self, answer: Answer) -> None:
        """Connect the ends that an answer found, and queue its seeds."""
        for link in answer.ends:
            self._connect(link, link.target)
        self._extend(answer.seeds)

    def _keep(self, seed: Seed, answer: Answer, branch: Branch) -> str:
        """Add the family that was followed, if it is new; its id."""
        if branch.digit_work.orbits:
            self.report["digits"] = (DigitWork(**self.report["digits"]) + branch.digit_work)._asdict()
            self._note()
        for id in branch.full_family.ids:
            if id in self.catalogue:
                # Near a branch point two families are too close: only following the orbit shows which one it belongs to.
                if not self._covers(self.catalogue.family(id), branch, seed):
                    at = float(branch.points["h"][branch.start])
                    self._count(failed=[f"{id}: a piece of it, followed from h = {at:.10g}, is not kept"])
                return id
        assert answer.packed is not None
        id = self.catalogue.add(answer.packed)
        self._remember(id, branch)
        self._count(missed=answer.missed)
        self._continue_from(answer)
        return id

    def _join(self, link: Link | None, id: str) -> None:
        """Connect the link of a seed to the family that was followed from it."""
        if link is not None and link.source == id and link.kind == "switch":
            # The corrector converged to the family that the seed came from.
            self._connect(replace(link, kind="dead end", note=_LOST), None)
            self._count(lost=[f"{id}: {link.event} at h = {link.h:.10g}: {_LOST}"])
        else:
            self._connect(link, id)

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
        apart = distances_from_orbit(problem, y, [np.array(orbit.start) for _, orbit in same])
        return next(id for (id, _), far in zip(same, apart, strict=True) if far < 10.0 * max(min(apart), _SAME))


