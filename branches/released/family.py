"""A family of free orbits in a parameter as a problem of the continuation engine.

The steps are those of `bvp.released`. Each orbit is one of the system at its own parameters. The test functions are those of a family in
the energy there (`branches.family`), but for the fold and the branch point, which are those of this family.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np

from branches.family import Family
from branches.forced.along_parameters import AlongParameters, parameter_bounds
from branches.images import Image, images_within
from branches.kernels.functions import CONDITION_NOISE, TANGENT_NOISE, is_orbit
from branches.solved_family import FAILED, SolvedFamily, step_of
from bvp.multipoint import MultipointProblem, Solution
from bvp.released import SLACK, ReleasedProblem
from continuation.images import Symmetry
from continuation.location import Location
from continuation.problem import EventDetails, Point, Step, TestFunction

__all__ = ["PlacedSolution", "ReleasedFamily", "placed"]


_SMOOTH_NOISE = 5e-12
"""`TANGENT_NOISE` of orbits with smooth forces in a parameter. Measured: 1.5e-12, beside a branch point of closed orbits."""


@dataclass(eq=False, slots=True)
class PlacedSolution(Solution):
    """A solution of the problem of the system at its own parameters.

    Parameters
    ----------
    problem : MultipointProblem
    """

    problem: MultipointProblem


def placed(problem: ReleasedProblem, y: np.ndarray) -> PlacedSolution | None:
    """An orbit as a solution of the problem of the system at its parameters; None where that system has no such orbit."""
    try:
        plain, at = problem.orbit_problem(y)
    except (ValueError, RuntimeError):
        return None
    found = plain.step(at, np.zeros(2 * plain.unknowns), 0.0, maximum=0)
    if found is None or not is_orbit(found.result):
        return None
    return PlacedSolution(found.y, found.tangent, found.position, found.ends, found.result, plain)


class ReleasedFamily(AlongParameters, Family):
    """A family of free orbits in one parameter: a `continuation.Problem`.

    Parameters
    ----------
    problem : ReleasedProblem
        Its first released parameter is the one that is reported.
    interval : (float, float)
        The family ends at these values of the parameter.
    values : sequence of float
        Values of the parameter that are marked.
    """

    def __init__(self, problem: ReleasedProblem, interval: tuple[float, float] = (-math.inf, math.inf), values: tuple[float, ...] = ()):
        super().__init__(problem.structure)
        self.problem = problem
        self.values = values
        self.advance = None  # each point has a system of its own
        self.interval, ends = parameter_bounds(problem, interval)
        # With the energy given at each value of the parameters, the fold in the energy is that in the parameter.
        self._folds_apart = any("quarter_period" in text for text in problem.keep)
        tests = list(self.tests)
        name = problem.released[0]
        self._unit = abs(problem.values[name]) or 1.0
        self._noise = _SMOOTH_NOISE if problem.is_smooth else TANGENT_NOISE
        tests[0] = TestFunction("SN", "crossing", False, f"fold in {name}", True)
        if problem.starts_rising:
            words = "the sum of the modal displacements no longer passes zero at the start of the orbit"
            tests[3] = TestFunction("EP", "guard", True, f"{words}; start from another maximum of it")
        tests[5:7] = [TestFunction("EP", "guard", True, end) for end in ends]
        tests[7] = TestFunction("SN", "crossing", False, "fold in the energy, at these parameters")
        self.tests = (*tests, *(TestFunction("UZ", "crossing", False, f"{name} = {value:g}") for value in values))

    step = SolvedFamily.step

    def symmetries(self, y: np.ndarray) -> list[Symmetry]:
        """See `continuation.Problem`; none of closed orbits without impacts, which begin at another maximum at each value."""
        released = self.problem
        if released.starts_rising:
            return []
        plain = released.orbit_problem(y)[0]
        images = images_within(plain, len(plain.sequence))
        return [partial(released.changed, change=image.unknowns) for image in images if image != Image(False, False)]

    def _step(self, solution: Solution | None) -> Step:
        if solution is None:
            return FAILED
        parameter, (low, high) = solution["energy"], self.interval
        orbit = placed(self.problem, self._inside(solution.y))
        if orbit is None:
            if low <= parameter <= high:
                return FAILED
            # Beyond the domain there is no system, but its end is located.
            tests = [math.nan] * len(self.tests)
            tests[5], tests[6] = parameter - low, high - parameter
            return step_of(solution, solution.result.tolist(), tests)
        tests = self._steps_of(orbit.problem).values(orbit)
        # The slope in the energy, nan where it is rounding, and the determinant have the same orientation, which is as it comes.
        tests[7] = tests[0] * math.copysign(1.0, orbit["branching"]) if self._folds_apart else math.nan
        # Along a family of one value of the parameter the slope is rounding, and near a branch point: see `common_tests`.
        slope, unit = abs(solution["slope"]), solution["steepness"] * self._unit
        certain = slope * solution["branching"] ** 2 > self._noise * unit and slope * solution["conditioning"] ** 2 > CONDITION_NOISE * unit
        tests[0], tests[1] = solution["slope"] if certain else math.nan, solution["branching"]
        if self.problem.starts_rising:
            tests[3] = self.problem.rise(solution.y)
        tests[5], tests[6] = parameter - low, high - parameter
        return step_of(solution, solution.result.tolist(), [*tests, *(parameter - value for value in self.values)])._replace(extra=orbit)

    def _inside(self, y: np.ndarray) -> np.ndarray:
        """The unknowns with the parameter at an end of the interval if it is beyond that by rounding: beyond may be no system."""
        place = self.problem.place
        within = min(max(y[place], self.interval[0]), self.interval[1])
        if within == y[place] or abs(within - y[place]) > SLACK * self._unit:
            return y
        found = y.copy()
        found[place] = within
        return found

    def classify(self, index: int, before: Point, at: Step, after: Point, location: Location) -> EventDetails | None:
        """What an event is, in the terms of the record."""
        if self.tests[index].code == "UZ":
            return EventDetails("UZ", False, {"note": self.tests[index].label})
        return super().classify(index, before, at, after, location)

    def orbit_of(self, solution: Solution) -> tuple[MultipointProblem, Solution]:
        assert isinstance(solution, PlacedSolution)
        return solution.problem, solution
