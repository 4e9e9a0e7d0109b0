"""Ends of families at which a stop opens no more, or bounces no more before it sticks.

Gap, speed and duration of a flight vanish together there. The equations are singular, and rounding ends the steps a little way off. The
same orbit is a regular one without that flight: there the contact force touches zero. This locates it. If the stop then sticks for the
whole period, its contact force is a sum of harmonics: the response of the system with a gap that rests.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from branches.admissible import BEYOND, force_event
from branches.forced.family import ForcedFamily
from branches.forced.resequencing import at_rest, later, resequenced
from branches.released.family import ReleasedFamily
from bvp.contact_sequence import CLOSES
from bvp.forced import ForcedProblem
from bvp.forcing import Constant, Harmonic
from bvp.multipoint import NotConverged, Solution
from continuation.problem import End, EndReason, Event, Point, Points, Step
from continuation.run import Run

__all__ = ["largest_residual", "sticks_for_ever", "vanishes", "without_chatter", "with_exact_ends", "without_moment"]

_BRIEF = 0.02
"""Longest duration of the flights that vanish, as a part of the period, from which their end is sought."""

_NEAR = 0.1
"""Largest distance of that end in arclength, and of the moment in parts of the period."""

_GRAZES = 1e-3
"""Both limits, as parts of themselves, where the run has ended at a grazing: it must be that one."""

_ROUNDS = 30
_PROBE = 1e-6
_MERGES = 4
"""Index of the test function for a flight without duration."""


class _Moment(NamedTuple):
    """Events at one stop that come to one instant at the end of a family.

    begin: node of the first one. length: how many. contact: where. opens: whether the first one is a release."""

    begin: int
    length: int
    contact: int
    opens: bool


def _moment(problem: ForcedProblem, y: np.ndarray, limit: float = _BRIEF) -> _Moment | None:
    """The events that are brief, with a release if there is one; None where there are none. limit: longest duration, in periods."""
    events, found = problem.events, list[_Moment]()
    if not events:
        return None
    times, limit = problem.flight_times(y), limit * problem.period(y)
    for begin, event in enumerate(events):
        plastic = problem.restitution(y, event.contact) == 0.0
        if event.sticks or not (event.is_release or plastic):
            continue
        before = events[begin - 1]
        if not event.is_release and before.contact == event.contact and not (before.sticks or before.is_release):
            continue  # it belongs to the impact before it
        lasts, count = 0.0, 1
        while count < len(events):
            lasts += abs(times[(begin + count - 1) % len(events)])
            other = events[(begin + count) % len(events)]
            if problem.half and begin + count >= len(events):
                break  # the mirror image follows
            count += 1
            if other.contact != event.contact or other.is_release or lasts > limit:
                break
            if other.sticks:
                found.append(_Moment(begin, count, event.contact, event.is_release))
                break
    return max(found, key=lambda one: one.opens) if found else None


def vanishes(problem: ForcedProblem, y: np.ndarray) -> bool:
    """Whether an orbit is the end at which such a moment has no duration."""
    return _moment(problem, y, 0.0) is not None


def sticks_for_ever(problem: ForcedProblem, y: np.ndarray) -> bool:
    """Whether an orbit is the end of a family at which a stop sticks for the whole period."""
    moment = _moment(problem, y, 0.0)
    return moment is not None and _closed_for_ever(problem, moment)


def without_chatter(problem: ForcedProblem, y: np.ndarray) -> ForcedProblem:
    """The problem in which the impacts of a moment that vanishes begin no chatter: they have no speed, and rounding would begin one."""
    moment = _moment(problem, y, 0.0)
    if moment is None:
        return problem
    made = problem.sibling(problem.sequence)
    summed, count = made.contact_modes.summed, len(problem.events)
    for k in range(moment.length):
        summed[(moment.begin + k - 1) % count] = 0
    return made


def largest_residual(problem: ForcedProblem, y: np.ndarray) -> float:
    """The largest residual of an orbit, as the solver scales it, also at the end of a family where a moment vanishes."""
    return without_chatter(problem, y).scaled_residual(y)


def _closed_for_ever(problem: ForcedProblem, moment: _Moment) -> bool:
    """Whether a stop sticks for the whole period without the events of a moment."""
    return moment.opens and moment.length == len(problem.events)


def without_moment(problem: ForcedProblem, y: np.ndarray) -> tuple[ForcedProblem, np.ndarray, _Moment] | None:
    """The problem without the brief opening, or the brief bounces, of an orbit; its unknowns there; and where the moment was, in an orbit
    begun so that the moment does not contain its first node. None where there is no such moment, and where no event is left."""
    moment = _moment(problem, y)
    if moment is None or _closed_for_ever(problem, moment):
        return None
    for _ in range(len(problem.impacts)):
        if moment.begin + moment.length <= len(problem.events):
            break
        problem, y = later(problem, y)
        moment = _moment(problem, y)
        if moment is None:
            return None
    nodes, times, size = problem.nodes(y), problem.flight_times(y).copy(), 2 * problem.degrees_of_freedom
    end = moment.begin + moment.length
    if end > len(nodes):
        return None
    letter = problem.modes.contact_letters[moment.contact]
    kept = [] if moment.opens else [end - 1]
    symbols = [] if moment.opens else [letter + CLOSES]
    sequence = [*problem.sequence[: moment.begin], *symbols, *problem.sequence[end:]]
    if moment.opens:
        times[moment.begin - 1] += np.sum(times[moment.begin : end])
        times = np.delete(times, np.s_[moment.begin : end])
    else:
        times[moment.begin] = np.sum(times[moment.begin : end])
        times = np.delete(times, np.s_[moment.begin + 1 : end])
    rows = np.r_[0 : moment.begin, kept, end : len(nodes)].astype(int)
    narrow, start = resequenced(problem, sequence, nodes[rows, :size], nodes[rows, size], times, y)
    return narrow, start, moment


def with_exact_ends(family: ForcedFamily | ReleasedFamily, run: Run) -> Run:
    """A run of a family whose ends at a moment that vanishes are located exactly: the same one if it has no such end."""
    if not isinstance(family, ForcedFamily) or not run.points or run.closed or not family.problem.events:
        return run
    points, events, ends, start = list(run.points), list(run.events), list(run.ends), run.start
    for last in (True, False):
        end = ends[last]
        known = points[-1 if last else 0].event
        merging = end.reason is EndReason.EVENT and known is not None and known.code == "GR"
        if not (merging or end.reason is EndReason.MINIMUM_STEP):
            continue
        # Where the moment lasts for no time its equations hold, whatever the force is: the last steps can land there.
        outwards, gone = points if last else points[::-1], 0
        while gone < len(points) - 1 and _moment(family.problem, outwards[-1 - gone].step.y, _GRAZES * _BRIEF) is not None:
            gone += 1
        if merging and not gone:
            continue
        made = _exact_end(family, outwards[-1 - gone].step, 1.0) or _exact_end(family, outwards[-1].step, _GRAZES)
        if made is None:
            continue
        left = [point.event for point in outwards[len(points) - gone :]]
        events = [event for event in events if event not in left]
        points = points[: len(points) - gone] if last else points[gone:]
        start = min(max(start - (0 if last else gone), 0), len(points) - 1)
        step, details = made
        near = points[-1 if last else 0]
        length = float(np.linalg.norm(np.subtract(step.position, near.step.position)))
        at = near.arclength + (length if last else -length)
        low, high = sorted((near.arclength, at))
        event = Event("GR", _MERGES, "located", at, (low, high), step.residual, step, 0, True, details)
        place = Point(0, at, step, length, event)
        points = [*points, place] if last else [place, *points]
        events = [*events, event] if last else [event, *events]
        start += not last
        ends[last] = End(EndReason.EVENT, "", end.tally)
    if ends == list(run.ends):
        return run
    return _placed(points, events, (ends[0], ends[1]), start)


def _placed(points: list[Point], events: list[Event], ends: tuple[End, End], start: int) -> Run:
    """A run with its indices and arclengths counted from its first point."""
    first, moved = points[0].arclength, dict[int, Event]()
    for index, point in enumerate(points):
        for event in events:
            if event is point.event or event.point is point.step:
                low, high = event.bracket
                moved[id(event)] = replace(event, arclength=event.arclength - first, bracket=(low - first, high - first), index=index)
        marked = None if point.event is None else moved.get(id(point.event))
        points[index] = replace(point, index=index, arclength=point.arclength - first, event=marked)
    return Run(Points([points], [0]), tuple(moved.get(id(event), event) for event in events), ends, start)


def _exact_end(family: ForcedFamily, near: Step, part: float) -> tuple[Step, dict[str, Any]] | None:
    """The end of a family just beyond a step: the orbit there, and the details of its event. part: of the limits."""
    problem, moment = family.problem, _moment(family.problem, near.y, part * _BRIEF)
    if moment is None:
        return None
    y = _held_orbit(problem, near.y, moment) if _closed_for_ever(problem, moment) else _touching_orbit(problem, near.y)
    if y is None:
        return None
    position = problem.position(y)
    if np.linalg.norm(position - problem.position(near.y)) > part * _NEAR:
        return None
    letter = problem.modes.contact_letters[moment.contact]
    if _closed_for_ever(problem, moment):
        note = f"stop {letter} opens no more: it sticks for the whole period"
    elif moment.opens:
        note = f"stop {letter} opens no more: the flight until its next impact has no duration"
    else:
        note = f"the impacts at stop {letter} before it sticks vanish: their speed reaches zero"
    residual = float(np.abs(problem.residual(y)).max())
    value = float(y[problem.place])
    # The flight that vanishes changes nothing to first order: multipliers are those without it, or close to those next to the end.
    made = without_moment(problem, y)
    multipliers = problem.period_multipliers(near.y) if made is None else made[0].period_multipliers(made[1])
    details = {"stop": letter, "note": note, "multipliers": multipliers}
    return near._replace(
        y=y, position=position, parameter=value, residual=residual if math.isfinite(residual) else near.residual,
        extra=replace(near.extra, y=y),
    ), details  # fmt: skip


def _touching_orbit(problem: ForcedProblem, y: np.ndarray) -> np.ndarray | None:
    """The end of the family near y, as an orbit of the problem: that at which the contact force touches zero without its moment."""
    made = without_moment(problem, y)
    if made is None:
        return None
    narrow, guess, moment = made
    flight = moment.begin - moment.opens
    stop = int(problem.modes.contact_stop[moment.contact])
    last: list[Solution] = []

    def force(value: float) -> float:
        begun = (last[-1].y if last else guess).copy()
        begun[narrow.place] = value
        last.append(narrow.solve(begun))
        found = force_event(narrow, last[-1])
        wanted = int(last[-1]["clearance_flight"]) == flight and int(last[-1]["clearance_stop"]) == stop
        if found is None or not wanted or found.kind != ("inside" if moment.opens else "begin"):
            raise NotConverged("another stop is nearer")
        return last[-1]["clearance"]

    try:
        _zero(force, float(y[problem.place]), problem.units[problem.size + 1])
    except NotConverged:
        return None
    found, at, count = last[-1].y, float(last[-1]["clearance_time"]), moment.length
    nodes, times, size = narrow.nodes(found), narrow.flight_times(found), 2 * problem.degrees_of_freedom
    if moment.opens:
        state, fraction = narrow.fly(nodes[flight], at, flight)
        state = at_rest(problem, state, stop)
        inserted = np.tile([*state, fraction], (count, 1))
        rows = np.insert(nodes[:, : size + 1], flight + 1, inserted, axis=0)
        times = np.concatenate([times[:flight], [at], np.zeros(count - 1), [times[flight] - at], times[flight + 1 :]])
    else:
        rows = np.insert(nodes[:, : size + 1], flight, np.tile(nodes[flight, : size + 1], (count - 1, 1)), axis=0)
        times = np.insert(times, flight, np.zeros(count - 1))
    return _begun_as(problem, y, rows, times, narrow.parameters(found))


def _begun_as(problem: ForcedProblem, near: np.ndarray, rows: np.ndarray, times: np.ndarray, parameters: dict[str, float]) -> np.ndarray:
    """An orbit, begun at any of its nodes, in the unknowns of a problem whose orbit `near` is its neighbour. rows: states and times."""
    values, (sign, part) = [parameters[name] for name in problem.released], problem.closing
    size, count, here = 2 * problem.degrees_of_freedom, len(times), problem.position(near)
    found: list[tuple[float, np.ndarray]] = []
    for turn in range(count * (2 if problem.half else 1)):
        past, lasting = turn % count, np.roll(times, -turn)
        begun = np.roll(rows, -past, axis=0)
        # The nodes that are passed come again, as their images, and of half a period all of them do.
        for later_ones in (begun[count - past :], begun if turn >= count else begun[:0]):
            later_ones[:, :size] *= sign
            later_ones[:, size] += part
        if problem.has_clock:
            begun[:, size] += round(problem.instants(near)[0] - begun[0, size])
        y = problem.pack(begun[:, :size], begun[:, size], values, lasting)
        distance = np.abs(problem.position(y) - here).max() + np.abs(lasting - problem.flight_times(near)).max()
        found.append((float(distance), y))
    return min(found, key=lambda one: one[0])[1]


def _held_orbit(problem: ForcedProblem, y: np.ndarray, moment: _Moment) -> np.ndarray | None:
    """The end of the family near y, as an orbit of the problem: there the stop sticks for the whole period, and its force touches zero."""
    if len(problem.released) > 1 or not problem.has_clock:
        return None
    size, count = 2 * problem.degrees_of_freedom, len(problem.events)
    stop, side = int(problem.modes.contact_stop[moment.contact]), float(problem.modes.contacts.side[moment.contact])
    phase = 2.0 * math.pi * problem.load_periods * float(problem.nodes(y)[moment.begin, size])
    held: list[tuple[np.ndarray, float]] = []

    def force(value: float) -> float:
        at = problem.values | {problem.released[0]: value}
        held.append(_held(problem, at, stop, side, phase))
        return held[-1][1]

    try:
        value = _zero(force, float(y[problem.place]), problem.units[problem.size + 1])
    except (NotConverged, ValueError, np.linalg.LinAlgError):
        return None
    *state, angle = held[-1][0].tolist()
    fractions, times, begun = np.full(count, angle / (2.0 * math.pi * problem.load_periods)), np.zeros(count), y.copy()
    fractions[: moment.begin] -= 1.0
    begun[problem.place] = value
    times[(moment.begin + moment.length - 1) % count] = problem.period(begun)
    return problem.pack(np.tile(at_rest(problem, np.array(state), stop), (count, 1)), fractions, [value], times)


def _held(problem: ForcedProblem, at: dict[str, float], stop: int, side: float, phase: float) -> tuple[np.ndarray, float]:
    """State (2 n,) and phase of the loads at the least contact force of a stop that sticks for ever, near a phase; and that force.

    Each harmonic f exp(i nu t) of the loads gives one of the motion and of the force g,

        (K - nu^2 M + i nu C) u + side c g = f,      c u = d for nu = 0, else 0.
    """
    system, n = problem.parametric.system(at), problem.degrees_of_freedom
    base = float(problem.parametric.entries(at)[problem.parametric.layout.frequency][0])
    row = side * np.asarray(system.stops[stop].gap)
    bound = system.stops[stop].upper if side > 0.0 else -system.stops[stop].lower
    loads: dict[int, np.ndarray] = {0: np.zeros(n, dtype=complex)}
    for given in problem.parametric.forces(at):
        if isinstance(given, Harmonic):
            order = round(given.frequency / base)
            loads[order] = loads.get(order, 0.0) + given.cosine - 1j * given.sine
        elif isinstance(given, Constant):
            loads[0] = loads[0] + given.load
    orders, parts = np.array(list(loads)), []
    for order, load in loads.items():
        rate = order * base
        dynamic = system.stiffness - rate * rate * system.mass + 1j * rate * system.damping
        matrix = np.block([[dynamic, row[:, None]], [row[None, :], np.zeros((1, 1))]])
        parts.append(np.linalg.solve(matrix, np.append(load, bound if order == 0 else 0.0)))
    shape = np.array(parts)

    def derivative(angle: float, count: int) -> np.ndarray:
        found: np.ndarray = ((1j * orders[:, None]) ** count * shape * np.exp(1j * orders * angle)[:, None]).sum(axis=0).real
        return found

    angle = phase
    for _ in range(_ROUNDS):
        change = -derivative(angle, 1)[n] / derivative(angle, 2)[n]
        angle += change
        if abs(change) < 1e-15 * max(1.0, abs(angle)):
            break
    if not abs(angle - phase) < 2.0 * math.pi * _NEAR:
        raise NotConverged("the contact force has no minimum near the moment")
    found, rates = derivative(angle, 0), base * derivative(angle, 1)
    return np.array([*found[:n], *rates[:n], angle]), float(found[n])


def _zero(function: Callable[[float], float], start: float, unit: float) -> float:
    """Zero of a function near a start, by secants."""
    unit = abs(unit or start)
    old, value = start, start + _PROBE * unit
    before, here = function(old), function(value)
    for _ in range(_ROUNDS):
        if here == before or abs(value - old) <= 4.0 * np.finfo(float).eps * unit:
            break
        old, before, value = value, here, value - here * (value - old) / (here - before)
        here = function(value)
    if not abs(here) < BEYOND:
        raise NotConverged("the contact force does not vanish")
    return value
