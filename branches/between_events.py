"""Stability between events: it changes only at them, so one decided orbit between two neighbouring events decides all of the interval.

Where rounding leaves every orbit of an interval undecided, one of them is solved in fifty digits (`bvp.many_digits`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from time import perf_counter
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from bvp.multipoint import MultipointProblem

__all__ = ["Barrier", "DigitWork", "decide_between", "stability_events"]


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
    closed: bool = False,
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
    closed : bool
        Whether the last point leads on to the first one.

    Returns
    -------
    stable : (N,) int8
        1 stable, 0 unstable, -1 undecided: at an event, inside its bracket, where an impact grazes, in an interval whose decided orbits
        contradict each other, and where fifty digits do not decide, as for a multiplier that is 1 along all of the family.
    work : DigitWork

    Notes
    -----
    Decided orbits of one interval contradict each other where an event between them was missed: `branches.missed` reports it.
    """
    stable, arclength = points["stable"].copy(), points["arclength"]
    kinds = stability_events(problem)
    if not kinds or not np.any(stable < 0):
        return stable, DigitWork()
    events = [barrier for barrier in barriers if barrier.type in kinds]
    # At grazing multipliers are unbounded. An interval does not go on beyond it.
    free = np.isfinite(points["multipliers"]).all(axis=1)
    for _, point, (low, high) in events:
        free[point] = False
        free &= (arclength < low) | (arclength > high)
    cuts = sorted({event.point for event in events})
    interval = np.searchsorted(cuts, np.arange(len(stable)))
    if closed and cuts:
        interval[interval == len(cuts)] = 0
    work = DigitWork()
    for number in np.unique(interval[free & (stable < 0)]):
        members = np.flatnonzero(free & (interval == number))
        known = np.unique(stable[members])
        known = known[known >= 0]
        if not known.size:
            began = perf_counter()
            decided = _decided_in_digits(problem, unknowns, arclength, members, cuts)
            work += DigitWork(1, perf_counter() - began)
            known = np.array([] if decided is None else [decided])
        if known.size == 1:
            stable[members] = known[0]
    return stable, work


def _decided_in_digits(
    problem: MultipointProblem, unknowns: Callable[[int], np.ndarray], arclength: np.ndarray, members: np.ndarray, cuts: Sequence[int]
) -> bool | None:
    """Stability of that orbit of an interval that is farthest from the events and from the ends of the branch."""
    from bvp.many_digits import orbit_in_digits

    limits = arclength[sorted({0, len(arclength) - 1, *cuts})]
    distance = np.min(np.abs(arclength[members][:, None] - limits), axis=1)
    place = int(np.argmax(distance))
    try:
        orbit = orbit_in_digits(problem, unknowns(int(members[place])))
    except ArithmeticError:
        return None
    # Beside a branch point the nearest orbit can lie beyond the event.
    return orbit.stable if orbit.moved < distance[place] else None
