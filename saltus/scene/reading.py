"""Reading of TOML files: each entry is read by its name and kind, and an error is one line with what was received and expected."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from branches.files import read_input
from bvp.texts import shown
from saltus.errors import BadInput, nearest, one_line

__all__ = ["FINITE", "INTEGER", "NUMBER", "NUMBERS", "POSITIVE", "TEXT", "TEXTS", "Kind", "TomlTable", "one_of", "read_toml"]

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
        return TomlTable(tomllib.loads(read_input(path).decode("utf-8")), where)
    except FileNotFoundError as error:
        beside = [str(entry) for entry in path.parent.glob("*.toml")]
        raise BadInput(f"{where} does not exist{nearest(str(path), [*beside, *names]) or expected}") from error
    except RecursionError as error:
        raise BadInput(f"cannot read {where}: its values are nested too deeply") from error
    except (OSError, ValueError) as error:
        raise BadInput(f"cannot read {where} as TOML: {one_line(error)}") from error
