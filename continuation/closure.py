"""Recognising that a family has come back to a point where it was before."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from continuation.control import height
from continuation.location import Locator, StepRefused, bracketed_root
from continuation.problem import Point, Problem, Step
from continuation.settings import Settings

_PARALLEL = 0.999  # cosine between the tangents at one point of one curve


class Closure:
    """Watches for the return of a run to a goal: its start, or where the run in the other direction has come to.

    The goal is passed where the position goes through the plane on it with a normal along the curve. There the step
    is shortened to land on that plane; the family is closed if it then lands on the goal itself, in position and in the
    unknowns, with its tangent pointing the same way.

    Parameters
    ----------
    problem : Problem
        The problem.
    settings : Settings
        `location_tolerance` and `coincidence_tolerance` are used.
    goal : Step
        The point to come back to, its tangent pointing the way that the run goes.
    direction : array_like
        Normal of the plane, roughly along the curve at the goal, the way that the run goes.
    """

    def __init__(self, problem: Problem, settings: Settings, goal: Step, direction: Any) -> None:
        self._problem = problem
        self._settings = settings
        self._goal = goal
        self.origin = np.asarray(goal.position, dtype=float)
        self.direction = np.asarray(direction, dtype=float)

    def _height(self, step: Step) -> float:
        return float(height(step.position, self.origin, self.direction))

    def landing(self, before: Point, after: Step, ds: float) -> tuple[float, Step] | None:
        """The step from `before` that lands on the goal, and its length, if the step to `after` of length ds passes it."""
        low, high = self._height(before.step), self._height(after)
        if not low < 0.0 <= high:
            return None
        locator = Locator(self._problem, before, self._settings)
        locator.enter(ds, after)
        try:
            found = bracketed_root(
                lambda s: self._height(locator.step(s)), 0.0, low, ds, high, self._settings.location_tolerance
            )
            step = locator.step(found.root)
        except StepRefused:
            return None
        near = self._settings.coincidence_tolerance
        goal = self._goal
        if found.interrupted or math.dist(step.position, goal.position) > near:
            return None
        if float(np.max(np.abs(step.y - goal.y))) > near * (1.0 + float(np.max(np.abs(goal.y)))):
            return None
        lengths = float(np.linalg.norm(step.tangent)) * float(np.linalg.norm(goal.tangent))
        if not float(step.tangent @ goal.tangent) > _PARALLEL * lengths:
            return None  # another branch through the same point
        return found.root, step
