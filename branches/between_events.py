"""Checks of a branch between its events: the stability of its points, and events that were missed.

A decided orbit between two neighbouring events decides those around it. Where rounding leaves many neighbouring orbits undecided, an
entry of their half maps is nearly zero, and an event among them could not be located either. Some of these orbits are solved in fifty
digits (`bvp.many_digits`).

A level that the trace crosses between two points needs an event there, and so does a turning point of the energy. Where an event lies
between two points, the value is expected on the other side of the level; elsewhere on the same side. So a crossing without an event is
seen, and also two crossings of which only one has an event.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache
from itertools import pairwise
from math import sqrt
from time import perf_counter
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from branches.events import BranchEvent, DigitWork
from branches.family import RESONANCES, multiplication
from branches.orbit import FAR as FAR_OUT
from bvp.multipoint import MultipointProblem, NotConverged
from bvp.stability import roundings

if TYPE_CHECKING:
    from branches.branch import Branch

__all__ = ["Barrier", "Missed", "decide_between", "missed_events", "stability_events", "stable_at_event"]

UNDECIDED_AT = ("SN", "BP", "SB", "PD")
"""Events at which a multiplier is at its bound. Only the location error would decide stability there, so it is not given."""

SPACING = 4
"""At most so many neighbouring points are decided by those around them: on a longer run of undecided points rounding can hide an event."""

NEAR = 1e-9
"""Difference of the trace from a level below which its side is left open."""

FAR = 1.0
"""Difference of the trace from +2 or -2 beyond which its side is known where stability is undecided."""


class Barrier(NamedTuple):
    """An event that can change stability: its type, the index of its point, and the arclengths between which it certainly is."""

    type: str
    point: int
    bracket: tuple[float, float]


def stable_at_event(code: str, columns: Mapping[str, np.ndarray], index: int) -> int:
    """Whether the orbit at an event, a row of the columns of a branch, is stable (1), unstable (0), or undecided (-1): with another
    multiplier far from the unit circle it is unstable."""
    known = int(columns["stable"][index])
    unstable = known == 0 and bool(np.any(np.abs(columns["multipliers"][index]) > FAR_OUT))
    return -1 if code in UNDECIDED_AT and not unstable else known


def stability_events(problem: MultipointProblem) -> tuple[str, ...]:
    """Types of the events at which the stability of a family can change.

    Two reversals a quarter period apart: the period doubles at tau_half = 0, inside the interval -2 < tau_half < 2 of the stable orbits.
    """
    doubling = () if problem.quarters == 1 else ("PD",)
    return ("SN", "BP", "SB", "NS", *doubling)


def decide_between(
    problem: MultipointProblem,
    orbit: Callable[[int], tuple[MultipointProblem, np.ndarray]],
    points: Mapping[str, np.ndarray],
    barriers: Iterable[Barrier],
) -> tuple[np.ndarray, DigitWork]:
    """Stability of all points of a branch between its events.

    Parameters
    ----------
    problem : MultipointProblem
        Its closure.
    orbit : callable
        Index of a point -> the problem and the unknowns of its orbit.
    points : mapping of str to ndarray
        Columns: stable, arclength, multipliers (see `branches.branch.Branch`).
    barriers : iterable of Barrier
        The events of the branch; those that cannot change stability have no effect.

    Returns
    -------
    stable : (N,) int8
        1 stable, 0 unstable, -1 undecided: at an event, inside its bracket, where an impact grazes, and in an interval in which no orbit is
        decided in fifty digits either, as for a multiplier that is 1 along all of the family.
    work : DigitWork

    Notes
    -----
    At a fold the only pair of multipliers of two degrees of freedom passes 1. So an interval beside it in which no orbit is decided, as
    between a fold and a branch point that nearly coincide, has the opposite stability.

    Between two neighbouring points of one interval that differ in fifty digits too an event was missed: `missed_events` reports it.
    """
    stable, arclength = points["stable"].copy(), points["arclength"]
    kinds = stability_events(problem)
    events = [barrier for barrier in barriers if barrier.type in kinds]
    free = np.isfinite(points["multipliers"]).all(axis=1)
    for _, point, (low, high) in events:
        free[point] = False
        free &= (arclength < low) | (arclength > high)
    cuts = sorted({event.point for event in events})
    limits = arclength[sorted({0, len(arclength) - 1, *cuts})]
    interval = np.searchsorted(cuts, np.arange(len(stable)))
    seconds: list[float] = []

    @cache
    def solve(i: int) -> int:
        began = perf_counter()
        found = _in_digits(*orbit(i), float(np.min(np.abs(arclength[i] - limits))))
        seconds.append(perf_counter() - began)
        return found

    for number in np.unique(interval[free]):
        members = np.flatnonzero(free & (interval == number))
        decided = set(stable[members].tolist()) - {-1}
        if len(decided) == 1 and np.all(stable[members] >= 0):
            continue
        if not decided:
            apart = np.min(np.abs(arclength[members][:, None] - limits), axis=1)
            farthest = members[np.argmax(apart)]
            stable[farthest] = solve(int(farthest))
        _fill(stable, members.tolist(), solve)
        _agree(stable, members.tolist(), solve)
    if problem.half == 2:
        for fold in (event.point for event in events if event.type == "SN"):
            number = int(interval[fold])
            sides = [np.flatnonzero(free & (interval == side)) for side in (number, number + 1)]
            known = [set(stable[members].tolist()) for members in sides]
            for members, own, other in zip(sides, known, known[::-1], strict=True):
                if own == {-1} and other in ({0}, {1}):
                    stable[members] = 1 - other.pop()
    return stable, DigitWork(len(seconds), sum(seconds))


def _agree(stable: np.ndarray, members: list[int], solve: Callable[[int], int]) -> None:
    """Solve neighbours with opposite stability in an interval without an event again in fifty digits.

    Near a branch point the error of an orbit can exceed its estimate in double precision."""
    solved = set[int]()
    while uncertain := {k for i, j in pairwise(members) if {stable[i], stable[j]} == {0, 1} for k in (i, j)} - solved:
        for k in sorted(uncertain):
            found = solve(k)
            stable[k] = found if found >= 0 else stable[k]
        solved |= uncertain


def _fill(stable: np.ndarray, members: list[int], solve: Callable[[int], int]) -> None:
    """Decide all points of an interval without an event, of which some are decided; `solve` decides others in fifty digits."""

    def ask(first: int, last: int) -> None:
        """Solve some of the members between two others, until those left follow from them."""
        known = {stable[members[k]] for k in (first, last)} - {-1}
        left = last - first - 1
        if not left or not known or (left <= SPACING and len(known) == 1):
            return
        middle = (first + last) // 2
        stable[members[middle]] = solve(members[middle])
        ask(first, middle)
        ask(middle, last)

    # An event that was missed next to an end of the interval is seen from there.
    if np.any(stable[members] >= 0):
        for end in (members[0], members[-1]):
            stable[end] = solve(end) if stable[end] < 0 else stable[end]
    for first, last in pairwise([k for k, i in enumerate(members) if stable[i] >= 0 or k in (0, len(members) - 1)]):
        ask(first, last)
    known = np.flatnonzero(stable[members] >= 0)
    if known.size:
        nearest = [int(known[np.argmin(np.abs(known - k))]) for k in range(len(members))]
        stable[members] = stable[members][nearest]


def _in_digits(problem: MultipointProblem, y: np.ndarray, distance: float) -> int:
    """Stability of an orbit in fifty digits: 1, 0, or -1 where it is not decided; `distance`: arclength to the next event."""
    from bvp.many_digits import orbit_in_digits

    if problem.is_smooth:
        return -1  # only linear flights are computed in many digits
    try:
        orbit = orbit_in_digits(problem, y)
    except ArithmeticError:
        return -1
    # Beside a branch point the nearest orbit can lie beyond the event.
    return -1 if orbit.stable is None or not orbit.moved < distance else int(orbit.stable)


class Missed(NamedTuple):
    """Two points of a branch between which an event is missed.

    types: of the events that would explain it. points: indices of the two points, between which the other points leave the side open.
    text: what was found. hidden: whether rounding hides the event, as double precision decides the
    stability of neither orbit. It was seen in fifty digits, and cannot be located.
    """

    types: tuple[str, ...]
    points: tuple[int, int]
    text: str
    hidden: bool = False


class _Level(NamedTuple):
    """A level of the trace, for example +2.

    name: a text. side: +1 for each point above the level, -1 below, 0 undecided. events: where the trace crosses the level. touching: types
    of events at which the trace can also touch the level and turn back. types: types of the events at a crossing. limit: whether the level
    is a limit of stability."""

    name: str
    side: np.ndarray
    events: list[BranchEvent]
    touching: tuple[str, ...]
    types: tuple[str, ...]
    limit: bool = True


def missed_events(branch: Branch) -> list[Missed]:
    """Events that a branch lacks although its points show a crossing.

    Returns
    -------
    list of Missed
        In order of arclength; empty where every crossing has its event.

    Notes
    -----
    The trace is tau_half if the branch has it, else tau. Its levels are +2, -2, the levels of the resonances and, for tau_half, 0 (period
    doubling). The stability of a point, which is decided beyond its error, gives the side of +2 and -2. A system of more than two degrees
    of freedom has several traces. There only changes of stability are checked.
    """
    found = [missed for level in _levels(branch) for missed in _crossings(branch, level)]
    return sorted([*found, *_turning_points(branch)], key=lambda missed: missed.points)


def _levels(branch: Branch) -> Iterator[_Level]:
    points, events = branch.points, branch.events
    stable = points["stable"]
    quarter = branch.problem.quarters == 1
    name = "tau_half" if quarter else "tau"
    trace = points[name]
    if branch.problem.half != 2:
        types = stability_events(branch.problem)
        side = np.where(stable == 1, -1, np.where(stable == 0, 1, 0))
        yield _Level("the limit of stability", side, [event for event in events if event.type in types], types, types)
        return

    def near(event: BranchEvent, value: float) -> bool:
        # An event of tau is one of two levels of tau_half; where the trace is not known, of either.
        there = trace[event.point]
        return not quarter or not (there * value < 0.0)

    with np.errstate(invalid="ignore"):
        upper = np.where((stable == 0) & (trace > 0.0), 1, -1)
        lower = np.where((stable == 0) & (trace < 0.0), -1, 1)
        upper = np.where((stable >= 0) | (trace < 2.0 - FAR), upper, 0)
        lower = np.where((stable >= 0) | (trace > FAR - 2.0), lower, 0)
    halved = [event for event in events if event.type == "SB" and quarter and event.breaks != "reversal"]
    broken = [event for event in events if event.type == "SB" and event not in halved]
    folds = [event for event in events if event.type in ("SN", "BP")]
    doubled = [event for event in events if event.type == "PD"]
    yield _Level(f"{name} = +2", upper, folds + broken, ("BP",), ("SN", "BP", "SB"))
    turning = ("PD",) if branch.problem.periodic else ()
    yield _Level(f"{name} = -2", lower, halved if quarter else doubled, turning, ("SB",) if quarter else ("PD",))
    values = [(0.0, doubled, "PD")] if quarter else []
    for p, q in RESONANCES:
        tau = multiplication(p, q)
        resonant = [event for event in events if event.type == "RT" and event.p_q == [p, q]]
        for value in (sqrt(2.0 + tau), -sqrt(2.0 + tau)) if quarter else (tau,):
            values.append((value, [event for event in resonant if near(event, value)], f"RT {p}:{q}"))
    for value, some, text in values:
        with np.errstate(invalid="ignore"):
            side = np.where(np.abs(trace - value) > NEAR, np.sign(trace - value), 0.0)
        yield _Level(f"{name} = {round(value, 6) + 0.0:g} ({text})", np.nan_to_num(side).astype(int), some, (), (text[:2],), limit=False)


def _crossings(branch: Branch, level: _Level) -> Iterator[Missed]:
    """Pairs of neighbouring points on known sides of a level whose sides do not fit the events between them."""
    side = level.side.copy()
    at = np.sort(np.array([event.point for event in level.events], dtype=int))
    side[at] = 0
    known = np.flatnonzero(side)
    odd = np.diff(np.searchsorted(at, known)) % 2 == 1
    for k in np.flatnonzero((side[known[1:]] != side[known[:-1]]) != odd).tolist():
        i, j = int(known[k]), int(known[k + 1])
        between = [event for event in level.events if i < event.point < j]
        crossed = side[i] != side[j]
        if between and any(event.type in level.touching for event in between):
            continue
        names = ", ".join(event.id for event in between) or "no event"
        how = f"crosses {level.name}" if crossed else f"does not cross {level.name}"
        found = _missed(branch, level.types, i, j, f"{how}, with {names} there")
        hidden = False
        if level.limit and not between:
            # Rounding hides a change of stability where neither orbit alone is decided, and no pivot changes its sign.
            orbits = branch.orbit(i), branch.orbit(j)
            hidden = orbits[0].solution["branching"] * orbits[1].solution["branching"] > 0.0
            hidden = hidden and all(int(orbit.columns["stable"][0]) < 0 for orbit in orbits)
        yield found._replace(hidden=hidden)


def _turning_points(branch: Branch) -> Iterator[Missed]:
    """Turning points of the energy without an SN or BP, and SN events without a turning point."""
    h = branch.points["h"]
    extrema = list(_extrema(branch))
    folds = {event.point for event in branch.events if event.type == "SN"}
    crossed = {event.point for event in branch.events if event.type == "BP"}
    for i, j in extrema:
        here = range(i, j + 1)
        if crossed.isdisjoint(here) and len(folds.intersection(here)) % 2 == 0:
            kind = "smallest" if h[max(0, i - 1)] > h[i] else "largest"
            yield _missed(branch, ("SN", "BP"), max(0, i - 1), min(len(h) - 1, j + 1), f"h is {kind} between them, without SN or BP")
    for (_, i), (j, _) in pairwise([(-1, -1), *extrema, (len(h), len(h))]):
        inside = sorted(folds.intersection(range(i + 1, j)))
        if len(inside) % 2 and crossed.isdisjoint(range(i + 1, j)):
            yield _missed(branch, ("SN",), max(0, inside[0] - 1), min(len(h) - 1, inside[0] + 1), "h does not turn at the SN between them")


def _extrema(branch: Branch) -> Iterator[tuple[int, int]]:
    """Ranges (first, last) of points that cannot be distinguished from a turning point of the energy, one range for each turning point.

    A turning point counts if the energy then returns by more than its error. Near a branch point this error grows with the inverse of
    the smallest pivot."""
    h = branch.points["h"]
    least = float(roundings(branch.problem.inner, 1.0))
    # log h is one of the coordinates of the arclength.
    known = {event.point: max(least, event.bracket[1] - event.bracket[0]) for event in branch.events if event.type in ("SN", "BP")}

    def error(i: int) -> float:
        if i not in known:
            try:
                pivot = branch.orbit(i).solution["branching"]
            except NotConverged:
                pivot = 0.0  # not known
            known[i] = float(roundings(branch.problem.inner, pivot))
        return known[i]

    def apart(i: int, j: int, times: float = 1.0) -> bool:
        difference = abs(h[i] / h[j] - 1.0)
        return bool(difference > 2.0 * least and difference > times * (error(i) + error(j)))

    way, best = 0, 0
    for i in range(1, len(h)):
        ahead = h[i] - h[best]
        if way == 0:
            if apart(i, best):
                way, best = (1 if ahead > 0.0 else -1), i
        elif ahead * way >= 0.0:
            best = i
        elif any((h[i] - h[j]) * way < 0.0 and apart(i, j) for j in range(best, i)):
            first = last = best
            while first > 0 and not apart(first - 1, best, 2.0):
                first -= 1
            while last < i and not apart(last + 1, best, 2.0):
                last += 1
            yield first, last
            way, best = -way, i


def _missed(branch: Branch, types: tuple[str, ...], i: int, j: int, text: str) -> Missed:
    h = branch.points["h"]
    return Missed(types, (i, j), f"between point {i}, h = {h[i]:.10g}, and point {j}, h = {h[j]:.10g}: {text}")
