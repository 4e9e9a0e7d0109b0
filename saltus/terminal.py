"""What a command shows in a terminal: tables and lines that fit it, and the progress of long runs."""

from __future__ import annotations

import re
import shutil
import sys
import textwrap
import threading
import time
from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager
from itertools import zip_longest
from typing import Any, TextIO

__all__ = [
    "EVENT_COLUMNS",
    "EVENT_ROW",
    "ProgressBar",
    "counted",
    "event_cells",
    "range_text",
    "short_id",
    "stability_word",
    "table_lines",
    "terminal_width",
    "with_short_ids",
    "wrapped",
]

_GAP = 2
"""Spaces between two columns."""
_LEAST = 16
"""Width that a column of texts or ids keeps."""
_ID = re.compile(r"(?:origin|rest|stop|periodic|(?:half-)?period-|free-)[^\s:]*:[^\s:]*:[0-9a-f]{8}")
EVENT_ROW = "{:>6}  {:<4}  {:<14}  {:<18}  {:<18}  {:<9}  {:<12}  {:<24}  {}"

EVENT_COLUMNS = ("point", "type", "label", "energy h", "quarter alpha", "stable", "|multiplier|", "normal form", "remark")


def terminal_width(stream: TextIO) -> int | None:
    """The width of the terminal that a stream writes to; None where it writes to no terminal."""
    return shutil.get_terminal_size().columns if stream.isatty() else None


def table_lines(head: Sequence[str], rows: Iterable[Sequence[str]], *, width: int | None = None, columns: str = "") -> list[str]:
    """Lay out a table.

    Parameters
    ----------
    head : sequence of str
        Names of the columns.
    rows : iterable of sequence of str
    width : int, optional
        Most characters in a line; by default any number.
    columns : str
        One letter a column: ``l`` and ``r`` give the alignment, left by default; ``t`` is text, which can wrap; ``i`` is ids of families,
        which can be shortened. Other cells stay complete: columns that do not fit go to further lines of each row.

    Returns
    -------
    list of str
        The lines, without spaces at their ends.

    Examples
    --------
    >>> print("\\n".join(table_lines(("label", "points"), [("S13O00+", "203"), ("U8353-", "7")], columns="lr")))
    label    points
    S13O00+     203
    U8353-        7
    >>> print("\\n".join(table_lines(("id", "h"), [("origin-origin:+-+-+-+-:0123abcd", "1.5")], width=25, columns="il")))
    id                    h
    origin-ori…:0123abcd  1.5
    """
    cells = [list(head), *map(list, rows)]
    kinds = columns.ljust(len(head), "l")
    sizes = [max(map(len, column)) for column in zip(*cells, strict=True)]
    groups = [range(len(head))]
    if width is not None:
        groups = _groups([min(size, _LEAST) if kind in "ti" else size for kind, size in zip(kinds, sizes, strict=True)], width)
        for indent, group in enumerate(groups):
            room = width - _GAP * (len(group) - 1 + (indent > 0))
            # Texts give room first, then ids. The widest gives one character at a time.
            for flexible in "t", "ti":
                giving = [j for j in group if kinds[j] in flexible]
                while sum(sizes[j] for j in group) > room and any(sizes[j] > _LEAST for j in giving):
                    sizes[max(giving, key=lambda j: sizes[j])] -= 1
    lines = []
    for row in cells:
        for indent, group in enumerate(groups):
            parts = [_cell(row[j], kinds[j], sizes[j]) for j in group]
            for texts in zip_longest(*parts, fillvalue=""):
                pads = (str.rjust if kinds[j] == "r" else str.ljust for j in group)
                padded = [pad(text, sizes[j]) for pad, text, j in zip(pads, texts, group, strict=True)]
                lines.append(" " * (_GAP * (indent > 0)) + (" " * _GAP).join(padded))
    return [line.rstrip() for line in lines if line.strip()]


def _groups(sizes: list[int], width: int) -> list[range]:
    """The columns that have room on each line of a row. The further lines are indented."""
    groups: list[range] = []
    first = 0
    for j in range(1, len(sizes) + 1):
        if j == len(sizes) or sum(sizes[first : j + 1]) + _GAP * (j - first + bool(groups)) > width:
            groups.append(range(first, j))
            first = j
    return groups


def _cell(text: str, kind: str, size: int) -> list[str]:
    """The lines of a cell: texts wrap, ids are shortened."""
    if kind == "t" and len(text) > size:
        return textwrap.wrap(text, size, break_on_hyphens=False)
    return [with_short_ids(text, size) if kind == "i" else text]


def short_id(id: str, size: int) -> str:
    """A family's id in so many characters: its beginning and its hash. It is longer where the hash needs more.

    Examples
    --------
    >>> short_id("origin-origin:+-+-:d777f141", 18), short_id("origin-stop+::44db5a75", 0), short_id("L11+", 2)
    ('origin-o…:d777f141', 'o…:44db5a75', 'L11+')
    """
    if len(id) <= size or not _ID.fullmatch(id):
        return id
    tail = "…" + id[-9:]
    return id[: max(1, size - len(tail))] + tail


def with_short_ids(line: str, width: int | None) -> str:
    """A line with the ids in it shortened as far as it has to be.

    Examples
    --------
    >>> with_short_ids("S13O00+  origin-stop+::44db5a75", 24)
    'S13O00+  origi…:44db5a75'
    """
    if width is None:
        return line
    excess = max(0, len(line) - width)
    return _ID.sub(lambda found: short_id(found[0], len(found[0]) - excess), line)


