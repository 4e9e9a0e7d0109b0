"""From the crossings of a scan to orbits: each is solved as its multipoint problem and kept once, or listed with what is known of it."""

from __future__ import annotations

import threading
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from branches.family import label_at
from branches.identity import cover_of, same_segment
from branches.naming.labels import ImpossibleLabelError, Label
from branches.search.scan import EndCrossing
from branches.search.starts import Curve, Path
from branches.sequences import canonical_sequence, format_sequence, impacts_per_period, mirror, mirror_ends, unfold
from bvp.kernels.multipoint import STOP
from bvp.multipoint import MultipointProblem, NotConverged, Solution

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["Collector", "Found", "Unpolished", "accept", "first_crossings", "from_other_end", "is_one_sided", "objection", "preference"]


@dataclass(frozen=True, eq=False)
class Found:
    """An admissible, primitive orbit: the problem that it solves, its solution, its label (None outside the grammar)."""

    problem: MultipointProblem
    solution: Solution
    label: Label | None

    @property
    def h(self) -> float:
        """Energy."""
        return self.solution["energy"]

    @property
    def alpha(self) -> float:
        """Quarter period."""
        return self.solution["quarter_period"]


def objection(problem: MultipointProblem, solution: Solution) -> str | None:
    """Why a solution is not a primitive orbit with impacts: "inadmissible", "multiple_turns", "without_impacts"; None where it is one."""
    if problem.inner == 0 and STOP not in problem.kinds:
        return "without_impacts"
    if not (solution["residual"] < 1e-12 and solution["clearance"] > 0.0 and solution["speed"] > 0.0 and solution["flight"] > 0.0):
        return "inadmissible"
    return "multiple_turns" if cover_of(problem, solution) > 1 else None


def accept(problem: MultipointProblem, solution: Solution) -> Found | None:
    """The orbit with its label, or None where it is no orbit (inadmissible, or without any impact) or not a primitive one."""
    return None if objection(problem, solution) is not None else labelled(problem, solution)


def labelled(problem: MultipointProblem, solution: Solution) -> Found:
    """A solution with its label."""
    try:
        label = label_at(problem, solution.result)
    except ImpossibleLabelError:
        label = None
    return Found(problem, solution, label)


def from_other_end(orbit: Found) -> Found:
    """The same origin..origin orbit, started half a period later; itself where Newton does not confirm it there."""
    from branches.presentation import embed

    presentation = embed(orbit.problem, orbit.solution.y, (1, 2))
    problem = MultipointProblem(orbit.problem.system, presentation.ends, presentation.sequence)
    try:
        turned = accept(problem, problem.solve(presentation.unknowns(problem), energy=orbit.h))
    except NotConverged:
        return orbit
    return orbit if turned is None else turned


SAME_START = 1e-11
"""Starts nearer to each other than this, relative to the curve, are one start: what it passes later, it repeats."""

SAME_STATE = 1e-8
"""States of two solutions nearer to each other than this, relative to their size, are one orbit's."""

MOVED = 1e-6
"""How far Newton's method may move the start of a crossing, relative to its size, before it counts as another orbit's."""

MOST_PROBLEMS = 1000
"""Problems kept from one search to the next: some twenty kilobytes each."""


class Unpolished(NamedTuple):
    """A crossing that was found and is no solution yet: what is known of it, and why."""

    ends: tuple[str, str]
    sequence: str
    parameter: float
    alpha: float
    residual: float
    reason: str


