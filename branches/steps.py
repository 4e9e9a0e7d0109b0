"""What takes steps along a family, with the test functions of each point: the compiled core, which fills the rows of a `Block`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import saltus_core

from bvp.multipoint import RESULT_INDEX, Solution
from continuation.control import Control, kinds_of
from continuation.problem import Goal, Recent, Step, TestFunction

__all__ = ["MOST", "MOST_ITERATIONS", "PASSED_OVER", "REFUSED", "Block", "CoreSteps", "Limits", "Place", "Sought", "empty_block"]

MOST_ITERATIONS = 12
"""Most iterations of a correction."""

Limits = tuple[float, float, float, float]
"""Logarithms of the lowest and highest energy and of the longest quarter period, and the noise of the tangent; of a family in a parameter
its lowest and highest value."""

Place = tuple[float, Step]
"""A step from an orbit, and its length before it."""


class Block(NamedTuple):
    """What is found of each step; row after row, the last one for a step that is tried and not plain. u unknowns, k inner nodes."""

    y: np.ndarray  # (steps + 1, u)
    tangent: np.ndarray  # (steps + 1, 2 u), or 3 u with smooth forces
    position: np.ndarray  # (steps + 1, coordinates of arclength)
    ends: np.ndarray  # (steps + 1, k + 1, N)
    result: np.ndarray  # (steps + 1, len(RESULT_INDEX))
    tests: np.ndarray  # (steps + 1, tests)
    lengths: np.ndarray  # (steps + 1, 2) requested length, arclength


MOST = 40
"""Steps that close in on a zero in one call."""

LANDED, REFUSED, TURNED, PASSED_OVER = range(4)
"""Where a step leads: to an orbit; to none; to one whose tangent is rotated too far; to one of another family."""


class Sought(NamedTuple):
    """What is sought inside a step: a step of a given length, or (NaN) a zero between two samples.

    length: of the step. test: number of the test function. tolerance: width of the final bracket. least_turn: cosine of the largest
    rotation of a tangent. known: samples as (length, value), in order. at: the zero is between this sample and the one before it.
    """

    length: float
    test: int
    tolerance: float
    least_turn: float
    known: Sequence[tuple[float, float]] = ()
    at: int = 0


def empty_block(problem: Any, rows: int, tests: int) -> Block:
    """Space for so many steps with so many test functions."""
    return Block(
        np.empty((rows, problem.unknowns)),
        np.empty((rows, problem.tangent_size)),
        np.empty((rows, problem.coordinates)),
        np.empty((rows, problem.inner + 1, problem.size)),
        np.empty((rows, len(RESULT_INDEX))),
        np.empty((rows, tests)),
        np.empty((rows, 2)),
    )


def _numbers(*arrays: Any) -> list[np.ndarray]:
    """Arrays as compiled code takes them: contiguous float64."""
    return [np.ascontiguousarray(array, dtype=float) for array in arrays]


def _goal(goal: Goal, places: int) -> list[np.ndarray]:
    """Position and direction; NaN where the direction is that of the first step."""
    return _numbers(goal.step.position, np.full(places, math.nan) if goal.direction is None else goal.direction)


class CoreSteps:
    """Steps of the core.

    Parameters
    ----------
    problem : MultipointProblem or ForcedProblem
    tests : sequence of TestFunction
        Those that are watched.
    limits : Limits
    targets : sequence of float
        Traces at which periods multiply.
    computed : int
        How many test functions are computed; those that are watched come first.
    neutral : bool
        Under loads: whether pairs of multipliers can have the product 1 by rounding alone.

    Attributes
    ----------
    core : saltus_core.OrbitFamily
    """

    def __init__(
        self, problem: Any, tests: Sequence[TestFunction], limits: Limits, targets: Sequence[float], computed: int, neutral: bool = False
    ):
        self.problem, self.computed = problem, computed
        singular = [test.singular for test in tests]
        self.core = saltus_core.OrbitFamily(
            problem.core, kinds_of(tests), singular, *limits, list(targets), computed, MOST_ITERATIONS, neutral
        )

    def step(self, y: np.ndarray, tangent: np.ndarray, ds: float, block: Block) -> bool:
        """Take a step into the first row of a block. Returns whether it leads to an orbit."""
        found: bool = self.core.step(*_numbers(y, tangent), float(ds), *block)
        return found

    def values(self, solution: Solution) -> list[float]:
        """The test functions at an observed orbit."""
        out = np.empty(self.computed)
        self.core.values(solution.y, solution.ends, solution.result, out)
        return out.tolist()

    def advance(self, recent: Recent, ds: float, goal: Goal, control: Control, block: Block) -> tuple[int, bool, float]:
        """Take steps from an orbit on: accepted steps, whether the next row holds one that is not plain, length of the next one."""
        found: tuple[int, bool, float] = self.core.advance(*self.arguments(recent, ds, goal, control, block))
        return found

    def arguments(self, recent: Recent, ds: float, goal: Goal, control: Control, block: Block) -> tuple[Any, ...]:
        """The arguments of the core's advance."""
        step = recent.step
        begin = _numbers(step.y, step.tangent, step.position, recent.tests, recent.older, recent.oldest)
        lengths = float(recent.length), float(recent.length_before)
        return *begin, *lengths, *_goal(goal, self.problem.coordinates), float(ds), tuple(control), *block

    def narrow(self, before: Step, low: Place, high: Place, sought: Sought, block: Block) -> tuple[int, int]:
        """Take steps between two: their number, and how they ended (`Inside` in bvp/core/family.hpp)."""
        ends: list[Any] = []
        for length, step in (low, high):
            y, tangent = _numbers(step.y, step.tangent)
            ends += [float(length), y, tangent[: y.size] / step.turn]
        places, values = ([float(pair[k]) for pair in sought.known] for k in range(2))
        samples = places, values, sought.at
        found: tuple[int, int] = self.core.narrow(*_numbers(before.y, before.tangent), *ends, *sought[:4], *samples, *block)
        return found
