"""What families in released parameters have in common: where their parameters end, and where their motion has no bound."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from bvp.forced import ForcedProblem
from bvp.multipoint import lost_digits
from bvp.released import ReleasedProblem
from continuation.problem import Point

__all__ = ["AlongParameters", "parameter_bounds", "unbounded"]

_LARGE = 100.0
"""Size of a state, in units of the metric, from which on a resonance is looked for."""

_UNBOUNDED = 1e10
"""The same, at which a motion without a clock is unbounded: the parameter approaches its limit with the inverse of the size."""

_FAST, _LIGHT = 10.0, 1e-3
"""Size of a state, in units of the metric, from which on the masses are looked at; and a mass, beside that of the scene, that vanishes."""

_UNDAMPED, _NEAR = 1e-10, 0.3
"""Distance of a multiplier from the unit circle, and from 1, at the resonance of an undamped mode."""


def parameter_bounds(problem: ForcedProblem, interval: tuple[float, float]) -> tuple[tuple[float, float], tuple[str, str]]:
    """The values between which the first released parameter stays, of those asked for and its domain; and what ends a family there."""
    name = problem.released[0]
    low, high = problem.parametric.domain(name)
    texts = [
        f"{side} value of {name} asked for" if inside else f"{name} leaves its domain here"
        for side, inside in (("lowest", interval[0] >= low), ("highest", interval[1] <= high))
    ]
    return (max(low, interval[0]), min(high, interval[1])), (texts[0], texts[1])


class AlongParameters:
    """What families in released parameters have in common."""

    problem: Any

    def sizes(self, y: np.ndarray) -> np.ndarray:
        """See `continuation.Problem`."""
        scale = self.problem.scales(y)
        return np.where(scale > 0.0, scale, np.maximum(np.abs(y), 1.0))

    def second_derivative(self, y: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """F''(y)[a, b], for switching."""
        found: np.ndarray = self.problem.second_derivative(y, a, b)
        return found

    def failure(self, y: np.ndarray, tangent: np.ndarray, ds: float) -> str:
        """Where steps fail: the value of the parameter; why the system cannot have the next one, or why a flight cannot be computed."""
        name, problem = self.problem.released[0], self.problem
        why = self.violation(y, tangent, ds) or lost_digits(problem, y)
        return f"at {name} = {self.problem.parameters(y)[name]:.6g}" + (f": {why}" if why else "")

    def violation(self, y: np.ndarray, tangent: np.ndarray, ds: float) -> str | None:
        """Why the system cannot have the parameters at a distance along the tangent; None if it can."""
        found: str | None = self.problem.violation(y + ds * tangent[: y.size])
        return found


def unbounded(problem: ForcedProblem) -> Callable[[Point], str | bool] | None:
    """The condition that the motion grows without bound, in words: without impacts towards the resonance of an undamped mode, and without
    a clock where the stops lose no more than the motion gains; of free orbits where a mass vanishes, and takes its energy."""

    def reach(point: Point) -> float:
        return math.exp(point.step.position[-1])

    def gains(point: Point) -> str | bool:
        return reach(point) > _UNBOUNDED and "the motion grows without bound"

    def grows(point: Point) -> str | bool:
        if reach(point) < _LARGE:
            return False
        free = problem.multipliers(point.step.y)
        near = free[np.argmin(np.abs(free - 1.0))]
        undamped = abs(abs(near) - 1.0) < _UNDAMPED and abs(near - 1.0) < _NEAR
        return "the response grows without bound: an undamped mode is near its resonance" if undamped else False

    def vanishes(point: Point) -> str | bool:
        if reach(point) < _FAST:
            return False
        mass, first = (problem.parametric.system(values).mass for values in (problem.parameters(point.step.y), None))
        lightest = float(np.abs(np.linalg.eigvals(np.linalg.solve(first, mass))).min())
        return lightest < _LIGHT and "a mass is below 1/1000 of the scene's, and the velocities grow without bound"

    if isinstance(problem, ReleasedProblem):
        return vanishes
    if not problem.has_clock:
        return gains
    return None if problem.sequence else grows
