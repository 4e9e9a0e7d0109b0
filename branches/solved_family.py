"""What all families of solved orbits have in common as problems of the continuation engine: steps, switching, branch points."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from branches.first_orbits import shares_fold
from branches.kernels.brackets import scan_tests
from branches.steps import MOST, PASSED_OVER, REFUSED, Block, CoreSteps, Place, Sought, empty_block
from bvp.multipoint import RESULT_INDEX, Solution
from continuation.control import Control
from continuation.problem import Advance, Goal, Recent, Step, TestFunction
from continuation.resolution import Sampled
from continuation.switching import refine_branch_point

__all__ = ["AdvancedSteps", "FAILED", "SINGULAR", "SolvedFamily", "begun_along", "step_of"]

_BRANCHING = 1
CONTRACTION, ENERGY, ITERATIONS, RESIDUAL, SLOPE, TURN = (
    RESULT_INDEX[name] for name in ("contraction", "energy", "iterations", "residual", "slope", "turn")
)

SINGULAR = 1e-5
"""Smallest pivot, relative to its column, below which signs are rounding: the error of a tangent is rounding over its square."""

_ALONG = 0.9  # cosine of the angle up to which two directions of the unknowns are one


FAILED = Step(False, np.empty(0), np.empty(0), (), 0.0, math.inf, 0, math.inf, math.nan, math.nan, [])


def step_of(solution: Solution, result: list[float], tests: list[float]) -> Step:
    """A solution as the engine sees it; its result entries are at hand as a list."""
    return Step(
        True, solution.y, solution.tangent, tuple(solution.position.tolist()), result[TURN], result[CONTRACTION],
        int(result[ITERATIONS]), result[RESIDUAL], result[ENERGY], result[SLOPE], tests, solution,
    )  # fmt: skip


@dataclass(eq=False, slots=True)
class AdvancedSteps(Sequence[Step]):
    """The steps in the rows of a block; a `Step` is created on access."""

    block: Block

    def __len__(self) -> int:
        return len(self.block.y)

    def __getitem__(self, place: Any) -> Any:
        block = self.block
        if isinstance(place, slice):
            return AdvancedSteps(Block(*(array[place] for array in block)))
        solution = Solution(block.y[place], block.tangent[place], block.position[place], block.ends[place], block.result[place])
        return step_of(solution, solution.result.tolist(), block.tests[place].tolist())


class SolvedFamily:
    """A family of the solutions of a multipoint problem; a `continuation.Problem` needs test functions besides.

    Parameters
    ----------
    problem : MultipointProblem or ForcedProblem
    """

    problem: Any
    tests: tuple[TestFunction, ...]
    _computed: int
    """How many test functions it computes; those that are watched come first."""

    @property
    def _steps(self) -> CoreSteps:
        """What takes steps along it."""
        raise NotImplementedError

    def _step(self, solution: Solution | None) -> Step:
        """A solution as the engine sees it, with its test functions."""
        raise NotImplementedError

    def _tried(self, solution: Solution, tests: np.ndarray) -> Step:
        """The step that ends a block. tests: its test functions, where it is an orbit."""
        return self._step(solution)

    def begin(self, y: np.ndarray) -> Step:
        """See `continuation.Problem`."""
        return self._step(self.problem.step(y, np.zeros(2 * self.problem.unknowns), 0.0))

    def step(self, y: np.ndarray, tangent: np.ndarray, ds: float) -> Step:
        """See `continuation.Problem`; the tangent carries higher derivatives behind it (`bvp.multipoint.Solution`)."""
        return self._step(self.problem.step(y, tangent, ds))

    def step_near(self, y: np.ndarray, tangent: np.ndarray, ds: float, guess: np.ndarray) -> Step:
        """See `continuation.Problem`."""
        along = tangent[: y.size]
        # the prediction is y + ds (tangent + ds/2 curvature)
        return self.step(y, np.concatenate([along, 2.0 * (guess - y - ds * along) / (ds * ds)]), ds)

    def step_between(self, before: Step, s: float, low: Place, high: Place, least_turn: float) -> tuple[Step, bool]:
        """See `continuation.Problem`."""
        block, _, answer = self._narrow(before, low, high, Sought(float(s), 0, 0.0, least_turn), 1)
        return FAILED if answer == REFUSED else AdvancedSteps(block)[0], answer == PASSED_OVER

    def narrow(
        self, before: Step, low: Place, high: Place, index: int, tolerance: float, least_turn: float, known: Sequence[tuple[float, float]]
    ) -> list[Place]:
        """See `continuation.Problem`."""
        at = next(place for place, (s, _) in enumerate(known) if s == high[0])
        block, count, _ = self._narrow(before, low, high, Sought(math.nan, index, tolerance, least_turn, known, at), MOST)
        return [(float(block.lengths[k, 0]), step) for k, step in enumerate(AdvancedSteps(block)[:count])]

    def _narrow(self, before: Step, low: Place, high: Place, sought: Sought, rows: int) -> tuple[Block, int, int]:
        """See `branches.steps.CoreSteps.narrow`."""
        block = self._block(rows)
        count, answer = self._steps.narrow(before, low, high, sought, block)
        return self._watched_part(block), count, answer

    def scan(
        self, sampled: Sampled, tests: Sequence[int], begin: int, limit: float, guard: bool, floor: float
    ) -> tuple[int, float, float, float]:
        """See `continuation.resolution.scan`."""
        indices = np.array(tests, dtype=np.int64)  # a family can have no test functions
        found: tuple[int, float, float, float] = scan_tests(sampled, indices, begin, float(limit), int(guard), floor)
        return found

    def _block(self, rows: int) -> Block:
        """Space for so many steps."""
        return empty_block(self.problem, rows, self._computed)

    def _watched_part(self, block: Block) -> Block:
        """The same steps with the test functions that are watched."""
        return block if self._computed == len(self.tests) else block._replace(tests=block.tests[:, : len(self.tests)])

    def uncorrected(self, y: np.ndarray) -> Step:
        """A solution as it stands: near a singular point Newton's method would move it."""
        return self._step(self.problem.step(y, np.zeros(2 * self.problem.unknowns), 0.0, maximum=0))

    def residual(self, y: np.ndarray) -> np.ndarray:
        """F(y), for switching."""
        return self.problem.residual(y)

    def jacobian(self, y: np.ndarray) -> np.ndarray:
        """F'(y), for switching."""
        return self.problem.jacobian(y)

    @property
    def curvature_blocks(self) -> list[np.ndarray]:
        """See `continuation.switching.Equations`."""
        return self.problem.curvature_blocks

    def refined(self, index: int, at: Step) -> Step | None:
        """See `continuation.Problem`. At branch points the equations are singular, and steps nearby fall onto the other family."""
        if index != _BRANCHING:
            return None
        y = refine_branch_point(self, at.y, self.problem.scales(at.y))
        return None if y is None else self._branch_point(y, at)

    def shares_fold(self, y: np.ndarray) -> bool:
        """See `continuation.Problem`."""
        return shares_fold(self, y)

    def _branch_point(self, y: np.ndarray, near: Step) -> Step | None:
        """A branch point, not corrected: the equations are singular there, and so is the tangent."""
        solution = self.problem.step(y, near.tangent, 0.0, maximum=0)
        found = self._step(None if solution is None else replace(solution, tangent=near.tangent))
        return found._replace(turn=near.turn) if found.converged else None

    def beyond(self, at: Step) -> tuple[Step, Step] | None:
        """See `continuation.Problem`. The point behind the branch point begins as the image of the one before it."""

        def is_along(one: np.ndarray, other: np.ndarray) -> bool:
            return bool(one @ other > _ALONG * np.linalg.norm(one) * np.linalg.norm(other))

        scale = self.problem.scales(at.y)
        y = refine_branch_point(self, at.y, scale)
        if y is None:
            return None
        ahead = (y - at.y) / scale
        point, after = self._branch_point(y, at), self.begin(2.0 * y - at.y)
        if point is None or not after.converged or not is_along(at.tangent[: y.size] / scale, ahead):
            return None
        behind = (after.y - y) / scale
        if not is_along(ahead, behind) or not 0.5 < np.linalg.norm(behind) / np.linalg.norm(ahead) < 2.0:
            return None
        if after.tangent[: y.size] / scale @ behind < 0.0:
            after = self.step(after.y, -after.tangent, 0.0)
        return (point, after) if after.converged else None

    def _advance(self, recent: Recent, ds: float, goal: Goal, room: int, control: Control) -> Advance:
        block = self._block(room + 1)
        count, tried, ds = self._steps.advance(recent, ds, goal, control, block)
        if 2 * (count + tried) <= room:  # a few rows must not keep the memory of all
            block = Block(*(array[: count + tried].copy() for array in block))
        trial = None
        if tried:
            solution = Solution(block.y[count], block.tangent[count], block.position[count], block.ends[count], block.result[count])
            trial = self._tried(solution, block.tests[count])
        taken = self._watched_part(Block(*(array[:count] for array in block)))
        return Advance(AdvancedSteps(taken), taken.lengths[:, 0], taken.lengths[:, 1], ds, trial)


def begun_along(
    family: SolvedFamily, y: np.ndarray, tangent: np.ndarray, scale: np.ndarray, places: np.ndarray | None = None
) -> Step:
    """The orbit at y, with its tangent turned like another one of the same family in other unknowns, of which m are the same.

    Parameters
    ----------
    family : SolvedFamily
    y : (u,) float
    tangent : (m + ..,) float
        The other tangent; its first m entries count.
    scale : (m,) float
        Sizes of the unknowns that are the same.
    places : (m,) int, optional
        Where they are in y; by default the first ones.
    """
    step, size = family.begin(y), len(scale)
    places = np.arange(size) if places is None else places
    ahead = (step.tangent[places] / scale) @ (tangent[:size] / scale) if step.converged else 1.0
    return family.step(step.y, -step.tangent, 0.0) if ahead < 0.0 else step
