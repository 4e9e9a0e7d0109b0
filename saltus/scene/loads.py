"""The loads of a scene: ``[ground]``, the motion of the ground, and ``[[forces]]`` on coordinates.

The course of a load in time is ``record`` (a CSV file with a column ``time``, linear between its rows, nothing before the first and
after the last), or ``amplitude`` with ``frequency`` (radians a unit of time) and ``phase``, amplitude cos(frequency t + phase), or
``constant``. Each force acts ``on`` a coordinate, or on all of them by ``load``, a force on each for the value 1. The ground's course is
its acceleration a(t): in displacements relative to the ground it is the load -M r a(t), r being ``direction``, all 1 by default.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.files import read_input
from saltus.errors import BadInput, nearest, one_line
from saltus.scene.reading import FINITE, NUMBERS, POSITIVE, TEXT, Kind, TomlTable

if TYPE_CHECKING:
    from bvp.forcing import Force
    from bvp.system import ImpactSystem

__all__ = ["read_loads", "read_record"]

_COURSES: dict[str, dict[str, Kind]] = {
    "record": {"record": TEXT, "column": TEXT._replace(default=None), "scale": FINITE._replace(default=1.0)},
    "amplitude": {"amplitude": FINITE, "frequency": POSITIVE, "phase": FINITE._replace(default=0.0)},
    "constant": {"constant": FINITE},
}
"""The entries of each kind of course."""


def read_loads(scene: TomlTable, system: ImpactSystem, folder: Path) -> tuple[Force, ...]:
    """The loads of a scene. Relative names of records start at `folder`. Messages name the place in the scene or in the record."""
    loads: list[Force] = []
    size = system.degrees_of_freedom
    row = Kind(f"a list of {size} numbers", lambda value: NUMBERS.fits(value) and len(value) == size, NUMBERS.read, default=None)
    if "ground" in scene.content:
        from bvp.forcing import ground_load

        ground = scene.table("ground")
        values = ground.fields({"direction": row, **_course(ground)})
        loads.append(_load(ground_load(system, values["direction"]), values, "acceleration", folder, ground.where))
    for force in scene.tables("forces"):
        values = force.fields({"on": TEXT._replace(default=None), "load": row, **_course(force)})
        on, load = values["on"], values["load"]
        if (on is None) == (load is None):
            raise BadInput(f"{force.where}: a force acts on = {system.coordinates[0]!r}, a coordinate, or has load, one force each")
        if load is None:
            if on not in system.coordinates:
                known = ", ".join(system.coordinates)
                raise force.wrong("on", on, f"one of the coordinates {known}{nearest(on, system.coordinates)}")
            load = [float(on == name) for name in system.coordinates]
        loads.append(_load(np.array(load), values, "force", folder, force.where))
    return tuple(loads)


def _course(table: TomlTable) -> dict[str, Kind]:
    """The entries of the course that a table gives."""
    kinds = [key for key in _COURSES if key in table.content]
    if len(kinds) != 1:
        received = ", ".join(kinds) or "none"
        raise BadInput(f"{table.where}: the course of a load is record, amplitude (with frequency) or constant; received {received}")
    return _COURSES[kinds[0]]


def _load(load: np.ndarray, values: dict[str, Any], column: str, folder: Path, where: str) -> Force:
    """The load on each coordinate, with its course in time. `column` is that of a record which names none."""
    from bvp.forcing import Constant, Harmonic, Record

    if "record" in values:
        times, course = read_record(folder / values["record"], values["column"] or column, where)
        return Record((values["scale"] * load).tolist(), times, course)
    if "constant" in values:
        return Constant((values["constant"] * load).tolist())
    amplitude, phase = values["amplitude"], values["phase"]
    return Harmonic(values["frequency"], (amplitude * math.cos(phase) * load).tolist(), (-amplitude * math.sin(phase) * load).tolist())


def read_record(path: Path, column: str, where: str) -> tuple[np.ndarray, np.ndarray]:
    """Times and values of a CSV file: a line of names, then rows of numbers. Empty lines and lines that begin with # are skipped. `column`
    is the column of the values, beside ``time``; `where` names the table of the scene in messages."""
    where = f"{where}: record {path}"
    try:
        lines = read_input(path).decode("utf-8").splitlines()
        rows = [line for line in lines if line.strip() and not line.startswith("#")]
        if not rows:
            raise ValueError("it is empty")
        table = np.genfromtxt(rows, delimiter=",", names=True, deletechars="", replace_space=" ", ndmin=1)
    except FileNotFoundError as error:
        beside = [entry.name for entry in path.parent.glob("*.csv")]
        raise BadInput(f"{where} does not exist{nearest(path.name, beside)}") from error
    except (OSError, ValueError) as error:
        raise BadInput(f"{where} is no CSV file of numbers: {one_line(error)}") from error
    names = table.dtype.names or ()
    for wanted in ("time", column):
        if wanted not in names:
            hint = nearest(wanted, names) or f"; its columns: {', '.join(names) or 'none'}"
            raise BadInput(f"{where} has no column {wanted!r}{hint}")
        if not np.isfinite(table[wanted]).all():
            row = int(np.argmin(np.isfinite(table[wanted]))) + 1
            raise BadInput(f"{where}, row {row}: {wanted} is no finite number")
    times = table["time"]
    if len(times) < 2:
        raise BadInput(f"{where} has {len(times)} rows, expected 2 at least")
    if not (np.diff(times) > 0.0).all():
        k = int(np.argmin(np.diff(times) > 0.0))
        raise BadInput(f"{where}, row {k + 2}: time {times[k + 1]:g} after {times[k]:g}, expected times that ascend")
    return times, table[column]
