"""Stability between events: it changes only at them, so a decided orbit between two neighbouring events decides those around it.

Where rounding leaves many neighbouring orbits undecided, an entry of their half maps is nearly zero, and an event among them could not be
located either. Some of these orbits are solved in fifty digits (`bvp.many_digits`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from itertools import pairwise
from time import perf_counter
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from bvp.multipoint import MultipointProblem

__all__ = ["Barrier", "DigitWork", "decide_between", "stability_events"]


SPACING = 4
"""At most so many neighbouring points are decided by those around them: on a longer run of undecided points rounding can hide an event."""


class Barrier(NamedTuple):
    """An event that can change stability: its type, the index of its point, and the arclengths between which it certainly is."""

    type: str
    point: int
    bracket: tuple[float, float]


class DigitWork(NamedTuple):
    """How many orbits were solved in fifty digits to decide their stability, and the time in seconds."""

    orbits: int = 0
    seconds: float = 0.0

    def __add__(self, other: tuple[object, ...]) -> DigitWork:  # of the sums, not of the tuples
        assert isinstance(other, DigitWork)
        return DigitWork(self.orbits + other.orbits, self.seconds + other.seconds)


def stability_events(problem: MultipointProblem) -> tuple[str, ...]:
    """Types of the events at which the stability of a family can change; empty where they are not all located.

    Two reversals a quarter period apart: the period doubles at tau_half = 0, inside the interval -2 < tau_half < 2 of the stable orbits.
    Periodic closures of more than two degrees of freedom: Krein collisions are not located.
    """
    if problem.periodic and problem.half > 2:
        return ()
    doubling = () if problem.quarters == 1 else ("PD",)
    return ("SN", "BP", "SB", "NS", *doubling)


def decide_between(
    problem: MultipointProblem,
    unknowns: Callable[[int], np.ndarray],
    points: Mapping[str, np.ndarray],
    barriers: Iterable[Barrier],
) -> tuple[np.ndarray, DigitWork]:
    """Stability of all points of a branch between its events.

    Parameters
    ----------
    problem : MultipointProblem
    unknowns : callable
        Index of a point -> the unknowns of its orbit.
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
    Between two neighbouring points of one interval that differ in fifty digits too an event was missed: `branches.missed` reports it.
    """
    stable, arclength = points["stable"].copy(), points["arclength"]
    kinds = stability_events(problem)
    if not kinds:
        return stable, DigitWork()
    events = [barrier for barrier in barriers if barrier.type in kinds]
    free = np.isfinite(points["multipliers"]).all(axis=1)
    for _, point, (low, high) in events:
        free[point] = False
        free &= (arclength < low) | (arclength > high)
    cuts = sorted({event.point for event in events})
    limits = arclength[sorted({0, len(arclength) - 1, *cuts})]
    interval = np.searchsorted(cuts, np.arange(len(stable)))
    work = DigitWork()

    solved: dict[int, int] = {}

    def solve(i: int) -> int:
        nonlocal work
        if i in solved:
            return solved[i]
        began = perf_counter()
        found = _in_digits(problem, unknowns(i), float(np.min(np.abs(arclength[i] - limits))))
        work += DigitWork(1, perf_counter() - began)
        solved[i] = found
        return found

    for number in np.unique(interval[free]):
        members = np.flatnonzero(free & (interval == number))
        if len(set(stable[members].tolist())) == 1 and stable[members[0]] >= 0:
            continue
        if np.all(stable[members] < 0):
            apart = np.min(np.abs(arclength[members][:, None] - limits), axis=1)
            farthest = members[np.argmax(apart)]
            stable[farthest] = solve(int(farthest))
        stable[members] = _filled(stable[members].tolist(), lambda k, members=members: solve(int(members[k])))  # type: ignore[misc]
        stable[members] = _agreed(stable[members].tolist(), lambda k, members=members: solve(int(members[k])))  # type: ignore[misc]
    return stable, work


def _agreed(stable: list[int], solve: Callable[[int], int]) -> list[int]:
    """The stability of the points of an interval without an event, where neighbours differ in fifty digits: beside a branch point the error
    of an orbit can be larger than double precision tells."""
    out, asked = list(stable), set[int]()
    while doubtful := {k for pair in pairwise(range(len(out))) if sorted(out[k] for k in pair) == [0, 1] for k in pair} - asked:
        for k in sorted(doubtful):
            found = solve(k)
            out[k] = found if found >= 0 else out[k]
        asked |= doubtful
    return out


def _filled(stable: list[int], solve: Callable[[int], int]) -> list[int]:
    """The stability of the points of an interval without an event, from that of some of them; `solve` gives it in fifty digits."""
    out = list(stable)

    def ask(first: int, last: int) -> None:
        """Solve some of the points between two others, until those left follow from them."""
        known = [out[k] for k in (first, last) if out[k] >= 0]
        left = last - first - 1
        if not left or not known or (left <= SPACING and len(set(known)) == 1):
            return
        middle = (first + last) // 2
        out[middle] = solve(middle)
        ask(first, middle)
        ask(middle, last)

    # An event that was missed next to an end of the interval is seen from there.
    if any(value >= 0 for value in stable):
        for end in (0, len(stable) - 1):
            out[end] = solve(end) if stable[end] < 0 else stable[end]
    known_or_end = [k for k, value in enumerate(out) if value >= 0 or k in (0, len(out) - 1)]
    for first, last in pairwise(known_or_end):
        ask(first, last)
    known = np.array([k for k, value in enumerate(out) if value >= 0])
    return [out[int(known[np.argmin(np.abs(known - k))])] for k in range(len(out))] if known.size else out


def _in_digits(problem: MultipointProblem, y: np.ndarray, distance: float) -> int:
    """Stability of an orbit in fifty digits: 1, 0, or -1 where it is not decided; `distance`: arclength to the next event."""
    from bvp.many_digits import orbit_in_digits

    try:
        orbit = orbit_in_digits(problem, y)
    except ArithmeticError:
        return -1
    # Beside a branch point the nearest orbit can lie beyond the event.
    return -1 if orbit.stable is None or not orbit.moved < distance else int(orbit.stable)
