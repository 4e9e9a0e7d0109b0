"""Connections to the SQLite file of a catalogue, and its tables.

``docs/reference/catalogue.md`` describes every column. Columns of numbers have no declared type, so SQLite keeps every float64 as it is, also the
sign of a zero. NaN is stored as NULL.
"""

from __future__ import annotations

import os
import sqlite3
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from branches.catalogue.errors import CatalogueDamaged, CatalogueError, translated
from branches.files import is_special

__all__ = ["KEYED", "SCHEMA", "checksum", "close_settled", "create_tables", "open_to_read", "open_to_write", "refuse_special", "schema_of"]

SCHEMA = 3
"""SQLite's user_version of a catalogue."""

APPLICATION = int.from_bytes(b"SLTS", "big")
"""SQLite's application_id of a catalogue."""

KEYED = ("scene", "provenance", "work", "progress")
"""Tables of JSON values by key."""

_BUSY = 5.0
"""Seconds to wait for another reader or writer of the file."""

_FREE = 0.1
"""Largest fraction of unused pages in a closed file."""

_TABLES = {
    **dict.fromkeys(KEYED, "key TEXT PRIMARY KEY, value TEXT NOT NULL, crc INTEGER NOT NULL) WITHOUT ROWID"),
    "families": """number INTEGER PRIMARY KEY, id TEXT NOT NULL UNIQUE, label TEXT NOT NULL, ends TEXT NOT NULL, sequence TEXT NOT NULL,
        impacts NOT NULL, h_low, h_high, alpha_low, alpha_high, points INTEGER NOT NULL, events INTEGER NOT NULL, start INTEGER NOT NULL,
        stable_fraction, names TEXT NOT NULL, details TEXT NOT NULL, crc INTEGER NOT NULL)""",
    "points": """family INTEGER NOT NULL REFERENCES families ON DELETE CASCADE, position INTEGER NOT NULL, h, alpha, arclength, tau,
        stable INTEGER, label TEXT, PRIMARY KEY (family, position)) WITHOUT ROWID""",
    "arrays": """family INTEGER PRIMARY KEY REFERENCES families ON DELETE CASCADE, npz BLOB NOT NULL, crc INTEGER NOT NULL)""",
    "events": """family INTEGER NOT NULL REFERENCES families ON DELETE CASCADE, position INTEGER NOT NULL, id TEXT NOT NULL,
        type TEXT NOT NULL, point INTEGER NOT NULL, number INTEGER NOT NULL, h, alpha, arclength, status TEXT NOT NULL, bracket_low,
        bracket_high, residual, label TEXT NOT NULL, stop TEXT, p INTEGER, q INTEGER, breaks TEXT, note TEXT, stable INTEGER, multiplier,
        crc INTEGER NOT NULL, PRIMARY KEY (family, position)) WITHOUT ROWID""",
    "nodes": """id TEXT PRIMARY KEY, kind TEXT NOT NULL, label TEXT NOT NULL, h_low, h_high, alpha, note TEXT NOT NULL,
        crc INTEGER NOT NULL) WITHOUT ROWID""",
    "edges": """source TEXT NOT NULL, source_event TEXT NOT NULL, type TEXT NOT NULL, kind TEXT NOT NULL, target TEXT NOT NULL,
        target_event TEXT NOT NULL, h, alpha, stop TEXT, note TEXT, source_orbit TEXT, target_orbit TEXT, crc INTEGER NOT NULL,
        PRIMARY KEY (source, source_event, kind, target, target_event)) WITHOUT ROWID""",
}


def checksum(values: Sequence[Any]) -> int:
    """CRC32 of a row's values.

    Examples
    --------
    >>> checksum(("L11+", 0.5, None)) == checksum(["L11+", 0.5, None]), checksum((0.0,)) == checksum((-0.0,))
    (True, False)
    """
    return zlib.crc32(repr(tuple(values)).encode())


def create_tables(connection: sqlite3.Connection) -> None:
    """Make the tables in the open transaction."""
    for name, columns in _TABLES.items():
        connection.execute(f"CREATE TABLE {name} ({columns}")
    connection.execute(f"PRAGMA application_id = {APPLICATION}")
    connection.execute(f"PRAGMA user_version = {SCHEMA}")


