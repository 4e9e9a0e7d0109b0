"""The data of a figure as files: columns of equal length, and a header with the values that are the same for all rows.

CSV: a first line ``# {...}`` with the head as JSON, then a line of names and a line for each row; an empty cell does not exist.
JSON: the head with ``"columns": {name: [...]}``; null does not exist. NPZ and MAT: an array for each column, and ``about``, the head as
JSON text. Numbers keep all their digits, so a figure drawn from a file is the same to the byte.

A figure of many families has rows of kind "family" (a point of a family), "manifold" (one energy of the impulsive motions: h and frequency)
and "impulsive" (a periodic impulsive orbit). Rows with the same `curve` are one line of the figure.
"""

from __future__ import annotations

import csv
import io
import json
import os
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from branches.figures.atlas_data import Atlas, AtlasCurve, Bound
from branches.files import one_line, read_input, reason, replacing, write_text
from branches.naming.labels import most_alike
from branches.tables import Table, csv_text, plain_columns, write_binary
from bvp.texts import shown

__all__ = [
    "DATA_FORMATS", "ExportError", "Layout", "data_format", "from_table", "read_atlas", "read_figure_data", "reporting", "to_table",
    "write_atlas", "write_figure_data",
]  # fmt: skip

DATA_FORMATS = ("csv", "json", "npz", "mat")

Columns = dict[str, np.ndarray]


class ExportError(ValueError):
    """A file that holds no data of a figure, or a format that does not exist; the message is one line."""


@dataclass(frozen=True)
class Layout:
    """The columns of a file.

    Attributes
    ----------
    content : str
        Its kind, as ``about`` says it.
    columns : dict of str to type
        The columns with one entry in a row, in order, as str, int or float; NaN for a number that does not exist.
    wide : tuple of str
        Columns of numbers with several entries in a row, which follow.
    schema : int
    """

    content: str
    columns: Mapping[str, type]
    wide: tuple[str, ...] = ()
    schema: int = 1

    def require(self, about: Any) -> None:
        """Refuse the head of a file of another kind, or of a schema that cannot be read."""
        if not isinstance(about, dict) or about.get("content") != self.content:
            raise ValueError(f"it does not say that it holds {'an' if self.content[0] in 'aeiou' else 'a'} {self.content}")
        if about.get("schema") != self.schema:
            raise ValueError(f"its schema is {about.get('schema')!r}, expected {self.schema}")


def data_format(path: str | os.PathLike[str]) -> str | None:
    """The format of data that a file's name ends with, None for another ending.

    Examples
    --------
    >>> data_format("plot.CSV"), data_format("plot.png")
    ('csv', None)
    """
    suffix = Path(path).suffix[1:].lower()
    return suffix if suffix in DATA_FORMATS else None


def write_figure_data(layout: Layout, about: Mapping[str, Any], columns: Mapping[str, np.ndarray], path: str | os.PathLike[str]) -> None:
    """Write csv, json, npz or mat, as the file's name ends.

    Raises
    ------
    ExportError
        For another ending.
    branches.files.WriteFailure
        If the file cannot be written; an old file is then unchanged.
    """
    kind = data_format(path)
    if kind is None:
        near = most_alike(Path(path).suffix[1:], DATA_FORMATS, 1)
        raise ExportError(f"unknown format of {os.fspath(path)!r}: expected {', '.join(DATA_FORMATS)}; nearest: {near[0]}")
    head = json.dumps(about, allow_nan=False)
    table: Table = {name: columns[name] for name in (*layout.columns, *layout.wide)}
    if kind == "csv":
        write_text(path, f"# {head}\n{csv_text(table, codes=True)}")
    elif kind == "json":
        plain = plain_columns(table, codes=True)
        lines = ",\n".join(f"    {json.dumps(name)}: {json.dumps(values, allow_nan=False)}" for name, values in plain.items())
        write_text(path, f'{head[:-1]},\n  "columns": {{\n{lines}\n  }}\n}}\n')
    else:
        with replacing(path) as beside, beside.open("wb") as file:
            write_binary(table, kind, file, about=head, cells=False)