def wrapped(lines: Iterable[str], width: int | None, indent: int) -> list[str]:
    """Lines of words. Those that are too long are broken between words, and their further lines are indented.

    Examples
    --------
    >>> wrapped(["model  elastic stops -> momentum is kept"], 30, 7)
    ['model  elastic stops ->', '       momentum is kept']
    """
    if width is None:
        return list(lines)
    wrapper = textwrap.TextWrapper(width, subsequent_indent=" " * indent, break_long_words=False, break_on_hyphens=False)
    return [part for line in lines for part in ([line] if len(line) <= width else wrapper.wrap(line))]


def counted(count: int, thing: str) -> str:
    """A number of things, one of them in the singular.

    Examples
    --------
    >>> counted(1, "orbit"), counted(0, "edge"), counted(2, "family")
    ('1 orbit', '0 edges', '2 families')
    """
    if count == 1:
        return f"1 {thing}"
    return f"{count} {thing[:-1]}ies" if thing.endswith("y") else f"{count} {thing}s"


def range_text(ends: tuple[float, float]) -> str:
    """A range of numbers as ``0.1185:14.55``.

    Examples
    --------
    >>> range_text((0.118507810594, 14.5537010891)), range_text((1.0, 1.0))
    ('0.11851:14.554', '1:1')
    """
    return f"{ends[0]:.5g}:{ends[1]:.5g}"


def stability_word(stable: bool | int | None) -> str:
    """Return ``yes``, ``no``, or ``undecided`` (for None and -1).

    Examples
    --------
    >>> [stability_word(stable) for stable in (True, 0, -1, None)]
    ['yes', 'no', 'undecided', 'undecided']
    """
    if stable is None or stable == -1:
        return "undecided"
    return "yes" if stable else "no"


def event_cells(event: Any) -> tuple[str, ...]:
    """The cells of an event, in the order of `EVENT_COLUMNS`.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> event = SimpleNamespace(number=-12, type="SN", label="S11O00-", h=0.06911644996826901, alpha=1.13584395619551,
    ...     stable=None, multiplier=1.0, normal_form="0.1621", stop=None, p_q=None, breaks=None, note=None)
    >>> print(EVENT_ROW.format(*EVENT_COLUMNS), EVENT_ROW.format(*event_cells(event)), sep="\\n")
    point   type  label           energy h            quarter alpha       stable     |multiplier|  normal form               remark
     -12    SN    S11O00-         0.069116449968269   1.1358439561955     undecided  1             0.1621
    """
    if event.note:
        remark = event.note
    elif event.p_q:
        remark = "p/q = {}/{}".format(*event.p_q)
    elif event.breaks:
        remark = f"breaks {event.breaks}"
    else:
        remark = f"stop {event.stop}" if event.stop else ""
    return (
        str(event.number), event.type, event.label, f"{event.h:.14g}", f"{event.alpha:.14g}", stability_word(event.stable),
        "unbounded" if event.multiplier is None else f"{event.multiplier:.8g}", event.normal_form,
        remark,
    )  # fmt: skip


PATIENCE = 1.0
"""Seconds before the bar appears: a short run shows none."""

PAUSE = 60.0
"""Seconds from line to line where there is no terminal."""


class ProgressBar(AbstractContextManager["ProgressBar"]):
    """Shows how many points are done. Lines printed through `line` do not disturb it.

    A thread prints a line a minute where no bar is drawn: standard error is no terminal, or a search reports nothing.

    Parameters
    ----------
    total : int or None
        How many points there will be at most, if that is known.
    things : str
        Unit of the count.
    more : str
        What the line says besides, until `update` says something else.

    Examples
    --------
    >>> with ProgressBar() as bar:
    ...     bar.update(1)
    ...     bar.line("one line", sys.stdout)
    one line
    """

    def __init__(self, total: int | None = None, things: str = "points", more: str = "") -> None:
        self._total = total
        self._things = things
        self._bar: Any = None
        self._start = time.monotonic()
        self._count: int | None = None
        self._more = more
        self._done = threading.Event()
        self._terminal = sys.stderr is not None and sys.stderr.isatty()
        threading.Thread(target=self._report, daemon=True).start()

    def __exit__(self, *error: object) -> None:
        self._done.set()
        if self._bar is not None:
            self._bar.stop()

    def update(self, count: int, more: str = "") -> None:
        """Show how many points are done, and more in words."""
        self._count, self._more = count, more
        if self._bar is None and self._terminal and time.monotonic() - self._start > PATIENCE:
            from rich.console import Console
            from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

            columns = BarColumn(), TextColumn(f"{{task.completed}} {self._things}"), TextColumn("{task.description}"), TimeElapsedColumn()
            self._bar = Progress(*columns, console=Console(file=sys.stderr), transient=True, redirect_stdout=False, redirect_stderr=False)
            self._bar.add_task("", total=self._total)
            self._bar.start()
        if self._bar is not None:
            self._bar.update(self._bar.task_ids[0], completed=count, description=more)

    def _report(self) -> None:
        """Print a line about the progress, again and again, until the work is done."""
        total = "" if self._total is None else f" of {self._total}"
        while not self._done.wait(min(PAUSE, threading.TIMEOUT_MAX)):
            if self._bar is not None or sys.stderr is None:
                continue
            done = "still at work" if self._count is None else f"{self._count}{total} {self._things}"
            minutes = f"{(time.monotonic() - self._start) / 60.0:.0f} min"
            print(f"saltus: {done} after {minutes}{self._more and ', ' + self._more}", file=sys.stderr, flush=True)

    def line(self, text: str, stream: Any) -> None:
        """Print a line to a stream and flush it."""
        if self._bar is not None:
            self._bar.stop()
        print(text, file=stream, flush=True)
        if self._bar is not None:
            self._bar.start()
