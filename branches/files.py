"""Safe writing of files: a temporary file replaces the target on success, so a failed run leaves the old file unchanged."""

from __future__ import annotations

import errno
import os
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from bvp.texts import shown

__all__ = [
    "DATABASE", "FIGURE_FORMATS", "SQLITE", "WriteFailure", "is_database", "is_special", "one_line", "figure_format", "read_input",
    "reason", "replacing", "write_text",
]  # fmt: skip

DATABASE = "it is an SQLite file, as catalogues are; expected another file"
"""Why a result does not take its place."""

SQLITE = b"SQLite format 3\0"
"""How such a file begins."""

FIGURE_FORMATS = ("png", "pdf", "svg")

MOST_BYTES = 1 << 30
"""Size of the largest file that is read: longer ones are no input, but a pipe or a file by mistake."""

_WORDS = {
    errno.ENOSPC: "no space is left on the device",
    errno.EFBIG: "the file would be larger than the system allows (ulimit -f)",
    errno.EDQUOT: "the disk quota is used up",
    errno.EACCES: "permission is denied",
    errno.EPERM: "permission is denied",
    errno.EROFS: "the file system is read-only",
    errno.ENOENT: "no such file or directory",
    errno.ENOTDIR: "a part of the path is not a directory",
    errno.EISDIR: "it is a directory",
    errno.ENAMETOOLONG: "the name is too long",
    errno.EPIPE: "the reader has closed it",
    errno.EMFILE: "too many files are open (ulimit -n)",
    errno.ENFILE: "too many files are open on this machine",
}


class WriteFailure(RuntimeError):
    """A file could not be written; the message names it and says why."""


def reason(error: OSError) -> str:
    """Say why the operating system refused.

    Examples
    --------
    >>> reason(OSError(errno.ENOSPC, "No space left on device"))
    'no space is left on the device'
    """
    known = _WORDS.get(error.errno) if error.errno is not None else None
    return known or error.strerror or str(error)


def one_line(error: BaseException) -> str:
    """Return an error's message as one line.

    Examples
    --------
    >>> one_line(ValueError("a stop\\n  has no gap"))
    'a stop has no gap'
    >>> one_line(OSError(errno.EMFILE, "Too many open files", "branch.json"))
    'too many files are open (ulimit -n): branch.json'
    """
    text = "the memory is too small for this" if isinstance(error, MemoryError) else str(error)
    if isinstance(error, OSError) and error.errno is not None:
        text = reason(error) + ("" if error.filename is None else f": {error.filename}")
    return " ".join(text.split()) or type(error).__name__


def is_special(path: str | os.PathLike[str]) -> bool:
    """Whether a path leads to what is neither a file nor a directory: a pipe, a device.

    Examples
    --------
    >>> is_special(__file__), is_special("."), is_special("no/such/place"), is_special(os.devnull)
    (False, False, False, True)
    """
    if not isinstance(path, str | os.PathLike):
        raise TypeError(f"a path is text; received {shown(path)}, expected the name of a file")
    path = Path(path)
    return path.exists() and not path.is_file() and not path.is_dir()


def figure_format(path_or_file: str | os.PathLike[str] | IO[bytes], format: str | None = None) -> str:
    """The format of a figure: the given one, else the suffix of the file's name.

    Raises
    ------
    ValueError
        For a format that is not one of `FIGURE_FORMATS`.

    Examples
    --------
    >>> figure_format("backbone.PDF")
    'pdf'
    >>> figure_format("backbone.jpg")
    Traceback (most recent call last):
    ...
    ValueError: unknown figure format 'jpg' of 'backbone.jpg': expected png, pdf or svg
    """
    name = getattr(path_or_file, "name", "") if hasattr(path_or_file, "write") else os.fspath(path_or_file)
    name = name if isinstance(name, str) else ""
    found = Path(name).suffix[1:] if format is None else format.lstrip(".")
    if found.lower() in FIGURE_FORMATS:
        return found.lower()
    what = f"unknown figure format {found!r}" if found else "no figure format"
    raise ValueError(f"{what}{f' of {name!r}' if name else ''}: expected png, pdf or svg")


def is_database(path: str | os.PathLike[str]) -> bool:
    """Whether a file begins as an SQLite file does; False for one that cannot be read.

    Examples
    --------
    >>> is_database(__file__)
    False
    """
    try:
        with open(path, "rb") as file:
            return file.read(len(SQLITE)) == SQLITE
    except OSError:
        return False


def read_input(path: str | os.PathLike[str]) -> bytes:
    """The bytes of a file, or of a pipe that somebody writes into.

    Raises
    ------
    OSError
        Also for a device, and for what has no end.
    """
    with open(path, "rb") as file:
        mode = os.fstat(file.fileno()).st_mode
        if stat.S_ISCHR(mode) or stat.S_ISBLK(mode):
            raise OSError("it is a device, expected a file")
        content = bytearray()
        while len(content) <= MOST_BYTES and (part := file.read(1 << 20)):
            content += part
    if len(content) > MOST_BYTES:
        raise OSError(f"it is larger than {MOST_BYTES >> 20} MB")
    return bytes(content)


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a temporary file beside `path`, which takes its place when the block ends without an error.

    A catalogue is not replaced: it may be hours of work, and its name is typed beside those of results.

    The temporary file has the suffix of `path`, the mode of the file it replaces (else the user's default mode), and is on
    disk before it is moved. A link is followed. What is not a regular file (a pipe, ``/dev/null``) cannot be replaced: the
    block then gets `path` itself.

    Raises
    ------
    WriteFailure
        If the file cannot be written; an old file at `path` is then unchanged.

    Examples
    --------
    >>> directory = tempfile.TemporaryDirectory()
    >>> target = Path(directory.name, "numbers.txt")
    >>> with replacing(target) as beside:
    ...     _ = beside.write_text("1 2 3")
    >>> target.read_text(), len(list(target.parent.iterdir()))
    ('1 2 3', 1)
    >>> directory.cleanup()
    """
    try:
        if is_special(path):
            yield Path(path)
            return
        target = Path(os.path.realpath(path))
        if target.is_dir():
            raise IsADirectoryError(errno.EISDIR, "is a directory")
        if is_database(target):
            raise WriteFailure(f"cannot write {path}: {DATABASE}")
        # The prefix has a fixed length: with the name in it, a long name could exceed the limit of the file system.
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=".saltus-", suffix=target.suffix)
        os.close(handle)
        beside = Path(name)
        try:
            yield beside
            mask = os.umask(0)
            os.umask(mask)
            beside.chmod(stat.S_IMODE(target.stat().st_mode) if target.exists() else 0o666 & ~mask)
            with beside.open("rb+") as file:
                os.fsync(file.fileno())
            os.replace(beside, target)
        finally:
            beside.unlink(missing_ok=True)
    except OSError as error:
        raise WriteFailure(f"cannot write {path}: {reason(error)}") from error


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write `text` as UTF-8 to `path`: completely, or not at all.

    Raises
    ------
    WriteFailure
        If the file cannot be written; an old file at `path` is then unchanged.
    """
    with replacing(path) as beside:
        beside.write_text(text, encoding="utf-8", newline="")
