"""The points of a family as rows: columns for what is asked for in queries, blobs of float64 for the rest, and back, bit for bit.

``layout`` tells what the blobs of a family's points hold: ``states`` is a list of [name, width] (width null for a column of one number
a point), all little-endian float64 one behind the other; ``multipliers`` their number, as (re, im). ``derived`` names the
columns that are not stored because others give them exactly.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from branches.catalogue.errors import CatalogueDamaged

__all__ = ["POINT_COLUMNS", "columns_of", "layout_of", "rows_of"]

NUMBERS = ("h", "alpha", "arclength", "tau", "tau_half", "residual", "trivial", "pairing")
WHOLE = {"stable": np.int8, "reliable": bool, "half_waves": int}

POINT_COLUMNS = (*NUMBERS, *WHOLE, "label", "states", "states_crc", "multipliers", "multipliers_crc")

Columns = dict[str, np.ndarray]


def layout_of(columns: Columns, ends: tuple[str, str]) -> dict[str, Any]:
    """How the points of a family are laid out.

    Raises
    ------
    ValueError
        For a column that cannot be kept.
    """
    given = _derived(columns, ends)
    derived = [name for name, values in given.items() if name in columns and _same(values, columns[name])]
    states: list[list[Any]] = []
    for name, values in columns.items():
        if name in (*NUMBERS, *WHOLE, "label", "multipliers") or name in derived:
            continue
        if values.dtype != np.float64 or values.ndim > 2:
            raise ValueError(f"column {name!r} of the points has the type {values.dtype} {values.shape}, expected float64, one or two axes")
        states.append([name, values.shape[1] if values.ndim == 2 else None])
    return {"states": states, "multipliers": columns["multipliers"].shape[1], "derived": derived}


def rows_of(columns: Columns, layout: dict[str, Any]) -> tuple[list[tuple[Any, ...]], int]:
    """The rows of the points, in the order of `POINT_COLUMNS`, and the checksum of their columns."""
    count = len(columns["h"])
    parts = [columns[name].reshape(count, -1) for name, _ in layout["states"]]
    states = np.ascontiguousarray(np.concatenate(parts, axis=1) if parts else np.empty((count, 0)), "<f8")
    multipliers = np.ascontiguousarray(columns["multipliers"], "<c16")
    lists: list[Sequence[Any]] = [_nulls(columns[name]) for name in NUMBERS]
    lists += [[int(value) for value in columns[name]] for name in WHOLE]
    lists.append([str(label) for label in columns["label"]])
    for values in (states, multipliers):
        blobs = [row.tobytes() for row in values]
        lists += [blobs, [zlib.crc32(blob) for blob in blobs]]
    return list(zip(*lists, strict=True)), _crc(lists[: len(NUMBERS) + len(WHOLE) + 1])


def columns_of(
    rows: Iterable[tuple[Any, ...]], layout: dict[str, Any], ends: tuple[str, str], columns_crc: int, where: str
) -> Columns:
    """The inverse of `rows_of`.

    Parameters
    ----------
    rows : iterable of tuple
        In the order of `POINT_COLUMNS`.
    layout, ends, columns_crc
        Of their family.
    where : str
        File and family, for messages.

    Raises
    ------
    CatalogueDamaged
        Naming the point and the part whose checksum does not fit.
    """
    lists = dict(zip(POINT_COLUMNS, zip(*rows, strict=True), strict=True))
    if _crc([lists[name] for name in (*NUMBERS, *WHOLE, "label")]) != columns_crc:
        raise CatalogueDamaged(f"{where}: the columns of its points do not fit their checksum")
    for name in ("states", "multipliers"):
        for i, (blob, crc) in enumerate(zip(lists[name], lists[f"{name}_crc"], strict=True)):
            if zlib.crc32(blob) != crc:
                raise CatalogueDamaged(f"{where}: the {name} of point {i} do not fit their checksum")
    count = len(lists["h"])
    columns: Columns = {name: np.array(lists[name], dtype=float) for name in NUMBERS}
    columns |= {name: np.array(lists[name], dtype=kind) for name, kind in WHOLE.items()}
    columns["label"] = np.array(lists["label"], dtype=str)
    width = sum(1 if size is None else size for _, size in layout["states"])
    states = np.frombuffer(b"".join(lists["states"]), "<f8").reshape(count, width)
    at = 0
    for name, size in layout["states"]:
        part = states[:, at : at + (1 if size is None else size)]
        columns[name] = np.ascontiguousarray(part[:, 0] if size is None else part, float)
        at += part.shape[1]
    columns["multipliers"] = np.frombuffer(b"".join(lists["multipliers"]), "<c16").reshape(count, layout["multipliers"]).astype(complex)
    derived = _derived(columns, ends)
    for name in layout["derived"]:
        columns[name] = derived[name]
    return columns


def _derived(columns: Columns, ends: tuple[str, str]) -> Columns:
    """What other columns give: by the expressions that made them, so to the last bit."""
    frequency = 2.0 * np.pi / (4.0 * columns["alpha"])
    start = columns["start_v"]
    return {
        "frequency": frequency,
        "frequency_index": columns["half_waves"] * frequency,
        "velocities": start.copy() if ends[0] == "origin" else np.full(start.shape, np.nan),
    }


def _same(one: np.ndarray, other: np.ndarray) -> bool:
    return one.shape == other.shape and one.dtype == other.dtype and one.tobytes() == other.tobytes()


def _nulls(values: np.ndarray) -> list[float | None]:
    """Numbers for SQLite, which has no NaN."""
    return [None if value != value else value for value in values.tolist()]


def _crc(lists: Sequence[Sequence[Any]]) -> int:
    crc = 0
    for name, values in zip((*NUMBERS, *WHOLE, "label"), lists, strict=True):
        if name == "label":
            data = "\n".join(values).encode()
        else:
            data = np.array([np.nan if value is None else value for value in values], "<f8").tobytes()
        crc = zlib.crc32(data, crc)
    return crc
