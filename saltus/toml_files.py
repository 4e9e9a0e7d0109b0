"""TOML files: read and parsed, and what keeps them from that told in one line."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from pathlib import Path

from branches.files import read_input, reason
from saltus.errors import BadInput, nearest, one_line
from saltus.table import Table

__all__ = ["parse_toml", "read_toml"]


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


def parse_toml(text: str, where: str) -> Table:
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
        return Table(tomllib.loads(text), where)
    except tomllib.TOMLDecodeError as error:
        raise BadInput(f"{where} is no TOML: {one_line(error)}") from error
    except RecursionError as error:
        raise BadInput(f"{where} is no TOML that can be read: its values are nested too deeply") from error
