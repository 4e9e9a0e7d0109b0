"""Opening the file of a catalogue: for reading wherever it lies, and for writing by one process."""

from __future__ import annotations

import os
import sqlite3
from pathlib import Path

from branches.catalogue.errors import CatalogueDamaged, CatalogueError, translated
from branches.files import SQLITE, WriteFailure, is_special, reason

__all__ = ["open_settled", "open_to_read", "open_to_write", "settle"]

_BUSY = 5.0
"""Seconds to wait for a reader or writer of the same file."""
_FREE = 0.1
"""Part of a file's pages that may stay free when it is closed."""


def open_to_read(path: Path) -> sqlite3.Connection:
    """A connection that changes nothing.

    Raises
    ------
    CatalogueError
        For a file that does not exist, cannot be read, or is no SQLite file.
    CatalogueDamaged
        For one that is cut short.
    """
    _look(path)
    wal = path.with_name(path.name + "-wal")
    journal = path.with_name(path.name + "-journal")
    with translated(path):
        try:
            return _probe(_connect(path, "mode=ro"))
        except sqlite3.OperationalError as error:
            if journal.exists() and os.access(path, os.W_OK):
                # A killed writer left a change half made: opening to write takes it back.
                _probe(_connect(path, "mode=rw")).close()
                return _probe(_connect(path, "mode=ro"))
            left = next((file.name for file in (wal, journal) if file.exists() and file.stat().st_size), None)
            if left is not None:
                raise CatalogueError(
                    f"cannot read {path}: {left} beside it holds families that a killed writer left; open it once where it can be written"
                ) from error
            # A read-only medium: nothing can be written beside the file, and nothing will change it.
            return _probe(_connect(path, "mode=ro&immutable=1"))


def open_settled(path: Path) -> sqlite3.Connection | None:
    """A connection to a file that nothing belongs to, which leaves it and its directory as they are; None where there is none."""
    beside = [path.with_name(path.name + ending) for ending in ("-wal", "-journal")]
    if not path.exists() or path.stat().st_size == 0 or any(file.exists() and file.stat().st_size for file in beside):
        return None
    _look(path)
    with translated(path):
        return _probe(_connect(path, "mode=ro&immutable=1"))


def open_to_write(path: Path) -> sqlite3.Connection:
    """A connection for the one writer; the file is made if it does not exist.

    Commits go to a log beside the file, so that readers are not held up and a killed process loses nothing that was committed.

    Raises
    ------
    CatalogueError, CatalogueDamaged, WriteFailure
    """
    if path.exists() and path.stat().st_size:
        _look(path)
        if not os.access(path, os.W_OK):
            raise WriteFailure(f"cannot write {path}: permission is denied")
    with translated(path):
        connection = _connect(path, "mode=rwc")
        try:
            connection.execute("PRAGMA journal_mode = WAL").fetchone()
            connection.execute("PRAGMA synchronous = NORMAL")
        except BaseException:
            connection.close()
            raise
    return connection


def settle(connection: sqlite3.Connection) -> None:
    """Bring everything into the one file, without the space that is free in it, and leave nothing beside it; where a reader or a full disk
    prevents that, what was committed stays in the log beside the file, or the free space in it."""
    try:
        connection.execute("PRAGMA journal_mode = DELETE").fetchone()
        free, all = (connection.execute(f"PRAGMA {name}").fetchone()[0] for name in ("freelist_count", "page_count"))
        if free > _FREE * all:
            connection.execute("VACUUM")
    except sqlite3.Error:
        pass
    connection.close()


def _connect(path: Path, options: str) -> sqlite3.Connection:
    # What separates the parts of a URI, and the sign that escapes.
    name = str(path).replace("%", "%25").replace("?", "%3f").replace("#", "%23")
    return sqlite3.connect(f"file:{name}?{options}", uri=True, timeout=_BUSY, isolation_level=None, check_same_thread=False)


def _probe(connection: sqlite3.Connection) -> sqlite3.Connection:
    try:
        connection.execute("PRAGMA schema_version").fetchone()
        connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
    except BaseException:
        connection.close()
        raise
    return connection


def _look(path: Path) -> None:
    """Refuse what is not there, is no SQLite file, or is cut short."""
    try:
        if path.is_dir():
            raise ValueError("it is a directory, expected the file of a catalogue")
        if is_special(path):
            raise ValueError("it is a pipe or a device, expected the file of a catalogue")
        with path.open("rb") as file:
            head = file.read(100)
        size = path.stat().st_size
    except FileNotFoundError as error:
        raise CatalogueError(f"there is no catalogue {path}") from error
    except (OSError, ValueError) as error:
        said = reason(error) if isinstance(error, OSError) else str(error)
        raise CatalogueError(f"cannot read {path}: {said}") from error
    log = path.with_name(path.name + "-wal")
    logged = log.exists() and log.stat().st_size > 0
    if size == 0:
        if logged:
            return
        raise CatalogueError(f"{path} is no catalogue: it is empty")
    if not head.startswith(SQLITE):
        raise CatalogueError(f"{path} is no catalogue: it is no SQLite file")
    if len(head) < 100:
        raise CatalogueDamaged(f"{path} is damaged: it is cut short, {size} bytes are left of its head")
    page = int.from_bytes(head[16:18], "big")
    page = 65536 if page == 1 else page
    pages = int.from_bytes(head[28:32], "big")
    # The count of pages holds where it was written together with the change counter.
    if head[24:28] == head[92:96] and size < page * pages and not logged:
        raise CatalogueDamaged(f"{path} is damaged: it is cut short, {size} of {page * pages} bytes are left")
