"""Printing by commands: a standard output that can be closed at any time, standard error, and the progress of long runs.

Standard output may be closed or full, or its reader may have left. The command then still writes its files. A printed name may contain
undecodable bytes or control characters of the terminal.
"""

from __future__ import annotations

import contextlib
import os
import sys
import threading
import time
from dataclasses import dataclass
from types import TracebackType
from typing import Any, TextIO, cast

from branches.files import WriteFailure, reason

__all__ = [
    "ProgressBar",
    "StandardError",
    "StandardOutput",
    "plain_stream",
    "printable",
]

KEPT = "\n\t"
"""Control characters that text may hold."""


def printable(text: str, kept: str = KEPT) -> str:
    """The text with each unprintable character replaced by its escape, except the characters in `kept`.

    Examples
    --------
    >>> print(printable("red \\x1b[31m, a byte that is no text \\udcff"))
    red \\x1b[31m, a byte that is no text \\xff
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in kept else _escape(c) for c in text)


def _escape(character: str) -> str:
    code = ord(character)
    # Python reads a byte b of a file name that is not UTF-8 as the character U+DC00 + b.
    return f"\\x{code - 0xDC00:02x}" if 0xDC80 <= code <= 0xDCFF else character.encode("unicode_escape").decode("ascii")


class StandardOutput:
    """A text stream over standard output that a command can rely on.

    Parameters
    ----------
    stream : text stream or None
        Standard output; None where it is closed.

    Attributes
    ----------
    outlasts : bool
        Whether the command goes on when standard output fails, because it has files to write.
    failure : str or None
        Why text could not be printed.
    """

    def __init__(self, stream: TextIO | None) -> None:
        self.stream = stream
        self.outlasts = False
        self.failure: str | None = None
        self._gone = False
        if getattr(stream, "errors", None) == "strict":
            cast(Any, stream).reconfigure(errors="backslashreplace")

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)

    def write(self, text: str) -> int:
        """Print; raise `BrokenPipeError` or `WriteFailure` where that fails and the command has no files to write."""
        self._do("write", printable(text))
        return len(text)

    def flush(self) -> None:
        """Flush; errors as for `write`."""
        if self.stream is not None:
            self._do("flush")

    def isatty(self) -> bool:
        """Whether it is a terminal."""
        return self.stream is not None and self.stream.isatty()

    def drop(self) -> None:
        """Print nothing more. Text left in the stream's buffer must not raise a second error when the process ends."""
        self._gone = True
        with contextlib.suppress(OSError, ValueError, AttributeError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), cast(TextIO, self.stream).fileno())

    def _do(self, action: str, *text: str) -> None:
        if self._gone:
            return
        try:
            if self.stream is None:
                raise OSError("it is closed")
            getattr(self.stream, action)(*text)
        except BrokenPipeError:
            self.drop()
            if not self.outlasts:
                raise
        except OSError as error:
            self.drop()
            self.failure = f"cannot write standard output: {reason(error)}"
            if not self.outlasts:
                raise WriteFailure(self.failure) from error


@dataclass(eq=False)
class StandardError:
    """A text stream over standard error that never fails: what cannot be printed there can be printed nowhere."""

    stream: TextIO

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)

    def write(self, text: str) -> int:
        """Print, if that is possible."""
        with contextlib.suppress(OSError):
            self.stream.write(text)
        return len(text)

    def flush(self) -> None:
        """Flush, if that is possible."""
        with contextlib.suppress(OSError):
            self.stream.flush()


def plain_stream() -> TextIO:
    """Standard output as it is, for data that must not be changed. `WriteFailure` if it is closed."""
    stream = sys.stdout.stream if isinstance(sys.stdout, StandardOutput) else sys.stdout
    if stream is None:
        raise WriteFailure("cannot write standard output: it is closed")
    return stream


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
        Unit of the count.

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
