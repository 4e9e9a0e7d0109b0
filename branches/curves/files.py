"""Files of curves in two parameters: JSON with a kind of its own, which holds one or several curves of one system; and their table."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from branches.curves.free import FreeKind
from branches.curves.grazing import Grazing
from branches.curves.held import surface_of
from branches.curves.identity import curve_id
from branches.curves.plane import ParameterPlane
from branches.curves.record import WORDS, BifurcationCurve, CurveEvent
from branches.events import ids_at_points
from branches.files import write_text
from branches.forced import record
from branches.reading import RecordError, load_json
from branches.tables import Table, json_lines, plain
from bvp.parameters import ParametricSystem

__all__ = ["CHART", "COLUMNS", "KIND", "curve_header", "curves_record", "curves_table", "read_curves", "restored_curve", "save_curves"]

KIND, CHART = "curve", "chart"
"""Kinds of files that hold curves: of `saltus curve`, and of `saltus chart`, which has more."""

_CURVE = {
    **record.PROBLEM,
    "id?": "a string",
    "code": "a string",
    "names": ["a string", 2],
    "shown?": ["a string", 2],
    "energy?": "a number",
    "window": [record.RANGE, 2],
    "start": "an integer",
    "closed": "a boolean",
    "origin": "a string",
    "points": [{**record.POINT, "parameters": ["a number", 2], "coefficient": "a number or null"}],
    "events": [record.EVENT],
    "ended": record.ENDED,
}
_FILE = {"schema": "an integer", "kind": "a string", "system": "an object", "curves": [_CURVE]}


def curves_record(curves: Sequence[BifurcationCurve]) -> dict[str, Any]:
    """Some curves of one system as plain data, in order."""
    problem = curves[0].plane.problem
    return {
        "schema": record.SCHEMA,
        "kind": KIND,
        "coordinates": list(problem.system.coordinates),
        "system": plain(problem.parametric.describe()),
        "curves": [_record(curve) for curve in curves],
    }


def _record(curve: BifurcationCurve) -> dict[str, Any]:
    rows = {key: plain(getattr(curve, name)) for key, name in COLUMNS.items()}
    points = [dict(zip(rows, row, strict=True)) for row in zip(*rows.values(), strict=True)]
    return {"id": curve_id(curve), **curve_header(curve), "points": points}


_SAME_NAME = ("arclength", "residual", "parameters", "coefficient", "multipliers", "unknowns")

COLUMNS = {name: name for name in _SAME_NAME} | {"tangent": "tangents"}
"""What a point has in a file, with the attribute of a curve."""


def curve_header(curve: BifurcationCurve) -> dict[str, Any]:
    """A curve without its points, as plain data."""
    problem = curve.plane.problem
    kind = {} if curve.grazing is None else {"grazing": plain(curve.grazing._asdict())}
    if curve.free is not None:
        kind["free"] = plain(curve.free._asdict())
    return {
        "code": curve.code,
        "names": list(curve.names),
        "shown": list(curve.shown[0]),
        **record.problem_record(problem),
        **kind,
        "window": plain(np.array(curve.window)),
        "start": curve.start,
        "closed": curve.closed,
        "origin": curve.origin,
        "ended": [end._asdict() for end in curve.ended],
        "events": [plain(event._asdict() | {"values": dict(event.values)}) for event in curve.events],
    }


def curves_table(curves: Sequence[BifurcationCurve]) -> Table:
    """The points of some curves in columns. A column of a parameter that a curve does not have is NaN there."""
    names = dict.fromkeys(name for curve in curves for name in curve.shown[0])
    most = max(curve.multipliers.shape[1] for curve in curves)
    parts: list[dict[str, np.ndarray]] = []
    for number, curve in enumerate(curves, 1):
        count, values = len(curve), dict(zip(curve.names, curve.parameters.T, strict=True))
        parts.append({
            "curve": np.full(count, number), "type": np.full(count, curve.code), "point": np.arange(count), "arclength": curve.arclength,
            **{name: values.get(name, np.full(count, np.nan)) for name in names}, "coefficient": curve.coefficient, "cosine": curve.cosine,
            "event": np.array(ids_at_points(((event.point, event.id) for event in curve.events), count), dtype=str),
            "residual": curve.residual,
            "multipliers": np.pad(curve.multipliers, ((0, 0), (0, most - curve.multipliers.shape[1])), constant_values=np.nan),
        })  # fmt: skip
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def read_curves(path: str | os.PathLike[str]) -> list[BifurcationCurve]:
    """The curves of a file.

    Parameters
    ----------
    path : path-like
        A JSON file of `saltus curve`, `saltus chart` or `save_curves`.

    Raises
    ------
    RecordError
        In one line, for a file that cannot be read or has no curves.
    """
    given = load_json(path, "curves")
    if not isinstance(given, Mapping) or given.get("kind") not in (KIND, CHART):
        raise RecordError(f"{path} holds no curve; expected a file of saltus curve --json FILE")
    return record.restored(given, _FILE, str(path), ("curves", "curves"), _curve)


def _curve(parametric: ParametricSystem, item: Mapping[str, Any]) -> BifurcationCurve:
    """The curve of a record."""
    points = item["points"]
    if not points:
        raise RecordError("a curve has no point")
    for key in ("unknowns", "tangent"):
        if len({len(point[key]) for point in points}) > 1:
            raise RecordError(f"not all points have the same number of {key}")
    names = [key for key in COLUMNS if key != "multipliers"]
    columns = {COLUMNS[key]: np.array([point[key] for point in points], dtype=float) for key in names}
    columns["multipliers"] = np.array(
        [[complex(*pair) if pair else complex(math.nan, math.nan) for pair in point["multipliers"]] for point in points]
    )
    return restored_curve(parametric, item, columns)


def restored_curve(parametric: ParametricSystem, item: Mapping[str, Any], columns: Mapping[str, np.ndarray]) -> BifurcationCurve:
    """A curve from its header and its columns, by their attributes.

    Raises
    ------
    RecordError
        If they do not fit each other.
    """
    if item["code"] not in WORDS:
        raise RecordError(f"a curve of type {item['code']} is not known; expected one of {', '.join(WORDS)}")
    problem = record.problem_from(parametric, item)
    plane = ParameterPlane(problem, (item["names"][0], item["names"][1]))
    count, own = len(columns["arclength"]), int(item["code"] == "NS")
    if any(columns[name].shape != (count, plane.size + own) for name in ("unknowns", "tangents")):
        raise RecordError(f"a point has not the {plane.size + own} unknowns of its sequence")
    given = item.get("grazing")
    grazing = None if given is None else Grazing(**_grazing(given))
    surface = surface_of(plane, grazing, columns["unknowns"][0])
    record.require_fitting(item, count, lambda i: surface.worst(surface.linearised(columns["unknowns"][i, : plane.size])))
    window = record.range_from(item["window"][0]), record.range_from(item["window"][1])
    return BifurcationCurve(
        plane=plane, code=item["code"], grazing=grazing, **columns,
        events=tuple(CurveEvent(**{**event, "bracket": tuple(event["bracket"])}) for event in item["events"]),
        ended=record.ended_from(item["ended"]), start=item["start"], closed=item["closed"], window=window, origin=item["origin"],
        free=_free_kind(item.get("free")), axes=tuple(item.get("shown", ())),
    )  # fmt: skip


def _free_kind(given: Mapping[str, Any] | None) -> FreeKind | None:
    return None if given is None else FreeKind(**{**given, "symmetry": tuple(given["symmetry"])})


def _grazing(given: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of a `Grazing`, whose repeats are a tuple."""
    repeats = given.get("repeats")
    return {**given, "repeats": None if repeats is None else tuple(repeats)}


def save_curves(curves: Sequence[BifurcationCurve], path: str | os.PathLike[str]) -> None:
    """Write some curves of one system as JSON; `read_curves` reads them. An older file is replaced only by a complete one.

    Parameters
    ----------
    curves : sequence of BifurcationCurve
    path : path-like

    Raises
    ------
    ValueError
        For no curve.
    """
    if not curves:
        raise ValueError("there is no curve to save; expected one at least")
    write_text(path, json_lines(curves_record(curves), ("curves",)))
