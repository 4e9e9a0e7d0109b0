"""What all families of solved orbits have in common as problems of the continuation engine: steps, switching, branch points."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from bvp.kernels.multipoint import CONTRACTION, ENERGY, ITERATIONS, RESIDUAL, SLOPE, TURN
from bvp.multipoint import Solution
from continuation.problem import Step
from continuation.switching import refine_branch_point

__all__ = ["FAILED", "SINGULAR", "SolvedFamily", "step_of"]

_BRANCHING = 1
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


class SolvedFamily:
    """A family of the solutions of a multipoint problem; a `continuation.Problem` needs test functions besides.

    Parameters
    ----------
    problem : MultipointProblem or ForcedProblem
    """

    problem: Any

    def _step(self, solution: Solution | None) -> Step:
        """A solution as the engine sees it, with its test functions."""
        raise NotImplementedError

    def begin(self, y: np.ndarray) -> Step:
        """See `continuation.Problem`."""
        return self._step(self.problem.step(y, np.zeros(2 * self.problem.unknowns), 0.0))

    def step(self, y: np.ndarray, tangent: np.ndarray, ds: float) -> Step:
        """See `continuation.Problem`; the tangent carries its curvature behind it, (2 u,)."""
        return self._step(self.problem.step(y, tangent, ds))

    def step_near(self, y: np.ndarray, tangent: np.ndarray, ds: float, guess: np.ndarray) -> Step:
        """See `continuation.Problem`."""
        along = tangent[: y.size]
        # the prediction is y + ds (tangent + ds/2 curvature)
        return self.step(y, np.concatenate([along, 2.0 * (guess - y - ds * along) / (ds * ds)]), ds)

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
