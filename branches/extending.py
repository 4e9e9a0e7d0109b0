"""Branches in parameters and curves go on beyond their ends: pieces with N points in arrays become one."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any, TypeVar

import numpy as np

from branches.events import moved, numbered

__all__ = ["joined", "reversed_line"]

Line = TypeVar("Line", bound=Any)
"""A `branches.forced.branch.ForcedBranch`, or a `branches.curves.record.BifurcationCurve`."""


def _columns(line: Any) -> dict[str, np.ndarray]:
    """The arrays of a branch or curve but the arclength, each with a row for each point."""
    values = {field.name: getattr(line, field.name) for field in fields(line) if field.name != "arclength"}
    return {name: value for name, value in values.items() if isinstance(value, np.ndarray)}


def joined(line: Line, further: Line, last: bool) -> Line:
    """A branch or curve, and the piece that was followed outwards from its first or last point, as one in the range of the piece."""
    if not last:
        return reversed_line(joined(reversed_line(line), further, True))
    place, length = len(line) - 1, float(line.arclength[-1])
    # An end of the old range is no event any more.
    kept = [event for event in line.events if not (event.type == "EP" and event.point == place)]
    columns: dict[str, Any] = {name: np.concatenate([column, getattr(further, name)[1:]]) for name, column in _columns(line).items()}
    ranges = {name: getattr(further, name) for name in ("interval", "window") if hasattr(further, name)}
    return replace(
        line, **columns, **ranges, arclength=np.concatenate([line.arclength, length + further.arclength[1:]]),
        events=numbered([*kept, *(moved(event, place, length) for event in further.events if event.point)]),
        ended=(line.ended[0], further.ended[1]),
    )  # fmt: skip


def reversed_line(line: Line) -> Line:
    """The same branch or curve in the other order."""
    place, length = len(line) - 1, float(line.arclength[-1])
    columns: dict[str, Any] = {name: column[::-1] for name, column in _columns(line).items()}
    return replace(
        line, **columns | {"tangents": -columns["tangents"]}, arclength=length - line.arclength[::-1],
        events=numbered(moved(event, place, length, -1) for event in line.events[::-1]),
        ended=line.ended[::-1], start=place - line.start,
    )  # fmt: skip
