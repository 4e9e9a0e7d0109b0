"""Tables of points and orbits, and their files: CSV, JSON, NPZ, MAT.

A table is a dict of columns of equal length: arrays (N,), arrays (N, k), or lists of N arrays of any lengths. What has no finite value is
an empty cell, null, or NaN. ``stable`` is 1, 0 or -1 (undecided) in NPZ and MAT; true, false or empty in CSV and JSON, but where codes are
asked for.
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import IO, TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import pandas

    from branches.catalogue.rows import FamilyRow
    from branches.catalogue.store import CatalogueStore
    from branches.orbit import Orbit

__all__ = [
    "DEFAULT_COLUMNS", "POINT_NAMES", "Table", "csv_cell", "csv_lines", "csv_text", "dataframe", "json_lines", "orbit_rows",
    "orbit_samples", "plain", "plain_columns", "points_table", "table_text", "write_binary",
]  # fmt: skip

_PLAIN = str.maketrans({",": ";", '"': "'", "#": "no. ", "\n": " "})

Table = dict[str, "np.ndarray | list[np.ndarray]"]


def dataframe(content: Any, caller: str) -> pandas.DataFrame:
    """Rows or columns as a pandas table, for a function with a name; an ImportError in one line where pandas is not installed."""
    try:
        import pandas
    except ImportError:
        raise ImportError(f"{caller} needs pandas, which is not installed; expected pip install pandas") from None
    return pandas.DataFrame(content)


def table_text(table: Table, format: str, name: str) -> str:
    """CSV or JSON text of a table.

    Parameters
    ----------
    table : Table
    format : {"csv", "json"}
        CSV: an array (N, k) takes k columns ``name.1``, ``name.2``, a complex number two, ``.re`` and ``.im``; numbers of a list of
        arrays share one cell, separated by spaces. JSON: ``{"schema", name: [row, ...]}``, complex numbers as [re, im].
    name : str
        Of the list of rows in JSON.
    """
    if format == "csv":
        return csv_text(table)
    columns = plain_columns(table)
    return json_lines({"schema": 1, name: [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]})


def json_lines(record: Mapping[str, Any], broken: Collection[str] | None = None) -> str:
    """JSON with a line for each entry of the lists with some names, or of all, so that files can be compared by line."""
    lines = []
    for key, value in record.items():
        text = json.dumps(value, allow_nan=False, default=_unwritten)
        if isinstance(value, list) and value and (broken is None or key in broken):
            text = "[\n    " + ",\n    ".join(json.dumps(entry, allow_nan=False) for entry in value) + "\n  ]"
        lines.append(f"  {json.dumps(key)}: {text}")
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _unwritten(value: object) -> object:
    if callable(value):
        raise ValueError("a force that is a Python function is not written to files; expected a formula")
    raise TypeError(f"no JSON of {value!r}")


def csv_text(table: Table, *, codes: bool = False) -> str:
    """CSV text of a table: a line of names, a line for each row; `codes` leaves ``stable`` as 1, 0, -1."""
    titled: dict[str, list[str]] = {}
    for key, values in plain_columns(table, codes=codes).items():
        titled |= _cells(key, values, table[key])
    return csv_lines(titled, zip(*titled.values(), strict=True))


def csv_lines(names: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """CSV text: a line of names, a line for each row."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([names, *rows])
    return text.getvalue()


def plain_columns(table: Table, *, codes: bool = False) -> dict[str, list[Any]]:
    """The columns as JSON has them: None for what is not finite, [re, im] for a complex number."""
    columns = {key: plain(values) for key, values in table.items()}
    if "stable" in columns and not codes:
        columns["stable"] = [None if code < 0 else bool(code) for code in columns["stable"]]
    return columns


def _cells(name: str, values: list[Any], column: np.ndarray | list[np.ndarray]) -> dict[str, list[str]]:
    """The CSV columns of one column."""
    if isinstance(column, list) or (column.ndim == 1 and not np.iscomplexobj(column)):
        return {name: [csv_cell(value) for value in values]}
    if column.ndim == 2:
        out: dict[str, list[str]] = {}
        for k in range(column.shape[1]):
            out |= _cells(f"{name}.{k + 1}", [value[k] for value in values], column[:, k])
        return out
    pairs = [value or (None, None) for value in values]
    return {f"{name}.{part}": [csv_cell(pair[k]) for pair in pairs] for k, part in enumerate(("re", "im"))}


def write_binary(table: Table, format: str, file: IO[bytes], *, about: str | None = None, cells: bool = True) -> None:
    """Write NPZ or MAT.

    In NPZ a list of arrays is one flat array and `name_offsets` (N + 1,), where each begins; in MAT, where texts and lists of arrays are
    cells, the variables are named as the columns, dots become underscores. `about` is a text of its own. Without `cells`, texts in MAT are
    rows of a character matrix, filled up with spaces: cells of many texts are slow to read.
    """
    arrays: dict[str, Any] = {} if about is None else {"about": np.array(about) if format == "npz" else about}
    if format == "npz":
        for name, values in table.items():
            if isinstance(values, list):
                arrays[name] = np.concatenate(values) if values else np.empty(0)
                arrays[f"{name}_offsets"] = np.concatenate([[0], np.cumsum([len(value) for value in values])]).astype(int)
            else:
                arrays[name] = values
        np.savez_compressed(file, **arrays)
        return
    from scipy.io import savemat

    for name, values in table.items():
        if not cells and not isinstance(values, list) and values.dtype.kind == "U":
            values = np.char.add(values, " ")
        elif isinstance(values, list) or values.dtype.kind == "U":
            cell = np.empty((len(values), 1), dtype=object)
            for i, value in enumerate(values):
                cell[i, 0] = str(value) if isinstance(value, str) else value
            values = cell
        elif values.ndim == 1:
            values = values[:, None]
        arrays[name.replace(".", "_")] = values
    savemat(file, arrays, do_compression=True, long_field_names=True, oned_as="column")


