"""Columns of text that fit the terminal."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Sequence
from typing import TextIO

__all__ = ["listing", "width_of"]

_GAP = "  "
_LEAST = 12
"""Characters that a shortened column keeps."""


def width_of(stream: TextIO) -> int | None:
    """The width of the terminal that a stream writes to; None where it is none, and nothing has to be shortened."""
    return shutil.get_terminal_size().columns if stream is not None and stream.isatty() else None


def listing(head: Sequence[str], rows: Sequence[Sequence[str]], *, width: int | None = None, right: str = "") -> list[str]:
    """Lay rows out in columns.

    Parameters
    ----------
    head : sequence of str
        Names of the columns.
    rows : sequence of sequence of str
    width : int, optional
        Most characters in a line: the widest columns are shortened to it.
    right : str
        Letters ``r`` and ``l``, one a column, for how it is aligned; left by default.

    Returns
    -------
    list of str
        The lines, without spaces at their ends.

    Examples
    --------
    >>> print("\\n".join(listing(("label", "points"), [("S13O00+", "203"), ("U8353-", "7")], right="lr")))
    label    points
    S13O00+     203
    U8353-        7
    >>> print("\\n".join(listing(("id", "h"), [("origin-origin:+-+-+-:0123abcd", "1.5")], width=20)))
    id               h
    origin-origin:…  1.5
    """
    table = [list(head), *([str(cell) for cell in row] for row in rows)]
    widths = [max(len(cell) for cell in column) for column in zip(*table, strict=True)]
    if width is not None:
        spare = width - len(_GAP) * (len(widths) - 1)
        while sum(widths) > spare and max(widths) > _LEAST:
            k = widths.index(max(widths))
            next_widest = max([_LEAST, *(size for size in widths if size < widths[k])])
            widths[k] -= min(max(1, widths[k] - next_widest), sum(widths) - spare)
    lines = []
    for row in table:
        cells = []
        for k, (cell, size) in enumerate(zip(row, widths, strict=True)):
            if len(cell) > size:
                cell = cell[: size - 1] + ("…" if _prints("…") else ".")
            cells.append(cell.rjust(size) if right[k : k + 1] == "r" else cell.ljust(size))
        lines.append(_GAP.join(cells).rstrip()[:width])
    return lines


def _prints(text: str) -> bool:
    """Whether standard output can show a character."""
    try:
        text.encode(getattr(sys.stdout, "encoding", None) or "utf-8")
    except UnicodeEncodeError:
        return False
    return True
