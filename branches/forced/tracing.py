"""Following a family of forced orbits, and switching to the families that meet it at its events."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from branches.admissible import GRAZING, describe_grazing, unphysical
from branches.events import FREE_NORMAL_FORMS, Ended, event_ids
from branches.extending import joined
from branches.family import SETTINGS
from branches.forced.along_parameters import parameter_bounds, unbounded
from branches.forced.branch import ForcedBranch, ForcedEvent, largest_multiplier
from branches.forced.closing import with_exact_ends
from branches.forced.family import parameter_family
from branches.forced.identity import closure_name
from branches.forced.primitive import primitive_orbit
from branches.forced.switching import GrazingNeighbour, beside_grazing, beside_moment, emanating_orbits
from branches.interrupted import with_branch, with_computed
from branches.released.branch import ReleasedBranch, branch_in_parameter
from branches.released.criticality import free_criticality_of
from branches.solved_family import begun_along
from branches.tracing import GROWTH_EVERY, event_along
from bvp.contact_sequence import joined_sequence
from bvp.criticality import NORMAL_FORMS, Criticality, criticality
from bvp.forced import ForcedProblem
from bvp.multipoint import GROWTH, NotConverged
from bvp.released import ReleasedProblem
from continuation.problem import End, EndReason, Event, Point, Step
from continuation.run import Run, follow_both_ways

__all__ = ["OUT_OF_DOMAIN", "SWITCHES", "follow_response", "go_on", "point_inside", "primitive_branch", "switch_response"]

SWITCHES = ("PD", "SB", "BP", "GR", "LB")
"""Events at which other families begin."""

_ON_BOUND = 1e-12
"""Distance from a bound of the parameter, beside its values, within which it is on the bound."""

_LOCATED, _BESIDE = 1e-9, 1e-5
"""Distance from a bound within which the end of a run was located there, and clearance, speed or flight time beside a grazing, as parts of
those of the orbit."""

OUT_OF_DOMAIN = "DOMAIN"
"""Reason of an end behind which the system cannot have the values of its parameters."""

_SIGNS = {"both": 1, "up": 1, "down": -1, "along": 0}

_OPEN = {
    reason.name
    for reason in (
        EndReason.POINTS, EndReason.NOT_ASKED, EndReason.STOP_AT, EndReason.STOP_WHEN, EndReason.INTERRUPTED, EndReason.MINIMUM_STEP
    )
}  # fmt: skip
"""Ends from which a family can go on."""

_FAILED = 0.1
"""Where steps failed, flights are cut so that perturbations grow in each by no more than this part of `GROWTH`."""

_BEYOND = (4.0 * SETTINGS.minimum_step, 1e-6)
"""Arclengths from an end at which the system is looked at: steps to it fail earlier than the system does."""


def follow_response(
    problem: ForcedProblem,
    start: np.ndarray | Step,
    interval: tuple[float, float] = (-math.inf, math.inf),
    *,
    values: tuple[float, ...] = (),
    points: int | None = None,
    direction: str = "both",
    stop_at: str | None = None,
    origin: str | None = None,
    on_event: Callable[[Event], object] | None = None,
    on_point: Callable[[int], object] | None = None,
) -> ForcedBranch:
    """Follow the family of a forced orbit.

    Parameters
    ----------
    problem : ForcedProblem
        Of a free orbit a `ReleasedProblem`: the branch is then a `ReleasedBranch`.
    start : (u,) float, or Step
        Unknowns near an orbit, or an orbit with its tangent.
    interval : (float, float)
        The family ends at these values of the released parameter.
    values : sequence of float
        Values of the parameter that are marked (UZ).
    points : int, optional
        Points in total.
    direction : {"both", "up", "down", "along"}
        Both ways; only the way in which the parameter rises or falls at the first step; only along the tangent of the start.
    stop_at : str, optional
        Type of the events at which the family ends.
    origin : str, optional
        Where the family begins, in words: the end at the start if it is followed along its tangent.
    on_event, on_point : callable, optional
        Called with each event as it is found, and with the number of points so far.

    Raises
    ------
    ValueError
        For a start outside the interval, and for one that solves the equations but is no orbit.
    RuntimeError
        Where the family cannot be followed.
    KeyboardInterrupt
        With the branch up to there as its attribute `branch`, if it has a point.
    """
    settings = SETTINGS if points is None else replace(SETTINGS, maximum_points=points)
    _require_inside(problem, start, interval, origin)

    def follow(problem: ForcedProblem, start: np.ndarray | Step, known: tuple[int, int]) -> tuple[Run, tuple[int, int]]:
        """A run, and the points and events that were reported; `known` were reported before."""
        place = problem.place
        family = parameter_family(problem, interval, values, float((start.y if isinstance(start, Step) else np.asarray(start))[place]))
        if isinstance(start, Step):  # it has the test functions of another family
            begin = family.step(start.y, start.tangent, 0.0)
        else:
            begin = family.begin(problem.solve(np.asarray(start, dtype=float)).y)
        beyond = unphysical(*family.orbit_of(begin.extra)) if begin.converged else None
        if beyond is not None:
            raise ValueError(f"the start solves the equations but is no orbit: {beyond}; expected motion between the stops")
        counts = [0, 0]

        def counted(found: Any) -> None:
            counts[0] += len(found)
            if on_point is not None and counts[0] > known[0]:
                on_point(counts[0])

        def event_counted(event: Event) -> None:
            counts[1] += 1
            if on_event is not None and counts[1] > known[1]:
                on_event(event)

        try:
            run = follow_both_ways(
                family, begin, settings, both=direction == "both", direction=_SIGNS[direction], stop_when=unbounded(problem),
                stop_at=frozenset() if stop_at is None else frozenset({stop_at}),
                on_points=None if on_point is None else counted, on_event=None if on_event is None else event_counted,
            )  # fmt: skip
        except (KeyboardInterrupt, RuntimeError) as error:
            raise with_computed(error, lambda run: _branch_of(problem, run, interval, origin)) from None
        return run, (max(known[0], counts[0]), max(known[1], counts[1]))

    known = (0, 0)
    finer = _in_enough_pieces(problem, [start.y if isinstance(start, Step) else np.asarray(start, dtype=float)])
    while True:
        if finer is not problem:
            if isinstance(start, Step):
                start = _begun_in(problem, finer, start.y, start.tangent)
            else:
                start = problem.in_pieces(finer.pieces, start)[1]
            problem = finer
        run, known = follow(problem, start, known)
        looked_at = [run.points[i].step.y for i in (*range(0, len(run.points), GROWTH_EVERY), -1) if run.points]
        finer = _in_enough_pieces(problem, looked_at, any(end.reason is EndReason.MINIMUM_STEP for end in run.ends))
        if finer is problem:
            break
    if not run.points:
        raise RuntimeError(f"the family could not be followed: {run.ends[0].text}")
    return _branch_of(problem, run, interval, origin)


def _require_inside(problem: ForcedProblem, start: np.ndarray | Step, interval: tuple[float, float], origin: str | None) -> None:
    """Refuse a start outside a range: a family would end at once, as if it had the end of the range there."""
    name, (low, high) = problem.released[0], interval
    value = problem.parameters(start.y if isinstance(start, Step) else np.asarray(start, dtype=float))[name]
    slack = _ON_BOUND * max(abs(bound) for bound in (value, problem.values[name], low, high) if math.isfinite(bound))
    if not low - slack <= value <= high + slack:
        where = "" if origin is None else f", where the family begins at {origin}"
        raise ValueError(f"the range {low:g}:{high:g} does not contain {name} = {value:.10g}{where}")


def _in_enough_pieces(problem: ForcedProblem, unknowns: Sequence[np.ndarray], failed: bool = False) -> ForcedProblem:
    """The problem in as many pieces as some orbits need: see `branches.tracing.follow_family`. failed: whether steps failed, as rounding
    that grows can make them."""
    limit = GROWTH * (_FAILED if failed else 1.0)
    pieces = max((problem.enough_pieces(y, limit) for y in unknowns), default=problem.pieces)
    return problem.sibling(problem.sequence, pieces=pieces) if pieces > problem.pieces else problem


def _begun_in(problem: ForcedProblem, other: ForcedProblem, y: np.ndarray, tangent: np.ndarray) -> Step:
    """An orbit in another number of pieces, with its tangent (at least (u,)) turned like the one given."""
    first = np.r_[0 : problem.size + 1, problem.place : problem.unknowns]  # the first node and the parameters
    there = np.r_[0 : other.size + 1, other.place : other.unknowns]
    scale = problem.scales(y)[first]
    return begun_along(
        parameter_family(other), problem.in_pieces(other.pieces, y)[1], tangent[first], np.where(scale > 0.0, scale, 1.0), there
    )


def _can_go_on(branch: ForcedBranch, last: bool, interval: tuple[float, float]) -> bool:
    """Whether a branch can go on beyond its first or last point in a range of its parameter."""
    place = len(branch) - 1 if last else 0
    if branch.ended[last].reason == EndReason.EVENT.name:
        value = branch.parameter[place]
        bounds = any(np.isclose(value, bound, rtol=1e-9, atol=0.0) for bound in branch.interval)
        event = next((event for event in branch.events if event.point == place), None)
        return event is not None and event.type == "EP" and bounds and interval[0] < value < interval[1]
    return branch.ended[last].reason in _OPEN


def go_on(
    branch: ForcedBranch, interval: tuple[float, float], *, direction: str = "both", **options: Any
) -> tuple[ForcedBranch, list[int]]:
    """Follow a branch on beyond its ends.

    Parameters
    ----------
    branch : ForcedBranch
    interval : (float, float)
        Range of its parameter, which contains that of the branch.
    direction : {"both", "up", "down"}
        Beyond both ends, or beyond those behind which the parameter rises or falls.
    **options
        As for `follow_response`.

    Returns
    -------
    ForcedBranch, list of int
        The branch and what follows, and the indices of the points, 0 or the last one, where it now ends. An end at an event is left as it
        is, and so is one behind which the family leaves the range.
    """
    moved = []
    for last in [last for last in (True, False) if _can_go_on(branch, last, interval)]:
        place = -1 if last else 0
        outward = branch.tangents[-1] if last else -branch.tangents[0]
        if direction != "both" and outward[branch.problem.place] * _SIGNS[direction] <= 0.0:
            continue
        begin = parameter_family(branch.problem, interval).step(branch.unknowns[place], np.pad(outward, (0, len(outward))), 0.0)
        try:
            further = follow_response(branch.problem, begin, interval, direction="along", **options)
        except KeyboardInterrupt as error:
            computed: ForcedBranch | None = getattr(error, "branch", None)
            raise error if computed is None else with_branch(error, joined(branch, computed, last)) from None
        branch = joined(_in_pieces_of(branch, further), further, last)
        moved.append(last)
    return branch, [len(branch) - 1 if last else 0 for last in moved]


def _in_pieces_of(branch: ForcedBranch, other: ForcedBranch) -> ForcedBranch:
    """A branch in the pieces of another one, which has more."""
    problem, finer = branch.problem, other.problem
    if finer.pieces == problem.pieces:
        return branch
    found = []
    for k, (y, tangent) in enumerate(zip(branch.unknowns, branch.tangents, strict=True)):
        begun = _begun_in(problem, finer, y, tangent)
        if not begun.converged:
            raise RuntimeError(f"point {k} of the branch could not be solved in {finer.pieces} pieces, as the orbits beyond its end are")
        found.append((begun.y, begun.tangent[: finer.unknowns]))
    unknowns, tangents = (np.array(part) for part in zip(*found, strict=True))
    return replace(branch, problem=finer, unknowns=unknowns, tangents=tangents)


def _branch_of(problem: ForcedProblem, run: Run, interval: tuple[float, float], origin: str | None) -> ForcedBranch:
    run = with_exact_ends(parameter_family(problem), run)
    _put_on_bounds(problem, run, interval)
    steps = [point.step for point in run.points]
    unknowns = np.array([step.y for step in steps])
    events = []
    for event, id in zip(run.events, event_ids(event.code for event in run.events), strict=True):
        details, at = event.details, event.point
        if "label" in details:  # its change reads in the order of arclength
            details = details | {"note": event_along(event, event.index < run.start and not (run.closed and event.index == 0))[2]}
        multipliers = details["multipliers"] if "multipliers" in details else problem.period_multipliers(at.y)
        largest = largest_multiplier(problem, multipliers)
        found = ForcedEvent(
            id, event.code, event.index, problem.known_values(at.y), event.arclength, event.status,
            (float(event.bracket[0]), float(event.bracket[1])), event.residual, details.get("stop"), details.get("angle"),
            details.get("note"), largest if math.isfinite(largest) else None,
        )  # fmt: skip
        events.append(_with_normal_form(problem, at.y, found))
    ended = []
    for end, point, sign in zip(run.ends, (run.points[0], run.points[-1]), (-1, 1), strict=True):
        ended.append(_ended(problem, end, point, sign, origin))
    tangents, residuals = np.array([step.tangent[: problem.unknowns] for step in steps]), np.array([step.residual for step in steps])
    rest = unknowns, tangents, run.points.arclengths(), residuals, tuple(events), (ended[0], ended[1]), run.start, interval
    branch = branch_in_parameter(problem, *rest)
    if isinstance(branch, ReleasedBranch):
        return branch.with_orbits([step.extra for step in steps])
    return replace(branch, events=tuple(_with_neighbours(branch, event) for event in events))


def _put_on_bounds(problem: ForcedProblem, run: Run, interval: tuple[float, float]) -> None:
    """Solve the first and the last orbit of a run at the bound of the parameter at which they were located: 0, not 1e-15. Where
    Newton's method finds no orbit, as where perturbations grow too much, it stays as it is."""
    place = problem.place
    located = {event.index for event in run.events if event.code != "EP"}  # beside a bound there can be another event
    for point in (run.points[index] for index in {0, len(run.points) - 1} - located):
        for bound in parameter_bounds(problem, interval)[0]:
            moved = point.step.y.copy()
            if abs(moved[place] - bound) <= _LOCATED * max(abs(moved[place]), abs(problem.values[problem.released[0]]) or 1.0):
                moved[place] = bound
                with suppress(NotConverged):
                    point.step.y[:] = problem.solve(moved).y
                    point.step.y[place] = bound


