"""The test functions of curves of grazings of free orbits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from branches.curves.free_grazing import approach_speeds, are_at, impact_places, touch_as_impact
from branches.curves.free_points import Critical, FreePoint, event_of, observed_free
from branches.curves.grazing import Grazing, beside_grazing
from branches.curves.grazing_monitor import SECOND_GRAZING, enter_least, second_grazing
from branches.curves.monitor import Window, window_tests, window_values
from branches.curves.plane import ParameterPlane
from bvp.kernels.multipoint import (
    FLIGHT,
    FLIGHT_INDEX,
    SPEED,
    SPEED_NODE,
)
from bvp.multipoint import Solution
from bvp.released import ReleasedProblem
from continuation.curves import Held, Linearised
from continuation.location import Location
from continuation.problem import EventDetails, Point, Step, TestFunction

__all__ = ["FreeGrazingMonitor"]


class FreeGrazingMonitor:
    """The test functions of a curve of grazings of free orbits.

    Parameters
    ----------
    plane : ParameterPlane
    grazing : Grazing
    y : (u,) float
        An orbit of the curve. Images of the touch have no speed along the curve, either.
    window : Window
    """

    def __init__(self, plane: ParameterPlane, grazing: Grazing, y: np.ndarray, window: Window):
        problem = plane.problem
        assert isinstance(problem, ReleasedProblem)
        self.plane, self.problem, self.grazing, self.window = plane, problem, grazing, window
        self._critical = Critical(plane, [])
        problem.residual(y)
        nodes, speeds = approach_speeds(problem, y, problem._factor.before)
        left = nodes == grazing.flight if grazing.kind == "speed" else np.zeros(len(nodes), dtype=bool)
        if left.any() and problem.structure.periodic:
            places = impact_places(problem, y, problem._factor.before, nodes)
            left = are_at(places, places[left][0], True) & (speeds <= _SLOW * float(np.max(np.abs(problem._factor.before))))
        self._others = nodes[~left]
        events = [event_of(problem, symmetry) for symmetry in self._critical.symmetries]
        self.tests = (
            *window_tests(plane, window),
            *SECOND_GRAZING,
            *(TestFunction(f"{code}-GR", "crossing", False, f"orbits with the impact: {words}") for code, words in events),
        )

    def values(self, at: Linearised, own: np.ndarray, held: Held, tangent: np.ndarray, scale: np.ndarray) -> tuple[Sequence[float], Any]:
        """See `continuation.curves.Monitor`."""
        solution, bend = self._observed(at.y)
        self.problem.residual(at.y)
        guards = [solution["clearance"], solution["speed"], solution["flight"], bend]
        values = [*window_values(self.plane, at.parameters, self.window), *guards, *self._critical.values(at, scale)]
        return values, FreePoint(self.problem, solution)

    def second(self, y: np.ndarray) -> tuple[ReleasedProblem, np.ndarray, Grazing]:
        """What else grazes at an orbit of the curve. Result and errors as of `branches.curves.grazing_monitor.GrazingMonitor.second`."""
        problem, grazing = self.problem, self.grazing
        problem.residual(y)
        solution = self._observed(y)[0]
        least = second_grazing(problem, solution)
        if least != "clearance":
            return problem, y, Grazing(least, int(solution["speed_node" if least == "speed" else "flight_index"]))
        ends = solution.ends
        return touch_as_impact(problem, y, impact_places(problem, y, ends, np.array([grazing.flight]))[0])

    def _observed(self, y: np.ndarray) -> tuple[Solution, float]:
        """The orbit that was evaluated last, with all else but its grazing, and the acceleration of the gap at its touch."""
        problem, grazing, ends = self.problem, self.grazing, self.problem._factor.before.copy()
        flights, shown, shown_ends, bend = problem.flight_times(y), np.array(y), ends, 1.0
        if grazing.kind == "flight":
            problem.flight_times(shown)[grazing.flight] = 0.0
            flights = np.where(np.arange(len(flights)) == grazing.flight, math.inf, flights)
        else:
            shown, shown_ends, bend = beside_grazing(problem, y, ends, grazing.flight, problem.structure.periodic)
        nodes, speeds = approach_speeds(problem, y, ends)
        watched = np.isin(nodes, self._others)
        solution = observed_free(problem, shown, shown_ends)
        enter_least(solution.result, [SPEED, SPEED_NODE], speeds[watched], nodes[watched])
        enter_least(solution.result, [FLIGHT, FLIGHT_INDEX], flights, np.arange(len(flights)))
        return Solution(y, solution.tangent, solution.position, ends, solution.result), bend

    def classify(self, index: int, before: Point, at: Step, after: Point, location: Location) -> EventDetails | None:
        """What an event is."""
        test = self.tests[index]
        if test.kind == "crossing" and location.kind in ("pole", "jump"):
            return None
        return EventDetails(test.code, test.terminal, {"stop": None, "note": test.label})


_SLOW = 1e-7
"""Part of the largest velocity or displacement below which the impact of a located grazing has no speed."""
