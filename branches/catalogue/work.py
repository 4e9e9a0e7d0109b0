"""What a long run still has to do, in the same file and the same transactions as what it has found."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

from branches.catalogue.errors import CatalogueDamaged
from branches.catalogue.file import CatalogueFile

__all__ = ["WorkQueue"]


class WorkQueue(CatalogueFile):
    """Pieces of work with keys, and notes."""

    def add_work(self, items: Iterable[tuple[str, Any]]) -> int:
        """Queue pieces of work, as (key, JSON value); a key that is known already stays as it is.

        Returns
        -------
        int
            How many were new.
        """
        with self.transaction():
            before = self._connection.total_changes
            self._connection.executemany(
                "INSERT OR IGNORE INTO work (key, payload) VALUES (?, ?)",
                ((key, json.dumps(value, sort_keys=True)) for key, value in items),
            )
            return self._connection.total_changes - before

    def finish(self, key: str) -> None:
        """Strike a piece of work off: in one transaction with what came of it."""
        with self.transaction():
            self._connection.execute("DELETE FROM work WHERE key = ?", (key,))

    def work(self) -> list[tuple[str, Any]]:
        """Pieces of work that are left: (key, value) in the order of their keys."""
        return [(key, self._value(key, value)) for key, value in self._select("work", ("key", "payload"), "ORDER BY key")]

    def progress(self, key: str) -> Any:
        """What was last noted under a key, None where nothing was."""
        rows = self._select("progress", ("value",), "WHERE key = ?", (key,))
        return self._value(key, rows[0][0]) if rows else None

    def notes(self, beginning: str) -> list[Any]:
        """All that is noted under keys with this beginning, in the order of the keys."""
        rows = self._select("progress", ("value",), "WHERE substr(key, 1, ?) = ? ORDER BY key", (len(beginning), beginning))
        return [self._value(beginning, value) for (value,) in rows]

    def note(self, key: str, value: Any) -> None:
        """Note a JSON value under a key, in place of what was there."""
        with self.transaction():
            self._connection.execute("INSERT OR REPLACE INTO progress VALUES (?, ?)", (key, json.dumps(value, sort_keys=True)))

    def _value(self, key: str, text: str) -> Any:
        try:
            return json.loads(text)
        except (TypeError, ValueError) as error:
            raise CatalogueDamaged(f"{self.path} is damaged: what is noted under {key!r} cannot be read") from error
