"""Files of the data of a picture of many families: see `branches.export.picture_data`."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from branches.export.atlas_table import COLUMNS, TEXTS, WHOLE, from_table, to_table
from branches.export.picture_data import DATA_FORMATS, ExportError, Layout, data_format, read_data, told, write_data

if TYPE_CHECKING:
    from branches.diagram.atlas_data import Atlas

__all__ = ["DATA_FORMATS", "ExportError", "data_format", "read_atlas", "write_atlas"]

_LAYOUT = Layout("atlas", COLUMNS, ("velocities",), TEXTS, WHOLE)


def write_atlas(atlas: Atlas, path: str | os.PathLike[str]) -> None:
    """Write the data of a picture: csv, json, npz or mat, as the file's name ends.

    Raises
    ------
    ExportError
        For another ending.
    branches.files.WriteFailure
        If the file cannot be written; an old file is then unchanged.
    """
    write_data(_LAYOUT, *to_table(atlas), path)


def read_atlas(path: str | os.PathLike[str]) -> Atlas:
    """Read the data of a picture.

    Raises
    ------
    ExportError
        In one line: the file cannot be read, or what it lacks.
    """
    about, columns = read_data(_LAYOUT, path)
    with told(os.fspath(path)):
        return from_table(about, columns)
