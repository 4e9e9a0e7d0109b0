"""Passing branch points: where a run is stuck beside one, the family is followed again from afar, so that steps fall elsewhere.

Beside a branch point the equations are nearly singular, and a point that happens to be accepted there leads no further.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Generic, NamedTuple, TypeVar

import numpy as np

from branches.identity import Symmetries, symmetries
from bvp.closures import cycle_of

if TYPE_CHECKING:
    from bvp.multipoint import MultipointProblem
    from continuation.control import Settings

__all__ = ["Runs", "has_jumped", "longest", "one_family", "order"]

FINER = 4
"""How often steps are halved for a family that they leave at a branch point."""

PARTS = (0.5, 0.3, 0.8)
"""Parts of its length from where a family is followed again."""

Run = TypeVar("Run")


def longest(first: Run, again: Callable[[Run, float], Run], stuck: Callable[[Run], bool], length: Callable[[Run], float]) -> Run:
    """The longest of some runs along a family.

    Parameters
    ----------
    first : Run
    again : callable
        (run, part) -> a run from the point at that part of the length.
    stuck : callable
        run -> whether it ended where the corrector failed.
    length : callable
        run -> arclength.
    """
    best = first
    for part in PARTS:
        if not stuck(best):
            break
        other = again(best, part)
        if length(other) > length(best):
            best = other
    return best


class Runs(NamedTuple, Generic[Run]):
    """How a family is followed, for `one_family`.

    follow : callable
        (unknowns of an orbit, settings) -> run.
    at : callable
        (run, part of its length) -> the unknowns there.
    ends : callable
        run -> the unknowns of an orbit near either end; None for a run that is too short to have them.
    stuck, length : callable
        See `longest`.
    """

    follow: Callable[[np.ndarray, Settings], Run]
    at: Callable[[Run, float], np.ndarray]
    ends: Callable[[Run], tuple[np.ndarray, np.ndarray] | None]
    stuck: Callable[[Run], bool]
    length: Callable[[Run], float]


def one_family(problem: MultipointProblem, runs: Runs[Run], y: np.ndarray, settings: Settings) -> Run:
    """The longest run along the family of an orbit, started again where it is stuck, with finer steps where they went over to another
    family."""

    def jumped(run: Run) -> bool:
        ends = runs.ends(run)
        return ends is not None and has_jumped(problem, *ends)

    def fine(start: np.ndarray) -> Run:
        steps = settings
        run = runs.follow(start, steps)
        for _ in range(FINER):
            if not jumped(run):
                break
            halves = {name: 0.5 * getattr(steps, name) for name in ("initial_step", "maximum_step", "target_turn")}
            steps = replace(steps, **halves)
            run = runs.follow(start, steps)
        return run

    def length(run: Run) -> float:
        return -1.0 if jumped(run) else runs.length(run)

    return longest(fine(y), lambda run, part: fine(runs.at(run, part)), lambda run: runs.stuck(run) or jumped(run), length)


def has_jumped(problem: MultipointProblem, first: np.ndarray, last: np.ndarray) -> bool:
    """Whether steps from one orbit to the other went over from a family to one of more symmetry: then the two have not the same symmetries.

    The two families can leave their branch point nearly in one direction, as seen in the start state and the energy."""
    return order(symmetries(cycle_of(problem, first))) != order(symmetries(cycle_of(problem, last)))


def order(found: Symmetries) -> int:
    """How many symmetries an orbit has, itself and its mirror image taken as two."""
    return found.cover * (1 + found.half) * max(1, len(found.reversals))
