"""Tables of results - in the terminal, as Markdown, and in a page between two marks - and a description of the machine."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TypeVar

from branches.files import write_text
from saltus import __version__
from saltus.errors import BadInput

__all__ = ["BEGIN", "END", "Table", "check_page", "machine", "number", "progress", "show", "watched", "write_page"]

Item = TypeVar("Item")

BEGIN = "<!-- measured: begin -->"
END = "<!-- measured: end -->"

WIDTH = 200
"""Columns of a table if the output is not a terminal."""


@dataclass(frozen=True)
class Table:
    """A title, columns, and rows of text.

    Parameters
    ----------
    title : str
    columns : sequence of str
    rows : sequence of sequences of str
    notes : sequence of str
        How it was measured, in lines.
    """

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    notes: Sequence[str] = ()

    def markdown(self) -> str:
        """The table for a page."""
        lines = [f"### {self.title}", "", *self.notes, "" if self.notes else None]
        for k, row in enumerate([self.columns, *self.rows]):
            lines.append("| " + " | ".join(row) + " |")
            if k == 0:
                lines.append("|" + " ---: |" * len(row))
        return "\n".join(line for line in lines if line is not None) + "\n"


def show(table: Table) -> None:
    """Print a table: as wide as the terminal, or `WIDTH` columns wide if there is none."""
    from rich import box
    from rich.console import Console
    from rich.table import Table as RichTable

    console = Console(width=None if sys.stdout.isatty() else WIDTH)
    shown = RichTable(
        title=table.title, title_justify="left", caption=" ".join(table.notes) or None, caption_justify="left", box=box.SIMPLE_HEAD,
        header_style="bold", pad_edge=False,
    )  # fmt: skip
    for index, column in enumerate(table.columns):
        shown.add_column(column, justify="left" if index == 0 else "right", overflow="fold")
    for row in table.rows:
        shown.add_row(*row)
    console.print(shown)
    console.print()


def progress(text: str) -> None:
    """Print what is being measured, on standard error."""
    print(f"  {text}", file=sys.stderr, flush=True)


def watched(items: Iterable[Item], name: Callable[[Item], str]) -> Iterator[Item]:
    """Yield items, and print the name of each as `progress` before."""
    for item in items:
        progress(name(item))
        yield item


def number(value: float, digits: int = 3) -> str:
    """A number with this many significant digits, without an exponent between 0.001 and 1e9.

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


def machine() -> list[str]:
    """Lines with the processor, its load, and the versions that matter."""
    load = ", ".join(f"{x:.2f}" for x in os.getloadavg()) if hasattr(os, "getloadavg") else "unknown"
    packages = ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy", "numba"))
    return [
        f"Machine: {_processor()}, {os.cpu_count()} cores; {platform.system()} {platform.machine()}.",
        f"Load averages at the start: {load} (1, 5 and 15 minutes); figures of a loaded machine are too long.",
        f"saltus {__version__}, Python {platform.python_version()} ({sys.implementation.name}), {packages}.",
    ]


def _processor() -> str:
    """Name of the processor, from the system."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or "unknown processor"


def check_page(path: str | os.PathLike[str]) -> None:
    """Refuse a page without a place for the tables.

    Raises
    ------
    BadInput
        If the page cannot be read or written, or does not have the two marks in order, once each.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise BadInput(f"cannot read {path}: {reason}") from error
    if text.count(BEGIN) != 1 or text.count(END) != 1 or text.index(BEGIN) > text.index(END):
        raise BadInput(f"{path} has no place for the tables; expected one line {BEGIN!r} and one line {END!r} after it")
    if not os.access(path, os.W_OK):
        raise BadInput(f"cannot write {path}: permission denied")


def write_page(path: str | os.PathLike[str], text: str, begin: str = BEGIN, end: str = END) -> None:
    """Replace the text between two marks of a page."""
    page = Path(path).read_text(encoding="utf-8")
    before, _, rest = page.partition(begin)
    after = rest.partition(end)[2]
    write_text(path, f"{before}{begin}\n{text.strip()}\n{end}{after}")
