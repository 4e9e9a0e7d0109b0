"""Following a curve in the plane of two parameters: from an event of a family, from another curve, and on from its ends."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from branches.curves.collapse import Narrow, with_collapsed_ends
from branches.curves.extending import can_go_on, is_within, joined
from branches.curves.free import FreeKind
from branches.curves.free_start import free_curve, free_event
from branches.curves.grazing import Grazing, GrazingMonitor, grazing_at, grazing_condition, observed
from branches.curves.monitor import BifurcationMonitor, Window
from branches.curves.pencils import forced_condition
from branches.curves.plane import ParameterPlane, plane_of
from branches.curves.record import BifurcationCurve, CurveEvent
from branches.curves.steps import forced_curve
from branches.events import Ended
from branches.family import SETTINGS
from branches.forced.branch import ForcedBranch, ForcedEvent
from branches.forced.primitive import full_period, primitive_orbit, twice
from branches.forced.tracing import OUT_OF_DOMAIN
from branches.interrupted import with_computed
from bvp.forced import ForcedProblem
from bvp.released import ReleasedProblem
from continuation.curves import Curve
from continuation.problem import End, EndReason, Event, Point, Step
from continuation.run import Run, follow_both_ways

__all__ = [
    "CURVES", "CurveStart", "NoCurve", "curve_again", "curve_at", "curve_start", "curve_through", "extend_curve", "first_point",
    "follow_curve", "step_at",
]  # fmt: skip

CURVES = ("SN", "PD", "SB", "NS", "BP", "GR")
"""Events that can be continued in two parameters."""

_REASONS = {
    "EP": "the end of a run is no bifurcation",
    "LB": "the label changes there without a bifurcation",
    "IO": "an impulsive orbit is no bifurcation: its family passes it without a change",
    "UZ": "a marked value is no bifurcation",
    "RT": "a p:q resonance changes no stability: a curve of it is a level of the multipliers",
}

_DIRECTIONS = {"both": 1, "up": 1, "down": -1, "along": 0}


class NoCurve(ValueError):
    """An event that cannot be continued in two parameters, or not in these; the message says why."""


class CurveStart(NamedTuple):
    """Where a curve is started: its plane, its condition, unknowns near a point of it, and what it is in words."""

    plane: ParameterPlane
    code: str
    grazing: Grazing | None
    y: np.ndarray
    origin: str = ""
    free: FreeKind | None = None

    def curve(self, window: Window) -> Curve:
        """The curve as a `continuation.Problem`."""
        return curve_problem(self.plane, self.code, self.free or self.grazing, self.y, window)


def curve_problem(plane: ParameterPlane, code: str, kind: FreeKind | Grazing | None, y: np.ndarray, window: Window) -> Curve:
    """A curve as a `continuation.Problem`. y: an orbit of it."""
    if isinstance(plane.problem, ReleasedProblem):
        assert kind is not None
        return free_curve(plane, code, kind, y, window)
    grazing = kind if isinstance(kind, Grazing) else None
    if grazing is not None:
        return forced_curve(plane, grazing_condition(plane, grazing), GrazingMonitor(plane, grazing, window), grazing)
    return forced_curve(plane, forced_condition(plane, code), BifurcationMonitor(plane, code, window))


def curve_start(
    problem: ForcedProblem,
    y: np.ndarray,
    code: str,
    names: Sequence[str],
    keep: Sequence[str] = (),
    *,
    angle: float | None = None,
    origin: str = "",
) -> CurveStart:
    """The start of a curve at an event of a family.

    Parameters
    ----------
    problem, y : ForcedProblem, (u,) float
        The orbit at the event.
    code : str
        The event's type.
    names, keep : sequence of str
        See `branches.curves.plane.plane_of`.
    angle : float, optional
        Of the pair of multipliers (NS).
    origin : str
        Where the curve is started, in words.

    Raises
    ------
    NoCurve
        For an event that has no curve.
    ValueError
        For parameters that the problem cannot have.
    """
    if code not in CURVES:
        raise NoCurve(f"{_REASONS.get(code, 'it is no bifurcation')}; expected one of {', '.join(CURVES)}")
    if isinstance(problem, ReleasedProblem):
        try:
            plane, code, kind, unknowns = free_event(problem, y, code, names, keep)
        except ValueError as error:
            raise NoCurve(str(error)) from error
        if isinstance(kind, Grazing):
            return CurveStart(plane, code, kind, unknowns, origin)
        return CurveStart(plane, code, None, unknowns, origin, kind)
    grazing = None
    if code == "BP":
        primitive, single = primitive_orbit(problem, y)
        if primitive is problem:
            why = "two families of orbits cross there, and a second parameter parts them"
            raise NoCurve(f"{why}; expected an event of type {', '.join(one for one in CURVES if one != 'BP')}")
        problem, y, code = primitive, single, "SB" if primitive.half else "PD"
    if code == "GR":
        try:
            problem, y, grazing = grazing_at(problem, observed(problem, y))
        except ValueError as error:
            raise NoCurve(str(error)) from error
    plane, unknowns = plane_of(problem, y, names, keep)
    if code == "NS":
        if angle is None:
            raise NoCurve("the angle of its pair of multipliers is not known")
        unknowns = np.append(unknowns, math.cos(angle))
    return CurveStart(plane, code, grazing, unknowns, origin)


def curve_at(
    branch: ForcedBranch, event: ForcedEvent | str, names: Sequence[str], keep: Sequence[str] = (), origin: str = ""
) -> CurveStart:
    """The start of a curve at an event of a response.

    Parameters
    ----------
    branch : ForcedBranch
        Such as one of `saltus.trace_response`.
    event : ForcedEvent or str
        One of its events, or the id of one, such as "PD1".
    names : sequence of str
        The parameters that vary. The first two span the plane.
    keep : sequence of str
        Equations that determine the others, two less than there are names.
    origin : str
        Where the curve is started, in words.

    Raises
    ------
    NoCurve
        For an event that has no curve.
    ValueError
        For an event that the branch has not, and for parameters that the problem cannot have.
    """
    known = {own.id: own for own in branch.events}
    id = event if isinstance(event, str) else event.id
    if id not in known:
        raise ValueError(f"the branch has no event {id}; known: {', '.join(known) or 'none'}")
    at = known[id]
    return curve_start(branch.problem, branch.unknowns[at.point], at.type, names, keep, angle=at.angle, origin=origin or at.id)


def follow_curve(
    start: CurveStart,
    window: Window,
    *,
    points: int | None = None,
    direction: str = "both",
    on_event: Callable[[Event], object] | None = None,
    on_point: Callable[[int], object] | None = None,
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

    Raises
    ------
    NoCurve
        Where the start is on no curve, and where the event does not depend on the parameters.
    KeyboardInterrupt
        With the curve up to there as its attribute `branch`.
    """
    curve, first = first_point(start, window)
    settings = SETTINGS if points is None else replace(SETTINGS, maximum_points=points)
    count = 0

    def counted(new: Sequence[Point]) -> None:
        nonlocal count
        count += len(new)
        if on_point is not None:
            on_point(count)

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
    problem, y, code, _ = narrow
    others = [name for name in problem.released if name not in curve.names]
    try:
        start = curve_start(problem, y, code, [*curve.names, *others], problem.keep[:-1])
        return follow_curve(start, _ANYWHERE, points=_NEAR_END)
    except (ValueError, RuntimeError):
        return None


