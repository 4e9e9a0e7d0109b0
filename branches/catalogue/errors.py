"""What can be wrong with the file of a catalogue, said in one line each."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from branches.files import WriteFailure
from bvp.shown import shown

__all__ = ["CatalogueDamaged", "CatalogueError", "CatalogueInUse", "not_taken", "readable", "translated"]

_REFUSED = {
    "SQLITE_IOERR_WRITE": "the system refused to write into it, or into the files -wal and -shm that belong to it",
    "SQLITE_IOERR_FSYNC": "the system refused to bring what was written onto the disk",
    "SQLITE_IOERR_TRUNCATE": "the system refused to shorten it, or the file -wal that belongs to it",
    "SQLITE_IOERR_SHMSIZE": "the system refused to make room for the file -shm that belongs to it",
}
"""What the system did not do, by SQLite's names."""


class CatalogueError(ValueError):
    """A file that cannot be used as the catalogue that was asked for; the message is one line."""


class CatalogueDamaged(CatalogueError):
    """A catalogue of which a part cannot be trusted; the message names the part."""


class CatalogueInUse(CatalogueError):
    """A catalogue that another process is writing; the message names it."""


def not_taken(expected: str, value: object) -> CatalogueError:
    """The error for an argument of another kind than is expected.

    Examples
    --------
    >>> print(not_taken("a catalogue is the name of a file", 3))
    a catalogue is the name of a file; received 3
    """
    return CatalogueError(f"{expected}; received {shown(value)}")


@contextmanager
def readable(path: Path, what: str) -> Iterator[None]:
    """Say that a part of a catalogue is not what it should be, where the block cannot make sense of it.

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
    """Say what SQLite reports in the user's words.

    Parameters
    ----------
    path : Path
        The file that is read or written in the block.

    Raises
    ------
    CatalogueError, CatalogueDamaged
        Where the file cannot be read.
    WriteFailure
        Where it cannot be written; what it held stays whole.
    """
    try:
        yield
    except sqlite3.Error as error:
        code = getattr(error, "sqlite_errorname", None) or ""
        if code == "SQLITE_FULL":
            raise WriteFailure(f"cannot write {path}: no space is left on the device; what it held is whole") from error
        if code.startswith("SQLITE_READONLY"):
            raise WriteFailure(f"cannot write {path}: it, or its directory, is read-only") from error
        if code.startswith(("SQLITE_BUSY", "SQLITE_LOCKED")):
            raise CatalogueInUse(f"{path} is being read or written by another program; try again when it has finished") from error
        if code in _REFUSED:
            raise WriteFailure(f"cannot write {path}: {_REFUSED[code]}{_limit()}; what it held is whole") from error
        if isinstance(error, sqlite3.ProgrammingError) and "closed" in str(error):
            raise CatalogueError(f"the catalogue {path} is closed; expected one that is open") from error
        if code == "SQLITE_NOTADB":
            raise CatalogueDamaged(f"{path} is no catalogue: it is no SQLite file") from error
        if code.startswith("SQLITE_CANTOPEN"):
            raise CatalogueError(f"cannot open {path}, or the files -wal and -shm that belong to it") from error
        if code.startswith(("SQLITE_CORRUPT", "SQLITE_IOERR")):
            raise CatalogueDamaged(f"{path} is damaged: {error}") from error
        if isinstance(error, sqlite3.OperationalError) and str(error).startswith("no such"):
            raise CatalogueDamaged(f"{path} is damaged: it has {error}") from error
        if isinstance(error, sqlite3.OperationalError) and str(error).startswith("Could not decode"):
            raise CatalogueDamaged(f"{path} is damaged: {str(error)[:1].lower()}{str(error)[1:].splitlines()[0][:80]}") from error
        raise


def _limit() -> str:
    """The limit on the size of files, where there is one: SQLite does not tell whether it was the reason."""
    try:
        import resource
    except ImportError:  # Windows
        return ""
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
    return "" if limit == resource.RLIM_INFINITY else f"; no file may be larger than {limit} bytes here (ulimit -f)"
