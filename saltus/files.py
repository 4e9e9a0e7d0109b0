"""Output files of the command line: checked before any work starts, written whole or not at all, `-` for standard output."""

from __future__ import annotations

import os
import stat
import tempfile
from collections.abc import Iterable
from pathlib import Path

from branches.files import (
    DATABASE,
    PICTURE_FORMATS,
    WriteFailure,
    is_database,
    is_special,
    picture_format,
    reason,
    replacing,
    write_text,
)
from saltus.errors import BadInput, nearest
from saltus.printing import outlast, plain_stream

__all__ = ["STANDARD_OUTPUT", "WriteFailure", "check_picture", "check_writable", "output_folder", "output_path", "replacing", "write_data"]

STANDARD_OUTPUT = "-"


def output_path(path: str) -> str:
    """The path of an option; ``-`` for one that leads to the pipe or terminal that is standard output, as ``/dev/stdout`` does.

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


def check_writable(path: str, *, database: bool = False) -> None:
    """Refuse a file that could not be written, before the work that would fill it.

    A command with a file to write goes on when standard output fails.

    Parameters
    ----------
    path : str
        A file's path, or ``-`` for standard output.
    database : bool
        Whether it is for a catalogue. A result takes no catalogue's place.

    Raises
    ------
    BadInput
        If the directory does not exist or may not be written, or `path` is a directory or a file that may not be written.

    Examples
    --------
    >>> check_writable("no/such/place/branch.json")
    Traceback (most recent call last):
    saltus.errors.BadInput: cannot write no/such/place/branch.json: the directory no/such/place does not exist
    """
    if path == STANDARD_OUTPUT:
        return
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
            # Some directories allow it and cannot: files are written beside, so one is tried.
            with tempfile.NamedTemporaryFile(dir=target.parent, prefix=".saltus-"):
                pass
    except OSError as error:
        raise BadInput(f"cannot write {path}: {reason(error)}") from error
    outlast()


def output_folder(option: str, place: str, names: Iterable[str]) -> Path:
    """The folder that results go into, made if there is none, after looking whether every file can be written.

    Parameters
    ----------
    option : str
        What names it, for messages.
    place : str
    names : iterable of str
        The files.

    Raises
    ------
    BadInput
        If it cannot be made, is a file, or one of the files cannot be written.
    """
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


def check_picture(path: str) -> None:
    """Refuse a picture whose format is unknown or that could not be written.

    Parameters
    ----------
    path : str
        A file's path; its suffix tells the format.

    Raises
    ------
    BadInput

    Examples
    --------
    >>> check_picture("branch.pgn")
    Traceback (most recent call last):
    saltus.errors.BadInput: unknown picture format 'pgn' of 'branch.pgn': expected png, pdf or svg; nearest: png
    """
    if path == STANDARD_OUTPUT:
        raise BadInput("a picture cannot go to standard output: expected a file ending in .png, .pdf or .svg")
    try:
        picture_format(path)
    except ValueError as error:
        raise BadInput(f"{error}{nearest(Path(path).suffix.lstrip('.'), PICTURE_FORMATS)}") from error
    check_writable(path)


def write_data(path: str, text: str) -> None:
    """Write data to a file, whole or not at all, or to standard output.

    Parameters
    ----------
    path : str
        A file's path, or ``-`` for standard output.
    text : str

    Raises
    ------
    WriteFailure
        With the reason in words.
    """
    if path != STANDARD_OUTPUT:
        write_text(path, text)
        return
    try:
        stream = plain_stream()
        stream.write(text)
        stream.flush()
    except OSError as error:
        raise WriteFailure(f"cannot write standard output: {reason(error)}") from error