_BEYOND = (4.0 * SETTINGS.minimum_step, 1e-6)
"""Arclengths from an end at which the system is looked at: steps to it fail earlier than the system does."""

_ANYWHERE = (-math.inf, math.inf), (-math.inf, math.inf)


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
    values = np.array([plane.linearised(step.y[:u]).parameters for step in (first, *beside)])
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
    at = start.plane.linearised(start.y[:u])
    first = curve.condition.first(at, start.y[u:], scale)
    held = curve.condition.held(at, start.y[u:], first, scale)
    matrix = np.vstack([at.jacobian, held.gradient[:, :u]]) * scale
    singular = np.linalg.svd(matrix, compute_uv=False)
    names = " and ".join(start.plane.names)
    if singular[-1] < 1e-10 * singular[0]:
        return f"the {start.code} there does not depend on {names} alone: its equations are singular; expected other parameters"
    return f"no point of a curve {start.code} in {names} was found there: Newton's corrections do not settle"


def _record(curve: Curve, start: CurveStart, run: Run, window: Window) -> BifurcationCurve:
    plane = start.plane
    steps = [point.step for point in run.points]
    unknowns = np.array([step.y for step in steps])
    m = unknowns.shape[1]
    counts = Counter[str]()
    events = []
    for event in run.events:
        counts[event.code] += 1
        number = f"{'-' if event.code[-1].isdigit() else ''}{counts[event.code]}"
        events.append(
            CurveEvent(
                event.code + number, event.code, event.index, plane.values(event.point.y[: plane.size]), event.arclength, event.status,
                (float(event.bracket[0]), float(event.bracket[1])), event.residual, event.details.get("stop"), event.details.get("note"),
            )
        )  # fmt: skip
    ended = [_ended(plane, *one) for one in zip(run.ends, (run.points[0], run.points[-1]), (-1, 1), strict=True)]
    parameters = np.array([plane.linearised(y[: plane.size]).parameters for y in unknowns])
    return BifurcationCurve(
        plane=plane, code=start.code, grazing=start.grazing, unknowns=unknowns,
        tangents=np.array([step.tangent[:m] for step in steps]), parameters=parameters,
        arclength=run.points.arclengths(), residual=np.array([step.residual for step in steps]),
        multipliers=np.array([step.extra.multipliers for step in steps]),
        coefficient=np.array([step.extra.coefficient for step in steps]),
        events=tuple(events), ended=(ended[0], ended[1]), start=run.start, closed=run.closed, window=window, origin=start.origin,
        free=start.free,
    )  # fmt: skip


