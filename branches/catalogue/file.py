"""The SQLite file of a catalogue: opening, transactions, and rows with checksums."""

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

from branches.catalogue.database import (
    KEYED,
    SCHEMA,
    CatalogueDamaged,
    CatalogueError,
    WriterLock,
    checksum,
    close_settled,
    create_tables,
    log_commits,
    not_taken,
    open_to_read,
    open_to_write,
    refuse_special,
    schema_of,
    translated,
)
from branches.catalogue.rows import SceneRecord, difference
from branches.files import WriteFailure
from bvp.texts import shown

if TYPE_CHECKING:
    from bvp.parameters import ParametricSystem
    from bvp.system import ImpactSystem

__all__ = ["CatalogueFile"]

_LIBRARIES = ("saltus", "numpy", "scipy", "numba", "networkx")


class CatalogueFile:
    """The file of a `branches.catalogue.Catalogue`, which describes parameters and errors."""

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
        if mode == "r":
            self._connection = open_to_read(self.path)
        else:
            self.path = Path(os.path.realpath(path))
            existed = self.path.exists()
            self._connection = self._open_to_write(record)
        try:
            with translated(self.path):
                schema = schema_of(self._connection, self.path)
                if schema is None and mode == "a":
                    self._make(record, dict(provenance or {}))
                elif schema is None:
                    raise CatalogueError(f"{self.path} is not a catalogue: it is empty")
            if record is not None:
                self.require_system(record.system)
            if record is not None and record.parameters:
                self.require_parameters(record.parameters)
            if self._lock is not None:
                with translated(self.path):
                    log_commits(self._connection)
        except BaseException:
            # A file that is refused stays as it is. One that could not be filled, on a full disk, is not left.
            self._connection.close()
            if mode == "a" and not existed and self.path.exists() and not self.path.stat().st_size:
                self.path.unlink()
            if self._lock is not None:
                self._lock.release()
            raise

    def __enter__(self) -> Self:
        with translated(self.path):
            _ = self._connection.total_changes  # fails if it is closed
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Leave one single file. A process that was forked from the writer's does nothing."""
        if os.getpid() != self._process:
            return
        self._changed()
        if self._lock is None:
            self._connection.close()
            return
        close_settled(self._connection)
        self._lock.release()

    @cached_property
    def scene(self) -> SceneRecord:
        """The scene that it belongs to."""
        # Only a catalogue of forced responses has parameters.
        required = [field.name for field in fields(SceneRecord) if field.name != "parameters"]
        return SceneRecord(**self._values("scene", required))

    @cached_property
    def provenance(self) -> dict[str, Any]:
        """Versions and settings that it was made with."""
        return self._values("provenance", ["created", "schema", "versions"])

    @cached_property
    def system(self) -> ImpactSystem:
        """The system of its families."""
        from bvp.system import ImpactSystem

        return self.parametric.system() if self.scene.parameters else ImpactSystem.from_description(self.scene.system)

    @cached_property
    def parametric(self) -> ParametricSystem:
        """The system and the loads of a catalogue of forced responses, as functions of parameters."""
        from bvp.parameters import ParametricSystem

        return ParametricSystem.from_description(self.scene.system)

    def require_system(self, system: Mapping[str, Any]) -> None:
        """Refuse another system than that of the catalogue.

        Parameters
        ----------
        system : mapping
            As `ImpactSystem.describe` gives it; in a catalogue of forced responses as `ParametricSystem.describe` does. There the values of
            the parameters that vary do not count.

        Raises
        ------
        CatalogueError
            With the differences.
        """
        own = self.scene
        if own.parameters and "system" in system:
            system = self._at_own_values(system)
        elif own.parameters or "system" in system:
            other = "families in the energy" if own.parameters else "families in a parameter"
            raise CatalogueError(f"{self.path} holds {own.held}, and no {other}; expected another catalogue")
        differs = difference(own.system, system)
        if differs is not None:
            raise CatalogueError(f"{self.path} belongs to another system: there {differs}")

    def require_parameters(self, parameters: Mapping[str, Any]) -> None:
        """Refuse forced families in other parameters, or with other equations, than those of the catalogue: ``names`` and ``keep``."""
        own = self.scene.parameters
        if any([text.replace(" ", "") for text in own[key]] != [text.replace(" ", "") for text in parameters[key]] for key in own):
            held, other = (", ".join([*found["names"], *found["keep"]]) for found in (own, parameters))
            what = self.scene.held.partition(" in ")[0]
            raise CatalogueError(f"{self.path} holds {what} in {held}; received one in {other}, expected another catalogue for it")

    def _at_own_values(self, system: Mapping[str, Any]) -> dict[str, Any]:
        """A description with this catalogue's values of the parameters that vary."""
        from bvp.parameters import ParametricSystem

        given, names = ParametricSystem.from_description(system), self.scene.parameters["names"]
        if not set(names) <= set(given.names):
            return dict(system)
        at = given.replaced({name: self.parametric.values[name] for name in names})
        plain: dict[str, Any] = json.loads(json.dumps(at.describe()))
        return plain

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """Commit everything that the block adds, or nothing of it."""
        self._writable()
        with translated(self.path):
            if self._depth == 0:
                self._connection.execute("BEGIN IMMEDIATE")
            self._depth += 1
            try:
                self._require_transaction()
                yield
                if self._depth == 1:
                    self._require_transaction()
                    self._connection.execute("COMMIT")
            except BaseException:
                if self._depth == 1 and self._connection.in_transaction:
                    self._connection.execute("ROLLBACK")
                raise
            finally:
                self._depth -= 1
                self._changed()

    # -- rows -----------------------------------------------------------------------------------------------------------------

    def _select(self, statement: str, values: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
        with translated(self.path):
            return self._connection.execute(statement, values).fetchall()

    def _rows(self, table: str, rest: str = "", values: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
        """Rows of a table, without their checksums.

        Raises
        ------
        CatalogueDamaged
            If a row does not fit its checksum.
        """
        for row in self._select(f"SELECT * FROM {table} {rest}", values):
            yield self._checked(table, row)

    def _checked(self, table: str, row: tuple[Any, ...]) -> tuple[Any, ...]:
        if checksum(row[:-1]) != row[-1]:
            what = row[0] if table in KEYED else " ".join(str(value) for value in row[:3])
            raise CatalogueDamaged(f"{self.path} is damaged: the row {what!r} of the table {table} does not fit its checksum")
        return row[:-1]

    def _values(self, table: str, required: Iterable[str] = ()) -> dict[str, Any]:
        """The JSON values of a table by key.

        Raises
        ------
        CatalogueDamaged
            If a required key is missing.
        """
        values = {key: self._parsed(table, key, text) for key, text in self._rows(table)}
        for key in required:
            if key not in values:
                raise CatalogueDamaged(f"{self.path} is damaged: {key} is missing in the table {table}")
        return values

    def _parsed(self, table: str, key: str, text: str) -> Any:
        try:
            value = json.loads(text)
            if value is None:
                raise ValueError("null says nothing")
            return value
        except (TypeError, ValueError) as error:
            raise CatalogueDamaged(f"{self.path} is damaged: {key!r} in the table {table} cannot be read") from error

    def _insert(self, table: str, row: Iterable[Any], verb: str = "INSERT") -> bool:
        """Add a row with its checksum in the open transaction; False if it was ignored."""
        row = tuple(row)
        marks = ", ".join("?" * (len(row) + 1))
        return self._connection.execute(f"{verb} INTO {table} VALUES ({marks})", (*row, checksum(row))).rowcount > 0

    # -- inside ---------------------------------------------------------------------------------------------------------------

    def _open_to_write(self, scene: SceneRecord | None) -> sqlite3.Connection:
        refuse_special(self.path, "write")
        if not self.path.exists() and scene is None:
            raise CatalogueError(f"there is no catalogue {self.path}; expected a scene to make one for")
        self._lock = WriterLock(self.path)
        try:
            return open_to_write(self.path)
        except BaseException:
            self._lock.release()
            raise

    def _make(self, scene: SceneRecord | None, provenance: dict[str, Any]) -> None:
        import datetime

        if scene is None:
            raise CatalogueError(f"{self.path} is empty; expected a scene to make a catalogue for")
        created = datetime.datetime.now().astimezone().isoformat(timespec="seconds")
        made = {"created": created, "versions": _versions(), **provenance, "schema": SCHEMA}
        with self.transaction():
            create_tables(self._connection)
            for table, content in (("scene", vars(scene)), ("provenance", made)):
                for key, value in content.items():
                    if value or key != "parameters":
                        self._insert(table, (key, json.dumps(value, allow_nan=False)))

    def _changed(self) -> None:
        """Forget what was read before a transaction."""

    def _writable(self) -> None:
        if self._lock is None:
            raise CatalogueError(f"{self.path} was opened to read, expected mode a to add to it")
        if os.getpid() != self._process:
            raise CatalogueError(f"{self.path} is written by process {self._process}, not by this one, which was forked from it")

    def _require_transaction(self) -> None:
        # SQLite rolls the complete transaction back if the disk is full. What follows must not be committed alone.
        if not self._connection.in_transaction:
            raise WriteFailure(f"cannot write {self.path}: an earlier failure has taken the transaction back")


def _versions() -> dict[str, str | None]:
    """Versions of Python, SQLite and the libraries; None for one that is not installed as a package."""
    import platform
    from importlib import metadata

    found: dict[str, str | None] = {"python": platform.python_version(), "sqlite": sqlite3.sqlite_version}
    for name in _LIBRARIES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = None
    return found
