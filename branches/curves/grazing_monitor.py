"""The test functions of a curve of grazings of forced orbits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import saltus_core as core
from scipy.linalg.lapack import dgesv

from branches.curves.grazing import Grazing, beside_grazing, grazing_of, grazing_sizes, paths_beside, what_grazes
from branches.curves.monitor import CurvePoint, Window, has_pair, meeting_of, pair_product, window_tests, window_values
from branches.curves.plane import ParameterPlane, closing_block
from bvp.forced import Flights, ForcedProblem
from bvp.kernels.extrema import TIE
from bvp.multipoint import Solution
from bvp.orbits import RESULT_INDEX
from continuation.curves import Held, Linearised
from continuation.location import Location
from continuation.problem import EventDetails, Point, Step, TestFunction

__all__ = ["FLIGHT", "SECOND_GRAZING", "SPEED", "GrazingMonitor", "enter_least", "second_grazing", "signed_smallest"]

_SECOND = 1e-6
"""Largest clearance, speed and flight time, in units of arclength and of the period, of a second grazing at a located point."""

SECOND_GRAZING = (
    *(
        TestFunction("GR-GR", "guard", True, f"two grazings at once: {what}")
        for what in ("a flight touches a stop", "the speed of another impact reaches zero", "a flight time reaches zero")
    ),
    TestFunction("GR-GR", "guard", True, "the touch is degenerate: the acceleration of the gap vanishes there"),
)
"""Guards of a curve of grazings: clearance, speed and flight time of all else, and the acceleration at the touch."""

CLEARANCE = RESULT_INDEX["clearance"]
SPEED = [RESULT_INDEX["speed"], RESULT_INDEX["speed_node"]]
FLIGHT = [RESULT_INDEX["flight"], RESULT_INDEX["flight_index"]]
"""Entries of a result: the least of something, and where it is."""

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
        self._single = None if grazing.repeats is None else _SingleTouch(plane.problem, grazing)
        # Multipliers are zero where all coordinates stick, and a flight without duration changes none: rounding would decide the signs.
        freedom = plane.problem.degrees_of_freedom
        spared = grazing.flight if grazing.kind == "flight" else -1
        closed = [len(one.closed) for k, one in enumerate(plane.problem.events) if k != spared]
        self._forgets = grazing.kind == "held" or max(closed, default=0) >= freedom

    def values(self, at: Linearised, own: np.ndarray, held: Held, tangent: np.ndarray, scale: np.ndarray) -> tuple[Sequence[float], Any]:
        """See `continuation.curves.Monitor`."""
        y, whole = at.y, self.plane.problem.flights(at.y)
        along, others = np.concatenate([tangent[: y.size], np.zeros(y.size)]), self._others(y, whole)
        solution = Solution(y, along, self.plane.position(y), whole.ends, others.result)
        fixed = at.extra * scale
        shifted = closing_block(self.plane, y) * scale
        finite = finite_multipliers(fixed, shifted, self.plane.problem.has_clock)
        tests = [1.0, 1.0, 1.0]
        if not self._forgets:
            tests = [signed_smallest(fixed), signed_smallest(fixed - 2.0 * shifted), pair_product(finite.tolist())]
        guards = [*others.result[[CLEARANCE, SPEED[0], FLIGHT[0]]].tolist(), others.bend]
        values = [*window_values(self.plane, at.parameters, self.window), *guards, *tests]
        return values, CurvePoint(solution, finite, math.nan, math.nan)

    def second(self, y: np.ndarray) -> tuple[ForcedProblem, np.ndarray, Grazing]:
        """What else grazes at an orbit of the curve, as `branches.curves.grazing.grazing_at` gives it.

        Raises
        ------
        ValueError
            Where nothing else does, and where that cannot be continued.
        """
        others, solution = self._observed(y)
        least = second_grazing(self.plane.problem, solution)
        if least == "clearance":
            return grazing_of(others.problem, replace(solution, y=others.y), least)
        return grazing_of(self.plane.problem, solution, least)

    def _observed(self, y: np.ndarray) -> tuple[_Others, Solution]:
        """All else at an orbit, and that as the solution of the curve's own problem."""
        whole = self.plane.problem.flights(y)
        others = self._others(y, whole)
        return others, Solution(y, np.zeros(2 * y.size), self.plane.position(y), whole.ends, others.result)

    def _others(self, y: np.ndarray, whole: Flights) -> _Others:
        """See `_Others`. whole: the flights of the orbit."""
        problem, grazing, flights = self.plane.problem, self.grazing, whole.times
        speeds = np.full(len(flights), math.inf)  # releases have none
        hit = (problem.impacts - 1) % len(flights) if problem.sequence else problem.impacts[:0]
        speeds[hit] = problem.approach(whole.ends)[hit]
        if grazing.kind == "speed":
            speeds[grazing.flight] = math.inf
        elif grazing.kind == "held":
            speeds[:] = math.inf  # all impacts are at the touch
        if grazing.kind in ("flight", "held"):
            flights = np.where(np.arange(len(flights)) == grazing.flight, math.inf, flights)
        found = self._clear(y, whole)
        enter_least(found.result, SPEED, speeds, range(len(speeds)))
        enter_least(found.result, FLIGHT, flights, range(len(flights)))
        return found

    def _clear(self, y: np.ndarray, whole: Flights) -> _Others:
        """The orbit without the neighbourhood of what grazes."""
        problem, grazing, bend = self.plane.problem, self.grazing, 1.0
        if self._single is not None:
            problem, y = self._single.problem, self._single.unknowns(y)
            whole = problem.flights(y)
        if grazing.kind == "speed":
            at = grazing.flight if self._single is None else problem.inner
            shown, bend = beside_grazing(problem, y, whole, at, wraps=True)
            paths = [shown]
        else:
            paths = paths_beside(problem, y, whole, grazing)
        nothing = np.full(len(RESULT_INDEX), math.nan)
        nothing[CLEARANCE] = math.inf
        seen = [_seen(problem, y, whole, path) for path in paths]
        return _Others(problem, y, min(seen, key=lambda result: float(result[CLEARANCE]), default=nothing), bend)

    def classify(self, index: int, before: Point, at: Step, after: Point, location: Location) -> EventDetails | None:
        """What an event is."""
        test = self.tests[index]
        if test.code == "NS-GR" and not has_pair(at.extra.multipliers, math.nan):
            return None
        if test == SECOND_GRAZING[2]:
            met = meeting_of(self.plane.problem, self._observed(at.y)[1])
            if met is not None:
                return met
        return EventDetails(test.code, test.terminal, {"stop": None, "note": test.label})


