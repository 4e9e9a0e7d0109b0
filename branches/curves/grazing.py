"""The conditions of grazings: an impact without speed, a flight without duration, a contact force that touches zero.

A touch is an impact without speed of the sequence with that impact. So the curve belongs to both families that meet at the grazing, and the
equations of its orbits are regular.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from branches.admissible import force_event
from branches.curves.plane import ParameterPlane
from branches.forced.closing import sticks_for_ever, vanishes, without_moment
from branches.forced.primitive import primitive_orbit
from branches.forced.resequencing import with_touch, without_impact
from bvp.contact_sequence import CLOSES, OPENS
from bvp.forced import ForcedProblem
from bvp.kernels.forced_sticking import contact_force
from bvp.kernels.multipoint import QUARTER_PERIOD, RESULT
from bvp.multipoint import Solution
from continuation.curves import Linearised, ScalarCondition

__all__ = [
    "Grazing", "beside_grazing", "grazing_at", "grazing_condition", "grazing_of", "grazing_sizes", "observed",
    "paths_beside", "what_grazes",
]  # fmt: skip

_ZERO = 1e-9
"""Clearance, speed and flight time, in units of arclength and of the period, that are zero at a located grazing."""

_INSTANT = 1e-6
"""Part of the period that a flight between two events of a stop that sticks lasts at a grazing, at most."""

_NEXT = 1e-4
"""Part of the solved segment beside a touch in which no other one is looked for."""

_ROUNDS, _DIFFERENCE, _AT_MINIMUM = 8, 1e-5, 1e-13
"""Newton's steps to the minimum of a force; the difference of its second derivative; the last step: parts of the flight."""


class Grazing(NamedTuple):
    """What grazes. kind: "speed" of the impact that ends a flight; "flight", whose duration vanishes; "force" of a stop that sticks in it;
    "held": a flight without duration in place of such a force, of a stop that sticks for the whole period.
    stop and part: of the force, and of the flight at which it was least at first; None where the stop begins to stick. repeats: periods of
    the load in the orbit without the impact, and whether that is symmetric, where it repeats itself: then its images touch, too."""

    kind: str
    flight: int
    stop: int = -1
    part: float | None = None
    repeats: tuple[int, bool] | None = None


def grazing_at(problem: ForcedProblem, solution: Solution) -> tuple[ForcedProblem, np.ndarray, Grazing]:
    """The problem in which a grazing orbit is continued, its unknowns, and what grazes there.

    Raises
    ------
    ValueError
        For a grazing that cannot be continued.
    """
    if vanishes(problem, solution.y):
        if sticks_for_ever(problem, solution.y):
            return held_grazing(problem, solution.y)
        narrow = without_moment(problem, solution.y)
        if narrow is None:
            raise ValueError("the flights that have no duration there could not be left out; expected another event")
        problem, solution = narrow[0], observed(narrow[0], narrow[1])
    sizes = grazing_sizes(problem, solution)
    least = what_grazes(sizes)
    if any(event.closed for event in problem.events) and sizes["flight"] < _INSTANT:
        least = "flight"  # contact force and speed vanish faster than the time
    return grazing_of(problem, solution, least)


def held_grazing(problem: ForcedProblem, y: np.ndarray) -> tuple[ForcedProblem, np.ndarray, Grazing]:
    """The same where a stop opens no more, and sticks for the whole period: in the least sequence that opens it. See `HeldSurface`."""
    release = next(k for k, event in enumerate(problem.events) if event.is_release)
    letter = problem.modes.contact_letters[problem.events[release].contact]
    made = problem.sibling((letter + CLOSES, letter + OPENS), load_periods=1, half=False, values=problem.parameters(y))
    size = 2 * problem.degrees_of_freedom
    node = problem.nodes(y)[release]
    fraction = float(node[size]) * problem.load_periods % 1.0
    start = made.pack(np.tile(node[:size], (2, 1)), np.array([fraction, fraction + 1.0]), node[size + 1 :])
    made.flight_times(start)[:] = made.period(start), 0.0
    return made, start, Grazing("held", 1)


