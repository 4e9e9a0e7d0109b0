"""The test functions of a curve of grazings of forced orbits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.linalg.lapack import dgesv

from branches.curves.grazing import Grazing, beside_grazing, observed
from branches.curves.monitor import CurvePoint, Window, has_pair, meeting_of, pair_product, window_tests, window_values
from branches.curves.plane import ParameterPlane, closing_block
from bvp.forced import ForcedProblem
from bvp.kernels.dense import determinant, eigenvalues, least_singular
from bvp.kernels.multipoint import CLEARANCE, RESULT
from bvp.multipoint import Solution
from continuation.curves import Held, Linearised
from continuation.location import Location
from continuation.problem import EventDetails, Point, Step, TestFunction

__all__ = ["SECOND_GRAZING", "GrazingMonitor", "signed_smallest"]

_NEXT = 1e-4
"""Part of the period beside a flight without duration in which no other touch is looked for."""

SECOND_GRAZING = (
    *(
        TestFunction("GR-GR", "guard", True, f"two grazings at once: {what}")
        for what in ("a flight touches a stop", "the speed of another impact reaches zero", "a flight time reaches zero")
    ),
    TestFunction("GR-GR", "guard", True, "the touch is degenerate: the acceleration of the gap vanishes there"),
)
"""Guards of a curve of grazings: clearance, speed and flight time of all else, and the acceleration at the touch."""

_WORDS = {"SB": "symmetry breaking", "PD": "period doubling"}


class GrazingMonitor:
    """The test functions of a curve of grazings.

    Parameters
    ----------
    plane : ParameterPlane
    grazing : Grazing
    window : Window
    """

    def __init__(self, plane: ParameterPlane, grazing: Grazing, window: Window):
        self.plane, self.grazing, self.window = plane, grazing, window
        turned = "SB" if plane.problem.half else "PD"
        self.tests = (
            *window_tests(plane, window),
            *SECOND_GRAZING,
            TestFunction("SN-GR", "crossing", False, "a fold of the orbits with the impact meets the grazing"),
            TestFunction(f"{turned}-GR", "crossing", False, f"a {_WORDS[turned]} of the orbits with the impact meets the grazing"),
            TestFunction("NS-GR", "crossing", False, "a Neimark-Sacker bifurcation of the orbits with the impact meets the grazing"),
        )
        self._shifted = closing_block(plane)
        self._single = None if grazing.repeats is None else _SingleTouch(plane.problem, grazing)

    def values(
        self, at: Linearised, own: np.ndarray, held: Held, tangent: np.ndarray, scale: np.ndarray
    ) -> tuple[Sequence[float], Any]:
        """See `continuation.curves.Monitor`."""
        problem, grazing = self.plane.problem, self.grazing
        y, flights, ends = at.y, problem.flight_times(at.y), problem._factor.before.copy()
        # Releases have no speed.
        flights_hit = (problem.impacts - 1) % (problem.inner + 1) if problem.sequence else np.zeros(0, dtype=int)
        if grazing.kind == "speed":
            flights_hit = flights_hit[flights_hit != grazing.flight]
        speeds = problem._approach()[flights_hit]
        solution = Solution(y, np.concatenate([tangent[: y.size], np.zeros(y.size)]), self.plane.position(y), ends, np.zeros(0))
        bend, clearance = 1.0, math.inf
        if grazing.kind == "speed":
            one, shown, i = problem, y, grazing.flight
            if self._single is not None:
                one, shown = self._single.problem, self._single.unknowns(y)
                one.residual(shown)
                i = one.inner
            shown, shown_ends, bend = beside_grazing(one, shown, one._factor.before, i, wraps=True)
            result = np.full(len(RESULT), math.nan)
            one._observe(shown, shown_ends, result)
            clearance = float(result[CLEARANCE])
        elif grazing.kind == "flight":
            shown = np.array(y)
            problem.flight_times(shown)[grazing.flight] = 0.0
            seen = observed(problem, shown)
            clearance = math.inf if _is_at_instant(problem, seen, grazing.flight) else seen["clearance"]
            flights = np.delete(flights, grazing.flight)
        least_flight = float(flights.min(initial=math.inf))
        slowest = float(speeds.min(initial=math.inf))
        fixed = at.extra * scale
        shifted = self._shifted * scale
        finite = finite_multipliers(fixed, shifted)
        tests = [signed_smallest(fixed), signed_smallest(fixed - 2.0 * shifted), pair_product(finite.tolist())]
        values = [*window_values(self.plane, at.parameters, self.window), clearance, slowest, least_flight, bend, *tests]
        return values, CurvePoint(solution, finite, math.nan, math.nan)

    def classify(self, index: int, before: Point, at: Step, after: Point, location: Location) -> EventDetails | None:
        """What an event is."""
        test = self.tests[index]
        if test.kind == "crossing" and location.kind in ("pole", "jump"):
            return None
        if test.code == "NS-GR" and not has_pair(at.extra.multipliers, math.nan):
            return None
        if test == SECOND_GRAZING[2]:
            solution = observed(self.plane.problem, at.y)
            if int(solution["flight_index"]) != self.grazing.flight and (met := meeting_of(self.plane.problem, solution)) is not None:
                return met
        return EventDetails(test.code, test.terminal, {"stop": None, "note": test.label})


def finite_multipliers(matrix: np.ndarray, shifted: np.ndarray) -> np.ndarray:
    """The multipliers of orbits that graze, (2 n,): those of the pencil, of which one has no bound and is NaN. matrix, shifted: B at
    lambda = 1, and B1."""
    rows, columns = np.nonzero(shifted)
    found = np.full(len(rows) - len(rows) % 2, complex(math.nan, math.nan))
    _, _, solved, singular = dgesv(matrix, shifted[:, columns])
    if singular or not np.isfinite(solved).all():  # rounding can hide that the matrix is singular
        return found
    real, imaginary = np.empty((2, len(columns)))
    if not eigenvalues(np.ascontiguousarray(solved[columns]), real, imaginary):
        return found
    largest = sorted(map(complex, real.tolist(), imaginary.tolist()), key=abs, reverse=True)[: len(found) - 1]
    kept = np.array(sorted(largest, key=lambda value: (value.real, value.imag)))
    found[: len(kept)] = 1.0 - 1.0 / kept
    return found


class _SingleTouch:
    """An orbit that would repeat itself but for its touch, as one with a single touch: the images of the touch are left out."""

    def __init__(self, problem: ForcedProblem, grazing: Grazing):
        assert grazing.repeats is not None
        periods, half = grazing.repeats
        self.whole = problem
        self.first = (grazing.flight + 1) % (problem.inner + 1)
        # The impacts in one repetition: the others but the touch are as many times as many.
        parts = problem.load_periods // periods * (2 if half and not problem.half else 1)
        count = 1 + (len(problem.sequence) - 1) // parts
        order = [(self.first + k) % (problem.inner + 1) for k in range(count)]
        letters = [problem.sequence[k] if k >= self.first else self._later(k) for k in order]
        self.order = np.array(order)
        self.parts = parts
        self.problem = problem.sibling(letters, load_periods=periods, half=half)

    def _later(self, k: int) -> str:
        return self.whole.mirrored(self.whole.sequence[k]) if self.whole.half else self.whole.sequence[k]

    def unknowns(self, y: np.ndarray) -> np.ndarray:
        """The orbit in the unknowns of that problem."""
        whole, n = self.whole, self.whole.degrees_of_freedom
        nodes, times = whole.nodes(y)[self.order].copy(), whole.flight_times(y)[self.order].copy()
        nodes[self.order < self.first, : 2 * n] *= whole.segment.closing[0]
        times[-1] = float(np.sum(whole.flight_times(y))) / self.parts - float(np.sum(times[:-1]))
        fractions = nodes[:, 2 * n] * whole.load_periods / self.problem.load_periods
        return self.problem.pack(nodes[:, : 2 * n], fractions, nodes[0, 2 * n + 1 :], times)


def _is_at_instant(problem: ForcedProblem, solution: Solution, flight: int) -> bool:
    """Whether the closest touch is where a flight without duration is."""
    where, time, count = int(solution["clearance_flight"]), float(solution["clearance_time"]), problem.inner + 1
    short = _NEXT * problem.period(solution.y)
    if where == (flight + 1) % count:
        return time < short
    return where == flight or (where == (flight - 1) % count and time > problem.flight_times(solution.y)[where] - short)


def signed_smallest(matrix: np.ndarray) -> float:
    """A lower bound of the smallest singular value, sharp to the root of the matrix's size, with the sign of the determinant."""
    factors = np.array(matrix)
    sign = math.copysign(1.0, determinant(factors))
    return sign * float(least_singular(factors, np.empty_like(factors)))
