"""Progress of long runs on standard error: a bar where that is a terminal, else a line a minute."""

from __future__ import annotations

import sys
import threading
import time
from types import TracebackType
from typing import Any

__all__ = ["ProgressBar"]

PATIENCE = 1.0
"""Seconds before the bar appears: a short run shows none."""

PAUSE = 60.0
"""Seconds from line to line where there is no terminal."""


class ProgressBar:
    """Shows how many points are done. Lines printed through `line` do not disturb it.

    Where standard error is no terminal, a thread prints a line a minute, also while a search reports nothing.

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
        self._terminal = sys.stderr is not None and sys.stderr.isatty()
        self._start = time.monotonic()
        self._count: int | None = None
        self._more = ""
        self._done = threading.Event()

    def __enter__(self) -> ProgressBar:
        if not self._terminal:
            threading.Thread(target=self._report_again, daemon=True).start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        self._done.set()
        if self._bar is not None:
            self._bar.stop()

    def update(self, count: int, more: str = "") -> None:
        """Show how many points are done, and more in words."""
        self._count, self._more = count, more
        if self._bar is not None:
            self._bar.update(self._task, completed=count, description=more)
        elif self._terminal and time.monotonic() - self._start > PATIENCE:
            self._show(count)

    def report(self) -> None:
        """Print a line about the progress on standard error."""
        if sys.stderr is None:
            return
        total = "" if self._total is None else f" of {self._total}"
        done = "still at work" if self._count is None else f"{self._count}{total} {self._things}"
        minutes = f"{(time.monotonic() - self._start) / 60.0:.0f} min"
        sys.stderr.write(f"saltus: {done} after {minutes}{self._more and ', ' + self._more}\n")
        sys.stderr.flush()

    def _report_again(self) -> None:
        while not self._done.wait(min(PAUSE, threading.TIMEOUT_MAX)):
            self.report()

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