def grazing_of(problem: ForcedProblem, solution: Solution, least: str) -> tuple[ForcedProblem, np.ndarray, Grazing]:
    """The same, where it is known what vanishes at the orbit: "clearance", "speed" or "flight"."""
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
        part = float(solution["clearance_time"]) / float(problem.flight_times(solution.y)[flight])
        return problem, solution.y, Grazing("force", flight, stop, None if force.kind == "begin" else part)
    made, y = with_touch(problem, solution)
    flight = int(solution["clearance_flight"]) if problem.sequence else made.inner
    primitive, _ = primitive_orbit(problem, solution.y)
    return made, y, Grazing("speed", flight, repeats=_other_closure(primitive, problem))


def grazing_sizes(problem: ForcedProblem, solution: Solution) -> dict[str, float]:
    """Clearance, least impact speed and least flight time of an orbit, in units of arclength and of the solved segment."""
    return {
        "clearance": abs(solution["clearance"]) / problem.segment.scale[0],
        "speed": abs(solution["speed"]) / problem.segment.scale[problem.degrees_of_freedom],
        "flight": abs(solution["flight"]) / float(np.sum(problem.flight_times(solution.y))),
    }


def what_grazes(sizes: Mapping[str, float]) -> str:
    """The one of them that is zero. The gap turns where an impact has no speed, and an impact that vanishes can meet another one: the speed
    comes first."""
    limit = max(_ZERO, min(sizes.values()))
    return next(name for name in ("speed", "clearance", "flight") if sizes[name] <= limit)


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


def grazing_condition(plane: ParameterPlane, grazing: Grazing) -> ScalarCondition:
    """The condition of a grazing. An impact behind the last node is the one at the start of a segment between two ends."""
    problem, flight = plane.problem, grazing.flight
    width, n = problem.size, problem.degrees_of_freedom
    at = flight * (width + 1)

    def speed(point: Linearised) -> tuple[float, np.ndarray]:
        row = problem.segment.side[flight] * problem.segment.gap[flight, :n]
        gradient = np.zeros(plane.size)
        if flight > problem.inner:
            gradient[n : 2 * n] = -row
            return float(gradient[n : 2 * n] @ point.y[n : 2 * n]), gradient
        out, jacobian, rate = problem.flown(point.y[at : at + width], point.y[at + width], flight)
        gradient[at : at + width] = row @ jacobian[n : 2 * n]
        gradient[at + width] = row @ rate[n : 2 * n]
        return float(row @ out[n : 2 * n]), gradient

    def duration(point: Linearised) -> tuple[float, np.ndarray]:
        gradient = np.zeros(plane.size)
        gradient[at + width] = 1.0
        return float(point.y[at + width]), gradient

    def force(point: Linearised) -> tuple[float, np.ndarray]:
        gradient = np.zeros(plane.size)
        value, gradient[at : at + width], _ = _least_force(problem, point.y, grazing)
        return value, gradient

    return ScalarCondition({"speed": speed, "flight": duration, "held": duration, "force": force}[grazing.kind])


def beside_grazing(
    problem: ForcedProblem, y: np.ndarray, ends: np.ndarray, flight: int, wraps: bool
) -> tuple[np.ndarray, np.ndarray, float]:
    """An orbit without the neighbourhood of an impact without speed.

    Parameters
    ----------
    problem, y : ForcedProblem, (u,) float
    ends : (k + 1, N) float
        The nodes before the impacts.
    flight : int
        That ends with the impact; k + 1 for an impact at the start of a segment between two ends.
    wraps : bool
        Whether the first flight follows the last one.

    Returns
    -------
    y, ends : ndarray
        With the flights before and behind the impact shortened.
    bend : float
        The acceleration of the gap at the impact, away from the stop.
    """
    n, k = problem.degrees_of_freedom, problem.inner
    row = problem.segment.side[flight] * problem.segment.gap[flight, :n]
    at_start = flight > k
    place, time = (0, 0.0) if at_start else (flight, float(problem.flight_times(y)[flight]))
    bend = -float(row @ problem.flown(problem.nodes(y)[place], time, place)[2][n : 2 * n])
    after = 0 if at_start or (flight == k and wraps) else flight + 1
    return *_shortened(problem, y, ends, None if at_start else flight, after if after <= k else None), bend