def _with_normal_form(problem: ForcedProblem, y: np.ndarray, event: ForcedEvent) -> ForcedEvent:
    """The event with the coefficient of its normal form."""
    if event.type not in NORMAL_FORMS:
        return event
    found: Criticality | None
    if isinstance(problem, ReleasedProblem):
        found = free_criticality_of(problem, y, event.type) if event.type in FREE_NORMAL_FORMS else None
    else:
        try:
            found = criticality(problem, y, event.type, event.angle)
        except (ValueError, np.linalg.LinAlgError):
            return event
    if found is None or not math.isfinite(found.coefficient):
        return event
    return event._replace(coefficient=found.coefficient, criticality=found.kind)


def _ended(problem: ForcedProblem, end: End, point: Point, sign: int, origin: str | None) -> Ended:
    """Why a branch ends at a point, in the terms of the user. sign: 1 at the last point, -1 at the first."""
    name, text = problem.released[0], end.text
    if end.reason is EndReason.MINIMUM_STEP:
        family = parameter_family(problem)
        for distance in _BEYOND:
            why = family.violation(point.step.y, point.step.tangent, sign * distance)
            if why is not None:
                return Ended(OUT_OF_DOMAIN, f"the system ends at {name} = {point.step.parameter:.12g}: {why}")
        found, keys, units = point.step.extra, ("clearance", "speed", "flight"), (problem.reach, problem.speed, problem.duration)
        near, verb = min((abs(float(found[key])) / unit(found), verb) for verb, key, unit in zip(GRAZING, keys, units, strict=True))
        text += f"; it is beside a grazing: {describe_grazing(problem, found, verb)['note']}" if near < _BESIDE else ""
    if end.reason is EndReason.EVENT and point.event is not None:
        value = problem.parameters(point.step.y)[name]
        text = f"{point.event.code} at {name} = {value:.12g}: {point.event.details.get('note')}{end.unlocated}"
    elif end.reason is EndReason.NOT_ASKED and origin is not None:
        return Ended(EndReason.EVENT.name, f"the family begins at {origin}")
    elif end.reason is EndReason.STOP_WHEN:
        text = f"{end.detail}, at {name} = {point.step.parameter:.12g}"
    return Ended(end.reason.name, text)


