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
from bvp.forced import Flights, ForcedProblem
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
    period = problem.period(y) / problem.load_periods
    start = made.pack(np.tile(node[:size], (2, 1)), np.array([fraction, fraction + 1.0]), node[size + 1 :], [period, 0.0])
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
        "clearance": abs(solution["clearance"]) / problem.units[0],
        "speed": abs(solution["speed"]) / problem.units[problem.degrees_of_freedom],
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
    """See `ForcedProblem.as_it_is`."""
    return problem.as_it_is(y)


def grazing_condition(plane: ParameterPlane, grazing: Grazing) -> ScalarCondition:
    """The condition of a grazing. An impact behind the last node is the one at the start of a segment between two ends."""
    problem, flight, n = plane.problem, grazing.flight, plane.problem.degrees_of_freedom

    def speed(point: Linearised) -> tuple[float, np.ndarray]:
        y, row = point.y, problem.side[flight] * problem.gap[flight, :n]
        if flight > problem.inner:
            gradient = np.zeros(plane.size)
            problem.states(gradient)[0, n:] = -row
            return float(-row @ problem.states(y)[0, n:]), gradient
        place = problem.flown(problem.nodes(y)[flight], float(problem.flight_times(y)[flight]), flight)
        here = slice(n, 2 * n)
        return float(row @ place.values[here]), problem.gradient(y, flight, row @ place.slopes[here], float(row @ place.rates[here]))

    def duration(point: Linearised) -> tuple[float, np.ndarray]:
        nothing = np.zeros(2 * n + 1 + len(problem.released))
        return float(problem.flight_times(point.y)[flight]), problem.gradient(point.y, flight, nothing, 1.0)

    def force(point: Linearised) -> tuple[float, np.ndarray]:
        value, slopes, _ = _least_force(problem, point.y, grazing)
        return value, problem.gradient(point.y, flight, slopes)

    return ScalarCondition({"speed": speed, "flight": duration, "held": duration, "force": force}[grazing.kind])


def beside_grazing(problem: ForcedProblem, y: np.ndarray, whole: Flights, flight: int, wraps: bool) -> tuple[Flights, float]:
    """The flights of an orbit without the neighbourhood of an impact without speed.

    Parameters
    ----------
    problem, y : ForcedProblem, (u,) float
    whole : Flights
        Those of the orbit.
    flight : int
        That ends with the impact; k + 1 for an impact at the start of a segment between two ends.
    wraps : bool
        Whether the first flight follows the last one.

    Returns
    -------
    Flights
        Those before and behind the impact are shortened.
    float
        The acceleration of the gap at the impact, away from the stop.
    """
    n, k = problem.degrees_of_freedom, problem.inner
    row = problem.side[flight] * problem.gap[flight, :n]
    at_start = flight > k
    place, time = (0, 0.0) if at_start else (flight, float(whole.times[flight]))
    bend = -float(row @ problem.flown(problem.nodes(y)[place], time, place).rates[n : 2 * n])
    after = 0 if at_start or (flight == k and wraps) else flight + 1
    return _shortened(problem, y, whole, None if at_start else flight, after if after <= k else None), bend


def paths_beside(problem: ForcedProblem, y: np.ndarray, whole: Flights, grazing: Grazing) -> list[Flights]:
    """The flights of an orbit without the neighbourhood of a flight without duration, or of the instant at which a contact force touches
    zero: up to there, and from there. Arguments as of `beside_grazing`; its wraps is true."""
    flight, count = grazing.flight, len(whole.times)
    here = np.arange(count) == flight
    if grazing.kind in ("flight", "held"):
        shown = whole._replace(times=np.where(here, 0.0, whole.times))
        return [_shortened(problem, y, shown, (flight - 1) % count, (flight + 1) % count)]
    time, duration = _least_force(problem, y, grazing)[2], float(whole.times[flight])
    begins = whole.begins.copy()
    state, fraction = problem.fly(problem.nodes(y)[flight], time, flight)
    begins[flight] = *state, fraction
    before = whole._replace(times=np.where(here, time, whole.times))
    after = whole._replace(begins=begins, times=np.where(here, duration - time, whole.times))
    paths = [_shortened(problem, y, before, flight, None), _shortened(problem, y, after, None, flight)]
    return [path for path in paths if path.times[flight] > 0.0]


def _shortened(problem: ForcedProblem, y: np.ndarray, whole: Flights, before: int | None, after: int | None) -> Flights:
    """The flights of an orbit without the last part of the one before an instant, and the first part of the one after it."""
    begins, times, ends = (part.copy() for part in whole)
    short, values = _NEXT * float(np.sum(times)), problem.released_values(y)
    if before is not None:
        times[before] -= short
        ends[before] = problem.fly(np.append(begins[before], values), float(times[before]), before)[0]
    if after is not None:
        state, fraction = problem.fly(np.append(begins[after], values), short, after)
        begins[after] = *state, fraction
        times[after] -= short
    return Flights(begins, times, ends)


def _least_force(problem: ForcedProblem, y: np.ndarray, grazing: Grazing) -> tuple[float, np.ndarray, float]:
    """The contact force of a stop at its minimum over a flight, its derivatives by the node where the flight begins, and its time; all NaN
    where no minimum is found."""
    flight = grazing.flight
    node, duration = problem.nodes(y)[flight], float(problem.flight_times(y)[flight])

    def at(time: float) -> tuple[float, np.ndarray, float]:
        place = problem.flown(node, time, flight, grazing.stop)
        return float(place.values[-1]), place.slopes[-1], float(place.rates[-1])

    if grazing.part is None:
        value, slopes, _ = at(0.0)
        return value, slopes, 0.0
    time, step = grazing.part * duration, _DIFFERENCE * duration
    seen = observed(problem, y)
    if int(seen["clearance_flight"]) == flight and int(seen["clearance_stop"]) == grazing.stop:
        time = float(seen["clearance_time"])
    for _ in range(_ROUNDS):
        slope = at(time)[2]
        bend = (at(time + step)[2] - at(time - step)[2]) / (2.0 * step)
        change = -slope / bend if bend > 0.0 else math.nan
        time += change
        if not abs(change) > _AT_MINIMUM * duration:
            break
    else:
        change = math.nan
    if not math.isfinite(change):
        return math.nan, np.full(len(node), math.nan), math.nan
    value, slopes, _ = at(time)
    return value, slopes, time
