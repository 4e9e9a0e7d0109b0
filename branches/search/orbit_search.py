"""Orbits that searches find: segments are solved, and each orbit is kept once."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from branches.naming.labels import Label
from branches.orbit import Orbit, label_at
from branches.order import in_tied_order
from branches.presentation import cover_of, same_orbit
from branches.search.intervals import SAME_START, Limits, Opening, segments
from branches.search.known import Boxes, recognised
from branches.search.starts import ScannedSegment, StartCurve
from branches.sequences import Ends, ImpactSequence, canonical_sequence, impacts_per_period
from bvp.checks import EPSILON
from bvp.closures import STOP
from bvp.multipoint import MultipointProblem, NotConverged, Solution
from bvp.system import ImpactSystem
from bvp.texts import brief, listed

__all__ = [
    "CLASSES", "Discovery", "Found", "OrbitSearch", "Problems", "STAGES", "Unpolished", "WITHOUT_ORIGIN", "in_order", "is_complete",
    "judged", "kept_problems",
]  # fmt: skip

CLASSES = {
    "origin-origin": ("origin-origin", "origin-rest", "origin-stop"),
    "origin-rest": ("origin-rest",),
    "origin-stop": ("origin-stop",),
    "rest-rest": ("rest-rest", "origin-rest"),
    "rest-stop": ("rest-stop",),
    "stop-stop": ("stop-stop", "origin-stop"),
}
"""Pairs of ends that can be searched, each with the pairs of the more symmetric orbits among its own."""

WITHOUT_ORIGIN = ("rest-rest", "rest-stop", "stop-stop")
"""Pairs of ends of every reversible system. An origin end needs odd symmetry."""

STAGES = (
    "starts", "split", "closed", "open", "resumed", "at_grazing", "over_budget", "grazings", "crossings", "repeated", "polished",
    "unpolished", "inadmissible", "without_impacts", "covers", "duplicates", "one_sided", "beyond_bounds", "orbits",
)  # fmt: skip
"""Keys of `Discovery.counts`."""

SAME_STATE = 1e-8
"""Largest difference of the states of two solutions that are one orbit, relative to their size."""

TIED = 1e-12
"""Relative difference of quarter periods that rounding may have made: they are no order of two orbits."""

MOVED = 1e-6
"""How far Newton's method may move the start of a segment, relative to its size. Farther, it has found another orbit."""

MOST_PROBLEMS = 1000
"""Problems kept from one search to the next, some twenty kilobytes each."""

Problems = dict[tuple[Ends, ImpactSequence], MultipointProblem]

Solver = Callable[[MultipointProblem, np.ndarray], Solution]
"""Takes a problem and its unknowns; may raise `NotConverged`."""


@dataclass(eq=False)
class Found:
    """An admissible, primitive orbit: its problem, solution and label (None outside the grammar), energy h, quarter period alpha, and its
    canonical sequence and ends."""

    problem: MultipointProblem
    solution: Solution
    label: Label | None

    def __post_init__(self) -> None:
        self.h = self.solution["energy"]
        self.alpha = self.solution["quarter_period"]
        problem = self.problem
        self.canonical = canonical_sequence(problem.sequence, problem.ends, odd_symmetry=problem.system.has_odd_symmetry)


class Unpolished(NamedTuple):
    """A segment that could not be solved. parameter, low, high: the scan's parameter and its interval. alpha, residual: of the segment."""

    ends: Ends
    sequence: str
    parameter: float
    low: float
    high: float
    alpha: float
    residual: float
    reason: str


def judged(problem: MultipointProblem, solution: Solution) -> Found | str:
    """The orbit with its label, or why it is none: "without_impacts", "inadmissible", or "covers" for an orbit that is not primitive."""
    if problem.inner == 0 and STOP not in problem.kinds and not problem.is_smooth:
        return "without_impacts"
    fast = solution["speed"] > EPSILON * problem.speed(solution)  # what rests at a stop has a speed of rounding
    if not (solution["residual"] < 1e-12 and solution["clearance"] > 0.0 and fast and solution["flight"] > 0.0):
        return "inadmissible"
    if cover_of(problem, solution) > 1:
        return "covers"
    return Found(problem, solution, label_at(problem, solution.result))


def is_complete(counts: dict[str, int]) -> bool:
    """Whether a scan decided all its intervals, all its segments were solved, and each orbit was found from both its ends."""
    return not any(counts.get(stage) for stage in ("open", "unpolished", "one_sided"))


