"""Output files of the commands: one set of options, checked before the work and written after it.

A file is written completely or not at all. ``-`` is standard output.
"""

from __future__ import annotations

import argparse
import json
import os
import stat
import sys
import tempfile
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO, cast

from branches.files import (
    DATABASE,
    FIGURE_FORMATS,
    WriteFailure,
    figure_format,
    is_database,
    is_special,
    reason,
    replacing,
    write_text,
)
from bvp.interrupts import InterruptHandler, defer_interrupts
from saltus.errors import DONE, FAILED, INTERRUPTED, BadInput, nearest, one_line, say, say_and_code
from saltus.terminal import StandardOutput, plain_stream

if TYPE_CHECKING:
    from branches.export.tables import Table

__all__ = [
    "STANDARD_OUTPUT",
    "NotDrawn",
    "Outputs",
    "WriteFailure",
    "add_arguments",
    "after",
    "apart",
    "check_writable",
    "draw",
    "json_text",
    "output_folder",
    "output_path",
    "outputs_of",
    "replacing",
    "write_data",
]

STANDARD_OUTPUT = "-"


def output_path(path: str) -> str:
    """The path of an option; ``-`` if it leads to standard output, as ``/dev/stdout`` does.

    Examples
    --------
    >>> output_path("branch.json"), output_path("-"), output_path(os.devnull) == os.devnull
    ('branch.json', '-', True)
    """
    try:
        there = os.stat(path)
        same = os.path.samestat(there, os.fstat(1)) and not stat.S_ISREG(there.st_mode)
        # What goes to the null device does not mix there.
        return STANDARD_OUTPUT if same and not os.path.samestat(there, os.stat(os.devnull)) else path
    except (OSError, ValueError):
        return path


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
    if figure and path == STANDARD_OUTPUT:
        raise BadInput("a figure cannot go to standard output: expected a file ending in .png, .pdf or .svg")
    if path == STANDARD_OUTPUT:
        return
    if figure:
        try:
            figure_format(path)
        except ValueError as error:
            raise BadInput(f"{error}{nearest(Path(path).suffix.lstrip('.'), FIGURE_FORMATS)}") from error
    if not path or "\0" in path:
        raise BadInput(f"cannot write {path!r}: expected the path of a file, or - for standard output")
    try:
        special = is_special(path)
        # What leads to a pipe, as /dev/stdout does, names no place in a directory.
        target = Path(path) if special else Path(os.path.realpath(path))
        if target.is_dir():
            raise BadInput(f"cannot write {path}: it is a directory, expected a file")
        if not target.parent.exists():
            raise BadInput(f"cannot write {path}: the directory {Path(path).parent} does not exist")
        if not target.parent.is_dir():
            raise BadInput(f"cannot write {path}: {Path(path).parent} is not a directory")
        if not special and not os.access(target.parent, os.W_OK | os.X_OK):
            read_only = hasattr(os, "statvfs") and os.statvfs(target.parent).f_flag & os.ST_RDONLY
            why = "the file system is read-only" if read_only else f"permission is denied in the directory {Path(path).parent}"
            raise BadInput(f"cannot write {path}: {why}")
        if target.exists() and not os.access(target, os.W_OK):
            raise BadInput(f"cannot write {path}: permission is denied")
        if not special and not database and is_database(target):
            raise BadInput(f"cannot write {path}: {DATABASE}")
        if not special:
            # The permissions may allow writing although the file system does not. Files are written via a temporary file, so try one.
            with tempfile.NamedTemporaryFile(dir=target.parent, prefix=".saltus-"):
                pass
    except OSError as error:
        raise BadInput(f"cannot write {path}: {reason(error)}") from error
    if isinstance(sys.stdout, StandardOutput):
        sys.stdout.outlasts = True


def output_folder(option: str, place: str, names: Iterable[str]) -> Path:
    """The folder for results, made if there is none. It is refused if one of the files cannot be written. `option` names it in messages."""
    if not place or "\0" in place:
        raise BadInput(f"{option} {place!r}: expected a folder")
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
    """Write text to a file, completely or not at all, or to standard output. `WriteFailure` gives the reason in words."""
    if path != STANDARD_OUTPUT:
        write_text(path, text)
        return
    try:
        stream = plain_stream()
        stream.write(text)
        stream.flush()
    except OSError as error:
        raise WriteFailure(f"cannot write standard output: {reason(error)}") from error


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


