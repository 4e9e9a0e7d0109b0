"""Files of a branch and of an orbit: JSON with schema 1, and CSV with the same names, flattened.

A branch is ``{"schema", "system", "branch": {id, label, aliases, ends, word, energy, others}, "points", "events", "ended"}``; points
and events stand in the order of arclength, every number in full precision. What has no value is null: where the multipliers or tau grow
without bound (at grazing) a ``note`` says so. ``docs/howto.md`` lists the fields with their meaning.
"""

from __future__ import annotations

import csv
import io
import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.check import RecordError, check_branch
from branches.files import one_line, read_input, reason
from bvp.shown import shown

if TYPE_CHECKING:
    from branches.branch import Branch
    from branches.orbit import Orbit

__all__ = [
    "SCHEMA",
    "RecordError",
    "orbit_to_csv",
    "orbit_to_json",
    "orbit_to_record",
    "points_of",
    "read_branch",
    "to_csv",
    "to_json",
    "to_record",
]

SCHEMA = 1

SCALARS = ("h", "alpha", "frequency", "frequency_index", "arclength", "tau", "tau_half", "residual")
"""Columns of `Branch.points` that hold one number a point."""

_UNBOUNDED = "not finite at this point, so null: {}"


def to_record(branch: Branch) -> dict[str, Any]:
    """Return a branch as plain data.

    Parameters
    ----------
    branch : branches.branch.Branch

    Returns
    -------
    dict
        With lists, dicts, strings, finite numbers, booleans and None only.
    """
    return {
        "schema": SCHEMA,
        "system": branch.system.describe(),
        "branch": {
            "id": branch.id,
            "label": branch.label,
            "aliases": [{"label": alias["label"], "from": _finite(alias["from"]), "to": _finite(alias["to"])} for alias in branch.aliases],
            "ends": list(branch.ends),
            "word": branch.word,
            "energy": [_finite(bound) for bound in branch.energy],
            "others": [{"from": _place(piece.first), "to": _place(piece.last)} for piece in branch.others],
        },
        "points": [_point(branch.points, i) for i in range(len(branch.points["h"]))],
        "events": [_event(event) for event in branch.events],
        "ended": [{"reason": str(end.reason), "text": end.text} for end in branch.ended],
    }


def _place(orbit: tuple[float, float]) -> dict[str, float | None]:
    return {"h": _finite(orbit[0]), "alpha": _finite(orbit[1])}


def _point(points: Mapping[str, Any], i: int) -> dict[str, Any]:
    scalars = {name: _finite(points[name][i]) for name in SCALARS}
    velocities = points["velocities"][i]
    return {
        "h": scalars["h"],
        "alpha": scalars["alpha"],
        "frequency": scalars["frequency"],
        "frequency_index": scalars["frequency_index"],
        "half_waves": int(points["half_waves"][i]),
        "start": {"u": _numbers(points["start_u"][i]), "v": _numbers(points["start_v"][i])},
        "flight_times": _numbers(points["flight_times"][i]),
        "velocities": _numbers(velocities) if np.all(np.isfinite(velocities)) else None,
        "multipliers": _complexes(points["multipliers"][i]),
        "tau": scalars["tau"],
        "tau_half": scalars["tau_half"],
        "stable": _decided(points["stable"][i]),
        "quality": {
            "trivial": _finite(points["trivial"][i]),
            "pairing": _finite(points["pairing"][i]),
            "reliable": bool(points["reliable"][i]),
        },
        "label": str(points["label"][i]),
        "arclength": scalars["arclength"],
        "residual": scalars["residual"],
        "impact_speeds": _numbers(points["impact_speeds"][i]),
        "note": _note(points["multipliers"][i]),
    }


def _note(multipliers: Any) -> str | None:
    """Say that the multipliers, and with them tau, are null because they have no finite value."""
    return None if np.all(np.isfinite(multipliers)) else _UNBOUNDED.format("multipliers")


def _event(event: Any) -> dict[str, Any]:
    return {
        "id": event.id,
        "type": event.type,
        "h": _finite(event.h),
        "alpha": _finite(event.alpha),
        "arclength": _finite(event.arclength),
        "status": str(event.status),
        "bracket": _numbers(event.bracket),
        "residual": _finite(event.residual),
        "label": str(event.label),
        "stop": event.stop,
        "p_q": None if event.p_q is None else [int(part) for part in event.p_q],
        "breaks": event.breaks,
        "note": event.note or None,
        "point": int(event.point),
        "number": int(event.number),
        "stable": None if event.stable is None else bool(event.stable),
        "multiplier": _finite(event.multiplier),
    }


