"""The conditions of grazings of forced orbits: an impact without speed, a flight without duration, a contact force that touches zero.

A touch is an impact without speed of the sequence with that impact. So the curve belongs to both families that meet at the grazing, and the
equations of its orbits are regular.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg.lapack import dgesv

from branches.admissible import force_event
from branches.curves.monitor import CurvePoint, Window, has_pair, meeting_of, pair_product, window_tests, window_values
from branches.curves.plane import ParameterPlane, closing_block
from branches.forced.closing import vanishes, without_moment
from branches.forced.primitive import primitive_orbit
from branches.forced.resequencing import with_touch, without_impact
from bvp.forced import ForcedProblem
from bvp.kernels.dense import determinant, eigenvalues, least_singular
from bvp.kernels.forced import fly_loaded
from bvp.kernels.forced_sticking import contact_force
from bvp.kernels.multipoint import CLEARANCE, QUARTER_PERIOD, RESULT
from bvp.multipoint import Solution
from continuation.curves import Held, Linearised, ScalarCondition
from continuation.location import Location
from continuation.problem import EventDetails, Point, Step, TestFunction

__all__ = ["Grazing", "GrazingMonitor", "grazing_at", "grazing_condition", "observed"]

_ZERO = 1e-9
"""Clearance, speed and flight time, in units of arclength and of the period, that are zero at a located grazing."""

_INSTANT = 1e-6
"""Part of the period that a flight between two events of a stop that sticks lasts at a grazing, at most."""

_NEXT = 1e-4
"""Part of the period beside a touch in which no other one is looked for."""


class Grazing(NamedTuple):
    """What grazes. kind: "speed" of the impact that ends a flight; "flight", whose duration vanishes; "force" of a stop that sticks in it.
    stop and time: of the force; the time is that of its minimum, None where the stop begins to stick. repeats: periods of the load in the
    orbit without the impact, and whether that is symmetric, where it repeats itself: then its images touch, too."""

    kind: str
    flight: int
    stop: int = -1
    time: float | None = None
    repeats: tuple[int, bool] | None = None


def grazing_at(problem: ForcedProblem, solution: Solution) -> tuple[ForcedProblem, np.ndarray, Grazing]:
    """The problem in which a grazing orbit is continued, its unknowns, and what grazes there.

    Raises
    ------
    ValueError
        For a grazing that cannot be continued.
    """
    if vanishes(problem, solution.y):
        narrow = without_moment(problem, solution.y)
        if narrow is None:
            raise ValueError("the stop sticks for the whole period there, and no orbit with an impact has this limit as an equation")
        problem, solution = narrow[0], observed(narrow[0], narrow[1])
    sizes = {
        "clearance": abs(solution["clearance"]) / problem.segment.scale[0],
        "speed": abs(solution["speed"]) / problem.segment.scale[problem.degrees_of_freedom],
        "flight": abs(solution["flight"]) / problem.duration(solution),
    }
    # The gap turns where an impact has no speed, and an impact that vanishes can meet another one: the speed comes first.
    limit = max(_ZERO, min(sizes.values()))
    if any(event.closed for event in problem.events) and sizes["flight"] < _INSTANT:
        sizes = {"speed": math.inf, "clearance": math.inf} | {"flight": 0.0}  # contact force and speed vanish faster than the time
    least = next(name for name in ("speed", "clearance", "flight") if sizes[name] <= limit)
    if least == "clearance" and solution["clearance_side"] == 0.0:
        raise ValueError("a chatter that hardly ends is no grazing with an equation of its own; expected another event")
    if least == "speed" and problem.sequence:
        flight = int(solution["speed_node"])
        return problem, solution.y, Grazing("speed", flight, repeats=_repeats(problem, solution))
    if least == "flight":
        return problem, solution.y, Grazing("flight", int(solution["flight_index"]))
    force = force_event(problem, solution)
    if force is not None:
        if force.kind == "after":
            raise ValueError("the stop would stay closed after its impact: continue the event of the family in which it sticks")
        flight, stop = int(solution["clearance_flight"]), int(solution["clearance_stop"])
        return problem, solution.y, Grazing("force", flight, stop, None if force.kind == "begin" else float(solution["clearance_time"]))
    made, y = with_touch(problem, solution)
    flight = int(solution["clearance_flight"]) if problem.sequence else made.inner
    primitive, _ = primitive_orbit(problem, solution.y)
    return made, y, Grazing("speed", flight, repeats=_other_closure(primitive, problem))


def _repeats(problem: ForcedProblem, solution: Solution) -> tuple[int, bool] | None:
    """See `Grazing`, of an impact whose speed has vanished."""
    made = without_impact(problem, solution)
    return None if made is None else _other_closure(primitive_orbit(*made)[0], problem)


def _other_closure(primitive: ForcedProblem, problem: ForcedProblem) -> tuple[int, bool] | None:
    closure = primitive.load_periods, primitive.half
    return None if closure == (problem.load_periods, problem.half) else closure


def observed(problem: ForcedProblem, y: np.ndarray) -> Solution:
    """An orbit as it stands, with what its paths and impacts show: near a singular point Newton's method would move it."""
    problem.residual(y)
    result = np.full(len(RESULT), math.nan)
    ends = problem._factor.before.copy()
    problem._observe(y, ends, result)
    result[QUARTER_PERIOD] = problem.period(y)
    return Solution(y, np.zeros(2 * y.size), np.zeros(problem.size), ends, result)


