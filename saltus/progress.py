"""Progress of long runs on standard error: a bar where that is a terminal, else a line a minute."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import Any

__all__ = ["ProgressBar"]

PATIENCE = 1.0
"""Seconds before the bar appears: a short run shows none."""

PAUSE = 60.0
"""Seconds from line to line where there is no terminal."""


class ProgressBar:
    """Shows how many points are done; lines printed through `line` do not disturb it.

    Parameters
    ----------
    total : int or None
        How many points there will be at most, if that is known.
    things : str
        What is counted.

    Examples
    --------
    >>> with ProgressBar() as bar:
    ...     bar.update(1)
    ...     bar.line("one line", sys.stdout)
    one line
    """

    def __init__(self, total: int | None = None, things: str = "points") -> None:
        self._total = total
        self._things = things
        self._bar: Any = None
        self._task: Any = None
        self._wanted = sys.stderr is not None and sys.stderr.isatty()
        self._start = self._said = time.monotonic()

    def __enter__(self) -> ProgressBar:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        if self._bar is not None:
            self._bar.stop()

    def update(self, count: int, more: str = "") -> None:
        """Show how many points are done, and more in words."""
        if self._bar is not None:
            self._bar.update(self._task, completed=count, description=more)
        elif self._wanted:
            if time.monotonic() - self._start > PATIENCE:
                self._show(count)
        elif sys.stderr is not None and time.monotonic() - self._said >= PAUSE:
            self._said = time.monotonic()
            total = "" if self._total is None else f" of {self._total}"
            after = f"after {(self._said - self._start) / 60.0:.0f} min"
            print(f"saltus: {count}{total} {self._things} {after}{more and ', ' + more}", file=sys.stderr, flush=True)

    def line(self, text: str, stream: Any) -> None:
        """Print a line to a stream and flush it."""
        if self._bar is not None:
            self._bar.stop()
        print(text, file=stream, flush=True)
        if self._bar is not None:
            self._bar.start()

    def _show(self, count: int) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        self._bar = Progress(
            BarColumn(),
            TextColumn(f"{{task.completed}} {self._things}"),
            TextColumn("{task.description}"),
            TimeElapsedColumn(),
            console=Console(stderr=True),
            transient=True,
            redirect_stdout=False,
            redirect_stderr=False,
        )
        self._task = self._bar.add_task("", total=self._total, completed=count)
        self._bar.start()