def plain(value: Any) -> Any:
    """A value as JSON has it: null for what is not finite, [re, im] for a complex number."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, complex):
        return [value.real, value.imag] if math.isfinite(value.real) and math.isfinite(value.imag) else None
    return {key: plain(entry) for key, entry in value.items()} if isinstance(value, Mapping) else value


def csv_cell(value: Any) -> str:
    """A value as a cell of CSV. Commas, quotes and # in texts are replaced, because many readers of CSV do not know quoting."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list):
        return " ".join(csv_cell(entry) for entry in value)
    return repr(value) if isinstance(value, float) else str(value).translate(_PLAIN)


POINT_NAMES = (
    "family", "point", "label", "h", "alpha", "frequency", "frequency_index", "half_waves", "arclength", "stable", "tau", "tau_half",
    "velocities", "multipliers", "residual", "trivial", "pairing", "reliable", "start_u", "start_v", "flight_times", "impact_speeds",
)  # fmt: skip

DEFAULT_COLUMNS = POINT_NAMES[:15]

_RAGGED = ("flight_times", "impact_speeds")
"""Columns whose rows differ in length from family to family."""


def points_table(catalogue: CatalogueStore, families: Sequence[FamilyRow], columns: Sequence[str] = DEFAULT_COLUMNS) -> Table:
    """The points of families of a catalogue, one family after the other.

    `columns` are from `POINT_NAMES`: those of `branches.branch.Branch.points`, the family's id, and the index of the point.
    """
    parts: dict[str, list[np.ndarray]] = {name: [] for name in columns}
    for row in families:
        points = dict(catalogue.points(row.id))
        points["family"] = np.full(row.points, row.id)
        points["point"] = np.arange(row.points)
        for name in columns:
            parts[name].append(points[name])
    table: Table = {}
    for name, arrays in parts.items():
        if name in _RAGGED:
            table[name] = [row for array in arrays for row in array]
        else:
            table[name] = np.concatenate(arrays) if arrays else np.empty(0)
    return table


def orbit_rows(found: Sequence[tuple[str, Orbit]]) -> Table:
    """A row for each orbit, given with the id of its family: its properties, its start, and its impacts over a period."""
    orbits = [orbit for _, orbit in found]
    states = [np.concatenate(orbit.sample(np.zeros(1)), axis=1)[0] for orbit in orbits]
    n = orbits[0].system.degrees_of_freedom if orbits else 0
    starts = np.array(states).reshape(len(orbits), 2 * n)
    multipliers = [orbit.multipliers for orbit in orbits]

    def column(*names: str) -> Table:
        return {name: np.array([getattr(orbit, name) for orbit in orbits]) for name in names}

    return {
        "family": np.array([id for id, _ in found], dtype=str),
        "label": np.array([orbit.label for orbit in orbits], dtype=str),
        **column("h", "alpha"),
        "stable": np.array([-1 if orbit.stable is None else int(orbit.stable) for orbit in orbits], dtype=np.int8),
        **column("tau", "tau_half"),
        "multipliers": np.array(multipliers, complex).reshape(len(orbits), len(multipliers[0]) if orbits else 0),
        **column("residual"),
        "start_u": starts[:, :n],
        "start_v": starts[:, n:],
        "impact_times": [np.array([impact.time for impact in orbit.impacts]) for orbit in orbits],
        "impact_speeds": [np.array([impact.speed for impact in orbit.impacts]) for orbit in orbits],
        "impact_stops": np.array([" ".join(impact.stop for impact in orbit.impacts) for orbit in orbits], dtype=str),
    }


def orbit_samples(found: Sequence[tuple[str, Orbit]], count: int) -> Table:
    """The motion of each orbit, given with the id of its family, over one period: time, displacements u and velocities v at `count` evenly
    spaced times, both ends included. One orbit follows the other."""
    times, u, v = [], [], []
    for _, orbit in found:
        t = np.linspace(0.0, orbit.period, count)
        at = orbit.sample(t)
        times.append(t)
        u.append(at[0])
        v.append(at[1])
    repeated = np.repeat(np.arange(len(found)), count)
    ids = np.array([id for id, _ in found], dtype=str)
    energies, quarters = (np.array([getattr(orbit, name) for _, orbit in found]) for name in ("h", "alpha"))
    return {
        "orbit": repeated,
        "family": ids[repeated],
        "label": np.array([orbit.label for _, orbit in found], dtype=str)[repeated],
        "h": energies[repeated],
        "alpha": quarters[repeated],
        "time": np.concatenate(times) if times else np.empty(0),
        "u": np.concatenate(u) if u else np.empty((0, 0)),
        "v": np.concatenate(v) if v else np.empty((0, 0)),
    }
