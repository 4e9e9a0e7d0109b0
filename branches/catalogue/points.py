"""The points of a family: a row each, with columns for what is asked for in queries, and three blobs for all of them together.

``layout`` tells what the blobs hold, as lists of [name, width] (width null for a column of one number a point): ``states``, from which the
orbits are solved again; ``others``; ``multipliers`` is their number, as (re, im). ``derived`` names the columns that are not stored
because others give them exactly. Multipliers are stored as differences from what tau gives, impact speeds as differences from those of an
exact flight over the flight times.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from branches.catalogue.coding import decode, encode
from branches.catalogue.errors import CatalogueDamaged

if TYPE_CHECKING:
    from bvp.multipoint import MultipointProblem

__all__ = ["BLOBS", "POINT_COLUMNS", "Packed", "columns_of", "layout_of", "rows_of"]

NUMBERS = ("h", "alpha", "arclength", "tau")
POINT_COLUMNS = (*NUMBERS, "stable", "label")
BLOBS = ("states", "multipliers", "others")
STATES = ("start_u", "start_v", "flight_times")
TYPES = {"reliable": bool, "half_waves": int}
"""Columns of `others` that are no float64."""

Columns = dict[str, np.ndarray]


class Packed(NamedTuple):
    """The points of a family as they are stored: rows in the order of `POINT_COLUMNS`, their checksum, blobs in the order of `BLOBS`."""

    rows: list[tuple[Any, ...]]
    columns_crc: int
    blobs: tuple[bytes, ...]


def layout_of(columns: Columns, ends: tuple[str, str]) -> dict[str, Any]:
    """How the points of a family are laid out.

    Raises
    ------
    ValueError
        For a column that cannot be kept.
    """
    given = _derived(columns, ends)
    derived = [name for name, values in given.items() if name in columns and _same(values, columns[name])]
    layout: dict[str, Any] = {"states": [], "multipliers": columns["multipliers"].shape[1], "others": [], "derived": derived}
    for name, values in columns.items():
        if name in (*POINT_COLUMNS, "multipliers") or name in derived:
            continue
        if (values.dtype != np.float64 and name not in TYPES) or values.ndim > 2:
            raise ValueError(f"column {name!r} of the points has the type {values.dtype} {values.shape}, expected float64, one or two axes")
        layout["states" if name in STATES else "others"].append([name, values.shape[1] if values.ndim == 2 else None])
    return layout


def rows_of(columns: Columns, layout: dict[str, Any], problem: MultipointProblem) -> Packed:
    """The points as they are stored."""
    count = len(columns["h"])
    lists: list[Sequence[Any]] = [_nulls(columns[name]) for name in NUMBERS]
    lists.append([int(value) for value in columns["stable"]])
    lists.append([str(label) for label in columns["label"]])
    blobs = []
    for name in BLOBS:
        if name == "multipliers":
            values = np.ascontiguousarray(columns[name], complex).view(float)
        else:
            parts = [columns[part].reshape(count, -1).astype(float) for part, _ in layout[name]]
            values = np.concatenate(parts, axis=1) if parts else np.empty((count, 0))
        blobs.append(encode(values, _predicted(name, columns, layout, problem)))
    return Packed(list(zip(*lists, strict=True)), _crc(lists), tuple(blobs))


def columns_of(packed: Packed, layout: dict[str, Any], problem: MultipointProblem, where: str) -> Columns:
    """The inverse of `rows_of`; that the blobs fit their own checksums was seen before.

    Parameters
    ----------
    packed : Packed
    layout : dict
        Of the family.
    problem : MultipointProblem
        Of the family's orbits.
    where : str
        File and family, for messages.

    Raises
    ------
    CatalogueDamaged
        Naming the part that does not fit.
    """
    lists = dict(zip(POINT_COLUMNS, zip(*packed.rows, strict=True), strict=True))
    try:
        fits = _crc([lists[name] for name in POINT_COLUMNS]) == packed.columns_crc
    except (TypeError, ValueError):
        # A text where a number was, or the other way round.
        fits = False
    if not fits:
        raise CatalogueDamaged(f"{where}: the columns of its points do not fit their checksum")
    count = len(lists["h"])
    columns: Columns = {name: np.array(lists[name], dtype=float) for name in NUMBERS}
    columns["stable"] = np.array(lists["stable"], dtype=np.int8)
    columns["label"] = np.array(lists["label"], dtype=str)
    for name, blob in zip(BLOBS, packed.blobs, strict=True):
        try:
            width = 2 * layout[name] if name == "multipliers" else sum(1 if size is None else size for _, size in layout[name])
            values = decode(blob, count, width, _predicted(name, columns, layout, problem))
        except ValueError as error:
            raise CatalogueDamaged(f"{where}: the {name} of its points: {error}") from error
        if name == "multipliers":
            columns[name] = values.view(complex)
            continue
        at = 0
        for part, size in layout[name]:
            block = values[:, at : at + (1 if size is None else size)]
            columns[part] = np.ascontiguousarray(block[:, 0] if size is None else block).astype(TYPES.get(part, float))
            at += block.shape[1]
    derived = _derived(columns, problem.ends)
    for name in layout["derived"]:
        columns[name] = derived[name]
    return columns


# -- what columns say of others -----------------------------------------------------------------------------------------------


def _derived(columns: Columns, ends: tuple[str, str]) -> Columns:
    """What other columns give: by the expressions that made them, so to the last bit."""
    frequency = 2.0 * np.pi / (4.0 * columns["alpha"])
    start = columns["start_v"]
    return {
        "frequency": frequency,
        "frequency_index": columns["half_waves"] * frequency,
        "velocities": start.copy() if ends[0] == "origin" else np.full(start.shape, np.nan),
    }


def _predicted(name: str, columns: Columns, layout: dict[str, Any], problem: MultipointProblem) -> np.ndarray | None:
    """Numbers near those of a blob, from columns that are read before it; NaN where there are none."""
    if name == "multipliers" and layout[name] == 2:
        return _multipliers(columns["tau"])
    if name == "others" and any(part == "impact_speeds" for part, _ in layout[name]):
        parts = [
            _speeds(columns, problem) if part == "impact_speeds" else np.full((len(columns["h"]), size or 1), np.nan)
            for part, size in layout[name]
        ]
        return np.concatenate(parts, axis=1)
    return None


def _multipliers(tau: np.ndarray) -> np.ndarray:
    """Real and imaginary parts, (N, 4), of the pair of multipliers whose product is 1 and whose sum is tau."""
    half = 0.5 * tau
    with np.errstate(all="ignore"):
        root = np.sqrt(np.abs((half - 1.0) * (half + 1.0)))
        outer = half + np.copysign(root, half)
        circle, zero = np.abs(half) < 1.0, np.zeros(len(tau))
        return np.stack(
            [
                np.where(circle, half, outer), np.where(circle, root, zero),
                np.where(circle, half, 1.0 / outer), np.where(circle, -root, zero),
            ], axis=1,
        )  # fmt: skip


def _speeds(columns: Columns, problem: MultipointProblem) -> np.ndarray:
    """Impact speeds of exact flights from the start over the flight times, of all points at once; NaN for a system with damping."""
    from branches.stability import impact_speeds

    segment, (_, mean, _, _) = problem.segment, problem.modes.blocks
    start = np.concatenate([columns["start_u"], columns["start_v"]], axis=1)
    # Term by term: what a matrix product gives to the last bit is not the same everywhere.
    state = np.array([sum(start[:, j] * row[j] for j in range(problem.size)) for row in problem.modes.from_state]).T
    starts, times = state, columns["flight_times"]
    ends = np.full((len(state), problem.inner + 1, problem.size), np.nan)
    with np.errstate(all="ignore"):
        for i in range(problem.inner + 1) if not mean.any() else ():
            ends[:, i] = _flown(problem, state, times[:, i])
            if i < problem.inner:
                rate = sum(ends[:, i, j] * segment.gap_rate[i, j] for j in range(problem.size))
                state = ends[:, i] - (segment.jump[i] * rate)[:, None] * segment.push[i]
        return impact_speeds(problem, starts, ends)


def _flown(problem: MultipointProblem, states: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Where undamped free flights over times (N,) lead from states (N, 2 n): the formulas of `bvp.kernels.flight`."""
    pairs, _, delta, matrix = problem.modes.blocks
    out = np.full(states.shape, np.nan)
    for (i, j), square in zip(pairs, delta, strict=True):
        if j < 0:
            continue
        rate = np.sqrt(abs(square))
        c, s = (np.cos(rate * times), np.sin(rate * times) / rate) if square < 0.0 else (np.ones(len(times)), times)
        x, y = states[:, i], states[:, j]
        out[:, i] = (c + s * matrix[i, i]) * x + s * matrix[i, j] * y
        out[:, j] = s * matrix[j, i] * x + (c + s * matrix[j, j]) * y
    return out


def _same(one: np.ndarray, other: np.ndarray) -> bool:
    return one.shape == other.shape and one.dtype == other.dtype and one.tobytes() == other.tobytes()


def _nulls(values: np.ndarray) -> list[float | None]:
    """Numbers for SQLite, which has no NaN."""
    return [None if value != value else value for value in values.tolist()]


def _crc(lists: Sequence[Sequence[Any]]) -> int:
    crc = 0
    for name, values in zip(POINT_COLUMNS, lists, strict=True):
        if name == "label":
            data = "\n".join(values).encode()
        else:
            data = np.array([np.nan if value is None else value for value in values], "<f8").tobytes()
        crc = zlib.crc32(data, crc)
    return crc