def orbit_to_record(orbit: Orbit) -> dict[str, Any]:
    """Return an orbit as plain data: the names of a branch's point, and its impacts over a period.

    Parameters
    ----------
    orbit : branches.orbit.Orbit

    Returns
    -------
    dict
        ``{"schema", "system", "orbit"}``.
    """
    u, v = orbit.sample(np.zeros(1))
    frequency = 2.0 * math.pi / orbit.period
    velocities = orbit.velocities
    return {
        "schema": SCHEMA,
        "system": orbit.system.describe(),
        "orbit": {
            "label": str(orbit.label),
            "ends": list(orbit.ends),
            "word": orbit.word,
            "h": _finite(orbit.h),
            "alpha": _finite(orbit.alpha),
            "period": _finite(orbit.period),
            "frequency": _finite(frequency),
            "start": {"u": _numbers(u[0]), "v": _numbers(v[0])},
            "velocities": None if velocities is None or not np.all(np.isfinite(velocities)) else _numbers(velocities),
            "multipliers": _complexes(orbit.multipliers),
            "tau": _finite(orbit.tau),
            "tau_half": _finite(orbit.tau_half),
            "stable": _decided(orbit.stable),
            "quality": {
                "trivial": _finite(orbit.quality["trivial"]),
                "pairing": _finite(orbit.quality["pairing"]),
                "reliable": bool(orbit.quality["reliable"]),
                **{name: value for name, value in orbit.quality.items() if name not in ("trivial", "pairing", "reliable")},
            },
            "residual": _finite(orbit.residual),
            "impacts": [{"time": _finite(x.time), "stop": x.stop, "speed": _finite(x.speed)} for x in orbit.impacts],
            "note": _note(orbit.multipliers),
        },
    }


def to_json(branch: Branch) -> str:
    """Return the JSON text of a branch."""
    return _json(to_record(branch))


def orbit_to_json(orbit: Orbit) -> str:
    """Return the JSON text of an orbit."""
    return _json(orbit_to_record(orbit))


def to_csv(branch: Branch) -> str:
    """Return the CSV text of a branch: a line of names, a line for each point; ``event`` holds the ids of the events there."""
    record = to_record(branch)
    at: dict[int, list[str]] = {}
    for event in record["events"]:
        at.setdefault(event["point"], []).append(event["id"])
    return _csv([{**_row(point), "event": " ".join(at.get(i, []))} for i, point in enumerate(record["points"])])


def orbit_to_csv(orbit: Orbit) -> str:
    """Return the CSV text of an orbit: a line of names and a line of values."""
    return _csv([_row(orbit_to_record(orbit)["orbit"])])


def read_branch(path: str | os.PathLike[str]) -> Branch:
    """Read a branch from a JSON file.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    branches.branch.Branch

    Raises
    ------
    RecordError
        A `ValueError` with one line: the file cannot be read, is no JSON, is truncated, has another schema, lacks a key, or
        holds something of another type.
    """
    if not isinstance(path, str | os.PathLike):
        raise TypeError(f"a path is text; received {shown(path)}, expected the name of a JSON file")
    try:
        text = read_input(path).decode("utf-8")
    except OSError as error:
        raise RecordError(f"cannot read {path}: {reason(error)}") from error
    except ValueError as error:
        raise RecordError(f"{path} is no file of a branch: it is not UTF-8 text") from error
    try:
        record = json.loads(text, parse_constant=_refuse_constant)
    except json.JSONDecodeError as error:
        # An error behind the last character says that something was still to come.
        if error.pos >= len(text.rstrip()) or error.msg.startswith("Unterminated"):
            end = text.count("\n") + 1
            raise RecordError(f"{path} is truncated: it ends in line {end} before its JSON is complete") from error
        raise RecordError(f"{path} is no JSON: {error.msg} in line {error.lineno}, column {error.colno}") from error
    except (RecursionError, ValueError) as error:  # a number of thousands of digits is a ValueError
        raise RecordError(f"{path} is no file of a branch: {one_line(error)}") from error
    try:
        check_branch(record, SCHEMA)
        from branches.branch import Branch

        return Branch.from_record(record)
    except ValueError as error:
        raise RecordError(f"{path} is no file of a branch that can be read: {one_line(error)}") from error


