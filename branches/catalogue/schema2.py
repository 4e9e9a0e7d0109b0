"""Catalogues of schema 2: they can be read, and are converted when they are opened for writing.

Temporary views show the old tables with the columns of today's, in their order. If the checksum of an old row fits, the view computes
the checksum that the row would have today, otherwise NULL. Only the blobs of the points are decoded here.
"""

from __future__ import annotations

import json
import os
import sqlite3
import struct
import zlib
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from branches.catalogue.database import CatalogueInUse, checksum

if TYPE_CHECKING:
    from branches.catalogue.packing import Columns
    from branches.catalogue.rows import FamilyRow
    from bvp.multipoint import MultipointProblem

__all__ = ["add_views", "convert", "read_blobs"]

_FAMILY = (
    "id, label, ends, word, impacts, h_low, h_high, alpha_low, alpha_high, points, events, start, stable_fraction, label_names, details"
)
_EVENT = (
    "id, type, point, number, h, alpha, arclength, status, bracket_low, bracket_high, residual, label, stop, p, q, breaks, note, stable, "
    "multiplier"
)
_EDGE = "source, source_event, type, kind, target, target_event, h, alpha, stop, note"
_ORBITS = "source_problem, source_states, source_crc, target_problem, target_states, target_crc"

_KEY = "CASE key WHEN 'pins' THEN 'reference_points' ELSE key END"
_NOTE = "CASE key WHEN 'told' THEN 'report' ELSE key END"
_NOTED = "value"
for _old, _new in (("pins", "reference_points"), ("unsettled", "incomplete"), ("settled", "complete")):
    _NOTED = f"replace({_NOTED}, '\"{_old}\":', '\"{_new}\":')"
_WORK = "replace(payload, '\"word\":', '\"sequence\":')"

_VIEWS = {
    "scene": f"SELECT {_KEY} AS key, value, CASE WHEN crc = checksum(key, value) THEN checksum({_KEY}, value) END "
    "FROM main.scene WHERE key != 'rows'",
    "families": f"SELECT number, {_FAMILY}, "
    f"CASE WHEN crc = checksum({_FAMILY}, first_point, columns_crc) THEN checksum(number, {_FAMILY}) END FROM main.families",
    "points": "SELECT f.number AS family, p.number - f.first_point AS position, p.h, p.alpha, arclength, tau, stable, p.label "
    "FROM main.families f JOIN main.points p ON p.number >= f.first_point AND p.number < f.first_point + f.points",
    "events": f"SELECT family, position, {_EVENT}, "
    f"CASE WHEN crc = checksum({_EVENT}, more) THEN checksum(family, position, {_EVENT}) END FROM main.events",
    "edges": f"SELECT {_EDGE}, here, there, CASE WHEN crc = checksum({_EDGE}, {_ORBITS}) THEN checksum({_EDGE}, here, there) END FROM "
    "(SELECT *, orbit(source_problem, source_states) AS here, orbit(target_problem, target_states) AS there FROM main.edges)",
    # Older files have no checksums of these rows. Unfinished work and the report of a build have old keys.
    "work": f"SELECT key, {_WORK} AS value, checksum(key, {_WORK}) FROM main.work",
    "progress": f"SELECT {_NOTE} AS key, {_NOTED} AS value, checksum({_NOTE}, {_NOTED}) FROM main.progress",
    "counts": "SELECT 'edges', '' || count(*), checksum('edges', '' || count(*)) FROM main.edges",
}


def add_views(connection: sqlite3.Connection) -> None:
    """Show the tables of an open catalogue with the columns of today's."""
    connection.create_function("checksum", -1, lambda *values: checksum(values), deterministic=True)
    connection.create_function("orbit", 2, _orbit, deterministic=True)
    connection.execute("PRAGMA query_only = OFF")  # a temporary view is not part of the file
    for name, select in _VIEWS.items():
        connection.execute(f"CREATE TEMP VIEW {name} AS {select}")
    connection.execute("PRAGMA query_only = ON")


