"""The tables of a catalogue. ``docs/catalogue.md`` says what each column means.

Columns of numbers have no declared type: SQLite then keeps every float64 as it is, the sign of a zero too. NaN is stored as NULL.
A family's points stand in consecutive rows, so that they are found without an index; what is not asked for in queries stands in one row
for all of them (see `branches.catalogue.points`).
"""

from __future__ import annotations

import sqlite3
from pathlib import Path

from branches.catalogue.errors import CatalogueDamaged, CatalogueError

__all__ = ["APPLICATION", "SCHEMA", "create", "has_checksums", "is_empty", "require"]

SCHEMA = 2
"""Schema 1, with all numbers of a point in its row, was never released: nothing is migrated."""

APPLICATION = int.from_bytes(b"SLTS", "big")
"""SQLite's application_id of a catalogue."""

_TABLES = """
CREATE TABLE scene (key TEXT PRIMARY KEY, value TEXT NOT NULL, crc INTEGER NOT NULL) WITHOUT ROWID;
CREATE TABLE provenance (key TEXT PRIMARY KEY, value TEXT NOT NULL, crc INTEGER NOT NULL) WITHOUT ROWID;
CREATE TABLE families (
    number INTEGER PRIMARY KEY, id TEXT NOT NULL UNIQUE, label TEXT NOT NULL, ends TEXT NOT NULL, word TEXT NOT NULL, impacts NOT NULL,
    h_low, h_high, alpha_low, alpha_high, points INTEGER NOT NULL, events INTEGER NOT NULL, start INTEGER NOT NULL,
    stable_fraction, label_names TEXT NOT NULL, details TEXT NOT NULL,
    first_point INTEGER NOT NULL, columns_crc INTEGER NOT NULL, crc INTEGER NOT NULL);
CREATE TABLE points (
    number INTEGER PRIMARY KEY, family INTEGER NOT NULL, h, alpha, arclength, tau, stable INTEGER, label TEXT);
CREATE TABLE blobs (
    family INTEGER PRIMARY KEY, states BLOB NOT NULL, states_crc INTEGER NOT NULL, multipliers BLOB NOT NULL,
    multipliers_crc INTEGER NOT NULL, others BLOB NOT NULL, others_crc INTEGER NOT NULL);
CREATE TABLE events (
    family INTEGER NOT NULL, position INTEGER NOT NULL, id TEXT NOT NULL, type TEXT NOT NULL, point INTEGER NOT NULL,
    number INTEGER NOT NULL, h, alpha, arclength, status TEXT NOT NULL, bracket_low, bracket_high, residual, label TEXT NOT NULL,
    stop TEXT, p INTEGER, q INTEGER, breaks TEXT, note TEXT, stable INTEGER, multiplier, more TEXT, crc INTEGER NOT NULL,
    PRIMARY KEY (family, position)) WITHOUT ROWID;
CREATE TABLE nodes (
    id TEXT PRIMARY KEY, kind TEXT NOT NULL, label TEXT NOT NULL, h_low, h_high, alpha, note TEXT NOT NULL, crc INTEGER NOT NULL)
    WITHOUT ROWID;
CREATE TABLE edges (
    number INTEGER PRIMARY KEY, source TEXT NOT NULL, source_event TEXT NOT NULL, type TEXT NOT NULL, kind TEXT NOT NULL,
    target TEXT NOT NULL, target_event TEXT NOT NULL, h, alpha, stop TEXT, note TEXT, source_problem TEXT, source_states BLOB,
    source_crc INTEGER, target_problem TEXT, target_states BLOB, target_crc INTEGER, crc INTEGER NOT NULL,
    UNIQUE (source, source_event, kind, target, target_event));
CREATE INDEX edges_to ON edges (target);
CREATE TABLE work (key TEXT PRIMARY KEY, payload TEXT NOT NULL, crc INTEGER) WITHOUT ROWID;
CREATE TABLE progress (key TEXT PRIMARY KEY, value TEXT NOT NULL, crc INTEGER) WITHOUT ROWID;
"""


def create(connection: sqlite3.Connection) -> None:
    """Make the tables, in the transaction that is open."""
    for statement in _TABLES.split(";"):
        if statement.strip():
            connection.execute(statement)
    connection.execute(f"PRAGMA application_id = {APPLICATION}")
    connection.execute(f"PRAGMA user_version = {SCHEMA}")


def is_empty(connection: sqlite3.Connection) -> bool:
    """Whether the file holds no table at all: a new one, or one whose making was cut short."""
    return connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0] == 0


def has_checksums(connection: sqlite3.Connection, table: str) -> bool:
    """Whether the rows of a table have checksums: those of `work` and `progress` have none in a catalogue from before they were given."""
    return any(column[1] == "crc" for column in connection.execute(f"PRAGMA table_info({table})"))


def require(connection: sqlite3.Connection, path: Path) -> None:
    """Refuse a file of another kind or schema.

    Raises
    ------
    CatalogueError
    """
    if is_empty(connection):
        raise CatalogueError(f"{path} is no catalogue: it is empty")
    if connection.execute("PRAGMA application_id").fetchone()[0] != APPLICATION:
        raise CatalogueError(f"{path} is no catalogue: it is an SQLite file of something else")
    version = connection.execute("PRAGMA user_version").fetchone()[0]
    if version > SCHEMA:
        raise CatalogueError(
            f"{path} is a catalogue of schema {version}, of a later saltus; this one reads schema {SCHEMA}: expected that later version"
        )
    if version < SCHEMA:
        raise CatalogueError(
            f"{path} is a catalogue of schema {version}, from before the first release; this saltus reads schema {SCHEMA}: build it again"
        )
    missing = _names() - {name for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    if missing:
        raise CatalogueDamaged(f"{path} is damaged: it has no table {sorted(missing)[0]}")


def _names() -> set[str]:
    return {statement.split()[2] for statement in _TABLES.split(";") if statement.split()[:2] == ["CREATE", "TABLE"]}
