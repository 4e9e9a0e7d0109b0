"""Reading of TOML files, and the loads of a scene. Each entry is read by its name and kind; an error is one line with what was received
and expected.

The loads are ``[ground]``, the motion of the ground, and ``[[forces]]`` on coordinates. The course of a load in time is ``record`` (a CSV
file with a column ``time``, linear between its rows, nothing before the first and after the last), or ``amplitude`` with ``frequency``
(radians a unit of time) and ``phase``, amplitude cos(frequency t + phase), or ``constant``. In place of ``frequency``, ``harmonic`` = k
gives k times the parameter w. In a scene with ``[parameters]`` these numbers can be expressions of them.

Each force acts ``on`` a coordinate, or on all of them by ``load``, a force on each for the value 1. The ground's course is its acceleration
a(t): in displacements relative to the ground it is the load -M r a(t), r being ``direction``, all 1 by default.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from branches.files import read_input
from bvp.expressions import normalised
from bvp.texts import listed, shown
from saltus.errors import BadInput, nearest, one_line

__all__ = [
    "FINITE", "INTEGER", "Kind", "NUMBER", "NUMBERS", "POSITIVE", "TEXT", "TEXTS", "TomlTable", "one_of", "read_loads",
    "read_record", "read_toml",
]  # fmt: skip

_REQUIRED: Any = object()


class Kind(NamedTuple):
    """What an entry has to be: the text of messages, a test, what makes the value, the choices of a text, and the default."""

    expected: str
    fits: Callable[[Any], bool]
    read: Callable[[Any], Any] = lambda value: value
    choices: tuple[str, ...] = ()
    default: Any = _REQUIRED


def one_of(*choices: str) -> Kind:
    """The kind of a text that is one of several."""
    return Kind(" or ".join(choices), lambda value: value in choices, choices=choices)


NUMBER = Kind(
    "a number",
    # An integer is one too, unless it is beyond all floats; NaN is none.
    lambda x: isinstance(x, int | float) and not isinstance(x, bool) and (abs(x) < 1e308 or abs(x) == math.inf),
    float,
)
FINITE = Kind("a finite number", lambda value: NUMBER.fits(value) and math.isfinite(value), float)
POSITIVE = Kind("a number above 0", lambda value: NUMBER.fits(value) and 0.0 < value < math.inf, float)
INTEGER = Kind("an integer", lambda value: isinstance(value, int) and not isinstance(value, bool))
TEXT = Kind("a string", lambda value: isinstance(value, str))
TEXTS = Kind("a list of strings", lambda value: isinstance(value, list) and all(isinstance(entry, str) for entry in value), tuple)
NUMBERS = Kind(
    "a list of numbers",
    lambda value: isinstance(value, list) and all(map(NUMBER.fits, value)),
    lambda value: tuple(map(float, value)),
)
_TABLES = Kind("tables", lambda value: isinstance(value, list) and all(isinstance(entry, Mapping) for entry in value), default=[])


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
        if key not in self.content:
            value = kind.default if default is _REQUIRED else default
            if value is _REQUIRED:
                raise BadInput(f"{self.where}: {key} is missing, expected {kind.expected}")
            return value
        value = self.content[key]
        if not kind.fits(value):
            raise self.wrong(key, value, kind.expected + nearest(str(value), kind.choices))
        return kind.read(value)

    def fields(self, kinds: Mapping[str, Kind]) -> dict[str, Any]:
        """All entries, by their kinds; other entries are refused."""
        self.only(*kinds)
        return {key: self.get(key, kind) for key, kind in kinds.items()}

    def table(self, key: str, default: Mapping[str, Any] = _REQUIRED) -> TomlTable:
        """The table with a name."""
        value = self.get(key, Kind(f"a table [{key}]", lambda value: isinstance(value, Mapping)), default)
        return TomlTable(value, f"{self.where} [{key}]")

    def tables(self, key: str) -> list[TomlTable]:
        """The list of tables with a name, which can be empty."""
        entries = self.get(key, _TABLES._replace(expected=f"tables [[{key}]]"))
        return [TomlTable(entry, f"{self.where} [[{key}]] number {i}") for i, entry in enumerate(entries, 1)]


def read_toml(path: Path, where: str, names: Iterable[str] = (), expected: str = "; expected a TOML file") -> TomlTable:
    """The content of a TOML file.

    Parameters
    ----------
    path : Path
    where : str
        The file, as messages name it: "scene a.toml".
    names : iterable of str
        Suggested, with the files beside it, if the file is missing.
    expected : str
        The end of the message if nothing is near.
    """
    try:
        return TomlTable(_with_plain_names(tomllib.loads(read_input(path).decode("utf-8")), where), where)
    except BadInput:
        raise
    except FileNotFoundError as error:
        beside = [str(entry) for entry in path.parent.glob("*.toml")]
        raise BadInput(f"{where} does not exist{nearest(str(path), [*beside, *names]) or expected}") from error
    except RecursionError as error:
        raise BadInput(f"cannot read {where}: its values are nested too deeply") from error
    except (OSError, ValueError) as error:
        raise BadInput(f"cannot read {where} as TOML: {one_line(error)}") from error


def _with_plain_names(content: Any, where: str) -> Any:
    """The content of a file with each name, and each text that can be one, as expressions have it."""
    if isinstance(content, dict):
        plain = {normalised(key): _with_plain_names(value, where) for key, value in content.items()}
        if len(plain) < len(content):
            keys = [key for key in content if [normalised(other) for other in content].count(normalised(key)) > 1]
            codes = [f"{key} ({' '.join(f'U+{ord(letter):04X}' for letter in key)})" for key in keys]
            raise BadInput(f"{where}: {listed(codes)} are one name, written with other characters; rename one of them")
        return plain
    if isinstance(content, list):
        return [_with_plain_names(value, where) for value in content]
    return normalised(content) if isinstance(content, str) and content.isidentifier() else content


_EXPRESSION = Kind("a finite number or an expression of parameters", lambda value: FINITE.fits(value) or isinstance(value, str))
_HARMONIC = Kind("a positive integer", lambda value: INTEGER.fits(value) and value > 0, default=None)


def _courses(number: Kind, frequency: Kind) -> dict[str, dict[str, Kind]]:
    """The entries of each kind of course."""
    return {
        "record": {"record": TEXT, "column": TEXT._replace(default=None), "scale": FINITE._replace(default=1.0)},
        "amplitude": {"amplitude": number, "frequency": frequency, "harmonic": _HARMONIC, "phase": number._replace(default=0.0)},
        "constant": {"constant": number},
    }


def read_loads(scene: TomlTable, coordinates: Sequence[str], folder: Path) -> list[dict[str, Any]]:
    """The loads of a scene, as `bvp.parameters.ParametricSystem.from_description` takes them. Relative names of records start at `folder`.
    Messages name the place in the scene or in the record."""
    loads: list[dict[str, Any]] = []
    size = len(coordinates)
    number = _EXPRESSION if "parameters" in scene.content else FINITE
    courses = _courses(number, _EXPRESSION if "parameters" in scene.content else POSITIVE)
    row = Kind(
        f"a list of {size} numbers",
        lambda value: isinstance(value, list) and len(value) == size and all(map(number.fits, value)),
        lambda value: list(map(number.read, value)),
        default=None,
    )
    if "ground" in scene.content:
        ground = scene.table("ground")
        values = ground.fields({"direction": row, **_course(ground, courses)})
        direction = values.pop("direction")
        loads.append(_load({"ground": direction or [1.0] * size, **values}, "acceleration", folder, ground.where))
    for force in scene.tables("forces"):
        values = force.fields({"on": TEXT._replace(default=None), "load": row, **_course(force, courses)})
        on, load = values.pop("on"), values["load"]
        if (on is None) == (load is None):
            raise BadInput(f"{force.where}: a force acts on = {coordinates[0]!r}, a coordinate, or has load, one force each")
        if load is None:
            if on not in coordinates:
                raise force.wrong("on", on, f"one of the coordinates {', '.join(coordinates)}{nearest(on, coordinates)}")
            values["load"] = [float(on == name) for name in coordinates]
        loads.append(_load(values, "force", folder, force.where))
    return loads


def _course(table: TomlTable, courses: dict[str, dict[str, Kind]]) -> dict[str, Kind]:
    """The entries of the course that a table gives."""
    kinds = [key for key in courses if key in table.content]
    if len(kinds) != 1:
        received = ", ".join(kinds) or "none"
        raise BadInput(f"{table.where}: the course of a load is record, amplitude (with frequency) or constant; received {received}")
    course = courses[kinds[0]]
    if "frequency" in course:
        if "frequency" in table.content and "harmonic" in table.content:
            raise BadInput(f"{table.where}: frequency and harmonic each give the frequency; expected one of them")
        course = {key: kind for key, kind in course.items() if key != ("frequency" if "harmonic" in table.content else "harmonic")}
    return course


def _load(values: dict[str, Any], column: str, folder: Path, where: str) -> dict[str, Any]:
    """A load, with the samples of its record. `column` is that of a record which names none."""
    if "record" in values:
        times, course = read_record(folder / values.pop("record"), values.pop("column") or column, where)
        values |= {"times": times.tolist(), "values": course.tolist()}
    return values


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
