"""The data of a picture of many families as one table: a row for each point, and what holds for all of it apart.

Rows are of kind "family" (a point of a family), "manifold" (one energy of the impulsive motions: h and frequency) and "impulsive" (a
periodic impulsive orbit). Rows with the same `curve` are one line of the picture.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.diagram.atlas_data import Atlas, Bound, Curve
from branches.export.picture_data import DATA_FORMATS, ExportError, Layout, data_format, read_data, told, write_data

if TYPE_CHECKING:
    from branches.diagram.atlas_data import Atlas

__all__ = ["COLUMNS", "DATA_FORMATS", "ExportError", "KINDS", "TEXTS", "data_format", "from_table", "read_atlas", "to_table", "write_atlas"]

KINDS = ("family", "manifold", "impulsive")

TEXTS = ("kind", "family", "name", "label", "event")
WHOLE = ("curve", "pinned", "half_waves", "stable", "joined")
NUMBERS = ("h", "alpha", "frequency", "frequency_index")
COLUMNS = ("kind", "curve", "family", "name", "pinned", "label", *NUMBERS, "half_waves", "stable", "joined", "event")
"""Columns, besides `velocities`: name is what the family is called there, pinned is 1 where a scene pins that, label is that of the point;
stable is 1, 0, or -1 where it is undecided; joined is 1 where the manifold goes on to the next row; event is the type of the special point
there. NaN: does not exist."""


def to_table(atlas: Atlas) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """What holds for all, as plain data, and the columns, all of one length; `velocities` has a column for each coordinate."""
    about = {
        "schema": 1,
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
        curve = Curve(
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


def _rows(kind: str, number: int, curve: Curve) -> dict[str, np.ndarray]:
    count = len(curve.h)
    return {
        "kind": np.full(count, kind),
        "curve": np.full(count, number),
        "family": np.full(count, curve.family),
        "name": curve.names.astype(str),
        "pinned": curve.pinned.astype(int),
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


def _curve(columns: Mapping[str, np.ndarray], rows: np.ndarray) -> Curve:
    numbers = {name: columns[name][rows] for name in NUMBERS}
    return Curve(
        str(columns["family"][rows[0]]),
        columns["name"][rows].astype(str),
        columns["pinned"][rows] == 1,
        half_waves=columns["half_waves"][rows],
        stable=columns["stable"][rows],
        velocities=columns["velocities"][rows],
        labels=columns["label"][rows],
        events=columns["event"][rows].astype(str),
        **numbers,
    )


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
