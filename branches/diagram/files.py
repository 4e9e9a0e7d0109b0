"""Picture files: which formats there are, and how a figure becomes the same bytes each time."""

from __future__ import annotations

import io
import os
from collections.abc import Callable
from pathlib import Path
from typing import IO, TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PICTURE_FORMATS = ("png", "pdf", "svg")

_UNDATED = {"png": {}, "pdf": {"CreationDate": None}, "svg": {"Date": None}}


def picture_format(path_or_file: str | os.PathLike[str] | IO[bytes], format: str | None = None) -> str:
    """The format that a picture will have: the one asked for, else the one that the file's name ends with.

    Needs no matplotlib, so a wrong name is found before any work is done.

    Parameters
    ----------
    path_or_file : path, or binary file open for writing
    format : "png", "pdf" or "svg" in any case; required for a file without a name that ends so.

    Returns
    -------
    str
        One of `PICTURE_FORMATS`.

    Raises
    ------
    ValueError
        When the format is not one of these.

    Examples
    --------
    >>> picture_format("backbone.PDF")
    'pdf'
    >>> picture_format("backbone.jpg")
    Traceback (most recent call last):
    ...
    ValueError: unknown picture format 'jpg' of 'backbone.jpg': expected png, pdf or svg
    """
    name = getattr(path_or_file, "name", "") if hasattr(path_or_file, "write") else os.fspath(path_or_file)
    name = name if isinstance(name, str) else ""
    found = Path(name).suffix[1:] if format is None else format.lstrip(".")
    if found.lower() in PICTURE_FORMATS:
        return found.lower()
    said = f"unknown picture format {found!r}" if found else "no picture format"
    raise ValueError(f"{said}{f' of {name!r}' if name else ''}: expected png, pdf or svg")


def draw(make: Callable[[], Figure], path_or_file: str | os.PathLike[str] | IO[bytes], format: str | None = None) -> None:
    """Make a figure and write it, both with the settings of pictures; the format is checked before.

    Parameters
    ----------
    make : callable
        Returns the figure.
    path_or_file, format
        As for `picture_format`.

    Raises
    ------
    ValueError
        For another format.
    OSError
        When the file cannot be written.
    """
    from branches.diagram.style import picture_settings

    kind = picture_format(path_or_file, format)
    with picture_settings():
        save(make(), path_or_file, kind)


def save(figure: Figure, path_or_file: str | os.PathLike[str] | IO[bytes], format: str) -> None:
    """Write `figure` without a date; a file that is replaced stays as it was until the new one is whole.

    Parameters
    ----------
    figure : matplotlib Figure
    path_or_file : path, or binary file open for writing
    format : one of `PICTURE_FORMATS`

    Raises
    ------
    OSError
        When the file cannot be written.
    """
    picture = io.BytesIO()
    figure.savefig(picture, format=format, metadata=_UNDATED[format])
    if hasattr(path_or_file, "write"):
        path_or_file.write(picture.getvalue())
        return
    path = Path(path_or_file)
    if path.exists() and not path.is_file():  # a device or a pipe cannot be replaced by a file
        path.write_bytes(picture.getvalue())
        return
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        beside.write_bytes(picture.getvalue())
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)
