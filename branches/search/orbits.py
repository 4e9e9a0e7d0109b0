"""The search for orbits: each scanned segment is solved as a multipoint problem, and each orbit is kept once.

Three scans find segments. `branches.search.intervals` splits the starts at an energy into intervals until each is decided.
`branches.search.starts` compares starts at given angles: it is fast and proves nothing. `branches.impulsive.orbits` splits a range of
energies until each interval is decided.
"""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from branches.identity import cover_of, same_orbit
from branches.naming.labels import Label
from branches.orbit import label_at
from branches.search.intervals import SAME_START, Limits, Opening, segments
from branches.search.starts import Sampler, ScannedSegment
from branches.sequences import Ends, ImpactSequence, canonical_sequence, impacts_per_period
from bvp.kernels.multipoint import STOP
from bvp.multipoint import MultipointProblem, NotConverged, Solution

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["Found", "OrbitSearch", "Unpolished", "accept", "from_other_end", "is_complete", "judged", "kept_problems"]

SAME_STATE = 1e-8
"""Largest difference of the states of two solutions that are one orbit, relative to their size."""

MOVED = 1e-6
"""How far Newton's method may move the start of a segment, relative to its size. Farther, it has found another orbit."""

MOST_PROBLEMS = 1000
"""Problems kept from one search to the next, some twenty kilobytes each."""


Problems = dict[tuple[Ends, ImpactSequence], MultipointProblem]


@dataclass(eq=False)
class Found:
    """An admissible, primitive orbit.

    It has the problem that it solves, its solution, its label (None outside the grammar), energy h, quarter period alpha, and its canonical
    sequence and ends.
    """

    problem: MultipointProblem
    solution: Solution
    label: Label | None

    def __post_init__(self) -> None:
        self.h = self.solution["energy"]
        self.alpha = self.solution["quarter_period"]
        problem = self.problem
        self.canonical = canonical_sequence(problem.sequence, problem.ends, odd_symmetry=problem.system.has_odd_symmetry)


class Unpolished(NamedTuple):
    """A segment that a scan found and that could not be solved.

    parameter, low, high: the scan's parameter and its interval. alpha, residual: of the segment. reason: a text.
    """

    ends: Ends
    sequence: str
    parameter: float
    low: float
    high: float
    alpha: float
    residual: float
    reason: str


def accept(problem: MultipointProblem, solution: Solution) -> Found | None:
    """The orbit with its label, or None if the solution is not a primitive orbit with impacts."""
    orbit = judged(problem, solution)
    return None if isinstance(orbit, str) else orbit


def judged(problem: MultipointProblem, solution: Solution) -> Found | str:
    """The orbit with its label, or why it is none: "without_impacts", "inadmissible", or "covers" for an orbit that is not primitive."""
    if problem.inner == 0 and STOP not in problem.kinds:
        return "without_impacts"
    if not (solution["residual"] < 1e-12 and solution["clearance"] > 0.0 and solution["speed"] > 0.0 and solution["flight"] > 0.0):
        return "inadmissible"
    if cover_of(problem, solution) > 1:
        return "covers"
    return Found(problem, solution, label_at(problem, solution.result))


def from_other_end(orbit: Found) -> Found:
    """The same origin..origin orbit, started half a period later. If Newton's method does not confirm it there, the orbit itself."""
    from branches.presentation import embed

    presentation = embed(orbit.problem, orbit.solution.y, (1, 2))
    problem = MultipointProblem(orbit.problem.system, presentation.ends, presentation.sequence)
    try:
        turned = accept(problem, problem.solve(presentation.unknowns(problem), energy=orbit.h))
    except NotConverged:
        return orbit
    return orbit if turned is None else turned


def is_complete(counts: dict[str, int]) -> bool:
    """Whether a scan decided all its intervals, all its segments were solved, and each orbit was found from both its ends."""
    return not any(counts.get(stage) for stage in ("open", "unpolished", "one_sided"))


