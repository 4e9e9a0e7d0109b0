"""The full family of a branch that may be cut: it is followed past the cut ends, to find its id and its other pieces.

A branch can be cut by a range of energies, by a number of points, by a condition, or because only one side of a bifurcation was asked
for. Its family does not depend on that. Through a regular orbit with given ends and impact sequence there is one family only. So one orbit
identifies the family, if it does not depend on how the family was reached. A family ends where it grazes: its end of lowest energy (of
several, that with the smallest quarter period) identifies it. A family without an end closes on itself or on its image, or its energy has
no bound: its
orbit of lowest energy identifies it.

Ends are looked for at energies from 1e-3 to 1e5 times `energy_scale` of the system, of smooth motion up to 1e3 times it, whatever range was
asked for: a family that leaves this window is known by what is inside. A branch all above it is followed down into it.
"""

from __future__ import annotations

import hashlib
import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Generic, NamedTuple, TypeVar

import numpy as np

from branches.family import SETTINGS, Family
from branches.orbit import stacked
from branches.presentation import canonical_orbit, is_solved_as_it_is, pattern_of, symmetries
from branches.sequences import canonical_sequence, format_ends
from branches.solved_family import AdvancedSteps
from bvp.checks import read_only
from bvp.closures import cycle_of
from bvp.functions import exp, log
from bvp.multipoint import MultipointProblem, Solution
from bvp.orbits import RESULT_INDEX
from bvp.saddles import approached
from continuation.control import Settings
from continuation.problem import EndReason, PlainPoints, Point, Points
from continuation.run import Run, follow_both_ways

if TYPE_CHECKING:
    from branches.branch import Branch
    from bvp.system import ImpactSystem

__all__ = [
    "Course", "FamilyMark", "FullFamily", "Piece", "connected_part", "digests", "energy_scale", "full_family", "longest_course", "risen",
    "solutions_of",
]  # fmt: skip

Result = TypeVar("Result")

FINER = 4
"""How often steps are halved for a family that they leave at a branch point."""

PARTS = (0.5, 0.3, 0.8)
"""Points from which a family is followed again, as parts of its length."""

WIDE = replace(SETTINGS, maximum_step=0.05)
"""Settings for smooth families without impacts. They end where their flights do, not where they graze, and their points are not drawn."""

WINDOW = (1e-3, 1e5)
"""Energies, in units of `energy_scale`, at which a family's ends are looked for."""

_SMOOTH_WINDOW = (1e-3, 1e3)
"""The same for smooth motion without stops. No impact ends its families: they fold ever more often, the higher their energy."""

_INSIDE = 2.0
"""Energy inside that window to which a family below it is followed, as a multiple of the lowest."""

TIE = 1e-8
"""Relative difference of energies, and of quarter periods, below which they are equal."""

DIGITS = 6
"""Significant digits of the numbers in a family's hash."""

BORDER = 1e-9
"""Relative distance from a border of rounding within which both roundings name the family."""

ORDERS = {1: 8, 2: 2, 4: 1}
"""How many symmetries an orbit has at least, by the quarters of its period that are solved."""

_FOLD, _GUARDS = (0,), (2, 3, 4)
"""Places of the tests for folds and for grazing among the tests of a `Family`."""

_SLACK = 1e-3
"""Part by which limits are widened beyond the points of a coarse curve."""

_SHRUNK = 1e-6
"""A quarter period below this part of the family's largest is zero: bounces against a stop that presses at rest end in rest."""

_REACH = 1e-7
"""Arclength over which a located end is polished."""


class Piece(NamedTuple):
    """Another part of a cut family inside the same range of energies: (h, alpha) of its first and its last orbit."""

    first: tuple[float, float]
    last: tuple[float, float]


