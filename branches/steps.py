"""What takes steps along a family, with the test functions of each point: the compiled core, or kernels for loads.

Both fill the rows of a `Block` and have the same methods, so families do not ask which they have.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import saltus_core

from branches.kernels.blocks import Beginning, Block, GoalPlane, WatchedTests
from branches.kernels.brackets import BracketWork, Departure, Known, make_bracket
from branches.kernels.brackets import Sought as SoughtByKernel
from bvp.multipoint import RESULT_INDEX, MultipointProblem, Solution
from continuation.control import Control, kinds_of
from continuation.problem import Goal, Recent, Step, TestFunction

if TYPE_CHECKING:
    from bvp.kernels.step import CompiledProblem

__all__ = ["MOST_ITERATIONS", "CoreSteps", "KernelSteps", "Limits", "Place", "Sought", "empty_block"]

MOST_ITERATIONS = 12
"""Most iterations of a correction."""

Limits = tuple[float, float, float, float]
"""Logarithms of the lowest and highest energy and of the longest quarter period, and the noise of the tangent."""

Place = tuple[float, Step]
"""A step from an orbit, and its length before it."""


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
    """Steps of the core, for conservative problems.

    Parameters
    ----------
    problem : MultipointProblem
    tests : sequence of TestFunction
        Those that are watched.
    limits : Limits
    targets : sequence of float
        Traces at which periods multiply.
    computed : int
        How many test functions are computed; those that are watched come first.

    Attributes
    ----------
    core : saltus_core.OrbitFamily
    """

    def __init__(
        self, problem: MultipointProblem, tests: Sequence[TestFunction], limits: Limits, targets: Sequence[float], computed: int
    ):
        self.problem, self.computed = problem, computed
        singular = [test.singular for test in tests]
        orbits = problem.orbits.core
        self.core = saltus_core.OrbitFamily(orbits, kinds_of(tests), singular, *limits, list(targets), computed, MOST_ITERATIONS)

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


class KernelSteps:
    """The same by kernels, for problems with loads or in parameters.

    Parameters
    ----------
    problem : ForcedProblem
    watched : WatchedTests
    compiled : CompiledProblem
        What takes steps.
    advance, narrow : kernel
        For an advance, and for steps between two (`branches.kernels.blocks`, `.brackets`).
    """

    def __init__(self, problem: Any, watched: WatchedTests, compiled: CompiledProblem, advance: Any, narrow: Any):
        self.problem, self._watched, self._compiled = problem, watched, compiled
        self._advance, self._narrow = advance, narrow

    def advance(self, recent: Recent, ds: float, goal: Goal, control: Control, block: Block) -> tuple[int, bool, float]:
        """See `CoreSteps.advance`."""
        step = recent.step
        y, tangent, position = _numbers(step.y, step.tangent, step.position)
        tests, older, oldest = (np.array(values, dtype=float) for values in (recent.tests, recent.older, recent.oldest))
        beginning = Beginning(y, tangent, position, tests, older, oldest, float(recent.length), float(recent.length_before))
        towards = GoalPlane(*_goal(goal, self.problem.coordinates))
        found: tuple[int, bool, float] = self._advance(
            self._compiled, MOST_ITERATIONS, control, self._watched, beginning, towards, float(ds), self._scratch, block
        )
        return found

    def narrow(self, before: Step, low: Place, high: Place, sought: Sought, block: Block) -> tuple[int, int]:
        """See `CoreSteps.narrow`."""
        y, tangent = _numbers(before.y, before.tangent)
        departure = Departure(self._compiled, MOST_ITERATIONS, self._watched, y, tangent, self._scratch)
        samples = make_bracket(sought.known, self.problem.unknowns) if sought.known else self._no_samples
        wanted = SoughtByKernel(*sought[:4], len(sought.known), sought.at)
        found: tuple[int, int] = self._narrow(departure, _known(*low), _known(*high), wanted, samples, block)
        return found

    @cached_property
    def _no_samples(self) -> BracketWork:
        return make_bracket([], self.problem.unknowns)

    @cached_property
    def _scratch(self) -> np.ndarray:
        return np.empty((5, self.problem.coordinates))


def _known(length: float, step: Step) -> Known:
    y, tangent = _numbers(step.y, step.tangent)
    return Known(length, y, tangent, float(step.turn))
