"""The loads of a scene: ``[ground]``, the motion of the ground, and ``[[forces]]`` on coordinates, each a harmonic, a record or a constant.

The course of a load in time is ``record`` (a CSV file with a column ``time``, linear between its rows, nothing before the first and
after the last), or ``amplitude`` with ``frequency`` (radians a unit of time) and ``phase``, amplitude cos(frequency t + phase), or
``constant``. Each force acts ``on`` a coordinate, or on all of them by ``load``, a force on each for the value 1. The ground's course is
its acceleration a(t): in displacements relative to the ground it is the load -M r a(t), r being ``direction``, all 1 by default.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import TYPE_CHECKING

from branches.files import read_input, reason
from saltus.errors import BadInput, nearest, one_line
from saltus.scene.toml import FINITE, POSITIVE, TEXT, TomlTable

if TYPE_CHECKING:
    from bvp.forcing import Force
    from bvp.system import ImpactSystem

__all__ = ["read_loads", "read_record"]

_COURSE = ("record", "column", "scale", "amplitude", "frequency", "phase", "constant")


def read_loads(scene: TomlTable, system: ImpactSystem, folder: Path | Traversable) -> tuple[Force, ...]:
    """The loads of a scene's ``[ground]`` and ``[[forces]]``. Relative names of records start at `folder`. Messages name the place in the
    scene or in the record."""
    loads: list[Force] = []
    if "ground" in scene.content:
        from bvp.forcing import ground_load

        ground = scene.table("ground")
        ground.only("direction", *_COURSE)
        direction = ground.numbers("direction", system.degrees_of_freedom) if "direction" in ground.content else None
        loads.append(_course(ground, ground_load(system, direction).tolist(), "acceleration", folder))
    for force in scene.tables("forces"):
        force.only("on", "load", *_COURSE)
        loads.append(_course(force, _load(force, system), "force", folder))
    return tuple(loads)


def _load(force: TomlTable, system: ImpactSystem) -> list[float]:
    """A force on each coordinate, for the value 1 of its course."""
    if ("on" in force.content) == ("load" in force.content):
        raise BadInput(f"{force.where}: a force acts on = \"{system.coordinates[0]}\", a coordinate, or has load, a force on each of them")
    if "load" in force.content:
        return list(force.numbers("load", system.degrees_of_freedom))
    name = force.get("on", TEXT)
    if name not in system.coordinates:
        raise force.wrong("on", name, f"one of the coordinates {', '.join(system.coordinates)}{nearest(name, system.coordinates)}")
    return [float(name == other) for other in system.coordinates]


def _course(table: TomlTable, load: Sequence[float], column: str, folder: Path | Traversable) -> Force:
    """The load whose course in time a table gives."""
    from bvp.forcing import Constant, Harmonic, Record

    kinds = [key for key in ("record", "amplitude", "constant") if key in table.content]
    if len(kinds) != 1:
        received = ", ".join(kinds) or "none"
        raise BadInput(f"{table.where}: the course of a load is record, amplitude (with frequency) or constant; received {received}")
    own = {"record": ("column", "scale"), "amplitude": ("frequency", "phase"), "constant": ()}[kinds[0]]
    for key in table.content:
        if key in _COURSE and key not in (kinds[0], *own):
            raise BadInput(f"{table.where}: {key} does not go with {kinds[0]}{'; expected ' + ', '.join(own) if own else ''}")
    if kinds[0] == "record":
        scale = table.get("scale", FINITE, 1.0)
        times, values = read_record(folder.joinpath(table.get("record", TEXT)), table.get("column", TEXT, column), table.where)
        return Record([scale * entry for entry in load], times, values)  # type: ignore[arg-type]
    value = table.get(kinds[0], FINITE)
    if kinds[0] == "constant":
        return Constant([value * entry for entry in load])  # type: ignore[arg-type]
    frequency = table.get("frequency", POSITIVE._replace(expected="a number above 0, in radians a unit of time"))
    phase = table.get("phase", FINITE, 0.0)
    cosine = [value * math.cos(phase) * entry for entry in load]
    return Harmonic(frequency, cosine, [-value * math.sin(phase) * entry for entry in load])  # type: ignore[arg-type]


def read_record(path: Path | Traversable, column: str, where: str) -> tuple[list[float], list[float]]:
    """Times and values of a CSV file: a line of names, then rows of numbers. Empty lines and lines that begin with # are skipped. `column`
    is the column of the values, beside ``time``; `where` names the table of the scene in messages."""
    try:
        lines = (read_input(path) if isinstance(path, Path) else path.read_bytes()).decode("utf-8").splitlines()
    except UnicodeDecodeError as error:
        raise BadInput(f"{where}: record {path} is no CSV: byte {error.start} is not UTF-8 text") from error
    except OSError as error:
        folder = Path(str(path)).parent
        beside = [entry.name for entry in folder.glob("*.csv")] if folder.is_dir() else []
        raise BadInput(f"{where}: cannot read record {path}: {reason(error)}{nearest(Path(str(path)).name, beside)}") from error
    rows = [(number, line) for number, line in enumerate(lines, 1) if line.strip() and not line.startswith("#")]
    try:
        cells = [[cell.strip() for cell in row] for row in csv.reader([line for _, line in rows], strict=True)]
    except csv.Error as error:
        raise BadInput(f"{where}: record {path} is no CSV: {one_line(error)}") from error
    names = cells[0] if cells else []
    for wanted in ("time", column):
        if wanted not in names:
            hint = nearest(wanted, names) or f"; its columns: {', '.join(names) or 'none'}"
            raise BadInput(f"{where}: record {path} has no column {wanted!r}{hint}")
    at = names.index("time"), names.index(column)
    columns: tuple[list[float], list[float]] = [], []
    for (number, _), row in zip(rows[1:], cells[1:], strict=True):
        for k, values in zip(at, columns, strict=True):
            values.append(_cell(row[k] if k < len(row) else "", f"{where}: record {path}, line {number}: {names[k]}"))
    times = columns[0]
    if len(times) < 2:
        raise BadInput(f"{where}: record {path} has {len(times)} rows, expected 2 at least")
    for k in range(len(times) - 1):
        if not times[k] < times[k + 1]:
            line = rows[k + 2][0]
            raise BadInput(f"{where}: record {path}, line {line}: time {times[k + 1]:g} after {times[k]:g}, expected times that ascend")
    return columns


def _cell(text: str, where: str) -> float:
    """A finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise BadInput(f"{where} is {text!r}, expected a finite number")
    return value
