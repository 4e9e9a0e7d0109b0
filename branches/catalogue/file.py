"""The file of a catalogue: opened to read or to write, changed in whole transactions, every row compared with its checksum."""

from __future__ import annotations

import json
import os
import sqlite3
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from branches.catalogue import schema
from branches.catalogue.errors import CatalogueDamaged, CatalogueError, not_taken, translated
from branches.catalogue.lock import WriterLock
from branches.catalogue.opening import open_settled, open_to_read, open_to_write, settle
from branches.catalogue.rows import crc_of
from branches.catalogue.scene import SceneRecord, difference
from branches.files import WriteFailure
from bvp.shown import shown

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["COUNTED", "CatalogueFile"]

COUNTED = ("families", "nodes", "edges", "work", "progress")
"""Tables whose rows are counted in the transaction that changes them, for nothing else in the file would tell of a row that is gone."""


class CatalogueFile:
    """What `branches.catalogue.store.Catalogue` is as a file; its parameters and errors are described there."""

    def __init__(
        self, path: str | os.PathLike[str], mode: str = "r", *, scene: Any = None, provenance: Mapping[str, Any] | None = None
    ) -> None:
        if mode not in ("r", "a"):
            raise ValueError(f"the mode of a catalogue is {shown(mode)}, expected r (read) or a (add)")
        if not isinstance(path, str | os.PathLike):
            raise not_taken("a catalogue is the name of a file", path)
        self.path = Path(path)
        self._lock: WriterLock | None = None
        self._depth = 0
        self._process = os.getpid()
        record = None if scene is None else SceneRecord.of(scene)
        if mode == "a":
            self.path = Path(os.path.realpath(path))
            if self.path.exists() and not self.path.is_file():
                kind = "a directory" if self.path.is_dir() else "a device or a pipe"
                raise CatalogueError(f"cannot write {path}: it is {kind}, expected the file of a catalogue")
            self._lock = WriterLock(self.path)
        try:
            if mode == "a":
                self._look_before_writing()
            self._connection = open_to_write(self.path) if mode == "a" else open_to_read(self.path)
        except BaseException:
            if self._lock is not None:
                self._lock.release()
            raise
        try:
            with translated(self.path):
                if mode == "a" and schema.is_empty(self._connection):
                    self._make(record, dict(provenance or {}))
                schema.require(self._connection, self.path)
                if mode == "a":
                    self._add_checksums()
            if record is not None:
                self.require_system(record.system)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        with translated(self.path):
            _ = self._connection.total_changes  # refused where it is closed
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Leave one single file behind. A process that was forked from the writer's does nothing."""
        if os.getpid() != self._process:
            return
        self._changed()
        if self._lock is None:
            self._connection.close()
            return
        settle(self._connection)
        self._lock.release()

    @cached_property
    def scene(self) -> SceneRecord:
        """The scene that it belongs to."""
        names = [field.name for field in fields(SceneRecord)]
        kept = self._whole("scene", names)
        return SceneRecord(**{name: kept[name] for name in names})

    @cached_property
    def provenance(self) -> dict[str, Any]:
        """Versions and settings that it was made with."""
        return self._whole("provenance", ["created", "schema", "versions"])

    @cached_property
    def system(self) -> ImpactSystem:
        """The system of its families."""
        from bvp.system import ImpactSystem

        return ImpactSystem.from_description(self.scene.system)

    def require_system(self, system: Mapping[str, Any]) -> None:
        """Refuse another system than that of the catalogue, given as it describes itself.

        Raises
        ------
        CatalogueError
            Naming what differs.
        """
        told = difference(self.scene.system, system)
        if told is not None:
            raise CatalogueError(f"{self.path} belongs to another system: there {told}")

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """All that is added in the block is kept together, or nothing of it."""
        self._writable()
        with translated(self.path):
            if self._depth == 0:
                self._connection.execute("BEGIN IMMEDIATE")
            elif not self._connection.in_transaction:
                raise WriteFailure(f"cannot write {self.path}: an earlier failure has taken the transaction back")
            self._depth += 1
            try:
                yield
                if self._depth == 1:
                    if not self._connection.in_transaction:
                        raise WriteFailure(f"cannot write {self.path}: an earlier failure has taken the transaction back")
                    self._connection.execute("COMMIT")
            except BaseException:
                if self._depth == 1 and self._connection.in_transaction:
                    self._connection.execute("ROLLBACK")
                raise
            finally:
                self._depth -= 1
                self._changed()

    # -- inside ---------------------------------------------------------------------------------------------------------------

    def _make(self, scene: SceneRecord | None, provenance: dict[str, Any]) -> None:
        import datetime

        from branches.catalogue.provenance import versions

        if scene is None:
            raise CatalogueError(f"there is no catalogue {self.path}; expected a scene to make one for")
        created = datetime.datetime.now().astimezone().isoformat(timespec="seconds")
        made = {"created": created, "schema": schema.SCHEMA, "versions": versions(), **provenance}
        with self.transaction():
            schema.create(self._connection)
            for table, content in (("scene", vars(scene) | {"rows": dict.fromkeys(COUNTED, 0)}), ("provenance", made)):
                for key, value in content.items():
                    row = (key, json.dumps(value, allow_nan=False))
                    self._insert(table, ("key", "value"), row, crc_of(row))

    def _add_checksums(self) -> None:
        """Give the rows of a catalogue from before all tables had checksums theirs."""
        for table, value in (("work", "payload"), ("progress", "value")):
            if schema.has_checksums(self._connection, table):
                continue
            with self.transaction():
                self._connection.execute(f"ALTER TABLE {table} ADD COLUMN crc INTEGER")
                rows = self._connection.execute(f"SELECT key, {value} FROM {table}").fetchall()
                self._connection.executemany(f"UPDATE {table} SET crc = ? WHERE key = ?", ((crc_of(row), row[0]) for row in rows))
                self._count(table, len(rows))

    def _look_before_writing(self) -> None:
        """Refuse a file of another kind or schema while it is as it was: opening it to write already changes it."""
        connection = open_settled(self.path)
        if connection is None:
            return
        try:
            with translated(self.path):
                if not schema.is_empty(connection):
                    schema.require(connection, self.path)
        finally:
            connection.close()

    def _changed(self) -> None:
        """Forget what was read before a transaction, or before it was closed."""

    def _writable(self) -> None:
        if self._lock is None:
            raise CatalogueError(f"{self.path} was opened to read, expected mode a to add to it")
        if os.getpid() != self._process:
            raise CatalogueError(f"{self.path} is written by process {self._process}, not by this one, which was forked from it")

    def _select(self, table: str, columns: tuple[str, ...], rest: str = "", values: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
        """Rows of a table, each with its checksum behind it where the table has one."""
        with translated(self.path):
            crc = ", crc" if table in COUNTED and len(columns) > 1 and schema.has_checksums(self._connection, table) else ""
            return self._connection.execute(f"SELECT {', '.join(columns)}{crc} FROM {table} {rest}", values).fetchall()

    def _table(self, table: str) -> dict[str, Any]:
        with translated(self.path):
            rows = self._connection.execute(f"SELECT key, value, crc FROM {table}").fetchall()
        return {key: json.loads(value) for key, value in (self._checked(row, f"{row[0]} in the table {table}") for row in rows)}

    def _whole(self, table: str, keys: Iterable[str]) -> dict[str, Any]:
        """What a table by key holds, where none of the keys lacks."""
        kept = self._table(table)
        missing = [key for key in keys if key not in kept]
        if missing:
            raise CatalogueDamaged(f"{self.path} is damaged: {missing[0]} is missing in the table {table}")
        return kept

    def _rows(self) -> dict[str, int]:
        """How many rows each of the tables `COUNTED` was given; nothing of a catalogue from before they were counted."""
        with translated(self.path):
            row = self._connection.execute("SELECT key, value, crc FROM scene WHERE key = 'rows'").fetchone()
        return {} if row is None else dict(json.loads(self._checked(row, "rows in the table scene")[1]))

    def _checked(self, values: Iterable[Any], what: str) -> tuple[Any, ...]:
        """A row's values without the checksum at their end.

        Raises
        ------
        CatalogueDamaged
            Where it does not fit.
        """
        *kept, crc = values
        if crc_of(tuple(kept)) != crc:
            raise CatalogueDamaged(f"{self.path} is damaged: {what} does not fit its checksum")
        return tuple(kept)

    def _insert(self, table: str, columns: tuple[str, ...], values: tuple[Any, ...], crc: int, ignore: bool = False) -> None:
        marks = ", ".join("?" * (len(columns) + 1))
        verb = "INSERT OR IGNORE" if ignore else "INSERT"
        self._change(table, f"{verb} INTO {table} ({', '.join(columns)}, crc) VALUES ({marks})", (*values, crc), 1)

    def _delete(self, table: str, where: str, values: tuple[Any, ...]) -> None:
        self._change(table, f"DELETE FROM {table} WHERE {where}", values, -1)

    def _change(self, table: str, statement: str, values: tuple[Any, ...], sign: int) -> None:
        """Add or take away rows of a table, in the transaction that is open, and count them."""
        try:
            changed = self._connection.execute(statement, values).rowcount
        except sqlite3.IntegrityError as error:
            raise CatalogueError(f"{self.path}: {error}") from error
        self._count(table, sign * changed)

    def _count(self, table: str, change: int) -> None:
        """Note that a table has so many rows more, in the transaction that is open."""
        if table in COUNTED and change and (rows := self._rows()):
            rows[table] = rows.get(table, 0) + change
            row = ("rows", json.dumps(rows))
            self._connection.execute("UPDATE scene SET value = ?, crc = ? WHERE key = ?", (row[1], crc_of(row), row[0]))
