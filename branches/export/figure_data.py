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
import math
import os
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.export.tables import Table, csv_text, plain_columns, write_binary
from branches.figures.atlas_data import Atlas, AtlasCurve, Bound
from branches.files import one_line, read_input, reason, replacing, write_text
from branches.naming.labels import most_alike

if TYPE_CHECKING:
    from branches.figures.atlas_data import Atlas

__all__ = [
    "COLUMNS", "DATA_FORMATS", "DATA_FORMATS", "KINDS", "TEXTS", "ExportError", "ExportError", "Layout", "data_format", "data_format",
    "from_table", "read_atlas", "read_figure_data", "to_table", "reporting", "write_atlas", "write_figure_data",
]  # fmt: skip

DATA_FORMATS = ("csv", "json", "npz", "mat")


class ExportError(ValueError):
    """A file that holds no data of a figure, or a format that does not exist; the message is one line."""


@dataclass(frozen=True)
class Layout:
    """The columns of a file.

    Attributes
    ----------
    content : str
        Its kind, as ``about`` says it.
    columns : tuple of str
        Names of the columns with one entry in a row, in order.
    wide : tuple of str
        Names of those with several, which follow.
    texts, integers : tuple of str
        Those of `columns` that hold texts, and integers. The others hold numbers, NaN for none.
    schema : int
    renamed : dict of str to str
        Names of columns in older schemas, by their names today.
    """

    content: str
    columns: tuple[str, ...]
    wide: tuple[str, ...] = ()
    texts: tuple[str, ...] = ()
    integers: tuple[str, ...] = ()
    schema: int = 1
    renamed: Mapping[str, str] = field(default_factory=dict)

    def about(self, about: Any) -> dict[str, Any]:
        """The head of a file, if it is of this kind and of a schema that can be read."""
        if not isinstance(about, dict) or about.get("content") != self.content:
            raise ValueError(f"it does not say that it holds {'an' if self.content[0] in 'aeiou' else 'a'} {self.content}")
        if about.get("schema") not in range(1, self.schema + 1):
            raise ValueError(f"its schema is {about.get('schema')!r}, expected {' or '.join(map(str, range(1, self.schema + 1)))}")
        return about

    def stored(self, about: Mapping[str, Any]) -> dict[str, str]:
        """The names of all columns in a file with this head, by their names today."""
        older = self.renamed if about["schema"] < self.schema else {}
        return {name: older.get(name, name) for name in (*self.columns, *self.wide)}


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
        plain = plain_columns(dict(columns), codes=True)
        lines = ",\n".join(f"    {json.dumps(name)}: {json.dumps(values, allow_nan=False)}" for name, values in plain.items())
        write_text(path, f'{head[:-1]},\n  "columns": {{\n{lines}\n  }}\n}}\n')
    else:
        with replacing(path) as beside, beside.open("wb") as file:
            write_binary(dict(columns), kind, file, about=head, cells=False)


def read_figure_data(layout: Layout, path: str | os.PathLike[str]) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
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
    reader = {"csv": _from_csv, "json": _from_json, "npz": _from_npz, "mat": _from_mat}[kind]
    with reporting(name):
        about, columns = reader(layout, content)
        _check(layout, columns)
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


def _check(layout: Layout, columns: Mapping[str, np.ndarray]) -> None:
    for name in (*layout.columns, *layout.wide):
        if name not in columns:
            raise KeyError(name)
    lengths = {len(column) for column in columns.values()}
    if len(lengths) != 1:
        raise ValueError(f"its columns have different lengths, {', '.join(map(str, sorted(lengths)))}")
    for name in (*layout.columns, *layout.wide):
        if name not in (*layout.texts, *layout.integers) and not np.issubdtype(columns[name].dtype, np.number):
            raise ValueError(f"the column {name} holds what is no number")


def _from_csv(layout: Layout, content: bytes) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    head, _, rest = content.decode("utf-8").partition("\n")
    if not head.startswith("# {"):
        raise ValueError("its first line is not # {...}")
    about = layout.about(json.loads(head[2:]))
    rows = list(csv.reader(io.StringIO(rest)))
    if len({len(row) for row in rows}) != 1:
        raise ValueError("its rows have different numbers of cells, or there are none")
    cells = dict(zip(rows[0], zip(*rows[1:], strict=True), strict=True)) if len(rows) > 1 else {}
    columns: dict[str, np.ndarray] = {}
    stored = layout.stored(about)
    for name in layout.columns:
        values = cells[stored[name]]
        if name in layout.texts:
            columns[name] = np.array(values)
        elif name in layout.integers:
            columns[name] = np.array([int(value) for value in values])
        else:
            columns[name] = np.array([float(value) if value else math.nan for value in values])
    for wide in layout.wide:
        names = [name for name in rows[0] if name.startswith(f"{wide}.")]
        columns[wide] = np.array([[float(value) if value else math.nan for value in cells[name]] for name in names]).T
    return about, columns


