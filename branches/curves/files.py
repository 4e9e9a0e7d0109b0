"""Files of curves in two parameters: JSON with a kind of its own, which holds one or several curves of one system; and their table."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from branches.curves.free import FreeKind
from branches.curves.grazing import Grazing
from branches.curves.identity import curve_id
from branches.curves.plane import ParameterPlane
from branches.curves.record import WORDS, BifurcationCurve, CurveEvent
from branches.events import Ended
from branches.files import one_line, write_text
from branches.reading import RecordError, check_pattern, load_json
from branches.tables import Table, plain
from bvp.forced import ForcedProblem
from bvp.parameters import ParametricSystem
from bvp.released import ReleasedProblem

__all__ = [
    "CHART", "COLUMNS", "KIND", "SCHEMA", "curve_header", "curves_of", "curves_record", "curves_table", "is_curve_record", "named_places",
    "read_curves", "restored_curve", "save_curves",
]  # fmt: skip

SCHEMA = 1
KIND, CHART = "curve", "chart"
"""Kinds of files that hold curves: of `saltus curve`, and of `saltus chart`, which has more."""

_AGREEMENT = 1e-8
"""Largest residual of a stored point."""

_EVENT = {
    "id": "a string",
    "type": "a string",
    "point": "an integer",
    "values": "an object",
    "arclength": "a number",
    "status": "a string",
    "bracket": ["a number", 2],
    "residual": "a number",
    "stop": "a string or null",
    "note": "a string or null",
}
_POINT = {
    "arclength": "a number",
    "residual": "a number",
    "parameters": ["a number", 2],
    "coefficient": "a number or null",
    "unknowns": ["a number"],
    "tangent": ["a number"],
}
_CURVE = {
    "id?": "a string",
    "code": "a string",
    "names": ["a string", 2],
    "shown?": ["a string", 2],
    "ends?": ["a string", 2],
    "solved": ["a string"],
    "load_periods": "an integer",
    "half": "a boolean",
    "released": ["a string"],
    "keep": ["a string"],
    "values": "an object",
    "window": [["a number or null", 2], 2],
    "start": "an integer",
    "closed": "a boolean",
    "origin": "a string",
    "points": [_POINT],
    "events": [_EVENT],
    "ended": [{"reason": "a string", "text": "a string"}, 2],
}
_FILE = {"schema": "an integer", "kind": "a string", "system": "an object", "curves": [_CURVE]}


def curves_record(curves: Sequence[BifurcationCurve]) -> dict[str, Any]:
    """Some curves of one system as plain data, in order."""
    problem = curves[0].plane.problem
    return {
        "schema": SCHEMA,
        "kind": KIND,
        "coordinates": list(problem.system.coordinates),
        "system": plain(problem.parametric.describe()),
        "curves": [_record(curve) for curve in curves],
    }


def _record(curve: BifurcationCurve) -> dict[str, Any]:
    rows = {key: plain(getattr(curve, name)) for key, name in COLUMNS.items()}
    points = [dict(zip(rows, row, strict=True)) for row in zip(*rows.values(), strict=True)]
    return {"id": curve_id(curve), **curve_header(curve), "points": points}


COLUMNS = {
    "arclength": "arclength",
    "residual": "residual",
    "parameters": "parameters",
    "coefficient": "coefficient",
    "multipliers": "multipliers",
    "unknowns": "unknowns",
    "tangent": "tangents",
}
"""What a point has in a file, with the attribute of a curve."""


def curve_header(curve: BifurcationCurve) -> dict[str, Any]:
    """A curve without its points, as plain data."""
    problem = curve.plane.problem
    ends = {} if problem.ends is None else {"ends": list(problem.ends), "energy": getattr(problem, "energy", None)}
    grazing = {} if curve.grazing is None else {"grazing": plain(curve.grazing._asdict())}
    if curve.free is not None:
        grazing["free"] = plain(curve.free._asdict())
    return {
        "code": curve.code,
        "names": list(curve.names),
        "shown": list(curve.shown[0]),
        **ends,
        "solved": list(problem.sequence),
        "load_periods": problem.load_periods,
        "half": problem.half,
        "released": list(problem.released),
        "keep": list(problem.keep),
        "values": dict(problem.values),
        **grazing,
        "window": plain(np.array(curve.window)),
        "start": curve.start,
        "closed": curve.closed,
        "origin": curve.origin,
        "ended": [{"reason": end.reason, "text": end.text} for end in curve.ended],
        "events": [plain(event._asdict() | {"values": dict(event.values)}) for event in curve.events],
    }


def curves_table(curves: Sequence[BifurcationCurve]) -> Table:
    """The points of some curves in columns. A column of a parameter that a curve does not have is NaN there."""
    names = list(dict.fromkeys(name for curve in curves for name in curve.shown[0]))
    values = {name: [] for name in names}  # type: dict[str, list[np.ndarray]]
    for curve in curves:
        for name in names:
            known = curve.names.index(name) if name in curve.names else None
            values[name].append(np.full(len(curve), np.nan) if known is None else curve.parameters[:, known])
    numbers = np.concatenate([np.full(len(curve), k) for k, curve in enumerate(curves, 1)])
    most = max(curve.multipliers.shape[1] for curve in curves)
    table: Table = {
        "curve": numbers,
        "type": np.concatenate([np.full(len(curve), curve.code) for curve in curves]),
        "point": np.concatenate([np.arange(len(curve)) for curve in curves]),
        "arclength": np.concatenate([curve.arclength for curve in curves]),
        **{name: np.concatenate(columns) for name, columns in values.items()},
        "coefficient": np.concatenate([curve.coefficient for curve in curves]),
        "cosine": np.concatenate([curve.cosine for curve in curves]),
        "event": np.concatenate([_event_names(curve) for curve in curves]),
        "residual": np.concatenate([curve.residual for curve in curves]),
        "multipliers": np.concatenate(
            [np.pad(curve.multipliers, ((0, 0), (0, most - curve.multipliers.shape[1])), constant_values=np.nan) for curve in curves]
        ),
    }
    return table


def _event_names(curve: BifurcationCurve) -> np.ndarray:
    names = np.full(len(curve), "", dtype="<U24")
    for event in curve.events:
        names[event.point] = event.id
    return names


def is_curve_record(record: Any) -> bool:
    """Whether the data of a JSON file are curves."""
    return isinstance(record, Mapping) and record.get("kind") in (KIND, CHART)


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
    record = load_json(path, "curves")
    if not is_curve_record(record):
        raise RecordError(f"{path} holds no curve; expected a file of saltus curve --json FILE")
    return curves_of(record, str(path))


def curves_of(record: Mapping[str, Any], path: str) -> list[BifurcationCurve]:
    """The curves of the data of a file; errors as for `read_curves`."""
    try:
        check_pattern(record, _FILE, "the file")
        if record["schema"] != SCHEMA:
            raise RecordError(f"schema {record['schema']} is not known; expected {SCHEMA}")
        if not record["curves"]:
            raise RecordError("it has no curve")
        parametric = ParametricSystem.from_description(record["system"])
        return [_curve(parametric, item) for item in record["curves"]]
    except (LookupError, TypeError, ValueError) as error:
        raise RecordError(f"{path} is not a readable file of curves: {one_line(error)}") from error


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
    problem: ForcedProblem
    if item["code"] not in WORDS:
        raise RecordError(f"a curve of type {item['code']} is not known; expected one of {', '.join(WORDS)}")
    if "ends" in item:
        ends, energy = (item["ends"][0], item["ends"][1]), item.get("energy") or 0.5
        problem = ReleasedProblem(
            parametric, ends, item["solved"], item["released"], item["keep"], values=item["values"], energy=energy
        )  # fmt: skip
    else:
        options = {key: item[key] for key in ("load_periods", "half", "values")}
        problem = ForcedProblem(parametric, item["solved"], item["released"], keep=item["keep"], **options)
    plane = ParameterPlane(problem, (item["names"][0], item["names"][1]))
    count, own = len(columns["arclength"]), int(item["code"] == "NS")
    if any(columns[name].shape != (count, plane.size + own) for name in ("unknowns", "tangents")):
        raise RecordError(f"a point has not the {plane.size + own} unknowns of its sequence")
    if not 0 <= item["start"] < count or any(not 0 <= event["point"] < count for event in item["events"]):
        raise RecordError("the start or an event has no point")
    worst = max(plane.worst(plane.linearised(y[: plane.size])) for y in columns["unknowns"][[0, item["start"], -1]])
    if not worst < _AGREEMENT:
        raise RecordError(f"its points do not solve the equations of its system: residual {worst:.1e}")
    window = [(_bound(low, -1.0), _bound(high, 1.0)) for low, high in item["window"]]
    given = item.get("grazing")
    ended = [Ended(end["reason"], end["text"]) for end in item["ended"]]
    return BifurcationCurve(
        plane=plane, code=item["code"], grazing=None if given is None else Grazing(**_grazing(given)), **columns,
        events=tuple(CurveEvent(**{**event, "bracket": tuple(event["bracket"])}) for event in item["events"]),
        ended=(ended[0], ended[1]), start=item["start"], closed=item["closed"], window=(window[0], window[1]), origin=item["origin"],
        free=_free_kind(item.get("free")), axes=tuple(item.get("shown", ())),
    )  # fmt: skip


def _free_kind(given: Mapping[str, Any] | None) -> FreeKind | None:
    return None if given is None else FreeKind(**{**given, "symmetry": tuple(given["symmetry"])})


def _bound(value: float | None, sign: float) -> float:
    return sign * math.inf if value is None else value


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
    record = curves_record(curves)
    lines = [f"  {json.dumps(key)}: {json.dumps(value, allow_nan=False)}" for key, value in record.items() if key != "curves"]
    listed = ",\n    ".join(json.dumps(curve, allow_nan=False) for curve in record["curves"])
    write_text(path, "{\n" + ",\n".join([*lines, f'  "curves": [\n    {listed}\n  ]']) + "\n}\n")


def named_places(curves: Sequence[BifurcationCurve]) -> dict[str, tuple[BifurcationCurve, CurveEvent]]:
    """The events of some curves by name, with the number of the curve before it from the second one on: "CP1", "2.CP1"."""
    return {
        (f"{number}." if number > 1 else "") + event.id: (curve, event)
        for number, curve in enumerate(curves, 1)
        for event in curve.events
    }  # fmt: skip