def _seen(problem: ForcedProblem, y: np.ndarray, whole: Flights, shown: Flights) -> np.ndarray:
    """What a part of an orbit shows: entries as of `bvp.orbits.RESULT_INDEX`, with times of the whole orbit y. shown: the part."""
    result = problem.observed(y, shown)
    flight = int(result[RESULT_INDEX["clearance_flight"]])
    # A flight that begins later does so at the end of what is left out.
    if not np.array_equal(shown.begins[flight], whole.begins[flight]):
        result[RESULT_INDEX["clearance_time"]] += (whole.times - shown.times)[flight]
    return result


def enter_least(result: np.ndarray, entries: list[int], values: np.ndarray, indices: Sequence[int] | np.ndarray) -> None:
    """Write the least of values, and the first index at which they are it to rounding, into two entries of a result; infinity where there
    are none."""
    tie = TIE * np.abs(values[np.isfinite(values)]).max(initial=0.0)
    result[entries] = (values.min(), indices[int(np.argmax(values <= values.min() + tie))]) if len(values) else (math.inf, -1)


def second_grazing(problem: ForcedProblem, solution: Solution) -> str:
    """What of all else is zero at an orbit: see `branches.curves.grazing.what_grazes`. ValueError where nothing is."""
    sizes = grazing_sizes(problem, solution)
    least = what_grazes(sizes)
    if sizes[least] > _SECOND:
        raise ValueError("this curve is the only one of grazings there; expected GR-GR, or the type of the other curve, as SN at SN-GR")
    return least


class _Others(NamedTuple):
    """What an orbit shows besides the grazing. problem, y: the orbit, in which the clearance is observed. result: entries as of
    `bvp.orbits.RESULT_INDEX`; the speed and the flight are those of the curve's own problem. bend: the acceleration of the gap at a
    touch, away from the stop."""

    problem: ForcedProblem
    y: np.ndarray
    result: np.ndarray
    bend: float


def finite_multipliers(matrix: np.ndarray, shifted: np.ndarray, has_clock: bool) -> np.ndarray:
    """The finite multipliers of a pencil B + (lambda - 1) B1 of a grazing orbit, where one is infinite; filled up to (2 n,) with nan.
    matrix, shifted: B at lambda = 1, and B1. Without a clock the section that the orbit starts from takes one more."""
    rows = np.flatnonzero(np.any(shifted != 0.0, axis=1))
    found = np.full(len(rows), complex(math.nan, math.nan))
    _, _, solved, singular = dgesv(matrix, np.eye(len(matrix))[:, rows])
    if singular or not np.isfinite(solved).all():  # rounding can hide that the matrix is singular
        return found
    try:
        values = core.eigenvalues(np.ascontiguousarray(shifted[rows] @ solved))
    except RuntimeError:
        return found
    largest = sorted(values.tolist(), key=abs, reverse=True)[: len(rows) - (1 if has_clock else 2)]
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
        nodes[self.order < self.first, : 2 * n] *= whole.closing[0]
        nodes[self.order < self.first, 2 * n] += whole.closing[1]
        times[-1] = float(np.sum(whole.flight_times(y))) / self.parts - float(np.sum(times[:-1]))
        fractions = nodes[:, 2 * n] * whole.load_periods / self.problem.load_periods
        return self.problem.pack(nodes[:, : 2 * n], fractions, nodes[0, 2 * n + 1 :], times)


def signed_smallest(matrix: np.ndarray) -> float:
    """A lower bound of the smallest singular value, sharp to the root of the matrix's size, with the sign of the determinant."""
    return float(core.signed_least_singular(np.ascontiguousarray(matrix, dtype=float)))