def _with_neighbours(branch: ForcedBranch, event: ForcedEvent) -> ForcedEvent:
    if event.type != "GR":
        return event
    found = _at_grazing(branch, event)
    sequences = tuple((joined_sequence(one.problem.sequence), one.persists) for one in found)
    return event._replace(neighbours=sequences, symmetric=tuple(one.problem.half for one in found))


def _at_grazing(branch: ForcedBranch, event: ForcedEvent) -> list[GrazingNeighbour]:
    problem, k = branch.problem, event.point
    inside = k + 1 if k + 1 < len(branch) else k - 1
    known = beside_moment(problem, branch.unknowns[k], branch.unknowns[inside] - branch.unknowns[k]) if inside >= 0 else None
    if known is not None:
        return known
    solution = problem.step(branch.unknowns[k], np.pad(branch.tangents[k], (0, problem.unknowns)), 0.0)  # of no known curvature
    if solution is None or inside < 0:
        return []
    return beside_grazing(problem, solution, branch.unknowns[inside] - branch.unknowns[k])


def switch_response(branch: ForcedBranch, event: ForcedEvent) -> list[tuple[ForcedProblem, Step]]:
    """The first orbits of the families that begin at an event, with tangents that point away from it.

    At PD it is the family of twice the period; at SB both mirror images; at BP both sides of the other family; at GR those with an impact
    more or less; at LB the one with the other order of impacts.

    Raises
    ------
    ValueError
        For an event where no other family begins.
    RuntimeError
        Where none was found.
    """
    if event.type not in SWITCHES:
        raise ValueError(f"no other family begins at {event.id}; expected an event of type {', '.join(SWITCHES)}")
    if event.type in ("GR", "LB"):
        found = [(one.problem, one.step) for one in _at_grazing(branch, event)]
    else:
        try:
            found = emanating_orbits(branch.problem, branch.unknowns[event.point], branch.tangents[event.point], event.type)
        except (NotConverged, np.linalg.LinAlgError) as error:
            raise RuntimeError(f"no family was found at {event.id}: {error}") from error
    if not found:
        raise RuntimeError(f"no family was found at {event.id}")
    return found


