"""Writing files of a branch, of an orbit and of a discovery: JSON with schema 2, and CSV with the same names, flattened.

A branch is ``{"schema", "system", "branch": {id, label, aliases, ends, sequence, energy, others}, "points", "events", "ended"}``; points
and events stand in the order of arclength, every number in full precision. What has no value is null: where the multipliers or tau grow
without bound (at grazing) a ``note`` says so. ``docs/reference/files.md`` lists the fields with their meaning.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.events import ids_at_points
from branches.files import is_special, write_text
from branches.sequences import impacts_per_period
from branches.tables import csv_cell, csv_lines, dataframe, json_lines, plain, plain_columns

if TYPE_CHECKING:
    import pandas

    from branches.branch import Branch
    from branches.orbit import Orbit
    from branches.search.orbit_search import Discovery

__all__ = [
    "EVENT", "EVENT_FIELDS", "HARMONIC", "SCALARS", "SCHEMA", "discovery_to_json", "half_period_impacts", "orbit_to_csv", "orbit_to_json",
    "save", "to_csv", "to_dataframe", "to_json", "to_record",
]  # fmt: skip

SCHEMA = 2
"""Schema 1 has `word` in place of `sequence`, and a discovery has `miss` in place of `residual`."""

SCALARS = ("h", "alpha", "frequency", "frequency_index", "arclength", "tau", "tau_half", "residual")
"""Columns of `Branch.points` that hold one number a point."""

HARMONIC = "harmonic."
"""Begin of the names of columns harmonic.COORDINATE.K (`branches.harmonics`)."""

EVENT = {
    "id": "a string",
    "type": "a string",
    "h": "a number",
    "alpha": "a number",
    "arclength": "a number",
    "status": "a string",
    "bracket": ["a number or null", 2],
    "residual": "a number or null",
    "label": "a string",
    "stop": "a string or null",
    "p_q": ["an integer", 2, None],
    "breaks": "a string or null",
    "note": "a string or null",
    "point": "an integer",
    "number": "an integer",
    "stable": "a boolean or null",
    "multiplier": "a number or null",
    "coefficient?": "a number or null",
    "criticality?": "a string or null",
}
"""The fields of an event in the order of the file, each with its pattern (see `branches.reading`)."""

EVENT_FIELDS = tuple(name.removesuffix("?") for name in EVENT)

_UNBOUNDED = "not finite at this point, so null: multipliers"
_UNPOLISHED = ("ends", "sequence", "parameter", "alpha", "residual", "reason")
_NOT_COMPUTED = "not computed at this point, so null: harmonic"


def to_record(branch: Branch) -> dict[str, Any]:
    """Return a branch as plain data.

    Returns
    -------
    dict
        With lists, dicts, strings, finite numbers, booleans and None only.
    """
    columns = plain_columns({**branch.points})
    points = [_point(dict(zip(columns, values, strict=True))) for values in zip(*columns.values(), strict=True)]
    return {
        "schema": SCHEMA,
        "system": branch.system.describe(),
        "branch": {
            "id": branch.id,
            "label": branch.label,
            "aliases": plain(branch.aliases),
            "ends": list(branch.ends),
            "sequence": branch.sequence,
            **({"pieces": branch.problem.pieces} if branch.problem.pieces > 1 else {}),
            "energy": plain(branch.energy),
            "others": [{"from": _place(piece.first), "to": _place(piece.last)} for piece in branch.others],
        },
        "points": points,
        "events": [{name: plain(getattr(event, name)) for name in EVENT_FIELDS} | {"note": event.note or None} for event in branch.events],
        "ended": [{"reason": str(end.reason), "text": end.text} for end in branch.ended],
    }


def _place(orbit: tuple[float, float]) -> dict[str, float]:
    return {"h": orbit[0], "alpha": orbit[1]}


def _point(row: Mapping[str, Any]) -> dict[str, Any]:
    """A point in the order of the file, from plain values of the columns."""
    harmonic: dict[str, dict[str, Any]] = {}
    for name in row:
        if name.startswith(HARMONIC):
            coordinate, _, order = name.removeprefix(HARMONIC).rpartition(".")
            harmonic.setdefault(coordinate, {})[order] = row[name]
    missing = [_UNBOUNDED] * (None in row["multipliers"])
    missing += [_NOT_COMPUTED] * any(None in amplitudes.values() for amplitudes in harmonic.values())
    return {
        **{name: row[name] for name in ("h", "alpha", "frequency", "frequency_index", "half_waves")},
        "start": {"u": row["start_u"], "v": row["start_v"]},
        "flight_times": row["flight_times"],
        "velocities": None if None in row["velocities"] else row["velocities"],
        **{name: row[name] for name in ("multipliers", "tau", "tau_half", "stable")},
        "quality": {name: row[name] for name in ("trivial", "pairing", "reliable")},
        **{name: row[name] for name in ("label", "arclength", "residual", "impact_speeds")},
        **({"harmonic": harmonic} if harmonic else {}),
        "note": "; ".join(missing) or None,
    }


def _orbit(orbit: Orbit) -> dict[str, Any]:
    """An orbit by the names of a branch's point, and its impacts over a period."""
    u, v = orbit.sample(np.zeros(1))
    multipliers = plain(orbit.multipliers)
    return plain(
        {
            **{name: getattr(orbit, name) for name in ("label", "ends", "sequence", "h", "alpha", "period")},
            "frequency": 2.0 * math.pi / orbit.period,
            "start": {"u": u[0], "v": v[0]},
            **{name: getattr(orbit, name) for name in ("velocities", "multipliers", "tau", "tau_half", "stable", "quality", "residual")},
            "impacts": [impact._asdict() for impact in orbit.impacts],
            "note": _UNBOUNDED if None in multipliers else None,
        }
    )


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


