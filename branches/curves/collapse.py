"""Where a curve ends at an event of another curve, on which the point is regular.

A curve SN of doubled orbits ends at a generalised period doubling, one of orbits without symmetry at a degenerate pitchfork. One of
another bifurcation ends where that meets the doubling, or the symmetry breaking, of the single orbits. A curve of their grazings ends
where the doubling, or the symmetry breaking, grazes itself. There the equations of the wider problem are singular, and steps fail nearby.
The point is located on the curve PD, or SB, of the single orbits, where it is regular. A curve of grazings of free orbits ends where the
touch has come to an end at rest, and meets its image. That point is on the curve of orbits that touch the stop at rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from branches.curves.free import FOLD, names_quarter_period
from branches.curves.grazing import Grazing
from branches.curves.record import BifurcationCurve, CurveEvent
from branches.curves.single_orbits import APART, Narrow, apart_from_single, narrowed, widened, without_grazing
from branches.events import Ended, numbered
from branches.extending import reversed_line
from branches.released.segments import segment_of
from bvp.closures import REST
from bvp.released import ReleasedProblem

__all__ = ["with_collapsed_ends"]

_ROOT = 1.5e-8
"""The root of rounding, to which the equations of the wider orbits determine the point; the bracket of its event can be wider."""

_BLURRED = 1e-4
"""Difference of an orbit and its image, or part of a segment between a touch and an end, below which events are rounding."""

_REACH = 10.0
"""Distance of an end in the parameters, relative, in squares of that difference."""

_NEAR_REST = 0.05
"""Part of the segment between a touch and an end at rest up to which the point where they meet is looked for."""

_SINGULAR = ("GR-GR", "DP", "GPD", "R2", "FF", "PN")
"""Events at which the equations can be singular, so that they are not located."""

_MEETINGS = {"SB": ("R2",), "PD": ("FF",), "NS": ("FF", "PN")}
"""The events of the single orbits at which another curve than of folds or grazings ends."""

Follow = Callable[[Narrow, BifurcationCurve], BifurcationCurve | None]
"""Gives the curve of the orbits next to those of a curve, near a place."""


class _End(NamedTuple):
    """An end of a curve at an event of another one: that curve, the event, the orbit there in the unknowns of the first curve, how many of
    its points are left out, and what happens."""

    base: BifurcationCurve
    event: CurveEvent
    y: np.ndarray
    left: int
    note: str


def _is_singular(curve: BifurcationCurve, last: bool) -> bool:
    """Whether a curve ends where steps fail, or at a `_singular_event`."""
    return curve.ended[int(last)].reason == "MINIMUM_STEP" or _singular_event(curve, last) is not None


def _singular_event(curve: BifurcationCurve, last: bool) -> CurveEvent | None:
    """The event at an end, if the equations can be singular there."""
    place = len(curve) - 1 if last else 0
    found = next((event for event in curve.events if event.point == place), None)
    return found if found is not None and found.type in _SINGULAR else None


def _ending(curve: BifurcationCurve, last: bool, at: _End) -> BifurcationCurve:
    """The curve with the point of an event of another curve as its end, in place of some points."""
    if not last:
        return reversed_line(_ending(reversed_line(curve), True, at))
    stop, u, former = len(curve) - at.left, curve.plane.size, _singular_event(curve, True)
    position, near, place = curve.plane.position, curve.unknowns[stop - 1], at.base.parameters[at.event.point]
    length = float(curve.arclength[stop - 1]) + float(np.linalg.norm(position(at.y) - position(near[:u])))
    new = {
        "unknowns": np.concatenate([at.y, near[u:]]), "tangents": curve.tangents[stop - 1], "parameters": place,
        "arclength": length, "residual": at.base.residual[at.event.point], "multipliers": np.full(curve.multipliers.shape[1], np.nan),
        "coefficient": math.nan,
    }  # fmt: skip
    columns: dict[str, Any] = {
        name: np.concatenate([column := getattr(curve, name)[:stop], np.asarray(row, column.dtype)[None]]) for name, row in new.items()
    }
    end = at.event._replace(point=stop, arclength=length, bracket=(length, length), note=at.note)
    where = " and ".join(f"{name} = {value:.12g}" for name, value in zip(curve.names, place, strict=True))
    return replace(
        curve, **columns,
        events=numbered([*(one for one in curve.events if one.point < stop and one is not former), end]),
        ended=(curve.ended[0], Ended("EVENT", f"{at.event.type} at {where}: {at.note}")),
        start=min(curve.start, stop - 1),
    )  # fmt: skip


def with_collapsed_ends(curve: BifurcationCurve, follow: Follow) -> BifurcationCurve:
    """A curve whose ends at the orbits that it emanates from are located there.

    Parameters
    ----------
    curve : BifurcationCurve
    follow : callable
        Gives the curve PD or SB of the single orbits near a place.
    """
    free = curve.free
    if curve.closed or (free is not None and free.symmetry == FOLD and names_quarter_period(curve.plane) and not free.in_energy):
        return curve
    for last in (False, True):
        end = _collapse(curve, last, follow) or _touch_at_rest(curve, last, follow)
        curve = curve if end is None else _ending(curve, last, end)
    return curve


def _collapse(curve: BifurcationCurve, last: bool, follow: Follow) -> _End | None:
    """The end at the single orbits; None where there is none."""
    place = len(curve) - 1 if last else 0
    if not _is_singular(curve, last):
        return None
    singular = _singular_event(curve, last)
    unknowns = curve.unknowns[:, : curve.plane.size]
    narrow = narrowed(*without_grazing(curve, unknowns[place]))
    if narrow is None or narrow.apart > APART:
        return None
    near = narrow.apart < _BLURRED
    if singular is not None and singular.status == "located" and not near:
        return None
    base = follow(narrow, curve)
    if base is None:
        return None
    wanted = _MEETINGS.get(curve.code) or {"PD": ("GPD", "PD-GR"), "SB": ("DP", "SB-GR")}[narrow.code]
    here = curve.parameters[place]
    found = [(float(np.abs(base.parameters[event.point] / here - 1.0).max()), event) for event in base.events if event.type in wanted]
    distance, event = min(found, key=lambda one: one[0], default=(math.inf, None))
    # The orbits part from their image as the root of the distance from a doubling. On a grazing they do in proportion to that from its end.
    reach = narrow.apart if near and curve.grazing is not None else narrow.apart**2
    rounding = _ROOT + (0.0 if singular is None else singular.bracket[1] - singular.bracket[0])
    if event is None or not distance <= _REACH * reach + rounding:
        return None
    rows = unknowns[::-1] if last else unknowns
    blurred = next((k for k, y in enumerate(rows) if not apart_from_single(*without_grazing(curve, y)) < _BLURRED), len(curve))
    left = min(max(blurred, int(any(event.point == place for event in curve.events))), len(curve) - 1)
    whole = widened(base.plane.problem, base.unknowns[event.point, : base.plane.size], curve.plane.problem, rows[left])
    words = "are symmetric" if base.code == "SB" else "are those of half the period, traversed twice"
    named = {
        "GPD": ": generalised period doubling", "DP": ": degenerate pitchfork",
        "PD-GR": ": their doubling grazes", "SB-GR": ": their symmetry breaking grazes",
    }  # fmt: skip
    note = f"the orbits {words}{named.get(event.type, f', with {event.note}')}"
    return None if whole is None else _End(base, event, whole, left, note)


def _touch_at_rest(curve: BifurcationCurve, last: bool, follow: Follow) -> _End | None:
    """The end where a touch beside an end at rest has come there, and meets its image. The time between them goes as the root of the
    distance along the curve, and its equations are singular. The point is also on the curve of orbits that touch the stop at rest: there
    the gap has no acceleration."""
    if not _is_singular(curve, last):
        return None
    rows = curve.unknowns[:: -1 if last else 1, : curve.plane.size]
    left, narrow = 0, _touching(curve, rows[0])
    while narrow is not None and narrow.apart <= _BLURRED and left + 2 < len(rows):
        left += 1
        narrow = _touching(curve, rows[left])
    if narrow is None or not _BLURRED < narrow.apart <= _NEAR_REST:
        return None
    base = follow(narrow, curve)
    if base is None:
        return None
    problem, single = curve.plane.problem, base.plane.problem
    assert isinstance(problem, ReleasedProblem) and isinstance(single, ReleasedProblem)
    here = curve.parameters[::-1][left] if last else curve.parameters[left]
    for event in base.events:
        distance = float(np.abs(base.parameters[event.point] / here - 1.0).max())
        if event.type == "GR-GR" and distance <= _REACH * narrow.apart**2:
            touching = segment_of(single, base.unknowns[event.point, : base.plane.size]).resting(problem.kinds[1] == REST)
            return _End(base, event, touching.unknowns(problem), left, "the touch has come to the end at rest, where it meets its image")
    return None


def _touching(curve: BifurcationCurve, y: np.ndarray) -> Narrow | None:
    """An orbit that touches a stop beside an end at rest, as one that touches it there; None where it has no such touch."""
    problem, grazing = curve.plane.problem, curve.grazing
    if not isinstance(problem, ReleasedProblem) or grazing is None or grazing.kind != "speed" or not problem.inner:
        return None
    far = problem.kinds[1] == REST and grazing.flight == problem.inner - 1
    if not far and not (problem.kinds[0] == REST and grazing.flight == 0):
        return None
    whole = segment_of(problem, y)
    single = whole.stopped(far)
    try:
        made = single.problem(problem, y)
    except ValueError:
        return None
    apart = float(whole.times[-1 if far else 0] / np.sum(whole.times))
    return Narrow(made, single.unknowns(made), "GR", apart, None, Grazing("speed", made.inner if far else made.inner + 1))