class FamilyMark(NamedTuple):
    """An orbit of a family that identifies it: what kind of point it is, and numbers that no presentation changes.

    kind: "GR", "SN" or "EP". h: energy. alpha: quarter period. pattern: `branches.presentation.pattern_of` of the impacts in the
    period. At the grazing of a linear mode many families begin with one energy and one period, and only their patterns differ.
    """

    kind: str
    h: float
    alpha: float
    pattern: float


@dataclass(frozen=True)
class FullFamily:
    """A full family, found by following a branch past its cut ends.

    Parameters
    ----------
    ids : tuple of str
        Its id. There are several if a number of its hash is at a border of rounding; each of them names the family.
    marks : tuple of FamilyMark
        The orbits that identify it; several if they are equal within their errors.
    closed : bool
    others : tuple of Piece
        The other pieces into which the branch's range of energies cuts the family.
    h, alpha : (m,) float
        Energies and quarter periods along the full family.
    """

    ids: tuple[str, ...]
    marks: tuple[FamilyMark, ...]
    closed: bool
    others: tuple[Piece, ...]
    h: np.ndarray
    alpha: np.ndarray

    def reach(self, energy: tuple[float, float], quarter_period: float) -> tuple[tuple[float, float], float] | None:
        """The energies and the longest quarter period within which the family hangs together, where it leaves those given and comes back
        into them; None where it is in one piece."""
        inside = (self.h >= energy[0]) & (self.h <= energy[1]) & (self.alpha <= quarter_period)
        part = connected_part(inside, self.closed)
        if part is None:
            return None
        h, alpha = self.h[part], self.alpha[part]
        low, high = min(energy[0], float(h.min()) * (1.0 - _SLACK)), max(energy[1], float(h.max()) * (1.0 + _SLACK))
        return (low, high), max(quarter_period, float(alpha.max()) * (1.0 + _SLACK))

    def cut_text(self) -> str:
        """That a range of energies cut the family into pieces, and where the others are; empty where it did not."""
        if not self.others:
            return ""
        places = "; ".join(
            f"from h = {piece.first[0]:.6g}, alpha = {piece.first[1]:.6g} to h = {piece.last[0]:.6g}, alpha = {piece.last[1]:.6g}"
            for piece in self.others
        )
        return f"the range of energies cuts {self.ids[0]} into {len(self.others) + 1} pieces; not followed: {places}"


def connected_part(inside: np.ndarray, closed: bool) -> slice | None:
    """The points of a curve from the first one in a range to the last one; None if the range does not cut it between them. inside (m,): of
    each point, whether it is in the range."""
    places = np.flatnonzero(inside)
    if not places.size or np.all(inside[places[0] : places[-1] + 1]):
        return None
    # A closed family may begin inside: its last piece then continues in the first.
    if closed and np.sum(inside & ~np.roll(inside, 1)) < 2:
        return None
    return slice(places[0], places[-1] + 1)


def energy_scale(system: ImpactSystem) -> float:
    """Order of magnitude of the energies at which impacts begin.

    It is the energy of a stop's effective mass that oscillates through its gap in the fastest mode, the largest of all stops. It is 1 if
    no mode has a frequency, or no stop a finite gap."""
    modes = system.modes
    size = np.sum(modes.contacts.gap[:, : system.degrees_of_freedom] ** 2, axis=1)
    scales = 0.5 * float(np.max(modes.squares)) * modes.contacts.bound**2 / size
    return float(np.max(scales, initial=0.0)) or 1.0


class Course(NamedTuple, Generic[Result]):
    """A run along a family, or the branch of one, as `longest_course` compares them.

    result: a run or a branch. arclength (N,): of its points. unknowns: index of a point -> its unknowns. stuck: whether the corrector
    failed at an end.
    """

    result: Result
    arclength: np.ndarray
    unknowns: Callable[[int], np.ndarray]
    stuck: bool

    @property
    def length(self) -> float:
        """Arclength of the last point."""
        return float(self.arclength[-1]) if len(self.arclength) else 0.0