def primitive_branch(branch: ForcedBranch) -> ForcedBranch:
    """The family of the primitive orbits of a branch, in the same range: the branch itself, unless its orbits repeat themselves, or are
    symmetric and solved over their full period.

    Raises
    ------
    RuntimeError
        Where that family cannot be followed.
    """
    i = point_inside(branch, (-math.inf, math.inf))
    problem, y = primitive_orbit(branch.problem, branch.unknowns[i])
    if problem is branch.problem or closure_name(problem) != branch.full_family.ids[0].partition(":")[0]:
        return branch
    return follow_response(problem, y, branch.interval)


def point_inside(branch: ForcedBranch, interval: tuple[float, float]) -> int:
    """Index of a point from which the branch can be followed in another range of its parameter: the one inside that is nearest to its
    start, at no event.

    Raises
    ------
    ValueError
        If the branch has no point in the range.
    """
    low, high = interval
    inside = np.flatnonzero((branch.parameter >= low) & (branch.parameter <= high))
    plain = np.setdiff1d(inside, [event.point for event in branch.events])
    usable = plain if len(plain) else inside
    if not len(usable):
        reached = f"{branch.parameter.min():.8g} to {branch.parameter.max():.8g}"
        raise ValueError(f"the range {low:g}:{high:g} has no point of the branch, which has {branch.name} = {reached}")
    return int(usable[np.argmin(np.abs(usable - branch.start))])
