"""Output files of the commands: one set of options, checked before the work and written after it.

A file is written completely or not at all. ``-`` is standard output.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from branches.files import DATABASE, FIGURE_FORMATS, WriteFailure, figure_format, is_database, is_special, reason, replacing, write_text
from bvp.interrupts import defer_interrupts
from saltus.errors import BAD_INPUT, DONE, FAILED, BadInput, nearest, one_line, say

if TYPE_CHECKING:
    from branches.tables import Table

__all__ = [
    "GuardedStream", "NotDrawn", "Outputs", "WriteFailure", "add_arguments", "check_writable", "json_text", "output_folder", "outputs_of",
    "write_data",
]  # fmt: skip

STANDARD_OUTPUT = "-"


class GuardedStream:
    """Standard output or standard error, whose disk may be full, or whose reader may have left. After a failure nothing more is printed.

    Attributes
    ----------
    outlasts : bool
        Whether the command goes on where printing fails: it has files to write.
    failure : OSError or None
        Why text could not be printed.
    """

    def __init__(self, stream: Any, *, outlasts: bool = False) -> None:
        self._stream = stream
        self.outlasts = outlasts
        self.failure: OSError | None = None

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Print and flush. Raise `OSError` where that fails and the command has no files to write."""
        if self.failure is None:
            try:
                self._stream.write(text)
                self._stream.flush()
            except OSError as error:
                self.failure = error
                if not self.outlasts:
                    raise
        return len(text)

    def flush(self) -> None:
        """Do nothing: `write` flushes."""


def check_writable(path: str, *, database: bool = False, figure: bool = False) -> None:
    """Refuse a file that could not be written, before the work that would fill it. With `database` it is a catalogue, whose place no other
    result may take. With `figure` its suffix gives the format of the figure. A command with a file to write goes on when standard output
    fails.

    Examples
    --------
    >>> check_writable("branch.pgn", figure=True)
    Traceback (most recent call last):
    saltus.errors.BadInput: unknown figure format 'pgn' of 'branch.pgn': expected png, pdf or svg; nearest: png
    >>> check_writable("no/such/place/branch.json")
    Traceback (most recent call last):
    saltus.errors.BadInput: cannot write no/such/place/branch.json: the directory no/such/place does not exist
    """
    if figure:
        try:
            figure_format(path)
        except ValueError as error:
            raise BadInput(f"{error}{nearest(Path(path).suffix.lstrip('.'), FIGURE_FORMATS)}") from error
    if path == STANDARD_OUTPUT:
        return
    try:
        special = is_special(path)
        # What leads to a pipe, as /dev/stdout does, names no place in a directory.
        target = Path(path) if special else Path(os.path.realpath(path))
        if target.is_dir():
            raise BadInput(f"cannot write {path}: it is a directory, expected a file")
        if not target.parent.is_dir():
            parent = target.parent if os.path.islink(path) else Path(path).parent
            raise BadInput(f"cannot write {path}: the directory {parent} does not exist")
        if target.exists() and not os.access(target, os.W_OK):
            raise BadInput(f"cannot write {path}: permission is denied")
        if not special:
            if not database and is_database(target):
                raise BadInput(f"cannot write {path}: {DATABASE}")
            # Files are written via a temporary file, so try one.
            with tempfile.NamedTemporaryFile(dir=target.parent, prefix=".saltus-"):
                pass
    except OSError as error:
        raise BadInput(f"cannot write {path}: {reason(error)}") from error
    if isinstance(sys.stdout, GuardedStream):
        sys.stdout.outlasts = True


def output_folder(option: str, place: str, names: Iterable[str]) -> Path:
    """The folder for results, made if there is none. It is refused if one of the files cannot be written. `option` names it in messages."""
    folder = Path(place)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError as error:
        raise BadInput(f"{option} {place}: it is a file, expected a folder") from error
    except OSError as error:
        raise BadInput(f"cannot make the folder {place}: {reason(error)}") from error
    for name in names:
        check_writable(str(folder / name))
    return folder


def write_data(path: str, text: str) -> None:
    """Write text to a file, completely or not at all, or to standard output. Raises `WriteFailure`."""
    if path == STANDARD_OUTPUT:
        print(text, end="")
    else:
        write_text(path, text)


WRITTEN = "what was computed is written"
"""Of an interrupt: what became of the results."""

SCHEMA = 1
"""Of the records that `Outputs.finish` writes."""

_HYPHEN = "; - is standard output"

TEXTS = {
    "json": f"write all data as JSON{_HYPHEN}",
    "csv": f"write all data as CSV{_HYPHEN}",
    "graphml": f"write the graph as GraphML{_HYPHEN}",
    "dot": f"write the graph as DOT, for Graphviz{_HYPHEN}",
}
"""Kinds of files that are text, with the help of their options."""

ARRAYS = {"npz": "write all data as numpy arrays", "mat": "write all data as Matlab arrays"}
"""Kinds of files of arrays, with the help of their options."""

KINDS = {**TEXTS, **ARRAYS, "plot": "draw a figure: FILE.png, FILE.pdf or FILE.svg"}
"""Every kind of output file: `KINDS` names the options of all commands."""


Drawing = tuple[str, Any, dict[str, Any]]
"""A figure: the function that makes it, as "module:function", what it draws, and its options."""


class NotDrawn(RuntimeError):
    """The result cannot be drawn in this way; the message gives the reason."""


