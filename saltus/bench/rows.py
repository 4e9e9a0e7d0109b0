"""Rows of the bench: task by method by setting, each written as it is finished."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from itertools import chain, repeat
from pathlib import Path
from typing import IO, Any

import numpy as np

from branches.files import WriteFailure, reason
from saltus.bench.answers import Errors
from saltus.bench.effort import Effort
from saltus.bench.methods import Method
from saltus.bench.tasks import Task
from saltus.bench.worker import Failed, Timed, Worker
from saltus.errors import one_line

__all__ = ["RowFile", "rows_of"]

Row = dict[str, Any]


class RowFile:
    """A file that grows by one JSON line a row; what is in it is on disk, whatever happens to the process.

    Parameters
    ----------
    path : path-like
        Begun anew.

    Raises
    ------
    WriteFailure
        Where it cannot be written.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self.rows: list[Row] = []
        try:
            self._file: IO[str] = self.path.open("w", encoding="utf-8")
        except OSError as error:
            raise WriteFailure(f"cannot write {path}: {reason(error)}") from error

    def add(self, row: Row) -> None:
        """Write a row; what is not finite becomes null."""
        row = {key: plain(value) for key, value in row.items()}
        try:
            self._file.write(json.dumps(row, allow_nan=False) + "\n")
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            raise WriteFailure(f"cannot write {self.path}: {reason(error)}") from error
        self.rows.append(row)

    def close(self) -> None:
        """Close the file; a row that `add` could not write has been told, and is not tried again."""
        with suppress(OSError):
            self._file.close()


def plain(value: Any) -> Any:
    """A value as JSON has it: numbers that are not finite are null."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    return value


def rows_of(
    tasks: Iterable[Task], methods: Iterable[Method], effort: Effort, say: Callable[[str], object]
) -> Iterator[Row]:
    """Do all tasks by all methods at all settings.

    Parameters
    ----------
    tasks, methods : iterable
    effort : Effort
    say : callable
        Told what is being done, and what is left out.

    Yields
    ------
    dict
        `task`, `method`, `setting` (null for a method without), `seconds` (of the processor, a point), `first` (seconds from the start of a
        fresh process to its first answer; in the first row of a task and method), `memory` (bytes), `points`, `repeats`,
        `errors` (orbit, energy, multipliers, located; null where there is none), `layers`, and `failed` (null, or why there is no answer).
    """
    methods = list(methods)
    for task in tasks:
        for method in methods:
            if method.missing() is None and method.does(task):
                yield from _ladder(task, method, effort, say)


def _ladder(task: Task, method: Method, effort: Effort, say: Callable[[str], object]) -> Iterator[Row]:
    with Worker(method.prepare, task, effort.repeat) as worker:
        for fresh, setting in zip(chain((True,), repeat(False)), method.ladder(effort.tolerances), strict=False):
            say(f"{task.name}, {method.name}" + ("" if setting is None else f", {method.setting} {setting:.0e}"))
            head: Row = {"task": task.name, "method": method.name, "setting": setting}
            try:
                timed = worker.do(setting, effort.limit + (effort.start if fresh else 0.0))
            except Failed as failure:
                nothing = dict.fromkeys(("seconds", "first", "memory", "points", "repeats", "layers"))
                yield {**head, **nothing, "errors": Errors()._asdict(), "failed": str(failure)}
                if failure.final:
                    return
                continue
            yield {**head, **_measured(task, timed)}


def _measured(task: Task, timed: Timed) -> Row:
    failed = None
    try:
        errors = task.errors(timed.answer)
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        # An answer that is so wrong that no orbit is next to it.
        errors, failed = Errors(), f"its error cannot be told: {one_line(error)}"
    return {
        "seconds": timed.seconds,
        "first": timed.first,
        "memory": timed.memory,
        "points": timed.answer.points,
        "repeats": timed.repeats,
        "layers": timed.answer.layers,
        "errors": errors._asdict(),
        "failed": failed,
    }
