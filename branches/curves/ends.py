"""An end of a curve that is located at an event of another curve, on which the point is regular."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from branches.curves.extending import numbered, reversed_curve
from branches.curves.record import BifurcationCurve, CurveEvent
from branches.curves.single_orbits import Narrow
from branches.events import Ended

__all__ = ["BLURRED", "REACH", "End", "Follow", "ending", "is_singular", "singular_event"]

BLURRED = 1e-4
"""Difference of an orbit and its image, or part of a segment between a touch and an end, below which events are rounding."""

REACH = 10.0
"""Distance of an end in the parameters, relative, in squares of that difference."""

_SINGULAR = ("GR-GR", "DP", "GPD", "R2", "FF", "PN")
"""Events at which the equations can be singular, so that they are not located."""

Follow = Callable[[Narrow, BifurcationCurve], BifurcationCurve | None]
"""Gives the curve of the orbits next to those of a curve, near a place."""


class End(NamedTuple):
    """An end of a curve at an event of another one: that curve, the event, the orbit there in the unknowns of the first curve, how many of
    its points are left out, and what happens."""

    base: BifurcationCurve
    event: CurveEvent
    y: np.ndarray
    left: int
    note: str


def is_singular(curve: BifurcationCurve, last: bool) -> bool:
    """Whether a curve ends where steps fail, or at a `singular_event`."""
    return curve.ended[int(last)].reason == "MINIMUM_STEP" or singular_event(curve, last) is not None


def singular_event(curve: BifurcationCurve, last: bool) -> CurveEvent | None:
    """The event at an end, if the equations can be singular there."""
    place = len(curve) - 1 if last else 0
    found = next((event for event in curve.events if event.point == place), None)
    return found if found is not None and found.type in _SINGULAR else None


def ending(curve: BifurcationCurve, last: bool, at: End) -> BifurcationCurve:
    """The curve with the point of an event of another curve as its end, in place of some points."""
    if not last:
        return reversed_curve(ending(reversed_curve(curve), True, at))
    stop, u, former = len(curve) - at.left, curve.plane.size, singular_event(curve, True)
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