@dataclass(eq=False)
class OrbitSearch:
    """Collects the orbits of one system.

    `problems`: multipoint problems of the system that earlier searches made; new ones are added. `counts`, `unpolished`, `open`: as in
    `Discovery`. `found`: orbits by their canonical sequence and ends, each with its images.
    """

    system: ImpactSystem
    problems: Problems = field(default_factory=dict)
    counts: Counter[str] = field(default_factory=Counter)
    unpolished: list[Unpolished] = field(default_factory=list)
    open: list[Opening] = field(default_factory=list)
    found: dict[tuple[Any, Any], list[list[Found]]] = field(default_factory=dict)

    def scan(self, starts: list[StartCurve], limits: Limits, budget: int, solve: Solver) -> None:
        """Collect all orbits from the starts of some curves, as `branches.search.intervals.segments` describes."""
        self.solve(self.scanned(starts, limits, budget), solve)

    def scanned(self, starts: list[StartCurve], limits: Limits, budget: int) -> list[ScannedSegment]:
        """The segments from the starts of some curves, before they are solved. Those whose impacts are not found again are set aside."""
        found = []
        for segment, is_found_again in segments(self.system, starts, limits, budget, self.counts, self.open):
            if is_found_again:
                found.append(segment)
            else:
                self._set_aside(segment, "its impacts were not found again")
        return found

    def solve(self, scanned: Sequence[ScannedSegment], solve: Solver, known: Boxes | None = None) -> None:
        """Collect the orbits of scanned segments; with `known`, the segments of one energy without the orbits of known families."""
        odd_symmetry, passed = self.system.has_odd_symmetry, set[int]()
        if known and not self.counts["open"] and not self.unpolished:
            passed = recognised(scanned, known, odd_symmetry=odd_symmetry)
        for index, segment in enumerate(scanned):
            if index not in passed:
                self.add(segment, solve, must_stay=True)

    def add(self, segment: ScannedSegment, solve: Solver, *, must_stay: bool = False) -> Found | None:
        """Solve a segment, and keep the orbit if it is new; None if the solution is not a primitive orbit.

        With `must_stay`, a solution that does not show what the segment is counts as not solved.
        """
        key = segment.ends, segment.sequence
        if not segment.sequence and not any(end.startswith("stop") for end in segment.ends) and self.system.smooth_forces is None:
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
        reason = _strayed(segment, problem, solution) if must_stay else None
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
            near = [other for other in images if abs(orbit.alpha / other.alpha - 1.0) <= SAME_STATE]
            pairs = (((problem, solution.y), (other.problem, other.solution.y)) for other in near)
            if any(same_orbit(*pair, SAME_STATE, between_reversals=True) for pair in pairs):
                self.counts["duplicates"] += 1
                # A segment that is only near an orbit does not show where it starts.
                start = segment.start if must_stay else problem.start(solution.y)
                if not any(_has_start(other, problem, start) for other in images):
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
        # Whether an orbit with two ends of one kind was found from one of them alone.
        symmetric = (images for images in within if len({end.rstrip("+-") for end in images[0].problem.ends}) == 1)
        self.counts["one_sided"] = sum(len(images) != 2 for images in symmetric)
        self.counts["beyond_bounds"] = len(every) - len(within)
        self.counts["orbits"] = len(within)
        return in_order(min(images, key=_preference) for images in within)


_kept = threading.local()


def kept_problems(system: ImpactSystem) -> Problems:
    """The multipoint problems of the system that this thread searched last: neighbouring energies have the same sequences. Problems hold
    scratch arrays, so threads do not share them."""
    if getattr(_kept, "system", None) is not system or len(_kept.problems) > MOST_PROBLEMS:
        _kept.system, _kept.problems = system, {}
    problems: Problems = _kept.problems
    return problems


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


def in_order(orbits: Iterable[Found]) -> list[Found]:
    """Orbits by quarter period. Of those that are tied, the one with more stop ends is first, then by ends, sequence and start.

    Orbits of different families can have quarter periods that differ by less than rounding. What a build finds first decides in which
    direction it follows the families that several others meet, so rounding must not order them."""

    def key(orbit: Found) -> tuple[Any, ...]:
        problem = orbit.problem
        start = problem.start(orbit.solution.y)
        return -problem.kinds.count(STOP), problem.ends, problem.sequence, tuple(np.round(start, 9))

    return in_tied_order(orbits, lambda orbit: orbit.alpha, key, TIED)


@brief
@dataclass(frozen=True, eq=False)
class Discovery:
    """The orbits found at one energy.

    Parameters
    ----------
    system : ImpactSystem
    energy : float
    quarter_period : float
        Longest quarter period searched.
    impacts : int or None
        Most impacts in half a period; None: not bounded.
    ends : tuple of str
        Pairs of ends searched.
    orbits : list of Orbit
        By quarter period.
    unpolished : list of Unpolished
        Segments that were found but not solved.
    open : list of Opening
        Intervals of starts that are not decided.
    counts : dict of str to int
        Of each stage: ``starts`` followed; intervals ``split``, ``closed``, ``open``, ``resumed`` (as narrow as rounding, and
        scanned on from their image), ``at_grazing`` (as narrow as rounding) and ``over_budget``; ``grazings`` located; ``crossings``
        of far ends; ``repeated`` (k-fold covers, known from the start), ``polished``, ``unpolished``, ``inadmissible``,
        ``without_impacts``, ``covers``, ``duplicates``, ``one_sided`` (found from one of two ends alone), ``beyond_bounds``,
        ``orbits``.
    families : tuple of (str or None)
        The id of each orbit's family in a catalogue, None if it has none there. Empty without a catalogue.
    angles : (int, int) or ()
        With smooth forces: starts over half a turn of the two scans that compare neighbouring starts. They prove nothing.
    added : int
        Orbits that the second of these scans found, and the first one did not.
    """

    system: ImpactSystem
    energy: float
    quarter_period: float
    impacts: int | None
    ends: tuple[str, ...]
    orbits: list[Orbit]
    unpolished: list[Unpolished]
    open: list[Opening]
    counts: dict[str, int]
    families: tuple[str | None, ...] = ()
    angles: tuple[int, ...] = ()
    added: int = 0

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        closed = "complete" if self.complete else "not complete"
        title = f"Discovery at h = {self.energy:.10g}: {len(self.orbits)} orbits, {closed}"
        return title, [("orbits", listed([orbit.label or "-".join(orbit.ends) for orbit in self.orbits]))]

    @property
    def complete(self) -> bool:
        """Whether the scan decided all intervals, all segments were solved, and each orbit was found from both its ends. Never with smooth
        forces.

        Whether families followed from other energies add nothing can only be checked with a catalogue."""
        return not self.angles and is_complete(self.counts)
