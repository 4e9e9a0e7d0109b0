"""Orbits of a block of steps: they stay in the arrays of their block, and become a step or a solution when asked for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import overload

import numpy as np

from branches.kernels.advance import Block
from bvp.kernels.multipoint import CONTRACTION, ENERGY, ITERATIONS, RESIDUAL, SLOPE, TURN
from bvp.multipoint import Solution
from continuation.points import PlainPoints, Points
from continuation.problem import Point, Step

__all__ = ["AdvancedSteps", "Solutions", "solutions_of", "step_of"]


class AdvancedSteps(Sequence[Step]):
    """The steps in the rows of a block.

    Parameters
    ----------
    block : Block
    """

    __slots__ = ("block",)

    def __init__(self, block: Block) -> None:
        self.block = block

    def __len__(self) -> int:
        return len(self.block.y)

    @overload
    def __getitem__(self, place: int) -> Step: ...

    @overload
    def __getitem__(self, place: slice) -> AdvancedSteps: ...

    def __getitem__(self, place: int | slice) -> Step | AdvancedSteps:
        block = self.block
        if isinstance(place, slice):
            return AdvancedSteps(Block(*(array[place] for array in block)))
        solution = Solution(block.y[place], block.tangent[place], block.position[place], block.ends[place], block.result[place])
        return step_of(solution, solution.result.tolist(), block.tests[place].tolist())


def step_of(solution: Solution, result: list[float], tests: list[float]) -> Step:
    """A solution, whose result entries are at hand as a list, as the engine sees it."""
    return Step(
        True, solution.y, solution.tangent, tuple(solution.position.tolist()), result[TURN], result[CONTRACTION],
        int(result[ITERATIONS]), result[RESIDUAL], result[ENERGY], result[SLOPE], tests, solution,
    )  # fmt: skip


class Solutions(Sequence[Solution]):
    """Many solutions of one problem, entry by entry.

    Parameters
    ----------
    y, tangent, position, ends, result : (N, ...) float
        As in `Solution`.
    """

    def __init__(self, y: np.ndarray, tangent: np.ndarray, position: np.ndarray, ends: np.ndarray, result: np.ndarray) -> None:
        self.y = y
        self.tangent = tangent
        self.position = position
        self.ends = ends
        self.result = result

    @classmethod
    def stacked(cls, solutions: Sequence[Solution]) -> Solutions:
        """From solutions that stand alone, one at least."""
        if isinstance(solutions, Solutions):
            return solutions
        return cls(
            *(np.array([getattr(solution, name) for solution in solutions]) for name in ("y", "tangent", "position", "ends", "result"))
        )

    def __len__(self) -> int:
        return len(self.y)

    @overload
    def __getitem__(self, place: int) -> Solution: ...

    @overload
    def __getitem__(self, place: slice) -> Solutions: ...

    def __getitem__(self, place: int | slice) -> Solution | Solutions:
        parts = (self.y[place], self.tangent[place], self.position[place], self.ends[place], self.result[place])
        return Solutions(*parts) if isinstance(place, slice) else Solution(*parts)


def solutions_of(points: Sequence[Point]) -> Solutions:
    """The solutions of a run's points, without making the points of a block of steps."""
    parts = []
    for piece in points.pieces if isinstance(points, Points) else [list(points)]:
        if isinstance(piece, PlainPoints) and isinstance(piece.steps, AdvancedSteps):
            parts.append(Solutions(*piece.steps.block[:5]))
        else:
            parts.append(Solutions.stacked([point.step.extra for point in piece]))
    if len(parts) == 1:
        return parts[0]
    return Solutions(*(np.concatenate([getattr(part, name) for part in parts]) for name in ("y", "tangent", "position", "ends", "result")))
