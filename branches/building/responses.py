"""Building a catalogue of forced responses: follow the families that begin at the events of others, up to a number of events away.

The queue is that of a build of conservative families (`branches.building.frontier`): results are taken in order, for any number of workers.
The result of a seed and the seeds that it gives are kept in one transaction, so that an interrupted build goes on where it was.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np

from branches.building.frontier import Frontier
from branches.building.plan import Link, plain_link, read_link
from branches.catalogue.catalogue import Catalogue
from branches.catalogue.database import CatalogueError, readable
from branches.catalogue.packing import PackedFamily
from branches.catalogue.responses import kept_as, orbit_of, pack_response, problem_at
from branches.catalogue.rows import Edge, FamilyRow
from branches.files import one_line
from branches.forced.branch import ForcedBranch, ForcedEvent
from branches.forced.family import ForcedFamily
from branches.forced.identity import impact_flux, invariants
from branches.forced.known import events_at, has_orbit
from branches.forced.primitive import primitive_orbit
from branches.forced.record import problem_from, problem_record
from branches.forced.tracing import SWITCHES, follow_response, primitive_branch, switch_response
from bvp.contact_sequence import joined_sequence
from bvp.forced import ForcedProblem
from bvp.parameters import ParametricSystem

__all__ = ["ResponsePlan", "ResponseSeed", "build_responses", "edge_of", "link_at", "seed_of"]

AHEAD = 6
"""Seeds that are worked on or wait for a worker, for each worker."""

_SAME = 1e-7
"""Largest relative difference of the numbers of one event on two families, or of two images of one event."""

_SLIGHT = 1e-9
"""Change of a parameter, beside its value, that is no rounding."""

MOST_POINTS = 3000
"""Points of a family, unless another number is asked for. A typical one has some hundreds."""

_LOST = "the family that begins here cannot be distinguished from this one"

_ERRORS = (ValueError, RuntimeError, ArithmeticError, np.linalg.LinAlgError)
"""What following a family can raise, with a text for the user."""


@dataclass(frozen=True)
class ResponsePlan:
    """The plan of a build.

    Parameters
    ----------
    interval : (float, float)
        Range of the parameter.
    depth : int
        Most events from a start to a family.
    points : int or None
        Most points of a family; by default `MOST_POINTS`.
    starts : str
        What the starts are, in short: a build of other ones is another one.
    """

    interval: tuple[float, float]
    depth: int
    points: int | None = None
    starts: str = ""

    def in_words(self) -> str:
        """The plan as a message names it."""
        low, high = self.interval
        points = "" if self.points is None else f", {self.points} points"
        return f"{low:g}:{high:g}, depth {self.depth}{points}"


class ResponseSeed(NamedTuple):
    """An orbit whose family is followed.

    problem: as `branches.forced.record.problem_record` gives it. y: unknowns. tangent: None, or the tangent at a first orbit.
    interval: the family is followed in it. depth: how many events further families are followed from it. link: how it was reached.
    """

    problem: dict[str, Any]
    y: tuple[float, ...]
    tangent: tuple[float, ...] | None
    interval: tuple[float, float]
    depth: int
    link: Link | None = None


class _Answer(NamedTuple):
    """The family of a seed, with its ids and its rows, or why it could not be followed; the next seeds; dead ends; events that are images
    of others."""

    ids: tuple[str, ...] = ()
    packed: PackedFamily | None = None
    failed: str = ""
    seeds: tuple[ResponseSeed, ...] = ()
    ends: tuple[Link, ...] = ()
    images: tuple[str, ...] = ()


def seed_of(problem: ForcedProblem, start: Any, interval: tuple[float, float], depth: int, link: Link | None = None) -> ResponseSeed:
    """The seed of a start: unknowns (u,), or a `continuation.problem.Step` with its tangent."""
    y, tangent = (start, None) if isinstance(start, np.ndarray) else (start.y, tuple(start.tangent.tolist()))
    return ResponseSeed(problem_record(problem), tuple(y.tolist()), tangent, interval, depth, link)


def build_responses(
    catalogue: Catalogue,
    starts: Sequence[ResponseSeed],
    plan: ResponsePlan,
    executor: Executor,
    workers: int = 1,
    on_family: Callable[[FamilyRow], object] | None = None,
    on_progress: Callable[[int, int], object] | None = None,
) -> dict[str, Any]:
    """Follow the families of some starts, and those that begin at their events.

    Parameters
    ----------
    catalogue : Catalogue
        Of responses, opened for writing. An unfinished build of the same plan is continued, without the starts. Families that are there
        already are followed again in the range of the plan and their own.
    starts : sequence of ResponseSeed
    plan : ResponsePlan
    executor : concurrent.futures.Executor
    workers : int
        Number of workers of the executor. The result does not depend on it.
    on_family, on_progress : callable, optional
        Called with each new family; with the numbers of families and of seeds that are left.

    Returns
    -------
    dict
        ``families``, ``points``, ``events``, ``edges``; ``left`` (events behind which nothing was followed, because they are too far away
        or outside the range), ``failed`` (families that could not be followed) and ``lost`` (events at which none was found), as texts.

    Raises
    ------
    CatalogueError
        If a build of another plan is not finished.
    """
    return _Build(catalogue, plan, executor, workers, on_family, on_progress).run(starts)


@cache
def _system(description: str) -> ParametricSystem:
    return ParametricSystem.from_description(json.loads(description))


def follow_seed(description: str, points: int | None, seed: ResponseSeed) -> _Answer:
    """Follow the family of a seed, and find the first orbits of those that begin at its events."""
    given = problem_from(_system(description), seed.problem)
    options: dict[str, Any] = {"points": points or MOST_POINTS}
    try:
        # The equations of a full period are singular where those of the half that is solved are not.
        problem, y = primitive_orbit(given, np.array(seed.y))
        start: Any = y
        if problem is given and seed.tangent is not None:
            start = ForcedFamily(problem).step(start, np.array(seed.tangent), 0.0)
        branch = primitive_branch(follow_response(problem, start, seed.interval, **options))
        whole = branch.full_family.reach(seed.interval)
        if whole != seed.interval:
            branch = follow_response(branch.problem, branch.unknowns[branch.start], whole, **options)
    except _ERRORS as error:
        return _Answer(failed=one_line(error))
    seeds: list[ResponseSeed] = []
    ends: list[Link] = []
    images: list[str] = []
    seen: list[tuple[str, np.ndarray]] = []
    for event in branch.events:
        if event.type not in SWITCHES:
            continue
        numbers = invariants(branch.problem, branch.unknowns[event.point])
        if any(code == event.type and np.allclose(its, numbers, _SAME, _SAME) for code, its in seen):
            images.append(event.id)
            continue
        seen.append((event.type, numbers))
        if seed.depth < 1 or not seed.interval[0] <= event.values[branch.name] <= seed.interval[1]:
            continue
        found, why = _beginning(branch, event, seed)
        seeds += found
        if not found:
            ends.append(replace(link_at(branch, event), kind="dead end", note=why))
    return _Answer(branch.full_family.ids, pack_response(branch), "", tuple(seeds), tuple(ends), tuple(images))


def _beginning(branch: ForcedBranch, event: ForcedEvent, seed: ResponseSeed) -> tuple[list[ResponseSeed], str]:
    """The seeds of the families that begin at an event, or why there is none. Both sides of a bifurcation are one family."""
    try:
        found = switch_response(branch, event)
    except _ERRORS as error:
        return [], one_line(error)
    seeds = []
    for problem, step in found if event.type in ("GR", "LB") else found[:1]:
        its = replace(link_at(branch, event, joined_sequence(problem.sequence)), there=orbit_of(problem, step.y))
        seeds.append(seed_of(problem, step, seed.interval, seed.depth - 1, its))
    return seeds, ""


def link_at(branch: ForcedBranch, event: ForcedEvent, sequence: str | None = None, onward: ForcedBranch | None = None) -> Link:
    """The link from an event of a branch; at a grazing to the family with a sequence. onward: a branch of it, where the event does not know
    on which side of the parameter it is."""
    kind = "switch"
    if event.type in ("GR", "LB"):
        persists = dict(event.neighbours).get(sequence or "")
        if persists is None and onward is not None:
            persists = _side(branch, event) != _side(onward, event)
        kind = "passage" if event.type == "LB" or persists is not False else "fold"
    place = float(branch.parameter[event.point]), float(branch.periods[event.point])
    problem, y, width = branch.problem, branch.unknowns[event.point], event.bracket[1] - event.bracket[0]
    here, flux = orbit_of(problem, y), impact_flux(problem, y)
    return Link(branch.id, event.id, event.type, kind, *place, event.stop, None, None, here, None, width, flux)


def _side(branch: ForcedBranch, event: ForcedEvent) -> float:
    """The sign of the change of the parameter along a branch away from an event at which it ends."""
    value = event.values[branch.name]
    off = branch.parameter - value
    ahead = off if abs(off[0]) <= abs(off[-1]) else off[::-1]
    return float(next((np.sign(one) for one in ahead if abs(one) > _SLIGHT * max(1.0, abs(value))), 0.0))


@dataclass(eq=False)
class _Piece:
    key: str
    seed: ResponseSeed


@dataclass
class _Build:
    catalogue: Catalogue
    plan: ResponsePlan
    executor: Executor
    workers: int
    on_family: Callable[[FamilyRow], object] | None
    on_progress: Callable[[int, int], object] | None

    def __post_init__(self) -> None:
        self.met: dict[tuple[str, str], None] = {}
        self.has_first_orbit, self.branch = cache(self._has_first_orbit), cache(self.catalogue.branch)
        self.report: dict[str, Any] = {"failed": [], "lost": [], "images": [], "depths": {}}
        self.count = 0
        description = json.dumps(self.catalogue.scene.system)
        self.frontier: Frontier[_Piece, _Answer] = Frontier(
            self.executor, partial(follow_seed, description, self.plan.points), self._known_family, AHEAD * self.workers,
            handed=lambda piece: piece.seed,
        )  # fmt: skip

    def run(self, starts: Sequence[ResponseSeed]) -> dict[str, Any]:
        self.plan = replace(self.plan, starts=hashlib.sha256(json.dumps([_plain(seed) for seed in starts]).encode()).hexdigest()[:8])
        built = self.catalogue.progress("built")
        if built and not self.catalogue.work() and self.catalogue.progress("plan") == _plain_plan(self.plan):
            return dict(built)
        if not self._take_up():
            self._begin(starts)
        for piece, answer in self.frontier:
            with self.catalogue.transaction():
                if answer is not None:
                    self._take(piece.seed, answer)
                elif piece.seed.link is not None:
                    self._connect(piece.seed.link, self._known_family(piece))
                self.catalogue.finish(piece.key)
                self.catalogue.note("report", self.report)
            if self.on_progress is not None:
                self.on_progress(len(self.catalogue), len(self.frontier))
        counts = self.catalogue.counts()
        report = {name: counts[name] for name in ("families", "points", "events", "edges")} | self.report
        del report["images"], report["depths"]
        done = {*self.met, *map(tuple, self.report["images"])}
        events = ((row.id, event) for row in self.catalogue.all_families() for event in self.catalogue.events(row.id))
        report["left"] = sum(event.type in SWITCHES and (id, event.id) not in done for id, event in events)
        self.catalogue.note("built", report)
        return report

    def _begin(self, starts: Sequence[ResponseSeed]) -> None:
        catalogue, interval = self.catalogue, self.plan.interval
        with catalogue.transaction():
            saved = []
            for row in catalogue.all_families():
                branch = catalogue.branch(row.id)
                # What was followed from a family is followed again from it.
                depth = int(any(edge.source == row.id for edge in catalogue.edges(row.id)))
                own = min(interval[0], branch.interval[0]), max(interval[1], branch.interval[1])
                saved.append(seed_of(branch.problem, branch.unknowns[branch.start], own, depth))
            for row in catalogue.all_families():
                catalogue.remove(row.id)
            for node in catalogue.nodes:
                catalogue.remove_node(node.id)
            catalogue.note("plan", _plain_plan(self.plan))
            catalogue.note("built", False)
            catalogue.note("report", self.report)
            self._extend([*starts, *saved])

    def _take_up(self) -> bool:
        """Go on with an unfinished build; False if there is none."""
        catalogue = self.catalogue
        pending = catalogue.work()
        if not pending:
            return False
        with readable(catalogue.path, "the work that its build has left"):
            plan = catalogue.progress("plan")
            earlier = ResponsePlan(tuple(plan["range"]), plan["depth"], plan["points"], plan["starts"])
            seeds = [(key, _read(value)) for key, value in pending]
            self.report = catalogue.progress("report")
            self.count = 1 + max(int(key) for key, _ in pending)
        if earlier != self.plan:
            others = "" if earlier.in_words() != self.plan.in_words() else " from other starts"
            words = f"a build of {earlier.in_words()} is not finished in {catalogue.path}; received {self.plan.in_words()}{others}"
            raise CatalogueError(f"{words}; expected the same, or another file")
        for edge in catalogue.edges():
            self._meet(edge.source, edge.source_event)
            self._meet(str(edge.target), edge.target_event)
        self.frontier.extend(_Piece(key, seed) for key, seed in seeds)
        return True

    def _extend(self, seeds: Iterable[ResponseSeed]) -> None:
        new = [_Piece(f"{self.count + k:07d}", seed) for k, seed in enumerate(seeds)]
        self.count += len(new)
        self.catalogue.add_work((piece.key, _plain(piece.seed)) for piece in new)
        self.frontier.extend(new)

    def _meet(self, id: str, event: str) -> None:
        if event:
            self.met[id, event] = None

    def _known_family(self, piece: _Piece) -> str | None:
        """The id of the family of a seed, if it was followed as far as from there; None if it was not."""
        deep = [id for id, depth in self.report["depths"].items() if depth >= piece.seed.depth and piece.seed.link is not None]
        return next((id for id in deep if self.has_first_orbit(id, piece)), None)

    def _has_first_orbit(self, id: str, piece: _Piece) -> bool:
        return has_orbit(self.branch(id), problem_from(self.catalogue.parametric, piece.seed.problem), np.array(piece.seed.y))

    def _take(self, seed: ResponseSeed, answer: _Answer) -> None:
        link = seed.link
        if answer.packed is None:
            where = "the start" if link is None else f"{link.source} {link.event}"
            self.report["failed"].append(f"{where}: {answer.failed}")
            if link is not None:
                self._connect(replace(link, kind="dead end", note=answer.failed, there=None), None)
            return
        id = next((id for id in answer.ids if id in self.catalogue), answer.ids[0])
        new = id not in self.catalogue
        self.report["depths"][id] = max(seed.depth, self.report["depths"].get(id, 0))
        if new:
            self.catalogue.add(kept_as(answer.packed, id))
            if self.on_family is not None:
                self.on_family(self.catalogue.family(id))
        if link is not None and link.source == id and link.kind == "switch":
            self._connect(replace(link, kind="dead end", note=_LOST, there=None), None)
        elif link is not None:
            self._connect(link, id)
        if not new and not seed.depth:
            return
        if new:
            self.report["images"] += [[id, event] for event in answer.images]
        following = []
        for one in answer.seeds:
            assert one.link is not None
            here = self._at_home(one.link, id, new)
            if here is not None and (id, here.event) not in self.met:
                following.append(one._replace(link=here))
        for end in answer.ends:
            here = self._at_home(end, id, new)
            if here is not None and (id, here.event) not in self.met:
                self.report["lost"].append(f"{id}: {here.event} at {end.h:.10g}: {end.note}")
                self._connect(here, None)
        self._extend(following)

    def _at_home(self, link: Link, id: str, new: bool) -> Link | None:
        """A link from an event of the family that was followed, as one of the family in the catalogue, whose events can have other numbers;
        None if that has no such event."""
        if new:
            return replace(link, source=id)
        branch = self.catalogue.branch(id)
        near = events_at(branch, (link.type,), (link.h, link.flux), link.width)
        if not near:
            return None
        return replace(link_at(branch, near[0]), kind=link.kind, note=link.note, there=link.there)

    def _connect(self, link: Link, target: str | None) -> None:
        edge = edge_of(self.catalogue, link, target)
        known = self.catalogue.edges(link.source)
        met_there = any((one.source, one.source_event, one.target_event) == (target, edge.target_event, link.event) for one in known)
        if not (met_there and edge.target_event):
            self.catalogue.connect(edge)
        self._meet(link.source, link.event)
        if target is not None:
            self._meet(target, edge.target_event)


def edge_of(catalogue: Catalogue, link: Link, target: str | None) -> Edge:
    """The edge from an event to the family that was followed from there, with the orbit of that family at the event, or next to it."""
    edge = Edge(link.source, link.event, link.type, link.kind, target, link.h, link.alpha, "", link.stop, link.note, link.here)
    if target is None or link.there is None:
        return edge
    types = (link.type,) if link.type in ("GR", "LB") else ("BP", "SB", "PD")
    branch = catalogue.branch(target)
    near = events_at(branch, types, (link.h, link.flux), link.width)
    event = next((event for event in near if (target, event.id) != (link.source, link.event)), None)
    if event is not None:
        return replace(edge, target_event=event.id, target_orbit=orbit_of(branch.problem, branch.unknowns[event.point]))
    # Another image of this orbit has other unknowns, so the nearest orbit of the stored family is taken.
    numbers = invariants(problem_at(branch.problem, link.there), np.array(link.there.start))
    curve = np.array([invariants(branch.problem, y) for y in branch.unknowns])
    size = np.maximum(np.ptp(curve, axis=0), 1e-9)
    nearest = int(np.argmin(np.linalg.norm((curve - numbers) / size, axis=1)))
    return replace(edge, target_orbit=orbit_of(branch.problem, branch.unknowns[nearest]))


def _plain_plan(plan: ResponsePlan) -> dict[str, Any]:
    return {"range": list(plan.interval), "depth": plan.depth, "points": plan.points, "starts": plan.starts}


def _plain(seed: ResponseSeed) -> dict[str, Any]:
    """A seed as JSON values."""
    return {**seed._asdict(), "link": plain_link(seed.link)}


def _read(plain: dict[str, Any]) -> ResponseSeed:
    """The inverse of `_plain`."""
    lists = {name: None if plain[name] is None else tuple(plain[name]) for name in ("y", "tangent", "interval")}
    return ResponseSeed(**plain | lists | {"link": read_link(plain["link"])})
