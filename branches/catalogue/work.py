"""What a long run still has to do, in the same file and the same transactions as what it has found."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

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
                "INSERT OR IGNORE INTO work (key, state, payload) VALUES (?, 'pending', ?)",
                ((key, json.dumps(value, sort_keys=True)) for key, value in items),
            )
            return self._connection.total_changes - before

    def finish(self, key: str, result: Any = None) -> None:
        """Mark a piece of work as done: in one transaction with what came of it. Its value is not kept any longer."""
        with self.transaction():
            self._connection.execute(
                "UPDATE work SET state = 'done', payload = 'null', result = ? WHERE key = ?",
                (None if result is None else json.dumps(result, sort_keys=True), key),
            )

    def work(self, state: str = "pending") -> list[tuple[str, Any, Any]]:
        """Pieces of work, ``pending`` or ``done``: (key, value, result) in the order of their keys. What is done has no value."""
        rows = self._select("work", ("key", "payload", "result"), "WHERE state = ? ORDER BY key", (state,))
        return [(key, json.loads(value), None if result is None else json.loads(result)) for key, value, result in rows]

    def progress(self, key: str) -> Any:
        """What was last noted under a key, None where nothing was."""
        rows = self._select("progress", ("value",), "WHERE key = ?", (key,))
        return json.loads(rows[0][0]) if rows else None

    def note(self, key: str, value: Any) -> None:
        """Note a JSON value under a key, in place of what was there."""
        with self.transaction():
            self._connection.execute("INSERT OR REPLACE INTO progress VALUES (?, ?)", (key, json.dumps(value, sort_keys=True)))
