"""A family of orbits under periodic loads as a problem of the continuation engine: test functions, and the classification of events.

The test functions are those of the stroboscopic map M (`bvp/core/stroboscopic.hpp`): det(M + 1), and the product of 1 - mu_i mu_j over the
pairs of its multipliers, which vanishes at a Neimark-Sacker bifurcation. Both are bounded, and continuous at a grazing.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property, partial
from typing import Any

import numpy as np

from branches.admissible import GRAZING, describe_grazing
from branches.first_orbits import is_denied
from branches.forced.along_parameters import AlongParameters, parameter_bounds
from branches.forced.primitive import SAME, apart_from_image, full_period, half_later, image_sign, later_sign, twice
from branches.forced.resequencing import is_unordered
from branches.forced.resonance import RESONANCE, resonances_around
from branches.kernels.functions import is_orbit
from branches.released.family import ReleasedFamily
from branches.solved_family import FAILED, SINGULAR, SolvedFamily, step_of
from branches.steps import CoreSteps
from bvp.forced import ForcedProblem
from bvp.multipoint import Solution
from bvp.released import ReleasedProblem
from bvp.system import ImpactSystem
from continuation.images import Symmetry
from continuation.location import Location
from continuation.problem import Advance, EventDetails, Point, Step, TestFunction

__all__ = ["ForcedFamily", "parameter_family"]

_ROUNDING = 1e-12
"""Sum of two rates of free motion, beside the fastest of all, that is zero."""

_ON_CIRCLE = 1e-6
"""How far from 1 the modulus of a multiplier can be at an event where a pair is on the unit circle."""

_DOUBLES = "the orbit is one of half the period, traversed twice: its period doubles here"


class ForcedFamily(AlongParameters, SolvedFamily):
    """A family of forced orbits in one parameter: a `continuation.Problem`.

    Parameters
    ----------
    problem : ForcedProblem
        Its first released parameter is the one that is reported.
    interval : (float, float)
        The family ends at these values of the parameter.
    values : sequence of float
        Values of the parameter that are marked.
    resonances : (float, float), optional
        Values of the parameter, below and above, at which the response is unbounded.

    Attributes
    ----------
    tests : tuple of TestFunction
        In the order of their values in each step.
    """

    problem: ForcedProblem

    def __init__(
        self,
        problem: ForcedProblem,
        interval: tuple[float, float] = (-math.inf, math.inf),
        values: tuple[float, ...] = (),
        resonances: tuple[float, float] = (-math.inf, math.inf),
    ):
        self.problem = problem
        self.values = values
        name = problem.released[0]
        (low, high), (first, last) = parameter_bounds(problem, interval)
        first, last = (RESONANCE if resonances[0] > low else first), (RESONANCE if resonances[1] < high else last)
        self.interval = max(low, resonances[0]), min(high, resonances[1])
        turned = ("SB", "the half-period symmetry breaks") if problem.half else ("PD", "period doubling")
        self.tests = (
            TestFunction("SN", "crossing", False, f"fold in {name}", True),
            TestFunction("BP", "crossing", False, "branch point", True, ("SN",), SINGULAR),
            *GRAZING.values(),
            TestFunction("EP", "guard", True, first),
            TestFunction("EP", "guard", True, last),
            TestFunction(turned[0], "crossing", False, turned[1], touches=True),
            TestFunction("NS", "crossing", False, "Neimark-Sacker bifurcation", touches=True),
            *(TestFunction("UZ", "crossing", False, f"{name} = {value:g}") for value in values),
        )
        self._computed = len(self.tests)
        self.advance: Callable[..., Advance] | None = self._advance

    @cached_property
    def neutral(self) -> bool:
        """Whether the product of two multipliers is 1 by their equations: without losses they are reciprocal pairs, and without impacts
        those of an undamped mode stay so. Then signs are rounding."""
        problem = self.problem
        linear = not problem.sequence and not problem.is_smooth
        return problem.system.is_conservative or (linear and _has_neutral_mode(problem.system))

    @cached_property
    def _steps(self) -> CoreSteps:
        limits = (*self.interval, math.inf, 0.0)
        return CoreSteps(self.problem, self.tests, limits, self.values, self._computed, self.neutral)

    def symmetries(self, y: np.ndarray) -> list[Symmetry]:
        """See `continuation.Problem`: the same orbit half a period later, or its mirror image there, where its impacts are the same."""
        sign = later_sign(self.problem)
        return [partial(half_later, self.problem, sign)] if sign else []

    def orbit_of(self, solution: Solution) -> tuple[ForcedProblem, Solution]:
        """The problem that a solution belongs to, with it."""
        return self.problem, solution

    def _step(self, solution: Solution | None) -> Step:
        if solution is None or not is_orbit(solution.result):
            return FAILED
        return step_of(solution, solution.result.tolist(), self._steps.values(solution))

    def classify(self, index: int, before: Point, at: Step, after: Point, location: Location) -> EventDetails | None:
        """What an event is, in the terms of the record."""
        test = self.tests[index]
        solution: Solution = at.extra
        data: dict[str, Any] = {"stop": None, "note": test.label}
        if test.code == "GR":
            verb = next(verb for verb, kind in GRAZING.items() if kind == test)
            data.update(describe_grazing(self.problem, solution, verb))
            if verb == "touches" and solution["clearance_side"] == 0.0 and solution["clearance_time"] > 0.0:
                return EventDetails("LB", True, data | {"note": f"{data['note']}: that is an impact of its own; the family continues"})
            if verb == "merge":
                return self.merging(solution, data)
        elif test.code in ("PD", "SB") and is_denied(*(twice if test.code == "PD" else full_period)(self.problem, at.y)):
            return None
        elif test.code == "NS":
            angle = self._angle_of_pair(at)
            if angle is None:
                return None
            data["angle"] = angle
        elif test.code == "BP" and self._is_twice(at.y) and not self._is_twice(before.step.y):
            # Behind it each orbit is one of those before it, begun a period of the single one later.
            return EventDetails("BP", True, data | {"note": _DOUBLES})
        return EventDetails(test.code, test.terminal, data)

    def _is_twice(self, y: np.ndarray) -> bool:
        """Whether an orbit is another one traversed twice."""
        return image_sign(self.problem) == 1.0 and apart_from_image(self.problem, y) <= SAME

    def merging(self, solution: Solution, data: dict[str, Any]) -> EventDetails:
        """Two impacts at the same instant: at stops that do not interact they exchange their order, else the family ends."""
        problem = self.problem
        flight = int(solution["flight_index"])
        stops = [problem.system.stops[problem.modes.contact_stop[problem.contacts[k]]] for k in (flight - 1, flight)]
        if stops[0].name == stops[1].name:
            return EventDetails("GR", True, data)
        names = f"stops {stops[0].name} and {stops[1].name}"
        if is_unordered(problem, flight):
            speeds = problem.impact_speeds(solution.y)[[flight, flight - problem.inner]]
            if np.abs(speeds).max() <= SAME * problem.units[problem.degrees_of_freedom]:  # both vanish, and meet there
                return EventDetails("GR", True, data | describe_grazing(problem, solution, "vanishes"))
            return EventDetails("LB", True, data | {"note": f"impacts at {names} exchange their order; the family continues"})
        return EventDetails("EP", True, data | {"note": f"{names} are hit at once and interact: restitution does not define what follows"})

    def _angle_of_pair(self, at: Step) -> float | None:
        """The angle in (0, pi) of a pair of multipliers on the unit circle; None where the product of two real ones is 1."""
        found = self.problem.multipliers(at.y)
        upper = sorted(found[found.imag > 0.0], key=np.angle)
        nearest = min(upper, key=lambda one: round(abs(abs(one) - 1.0), 10), default=None)
        return float(np.angle(nearest)) if nearest is not None and abs(abs(nearest) - 1.0) < _ON_CIRCLE else None


def parameter_family(
    problem: ForcedProblem,
    interval: tuple[float, float] = (-math.inf, math.inf),
    values: tuple[float, ...] = (),
    begin: float = math.nan,
) -> ForcedFamily | ReleasedFamily:
    """The family of a problem of forced or free orbits; arguments of its kind. begin: the value of its parameter at the start."""
    if isinstance(problem, ReleasedProblem):
        return ReleasedFamily(problem, interval, values)
    return ForcedFamily(problem, interval, values, resonances_around(problem, begin))


def _has_neutral_mode(system: ImpactSystem) -> bool:
    """Whether two rates of free motion have the sum 0, to rounding: an undamped mode, or a translation."""
    n = system.degrees_of_freedom
    below = -np.linalg.solve(system.mass, np.hstack([system.stiffness, system.damping]))
    rates = np.linalg.eigvals(np.vstack([np.eye(n, 2 * n, n), below]))
    sums = np.abs(rates[:, None] + rates)[np.triu_indices(2 * n, 1)]
    return bool(sums.min() <= _ROUNDING * np.abs(rates).max())
