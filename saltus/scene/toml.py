"""TOML files: reading, parsing, and tables whose entries are read by name and type. Each error is one line in the user's words."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from branches.files import read_input, reason
from bvp.shown import shown
from saltus.errors import BadInput, nearest, one_line

__all__ = ["TomlTable", "parse_toml", "read_toml"]

_REQUIRED: Any = object()


def read_toml(path: Path, what: str, names: Iterable[str] = (), expected: str = "; expected a TOML file") -> str:
    """The text of a TOML file.

    Parameters
    ----------
    path : Path
    what : str
        What the file is, for messages: "scene", "study".
    names : iterable of str
        What could have been meant besides the TOML files that lie where none is.
    expected : str
        The end of the message where nothing near exists, or what is there is no file that can be read.

    Raises
    ------
    BadInput
        For a file that does not exist, cannot be read, or is no text.
    """
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
    """The table that the text of a TOML file holds; `where` names the file in messages.

    Raises
    ------
    BadInput
        For text that is no TOML.

    Examples
    --------
    >>> parse_toml("mu = 0.1", "scene a.toml").number("mu")
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


class TomlTable:
    """Reads entries of a mapping and says where they stand when they are not what was expected.

    Parameters
    ----------
    content : mapping
        What the TOML file holds here.
    where : str
        The file and table, as messages name it.

    Examples
    --------
    >>> TomlTable({"energy": "high"}, "scene a.toml [bounds]").number("energy")
    Traceback (most recent call last):
    saltus.errors.BadInput: scene a.toml [bounds]: energy = 'high', expected a number
    """

    def __init__(self, content: Mapping[str, Any], where: str) -> None:
        self._content = content
        self.where = where

    def keys(self) -> list[str]:
        """Return the names of the entries."""
        return list(self._content)

    def content(self) -> dict[str, Any]:
        """Return the entries as they stand."""
        return dict(self._content)

    def only(self, *known: str) -> None:
        """Refuse an entry that is not known, naming the nearest that is."""
        for key in self._content:
            if key not in known:
                hint = nearest(key, known) or "; known: " + ", ".join(known)
                raise BadInput(f"{self.where}: unknown key {key!r}{hint}")

    def wrong(self, key: str, received: object, expected: str) -> BadInput:
        """Return the error for an entry that is not what was expected."""
        return BadInput(f"{self.where}: {key} = {shown(received)}, expected {expected}")

    def _get(self, key: str, expected: str, default: Any = _REQUIRED) -> Any:
        if key in self._content:
            return self._content[key]
        if default is _REQUIRED:
            raise BadInput(f"{self.where}: {key} is missing, expected {expected}")
        return default

    def number(self, key: str, default: float = _REQUIRED) -> float:
        """Return a number; a whole number is one too, NaN is none."""
        return self._number(key, self._get(key, "a number", default))

    def _number(self, key: str, value: object) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float) or math.isnan(value):
            raise self.wrong(key, value, "a number")
        try:
            return float(value)
        except OverflowError as error:
            raise self.wrong(key, value, "a number below 1.8e308") from error

    def finite(self, key: str, default: float = _REQUIRED) -> float:
        """Return a finite number."""
        value = self.number(key, default)
        if not math.isfinite(value):
            raise self.wrong(key, value, "a finite number")
        return value

    def positive(self, key: str, expected: str = "a number above 0") -> float:
        """Return a finite number above 0; `expected` describes it in the message."""
        value = self.number(key)
        if not 0.0 < value < math.inf:
            raise self.wrong(key, value, expected)
        return value

    def integer(self, key: str) -> int:
        """Return a whole number."""
        value = self._get(key, "a whole number")
        if isinstance(value, bool) or not isinstance(value, int):
            raise self.wrong(key, value, "a whole number")
        return value

    def text(self, key: str, default: str = _REQUIRED, expected: str = "a string") -> str:
        """Return a string; `expected` says which, where it is missing."""
        value = self._get(key, expected, default)
        if not isinstance(value, str):
            raise self.wrong(key, value, "a string")
        return value

    def choice(self, key: str, known: Sequence[str], default: str = _REQUIRED) -> str:
        """Return one of several strings."""
        value = self.text(key, default, expected=" or ".join(known))
        if value not in known:
            raise self.wrong(key, value, " or ".join(known) + nearest(value, known))
        return value

    def texts(self, key: str) -> tuple[str, ...]:
        """Return a list of strings."""
        value = self._get(key, "a list of strings")
        if not isinstance(value, list) or not all(isinstance(entry, str) for entry in value):
            raise self.wrong(key, value, "a list of strings")
        return tuple(value)

    def numbers(self, key: str, count: int | None = None) -> tuple[float, ...]:
        """Return a list of numbers, of a given length if `count` is given."""
        expected = "a list of numbers" if count is None else f"a list of {count} numbers"
        value = self._get(key, expected)
        if not isinstance(value, list) or (count is not None and len(value) != count):
            raise self.wrong(key, value, expected)
        return tuple(self._number(f"{key}[{i}]", entry) for i, entry in enumerate(value))

    def matrix(self, key: str) -> list[list[float]]:
        """Return a square matrix, given as a list of rows."""
        rows = self._get(key, "a square matrix as a list of rows")
        if not isinstance(rows, list) or not rows or not all(isinstance(row, list) and len(row) == len(rows) for row in rows):
            raise self.wrong(key, rows, "a square matrix as a list of rows")
        return [[self._number(f"{key}[{i}][{j}]", entry) for j, entry in enumerate(row)] for i, row in enumerate(rows)]

    def table(self, key: str, default: Mapping[str, Any] = _REQUIRED) -> TomlTable:
        """Return the table of that name."""
        value = self._get(key, f"a table [{key}]", default)
        if not isinstance(value, Mapping):
            raise self.wrong(key, value, f"a table [{key}]")
        return TomlTable(value, f"{self.where} [{key}]")

    def tables(self, key: str) -> list[TomlTable]:
        """Return the list of tables of that name; none is an empty list."""
        value = self._get(key, f"tables [[{key}]]", [])
        if not isinstance(value, list) or not all(isinstance(entry, Mapping) for entry in value):
            raise self.wrong(key, value, f"tables [[{key}]]")
        return [TomlTable(entry, f"{self.where} [[{key}]] number {i}") for i, entry in enumerate(value, 1)]
