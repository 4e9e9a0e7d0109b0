"""Reading of the TOML files of scenes and studies, with their loads and load records. Each entry is read by name and type.

Each error is one line that says what was received and what was expected. The loads of a scene are ``[ground]``, the motion of the ground,
and ``[[forces]]`` on coordinates, each a harmonic, a record or a constant.

The course of a load in time is ``record`` (a CSV file with a column ``time``, linear between its rows, nothing before the first and
after the last), or ``amplitude`` with ``frequency`` (radians a unit of time) and ``phase``, amplitude cos(frequency t + phase), or
``constant``. Each force acts ``on`` a coordinate, or on all of them by ``load``, a force on each for the value 1. The ground's course is
its acceleration a(t): in displacements relative to the ground it is the load -M r a(t), r being ``direction``, all 1 by default.
"""

from __future__ import annotations

import csv
import math
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from branches.files import read_input, reason
from bvp.texts import shown
from saltus.errors import BadInput, nearest, one_line

if TYPE_CHECKING:
    from bvp.forcing import Force
    from bvp.system import ImpactSystem

__all__ = [
    "FINITE",
    "INTEGER",
    "NUMBER",
    "POSITIVE",
    "TEXT",
    "TEXTS",
    "Kind",
    "TomlTable",
    "parse_toml",
    "read_loads",
    "read_record",
    "read_toml",
]

_COURSE = ("record", "column", "scale", "amplitude", "frequency", "phase", "constant")

_REQUIRED: Any = object()


def read_toml(path: Path, what: str, names: Iterable[str] = (), expected: str = "; expected a TOML file") -> str:
    """The text of a TOML file. `what` (scene, study) appears in messages. If the file is missing, `names` are suggested;
    `expected` ends the message if none is near."""
    try:
        return read_input(path).decode("utf-8")
    except UnicodeDecodeError as error:
        raise BadInput(f"{what} {path} is no TOML: byte {error.start} is not UTF-8 text") from error
    except FileNotFoundError as error:
        beside = [str(entry) for entry in path.parent.glob("*.toml")] if path.parent.is_dir() else []
        raise BadInput(f"{what} {path} does not exist{nearest(str(path), [*beside, *names]) or expected}") from error
    except (OSError, ValueError) as error:
        said = reason(error) if isinstance(error, OSError) else one_line(error)
        raise BadInput(f"cannot read {what} {path}: {said}{expected}") from error


def parse_toml(text: str, where: str) -> TomlTable:
    """The table that the text of a TOML file holds. `where` names the file in messages.

    Examples
    --------
    >>> parse_toml("mu = 0.1", "scene a.toml").get("mu", NUMBER)
    0.1
    >>> parse_toml("mu = = 0.1", "scene a.toml")
    Traceback (most recent call last):
    saltus.errors.BadInput: scene a.toml is no TOML: Invalid value (at line 1, column 6)
    """
    try:
        return TomlTable(tomllib.loads(text), where)
    except tomllib.TOMLDecodeError as error:
        raise BadInput(f"{where} is no TOML: {one_line(error)}") from error
    except RecursionError as error:
        raise BadInput(f"{where} is no TOML that can be read: its values are nested too deeply") from error


class Kind(NamedTuple):
    """What an entry has to be: the text of messages, a test, and what makes the value."""

    expected: str
    fits: Callable[[Any], bool]
    read: Callable[[Any], Any] = lambda value: value


def _is_number(value: Any) -> bool:
    """Whether a value is a number: an integer is one too, NaN is none."""
    return isinstance(value, int | float) and not isinstance(value, bool) and float(value) == value