def _orbit(problem: str | None, states: bytes) -> str | None:
    """The orbit of an edge as today's table holds it; None if there is none, or if it cannot be read."""
    if problem is None:
        return None
    try:
        first, last, sequence, count, flights = json.loads(problem)
        numbers = struct.unpack(f"<{count + flights}d", states)
    except (TypeError, ValueError, struct.error):
        return None
    return json.dumps([[first, last], sequence, numbers[:count], numbers[count:]], separators=(",", ":"))


def read_blobs(connection: sqlite3.Connection, row: FamilyRow, columns: Columns, problem: MultipointProblem) -> Columns:
    """All columns of a family's points, from the columns of the table of points and three blobs.

    Each blob holds columns of float64: a byte for each column with the order of its differences, then the compressed differences, taken as
    integers, first the lowest bytes of all columns. A blob that does not fit its checksum or the layout of the family raises ValueError.
    """
    import numpy as np

    from branches.catalogue.packing import PREDICTIONS, as_floats, as_integers, unfolded

    columns = dict(columns)
    select = "SELECT states, states_crc, others, others_crc, multipliers, multipliers_crc FROM main.blobs WHERE family = ?"
    found = connection.execute(select, (row.number,)).fetchone() or (b"", None) * 3
    layout = row.layout | {"multipliers": [["multipliers", 2 * row.layout["multipliers"]]]}
    for name, blob, crc in zip(("states", "others", "multipliers"), found[::2], found[1::2], strict=True):
        if not isinstance(blob, bytes) or zlib.crc32(blob) != crc:
            raise ValueError(f"the {name} of its points do not fit their checksum")
        parts = [(part, 1 if size is None else size) for part, size in layout[name]]
        width = sum(size for _, size in parts)
        orders = np.frombuffer(blob[:width], np.uint8)
        planes = np.frombuffer(zlib.decompress(blob[width:]), np.uint8).reshape(8, -1)
        numbers = unfolded(np.ascontiguousarray(planes.T)).reshape(width, row.points).T.copy()
        for order in range(1, int(orders.max(initial=0)) + 1):
            numbers[:, orders >= order] = np.cumsum(numbers[:, orders >= order], axis=0, dtype=np.uint64)
        at = 0
        for part, size in parts:
            own = numbers[:, at : at + size]
            at += size
            if part == "impact_speeds" or (part == "multipliers" and size == 4):
                with np.errstate(all="ignore"):
                    predicted = PREDICTIONS[part](columns, problem)
                own = own + as_integers(np.where(np.isfinite(predicted), predicted, 0.0))
            values = as_floats(np.ascontiguousarray(own))
            types: dict[str, type] = {"half_waves": int, "reliable": bool}
            columns[part] = values.view(complex) if part == "multipliers" else values.astype(types.get(part, float))
        for part, listed in layout[name]:
            if listed is None:
                columns[part] = columns[part][:, 0]
    for name in row.layout["derived"]:
        columns[name] = PREDICTIONS[name](columns, problem)
    return columns


def convert(path: Path, catalogue: type[Any], scene: Any = None) -> None:
    """Replace a catalogue of schema 2, whose lock the caller holds, by one of today's. After a failure the old one stays.

    `catalogue` is the class that reads the old file and writes the new one. The system of `scene` must be that of the file.
    `CatalogueInUse` is raised if another program reads the file.
    """
    beside = path.with_name(path.name + ".converted")
    _remove(beside)
    try:
        with catalogue(path, scene=scene) as old, catalogue(beside, "a", scene=old.scene, provenance=old.provenance) as new:
            with new.transaction():
                old.copy_to(new)
        if path.with_name(path.name + "-wal").exists():
            raise CatalogueInUse(f"{path} is being read by another program; try again when it has finished")
        os.replace(beside, path)
    finally:
        _remove(beside)


def _remove(path: Path) -> None:
    """Remove a file and what a killed writer left beside it."""
    for ending in ("", "-wal", "-shm", "-journal"):
        with suppress(OSError):
            path.with_name(path.name + ending).unlink(missing_ok=True)