def read_figure_data(layout: Layout, path: str | os.PathLike[str]) -> tuple[dict[str, Any], Columns]:
    """Read what `write_figure_data` wrote.

    Raises
    ------
    ExportError
        In one line: the file cannot be read, or what it lacks.
    """
    kind = data_format(path)
    name = os.fspath(path)
    if kind is None:
        raise ExportError(f"{name} is not a file of figure data: expected one that ends in {', '.join(DATA_FORMATS)}")
    try:
        content = read_input(path)
    except OSError as error:
        raise ExportError(f"cannot read {name}: {reason(error)}") from error
    with reporting(name):
        about, stored = {"csv": _from_csv, "json": _from_json, "npz": _from_npz, "mat": _from_mat}[kind](content)
        layout.require(about)
        if stored is None:
            raise KeyError("columns")
        types = {**layout.columns, **dict.fromkeys(layout.wide)}
        columns = {key: _column(stored[key], type) for key, type in types.items()}
        lengths = {len(column) for column in columns.values()}
        if len(lengths) != 1:
            raise ValueError(f"its columns have different lengths, {', '.join(map(str, sorted(lengths)))}")
        return about, columns


@contextmanager
def reporting(name: str) -> Iterator[None]:
    """Within the block, an error in the content of a file becomes an `ExportError` that names the file."""
    try:
        yield
    except KeyError as error:
        raise ExportError(f"{name} is not a file of figure data: it lacks {error.args[0]!r}") from error
    except (ValueError, TypeError, EOFError, IndexError, zipfile.BadZipFile, NotImplementedError) as error:
        raise ExportError(f"{name} is not a readable file of figure data: {one_line(error)}") from error


def _column(values: Any, type: type | None) -> np.ndarray:
    """A stored column as an array of a type; None as the type: numbers (N, k)."""
    if type in (str, int):
        array = np.asarray(values)
        array = array[:, 0] if array.ndim == 2 else array  # A MAT file has no vectors.
        return np.char.rstrip(array.astype(str)) if type is str else array.astype(int)
    try:
        array = np.asarray(values, dtype=float)
    except ValueError:  # Texts of a CSV file, some of them empty.
        cells = np.asarray(values)
        array = np.where(cells == "", "nan", cells).astype(float)
    return array[:, 0] if array.ndim == 2 and type is float else array


def _from_csv(content: bytes) -> tuple[Any, dict[str, Any]]:
    head, _, rest = content.decode("utf-8").partition("\n")
    if not head.startswith("# {"):
        raise ValueError("its first line is not # {...}")
    names, *rows = list(csv.reader(io.StringIO(rest))) or [[]]
    if not rows or {len(row) for row in rows} != {len(names)}:
        raise ValueError("its rows have different numbers of cells, or there are none")
    stored: dict[str, Any] = dict(zip(names, zip(*rows, strict=True), strict=True))
    for wide in {name.partition(".")[0] for name in names if "." in name}:
        stored[wide] = np.array([stored[name] for name in names if name.startswith(f"{wide}.")]).T
    return json.loads(head[2:]), stored


def _from_json(content: bytes) -> tuple[Any, Any]:
    record = json.loads(content)
    return record, record.pop("columns", None) if isinstance(record, dict) else None


def _from_npz(content: bytes) -> tuple[Any, dict[str, Any]]:
    with np.load(io.BytesIO(content), allow_pickle=False) as file:
        stored = dict(file)
    return json.loads(str(stored["about"])), stored


def _from_mat(content: bytes) -> tuple[Any, dict[str, Any]]:
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        file = loadmat(io.BytesIO(content), chars_as_strings=True)
    except (MatReadError, zlib.error, OSError) as error:
        raise ValueError(str(error)) from error
    return json.loads(str(file["about"][0])), file


_LAYOUT = Layout(
    "atlas",
    {
        "kind": str, "curve": int, "family": str, "name": str, "cited": int, "label": str, "h": float, "alpha": float, "frequency": float,
        "frequency_index": float, "half_waves": int, "stable": int, "joined": int, "event": str,
    },
    ("velocities",), schema=2,
)  # fmt: skip
"""name is what the family is called there, cited is 1 where a scene cites that, label is that of the point; stable is 1, 0, or -1 where it
is undecided; joined is 1 where the manifold goes on to the next row; event is the type of the special point there."""

_OF_CURVE = {
    "names": "name", "cited": "cited", "h": "h", "alpha": "alpha", "frequency": "frequency", "frequency_index": "frequency_index",
    "half_waves": "half_waves", "stable": "stable", "velocities": "velocities", "labels": "label", "events": "event",
}  # fmt: skip
"""Columns of the file by the attributes of an `AtlasCurve`."""


