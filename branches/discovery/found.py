"""What is found: an orbit that is admissible and run through once, with its label."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from branches.family import label_at
from branches.labels import ImpossibleLabelError, Label
from bvp.cycle import cycle_of
from bvp.kernels.multipoint import STOP
from bvp.multipoint import MultipointProblem, NotConverged, Solution

__all__ = ["Found", "accept", "from_other_end", "objection", "turns"]


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
    return "multiple_turns" if turns(problem, solution) > 1 else None


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
    from branches.switching import embed

    stretch = embed(orbit.problem, orbit.solution.y, (1, 2))
    problem = MultipointProblem(orbit.problem.system, stretch.ends, stretch.word)
    try:
        turned = accept(problem, problem.solve(stretch.unknowns(problem), energy=orbit.h))
    except NotConverged:
        return orbit
    return orbit if turned is None else turned


def turns(problem: MultipointProblem, solution: Solution) -> int:
    """How often the solved orbit repeats itself: k for k turns of its primitive orbit, with k = 2 also where an origin..origin
    segment is half a turn of an orbit with half-period symmetry (a quarter problem solves that one)."""
    cycle = cycle_of(problem, solution.y)
    count = len(cycle.duration)
    size = float(np.max(np.abs(cycle.after)))
    longest = float(np.max(cycle.duration)) if count else 0.0
    best = 1
    for divisor in range(1, count):
        if count % divisor or np.max(np.abs(cycle.duration[divisor:] - cycle.duration[:-divisor])) > 1e-7 * longest:
            continue
        for sign in (1.0, -1.0):
            if sign < 0.0 and (problem.quarters != 2 or 2 * divisor != count or not problem.system.has_odd_symmetry):
                continue
            if np.max(np.abs(cycle.after[divisor:] - sign * cycle.after[:-divisor])) <= 1e-7 * size:
                best = max(best, count // divisor)
    return best