def _ended(plane: ParameterPlane, end: End, point: Point, sign: int) -> Ended:
    """Why a curve ends at a point, in the terms of the user. sign: 1 at the last point, -1 at the first."""
    values = plane.linearised(point.step.y[: plane.size]).parameters
    place = " and ".join(f"{name} = {value:.12g}" for name, value in zip(plane.names, values, strict=True))
    if end.reason is EndReason.EVENT and point.event is not None:
        return Ended(end.reason.name, f"{point.event.code} at {place}: {point.event.details.get('note')}")
    for distance in _BEYOND if end.reason is EndReason.MINIMUM_STEP else ():
        why = plane.violation(point.step.y[: plane.size] + sign * distance * point.step.tangent[: plane.size])
        if why is not None:
            return Ended(OUT_OF_DOMAIN, f"the system ends at {place}: {why}")
    if end.reason is EndReason.CLOSED:
        return Ended(end.reason.name, "closed: the curve is back at its first point")
    return Ended(end.reason.name, f"at {place}: {end.text}")


def curve_through(curve: BifurcationCurve, index: int, code: str) -> CurveStart:
    """The start of another curve that passes through a point of a curve, or emanates there.

    Parameters
    ----------
    curve : BifurcationCurve
    index : int
        Of the point, such as ``event.point``.
    code : {"SN", "PD", "SB", "NS", "GR"}
        The type of the other curve.

    Raises
    ------
    NoCurve
        Where no such curve is found.
    """
    plane, u = curve.plane, curve.plane.size
    y = curve.unknowns[index, :u]
    origin = f"a point of a curve {curve.code}"
    if isinstance(plane.problem, ReleasedProblem):
        others = [name for name in plane.problem.released if name not in plane.names]
        return curve_start(plane.problem, y, code, [*plane.names, *others], plane.problem.keep[:-1], origin=origin)
    kinds = {event.type for event in curve.events if event.point == index}
    if code == "GR" and "LB" in kinds:
        raise NoCurve("impacts exchange their order there, which is no grazing; expected a grazing of the family in the other order")
    if code == "GR":
        return _grazing_through(curve, y, origin)
    if code == "SN" and kinds & {"DP", "GPD"}:
        return _fold_emanating(curve, y, origin)
    pairs = curve.multipliers[index]
    for angle in _angles(pairs) if code == "NS" else (None,):
        own = np.zeros(0) if angle is None else np.array([math.cos(angle)])
        start = CurveStart(plane, code, None, np.concatenate([y, own]), origin)
        problem = start.curve(((-math.inf, math.inf), (-math.inf, math.inf)))
        first = problem.begin(start.y)
        if first.converged and np.abs((first.y[:u] - y) / plane.scales(y)).max() < _NEAR:
            if code == "NS" and abs(first.y[-1]) >= 1.0 - _NEAR:
                inside = [step for step in _both(problem, first) if step.converged and abs(step.y[-1]) < 1.0]
                if not inside:
                    continue
                first = inside[0]
            return start._replace(y=first.y)
    there = ", ".join(sorted(kinds)) or "no event"
    raise NoCurve(f"no curve {code} passes through the point, which has {there}; expected a point where a curve {code} meets this one")