def add_arguments(parser: argparse.ArgumentParser, *kinds: str, **meanings: str) -> None:
    """Add the options that name output files: kinds of `KINDS`, and others with the help of their option."""
    for kind in (*kinds, *meanings):
        parser.add_argument(f"--{kind}", metavar="FILE", help=meanings.get(kind, KINDS[kind]))


def outputs_of(arguments: argparse.Namespace) -> Outputs:
    """The output files that were asked for. Paths that cannot be written and two results in one place are refused."""
    places: dict[str, str] = {}
    taken: dict[str, str] = {}
    for kind in (*KINDS, "catalogue"):
        path = getattr(arguments, kind, None)
        if path is None:
            continue
        if not path:
            raise BadInput(f"--{kind}: the name of the file is empty")
        if kind != "catalogue":
            if kind in ARRAYS and path == STANDARD_OUTPUT:
                raise BadInput(f"{kind} cannot go to standard output: expected a file")
            check_writable(path, figure=kind == "plot")
            places[kind] = path
        place = path if path == STANDARD_OUTPUT else os.path.realpath(path)
        if place in taken:
            where = "standard output" if path == STANDARD_OUTPUT else path
            raise BadInput(f"{taken[place]} and --{kind} both go to {where}: expected a place for each")
        taken[place] = f"--{kind}"
    to_stdout = STANDARD_OUTPUT in places.values()
    return Outputs(places, to_stdout, sys.stderr if to_stdout else sys.stdout)


@dataclass(frozen=True)
class Outputs:
    """The output files of a command.

    Attributes
    ----------
    places : mapping of str to str
        The path of each requested kind of file, ``-`` for standard output.
    to_stdout : bool
        Whether standard output carries data.
    words : text stream
        The stream for printed lines: standard output, or standard error if standard output carries data.
    """

    places: Mapping[str, str]
    to_stdout: bool
    words: Any

    def report(self, lines: Iterable[str]) -> None:
        """Print lines."""
        text = "\n".join(lines)
        if text:
            print(text, file=self.words, flush=True)

    def finish(self, lines: Iterable[str], record: Callable[[], dict[str, Any]], **options: Any) -> int:
        """Print lines, and write the record if JSON is requested. If the record goes to standard output, the lines are not printed.
        `options` are passed to `write`. Returns the exit code."""
        if not self.to_stdout:
            self.report(lines)
        return self.write({"json": lambda: json_text({"schema": SCHEMA, **record()})}, **options)

    def write(
        self,
        texts: Mapping[str, Callable[[], str]] | None = None,
        *,
        table: Callable[[], Table] | None = None,
        about: Callable[[], str] | None = None,
        cells: bool = True,
        figure: Drawing | None = None,
        files: Mapping[str, Callable[[Path], None]] | None = None,
        notes: Mapping[str, str] | None = None,
    ) -> int:
        """Write the requested files. After a failure or an interrupt, the other files are still written.

        Parameters
        ----------
        texts : mapping of str to callable
            For each kind of `TEXTS` a function that returns the text of the file.
        table : callable, optional
            Returns the table of the files of arrays, and of a CSV file that is not in `texts`.
        about : callable, optional
            Returns a text that files of arrays contain in addition to the table.
        cells : bool
            As for `branches.tables.write_binary`.
        figure : Drawing, optional
            Of the kind ``plot``.
        files : mapping of str to callable, optional
            For other kinds of files, a function that writes the file that it is given.
        notes : mapping of str to str, optional
            Description of the content of each kind of file.

        Returns
        -------
        int
            The exit code: 2 if a file could not be written, 1 if a figure could not be drawn. Each is reported on standard error.

        Raises
        ------
        KeyboardInterrupt
            After the files are written, if an interrupt came.
        """
        texts, files = texts or {}, files or {}
        made = None if table is None else cache(table)
        code = DONE
        with defer_interrupts() as interrupt:
            for kind, path in self.places.items():
                try:
                    if kind in files:
                        with replacing(path) as beside:
                            files[kind](beside)
                    elif kind == "plot":
                        from pkgutil import resolve_name

                        from branches.figures.style import write_figure

                        assert figure is not None
                        make, data, options = figure
                        write_figure(resolve_name(make), path, data, **options)
                    elif kind in ARRAYS:
                        from branches.tables import write_binary

                        assert made is not None
                        with replacing(path) as beside, beside.open("wb") as file:
                            write_binary(made(), kind, file, about=None if about is None else about(), cells=cells)
                    elif kind in texts:
                        write_data(path, texts[kind]())
                    else:
                        from branches.tables import csv_text

                        assert made is not None
                        write_data(path, csv_text(made()))
                except (WriteFailure, NotDrawn) as failure:
                    say(one_line(failure))
                    code = max(code, FAILED if isinstance(failure, NotDrawn) else BAD_INPUT)
                else:
                    if path != STANDARD_OUTPUT:
                        self.report([f"wrote  {path}" + (f": {notes[kind]}" if notes and kind in notes else "")])
        if interrupt.came:
            raise KeyboardInterrupt(WRITTEN)
        return code


def json_text(record: dict[str, Any]) -> str:
    """JSON with one line for each entry of a list, so that files can be compared by line."""
    lines = []
    for key, value in record.items():
        if isinstance(value, list) and value and isinstance(value[0], dict):
            entries = ",\n    ".join(json.dumps(entry, allow_nan=False, ensure_ascii=False) for entry in value)
            lines.append(f"  {json.dumps(key)}: [\n    {entries}\n  ]")
        else:
            lines.append(f"  {json.dumps(key)}: {json.dumps(value, allow_nan=False, ensure_ascii=False)}")
    return "{\n" + ",\n".join(lines) + "\n}\n"
