"""Where a curve in the plane of two parameters starts: at an event of a family."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from branches.curves.free import FreeKind
from branches.curves.free_start import free_curve, free_event
from branches.curves.grazing import Grazing, grazing_at, grazing_condition, observed
from branches.curves.grazing_monitor import GrazingMonitor
from branches.curves.held import surface_of
from branches.curves.monitor import BifurcationMonitor, Window
from branches.curves.pencils import forced_condition
from branches.curves.plane import ParameterPlane, plane_of
from branches.forced.branch import ForcedBranch, ForcedEvent
from branches.forced.primitive import primitive_orbit
from bvp.forced import ForcedProblem
from bvp.released import ReleasedProblem
from continuation.curves import Curve
from continuation.problem import Step

__all__ = ["CURVES", "CurveStart", "NoCurve", "curve_at", "curve_problem", "curve_start", "is_inside"]

CURVES = ("SN", "PD", "SB", "NS", "BP", "GR")
"""Events that can be continued in two parameters."""

_REASONS = {
    "EP": "the end of a run is no bifurcation",
    "LB": "the label changes there without a bifurcation",
    "IO": "an impulsive orbit is no bifurcation: its family passes it without a change",
    "UZ": "a marked value is no bifurcation",
    "RT": "a p:q resonance changes no stability: a curve of it is a level of the multipliers",
}


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
        plane = surface_of(plane, grazing, y)
        return Curve(plane, grazing_condition(plane, grazing), GrazingMonitor(plane, grazing, window))
    return Curve(plane, forced_condition(plane, code), BifurcationMonitor(plane, code, window))


def is_inside(curve: Curve, step: Step) -> bool:
    """Whether a step has arrived at a point of a curve, inside all its bounds."""
    return step.converged and all(value > 0.0 for test, value in zip(curve.tests, step.tests, strict=True) if test.kind == "guard")


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
    """The start of a curve at an event of a family, with the orbit (u,) there, a type and, at NS, the angle of its pair of multipliers. The
    rest, and the errors, are those of `curve_at`."""
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