def first_crossings(
    crossings: list[EndCrossing], instants: list[float], sequences: list[tuple[str, ...]], start: str, span: float
) -> tuple[list[int], list[int]]:
    """Which crossings are the first of their start, and which repeat it: multiples of the first segment, with the impacts of that.

    Parameters
    ----------
    crossings : list of EndCrossing
        Of one curve.
    instants : list of float
        Time from the start to each.
    sequences : list of tuple of str
        Impacts from the start to each, that at a far stop included.
    start : str
        The end that the curve is of.
    span : float
        Length of the curve.

    Returns
    -------
    first, repeated : list of int
    """
    first: list[int] = []
    repeated: list[int] = []
    order = sorted(range(len(crossings)), key=lambda i: crossings[i].parameter)
    groups: list[list[int]] = []
    for i in order:
        near = groups and crossings[i].parameter - crossings[groups[-1][-1]].parameter <= SAME_START * span
        if near and crossings[i].converged and crossings[groups[-1][-1]].converged:
            groups[-1].append(i)
        else:
            groups.append([i])
    for group in groups:
        group.sort(key=lambda i: instants[i])
        kept: list[int] = []
        for i in group:
            if any(_repeats(instants[i], sequences[i], crossings[j].kind, instants[j], sequences[j], start) for j in kept):
                repeated.append(i)
            else:
                kept.append(i)
        first += kept
    return sorted(first), repeated


def _repeats(instant: float, sequence: tuple[str, ...], far: str, period: float, first: tuple[str, ...], start: str) -> bool:
    """Whether a crossing is the first one again, after several segments between the start and that far end.

    The times alone do not tell: where motions part fast, orbits with other sequences have the same start and time within rounding."""
    count = round(instant / period)
    if count < 2 or abs(instant - count * period) > 1e-6 * period:
        return False
    inner, end = (first[:-1], far + first[-1]) if far == "stop" else (first, far)
    expected = unfold(inner, (start, end), count)[0]
    return sequence[: len(expected)] == expected and len(sequence) - len(expected) in (0, 1)


_Problems = dict[tuple[tuple[str, str], tuple[str, ...]], MultipointProblem]


class _Kept(threading.local):
    """The problems of the system that was searched last: neighbouring energies have the same sequences.

    Each thread has its own, for problems hold scratch arrays."""

    system: ImpactSystem | None = None
    problems: _Problems


_kept = _Kept()


def _problems_of(system: ImpactSystem) -> _Problems:
    if _kept.system is not system or len(_kept.problems) > MOST_PROBLEMS:
        _kept.system, _kept.problems = system, {}
    return _kept.problems