class OrbitSearch:
    """Collects the orbits of one system.

    Parameters
    ----------
    system : ImpactSystem
    problems : dict, optional
        Multipoint problems of the system made by earlier searches. New ones are added.

    Attributes
    ----------
    counts : Counter
        Counts of each stage: the stages of the scans, and ``polished``, ``unpolished``, ``inadmissible``, ``without_impacts``, ``covers``,
        ``duplicates``.
    unpolished : list of Unpolished
    open : list of Opening
        Intervals of starts that are not decided.
    """

    def __init__(self, system: ImpactSystem, problems: Problems | None = None):
        self.system = system
        self.counts: Counter[str] = Counter()
        self.unpolished: list[Unpolished] = []
        self.open: list[Opening] = []
        self.found: dict[tuple[Any, Any], list[list[Found]]] = {}
        self.problems: Problems = {} if problems is None else problems

    def scan(self, start: str, energy: float, limits: Limits, budget: int) -> None:
        """Collect all orbits at an energy that start at a kind of end, as `branches.search.intervals.segments` describes."""

        def solve(problem: MultipointProblem, y: np.ndarray) -> Solution:
            return problem.solve(y, energy=energy)

        for segment, is_found_again in segments(self.system, start, energy, limits, budget, self.counts, self.open):
            if is_found_again:
                self.add(segment, solve, _strayed)
            else:
                self._set_aside(segment, "its impacts were not found again")

    def sample(self, sampler: Sampler, energy: float, angles: int | np.ndarray) -> Iterator[Found]:
        """Orbits at an energy, as `Sampler.segments` finds them. One orbit may be yielded twice."""
        for segment in sampler.segments(energy, angles):
            orbit = self.add(segment, lambda problem, y: problem.solve(y, energy=energy))
            if orbit is not None:
                yield orbit

    def add(
        self,
        segment: ScannedSegment,
        solve: Callable[[MultipointProblem, np.ndarray], Solution],
        strayed: Callable[[ScannedSegment, MultipointProblem, Solution], str | None] | None = None,
    ) -> Found | None:
        """Solve a segment, and keep the orbit if it is new.

        Parameters
        ----------
        segment : ScannedSegment
        solve : callable
            (problem, unknowns) -> solution; raises `NotConverged`.
        strayed : callable, optional
            (segment, problem, solution) -> why the solution is not the segment's; None if it is.

        Returns
        -------
        Found or None
            None if the solution is not a primitive orbit.
        """
        key = segment.ends, segment.sequence
        if not segment.sequence and not any(end.startswith("stop") for end in segment.ends):
            self.counts["without_impacts"] += 1
            return None
        if key not in self.problems:
            self.problems[key] = MultipointProblem(self.system, *key)
        problem = self.problems[key]
        try:
            solution = solve(problem, problem.pack(segment.start, segment.nodes, segment.flight_times))
        except NotConverged as error:
            self._set_aside(segment, str(error))
            return None
        reason = strayed(segment, problem, solution) if strayed is not None else None
        if reason is not None:
            self._set_aside(segment, reason)
            return None
        orbit = judged(problem, solution)
        if isinstance(orbit, str):
            self.counts[orbit] += 1
            return None
        self.counts["polished"] += 1
        same = self.found.setdefault(orbit.canonical, [])
        for images in same:
            # Comparing the quarter periods first is cheap and separates most orbits.
            near = [(other.problem, other.solution.y) for other in images if abs(orbit.alpha / other.alpha - 1.0) <= SAME_STATE]
            if any(same_orbit((problem, solution.y), other, SAME_STATE, between_reversals=True) for other in near):
                self.counts["duplicates"] += 1
                if not any(_has_start(other, problem, segment.start) for other in images):
                    images.append(orbit)
                return orbit
        same.append([orbit])
        return orbit

    def _set_aside(self, segment: ScannedSegment, reason: str) -> None:
        self.counts["unpolished"] += 1
        sequence = "".join(segment.sequence)
        self.unpolished.append(
            Unpolished(segment.ends, sequence, segment.parameter, segment.low, segment.high, segment.alpha, segment.residual, reason)
        )

    def orbits(self, quarter_period: float, impacts: int | None) -> list[Found]:
        """The orbits within bounds of quarter period and impacts in half a period, by quarter period.

        An orbit with two ends of one kind can be solved from each of them. A complete scan finds it from both. ``one_sided`` counts those
        found from one alone, ``beyond_bounds`` the orbits outside the bounds."""
        every = [images for group in self.found.values() for images in group]
        within = [
            images
            for images in every
            if images[0].alpha <= quarter_period * (1.0 + 1e-12)
            and (impacts is None or impacts_per_period(images[0].problem.sequence, images[0].problem.ends) <= 2 * impacts)
        ]
        self.counts["one_sided"] = sum(_is_one_sided(images) for images in within)
        self.counts["beyond_bounds"] = len(every) - len(within)
        self.counts["orbits"] = len(within)
        return sorted((min(images, key=_preference) for images in within), key=lambda o: (o.alpha, o.problem.ends, o.problem.sequence))


class _Kept(threading.local):
    """The problems of the system that this thread searched last. Neighbouring energies have the same sequences.

    Problems hold scratch arrays, so threads do not share them."""

    system: ImpactSystem | None = None
    problems: Problems


_kept = _Kept()


def kept_problems(system: ImpactSystem) -> Problems:
    """The multipoint problems of the last system that this thread searched, if it is the same."""
    if _kept.system is not system or len(_kept.problems) > MOST_PROBLEMS:
        _kept.system, _kept.problems = system, {}
    return _kept.problems


def _strayed(segment: ScannedSegment, problem: MultipointProblem, solution: Solution) -> str | None:
    """Why a solution does not show what the segment is; None if it does."""
    if np.max(np.abs(problem.start(solution.y) - segment.start)) > MOVED * np.max(np.abs(segment.start)):
        return "Newton's method moved away from it"
    if not solution["residual"] < 1e-12:
        return f"its residual stays at {solution['residual']:.1e}"
    nearest = min(solution["clearance"], solution["speed"])
    if min(nearest, solution["flight"]) <= 0.0 and nearest > -1e-12:
        return "it grazes a stop within rounding"
    return None


def _is_one_sided(images: list[Found]) -> bool:
    """Whether an orbit with two ends of one kind was found from one of them alone."""
    first, last = (end.rstrip("+-") for end in images[0].problem.ends)
    return first == last and len(images) != 2


def _has_start(orbit: Found, problem: MultipointProblem, start: np.ndarray) -> bool:
    """Whether a start equals the start of a known orbit within rounding. This happens because resumed intervals overlap."""
    known = orbit.problem.start(orbit.solution.y)
    return orbit.problem is problem and float(np.max(np.abs(known - start))) <= SAME_START * float(np.max(np.abs(start)))


def _preference(orbit: Found) -> tuple[Any, ...]:
    """Sort key of the images of an orbit: the label with p <= q, then the first sequence, then the first start."""
    label = orbit.label
    crossed = label is not None and label.p is not None and label.q is not None and label.p > label.q
    start = orbit.problem.start(orbit.solution.y)
    return crossed, orbit.problem.ends, orbit.problem.sequence, tuple(np.round(-start, 9))