def _fold_emanating(curve: BifurcationCurve, y: np.ndarray, origin: str) -> CurveStart:
    """The curve of folds that emanates where a doubling, or a symmetry breaking, changes its criticality: of the orbits of twice the
    period, or without symmetry. There its equations are singular, so it is started beside the point, along the critical direction."""
    problem, plane = curve.plane.problem, curve.plane
    wide, whole = (full_period if problem.half else twice)(problem, y)
    others = [name for name in problem.released if name not in plane.names]
    wider, begun = plane_of(wide, whole, [*plane.names, *others], problem.keep[:-1])
    start = CurveStart(wider, "SN", None, begun, origin)
    fold = start.curve(((-math.inf, math.inf), (-math.inf, math.inf)))
    scale, at = wider.scales(begun), wider.linearised(begun)
    borders = fold.condition.first(at, np.zeros(0), scale)
    direction = borders[-wider.size :] * scale
    way = wider.directions(begun) @ direction
    tangent = fold.directed(direction / math.sqrt(float(way @ way)), borders)
    for distance in _ASIDE:
        step = fold.step(begun, tangent, distance)
        if step.converged:
            return start._replace(y=step.y)
    raise NoCurve("no curve SN was found beside the point")


_ASIDE = (0.05, 0.02, 0.1, 0.01, 0.005)
"""Distances, in units of arclength, at which a curve is looked for beside a singular point."""

_NEAR = 1e-6


def _both(problem: Curve, first: Any) -> list[Any]:
    return [problem.step(first.y, first.tangent, ds) for ds in (1e-3, -1e-3)]


def _angles(multipliers: np.ndarray) -> list[float]:
    """Angles at which a pair can be on the unit circle: of pairs there, and of two real ones that meet."""
    upper = multipliers[(multipliers.imag >= 0.0) & (np.abs(np.abs(multipliers) - 1.0) < 1e-4)]
    return sorted({round(float(np.angle(value)), 9) for value in upper}, reverse=True)


def _grazing_through(curve: BifurcationCurve, y: np.ndarray, origin: str) -> CurveStart:
    """The curve of grazings through a point where a curve leaves the orbits."""
    plane, n = curve.plane, curve.plane.problem.degrees_of_freedom
    solution = observed(plane.problem, y)
    clear = min(abs(solution["clearance"]), abs(solution["speed"]) / plane.problem.segment.scale[n], abs(solution["flight"]))
    if not clear < _NEAR:
        raise NoCurve("no grazing is there; expected an event whose type ends with GR")
    try:
        problem, unknowns, grazing = grazing_at(plane.problem, solution)
    except ValueError as error:
        raise NoCurve(str(error)) from error
    if problem is plane.problem:
        return CurveStart(plane, "GR", grazing, unknowns, origin)
    names = [*plane.names, *(name for name in problem.released if name not in plane.names)]
    made, again = plane_of(problem, unknowns, names, problem.keep[:-1])
    return CurveStart(made, "GR", grazing, again, origin)