def _from_json(layout: Layout, content: bytes) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    record = layout.about(json.loads(content))
    kinds: dict[str, Any] = {**dict.fromkeys(layout.texts, str), **dict.fromkeys(layout.integers, int)}
    today = {old: name for name, old in layout.stored(record).items()}
    found = {today.get(name, name): values for name, values in record.pop("columns").items()}
    return record, {name: np.array(values, dtype=kinds.get(name, float)) for name, values in found.items()}


def _from_npz(layout: Layout, content: bytes) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    with np.load(io.BytesIO(content), allow_pickle=False) as file:
        about = layout.about(json.loads(str(file["about"])))
        return about, {name: file[old] for name, old in layout.stored(about).items()}


def _from_mat(layout: Layout, content: bytes) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        file = loadmat(io.BytesIO(content), chars_as_strings=True)
    except (MatReadError, zlib.error, OSError) as error:
        raise ValueError(str(error)) from error
    about = layout.about(json.loads(str(file["about"][0])))
    columns = {}
    for name, old in layout.stored(about).items():
        values = file[old]
        if name in layout.texts:
            columns[name] = np.array([str(cell).rstrip() for cell in values])
        else:
            columns[name] = values if name in layout.wide else values[:, 0]
        if name in layout.integers:
            columns[name] = columns[name].astype(int)
    return about, columns


KINDS = ("family", "manifold", "impulsive")

TEXTS = ("kind", "family", "name", "label", "event")
INTEGERS = ("curve", "cited", "half_waves", "stable", "joined")
NUMBERS = ("h", "alpha", "frequency", "frequency_index")
COLUMNS = ("kind", "curve", "family", "name", "cited", "label", *NUMBERS, "half_waves", "stable", "joined", "event")
"""Columns, besides `velocities`: name is what the family is called there, cited is 1 where a scene cites that, label is that of the point;
stable is 1, 0, or -1 where it is undecided; joined is 1 where the manifold goes on to the next row; event is the type of the special point
there. NaN: does not exist."""


def to_table(atlas: Atlas) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
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
        nowhere = np.full(count, np.nan)
        curve = AtlasCurve(
            "", np.full(count, ""), np.zeros(count, dtype=bool),
            h=atlas.manifold_h, alpha=nowhere, frequency=atlas.manifold_frequency, frequency_index=nowhere,
            half_waves=np.zeros(count, dtype=int), stable=np.full(count, -1), velocities=atlas.manifold_velocities,
            labels=np.full(count, ""), events=np.full(count, ""),
        )  # fmt: skip
        parts.append({**_rows("manifold", len(atlas.curves), curve), "joined": atlas.manifold_joined.astype(int)})
    if atlas.impulsive is not None:
        parts.append(_rows("impulsive", len(atlas.curves) + 1, atlas.impulsive))
    if not parts:
        raise ValueError("there is nothing to export: no family, no impulsive orbit has a point in the range asked for")
    return about, {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _rows(kind: str, number: int, curve: AtlasCurve) -> dict[str, np.ndarray]:
    count = len(curve.h)
    return {
        "kind": np.full(count, kind),
        "curve": np.full(count, number),
        "family": np.full(count, curve.family),
        "name": curve.names.astype(str),
        "cited": curve.cited.astype(int),
        "label": curve.labels.astype(str),
        **{name: np.asarray(getattr(curve, name), dtype=float) for name in NUMBERS},
        "half_waves": np.asarray(curve.half_waves, dtype=int),
        "stable": np.asarray(curve.stable, dtype=int),
        "joined": np.zeros(count, dtype=int),
        "event": curve.events.astype(str),
        "velocities": np.asarray(curve.velocities, dtype=float),
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
    unknown = set(np.unique(kind).tolist()) - set(KINDS)
    if unknown:
        raise ValueError(f"rows of unknown kind {sorted(unknown)[0]!r}; expected {', '.join(KINDS)}")
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
    numbers = {name: columns[name][rows] for name in NUMBERS}
    return AtlasCurve(
        str(columns["family"][rows[0]]),
        columns["name"][rows].astype(str),
        columns["cited"][rows] == 1,
        half_waves=columns["half_waves"][rows],
        stable=columns["stable"][rows],
        velocities=columns["velocities"][rows],
        labels=columns["label"][rows],
        events=columns["event"][rows].astype(str),
        **numbers,
    )


_LAYOUT = Layout("atlas", COLUMNS, ("velocities",), TEXTS, INTEGERS, schema=2, renamed={"cited": "pinned"})


def write_atlas(atlas: Atlas, path: str | os.PathLike[str]) -> None:
    """Write the data of a figure: csv, json, npz or mat, as the file's name ends.

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
    write_figure_data(_LAYOUT, *to_table(atlas), path)


def read_atlas(path: str | os.PathLike[str]) -> Atlas:
    """Read the data of a figure.

    Parameters
    ----------
    path : path-like
        A name that ends in .csv, .json, .npz or .mat.

    Raises
    ------
    ExportError
        In one line: the file cannot be read, or what it lacks.
    """
    about, columns = read_figure_data(_LAYOUT, path)
    with reporting(os.fspath(path)):
        return from_table(about, columns)
