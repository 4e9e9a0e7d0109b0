"""A presentation of a periodic orbit: an interval of its period, as a multipoint problem solves it.

One orbit can be solved between different ends, started at different times, or run through more than once. Each presentation holds the
unknowns of the multipoint problem that has its ends and its impact sequence.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from branches.sequences import PERIODIC, Ends, ImpactSequence, mirror, mirror_ends
from bvp.closures import Cycle, cycle_of
from bvp.multipoint import MultipointProblem, Solution

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["Presentation", "closed_presentation", "embed", "run_backwards", "solved", "presentation_between", "presentation_of"]

SLACK = 1e-9
"""Part of the period within which an impact is at an end."""


class Presentation(NamedTuple):
    """A presentation of an orbit: its ends, inner contacts, start state, the states after its inner impacts, flight times.

    For periodic ends `sequence` is that of the whole presentation, whose first impact is the start; `nodes` are those after it.
    """

    ends: Ends
    sequence: ImpactSequence
    start: np.ndarray
    nodes: np.ndarray
    times: np.ndarray

    @property
    def quarter_period(self) -> float:
        """A quarter of the period of the orbit."""
        first, last = self.ends
        quarters = 4 if first == "periodic" else 1 if (first == "origin") != (last == "origin") else 2
        return float(np.sum(self.times)) / quarters

    @property
    def leans(self) -> bool:
        """Whether more impacts lie inside its first half than inside its second; False for periodic ends, between which there are none."""
        if self.ends == PERIODIC:
            return False
        instants = np.cumsum(self.times)
        middle, slack = 0.5 * instants[-1], SLACK * instants[-1]
        return bool(np.sum(instants[:-1] < middle - slack) > np.sum(instants[:-1] > middle + slack))

    def unknowns(self, problem: MultipointProblem) -> np.ndarray:
        """The presentation as unknowns of a problem with its ends and sequence."""
        return problem.pack(self.start, self.nodes, self.times)

    def mirrored(self) -> Presentation:
        """The presentation of -u."""
        return Presentation(mirror_ends(self.ends), mirror(self.sequence), -self.start, -self.nodes, self.times)


def presentation_between(cycle: Cycle, first: float, last: float, kinds: tuple[str, str]) -> Presentation:
    """The presentation of an orbit between two instants at which it reverses.

    Parameters
    ----------
    cycle : Cycle
        The orbit's period.
    first, last : float
        Times from the orbit's start, 0 <= first < last.
    kinds : (str, str)
        "origin", "rest" or "stop", with or without the contact's letter, which is read from the orbit.
    """
    count = len(cycle.duration)
    turns = range(-1, 2 + math.ceil(last / cycle.period))  # the impact of a stop at the start ends the period
    instants = np.concatenate([cycle.times + turn * cycle.period for turn in turns])
    slack = SLACK * cycle.period
    inner = [i for i in range(len(instants)) if first + slack < instants[i] < last - slack]
    ends = []
    for kind, time in zip(kinds, (first, last), strict=True):
        if kind.startswith("stop"):
            kind = "stop" + cycle.letters[int(np.argmin(np.abs(instants - time))) % count]
        ends.append(kind)
    if ends[0].startswith("stop"):
        start = cycle.after[int(np.argmin(np.abs(instants - first))) % count]
    else:
        u, v = cycle.sample(np.array([first]))
        start = cycle.system.modes.from_state @ np.concatenate([u[0], v[0]])
    stamps = np.concatenate([[first], instants[inner], [last]])
    sequence = tuple(cycle.letters[i % count] for i in inner)
    return Presentation((ends[0], ends[1]), sequence, start, cycle.after[[i % count for i in inner]], np.diff(stamps))


def closed_presentation(cycle: Cycle, cover: int = 1, first: int = 0, backwards: bool = False) -> Presentation:
    """The whole orbit as it closes on itself from one of its impacts, run through so many times, or backwards in time."""
    after, duration, letters = cycle.after, cycle.duration, cycle.letters
    if backwards:
        flip = np.repeat([1.0, -1.0], after.shape[1] // 2)
        after, duration, letters = (cycle.before * flip)[::-1], np.roll(duration[::-1], -1), letters[::-1]
    nodes = np.tile(np.roll(after, -first, axis=0), (cover, 1))
    sequence = (letters[first:] + letters[:first]) * cover
    return Presentation(PERIODIC, sequence, nodes[0], nodes[1:], np.tile(np.roll(duration, -first), cover))


def run_backwards(system: ImpactSystem, presentation: Presentation, problem: MultipointProblem | None = None) -> Presentation:
    """A presentation between two reversals run from its last end to its first: what follows the last end, up to the reversal there.
    `problem`, where it is at hand, is that with the presentation's ends and sequence."""
    if problem is None:
        problem = MultipointProblem(system, presentation.ends, presentation.sequence)
    flip = np.repeat([1.0, -1.0], problem.half)
    arrivals = problem.end_states(presentation.unknowns(problem)) * flip
    ends = (presentation.ends[1], presentation.ends[0])
    return Presentation(ends, presentation.sequence[::-1], arrivals[-1], arrivals[-2::-1], presentation.times[::-1])


def embed(problem: MultipointProblem, y: np.ndarray, window: tuple[int, int] | int) -> Presentation:
    """The orbit y over a window of its time: (first, last) in solved segments, or a number of periods that close on themselves."""
    cycle = cycle_of(problem, y)
    if isinstance(window, int):
        return closed_presentation(cycle, window)
    length = float(np.sum(problem.flight_times(y)))
    kinds = (problem.ends[window[0] % 2], problem.ends[window[1] % 2])
    return presentation_between(cycle, window[0] * length, window[1] * length, kinds)


def presentation_of(problem: MultipointProblem, y: np.ndarray) -> Presentation:
    """The presentation that the unknowns of a problem are."""
    return Presentation(problem.ends, problem.sequence, problem.start(y), problem.nodes(y), problem.flight_times(y))


def solved(problem: MultipointProblem, y: np.ndarray) -> Solution:
    """The solution at unknowns that another presentation gave: taken as it stands where its residual allows, since at a branch
    point the equations are singular and Newton would move it; else corrected at its energy.

    Raises
    ------
    NotConverged
        Where it cannot be corrected.
    """
    as_it_stands = problem.step(y, np.zeros(2 * problem.unknowns), 0.0, maximum=0)
    return problem.solve(y, energy=problem.energy(y)) if as_it_stands is None else as_it_stands
