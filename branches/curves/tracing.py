"""Following a curve in the plane of two parameters: from its start, and on from its ends."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from branches.curves.collapse import with_collapsed_ends
from branches.curves.monitor import ANYWHERE, Window
from branches.curves.plane import ParameterPlane
from branches.curves.record import BifurcationCurve, CurveEvent
from branches.curves.single_orbits import Narrow
from branches.curves.starting import CurveStart, NoCurve, is_inside
from branches.events import Ended, event_ids
from branches.extending import joined
from branches.family import SETTINGS
from branches.forced.tracing import OUT_OF_DOMAIN
from branches.interrupted import with_computed
from bvp.multipoint import lost_digits
from continuation.control import Settings
from continuation.curves import Curve
from continuation.problem import End, EndReason, Event, Point, Step
from continuation.run import Run, follow_both_ways

__all__ = ["can_go_on", "curve_again", "extend_curve", "first_point", "follow_curve", "is_within", "step_at"]

_OPEN = {reason.name for reason in (EndReason.POINTS, EndReason.NOT_ASKED, EndReason.INTERRUPTED)}
"""Ends from which a curve can go on."""

_ROUNDING = 1e-9
"""Difference of a parameter from a bound of its range, beside the bound, that is rounding."""

_DIRECTIONS = {"both": 1, "up": 1, "down": -1, "along": 0}


def follow_curve(
    start: CurveStart,
    window: Window,
    *,
    points: int | None = None,
    direction: str = "both",
    on_event: Callable[[Event], object] | None = None,
    on_point: Callable[[int], object] | None = None,
    begun: tuple[Curve, Step] | None = None,
    settings: Settings = SETTINGS,
) -> BifurcationCurve:
    """Follow a curve from its start, both ways.

    Parameters
    ----------
    start : CurveStart
    window : ((float, float), (float, float))
        The curve ends where a parameter leaves its range.
    points : int, optional
        Points in total.
    direction : {"both", "up", "down"}
        Both ways; only the way in which the first parameter rises or falls.
    on_event, on_point : callable, optional
        Called with each event, and with the number of points so far.
    begun : (Curve, Step), optional
        The result of `first_point` for this start and window, if it is known.
    settings : continuation.Settings
        How the curve is followed.

    Raises
    ------
    NoCurve
        Where the start is on no curve, and where the event does not depend on the parameters.
    KeyboardInterrupt
        With the curve up to there as its attribute `branch`.
    """
    curve, first = first_point(start, window) if begun is None else begun
    settings = settings if points is None else replace(settings, maximum_points=points)
    counted = None if on_point is None else _counting(on_point, 1)
    try:
        run = follow_both_ways(
            curve, first, settings, both=direction == "both", direction=_DIRECTIONS[direction], on_event=on_event, on_points=counted
        )
    except (KeyboardInterrupt, RuntimeError) as error:
        raise with_computed(error, lambda run: _record(curve, start, run, window)) from None
    if not run.points:
        raise NoCurve(f"the curve could not be followed: {run.ends[0].text}")
    return with_collapsed_ends(_record(curve, start, run, window), _of_single_orbits)


def curve_again(curve: BifurcationCurve, origin: str = "") -> CurveStart:
    """The start that a curve was followed from."""
    return CurveStart(curve.plane, curve.code, curve.grazing, curve.unknowns[curve.start], origin or curve.origin, curve.free)


def is_within(curve: BifurcationCurve, window: Window) -> bool:
    """Whether all points of a curve are in the ranges of its parameters; an end on a bound is."""
    return all(
        low - _ROUNDING * abs(low) <= least and most <= high + _ROUNDING * abs(high)
        for (low, high), least, most in zip(window, *curve.span, strict=True)
    )


def can_go_on(curve: BifurcationCurve, last: bool, window: Window) -> bool:
    """Whether a curve can go on beyond its first or last point, in ranges that contain it."""
    if curve.ended[last].reason != EndReason.EVENT.name:
        return not curve.closed and curve.ended[last].reason in _OPEN
    place = len(curve) - 1 if last else 0
    if not any(event.type == "EP" and event.point == place for event in curve.events):
        return False
    # At the end of a domain the value is a bound of it, too.
    return all(
        max(asked[0], domain[0]) + _ROUNDING * abs(value) < value < min(asked[1], domain[1]) - _ROUNDING * abs(value)
        for value, asked, domain in zip(curve.parameters[place].tolist(), window, curve.plane.domains, strict=True)
    )


def extend_curve(
    curve: BifurcationCurve,
    window: Window,
    *,
    points: int | None = None,
    direction: str = "both",
    on_event: Callable[[Event], object] | None = None,
    on_point: Callable[[int], object] | None = None,
) -> BifurcationCurve:
    """Follow a curve on beyond its ends, in wider ranges. Its points are kept.

    An end at an event, such as a grazing, stays where it is, and so does one behind which the curve leaves the ranges.

    Parameters
    ----------
    curve : BifurcationCurve
    window : ((float, float), (float, float))
        Ranges of its two parameters, which contain all its points.
    points : int, optional
        Points in total.
    direction : {"both", "up", "down"}
        Beyond both ends, or beyond those behind which the first parameter rises or falls.
    on_event, on_point : callable, optional
        As for `follow_curve`, of what is new.

    Raises
    ------
    ValueError
        If the curve has points outside the ranges, or as many points as asked for.
    KeyboardInterrupt
        With the curve up to there as its attribute `branch`.
    """
    if not is_within(curve, window):
        raise ValueError("the curve has points outside these ranges; expected ranges that contain it")
    left = SETTINGS.maximum_points if points is None else points - len(curve)
    if left < 1:
        raise ValueError(f"the curve has {len(curve)} points already, expected more than {points}")
    start = curve_again(curve)
    problem = start.curve(window)
    total, open_ends = len(curve) + left, [last for last in (True, False) if can_go_on(curve, last, window)]
    for k, last in enumerate(open_ends):
        begin = step_at(problem, curve, len(curve) - 1 if last else 0, 1.0 if last else -1.0)
        if begin is None or (direction != "both" and begin.slope * _DIRECTIONS[direction] <= 0.0):
            continue
        counted = None if on_point is None else _counting(on_point, len(curve))
        # The end itself is one of the points of its piece.
        allowed = max(1, (total - len(curve)) // (len(open_ends) - k)) + 1
        try:
            run = follow_both_ways(
                problem, begin, replace(SETTINGS, maximum_points=allowed), both=False, direction=0, on_event=on_event, on_points=counted
            )
        except (KeyboardInterrupt, RuntimeError) as error:
            known = curve
            raise with_computed(error, lambda run: joined(known, _record(problem, start, run, window), last)) from None  # noqa: B023
        if not run.points:
            continue
        further = _record(problem, start, run, window)
        if further.closed:
            nearest = np.abs(further.unknowns - curve.unknowns[curve.start]).max(axis=1)
            return replace(further, start=int(np.argmin(nearest)))
        curve = joined(curve, further, last)
    return with_collapsed_ends(replace(curve, window=window), _of_single_orbits)


def step_at(problem: Curve, curve: BifurcationCurve, index: int, sign: float = 1.0) -> Step | None:
    """A point of a curve with its tangent, along the curve or against it (sign -1); None where it is not found again."""
    begin = problem.begin(curve.unknowns[index])
    if not begin.converged:
        return None
    m, u = curve.unknowns.shape[1], curve.plane.size
    scale = np.concatenate([curve.plane.scales(begin.y[:u]), np.ones(m - u)])
    if sign * float((begin.tangent[:m] / scale) @ (curve.tangents[index] / scale)) < 0.0:
        begin = problem.step(begin.y, -begin.tangent, 0.0)
    return begin if begin.converged else None


def _counting(on_point: Callable[[int], object], known: int) -> Callable[[Sequence[Point]], object]:
    """Counts new points on from those of a curve, of which the first one is known."""
    count = known - 1

    def counted(new: Sequence[Point]) -> None:
        nonlocal count
        count += len(new)
        on_point(count)

    return counted


_NEAR_END = 80
"""Points of a curve of single orbits, on which the end of another one is looked for."""


def _of_single_orbits(narrow: Narrow, curve: BifurcationCurve) -> BifurcationCurve | None:
    """The curve of the single orbits next to the end of one of doubled orbits, or of orbits without symmetry."""
    plane, unknowns = curve.plane.of(narrow.problem, narrow.y)
    try:
        start = CurveStart(plane, narrow.code, narrow.grazing, unknowns, free=narrow.free)
        # The place can be beyond a bound of these orbits by rounding: the bound is located from a point inside.
        single, first = first_point(start, ANYWHERE)
        beside = (single.step(first.y, first.tangent, ds) for ds in _PROBES)
        inside = next((step.y for step in beside if is_inside(single, step)), first.y)
        return follow_curve(start._replace(y=inside), ANYWHERE, points=_NEAR_END)
    except (ValueError, RuntimeError):
        return None


_BEYOND = (4.0 * SETTINGS.minimum_step, 1e-6)
"""Arclengths from an end at which the system is looked at: steps to it fail earlier than the system does."""


def first_point(start: CurveStart, window: Window) -> tuple[Curve, Step]:
    """A curve, and its first point.

    Raises
    ------
    NoCurve
        Where the start is on no curve, and where the event does not depend on the parameters.
    """
    curve = start.curve(window)
    first = curve.begin(start.y)
    if not first.converged:
        raise NoCurve(_why_no_start(curve, start))
    _require_both(curve, first, start)
    return curve, first


def _require_both(curve: Curve, first: Step, start: CurveStart) -> None:
    """Refuse a parameter on which the event does not depend: the other one is constant along the curve."""
    u, plane = start.plane.size, start.plane
    beside = [step for step in (curve.step(first.y, first.tangent, ds) for ds in _PROBES) if step.converged]
    values = np.array([plane.parameters_at(step.y[:u]) for step in (first, *beside)])
    sizes = np.maximum(np.abs(values).max(axis=0), 1e-300)
    for k, name in enumerate(plane.names):
        if len(beside) == len(_PROBES) and np.ptp(values[:, k]) <= _CONSTANT * sizes[k]:
            other = plane.names[1 - k]
            raise NoCurve(
                f"the {start.code} does not depend on {other}: it stays at {name} = {values[0, k]:.10g}; expected another parameter"
            )


_PROBES, _CONSTANT = (0.02, -0.03), 1e-11
"""Arclengths at which a parameter is compared with that of the start, and its relative change that is rounding."""


def _why_no_start(curve: Curve, start: CurveStart) -> str:
    """Why no point of the curve was found at its start."""
    u = start.plane.size
    scale = start.plane.scales(start.y[:u])
    names = " and ".join(start.plane.names)
    lost = lost_digits(start.plane.problem, start.y[:u])
    if lost:
        return f"no point of a curve {start.code} in {names} was found there: {lost}"
    try:
        at = start.plane.linearised(start.y[:u])
        first = curve.condition.first(at, start.y[u:], scale)
        held = curve.condition.held(at, start.y[u:], first, scale)
        singular = np.linalg.svd(np.vstack([at.jacobian, held.gradient[:, :u]]) * scale, compute_uv=False)
    except np.linalg.LinAlgError:
        return f"no curve {start.code} in {names} starts there: derivatives of the forces are no numbers, as those of |w|^p can be at w = 0"
    if singular[-1] < 1e-10 * singular[0]:
        return f"the {start.code} there does not depend on {names} alone: its equations are singular; expected other parameters"
    return f"no point of a curve {start.code} in {names} was found there: Newton's corrections do not settle"


def _record(curve: Curve, start: CurveStart, run: Run, window: Window) -> BifurcationCurve:
    plane = start.plane
    steps = [point.step for point in run.points]
    unknowns = np.array([step.y for step in steps])
    m = unknowns.shape[1]
    events = []
    for event, id in zip(run.events, event_ids(event.code for event in run.events), strict=True):
        events.append(
            CurveEvent(
                id, event.code, event.index, plane.values(event.point.y[: plane.size]), event.arclength, event.status,
                (float(event.bracket[0]), float(event.bracket[1])), event.residual, event.details.get("stop"), event.details.get("note"),
            )
        )  # fmt: skip
    multipliers = plane.problem.of_period(np.array([step.extra.multipliers for step in steps]))
    coefficient = np.array([step.extra.coefficient for step in steps])
    coefficient[np.isnan(multipliers).any(axis=1)] = math.nan  # an impact grazes
    ended = [_ended(plane, *one) for one in zip(run.ends, (run.points[0], run.points[-1]), (-1, 1), strict=True)]
    parameters = np.array([plane.parameters_at(y[: plane.size]) for y in unknowns])
    return BifurcationCurve(
        plane=plane, code=start.code, grazing=start.grazing, unknowns=unknowns,
        tangents=np.array([step.tangent[:m] for step in steps]), parameters=parameters,
        arclength=run.points.arclengths(), residual=np.array([step.residual for step in steps]),
        multipliers=multipliers, coefficient=coefficient, events=tuple(events), ended=(ended[0], ended[1]), start=run.start,
        closed=run.closed, window=window, origin=start.origin, free=start.free,
    )  # fmt: skip


def _ended(plane: ParameterPlane, end: End, point: Point, sign: int) -> Ended:
    """Why a curve ends at a point, in the terms of the user. sign: 1 at the last point, -1 at the first."""
    values = plane.parameters_at(point.step.y[: plane.size])
    place = " and ".join(f"{name} = {value:.12g}" for name, value in zip(plane.names, values, strict=True))
    if end.reason is EndReason.EVENT and point.event is not None:
        return Ended(end.reason.name, f"{point.event.code} at {place}: {point.event.details.get('note')}{end.unlocated}")
    for distance in _BEYOND if end.reason is EndReason.MINIMUM_STEP else ():
        why = plane.violation(point.step.y[: plane.size] + sign * distance * point.step.tangent[: plane.size])
        if why is not None:
            return Ended(OUT_OF_DOMAIN, f"the system ends at {place}: {why}")
    if end.reason is EndReason.CLOSED:
        return Ended(end.reason.name, "closed: the curve is back at its first point")
    return Ended(end.reason.name, f"at {place}: {end.text}")