NUMBER = Kind("a number", _is_number, float)
FINITE = Kind("a finite number", lambda value: _is_number(value) and math.isfinite(value), float)
POSITIVE = Kind("a number above 0", lambda value: _is_number(value) and 0.0 < value < math.inf, float)
INTEGER = Kind("an integer", lambda value: isinstance(value, int) and not isinstance(value, bool))
TEXT = Kind("a string", lambda value: isinstance(value, str))
TEXTS = Kind("a list of strings", lambda value: isinstance(value, list) and all(isinstance(entry, str) for entry in value), tuple)
_MATRIX = Kind(
    "a square matrix as a list of rows",
    lambda rows: isinstance(rows, list) and bool(rows) and all(isinstance(row, list) and len(row) == len(rows) for row in rows),
)


@dataclass(frozen=True)
class TomlTable:
    """Reads entries of a mapping. An error names the table and the key.

    Parameters
    ----------
    content : mapping
        Content of the table.
    where : str
        The file and table, as messages name it.

    Examples
    --------
    >>> TomlTable({"energy": "high"}, "scene a.toml [bounds]").get("energy", NUMBER)
    Traceback (most recent call last):
    saltus.errors.BadInput: scene a.toml [bounds]: energy = 'high', expected a number
    """

    content: Mapping[str, Any]
    where: str

    def only(self, *known: str) -> None:
        """Refuse an entry that is not known. The message suggests the nearest."""
        for key in self.content:
            if key not in known:
                hint = nearest(key, known) or "; known: " + ", ".join(known)
                raise BadInput(f"{self.where}: unknown key {key!r}{hint}")

    def wrong(self, key: str, received: object, expected: str) -> BadInput:
        """The error for an entry that is not what was expected."""
        return BadInput(f"{self.where}: {key} = {shown(received)}, expected {expected}")

    def get(self, key: str, kind: Kind, default: Any = _REQUIRED) -> Any:
        """An entry of a kind, or the default."""
        if key not in self.content and default is not _REQUIRED:
            return default
        if key not in self.content:
            raise BadInput(f"{self.where}: {key} is missing, expected {kind.expected}")
        value = self.content[key]
        try:
            if kind.fits(value):
                return kind.read(value)
        except OverflowError as error:
            raise self.wrong(key, value, "a number below 1.8e308") from error
        raise self.wrong(key, value, kind.expected)

    def choice(self, key: str, known: Sequence[str], default: str = _REQUIRED) -> str:
        """One of several strings."""
        value = self.get(key, TEXT._replace(expected=" or ".join(known)), default)
        if value not in known:
            raise self.wrong(key, value, " or ".join(known) + nearest(value, known))
        return value

    def numbers(self, key: str, count: int | None = None) -> tuple[float, ...]:
        """A list of numbers, of a given length if `count` is given."""
        expected = "a list of numbers" if count is None else f"a list of {count} numbers"
        values = self.get(key, Kind(expected, lambda value: isinstance(value, list) and count in (None, len(value))))
        entries = TomlTable({f"{key}[{i}]": entry for i, entry in enumerate(values)}, self.where)
        return tuple(entries.get(name, NUMBER) for name in entries.content)

    def matrix(self, key: str) -> list[list[float]]:
        """A square matrix, given as a list of rows."""
        rows = TomlTable({f"{key}[{i}]": row for i, row in enumerate(self.get(key, _MATRIX))}, self.where)
        return [list(rows.numbers(name)) for name in rows.content]

    def table(self, key: str, default: Mapping[str, Any] = _REQUIRED) -> TomlTable:
        """The table with a name."""
        value = self.get(key, Kind(f"a table [{key}]", lambda value: isinstance(value, Mapping)), default)
        return TomlTable(value, f"{self.where} [{key}]")

    def tables(self, key: str) -> list[TomlTable]:
        """The list of tables with a name, which can be empty."""
        are_tables = Kind(f"tables [[{key}]]", lambda value: isinstance(value, list) and all(isinstance(x, Mapping) for x in value))
        return [TomlTable(entry, f"{self.where} [[{key}]] number {i}") for i, entry in enumerate(self.get(key, are_tables, []), 1)]


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
