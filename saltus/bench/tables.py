"""Tables of measured figures: as plain text, as Markdown, and put into a page between two marks."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from saltus.bench.following import Spread

__all__ = ["BEGIN", "END", "PageError", "Table", "check_page", "microseconds", "number", "write_page"]

BEGIN = "<!-- measured: begin -->"
END = "<!-- measured: end -->"


class PageError(ValueError):
    """The page to write to cannot be used; the message is one line."""


@dataclass(frozen=True)
class Table:
    """A title, what its columns mean, and rows of text.

    Parameters
    ----------
    title : str
    columns : sequence of str
    rows : sequence of sequences of str
    notes : sequence of str
        Sentences that say how it was measured, one a line.
    """

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    notes: Sequence[str] = ()

    def text(self) -> str:
        """The table in columns of equal width."""
        widths = [max(len(row[c]) for row in [self.columns, *self.rows]) for c in range(len(self.columns))]
        lines = [self.title, *self.notes, ""]
        for row in [self.columns, *self.rows]:
            lines.append("  " + "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)).rstrip())
        return "\n".join(lines) + "\n"

    def markdown(self) -> str:
        """The table for a page."""
        lines = [f"### {self.title}", "", *self.notes, "" if self.notes else None]
        for k, row in enumerate([self.columns, *self.rows]):
            lines.append("| " + " | ".join(row) + " |")
            if k == 0:
                lines.append("|" + " ---: |" * len(row))
        return "\n".join(line for line in lines if line is not None) + "\n"


def number(value: float, digits: int = 3) -> str:
    """A number with so many significant digits, without an exponent between 0.001 and 1e9.

    Examples
    --------
    >>> number(1234.5), number(0.01234), number(3.1e-15), number(7.0)
    ('1230', '0.0123', '3.1e-15', '7')
    """
    if value == 0.0:
        return "0"
    if not 1e-3 <= abs(value) < 1e9:
        return f"{value:.{digits - 1}g}"
    rounded = float(f"{value:.{digits}g}")
    return f"{rounded:.0f}" if abs(rounded) >= 10 ** (digits - 1) else f"{rounded:.{digits}g}"


def microseconds(seconds: Spread) -> str:
    """Median and, in parentheses, least of repeated times, in microseconds.

    Examples
    --------
    >>> microseconds(Spread(1e-5, 1.25e-5))
    '12.5 (10)'
    """
    return f"{number(1e6 * seconds.median)} ({number(1e6 * seconds.least)})"


def check_page(path: str | os.PathLike[str]) -> None:
    """Refuse a page that has no place for the tables.

    Raises
    ------
    PageError
        The page cannot be read or written, or has not the two marks in order, once each.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise PageError(f"cannot read {path}: {reason}") from error
    if text.count(BEGIN) != 1 or text.count(END) != 1 or text.index(BEGIN) > text.index(END):
        raise PageError(f"{path} has no place for the tables; expected one line {BEGIN!r} and one line {END!r} after it")
    if not os.access(path, os.W_OK):
        raise PageError(f"cannot write {path}: permission denied")


def write_page(path: str | os.PathLike[str], tables: str) -> None:
    """Put text between the marks of a page in place of what stands there; the page is replaced as a whole."""
    check_page(path)
    page = Path(path)
    text = page.read_text(encoding="utf-8")
    head, tail = text[: text.index(BEGIN) + len(BEGIN)], text[text.index(END) :]
    handle, temporary = tempfile.mkstemp(dir=page.resolve().parent, prefix=page.name, suffix=".part")
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(f"{head}\n{tables.strip()}\n{tail}")
        os.chmod(temporary, page.stat().st_mode)
        os.replace(temporary, page.resolve())
    except BaseException:
        os.unlink(temporary)
        raise
