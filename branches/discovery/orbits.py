"""From passages of a scan to orbits: each is solved as its multipoint problem and kept once, or listed with what is known of it."""

from __future__ import annotations

import threading
from collections import Counter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from branches.discovery.found import Found, labelled, objection
from branches.discovery.scan import Passage
from branches.discovery.starts import Curve, Path
from branches.identity import same_segment
from branches.words import canonical, format_word, impacts_per_period, mirror, mirror_ends, unfold
from bvp.multipoint import MultipointProblem, NotConverged

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["Collector", "Unpolished", "first_passages", "is_one_sided", "preference"]

SAME_START = 1e-11
"""Starts nearer to each other than this, relative to the curve, are one start: what it passes later, it repeats."""

SAME_STATE = 1e-8
"""States of two solutions nearer to each other than this, relative to their size, are one orbit's."""

MOVED = 1e-6
"""How far Newton's method may move the start of a passage, relative to its size, before it counts as another orbit's."""

MOST_PROBLEMS = 1000
"""Problems kept from one search to the next: some twenty kilobytes each."""


class Unpolished(NamedTuple):
    """A passage that was found and is no solution yet: what is known of it, and why."""

    ends: tuple[str, str]
    word: str
    parameter: float
    alpha: float
    miss: float
    reason: str


def first_passages(
    passages: list[Passage], instants: list[float], words: list[tuple[str, ...]], start: str, span: float
) -> tuple[list[int], list[int]]:
    """Which passages are the first of their start, and which repeat it: multiples of the first segment, with the impacts of that.

    Parameters
    ----------
    passages : list of Passage
        Of one curve.
    instants : list of float
        Time from the start to each.
    words : list of tuple of str
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
    order = sorted(range(len(passages)), key=lambda i: passages[i].parameter)
    groups: list[list[int]] = []
    for i in order:
        near = groups and passages[i].parameter - passages[groups[-1][-1]].parameter <= SAME_START * span
        if near and passages[i].converged and passages[groups[-1][-1]].converged:
            groups[-1].append(i)
        else:
            groups.append([i])
    for group in groups:
        group.sort(key=lambda i: instants[i])
        kept: list[int] = []
        for i in group:
            if any(_repeats(instants[i], words[i], passages[j].kind, instants[j], words[j], start) for j in kept):
                repeated.append(i)
            else:
                kept.append(i)
        first += kept
    return sorted(first), repeated


def _repeats(instant: float, word: tuple[str, ...], far: str, period: float, first: tuple[str, ...], start: str) -> bool:
    """Whether a passage is the first one again, after several segments between the start and that far end.

    The times alone do not tell: where motions part fast, orbits with other words have the same start and time within rounding."""
    turns = round(instant / period)
    if turns < 2 or abs(instant - turns * period) > 1e-6 * period:
        return False
    inner, end = (first[:-1], far + first[-1]) if far == "stop" else (first, far)
    expected = unfold(inner, (start, end), turns)[0]
    return word[: len(expected)] == expected and len(word) - len(expected) in (0, 1)


_Problems = dict[tuple[tuple[str, str], tuple[str, ...]], MultipointProblem]


class _Kept(threading.local):
    """The problems of the system that was searched last: neighbouring energies have the same words. Each thread has its own, for problems
    hold scratch arrays."""

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

    def problem(self, ends: tuple[str, str], word: tuple[str, ...]) -> MultipointProblem:
        """The multipoint problem with these ends and word, made once."""
        if (ends, word) not in self.problems:
            self.problems[ends, word] = MultipointProblem(self.system, ends, word)
        return self.problems[ends, word]

    def add(self, curve: Curve, passage: Passage, path: Path) -> None:
        """Solve a passage of a curve, the path of whose start is given, and sort it in."""
        letters = self.system.modes.contact_letters
        word = tuple(letters[c] for c in path.contacts[: passage.impacts])
        far = passage.kind
        if far == "stop":
            if len(path.contacts) <= passage.impacts:
                self._set_aside(curve, (curve.end, "stop+"), word, passage, path, "its last impact was not found again")
                return
            far += letters[path.contacts[passage.impacts]]
        ends = (curve.end, far)
        sign = 1.0
        if self.system.has_odd_symmetry and (mirror_ends(ends), mirror(word)) < (ends, word):
            ends, word, sign = mirror_ends(ends), mirror(word), -1.0
        if len(path.nodes) < passage.impacts:
            self._set_aside(curve, ends, word, passage, path, "its impacts were not found again")
            return
        problem = self.problem(ends, word)
        y = problem.pack(sign * path.start, sign * path.nodes, np.append(path.durations, passage.flight))
        try:
            solution = problem.solve(y, energy=self.energy)
        except NotConverged as error:
            self._set_aside(curve, ends, word, passage, path, str(error))
            return
        moved = float(np.max(np.abs(problem.start(solution.y) - sign * path.start)))
        if moved > MOVED * float(np.max(np.abs(path.start))):
            self._set_aside(curve, ends, word, passage, path, "Newton's method moved away from it")
            return
        why = objection(problem, solution)
        if why == "inadmissible" and not solution["residual"] < 1e-12:
            self._set_aside(curve, ends, word, passage, path, f"its residual stays at {solution['residual']:.1e}")
            return
        if why == "inadmissible" and min(solution["clearance"], solution["speed"]) > -1e-12:
            self._set_aside(curve, ends, word, passage, path, "it grazes a stop within rounding")
            return
        if why is not None:
            self.counts[why] += 1
            return
        self.counts["polished"] += 1
        orbit = labelled(problem, solution)
        key = canonical(word, ends, odd_symmetry=self.system.has_odd_symmetry)
        same = self.found.setdefault(key, [])
        for images in same:
            if any(is_same(orbit, other) for other in images):
                self.counts["duplicates"] += 1
                if not any(is_again(problem, sign * path.start, other) for other in images):
                    images.append(orbit)
                return
        same.append([orbit])

    def _set_aside(
        self, curve: Curve, ends: tuple[str, str], word: tuple[str, ...], passage: Passage, path: Path, reason: str
    ) -> None:
        time = path.until_last + passage.flight
        quarters = 1 if (ends[0] == "origin") != (ends[1] == "origin") else 2
        self.counts["unpolished"] += 1
        angle = curve.angle(passage.parameter)
        self.unpolished.append(Unpolished(ends, format_word(word), angle, time / quarters, passage.miss, reason))

    def within(self, quarter_period: float, impacts: int | None) -> list[list[Found]]:
        """The orbits within bounds of quarter period and impacts in half a period: each with all the solutions that are images of it."""
        return [
            images
            for group in self.found.values()
            for images in group
            if images[0].alpha <= quarter_period * (1.0 + 1e-12)
            and (impacts is None or impacts_per_period(images[0].problem.word, images[0].problem.ends) <= 2 * impacts)
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
    """Which image of an orbit is listed: the label with p <= q, then the first word, then the first start."""
    label = orbit.label
    crossed = label is not None and label.p is not None and label.q is not None and label.p > label.q
    start = orbit.problem.start(orbit.solution.y)
    return crossed, orbit.problem.ends, orbit.problem.word, tuple(np.round(-start, 9))


def is_same(orbit: Found, other: Found) -> bool:
    """Whether two solutions are one orbit. Their quarter periods are compared first: that is cheap, and tells most orbits apart."""
    if abs(orbit.alpha / other.alpha - 1.0) > SAME_STATE:
        return False
    return same_segment((orbit.problem, orbit.solution.y), (other.problem, other.solution.y), SAME_STATE)