class Collector:
    """Collects the orbits of one system at one energy.

    Parameters
    ----------
    system : ImpactSystem
    energy : float
    """

    def __init__(self, system: ImpactSystem, energy: float):
        self.system = system
        self.energy = energy
        self.counts: Counter[str] = Counter()
        self.unpolished: list[Unpolished] = []
        self.found: dict[tuple[Any, Any], list[list[Found]]] = {}
        self.problems = _problems_of(system)

    def problem(self, ends: tuple[str, str], sequence: tuple[str, ...]) -> MultipointProblem:
        """The multipoint problem with these ends and sequence, made once."""
        if (ends, sequence) not in self.problems:
            self.problems[ends, sequence] = MultipointProblem(self.system, ends, sequence)
        return self.problems[ends, sequence]

    def add(self, curve: Curve, crossing: EndCrossing, path: Path) -> None:
        """Solve a crossing of a curve, the path of whose start is given, and sort it in."""
        letters = self.system.modes.contact_letters
        sequence = tuple(letters[c] for c in path.contacts[: crossing.impacts])
        far = crossing.kind
        if far == "stop":
            if len(path.contacts) <= crossing.impacts:
                self._set_aside(curve, (curve.end, "stop+"), sequence, crossing, path, "its last impact was not found again")
                return
            far += letters[path.contacts[crossing.impacts]]
        ends = (curve.end, far)
        sign = 1.0
        if self.system.has_odd_symmetry and (mirror_ends(ends), mirror(sequence)) < (ends, sequence):
            ends, sequence, sign = mirror_ends(ends), mirror(sequence), -1.0
        if len(path.nodes) < crossing.impacts:
            self._set_aside(curve, ends, sequence, crossing, path, "its impacts were not found again")
            return
        problem = self.problem(ends, sequence)
        y = problem.pack(sign * path.start, sign * path.nodes, np.append(path.durations, crossing.flight))
        try:
            solution = problem.solve(y, energy=self.energy)
        except NotConverged as error:
            self._set_aside(curve, ends, sequence, crossing, path, str(error))
            return
        moved = float(np.max(np.abs(problem.start(solution.y) - sign * path.start)))
        if moved > MOVED * float(np.max(np.abs(path.start))):
            self._set_aside(curve, ends, sequence, crossing, path, "Newton's method moved away from it")
            return
        why = objection(problem, solution)
        if why == "inadmissible" and not solution["residual"] < 1e-12:
            self._set_aside(curve, ends, sequence, crossing, path, f"its residual stays at {solution['residual']:.1e}")
            return
        if why == "inadmissible" and min(solution["clearance"], solution["speed"]) > -1e-12:
            self._set_aside(curve, ends, sequence, crossing, path, "it grazes a stop within rounding")
            return
        if why is not None:
            self.counts[why] += 1
            return
        self.counts["polished"] += 1
        orbit = labelled(problem, solution)
        key = canonical_sequence(sequence, ends, odd_symmetry=self.system.has_odd_symmetry)
        same = self.found.setdefault(key, [])
        for images in same:
            if any(is_same(orbit, other) for other in images):
                self.counts["duplicates"] += 1
                if not any(is_again(problem, sign * path.start, other) for other in images):
                    images.append(orbit)
                return
        same.append([orbit])

    def _set_aside(
        self, curve: Curve, ends: tuple[str, str], sequence: tuple[str, ...], crossing: EndCrossing, path: Path, reason: str
    ) -> None:
        time = path.until_last + crossing.flight
        quarters = 1 if (ends[0] == "origin") != (ends[1] == "origin") else 2
        self.counts["unpolished"] += 1
        angle = curve.angle(crossing.parameter)
        self.unpolished.append(Unpolished(ends, format_sequence(sequence), angle, time / quarters, crossing.residual, reason))

    def within(self, quarter_period: float, impacts: int | None) -> list[list[Found]]:
        """The orbits within bounds of quarter period and impacts in half a period: each with all the solutions that are images of it."""
        return [
            images
            for group in self.found.values()
            for images in group
            if images[0].alpha <= quarter_period * (1.0 + 1e-12)
            and (impacts is None or impacts_per_period(images[0].problem.sequence, images[0].problem.ends) <= 2 * impacts)
        ]


def is_one_sided(images: list[Found]) -> bool:
    """Whether an orbit with two ends of one kind was found from one of them alone; no scan that misses nothing finds it so."""
    first, last = (end.rstrip("+-") for end in images[0].problem.ends)
    return first == last and len(images) != 2


def is_again(problem: MultipointProblem, start: np.ndarray, other: Found) -> bool:
    """Whether a start is that of an orbit that is known, within rounding: intervals that are resumed overlap."""
    known = other.problem.start(other.solution.y)
    return other.problem is problem and float(np.max(np.abs(known - start))) <= SAME_START * float(np.max(np.abs(start)))


def preference(orbit: Found) -> tuple[Any, ...]:
    """Which image of an orbit is listed: the label with p <= q, then the first sequence, then the first start."""
    label = orbit.label
    crossed = label is not None and label.p is not None and label.q is not None and label.p > label.q
    start = orbit.problem.start(orbit.solution.y)
    return crossed, orbit.problem.ends, orbit.problem.sequence, tuple(np.round(-start, 9))


def is_same(orbit: Found, other: Found) -> bool:
    """Whether two solutions are one orbit. Their quarter periods are compared first: that is cheap, and tells most orbits apart."""
    if abs(orbit.alpha / other.alpha - 1.0) > SAME_STATE:
        return False
    return same_segment((orbit.problem, orbit.solution.y), (other.problem, other.solution.y), SAME_STATE)