def points_of(record: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Return the points of a record as arrays: what `to_record` was made from, with NaN where it holds null.

    Parameters
    ----------
    record : mapping
        As `to_record` returns it.

    Returns
    -------
    dict of str to ndarray
        All of length N, the number of points; the names are those of `Branch.points`.
    """
    points = record["points"]
    n = len(points[0]["start"]["u"])
    columns: dict[str, np.ndarray] = {name: _column([point[name] for point in points]) for name in SCALARS}
    columns["half_waves"] = np.array([point["half_waves"] for point in points], dtype=int)
    columns["stable"] = np.array([-1 if point["stable"] is None else int(point["stable"]) for point in points], dtype=np.int8)
    columns["label"] = np.array([point["label"] for point in points])
    columns["velocities"] = _rows([point["velocities"] or [None] * n for point in points])
    columns["start_u"] = _rows([point["start"]["u"] for point in points])
    columns["start_v"] = _rows([point["start"]["v"] for point in points])
    columns["flight_times"] = _rows([point["flight_times"] for point in points])
    columns["impact_speeds"] = _rows([point["impact_speeds"] for point in points])
    parts = np.array([[pair or (None, None) for pair in point["multipliers"]] for point in points], dtype=float)
    parts = parts.reshape(len(points), -1, 2)
    multipliers = np.empty(parts.shape[:2], dtype=complex)
    multipliers.real, multipliers.imag = parts[..., 0], parts[..., 1]
    columns["multipliers"] = multipliers
    for name in ("trivial", "pairing"):
        columns[name] = _column([point["quality"][name] for point in points])
    columns["reliable"] = np.array([point["quality"]["reliable"] for point in points], dtype=bool)
    return columns


def _column(values: Sequence[float | None]) -> np.ndarray:
    return np.array(values, dtype=float)


def _rows(values: Sequence[Sequence[float | None]]) -> np.ndarray:
    return np.array(values, dtype=float).reshape(len(values), -1)


def _finite(value: Any) -> float | None:
    """Return a number as a float, null where it is none or not finite."""
    if value is None:
        return None
    number = float(value)
    return number if math.isfinite(number) else None


def _numbers(values: Any) -> list[float | None]:
    return [_finite(value) for value in values]


def _complexes(values: Any) -> list[list[float] | None]:
    """Return complex numbers as [re, im], null where a part is not finite."""
    numbers = np.asarray(values, dtype=complex)
    return [[float(value.real), float(value.imag)] if np.isfinite(value) else None for value in numbers]


def _decided(stable: Any) -> bool | None:
    return None if stable is None or stable == -1 else bool(stable)


def _json(record: Mapping[str, Any]) -> str:
    """Return JSON with one line a point and event, so that files can be compared by line."""
    lines = []
    for key, value in record.items():
        if isinstance(value, list):
            entries = ",\n    ".join(json.dumps(entry, allow_nan=False) for entry in value)
            lines.append(f"  {json.dumps(key)}: [\n    {entries}\n  ]" if value else f"  {json.dumps(key)}: []")
        else:
            lines.append(f"  {json.dumps(key)}: {json.dumps(value, allow_nan=False)}")
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _row(point: Mapping[str, Any]) -> dict[str, Any]:
    """Flatten a point or an orbit; velocities that it does not have are empty cells of their own."""
    velocities = point["velocities"] or [None] * len(point["start"]["u"])
    return dict(_flat({**point, "velocities": velocities}))


def _flat(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the leaves of a record with dotted names; list entries count from 1, a complex number has .re and .im."""
    if isinstance(value, Mapping):
        for key, entry in value.items():
            yield from _flat(entry, f"{name}.{key}" if name else key)
    elif name == "multipliers":
        for i, pair in enumerate(value, 1):
            real, imaginary = pair or (None, None)
            yield f"{name}.{i}.re", real
            yield f"{name}.{i}.im", imaginary
    elif isinstance(value, list):
        for i, entry in enumerate(value, 1):
            yield from _flat(entry, f"{name}.{i}")
    else:
        yield name, value


def _csv(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return CSV text of rows with the same names."""
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(rows[0]), lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({name: _cell(value) for name, value in row.items()})
    return text.getvalue()


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value) if isinstance(value, float) else str(value)


def _refuse_constant(name: str) -> float:
    raise RecordError(f"it holds {name}, which no file of a branch holds")
