"""TOML files: reading, parsing, and tables whose entries are read by name and type. Each error is one line in the user's words."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from branches.files import read_input, reason
from bvp.texts import shown
from saltus.errors import BadInput, nearest, one_line

__all__ = ["FINITE", "NUMBER", "POSITIVE", "TEXT", "TEXTS", "WHOLE", "Kind", "TomlTable", "parse_toml", "read_toml"]

_REQUIRED: Any = object()


def read_toml(path: Path, what: str, names: Iterable[str] = (), expected: str = "; expected a TOML file") -> str:
    """The text of a TOML file. `what` it is (scene, study) stands in messages. `names` could have been meant instead of a missing file;
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
    """What an entry has to be: the words of messages, a test, and what makes the value."""

    expected: str
    fits: Callable[[Any], bool]
    read: Callable[[Any], Any] = lambda value: value


def _is_number(value: Any) -> bool:
    """Whether a value is a number: a whole number is one too, NaN is none."""
    return isinstance(value, int | float) and not isinstance(value, bool) and float(value) == value


NUMBER = Kind("a number", _is_number, float)
FINITE = Kind("a finite number", lambda value: _is_number(value) and math.isfinite(value), float)
POSITIVE = Kind("a number above 0", lambda value: _is_number(value) and 0.0 < value < math.inf, float)
WHOLE = Kind("a whole number", lambda value: isinstance(value, int) and not isinstance(value, bool))
TEXT = Kind("a string", lambda value: isinstance(value, str))
TEXTS = Kind("a list of strings", lambda value: isinstance(value, list) and all(isinstance(entry, str) for entry in value), tuple)
_MATRIX = Kind(
    "a square matrix as a list of rows",
    lambda rows: isinstance(rows, list) and bool(rows) and all(isinstance(row, list) and len(row) == len(rows) for row in rows),
)


class TomlTable:
    """Reads entries of a mapping. An error names the table and the key.

    Parameters
    ----------
    content : mapping
        What the TOML file holds here.
    where : str
        The file and table, as messages name it.

    Examples
    --------
    >>> TomlTable({"energy": "high"}, "scene a.toml [bounds]").get("energy", NUMBER)
    Traceback (most recent call last):
    saltus.errors.BadInput: scene a.toml [bounds]: energy = 'high', expected a number
    """

    def __init__(self, content: Mapping[str, Any], where: str) -> None:
        self.content = content
        self.where = where

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
        return self._checked(key, self.content[key], kind)

    def _checked(self, key: str, value: Any, kind: Kind) -> Any:
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
        return tuple(self._checked(f"{key}[{i}]", entry, NUMBER) for i, entry in enumerate(values))

    def matrix(self, key: str) -> list[list[float]]:
        """A square matrix, given as a list of rows."""
        rows = self.get(key, _MATRIX)
        return [[self._checked(f"{key}[{i}][{j}]", entry, NUMBER) for j, entry in enumerate(row)] for i, row in enumerate(rows)]

    def table(self, key: str, default: Mapping[str, Any] = _REQUIRED) -> TomlTable:
        """The table with a name."""
        value = self.get(key, Kind(f"a table [{key}]", lambda value: isinstance(value, Mapping)), default)
        return TomlTable(value, f"{self.where} [{key}]")

    def tables(self, key: str) -> list[TomlTable]:
        """The list of tables with a name, which can be empty."""
        are_tables = Kind(f"tables [[{key}]]", lambda value: isinstance(value, list) and all(isinstance(x, Mapping) for x in value))
        return [TomlTable(entry, f"{self.where} [[{key}]] number {i}") for i, entry in enumerate(self.get(key, are_tables, []), 1)]
