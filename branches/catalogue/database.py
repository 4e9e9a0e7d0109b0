"""The SQLite file of a catalogue: connections, tables, one writer at a time, and errors as messages for the user.

``docs/reference/catalogue.md`` describes every column. Columns of numbers have no declared type, so SQLite keeps every float64 as it is,
also the sign of a zero. NaN is stored as NULL.
"""

from __future__ import annotations

import os
import re
import sqlite3
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from branches.files import WriteFailure, is_special, reason
from bvp.texts import shown

__all__ = [
    "KEYED", "SCHEMA", "CatalogueDamaged", "CatalogueError", "CatalogueInUse", "WriterLock", "add_table", "checksum", "close_settled",
    "create_tables", "log_commits", "not_taken", "open_to_read", "open_to_write", "readable", "refuse_special", "schema_of", "translated",
]  # fmt: skip


class CatalogueError(ValueError):
    """A file that cannot be used as a catalogue, or a wrong argument."""


class CatalogueDamaged(CatalogueError):
    """A part of a catalogue cannot be trusted. The message names the part."""


class CatalogueInUse(CatalogueError):
    """Another process writes the catalogue. The message names the process."""


_MESSAGES: tuple[tuple[str, type[Exception], str], ...] = (
    ("SQLITE_FULL", WriteFailure, "cannot write {path}: no space is left on the device; what it held is complete"),
    ("SQLITE_READONLY", WriteFailure, "cannot write {path}: it, or its directory, is read-only"),
    ("SQLITE_(BUSY|LOCKED)", CatalogueInUse, "{path} is being read or written by another program; try again when it has finished"),
    (
        "SQLITE_IOERR_(WRITE|FSYNC|TRUNCATE|SHMSIZE)",
        WriteFailure,
        "cannot write {path}: the system refused to write it, or the files -wal and -shm beside it{limit}; what it held is complete",
    ),
    ("SQLITE_NOTADB", CatalogueDamaged, "{path} is not a catalogue: it is not an SQLite file"),
    ("SQLITE_CANTOPEN", CatalogueError, "cannot open {path}, or the files -wal and -shm beside it"),
    ("SQLITE_CONSTRAINT", CatalogueDamaged, "{path} is damaged: {error}"),
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
    """Report SQLite's errors at a file in terms of the user: `CatalogueError` or `CatalogueDamaged` if it cannot be read, `WriteFailure` if
    it cannot be written. It keeps its contents then."""
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


_held: dict[str, int] = {}
"""Locks by path, with the number of the process that holds them. The system's locks belong to a process and would admit it twice. A forked
process has a copy of this, but none of the locks."""


class WriterLock:
    """Hold FILE.lock while FILE is written.

    A record lock (`fcntl.lockf`) belongs to a process and ends with it, also if it is killed. Forked workers do not inherit it. So a file
    that a killed process left behind locks nothing.

    Parameters
    ----------
    path : Path
        The file that will be written.

    Raises
    ------
    CatalogueInUse
        Naming the process that writes it: its number, host, and since when.
    WriteFailure
        If the directory cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self._path = path.with_name(path.name + ".lock")
        self._process = os.getpid()
        key = str(self._path)
        if _held.get(key) == self._process:
            raise CatalogueInUse(f"{path} is being written by this very process ({self._process})")
        while True:
            try:
                # Not truncated: its note may name the writer.
                self._file = os.open(self._path, os.O_RDWR | os.O_CREAT | getattr(os, "O_CLOEXEC", 0), 0o666)
            except OSError as error:
                raise WriteFailure(f"cannot write {path}: {reason(error)}") from error
            try:
                _lock(self._file)
            except OSError:
                holder = _holder(self._file)
                os.close(self._file)
                raise CatalogueInUse(f"{path} is being written by {holder}; expected one writer at a time") from None
            # The last holder may have removed the file between the two calls. Then another file counts.
            if _same(self._file, self._path):
                break
            os.close(self._file)
        import datetime
        import socket

        since = datetime.datetime.now().astimezone().isoformat(timespec="seconds")
        with suppress(OSError):  # A full disk cannot take the note. The lock holds without it.
            os.ftruncate(self._file, 0)
            os.lseek(self._file, 0, os.SEEK_SET)
            os.write(self._file, f"process {self._process} on {socket.gethostname()} since {since}".encode())
        _held[key] = self._process

    def release(self) -> None:
        """Release the lock. A process that was forked from the holder's does nothing."""
        if self._file < 0 or os.getpid() != self._process:
            return
        self._path.unlink(missing_ok=True)
        os.close(self._file)
        self._file = -1
        _held.pop(str(self._path), None)


def _lock(file: int) -> None:
    try:
        import fcntl
    except ImportError:  # Windows
        import msvcrt

        # Far behind the note, so that it can be read.
        os.lseek(file, 1 << 20, os.SEEK_SET)
        msvcrt.locking(file, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
    else:
        fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _same(file: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(file), os.stat(path))
    except FileNotFoundError:
        return False


def _holder(file: int) -> str:
    """The holder of the lock, as the note names it."""
    try:
        os.lseek(file, 0, os.SEEK_SET)
        return os.read(file, 4096).decode() or "another process"
    except (ValueError, OSError):
        return "another process"


SCHEMA = 3
"""SQLite's user_version of a catalogue."""

APPLICATION = int.from_bytes(b"SLTS", "big")
"""SQLite's application_id of a catalogue."""

KEYED = ("scene", "provenance", "work", "progress", "counts")
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
    "curves": """id TEXT PRIMARY KEY, code TEXT NOT NULL, first TEXT NOT NULL, second TEXT NOT NULL, first_low, first_high, second_low,
        second_high, points INTEGER NOT NULL, events INTEGER NOT NULL, details TEXT NOT NULL, npz BLOB NOT NULL, crc INTEGER NOT NULL)""",
    "edges": """source TEXT NOT NULL, source_event TEXT NOT NULL, type TEXT NOT NULL, kind TEXT NOT NULL, target TEXT NOT NULL,
        target_event TEXT NOT NULL, h, alpha, stop TEXT, note TEXT, source_orbit TEXT, target_orbit TEXT, crc INTEGER NOT NULL,
        PRIMARY KEY (source, source_event, kind, target, target_event)) WITHOUT ROWID""",
}

_LATER = ("curves",)
"""Tables that an older file of this schema can lack. They are made when they are needed."""


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


def add_table(connection: sqlite3.Connection, name: str) -> None:
    """Make a table that an older file lacks, in the open transaction."""
    connection.execute(f"CREATE TABLE IF NOT EXISTS {name} ({_TABLES[name]}")


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
        raise CatalogueError(f"{path} is not a catalogue: it is an SQLite file of something else")
    schema = int(connection.execute("PRAGMA user_version").fetchone()[0])
    if schema > SCHEMA:
        raise CatalogueError(f"{path} is a catalogue of schema {schema}; this saltus reads up to {SCHEMA}: install a later saltus")
    if schema < SCHEMA:
        raise CatalogueError(f"{path} is a catalogue of schema {schema}; this saltus reads {SCHEMA}: build it again")
    missing = set(_TABLES) - {*_LATER} - tables
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
        kind = "a directory" if path.is_dir() else "a pipe" if path.is_fifo() else "a device"
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
    """A connection for the one writer, which changes nothing before `log_commits`. An empty file is made if there is none.

    Raises
    ------
    CatalogueError, WriteFailure
    """
    with translated(path):
        return _connect(path, "mode=rwc", "PRAGMA foreign_keys = ON")


def log_commits(connection: sqlite3.Connection) -> None:
    """Write commits to a log beside the file: readers need not wait, and a killed process loses nothing that was committed.

    This changes bytes of the file, so the caller makes sure before that the file is a catalogue of its system.
    """
    connection.execute("PRAGMA journal_mode = WAL").fetchone()
    connection.execute("PRAGMA synchronous = NORMAL")


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