def _flown(problem: ForcedProblem, node: np.ndarray, time: float, flight: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The node at a time of a flight (N,), its derivatives by the first one (N, N) and its rate (N,)."""
    out, jacobian, rate = np.empty(problem.size), np.empty((problem.size, problem.size)), np.empty(problem.size)
    fly_loaded(problem._table.flight_in(flight), np.array(node), float(time), out, jacobian, rate)
    return out, jacobian, rate


def grazing_condition(plane: ParameterPlane, grazing: Grazing) -> ScalarCondition:
    """The condition of a grazing."""
    problem, flight = plane.problem, grazing.flight
    width, n = problem.size, problem.degrees_of_freedom
    at = flight * (width + 1)

    def speed(point: Linearised) -> tuple[float, np.ndarray]:
        row = problem.segment.side[flight] * problem.segment.gap[flight, :n]
        out, jacobian, rate = _flown(problem, point.y[at : at + width], point.y[at + width], flight)
        gradient = np.zeros(plane.size)
        gradient[at : at + width] = row @ jacobian[n : 2 * n]
        gradient[at + width] = row @ rate[n : 2 * n]
        return float(row @ out[n : 2 * n]), gradient

    def duration(point: Linearised) -> tuple[float, np.ndarray]:
        gradient = np.zeros(plane.size)
        gradient[at + width] = 1.0
        return float(point.y[at + width]), gradient

    def force(point: Linearised) -> tuple[float, np.ndarray]:
        node = point.y[at : at + width]
        value, _, by_node = _least_force(problem, node, grazing)
        gradient = np.zeros(plane.size)
        gradient[at : at + width] = by_node
        return value, gradient

    return ScalarCondition({"speed": speed, "flight": duration, "force": force}[grazing.kind])


def _least_force(problem: ForcedProblem, node: np.ndarray, grazing: Grazing) -> tuple[float, float, np.ndarray]:
    """The contact force at its minimum near the known time, that time, and its derivatives by the node."""
    flight = grazing.flight
    arrays = problem._table.arrays
    mode = int(arrays.mode[flight])

    def at(time: float) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
        out, jacobian, rate = _flown(problem, node, time, flight)
        row = np.empty(problem.size)
        value = contact_force(arrays, problem.segment.flight.loads, mode, grazing.stop, out, row)
        return value, row, jacobian, rate

    if grazing.time is None:
        value, row, _, _ = at(0.0)
        return value, 0.0, row
    time, step = grazing.time, 1e-5 * grazing.time
    for _ in range(8):
        slopes = []
        for place in (time - step, time, time + step):
            _, row, _, rate = at(place)
            slopes.append(float(row @ rate))
        bend = (slopes[2] - slopes[0]) / (2.0 * step)
        change = -slopes[1] / bend if bend else 0.0
        time += change
        if abs(change) <= 1e-13 * time:
            break
    value, row, jacobian, _ = at(time)
    return value, time, row @ jacobian


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
            *(TestFunction("GR-GR", "guard", True, f"two grazings at once: {what}") for what in _SECOND),
            TestFunction("GR-GR", "guard", True, "the touch is degenerate: the acceleration of the gap vanishes there"),
            TestFunction("SN-GR", "crossing", False, "a fold of the orbits with the impact meets the grazing"),
            TestFunction(f"{turned}-GR", "crossing", False, f"a {_WORDS[turned]} of the orbits with the impact meets the grazing"),
            TestFunction("NS-GR", "crossing", False, "a Neimark-Sacker bifurcation of the orbits with the impact meets the grazing"),
        )
        self._shifted = closing_block(plane)
        self._single = None if grazing.repeats is None else _SingleTouch(plane.problem, grazing)

    def values(
        self, at: Linearised, own: np.ndarray, held: Held, tangent: np.ndarray, scale: np.ndarray
    ) -> tuple[Sequence[float], Any] | None:
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
            n, i = problem.degrees_of_freedom, grazing.flight
            row = problem.segment.side[i] * problem.segment.gap[i, :n]
            bend = -float(row @ _flown(problem, problem.nodes(y)[i], flights[i], i)[2][n : 2 * n])
            if self._single is None:
                clearance = _clearance_beside(problem, y, i, ends)
            else:
                one, shown = self._single.problem, self._single.unknowns(y)
                one.residual(shown)
                clearance = _clearance_beside(one, shown, one.inner, one._factor.before)
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
        tests = [_signed_smallest(fixed), _signed_smallest(fixed - 2.0 * shifted), pair_product(finite.tolist())]
        values = [*window_values(self.plane, at.parameters, self.window), clearance, slowest, least_flight, bend, *tests]
        return values, CurvePoint(solution, finite, math.nan, math.nan)

    def classify(self, index: int, before: Point, at: Step, after: Point, location: Location) -> EventDetails | None:
        """What an event is."""
        test = self.tests[index]
        if test.kind == "crossing" and location.kind in ("pole", "jump"):
            return None
        if test.code == "NS-GR" and not has_pair(at.extra.multipliers, math.nan):
            return None
        if test.label.endswith(_SECOND[2]):
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


def _clearance_beside(problem: ForcedProblem, y: np.ndarray, i: int, ends: np.ndarray) -> float:
    """The least clearance of an orbit but that of the impact without speed that ends flight i: what is next to it is left out. ends: the
    states after the flights of the orbit, which was evaluated last."""
    after = (i + 1) % (problem.inner + 1)
    shown, ends = np.array(y), ends.copy()
    nodes, times = problem.nodes(shown), problem.flight_times(shown)
    short = _NEXT * float(times.sum()) * (2.0 if problem.half else 1.0)
    ends[i] = _flown(problem, nodes[i], times[i] - short, i)[0]
    nodes[after] = _flown(problem, nodes[after], short, after)[0]
    times[i] -= short
    times[after] -= short
    result = np.full(len(RESULT), math.nan)
    problem._observe(shown, ends, result)
    return float(result[CLEARANCE])


_SECOND = ("a flight touches a stop", "the speed of another impact reaches zero", "a flight time reaches zero")
_WORDS = {"SB": "symmetry breaking", "PD": "period doubling"}


def _signed_smallest(matrix: np.ndarray) -> float:
    """A lower bound of the smallest singular value, sharp to the root of the matrix's size, with the sign of the determinant."""
    factors = np.array(matrix)
    sign = math.copysign(1.0, determinant(factors))
    return sign * float(least_singular(factors, np.empty_like(factors)))
