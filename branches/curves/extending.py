"""A followed curve goes on beyond its ends, in a wider range: the pieces become one curve."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from branches.curves.monitor import Window
from branches.curves.record import BifurcationCurve, CurveEvent
from branches.events import event_ids
from continuation.problem import EndReason

__all__ = ["can_go_on", "is_within", "joined", "numbered", "reversed_curve"]

_OPEN = {reason.name for reason in (EndReason.POINTS, EndReason.NOT_ASKED, EndReason.INTERRUPTED)}
"""Ends from which a curve can go on."""

_ROUNDING = 1e-9
"""Difference of a parameter from a bound of its range, beside the bound, that is rounding."""

_COLUMNS = ("unknowns", "tangents", "parameters", "residual", "multipliers", "coefficient")


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


def joined(curve: BifurcationCurve, further: BifurcationCurve, last: bool) -> BifurcationCurve:
    """A curve, and the piece that was followed outwards from its first or last point, as one curve."""
    if not last:
        return reversed_curve(joined(reversed_curve(curve), further, True))
    place, length = len(curve) - 1, float(curve.arclength[-1])
    # An end of the old range is no event any more.
    kept = [event for event in curve.events if not (event.type == "EP" and event.point == place)]
    columns: dict[str, Any] = {name: np.concatenate([getattr(curve, name), getattr(further, name)[1:]]) for name in _COLUMNS}
    return replace(
        curve, **columns, arclength=np.concatenate([curve.arclength, length + further.arclength[1:]]),
        events=numbered([*kept, *(_moved(event, place, length) for event in further.events if event.point)]),
        ended=(curve.ended[0], further.ended[1]), window=further.window,
    )  # fmt: skip


def numbered(events: Iterable[CurveEvent]) -> tuple[CurveEvent, ...]:
    """Events with their ids along the curve."""
    found = list(events)
    return tuple(event._replace(id=id) for event, id in zip(found, event_ids(event.type for event in found), strict=True))


def reversed_curve(curve: BifurcationCurve) -> BifurcationCurve:
    """The same curve in the other order."""
    place, length = len(curve) - 1, float(curve.arclength[-1])
    columns: dict[str, Any] = {name: getattr(curve, name)[::-1] for name in _COLUMNS}
    columns["tangents"] = -columns["tangents"]
    return replace(
        curve, **columns, arclength=length - curve.arclength[::-1],
        events=numbered(_moved(event, place, length, -1) for event in curve.events[::-1]),
        ended=(curve.ended[1], curve.ended[0]), start=place - curve.start,
    )  # fmt: skip


def _moved(event: CurveEvent, place: int, length: float, sign: int = 1) -> CurveEvent:
    """An event of a piece whose first point has this place and arclength in another curve, along it or against it (sign -1)."""
    low, high = sorted(length + sign * end for end in event.bracket)
    return event._replace(point=place + sign * event.point, arclength=length + sign * event.arclength, bracket=(low, high))
