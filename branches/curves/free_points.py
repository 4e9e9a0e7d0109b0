"""Orbits on curves of free orbits: what is seen of each, and the critical matrices of their surface."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from branches.curves.free import BOTH, FOLD, SYMMETRIES, Breaking, Fold, Symmetry, with_rows_of_one
from branches.curves.free_grazing import approach_speeds
from branches.curves.grazing_monitor import enter_least, signed_smallest
from branches.curves.plane import ParameterPlane
from bvp.forced import ForcedProblem
from bvp.kernels.extrema import TIE
from bvp.kernels.multipoint import CLEARANCE, CLEARANCE_TIME, QUARTER_PERIOD, REST, RESULT, SPEED, SPEED_NODE
from bvp.multipoint import Solution
from bvp.released import ReleasedProblem
from continuation.curves import Linearised

__all__ = ["Critical", "FreePoint", "event_of", "half_multiplier", "observed_free"]


def observed_free(problem: ReleasedProblem, y: np.ndarray, ends: np.ndarray | None = None) -> Solution:
    """An orbit as it stands, with its clearance, its slowest impact and its shortest flight. ends: the states after the flights of the
    orbit that was evaluated last; None: y is evaluated."""
    if ends is None:
        problem.residual(y)
        ends = problem._factor.before.copy()
    result = np.full(len(RESULT), math.nan)
    ForcedProblem._observe(problem, np.array(y), ends, result)
    _see_rests(problem, y, ends, result)
    nodes, speeds = approach_speeds(problem, y, ends)
    enter_least(result, [SPEED, SPEED_NODE], speeds, nodes)
    result[QUARTER_PERIOD] = float(np.sum(problem.flight_times(y))) / problem.quarters
    return Solution(np.array(y), np.zeros(2 * y.size), np.zeros(problem.size), ends, result)


def _see_rests(problem: ReleasedProblem, y: np.ndarray, ends: np.ndarray, result: np.ndarray) -> None:
    """Where an orbit is at rest all gaps turn: compare their distances from the stops with the clearance in a result."""
    watched, k, n = problem._watched, problem.inner, problem.degrees_of_freedom
    bounds = problem.segment.released.entries[watched.bounds]
    places = (0, y[:n], 0.0), (k, ends[k, :n], float(problem.flight_times(y)[k]))
    for kind, (flight, x, time) in zip(() if problem.structure.periodic else problem.kinds, places, strict=False):
        if kind != REST or not len(watched.gaps):
            continue
        gaps = watched.gaps @ x
        distances = np.stack([bounds[1] - gaps, gaps - bounds[0]], axis=1).ravel()
        # At a tie the earlier instant counts, and the first stop.
        least, tie = float(distances.min()), TIE * float(np.abs(gaps).max())
        if least < result[CLEARANCE] + (tie if time == 0.0 else -tie):
            stop, lower = divmod(int(np.argmax(distances <= least + tie)), 2)
            result[CLEARANCE : CLEARANCE_TIME + 1] = min(least, result[CLEARANCE]), flight, stop, 1.0 - 2.0 * lower, time


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
