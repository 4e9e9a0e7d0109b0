"""Errors of a catalogue, each with a message of one line."""

from __future__ import annotations

import re
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from branches.files import WriteFailure
from bvp.shown import shown

__all__ = ["CatalogueDamaged", "CatalogueError", "CatalogueInUse", "not_taken", "readable", "translated"]


class CatalogueError(ValueError):
    """A file that cannot be used as a catalogue, or a wrong argument."""


class CatalogueDamaged(CatalogueError):
    """A part of a catalogue cannot be trusted. The message names the part."""


class CatalogueInUse(CatalogueError):
    """Another process writes the catalogue. The message names the process."""


_MESSAGES: tuple[tuple[str, type[Exception], str], ...] = (
    ("SQLITE_FULL", WriteFailure, "cannot write {path}: no space is left on the device; what it held is whole"),
    ("SQLITE_READONLY", WriteFailure, "cannot write {path}: it, or its directory, is read-only"),
    ("SQLITE_(BUSY|LOCKED)", CatalogueInUse, "{path} is being read or written by another program; try again when it has finished"),
    (
        "SQLITE_IOERR_(WRITE|FSYNC|TRUNCATE|SHMSIZE)",
        WriteFailure,
        "cannot write {path}: the system refused to write it, or the files -wal and -shm beside it{limit}; what it held is whole",
    ),
    ("SQLITE_NOTADB", CatalogueDamaged, "{path} is no catalogue: it is no SQLite file"),
    ("SQLITE_CANTOPEN", CatalogueError, "cannot open {path}, or the files -wal and -shm beside it"),
    ("SQLITE_CORRUPT", CatalogueDamaged, "{path} is damaged or cut short: {error}"),
    ("SQLITE_IOERR", CatalogueDamaged, "{path} is damaged: {error}"),
    (".*closed database", CatalogueError, "the catalogue {path} is closed; expected one that is open"),
    (".*no such", CatalogueDamaged, "{path} is damaged: it has {error}"),
    (".*Could not decode", CatalogueDamaged, "{path} is damaged: {error}"),
)
"""Regular expressions for SQLite's error code and text, with the error to raise. The first match counts."""


def not_taken(expected: str, value: object) -> CatalogueError:
    """The error for an argument of the wrong type.

    Examples
    --------
    >>> print(not_taken("a catalogue is the name of a file", 3))
    a catalogue is the name of a file; received 3
    """
    return CatalogueError(f"{expected}; received {shown(value)}")


@contextmanager
def readable(path: Path, what: str) -> Iterator[None]:
    """Report a part of a catalogue as damaged if the block cannot interpret it.

    Raises
    ------
    CatalogueDamaged
    """
    try:
        yield
    except CatalogueError:
        raise
    except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
        raise CatalogueDamaged(f"{path} is damaged: {what} cannot be read") from error


@contextmanager
def translated(path: Path) -> Iterator[None]:
    """Report SQLite's errors in the user's words.

    Parameters
    ----------
    path : Path
        The file that the block reads or writes.

    Raises
    ------
    CatalogueError, CatalogueDamaged
        If the file cannot be read.
    WriteFailure
        If the file cannot be written. It keeps what it held.
    """
    try:
        yield
    except sqlite3.Error as error:
        text = " ".join(str(error).split())
        code = getattr(error, "sqlite_errorname", None) or ""
        for pattern, kind, message in _MESSAGES:
            if re.match(pattern, f"{code} {text}"):
                raise kind(message.format(path=path, error=f"{text[:1].lower()}{text[1:80]}", limit=_limit())) from error
        raise


def _limit() -> str:
    """The limit on the size of files, if there is one: SQLite does not report whether it was the reason."""
    try:
        import resource
    except ImportError:  # Windows
        return ""
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
    return "" if limit == resource.RLIM_INFINITY else f"; no file may be larger than {limit} bytes here (ulimit -f)"
