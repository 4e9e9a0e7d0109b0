"""Columns of text that fit the terminal: texts give room first, then ids in their middle; what has no room is on a further line."""

from __future__ import annotations

import re
import shutil
import sys
import textwrap
from collections.abc import Iterable, Sequence
from typing import TextIO

__all__ = ["listing", "short_id", "width_of", "with_short_ids", "wrapped"]

_GAP = "  "
_INDENT = "    "
"""Before the further lines of a row."""
_LEAST = 12
"""Characters that a shortened text keeps."""
_ID = re.compile(r"(?:origin|rest|stop|periodic)[^\s:]*:[^\s:]*:[0-9a-f]{8}")


def width_of(stream: TextIO) -> int | None:
    """The width of the terminal that a stream writes to; None where it is none, and nothing has to be shortened."""
    return shutil.get_terminal_size().columns if stream is not None and stream.isatty() else None


def listing(head: Sequence[str], rows: Sequence[Sequence[str]], *, width: int | None = None, columns: str = "") -> list[str]:
    """Lay rows out in columns.

    Parameters
    ----------
    head : sequence of str
        Names of the columns.
    rows : sequence of sequence of str
    width : int, optional
        Most characters in a line. Numbers and names are never cut, and no column is left out: columns that find no room stand on further
        lines, indented, of every row.
    columns : str
        Letters, one a column: ``l`` and ``r`` for how it is aligned, left by default; ``t`` for text, which is shortened behind a word;
        ``i`` for the ids of families, which are shortened in their middle.

    Returns
    -------
    list of str
        The lines, without spaces at their ends.

    Examples
    --------
    >>> print("\\n".join(listing(("label", "points"), [("S13O00+", "203"), ("U8353-", "7")], columns="lr")))
    label    points
    S13O00+     203
    U8353-        7
    >>> print("\\n".join(listing(("id", "h"), [("origin-origin:+-+-+-:0123abcd", "1.5")], width=25, columns="il")))
    id                    h
    origin-ori…:0123abcd  1.5
    >>> print("\\n".join(listing(("id", "h"), [("origin-origin:+-+-+-:0123abcd", "1.51234")], width=15, columns="il")))
    id
        h
    origi…:0123abcd
        1.51234
    """
    table = [list(head), *([str(cell) for cell in row] for row in rows)]
    kinds = columns.ljust(len(head), "l")[: len(head)]
    natural = [max(map(len, column)) for column in zip(*table, strict=True)]
    least = [
        max(len(_fitted(cell, _LEAST if kind == "t" else 0, kind)) for cell in column)
        for kind, column in zip(kinds, zip(*table, strict=True), strict=True)
    ]
    lines = [list(range(len(head)))] if width is None else _split(least, width)
    sizes = list(natural)
    for k, line in enumerate(lines if width is not None else ()):
        assert width is not None
        _give(sizes, natural, least, kinds, line, width - len(_INDENT) * (k > 0) - len(_GAP) * (len(line) - 1))
    out = []
    for row in table:
        for k, line in enumerate(lines):
            cells = []
            for j in line:
                cell = _fitted(row[j], sizes[j], kinds[j])
                cells.append(cell.rjust(sizes[j]) if kinds[j] == "r" else cell.ljust(sizes[j]))
            text = (_INDENT if k else "") + _GAP.join(cells)
            if k == 0 or text.strip():
                out.append(text.rstrip())
    return out


def short_id(id: str, size: int) -> str:
    """A family's id in so many characters, with its hash, which tells it from all others; as long as that needs, where they are fewer.

    Examples
    --------
    >>> short_id("origin-origin:+-+-:d777f141", 18), short_id("origin-stop+::44db5a75", 0), short_id("L11+", 2)
    ('origin-o…:d777f141', 'o…:44db5a75', 'L11+')
    """
    if len(id) <= size or not _ID.fullmatch(id):
        return id
    tail = _dots() + id[-9:]
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
    """Lines of words, those that are too long broken between words, with further lines indented.

    Examples
    --------
    >>> wrapped(["model  elastic stops -> momentum is kept"], 30, 7)
    ['model  elastic stops ->', '       momentum is kept']
    """
    if width is None:
        return list(lines)
    out: list[str] = []
    for line in lines:
        if len(line) <= width:
            out.append(line)
            continue
        out += textwrap.wrap(line, width, subsequent_indent=" " * indent, break_long_words=False, break_on_hyphens=False)
    return out


def _split(least: Sequence[int], width: int) -> list[list[int]]:
    """The columns of each line of a row, so many as fit with the least widths."""
    lines: list[list[int]] = [[]]
    used = 0
    for j, size in enumerate(least):
        if lines[-1] and used + len(_GAP) + size > width:
            lines.append([])
        used = used + len(_GAP) + size if lines[-1] else size + len(_INDENT) * (len(lines) > 1)
        lines[-1].append(j)
    return lines


def _give(sizes: list[int], natural: list[int], least: list[int], kinds: str, line: list[int], room: int) -> None:
    """Share the room of a line out: what is rigid has what it needs, then ids, then texts."""
    spare = room - sum(least[j] for j in line)
    for j in line:
        sizes[j] = least[j]
    for kind in "it":
        for j in (j for j in line if kinds[j] == kind):
            more = max(0, min(spare, natural[j] - least[j]))
            sizes[j] += more
            spare -= more


def _fitted(cell: str, size: int, kind: str) -> str:
    if len(cell) <= size or kind not in "it":
        return cell
    if kind == "i":
        return short_id(cell, size)
    first, *_ = cell.split(" ")
    head = cell[:size].rpartition(" ")[0] or first
    return head if head == cell else head.rstrip(",;:") + _dots()


def _dots() -> str:
    """What stands for what was left out: a character that standard output can show."""
    try:
        "…".encode(getattr(sys.stdout, "encoding", None) or "utf-8")
    except UnicodeEncodeError:
        return "."
    return "…"