def longest_course(
    problem: MultipointProblem, follow: Callable[[np.ndarray, Settings], Course[Result]], y: np.ndarray, settings: Settings
) -> Course[Result]:
    """The longest run along the family of an orbit.

    Beside a branch point the equations are nearly singular, and a run can get stuck there or go over to the other family. A stuck run is
    followed again from elsewhere, so that its steps avoid the branch point. After a jump the steps are made finer. Both families can leave
    their branch point nearly in one direction, but their orbits differ in their symmetries.
    """

    def jumped(course: Course[Result]) -> bool:
        last = len(course.arclength) - 1
        if last <= 2 or any(approached(problem, course.unknowns(i)) is not None for i in (1, last - 1)):
            return False  # beside a saddle rounding decides the symmetries
        first, final = (_order(problem, course.unknowns(i)) for i in (1, last - 1))
        return first != final

    def fine(start: np.ndarray) -> tuple[Course[Result], bool]:
        steps, course = settings, follow(start, settings)
        for _ in range(FINER):
            if not jumped(course):
                return course, False
            halves = {name: 0.5 * getattr(steps, name) for name in ("initial_step", "maximum_step", "target_turn")}
            steps = replace(steps, **halves)
            course = follow(start, steps)
        return course, jumped(course)

    best, failed = fine(y)
    for part in PARTS:
        if not (best.stuck or failed):
            break
        place = int(np.argmin(np.abs(best.arclength - part * best.length)))
        other, other_failed = fine(best.unknowns(place))
        if (-1.0 if other_failed else other.length) > (-1.0 if failed else best.length):
            best, failed = other, other_failed
    return best


def _order(problem: MultipointProblem, y: np.ndarray) -> int:
    """How many symmetries an orbit has. A long smooth flight loses digits, but the symmetries of its ends remain."""
    found = symmetries(cycle_of(problem, y)).order
    return max(found, ORDERS[problem.quarters]) if problem.is_smooth else found


