"""Other curves through a point of a curve in the plane of two parameters, and those that emanate there."""

from __future__ import annotations

import math

import numpy as np

from branches.curves.free import FOLD, FreeKind, names_quarter_period
from branches.curves.free_monitor import FreeGrazingMonitor
from branches.curves.free_normal_form import CurveNormalForm
from branches.curves.grazing import grazing_at, observed
from branches.curves.grazing_monitor import GrazingMonitor
from branches.curves.monitor import ANYWHERE
from branches.curves.record import BifurcationCurve
from branches.curves.single_orbits import Narrow, narrowed, without_grazing
from branches.curves.starting import CurveStart, NoCurve, curve_start, is_inside
from branches.forced.primitive import full_period, twice
from bvp.released import ReleasedProblem

__all__ = ["curve_through", "single_orbit"]


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
    single = single_orbit(curve, index)
    if single is not None and single.code == code:
        made, again = plane.of(single.problem, single.y)
        return CurveStart(made, code, None, again, origin, single.free)
    if code == "GR" and curve.grazing is not None:
        return _grazing_through(curve, y, origin)
    kinds = {event.type for event in curve.events if event.point == index}
    if code == "SN" and kinds & {"DP", "GPD"} and curve.code in ("SB", "PD"):
        return _fold_emanating(curve, y, origin)
    if isinstance(plane.problem, ReleasedProblem):
        others = [name for name in plane.problem.released if name not in plane.names]
        return curve_start(plane.problem, y, code, [*plane.names, *others], plane.problem.keep[:-1], origin=origin)
    if code == "GR" and "LB" in kinds:
        raise NoCurve("impacts exchange their order there, which is no grazing; expected a grazing of the family in the other order")
    if code == "GR":
        return _grazing_through(curve, y, origin)
    angles = _angles(curve.multipliers[index])
    if plane.problem.half:  # those of the map over half a period, whose square is that of the period
        angles = [turn for angle in angles for turn in (0.5 * angle, math.pi - 0.5 * angle)]
    for angle in angles if code == "NS" else (None,):
        own = np.zeros(0) if angle is None else np.array([math.cos(angle)])
        start = CurveStart(plane, code, None, np.concatenate([y, own]), origin)
        problem = start.curve(ANYWHERE)
        first = problem.begin(start.y)
        if first.converged and np.abs((first.y[:u] - y) / plane.scales(y)).max() < _NEAR:
            if code == "NS" and abs(first.y[-1]) >= 1.0 - _NEAR:
                both = [problem.step(first.y, first.tangent, ds) for ds in (1e-3, -1e-3)]
                inside = [step for step in both if step.converged and abs(step.y[-1]) < 1.0]
                if not inside:
                    continue
                first = inside[0]
            return start._replace(y=first.y)
    there = ", ".join(sorted(kinds)) or "no event"
    raise NoCurve(f"no curve {code} passes through the point, which has {there}; expected a point where a curve {code} meets this one")


def single_orbit(curve: BifurcationCurve, index: int) -> Narrow | None:
    """The single orbit, or the symmetric one, at an end of a curve of doubled orbits or of orbits without symmetry; None elsewhere."""
    if index not in (0, len(curve) - 1):
        return None
    narrow = narrowed(*without_grazing(curve, curve.unknowns[index, : curve.plane.size]))
    return narrow if narrow is not None and narrow.apart < _NEAR else None


def _fold_emanating(curve: BifurcationCurve, y: np.ndarray, origin: str) -> CurveStart:
    """The curve of folds that emanates where a doubling, or a symmetry breaking, changes its criticality: of the orbits of twice the
    period, or without symmetry. There its equations are singular, so it is started beside the point, along the critical direction."""
    problem, plane = curve.plane.problem, curve.plane
    free, wide = None, problem
    if curve.free is not None:
        wide, whole = CurveNormalForm(plane, curve.free.symmetry, curve.free.doubled).emanating(y)
        free = FreeKind(FOLD, in_energy=names_quarter_period(plane))
    else:
        wide, whole = (full_period if problem.half else twice)(problem, y)
    wider, begun = plane.of(wide, whole)
    start = CurveStart(wider, "SN", None, begun, origin, free)
    fold = start.curve(ANYWHERE)
    scale, at = wider.scales(begun), wider.linearised(begun)
    borders = fold.condition.first(at, np.zeros(0), scale)
    direction = borders[-wider.size :] * scale
    way = wider.directions(begun) @ direction
    tangent = fold.directed(direction / math.sqrt(float(way @ way)), borders)
    for distance in _ASIDE:
        step = fold.step(begun, tangent, distance)
        if is_inside(fold, step):
            return start._replace(y=step.y)
    raise NoCurve("no curve SN was found beside the point")


_ASIDE = (0.05, 0.02, 0.1, 0.01, 0.005, 0.002, 0.001, 5e-4)
"""Distances, in units of arclength, at which a curve is looked for beside a singular point."""

_NEAR = 1e-6
"""Change of the unknowns, in their sizes, with which a point is on another curve, and sizes that are zero at a grazing."""

_ON_CIRCLE = 1e-4
"""Distance from the unit circle of a double multiplier at a located point, which rounding parts by its root."""


def _angles(multipliers: np.ndarray) -> list[float]:
    """Angles at which a pair can be on the unit circle: of pairs there, and of two real ones that meet."""
    upper = multipliers[(multipliers.imag >= 0.0) & (np.abs(np.abs(multipliers) - 1.0) < _ON_CIRCLE)]
    return sorted({round(float(np.angle(value)), 9) for value in upper}, reverse=True)


def _grazing_through(curve: BifurcationCurve, y: np.ndarray, origin: str) -> CurveStart:
    """The curve of grazings through a point where a curve leaves the orbits; of those themselves, that of what else grazes there."""
    # What the orbit repeats is solved at the parameters of the point, not at those where the curve was started.
    (plane, y), n = curve.plane.of(curve.plane.problem, y), curve.plane.problem.degrees_of_freedom
    try:
        if curve.grazing is not None:
            monitor = CurveStart(plane, "GR", curve.grazing, y, origin).curve(curve.window).monitor
            assert isinstance(monitor, GrazingMonitor | FreeGrazingMonitor)
            problem, unknowns, grazing = monitor.second(y)
            single = narrowed(problem, unknowns) if isinstance(monitor, GrazingMonitor) else None
            if single is not None and single.apart < _NEAR:  # the other touch is the image of the first one
                problem, unknowns, grazing = grazing_at(single.problem, observed(single.problem, single.y))
        else:
            solution = observed(plane.problem, y)
            unit, lasting = plane.problem.units, plane.problem.duration(solution)
            clear = min(abs(solution["clearance"]) / unit[0], abs(solution["speed"]) / unit[n], abs(solution["flight"]) / lasting)
            if not clear < _NEAR:
                raise NoCurve("no grazing is there; expected an event whose type ends with GR")
            problem, unknowns, grazing = grazing_at(plane.problem, solution)
    except ValueError as error:
        raise NoCurve(str(error)) from error
    made, again = (plane, unknowns) if problem is plane.problem else plane.of(problem, unknowns)
    return CurveStart(made, "GR", grazing, again, origin)
