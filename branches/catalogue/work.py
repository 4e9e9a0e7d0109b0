"""What a long run still has to do, in the same file and the same transactions as what it has found."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from typing import Any

from branches.catalogue.errors import CatalogueDamaged
from branches.catalogue.file import CatalogueFile
from branches.catalogue.rows import crc_of

__all__ = ["WorkQueue"]

_COLUMNS = {"work": ("key", "payload"), "progress": ("key", "value")}


class WorkQueue(CatalogueFile):
    """Pieces of work with keys, and notes."""

    def add_work(self, items: Iterable[tuple[str, Any]]) -> int:
        """Queue pieces of work, as (key, JSON value); a key that is known already stays as it is.

        Returns
        -------
        int
            How many were new.
        """
        rows = [(key, json.dumps(value, sort_keys=True)) for key, value in items]
        with self.transaction():
            before = self._connection.total_changes
            self._connection.executemany(
                "INSERT OR IGNORE INTO work (key, payload, crc) VALUES (?, ?, ?)", ((*row, crc_of(row)) for row in rows)
            )
            new = self._connection.total_changes - before
            self._count("work", new)
            return new

    def finish(self, key: str) -> None:
        """Strike a piece of work off: in one transaction with what came of it."""
        with self.transaction():
            self._delete("work", "key = ?", (key,))

    def work(self) -> list[tuple[str, Any]]:
        """Pieces of work that are left: (key, value) in the order of their keys."""
        return [(row[0], self._value("work", row)) for row in self._select("work", _COLUMNS["work"], "ORDER BY key")]

    def progress(self, key: str) -> Any:
        """What was last noted under a key, None where nothing was."""
        rows = self._select("progress", _COLUMNS["progress"], "WHERE key = ?", (key,))
        return self._value("progress", rows[0]) if rows else None

    def notes(self, beginning: str) -> list[Any]:
        """All that is noted under keys with this beginning, in the order of the keys."""
        rows = self._select("progress", _COLUMNS["progress"], "WHERE substr(key, 1, ?) = ? ORDER BY key", (len(beginning), beginning))
        return [self._value("progress", row) for row in rows]

    def note(self, key: str, value: Any) -> None:
        """Note a JSON value other than null under a key, in place of what was there."""
        row = (key, json.dumps(value, sort_keys=True))
        with self.transaction():
            self._delete("progress", "key = ?", (key,))
            self._insert("progress", _COLUMNS["progress"], row, crc_of(row))

    def damaged_work(self) -> Iterator[tuple[str, str]]:
        """What is wrong with the work that is left and the notes: the table, and a line for each row that cannot be trusted."""
        for table, columns in _COLUMNS.items():
            for row in self._select(table, columns, "ORDER BY key"):
                try:
                    self._value(table, row)
                except CatalogueDamaged as damage:
                    yield table, str(damage)

    def _value(self, table: str, row: tuple[Any, ...]) -> Any:
        """The value of a row, which fits its checksum where the table has them."""
        key, text = self._checked(row, f"{row[0]!r} in the table {table}") if len(row) > 2 else row
        try:
            value = json.loads(text)
        except (TypeError, ValueError) as error:
            raise CatalogueDamaged(f"{self.path} is damaged: what is noted under {key!r} cannot be read") from error
        if value is None:
            raise CatalogueDamaged(f"{self.path} is damaged: nothing is noted under {key!r}")
        return value
