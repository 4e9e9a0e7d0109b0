"""Orbits on curves of free orbits: what is seen of each, and the critical matrices of their surface."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from branches.curves.free import BOTH, FOLD, SYMMETRIES, Breaking, Fold, Symmetry, with_rows_of_one
from branches.curves.free_grazing import approach_speeds
from branches.curves.grazing_monitor import SPEED, enter_least, signed_smallest
from branches.curves.plane import ParameterPlane
from bvp.closures import REST
from bvp.forced import Flights
from bvp.kernels.extrema import TIE
from bvp.multipoint import Solution
from bvp.orbits import RESULT_INDEX
from bvp.released import ReleasedProblem
from continuation.curves import Linearised

__all__ = ["Critical", "FreePoint", "event_of", "half_multiplier", "observed_free"]


def observed_free(problem: ReleasedProblem, y: np.ndarray, flights: Flights | None = None) -> Solution:
    """An orbit as it stands, with its clearance, its slowest impact and its shortest flight. flights: those that are looked at, or all."""
    shown = problem.flights(y) if flights is None else flights
    result = problem.observed(y, shown)
    _see_rests(problem, y, shown, result)
    nodes, speeds = approach_speeds(problem, y, shown.ends)
    enter_least(result, SPEED, speeds, nodes)
    result[RESULT_INDEX["quarter_period"]] = problem.period(y) / 4.0
    return Solution(np.array(y), np.zeros(2 * y.size), problem.position(y), shown.ends, result)


def _see_rests(problem: ReleasedProblem, y: np.ndarray, shown: Flights, result: np.ndarray) -> None:
    """Where an orbit is at rest all gaps turn: compare their distances from the stops with the clearance in a result."""
    stops, k, n, layout = problem.contact_modes.stops, problem.inner, problem.degrees_of_freedom, problem.parametric.layout
    if problem.structure.periodic or not len(stops):
        return
    entries = problem.parametric.entries(problem.parameters(y))
    clearance, time_of = RESULT_INDEX["clearance"], RESULT_INDEX["clearance_time"]
    places = (0, shown.begins[0, :n], 0.0), (k, shown.ends[k, :n], float(shown.times[k]))
    for kind, (flight, x, time) in zip(problem.structure.kinds, places, strict=True):
        if kind != REST:
            continue
        gaps = stops @ x
        distances = np.stack([entries[layout.upper] - gaps, gaps - entries[layout.lower]], axis=1).ravel()
        # At a tie the earlier instant counts, and the first stop.
        least, tie = float(distances.min()), TIE * float(np.abs(gaps).max())
        if least < result[clearance] + (tie if time == 0.0 else -tie):
            stop, lower = divmod(int(np.argmax(distances <= least + tie)), 2)
            result[clearance : time_of + 1] = min(least, result[clearance]), flight, stop, 1.0 - 2.0 * lower, time


def event_of(problem: ReleasedProblem, symmetry: Symmetry) -> tuple[str, str]:
    """The type of event of a critical perturbation, and what happens there."""
    if symmetry == FOLD:
        return "SN", "fold"
    if symmetry == BOTH:
        return "SB", "the last reversal is broken"
    kept = f"the reversal about the {'far end' if symmetry[0] else 'start'} stays"
    return ("SB", f"half-period symmetry breaks, {kept}") if problem.quarters == 1 else ("PD", f"period doubling, {kept}")


def half_multiplier(symmetry: Symmetry) -> int:
    """The multiplier of the map between equal reversals, of half a period or of all of it."""
    return -1 if symmetry[0] != symmetry[1] else 1


class Critical:
    """The critical matrices of a surface of orbits, as numbers that pass zero where they are singular."""

    def __init__(self, plane: ParameterPlane, without: Iterable[Symmetry], doubled: bool = False):
        problem = plane.problem
        assert isinstance(problem, ReleasedProblem)
        self.fold = Fold(plane, in_energy=True)
        self.breaking = None if problem.structure.periodic else Breaking(plane)
        # A period doubling of a quarter period is solved on half of it, where two perturbations are critical at once.
        skipped = {*without, *([(False, True), (True, False)] if doubled else [])}
        every = (FOLD, *(SYMMETRIES if self.breaking else ()))
        # With one degree of freedom the energy and the stops hit determine the orbit.
        self.symmetries = [symmetry for symmetry in every if symmetry not in skipped and problem.degrees_of_freedom > 1]

    def values(self, at: Linearised, scale: np.ndarray) -> list[float]:
        found = []
        for symmetry in self.symmetries:
            if symmetry == FOLD:
                matrix = self.fold.matrix(at)
            else:
                assert self.breaking is not None
                matrix = self.breaking.matrix(at, symmetry)
            found.append(signed_smallest(with_rows_of_one(matrix * scale)))
        return found


@dataclass(frozen=True, eq=False)
class FreePoint:
    """An orbit on a curve, as `branches.curves.monitor.CurvePoint`. Its multipliers and its coefficient, which `normal_form` gives, are
    computed when they are wanted."""

    problem: ReleasedProblem
    solution: Solution
    normal_form: Callable[[], float] = lambda: math.nan
    cosine: float = math.nan

    @cached_property
    def coefficient(self) -> float:
        """Of the normal form; NaN where it is not known."""
        return self.normal_form()

    @cached_property
    def multipliers(self) -> np.ndarray:
        """(2 n,), those of the full period; NaN where an impact grazes."""
        try:
            return self.problem.multipliers(self.solution.y)
        except (ValueError, RuntimeError, np.linalg.LinAlgError):
            return np.full(2 * self.problem.degrees_of_freedom, complex(math.nan, math.nan))
