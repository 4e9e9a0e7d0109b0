"""Building a catalogue: everything found is followed, everything met on the way is found, until nothing new comes.

Seeds are taken in the order in which they were found, whatever the number of workers; what comes of one is kept in one transaction with
the seeds that it gives. A build that was cut short therefore goes on where it was.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.building.bounds import Bounds
from branches.building.frontier import Frontier
from branches.building.work import Answer, Link, Seed, work
from branches.catalogue.closures import presented, unknowns_of
from branches.catalogue.known import KnownFamilies
from branches.catalogue.rows import Edge, EventOrbit, Node
from branches.linear_modes import linear_modes
from branches.words import Ends, Word, parse_ends, parse_word
from bvp.multipoint import MultipointProblem

if TYPE_CHECKING:
    from branches.catalogue.store import Catalogue

__all__ = ["Progress", "build"]

COARSE = 0.5
"""Step in log h of the first energies searched; halved until a whole level finds no new family."""

LEVELS = 8
"""Halvings at most."""

_SAME = 1e-6

_JOINS = ("GR", "BP", "SB", "PD", "RT")


@dataclass(frozen=True)
class Progress:
    """How far a build is."""

    families: int
    queued: int
    points: int
    events: int
    level: int


def build(
    catalogue: Catalogue,
    bounds: Bounds,
    executor: Executor,
    workers: int = 2,
    on_progress: Callable[[Progress], object] | None = None,
) -> dict[str, Any]:
    """Find and follow every family inside the bounds, and keep them in a catalogue.

    Parameters
    ----------
    catalogue : Catalogue
        Opened to add to. What it holds of an earlier build with the same bounds is gone on from.
    bounds : Bounds
    executor : concurrent.futures.Executor
        Where the work is done.
    workers : int
        How many work on it; changes nothing but the time.
    on_progress : callable, optional

    Returns
    -------
    dict
        ``families``, ``points``, ``events``, ``edges``, ``levels`` (energies searched and families new at each), ``settled`` (whether the
        last level found nothing new), ``beyond`` (neighbours outside the bounds), ``failed`` (what could not be done, in words).
    """
    return _Build(catalogue, bounds, executor, workers, on_progress).run()


class _Build:
    def __init__(
        self,
        catalogue: Catalogue,
        bounds: Bounds,
        executor: Executor,
        workers: int,
        on_progress: Callable[[Progress], object] | None,
    ) -> None:
        self.catalogue = catalogue
        self.bounds = bounds
        self.system = catalogue.system
        self.on_progress = on_progress
        self.known = KnownFamilies()
        self.problems: dict[tuple[Any, ...], MultipointProblem] = {}
        self.places: dict[str, tuple[int, str | None]] = {}
        self.points = self.events = 0
        self.beyond = 0
        self.failed: list[str] = []
        self.levels: list[dict[str, Any]] = []
        description = json.dumps(self.system.describe(), sort_keys=True)
        self.frontier: Frontier[tuple[str, Seed], Answer] = Frontier(
            executor, partial(_named, description), self._is_known, lambda item: item[0], 3 * workers
        )
        self.count = 0

    def run(self) -> dict[str, Any]:
        """Everything, from the first level of energies to the one that adds nothing."""
        for row in self.catalogue.families():
            self._remember(row.id, self.catalogue.branch(row.id))
        self._take_up()
        for mode in linear_modes(self.system):
            if mode.label:
                self.catalogue.add_node(Node(mode.label, "linear mode", mode.label, mode.energies, mode.alpha))
        self._queue([("mode", (mode.index, turns)) for mode in linear_modes(self.system) for turns in self._turns(mode.alpha)])
        for level in range(len(self.levels), LEVELS):
            energies = self._energies(level)
            before = len(self.known)
            self._queue([("energy", energy) for energy in energies])
            self._empty(level)
            found = len(self.known) - before
            self.levels.append({"energies": len(energies), "new": found})
            self.catalogue.note("levels", self.levels)
            if level > 1 and not found and not self.levels[-2]["new"]:
                break
        settled = len(self.levels) > 1 and self.levels[-1]["new"] == 0
        report = {
            "families": len(self.known), "points": self.points, "events": self.events, "edges": len(self.catalogue.edges()),
            "levels": self.levels, "settled": settled, "beyond": self.beyond, "failed": self.failed,
        }  # fmt: skip
        self.catalogue.note("built", {"bounds": self.bounds.plain(), **report})
        return report

    def _turns(self, alpha: float) -> range:
        return range(1, math.floor(self.bounds.quarter_period / alpha * (1.0 + 1e-12)) + 1)

    def _energies(self, level: int) -> list[float]:
        """Energies of a level: those of all levels together are even in log h. None is at a bound."""
        low, high = np.log(self.bounds.energy)
        count = max(2, math.ceil((high - low) / COARSE))
        if level == 0:
            parts = (np.arange(count) + 0.5) / count
        else:
            fine = count * 2 ** (level - 1)
            parts = np.arange(1, fine) / fine if level == 1 else (np.arange(fine) + 0.5) / fine
        return [float(energy) for energy in np.exp(low + parts * (high - low))]

    # -- the queue ------------------------------------------------------------------------------------------------------------

    def _queue(self, found: Iterable[tuple[str, Any]]) -> None:
        with self.catalogue.transaction():
            self._extend(Seed(kind, value, self.bounds) for kind, value in found)

    def _extend(self, seeds: Iterable[Seed]) -> None:
        named = []
        for seed in seeds:
            named.append((f"{self.count:07d}", seed))
            self.count += 1
        self.catalogue.add_work((name, _plain(seed)) for name, seed in named)
        self.frontier.extend(named)

    def _take_up(self) -> None:
        """Go on with what an earlier run left."""
        self.levels = self.catalogue.progress("levels") or []
        done, pending = self.catalogue.work("done"), self.catalogue.work("pending")
        self.count = 1 + max((int(key) for key, _, _ in (*done, *pending)), default=-1)
        self.frontier.extend((key, _seed(value)) for key, value, _ in pending)

    def _empty(self, level: int) -> None:
        for (name, seed), answer in self.frontier:
            with self.catalogue.transaction():
                self._take(seed, answer)
                self.catalogue.finish(name)
            if self.on_progress is not None:
                self.on_progress(Progress(len(self.known), len(self.frontier), self.points, self.events, level))

    # -- one seed -------------------------------------------------------------------------------------------------------------

    def _is_known(self, item: tuple[str, Seed]) -> bool:
        name, seed = item
        if seed.kind != "orbit":
            return False
        count, id = self.places.get(name, (-1, None))
        if id is None and count < len(self.known):
            problem, y = self._solved(seed.value)
            place = self.known.find(problem, y)
            id = None if place is None else place.id
            self.places[name] = (len(self.known), id)
        return id is not None

    def _solved(self, orbit: EventOrbit) -> tuple[MultipointProblem, np.ndarray]:
        key = (orbit.ends, orbit.word)
        if key not in self.problems:
            self.problems[key] = MultipointProblem(self.system, orbit.ends, parse_word(orbit.word))
        return self.problems[key], unknowns_of(self.problems[key], orbit)

    def _take(self, seed: Seed, answer: Answer | None) -> None:
        if answer is None:
            problem, y = self._solved(seed.value)
            place = self.known.find(problem, y)
            assert place is not None
            if seed.link is not None:
                self._connect(seed.link, place.id)
            return
        self.beyond += answer.beyond
        self.failed += answer.failed
        if answer.branch is not None:
            id = answer.branch.id
            if id not in self.catalogue:
                self.catalogue.add(answer.branch)
                self._remember(id, answer.branch)
                self._extend(answer.seeds)
                for link in answer.ends:
                    self._connect(link, None)
            if seed.link is not None:
                self._connect(seed.link, id)
        else:
            self._extend(answer.seeds)

    def _remember(self, id: str, branch: Any) -> None:
        self.known.add(id, branch)
        self.points += len(branch)
        self.events += len(branch.events)

    def _as_orbit_of(self, link: Link, ends: Ends, word: Word) -> EventOrbit | None:
        """The event's orbit as the family with these ends and word has it."""
        for orbit in (link.there, link.here):
            if orbit is not None:
                found = presented(*self._solved(orbit), ends, word)
                if found is not None:
                    return found
        return None

    def _connect(self, link: Link, target: str | None) -> None:
        event = ""
        if target is None and link.kind == "linear mode":
            labels = [mode.label for mode in linear_modes(self.system) if mode.label]
            target = next((label for label in labels if label in (link.note or "")), None)
        elif target is not None:
            there = [event for event in self.catalogue.events(target) if event.type in _JOINS]
            same = [(abs(event.h / link.h - 1.0), event.id) for event in there if abs(event.h / link.h - 1.0) < _SAME]
            event = min(same)[1] if same else ""
            row = self.catalogue.family(target)
            link = replace(link, there=self._as_orbit_of(link, parse_ends(row.ends), parse_word(row.word)))
        self.catalogue.connect(
            Edge(
                link.source, link.event, link.type, link.kind, target, link.h, link.alpha, event, link.stop, link.note,
                link.here, link.there,
            )  # fmt: skip
        )


def _named(description: str, item: tuple[str, Seed]) -> Answer:
    return work(description, item[1])


def _plain(seed: Seed) -> dict[str, Any]:
    """A seed as JSON values."""
    value: Any = list(seed.value) if seed.kind == "mode" else seed.value
    return {
        "kind": seed.kind,
        "value": asdict(value) if seed.kind == "orbit" else value,
        "bounds": seed.bounds.plain(),
        "link": None if seed.link is None else asdict(seed.link),
    }


def _seed(plain: dict[str, Any]) -> Seed:
    """The inverse of `_plain`."""
    kind, value, link = plain["kind"], plain["value"], plain["link"]
    if kind == "orbit":
        value = _orbit(value)
    elif kind == "mode":
        value = tuple(value)
    if link is not None:
        link = replace(Link(**link), here=_orbit(link["here"]), there=_orbit(link["there"]))
    return Seed(kind, value, Bounds.of(plain["bounds"]), link)


def _orbit(plain: dict[str, Any] | None) -> EventOrbit | None:
    if plain is None:
        return None
    return EventOrbit(tuple(plain["ends"]), plain["word"], tuple(plain["start"]), tuple(plain["flight_times"]))