def to_table(atlas: Atlas) -> tuple[dict[str, Any], Columns]:
    """What holds for all, as plain data, and the columns, all of one length; `velocities` has a column for each coordinate."""
    about = {
        "schema": _LAYOUT.schema,
        "content": "atlas",
        "system": atlas.system.describe(),
        "clearance": atlas.clearance,
        "natural_frequency": atlas.natural_frequency,
        "energy": None if atlas.energy is None else list(atlas.energy),
        "manifold": {"window": atlas.manifold_window, "periods": atlas.manifold_periods},
        "bounds": [{"below": b.below, "above": b.above, "h": b.h, "what": b.what} for b in atlas.bounds],
    }
    parts = [_rows("family", k, curve) for k, curve in enumerate(atlas.curves)]
    count = len(atlas.manifold_h)
    if count:
        nowhere, texts, zeros = np.full(count, np.nan), np.full(count, ""), np.zeros(count, dtype=int)
        curve = AtlasCurve(
            "", texts, zeros, atlas.manifold_h, nowhere, atlas.manifold_frequency, nowhere, zeros, zeros - 1, atlas.manifold_velocities,
            texts, texts,
        )  # fmt: skip
        parts.append({**_rows("manifold", len(atlas.curves), curve), "joined": atlas.manifold_joined.astype(int)})
    if atlas.impulsive is not None:
        parts.append(_rows("impulsive", len(atlas.curves) + 1, atlas.impulsive))
    if not parts:
        raise ValueError("there is nothing to export: no family, no impulsive orbit has a point in the range asked for")
    return about, {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _rows(kind: str, number: int, curve: AtlasCurve) -> Columns:
    same = {"kind": kind, "curve": number, "family": curve.family, "joined": 0}
    return {
        **{name: np.full(len(curve.h), value) for name, value in same.items()},
        **{name: np.asarray(getattr(curve, attribute), _LAYOUT.columns.get(name, float)) for attribute, name in _OF_CURVE.items()},
    }


def from_table(about: Mapping[str, Any], columns: Mapping[str, np.ndarray]) -> Atlas:
    """The inverse of `to_table`.

    Raises
    ------
    ValueError, KeyError, TypeError
        For what is no such table.
    """
    from bvp.system import ImpactSystem

    kind = columns["kind"]
    unknown = set(np.unique(kind).tolist()) - {"family", "manifold", "impulsive"}
    if unknown:
        raise ValueError(f"rows of unknown kind {sorted(unknown)[0]!r}; expected family, manifold, impulsive")
    rows = np.flatnonzero(kind == "family")
    rows = rows[np.argsort(columns["curve"][rows], kind="stable")]
    parts = np.split(rows, np.flatnonzero(np.diff(columns["curve"][rows])) + 1) if len(rows) else []
    manifold = kind == "manifold"
    impulsive = np.flatnonzero(kind == "impulsive")
    return Atlas(
        ImpactSystem.from_description(about["system"]),
        tuple(_curve(columns, part) for part in parts),
        columns["h"][manifold],
        columns["frequency"][manifold],
        columns["joined"][manifold] == 1,
        str(about["manifold"]["window"]),
        int(about["manifold"]["periods"]),
        _curve(columns, impulsive) if len(impulsive) else None,
        tuple(Bound(str(b["below"]), str(b["above"]), float(b["h"]), str(b["what"])) for b in about["bounds"]),
        float(about["clearance"]),
        float(about["natural_frequency"]),
        None if about.get("energy") is None else (float(about["energy"][0]), float(about["energy"][1])),
    )


def _curve(columns: Mapping[str, np.ndarray], rows: np.ndarray) -> AtlasCurve:
    own = {attribute: columns[name][rows] for attribute, name in _OF_CURVE.items()}
    return AtlasCurve(str(columns["family"][rows[0]]), **{**own, "cited": own["cited"] == 1})


def write_atlas(atlas: Atlas, path: str | os.PathLike[str]) -> None:
    """Write the data of a figure of many families.

    Parameters
    ----------
    atlas : Atlas
    path : path-like
        A name that ends in .csv, .json, .npz or .mat.

    Raises
    ------
    ExportError
        For another ending.
    branches.files.WriteFailure
        If the file cannot be written; an old file is then unchanged.
    """
    if not isinstance(atlas, Atlas):
        raise TypeError(f"the data of a figure are {shown(atlas)}, expected an Atlas, as saltus.atlas_of makes it")
    write_figure_data(_LAYOUT, *to_table(atlas), path)


def read_atlas(path: str | os.PathLike[str]) -> Atlas:
    """Read the data of a figure of many families.

    Parameters
    ----------
    path : path-like
        A file of `saltus.write_atlas`.

    Raises
    ------
    ExportError
        In one line: the file cannot be read, or what it lacks.
    """
    about, columns = read_figure_data(_LAYOUT, path)
    with reporting(os.fspath(path)):
        return from_table(about, columns)