def solutions_of(points: Sequence[Point]) -> Solution:
    """The solutions of a run's points, stacked; no `Point` is made of the steps of a block."""
    parts = []
    for piece in points.pieces if isinstance(points, Points) else [list(points)]:
        if isinstance(piece, PlainPoints) and isinstance(piece.steps, AdvancedSteps):
            parts.append(Solution(*piece.steps.block[:5]))
        else:
            parts.append(stacked([point.step.extra for point in piece]))
    names = ("y", "tangent", "position", "ends", "result")
    return parts[0] if len(parts) == 1 else Solution(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


class _Curve(NamedTuple):
    """A family inside the window: energies and quarter periods along it, the orbits at its grazing ends and folds, and those at the
    other ends; `start`: place of the orbit that it was followed from."""

    h: np.ndarray
    alpha: np.ndarray
    grazing: list[np.ndarray]
    folds: list[np.ndarray]
    cuts: list[np.ndarray]
    closed: bool
    start: int


def full_family(branch: Branch, wider: Branch | None = None) -> FullFamily:
    """Follow a branch's family on where it was cut, and identify it; `wider` is a wider branch of the family, from the same orbit.

    A branch of orbits that are another orbit run through several times, or half an orbit with half-period symmetry, is identified as the
    family of that orbit.
    """
    scale = energy_scale(branch.problem.system)
    lowest = float(branch.points["h"].min())
    smooth = not branch.problem.system.stops
    # A branch that is all above the window is followed down into it. Smooth ones can be below it, too: they are followed up.
    low, high = (bound * scale for bound in (_SMOOTH_WINDOW if smooth else WINDOW))
    window = (low, high if lowest < high else 2.0 * lowest)
    beginning = low if smooth and branch.points["h"].max() > low else 0.0
    located = {event.point for event in branch.events}
    plain = [i for i in range(len(branch.points["h"])) if i not in located] or range(len(branch.points["h"]))
    inside = [i for i in plain if beginning <= branch.points["h"][i] < window[1]] or [int(np.argmin(branch.points["h"]))]
    if smooth:
        # Of several pieces inside the window, that of lowest energy identifies the family.
        outside = np.flatnonzero((branch.points["h"] < beginning) | (branch.points["h"] >= window[1]))
        least = min(inside, key=lambda i: float(branch.points["h"][i]))
        after, before = max(outside[outside < least], default=-1), min(outside[outside > least], default=len(branch))
        inside = [i for i in inside if after < i < before]
    problem, length = branch.problem, branch.points["arclength"]
    middle = min(inside, key=lambda i: abs(float(length[i]) - 0.5 * float(length[inside[0]] + length[inside[-1]])))
    # Two orbits are tested, since one orbit at a bifurcation has more symmetry than its family.
    tested = [branch.orbit(i).solution.y for i in (inside[len(inside) // 3], middle)]
    y = tested[1]
    if not any(is_solved_as_it_is(problem, y) for y in tested):
        problem, y = canonical_orbit(problem, y)
    if smooth and problem.energy(y) < low:
        above = risen(problem, y, _INSIDE * low)[0]
        y = y if above is None else above
    uncut = (_known(one, _states(branch)[branch.start], window) for one in (branch, wider) if one is not None and problem is one.problem)
    curve = next((one for one in uncut if one is not None), None)
    # If the family leaves the window, its other pieces are measured on what is followed inside, whichever branch of it is known.
    if curve is None or (not curve.closed and len(curve.grazing) < 2 and _others(curve, branch.energy)):
        if problem.periodic and not smooth and is_solved_as_it_is(problem, y):
            # From some impacts of a period a run gets stuck, from others it does not: the id is of one start.
            problem, y = canonical_orbit(problem, y)
        curve = _followed(problem, y, window)
    marks = _marks(Family(problem, window, ends_only=True), curve)
    sequence, ends = canonical_sequence(problem.sequence, problem.ends, odd_symmetry=branch.problem.system.has_odd_symmetry)
    ids = tuple(f"{format_ends(ends)}:{''.join(sequence)}:{digest}" for digest in digests(marks))
    return FullFamily(ids, marks, curve.closed, _others(curve, branch.energy), read_only(curve.h), read_only(curve.alpha))


def risen(problem: MultipointProblem, y: np.ndarray, energy: float) -> tuple[np.ndarray | None, str]:
    """The first orbit of an energy on the family of an orbit with less, as the energy rises; None and the reason if there is none."""
    run = follow_both_ways(Family(problem, (0.5 * problem.energy(y), energy), ends_only=True), y, WIDE, both=False)
    last = run.points[-1].step.y if run.points else y
    if problem.energy(last) > energy * (1.0 - TIE):
        return last, ""
    highest = max((problem.energy(point.step.y) for point in run.points), default=problem.energy(y))
    saddle = approached(problem, last)
    why = run.ends[1].text if saddle is None else f"there is no turning point beyond {saddle}"
    return None, f"comes up to h = {highest:.6g} ({why})"


def _states(branch: Branch) -> np.ndarray:
    """Where the orbits of a branch begin, and their quarter periods, (m, 2 n + 1)."""
    return np.column_stack([branch.points["start_u"], branch.points["start_v"], branch.points["alpha"]])


def _nearest(rows: np.ndarray, row: np.ndarray) -> int:
    """The row that is nearest to another one, each column in units of its largest value."""
    return int(np.argmin(np.sum(((rows - row) / np.maximum(np.max(np.abs(rows), axis=0), np.finfo(float).tiny)) ** 2, axis=1)))


def _known(branch: Branch, state: np.ndarray, window: tuple[float, float]) -> _Curve | None:
    """The family around an orbit of a branch, a row of `_states`, that was not cut inside the window. None where it was, and where only
    the bound of the window marks it."""
    h, alpha, closed = branch.points["h"], branch.points["alpha"], branch.is_closed
    start = _nearest(_states(branch), state)
    outside = np.flatnonzero((h < window[0]) | (h > window[1]))
    if start in outside or (closed and outside.size):
        return None
    first, last = max(outside[outside < start], default=-1) + 1, min(outside[outside > start], default=len(h)) - 1
    events = [event for event in branch.events if first <= event.point <= last]
    grazing = []
    for at, border, ended in ((first, 0, branch.ended[0]), (last, len(h) - 1, branch.ended[1])):
        if ended.reason == "EVENT" and any(event.type == "GR" and event.point == at == border for event in events):
            grazing.append(branch.orbit(at).solution.y)
        elif at == border and not closed:
            return None
    folds = [branch.orbit(event.point).solution.y for event in events if event.type == "SN"]
    if (outside.size or closed) and not grazing and not folds:
        return None
    part = slice(first, last + 1)
    return _Curve(h[part], alpha[part], grazing, folds, [], closed, start - first)


def _followed(problem: MultipointProblem, y: np.ndarray, window: tuple[float, float]) -> _Curve:
    """The family of an orbit, both ways, through the window.

    One that cannot be followed is known by the orbit alone.
    """
    family = Family(problem, window, ends_only=True)

    def follow(start: np.ndarray, settings: Settings) -> Course[Run]:
        run = follow_both_ways(family, start, settings)
        outwards = -2.0 * settings.minimum_step, 2.0 * settings.minimum_step
        stuck = bool(run.points) and any(
            end.reason is EndReason.MINIMUM_STEP
            and not family.why_not_flown(*run.points[place].step[1:3], ds)
            and approached(problem, run.points[place].step.y) is None
            for place, ds, end in zip((0, -1), outwards, run.ends, strict=True)
        )
        return Course(run, run.points.arclengths(), lambda i: run.points[i].step.y, stuck)

    # Impacting families have the settings of branches, so that both have the same ends.
    run = longest_course(problem, follow, y, WIDE if problem.is_smooth and not problem.system.stops else SETTINGS).result
    if not run.points:
        return _Curve(np.array([problem.energy(y)]), np.array([problem.quarter_period(y)]), [], [], [y], False, 0)
    grazing: list[np.ndarray] = []
    cuts: list[np.ndarray] = []
    closed = run.closed or all(end.reason is EndReason.IMAGE for end in run.ends)
    for point, end in zip((run.points[0], run.points[-1]), run.ends, strict=True):
        if not closed:
            certain = end.reason is EndReason.EVENT and point.event is not None and point.event.code == "GR"
            (grazing if certain else cuts).append(point.step.y)
    folds = [event.point.y for event in run.events if event.code == "SN"]
    found = solutions_of(run.points)
    h, alpha = found.result[:, RESULT_INDEX["energy"]], found.result[:, RESULT_INDEX["quarter_period"]]
    if closed and not folds:
        # It turns around in h at orbits of higher symmetry, and is its own image beyond them.
        met = [event.point.y for event in run.events] or [run.points[int(np.argmin(h))].step.y]
        cuts = [min(met, key=problem.energy)]
    # A run that got stuck was followed again from another orbit.
    return _Curve(h, alpha, grazing, folds, cuts, closed, _nearest(found.y, y))


def _marks(family: Family, curve: _Curve) -> tuple[FamilyMark, ...]:
    """What identifies the family: the lowest of its ends, else of its folds, else of where it leaves the window."""
    problem = family.problem
    kind, orbits, tests = ("GR", curve.grazing, _GUARDS) if curve.grazing else ("SN", curve.folds, _FOLD)
    if orbits:
        # Polishing moves log h by no more than `_REACH`.
        highest = min(map(problem.energy, orbits)) * (1.0 + 10.0 * _REACH)
        orbits = [_polished(family, y, tests) for y in orbits if problem.energy(y) <= highest]
    else:
        kind, orbits = "EP", curve.cuts
    marks = []
    for y in orbits:
        cycle = cycle_of(problem, y)
        pattern = pattern_of(problem.system, cycle.times / cycle.period, cycle.contact)
        alpha = problem.quarter_period(y)
        marks.append(FamilyMark(kind, problem.energy(y), alpha if alpha > _SHRUNK * np.max(curve.alpha) else 0.0, pattern))
    for name in ("h", "alpha", "pattern"):
        # Marks that are equal within their error cannot be ordered, so all of them are kept.
        least = min(getattr(mark, name) for mark in marks)
        marks = [mark for mark in marks if getattr(mark, name) <= least * (1.0 + TIE)]
    return tuple(sorted(marks))


def digests(marks: Iterable[FamilyMark]) -> tuple[str, ...]:
    """Hashes that name a family with these marks, the proper one first.

    The numbers of the first mark are rounded to six digits and hashed. Rounding has borders, wherever one puts them: a number within
    1e-9 of one has both roundings, and each of the hashes that come of that, and those of further marks, names the family too.
    """
    out: dict[str, None] = {}
    for mark in marks:
        numbers = mark[1:]
        texts = [dict.fromkeys(f"{number * (1.0 + shift):.{DIGITS - 1}e}" for shift in (0.0, -BORDER, BORDER)) for number in numbers]
        for parts in itertools.product(*texts):
            text = ":".join((mark.kind, *parts))
            out[hashlib.sha256(text.encode()).hexdigest()[:8]] = None
    return tuple(out)


def _polished(family: Family, y: np.ndarray, tests: tuple[int, ...]) -> np.ndarray:
    """Move a located orbit to the nearest zero of one of the test functions, more accurately than its location.

    The numbers of two runs then agree to rounding, not only to the tolerance of location.
    """
    here = family.begin(y)
    if not here.converged:
        return y
    nearby = [(s, family.step(here.y, here.tangent, s)) for s in (_REACH, -_REACH)]
    zeros = []
    for index in tests:
        # Both sides of a fold are orbits; one of grazing.
        values = [(step.tests[index], s) for s, step in nearby if step.converged and math.isfinite(step.tests[index])]
        if values and max(values)[0] != here.tests[index]:
            value, s = max(values)
            zeros.append(-here.tests[index] * s / (value - here.tests[index]))
    if not zeros or abs(min(zeros, key=abs)) > _REACH:
        return y
    there = family.step(here.y, here.tangent, min(zeros, key=abs))
    return there.y if there.converged else y


def _others(curve: _Curve, energies: tuple[float, float]) -> tuple[Piece, ...]:
    """The pieces of the family inside a range of energies, except the piece where the branch started."""
    # Places along the curve, counted in points, where it crosses a bound; between two of them it is inside or outside.
    level = log(curve.h)
    low, high = (log(bound) if 0.0 < bound < math.inf else math.copysign(math.inf, bound - 1.0) for bound in energies)
    places = [0.0, float(len(level) - 1)]
    for bound in (low, high):
        if math.isfinite(bound):
            height = level - bound
            at = np.flatnonzero((height[:-1] > 0.0) != (height[1:] > 0.0))
            places += list(at + height[at] / (height[at] - height[at + 1]))
    places = sorted(places)
    index = np.arange(len(level))

    def orbit(place: float) -> tuple[float, float]:
        return float(exp(np.interp(place, index, level))), float(np.interp(place, index, curve.alpha))

    runs = [(a, b) for a, b in itertools.pairwise(places) if b > a and low <= np.interp(0.5 * (a + b), index, level) <= high]
    if curve.closed and len(runs) > 1 and runs[0][0] == 0.0 and runs[-1][1] == places[-1]:
        runs = [(runs[-1][0], runs[0][1]), *runs[1:-1]]

    def away(run: tuple[float, float]) -> float:
        """How far the start is from a piece, which may lie between two points of the curve."""
        before, after = run[0] - curve.start, curve.start - run[1]
        return max(before, after) if run[0] <= run[1] else min(before, after)

    own = min(runs, key=away, default=None)
    return tuple(Piece(orbit(first), orbit(last)) for first, last in runs if (first, last) != own)
