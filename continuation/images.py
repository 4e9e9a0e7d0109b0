"""The images of a run under the symmetries of its equations: where it comes to the image of its start, and where it gains a symmetry.

A symmetry takes each solution to another one of the same equations. A run that comes to the image of its start goes on with images of what
it followed. A solution that is its own image lies on a family of more symmetry. A run comes to such a solution at a branch point only.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from bvp.dense import inner, product
from continuation.control import NEAR_GOAL
from continuation.problem import Goal, Problem, Step

__all__ = ["Images", "Symmetry"]

Symmetry = Callable[[np.ndarray], "np.ndarray | None"]
"""Takes unknowns to those of the image; None where it has none."""

SAME = 1e-7
"""Difference of unknowns, relative to the largest of their kind, below which a solution is its own image."""


class Images:
    """The images of a run from its first point.

    Parameters
    ----------
    problem : Problem
        Its optional `symmetries(y)` gives the symmetries, and its optional `sizes(y)` the size of each unknown.
    first : Step
        The first point.
    """

    def __init__(self, problem: Problem, first: Step) -> None:
        self._problem, self._first = problem, first
        find: Callable[[np.ndarray], Sequence[Symmetry]] | None = getattr(problem, "symmetries", None)
        self._symmetries: Sequence[Symmetry] = () if find is None else find(first.y)
        self._goals: list[Goal] | None = None
        self._order = self.order(first.y) if self._symmetries else 0

    def order(self, y: np.ndarray) -> int:
        """How many of the symmetries take a solution to itself."""
        sizes = np.asarray(self._problem.sizes(y))  # type: ignore[attr-defined]
        images = (symmetry(y) for symmetry in self._symmetries)
        return sum(image is not None and bool(np.max(np.abs(image - y) / sizes) < SAME) for image in images)

    def gains(self, y: np.ndarray) -> bool:
        """Whether a solution has more symmetry than the first point."""
        return bool(self._symmetries) and self.order(y) > self._order

    def goals(self, second: Step) -> list[Goal]:
        """The images of the first point, with the direction in which the run would pass each; `second`: a point that follows."""
        if second is self._first:
            return []
        if self._goals is None:
            self._goals = []
            for symmetry in self._symmetries:
                start, ahead = symmetry(self._first.y), symmetry(second.y)
                if start is None or ahead is None:
                    continue
                at, then = self._problem.begin(start), self._problem.begin(ahead)
                if not (at.converged and then.converged) or self._is_first(at):
                    continue
                if inner(at.tangent[: at.y.size], then.y - at.y) < 0.0:
                    at = self._problem.step(at.y, -at.tangent, 0.0)
                self._goals.append(Goal(at, np.asarray(then.position) - np.asarray(at.position)))
        return self._goals

    def _is_first(self, at: Step) -> bool:
        sizes = np.asarray(self._problem.sizes(at.y))  # type: ignore[attr-defined]
        return bool(np.max(np.abs(at.y - self._first.y) / sizes) < SAME)

    def plain(self, before: Step, steps: Any) -> int:
        """How many of the steps of a block after a point are neither near an image of the first point nor have more symmetry."""
        count = len(steps)
        if not self._symmetries or not count:
            return count
        if self.gains(steps[count - 1].y):
            low, high = -1, count - 1  # the first one is searched by bisection: what has gained a symmetry keeps it
            while high - low > 1:
                middle = (low + high) // 2
                low, high = (low, middle) if self.gains(steps[middle].y) else (middle, high)
            count = high
        for goal in self.goals(steps[0]):
            positions = np.array([before.position, *(steps[k].position for k in range(count))])
            chords = np.linalg.norm(np.diff(positions, axis=0), axis=1)
            apart = positions - np.asarray(goal.step.position)
            heights = product(apart, np.asarray(goal.direction))
            passed = (heights[:-1] < 0.0) & (heights[1:] >= 0.0) & (np.linalg.norm(apart[1:], axis=1) <= NEAR_GOAL * chords)
            count = int(np.argmax(passed)) if passed.any() else count
        return count
