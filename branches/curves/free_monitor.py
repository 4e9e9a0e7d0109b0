"""The test functions of curves of bifurcations, and of grazings, of free orbits."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from branches.admissible import GRAZING, describe_grazing
from branches.curves.free import Symmetry
from branches.curves.free_grazing import approach_speeds, are_at, impact_places, touch_as_impact
from branches.curves.free_normal_form import CurveNormalForm
from branches.curves.free_points import Critical, FreePoint, event_of, half_multiplier, observed_free
from branches.curves.grazing import Grazing, beside_grazing
from branches.curves.grazing_monitor import FLIGHT, SECOND_GRAZING, SPEED, enter_least, second_grazing
from branches.curves.monitor import NAMES, Window, fold_coefficient, window_tests, window_values
from branches.curves.plane import ParameterPlane
from branches.presentation import symmetries
from bvp.closures import cycle_of
from bvp.multipoint import Solution
from bvp.released import ReleasedProblem
from continuation.curves import Held, Linearised
from continuation.location import Location
from continuation.problem import EventDetails, Point, Step, TestFunction

__all__ = ["FreeGrazingMonitor", "FreeMonitor"]


class FreeMonitor:
    """The test functions of a curve of SN, SB or PD of free orbits.

    Parameters
    ----------
    plane : ParameterPlane
    code : {"SN", "SB", "PD"}
    symmetry : (bool, bool)
        Of the critical perturbation, see `branches.curves.free.free_condition`.
    window : ((float, float), (float, float))
        Ranges of the two parameters.
    doubled : bool
        Whether the orbits are symmetric in half the period that is solved for.

    Notes
    -----
    Where another critical matrix becomes singular, two multipliers of the map between equal reversals are critical: both 1 (R1), both -1
    (R2), or one of each (FF).
    """

    def __init__(self, plane: ParameterPlane, code: str, symmetry: Symmetry, window: Window, doubled: bool = False):
        problem = plane.problem
        assert isinstance(problem, ReleasedProblem)
        self.plane, self.problem, self.code, self.symmetry, self.window = plane, problem, code, symmetry, window
        periodic = problem.structure.periodic
        self._critical = Critical(plane, [symmetry] if code == "SN" or not periodic else [], doubled)
        own = -1 if periodic and code == "PD" else half_multiplier(symmetry)
        others = []
        for other in self._critical.symmetries:
            meets = {(1, 1): "R1", (-1, -1): "R2"}.get((own, half_multiplier(other)), "FF")
            kind, words = event_of(problem, other)
            others.append(TestFunction(meets, "crossing", False, f"a second critical multiplier: {kind}, {words}"))
        self._folds = code == "SN"
        self._form = None if self._folds else CurveNormalForm(plane, symmetry, doubled)
        changes = "DP" if code == "SB" else "GPD"
        forms = (TestFunction(changes, "crossing", False, NAMES[changes]),) * (self._form.count if self._form else 0)
        cusp = (TestFunction("CP", "crossing", False, "cusp: two folds meet", True),) if self._folds else ()
        # Between two ends of one kind an orbit can get both kinds of reversals: then it is its own image, begun at the other end.
        self._exchanged = not periodic and not doubled and problem.quarters == 2 and problem.inner > 0
        image = (TestFunction(_SYMMETRIC[code], "crossing", True, _GOES_BACK),) if self._exchanged else ()
        self.tests = (*window_tests(plane, window), *GRAZING.values(), *cusp, *others, *forms, *image)

    def values(self, at: Linearised, own: np.ndarray, held: Held, tangent: np.ndarray, scale: np.ndarray) -> tuple[Sequence[float], Any]:
        """See `continuation.curves.Monitor`."""
        problem, null = self.problem, held.extra
        solution = observed_free(problem, at.y)
        guards = [solution["clearance"], solution["speed"], solution["flight"]]
        sizes = self.plane.scales(at.y)
        critical = self._critical.values(at, scale)
        found = []
        if self._form is None:
            coefficient = fold_coefficient(null, scale, sizes)
            found += [coefficient, *critical]
            form: Callable[[], float] = partial(abs, coefficient)
        else:
            reduced, way = self._form.reduced(at, held, tangent, sizes)
            # It has poles where the orbits with more symmetry have a fold, whose matrix is the first one.
            known = abs(critical[0]) > _ROUNDING
            found += [*critical, *((reduced * critical[0]).tolist() if known else [math.nan] * len(reduced))]
            form = partial(self._form.coefficient, at.y, reduced, way)
        if self._exchanged:
            flights = problem.flight_times(at.y)
            found.append(float(flights[0] - flights[-1]))
            if abs(found[-1]) < _BESIDE * float(np.sum(flights)):
                found[:-1] = [math.nan] * len(found[:-1])  # these touch zero at a symmetric orbit
        values = [*window_values(self.plane, at.parameters, self.window), *guards, *found]
        return values, FreePoint(problem, solution, form)

    def classify(self, index: int, before: Point, at: Step, after: Point, location: Location) -> EventDetails | None:
        """What an event is."""
        test = self.tests[index]
        data: dict[str, Any] = {"stop": None, "note": test.label}
        if test.code == "GR":
            verb = next(verb for verb, kind in GRAZING.items() if kind == test)
            data.update(describe_grazing(self.problem, at.extra.solution, verb))
            return EventDetails(f"{self.code}-GR", True, data)
        if test.label == _GOES_BACK and not self._is_symmetric(at.y):
            return None
        return EventDetails(test.code, test.terminal, data)

    def _is_symmetric(self, y: np.ndarray) -> bool:
        """Whether an orbit has both kinds of reversals."""
        plain, at = self.problem.orbit_problem(y)
        return len({e for _, e in symmetries(cycle_of(plain, at), _NEARLY).reversals}) == 2


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
        ends = problem.end_states(y)
        nodes, speeds = approach_speeds(problem, y, ends)
        left = nodes == grazing.flight if grazing.kind == "speed" else np.zeros(len(nodes), dtype=bool)
        if left.any() and problem.structure.periodic:
            places = impact_places(problem, y, ends, nodes)
            left = are_at(places, places[left][0], True) & (speeds <= _SLOW * float(np.max(np.abs(ends))))
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
        guards = [solution["clearance"], solution["speed"], solution["flight"], bend]
        values = [*window_values(self.plane, at.parameters, self.window), *guards, *self._critical.values(at, scale)]
        return values, FreePoint(self.problem, solution)

    def second(self, y: np.ndarray) -> tuple[ReleasedProblem, np.ndarray, Grazing]:
        """What else grazes at an orbit of the curve. Result and errors as of `branches.curves.grazing_monitor.GrazingMonitor.second`."""
        problem, grazing = self.problem, self.grazing
        solution = self._observed(y)[0]
        least = second_grazing(problem, solution)
        if least != "clearance":
            return problem, y, Grazing(least, int(solution["speed_node" if least == "speed" else "flight_index"]))
        ends = solution.ends
        return touch_as_impact(problem, y, impact_places(problem, y, ends, np.array([grazing.flight]))[0])

    def _observed(self, y: np.ndarray) -> tuple[Solution, float]:
        """An orbit with all else but its grazing, and the acceleration of the gap at its touch."""
        problem, grazing = self.problem, self.grazing
        whole = problem.flights(y)
        flights, ends, bend = whole.times, whole.ends, 1.0
        if grazing.kind == "flight":
            here = np.arange(len(flights)) == grazing.flight
            shown = whole._replace(times=np.where(here, 0.0, flights))
            flights = np.where(here, math.inf, flights)
        else:
            shown, bend = beside_grazing(problem, y, whole, grazing.flight, problem.structure.periodic)
        nodes, speeds = approach_speeds(problem, y, ends)
        watched = np.isin(nodes, self._others)
        solution = observed_free(problem, y, shown)
        enter_least(solution.result, SPEED, speeds[watched], nodes[watched])
        enter_least(solution.result, FLIGHT, flights, np.arange(len(flights)))
        return Solution(y, solution.tangent, solution.position, ends, solution.result), bend

    def classify(self, index: int, before: Point, at: Step, after: Point, location: Location) -> EventDetails | None:
        """What an event is."""
        test = self.tests[index]
        return EventDetails(test.code, test.terminal, {"stop": None, "note": test.label})


_GOES_BACK = "the orbits get the half-period symmetry: the curve goes back as its image"
_SYMMETRIC = {"SN": "DP", "SB": "R2", "PD": "FF"}
"""What such a point is on the curve of symmetric orbits."""

_ROUNDING = 1e-9
"""A smallest singular value by which no pole can be removed."""

_BESIDE = 1e-5
"""Difference of two flights, as a part of all, of an orbit beside a symmetric one."""

_NEARLY = 1e-4
"""Difference of states and times of a symmetric orbit that is located. The equations are singular there, and steps fail nearby."""

_SLOW = 1e-7
"""Part of the largest velocity or displacement below which the impact of a located grazing has no speed."""
