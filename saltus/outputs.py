"""The files that a command was asked for: checked together before the work, written together after it."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TextIO

from bvp.interrupts import Held, held
from saltus.errors import DONE, FAILED, INTERRUPTED, BadInput, nearest, one_line, say, say_and_code
from saltus.files import STANDARD_OUTPUT, WriteFailure, check_picture, check_writable, output_path, replacing, write_data
from saltus.printing import words_stream

__all__ = ["NotDrawn", "Outputs", "add_arguments", "add_json", "after", "apart", "from_arguments"]

ARRAYS = ("npz", "mat")
"""Kinds of files of arrays."""

_HYPHEN = "; - is standard output, which then carries nothing else"


class NotDrawn(RuntimeError):
    """What was computed has no such picture; the message says why in words."""


def apart(places: Mapping[str, str | None]) -> None:
    """Refuse one place for two results.

    Parameters
    ----------
    places : mapping
        Of each option its path, ``-`` for standard output, None where it is not given.

    Raises
    ------
    saltus.errors.BadInput

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
    """Where the results go; None for what was not asked for.

    Attributes
    ----------
    json, csv : str or None
        Paths, or ``-`` for standard output.
    plot : str or None
        Path of a picture.
    npz, mat : str or None
        Paths of files of arrays.
    arrays : str or None
        Path of a file of arrays whose ending tells which kind it is.
    """

    json: str | None = None
    csv: str | None = None
    plot: str | None = None
    npz: str | None = None
    mat: str | None = None
    arrays: str | None = None

    def check(self) -> None:
        """Refuse what could not be written.

        Raises
        ------
        saltus.errors.BadInput
            For a path that cannot be written, an unknown picture format, or one place for two results.
        """
        for path in (self.json, self.csv):
            if path is not None:
                check_writable(path)
        for kind, path in (("npz", self.npz), ("mat", self.mat)):
            if path == STANDARD_OUTPUT:
                raise BadInput(f"{kind} cannot go to standard output: expected a file")
            if path is not None:
                check_writable(path)
        if self.arrays is not None:
            suffix = _suffix(self.arrays)
            if self.arrays == STANDARD_OUTPUT or suffix not in ARRAYS:
                expected = f"expected a file ending in {' or '.join(ARRAYS)}{nearest(suffix, ARRAYS)}"
                raise BadInput(f"unknown format of {self.arrays!r} for --arrays: {expected}")
            check_writable(self.arrays)
        if self.plot is not None:
            check_picture(self.plot)
        apart({f"--{name}": getattr(self, name) for name in ("json", "csv", "plot", *ARRAYS, "arrays")})

    @property
    def words(self) -> TextIO:
        """The stream for what is printed: standard error where standard output carries data."""
        return words_stream(STANDARD_OUTPUT in (self.json, self.csv))

    def write(
        self,
        json: Callable[[], str],
        csv: Callable[[], str],
        draw: Callable[[Path], None],
        arrays: Callable[[str, IO[bytes]], None] | None = None,
    ) -> int:
        """Write what was asked for. One failure does not keep the others from being written, nor does an interrupt.

        Parameters
        ----------
        json, csv : callable
            Return the text of the file.
        draw : callable
            Draws into the file that it is given.
        arrays : callable, optional
            Writes arrays in the format that it is given, "npz" or "mat", into the file that it is given.

        Returns
        -------
        int
            The exit code: 130 if an interrupt came, 2 if a file could not be written, 1 if a picture could not be drawn; each is said on
            standard error.
        """

        def picture(path: str) -> None:
            with replacing(path) as beside:
                draw(beside)

        def binary(kind: str) -> Callable[[str], None]:
            def write(path: str) -> None:
                assert arrays is not None
                with replacing(path) as beside, beside.open("wb") as file:
                    arrays(kind, file)

            return write

        code = DONE
        jobs = (
            (self.json, lambda path: write_data(path, json())),
            (self.csv, lambda path: write_data(path, csv())),
            (self.npz, binary("npz")),
            (self.mat, binary("mat")),
            (self.plot, picture),
            (self.arrays, binary(_suffix(self.arrays or ""))),
        )
        with held() as interrupt:
            for path, job in jobs:
                if path is None:
                    continue
                try:
                    job(path)
                except WriteFailure as failure:
                    code = say_and_code(failure)
                except NotDrawn as failure:
                    say(one_line(failure))
                    code = max(code, FAILED)
                else:
                    if path != STANDARD_OUTPUT:
                        print(f"wrote  {path}", file=self.words, flush=True)
        return after(interrupt, code)


def after(interrupt: Held, code: int) -> int:
    """The exit code after work that an interrupt had to wait for."""
    if interrupt.came and code != INTERRUPTED:
        say("interrupted; what was computed is written")
        return INTERRUPTED
    return code


def _suffix(path: str) -> str:
    return Path(path).suffix[1:].lower()


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add ``--json``."""
    parser.add_argument("--json", metavar="FILE", type=output_path, help=f"write all data as JSON{_HYPHEN}")


def add_arguments(parser: argparse.ArgumentParser, *, arrays: bool = False) -> None:
    """Add ``--json``, ``--csv`` and ``--plot``; and ``--npz`` and ``--mat``, for a command that has arrays."""
    add_json(parser)
    parser.add_argument("--csv", metavar="FILE", type=output_path, help=f"write all data as CSV{_HYPHEN}")
    if arrays:
        parser.add_argument("--npz", metavar="FILE", help="write all data as arrays of numpy")
        parser.add_argument("--mat", metavar="FILE", help="write all data as arrays of Matlab")
    parser.add_argument("--plot", metavar="FILE", help="draw a picture: FILE.png, FILE.pdf or FILE.svg")


def from_arguments(arguments: argparse.Namespace) -> Outputs:
    """Return the outputs asked for, checked."""
    arrays = {name: getattr(arguments, name, None) for name in (*ARRAYS, "arrays")}
    outputs = Outputs(json=arguments.json, csv=arguments.csv, plot=arguments.plot, **arrays)
    outputs.check()
    return outputs