def to_json(branch: Branch) -> str:
    """Return the JSON text of a branch."""
    return json_lines(to_record(branch))


def orbit_to_record(orbit: Orbit) -> dict[str, Any]:
    """An orbit and its system as plain data."""
    return {"schema": SCHEMA, "system": orbit.system.describe(), "orbit": _orbit(orbit)}


def orbit_to_json(orbit: Orbit) -> str:
    """Return the JSON text of an orbit, ``{"schema", "system", "orbit"}``."""
    return json_lines(orbit_to_record(orbit))


def discovery_to_json(found: Discovery, families: Sequence[str | None] | None = None) -> str:
    """Return the JSON text of a discovery.

    Parameters
    ----------
    found : branches.search.orbit_search.Discovery
    families : sequence of (str or None), optional
        Of each orbit; by default those of the catalogue.
    """
    ids: Sequence[str | None] = families or found.families or [None] * len(found.orbits)
    return json_lines(
        {
            "schema": SCHEMA,
            "energy": found.energy,
            "bounds": {"quarter_period": found.quarter_period, "impacts": found.impacts, "ends": list(found.ends)},
            "complete": found.complete,
            "counts": found.counts,
            **({"angles": list(found.angles), "added": found.added} if found.angles else {}),
            "orbits": [_discovered(orbit, family) for orbit, family in zip(found.orbits, ids, strict=True)],
            "unpolished": [
                {"angle" if name == "parameter" else name: plain(getattr(item, name)) for name in _UNPOLISHED} for item in found.unpolished
            ],
        }
    )


def _discovered(orbit: Orbit, family: str | None) -> dict[str, Any]:
    names = ("alpha", "h", "velocities", "impact_speeds", "tau", "stable", "residual")
    return {
        "label": orbit.label or None,
        "family": family,
        "ends": list(orbit.ends),
        "sequence": orbit.sequence,
        "impacts": half_period_impacts(orbit),
        **{name: plain(getattr(orbit, name)) for name in names},
    }


def to_csv(branch: Branch) -> str:
    """Return the CSV text of a branch: a line of names, a line for each point; ``event`` holds the ids of the events there."""
    return _csv_text(_rows(branch))


def to_dataframe(branch: Branch) -> pandas.DataFrame:
    """The points of a branch as a pandas table with the columns of the CSV file; ``stable`` is True, False or NA.

    Raises
    ------
    ImportError
        If pandas is not installed.
    """
    return dataframe(_rows(branch), "to_dataframe").astype({"stable": "boolean"})


def orbit_to_csv(orbit: Orbit) -> str:
    """Return the CSV text of an orbit: a line of names and a line of values."""
    return _csv_text([_row(_orbit(orbit))])


def _rows(branch: Branch) -> list[dict[str, Any]]:
    """The points as flat rows, each with the ids of the events there."""
    record = to_record(branch)
    points = record["points"]
    ids = ids_at_points(((event["point"], event["id"]) for event in record["events"]), len(points))
    return [_row(point) | {"event": names} for point, names in zip(points, ids, strict=True)]


def _row(point: Mapping[str, Any]) -> dict[str, Any]:
    """Flatten a point or an orbit; velocities that it does not have are empty cells of their own."""
    velocities = point["velocities"] or [None] * len(point["start"]["u"])
    return dict(_flat({**point, "velocities": velocities}))


def _flat(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the leaves of a record with dotted names; list entries count from 1, a complex number has .re and .im."""
    if name == "multipliers":
        value = [dict(zip(("re", "im"), pair or (None, None), strict=True)) for pair in value]
    if isinstance(value, Mapping):
        for key, entry in value.items():
            yield from _flat(entry, f"{name}.{key}" if name else key)
    elif isinstance(value, list):
        for i, entry in enumerate(value, 1):
            yield from _flat(entry, f"{name}.{i}")
    else:
        yield name, value


def _csv_text(rows: Sequence[Mapping[str, Any]]) -> str:
    """CSV text of rows with the same names."""
    return csv_lines(rows[0], ([csv_cell(value) for value in row.values()] for row in rows))