def paths_beside(problem: ForcedProblem, y: np.ndarray, ends: np.ndarray, grazing: Grazing) -> list[tuple[np.ndarray, np.ndarray]]:
    """An orbit without the neighbourhood of a flight without duration, or of the instant at which a contact force touches zero: up to
    there, and from there. Arguments as of `beside_grazing`; its wraps is true."""
    flight, count = grazing.flight, len(ends)
    if grazing.kind in ("flight", "held"):
        shown = np.array(y)
        problem.flight_times(shown)[flight] = 0.0
        return [_shortened(problem, shown, ends, (flight - 1) % count, (flight + 1) % count)]
    time, duration = _least_force(problem, y, grazing)[2], float(problem.flight_times(y)[flight])
    before, after = np.array(y), np.array(y)
    problem.flight_times(before)[flight] = time
    problem.flight_times(after)[flight] = duration - time
    problem.nodes(after)[flight] = problem.flown(problem.nodes(y)[flight], time, flight)[0]
    paths = [_shortened(problem, before, ends, flight, None), _shortened(problem, after, ends, None, flight)]
    return [path for path in paths if problem.flight_times(path[0])[flight] > 0.0]


def _shortened(
    problem: ForcedProblem, y: np.ndarray, ends: np.ndarray, before: int | None, after: int | None
) -> tuple[np.ndarray, np.ndarray]:
    """An orbit without the last part of the flight before an instant, and the first part of the flight after it."""
    shown, ends = np.array(y), ends.copy()
    times, nodes = problem.flight_times(shown), problem.nodes(shown)
    short = _NEXT * float(np.sum(times))
    if before is not None:
        times[before] -= short
        ends[before] = problem.flown(nodes[before], float(times[before]), before)[0]
    if after is not None:
        nodes[after] = problem.flown(nodes[after], short, after)[0]
        times[after] -= short
    return shown, ends


def _least_force(problem: ForcedProblem, y: np.ndarray, grazing: Grazing) -> tuple[float, np.ndarray, float]:
    """The contact force of a stop at its minimum over a flight, its derivatives by the node where the flight begins, and its time; all NaN
    where no minimum is found."""
    flight, arrays = grazing.flight, problem._table.arrays
    mode = int(arrays.mode[flight])
    node, duration = problem.nodes(y)[flight], float(problem.flight_times(y)[flight])

    def at(time: float) -> tuple[float, np.ndarray, np.ndarray, float]:
        out, jacobian, rate = problem.flown(node, time, flight)
        row = np.empty(problem.size)
        value = contact_force(arrays, problem.segment.flight.loads, mode, grazing.stop, out, row)
        return value, row, jacobian, float(row @ rate)

    if grazing.part is None:
        value, row, _, _ = at(0.0)
        return value, row, 0.0
    time, step = grazing.part * duration, _DIFFERENCE * duration
    seen = observed(problem, y)
    if int(seen["clearance_flight"]) == flight and int(seen["clearance_stop"]) == grazing.stop:
        time = float(seen["clearance_time"])
    for _ in range(_ROUNDS):
        slope = at(time)[3]
        bend = (at(time + step)[3] - at(time - step)[3]) / (2.0 * step)
        change = -slope / bend if bend > 0.0 else math.nan
        time += change
        if not abs(change) > _AT_MINIMUM * duration:
            break
    else:
        change = math.nan
    if not math.isfinite(change):
        return math.nan, np.full(problem.size, math.nan), math.nan
    value, row, jacobian, _ = at(time)
    return value, row @ jacobian, time