def schema_of(connection: sqlite3.Connection, path: Path) -> int | None:
    """The schema of a catalogue; None for an empty file.

    Raises
    ------
    CatalogueError
        For a file of something else, or of a schema that this version cannot read.
    """
    tables = {name for (name,) in connection.execute("SELECT name FROM main.sqlite_master WHERE type = 'table'")}
    if not tables:
        return None
    if connection.execute("PRAGMA application_id").fetchone()[0] != APPLICATION:
        raise CatalogueError(f"{path} is no catalogue: it is an SQLite file of something else")
    schema = int(connection.execute("PRAGMA user_version").fetchone()[0])
    if schema > SCHEMA:
        raise CatalogueError(f"{path} is a catalogue of schema {schema}; this saltus reads up to {SCHEMA}: install a later saltus")
    if schema < SCHEMA - 1:
        raise CatalogueError(f"{path} is a catalogue of schema {schema}; this saltus reads {SCHEMA - 1} and {SCHEMA}: build it again")
    missing = set(_TABLES) - tables if schema == SCHEMA else set()
    if missing:
        raise CatalogueDamaged(f"{path} is damaged: it has no table {min(missing)}")
    return schema


def refuse_special(path: Path, verb: str) -> None:
    """Refuse a directory, a pipe or a device, on which SQLite would fail or wait without end.

    Raises
    ------
    CatalogueError
    """
    if path.is_dir() or is_special(path):
        kind = "a directory" if path.is_dir() else "a device or a pipe"
        raise CatalogueError(f"cannot {verb} {path}: it is {kind}, expected the file of a catalogue")


def open_to_read(path: Path) -> sqlite3.Connection:
    """A connection that adds nothing. SQLite recovers what a killed writer committed and removes what it left unfinished.

    Raises
    ------
    CatalogueError
        For a file that does not exist, cannot be read, or is no SQLite file.
    """
    refuse_special(path, "read")
    if not path.exists():
        raise CatalogueError(f"there is no catalogue {path}")
    if not os.access(path, os.R_OK):
        raise CatalogueError(f"cannot read {path}: permission is denied")
    with translated(path):
        if os.access(path, os.W_OK) and os.access(path.parent, os.W_OK):
            return _connect(path, "mode=rw", "PRAGMA query_only = ON")
        try:
            return _connect(path, "mode=ro")
        except sqlite3.OperationalError as error:
            beside = [path.with_name(path.name + ending) for ending in ("-wal", "-journal")]
            left = [file.name for file in beside if file.exists() and file.stat().st_size]
            if left:
                text = f"cannot read {path}: {left[0]} beside it holds families that a killed writer left"
                raise CatalogueError(f"{text}; open it once where it can be written") from error
            # A read-only medium: nothing can be written beside the file, and nothing will change it.
            return _connect(path, "mode=ro&immutable=1")


def open_to_write(path: Path) -> sqlite3.Connection:
    """A connection for the one writer. The file is made if it does not exist.

    A file of something else or of another schema stays as it is.

    Raises
    ------
    CatalogueError, WriteFailure
    """
    with translated(path):
        connection = _connect(path, "mode=rwc", "PRAGMA foreign_keys = ON")
        try:
            if schema_of(connection, path) in (None, SCHEMA):
                # Commits go to a log beside the file: readers need not wait, and a killed process loses nothing that was committed.
                connection.execute("PRAGMA journal_mode = WAL").fetchone()
                connection.execute("PRAGMA synchronous = NORMAL")
        except BaseException:
            connection.close()
            raise
    return connection


def close_settled(connection: sqlite3.Connection) -> None:
    """Close a writer's connection and leave one file without much unused space. If a reader or a full disk prevents this, committed data
    stay in the log beside the file."""
    try:
        connection.execute("PRAGMA journal_mode = DELETE").fetchone()
        free, pages = (connection.execute(f"PRAGMA {name}").fetchone()[0] for name in ("freelist_count", "page_count"))
        if free > _FREE * pages:
            connection.execute("VACUUM")
    except sqlite3.Error:
        pass
    connection.close()


def _connect(path: Path, options: str, *pragmas: str) -> sqlite3.Connection:
    # Escape what has a meaning in a URI.
    name = str(path).replace("%", "%25").replace("?", "%3f").replace("#", "%23")
    connection = sqlite3.connect(f"file:{name}?{options}", uri=True, timeout=_BUSY, isolation_level=None, check_same_thread=False)
    try:
        for pragma in pragmas:
            connection.execute(pragma)
        # SQLite opens the file at the first statement.
        connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
    except BaseException:
        connection.close()
        raise
    return connection
