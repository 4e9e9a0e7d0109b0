"""A table of a TOML file whose entries are asked for by name and type, and refused in the user's words."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from bvp.shown import shown
from saltus.errors import BadInput, nearest

__all__ = ["Table"]

_REQUIRED: Any = object()


class Table:
    """Reads entries of a mapping and says where they stand when they are not what was expected.

    Parameters
    ----------
    content : mapping
        What the TOML file holds here.
    where : str
        The file and table, as messages name it.

    Examples
    --------
    >>> Table({"energy": "high"}, "scene a.toml [bounds]").number("energy")
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

    def table(self, key: str, default: Mapping[str, Any] = _REQUIRED) -> Table:
        """Return the table of that name."""
        value = self._get(key, f"a table [{key}]", default)
        if not isinstance(value, Mapping):
            raise self.wrong(key, value, f"a table [{key}]")
        return Table(value, f"{self.where} [{key}]")

    def tables(self, key: str) -> list[Table]:
        """Return the list of tables of that name; none is an empty list."""
        value = self._get(key, f"tables [[{key}]]", [])
        if not isinstance(value, list) or not all(isinstance(entry, Mapping) for entry in value):
            raise self.wrong(key, value, f"tables [[{key}]]")
        return [Table(entry, f"{self.where} [[{key}]] number {i}") for i, entry in enumerate(value, 1)]
