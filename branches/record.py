"""Writing files of a branch, of an orbit and of a discovery: JSON with schema 2, and CSV with the same names, flattened.

A branch is ``{"schema", "system", "branch": {id, label, aliases, ends, sequence, energy, others}, "points", "events", "ended"}``; points
and events stand in the order of arclength, every number in full precision. What has no value is null: where the multipliers or tau grow
without bound (at grazing) a ``note`` says so. ``docs/reference/files.md`` lists the fields with their meaning.
"""

from __future__ import annotations

import csv
import io
import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from itertools import repeat
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.export.tables import csv_cell
from branches.files import is_special, write_text
from branches.sequences import impacts_per_period

if TYPE_CHECKING:
    import pandas

    from branches.branch import Branch
    from branches.orbit import Orbit
    from branches.search.discovery import Discovery

__all__ = [
    "SCHEMA",
    "discovery_to_json",
    "discovery_to_record",
    "half_period_impacts",
    "orbit_to_csv",
    "orbit_to_json",
    "orbit_to_record",
    "save",
    "to_csv",
    "to_dataframe",
    "to_json",
    "to_record",
]

SCHEMA = 2
"""Schema 1 has `word` in place of `sequence`, and a discovery has `miss` in place of `residual`."""

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
            "sequence": branch.sequence,
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
            "sequence": orbit.sequence,
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


def save(branch: Branch, path: str | os.PathLike[str]) -> None:
    """Write a branch. The suffix of the name gives the format, .json or .csv. An older file is replaced only by a complete one.

    Parameters
    ----------
    branch : Branch
    path : path-like
        A name that ends in .json or .csv.

    Raises
    ------
    ValueError
        For another suffix.
    """
    writers = {".json": to_json, ".csv": to_csv}
    suffix = ".json" if is_special(path) else os.path.splitext(path)[1].lower()
    if suffix not in writers:
        raise ValueError(f"cannot save a branch as {os.fspath(path)!r}: expected a name that ends in .json or .csv")
    write_text(path, writers[suffix](branch))


def half_period_impacts(orbit: Orbit) -> int | float:
    """Impacts in half a period; half of an odd number between a rest and a stop."""
    count = impacts_per_period(orbit.problem.sequence, orbit.ends)
    return count // 2 if count % 2 == 0 else count / 2


def discovery_to_record(found: Discovery, families: Sequence[str | None] | None = None) -> dict[str, Any]:
    """A discovery as plain data: lists, dicts, strings, finite numbers, booleans and None only.

    Parameters
    ----------
    found : branches.search.discovery.Discovery
    families : sequence of (str or None), optional
        Of each orbit; by default those of the catalogue.

    Returns
    -------
    dict
        ``{"schema", "energy", "bounds", "complete", "counts", "orbits", "unpolished"}``.
    """
    return {
        "schema": SCHEMA,
        "energy": found.energy,
        "bounds": {"quarter_period": found.quarter_period, "impacts": found.impacts, "ends": list(found.ends)},
        "complete": found.complete,
        "counts": found.counts,
        "orbits": [_discovered(*item) for item in zip(found.orbits, families or found.families or repeat(None), strict=False)],
        "unpolished": [
            {
                "ends": list(item.ends),
                "sequence": item.sequence,
                "angle": item.parameter,
                "alpha": _finite(item.alpha),
                "residual": _finite(item.residual),
                "reason": item.reason,
            }
            for item in found.unpolished
        ],
    }


def _discovered(orbit: Orbit, family: str | None) -> Mapping[str, Any]:
    velocities = orbit.velocities
    return {
        "label": orbit.label or None,
        "family": family,
        "ends": list(orbit.ends),
        "sequence": orbit.sequence,
        "impacts": half_period_impacts(orbit),
        "alpha": orbit.alpha,
        "h": orbit.h,
        "velocities": None if velocities is None else [float(v) for v in velocities],
        "impact_speeds": [_finite(speed) for speed in orbit.impact_speeds],
        "tau": _finite(orbit.tau),
        "stable": orbit.stable,
        "residual": orbit.residual,
    }


def to_json(branch: Branch) -> str:
    """Return the JSON text of a branch."""
    return _json(to_record(branch))


def orbit_to_json(orbit: Orbit) -> str:
    """Return the JSON text of an orbit."""
    return _json(orbit_to_record(orbit))


def discovery_to_json(found: Discovery, families: Sequence[str | None] | None = None) -> str:
    """Return the JSON text of a discovery; see `discovery_to_record`."""
    return _json(discovery_to_record(found, families))


def to_csv(branch: Branch) -> str:
    """Return the CSV text of a branch: a line of names, a line for each point; ``event`` holds the ids of the events there."""
    return _csv(_rows(branch))


def to_dataframe(branch: Branch) -> pandas.DataFrame:
    """The points of a branch as a pandas table with the columns of the CSV file; ``stable`` is True, False or NA.

    Raises
    ------
    ImportError
        If pandas is not installed.
    """
    try:
        import pandas
    except ImportError:
        raise ImportError("to_dataframe needs pandas, which is not installed; expected pip install pandas") from None
    return pandas.DataFrame(_rows(branch)).astype({"stable": "boolean"})


def _rows(branch: Branch) -> list[dict[str, Any]]:
    """The points as flat rows, each with the ids of the events there."""
    record = to_record(branch)
    at: dict[int, list[str]] = {}
    for event in record["events"]:
        at.setdefault(event["point"], []).append(event["id"])
    return [{**_row(point), "event": " ".join(at.get(i, []))} for i, point in enumerate(record["points"])]


def orbit_to_csv(orbit: Orbit) -> str:
    """Return the CSV text of an orbit: a line of names and a line of values."""
    return _csv([_row(orbit_to_record(orbit)["orbit"])])


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
        writer.writerow({name: csv_cell(value) for name, value in row.items()})
    return text.getvalue()