class NotDrawn(RuntimeError):
    """The result cannot be drawn in this way; the message gives the reason."""


def add_arguments(parser: argparse.ArgumentParser, *kinds: str, **meanings: str) -> None:
    """Add the options that name output files: kinds of `KINDS`, and others with the help of their option."""
    for kind in (*kinds, *meanings):
        parser.add_argument(f"--{kind}", metavar="FILE", type=output_path, help=meanings.get(kind, KINDS[kind]))


def outputs_of(arguments: argparse.Namespace) -> Outputs:
    """The output files that were asked for. Paths that cannot be written and two results in one place are refused."""
    places = {kind: path for kind in KINDS if (path := getattr(arguments, kind, None)) is not None}
    for kind, path in places.items():
        if kind in ARRAYS and path == STANDARD_OUTPUT:
            raise BadInput(f"{kind} cannot go to standard output: expected a file")
        check_writable(path, figure=kind == "plot")
    apart({f"--{kind}": path for kind, path in places.items()})
    to_stdout = STANDARD_OUTPUT in places.values()
    return Outputs(places, to_stdout, cast(TextIO, StandardOutput(sys.stderr)) if to_stdout else sys.stdout)


def apart(places: Mapping[str, str | None]) -> None:
    """Refuse one place for two results. The mapping gives the path of each option, None where it is not given.

    Examples
    --------
    >>> apart({"--json": "a.json", "--csv": "./a.json"})
    Traceback (most recent call last):
    saltus.errors.BadInput: --json and --csv both go to ./a.json: expected a place for each
    """
    taken: dict[str, str] = {}
    for option, path in places.items():
        if path is None:
            continue
        place = path if path == STANDARD_OUTPUT else os.path.realpath(path)
        if place in taken and (place == STANDARD_OUTPUT or not Path(place).exists() or Path(place).is_file()):
            where = "standard output" if path == STANDARD_OUTPUT else path
            raise BadInput(f"{taken[place]} and {option} both go to {where}: expected a place for each")
        taken[place] = option


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
    words: TextIO

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
        plot: Callable[[Path], None] | None = None,
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
            As for `branches.export.tables.write_binary`.
        plot : callable, optional
            Draws into the file that it is given.
        files : mapping of str to callable, optional
            For other kinds of files, a function that writes the file that it is given.
        notes : mapping of str to str, optional
            Description of the content of each kind of file.

        Returns
        -------
        int
            The exit code: 130 if an interrupt came, 2 if a file could not be written, 1 if a figure could not be drawn. Each is
            reported on standard error.
        """
        direct = {**(files or {}), **({} if plot is None else {"plot": plot})}
        texts = texts or {}
        made = None if table is None else cache(table)
        code = DONE
        with defer_interrupts() as interrupt:
            for kind, path in self.places.items():
                try:
                    if kind in direct:
                        with replacing(path) as beside:
                            direct[kind](beside)
                    elif kind in ARRAYS:
                        from branches.export.tables import write_binary

                        assert made is not None
                        with replacing(path) as beside, beside.open("wb") as file:
                            write_binary(made(), kind, file, about=None if about is None else about(), cells=cells)
                    elif kind in texts:
                        write_data(path, texts[kind]())
                    else:
                        from branches.export.tables import csv_text

                        assert made is not None
                        write_data(path, csv_text(made()))
                except WriteFailure as failure:
                    code = max(code, say_and_code(failure))
                except NotDrawn as failure:
                    say(one_line(failure))
                    code = max(code, FAILED)
                else:
                    if path != STANDARD_OUTPUT:
                        self.report([f"wrote  {path}" + (f": {notes[kind]}" if notes and kind in notes else "")])
        return after(interrupt, code)


def draw(figure: str, data: Any, path: Path, **options: Any) -> None:
    """Draw data into a file. With all but the path bound, it is the `plot` of `Outputs.write`. What draws is loaded here.

    Parameters
    ----------
    figure : str
        The function that makes the figure, as "module:function".
    data, **options
        What it takes.
    path : path-like
    """
    from pkgutil import resolve_name

    from branches.figures.style import write_figure

    write_figure(resolve_name(figure), path, data, **options)


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


def after(interrupt: InterruptHandler, code: int) -> int:
    """The exit code after work that an interrupt had to wait for."""
    if interrupt.came and code != INTERRUPTED:
        say("interrupted; what was computed is written")
        return INTERRUPTED
    return code
