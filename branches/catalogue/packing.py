"""Conversion of a branch to the rows of a catalogue. A worker does it; another process writes the rows.

The columns `QUERIED` are columns of a table, for queries. All others are in one compressed array, a numpy .npz file with one member:
``bytes`` (W, N) uint8, byte k of each of the N points in row k. The layout lists [name, dtype, shape] of the columns in this order.

Two kinds of columns become small before they are compressed. Both are taken as integers in the order of the floats, so that no bit is lost.

- ``smooth`` columns are replaced by their third differences along the family.
- ``predicted`` columns, which others give exactly or nearly, are replaced by the difference from this prediction. If a prediction changes
  by rounding, as between machines, the numbers change by as much.
"""

from __future__ import annotations

import io
import math
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any
from zipfile import BadZipFile

import numpy as np

from branches.catalogue.rows import FamilyRow, Interval, compact_json, event_values
from branches.orbit import impact_speeds
from branches.sequences import format_ends, impacts_per_period
from bvp.checks import require_branch
from bvp.functions import cos, sin

if TYPE_CHECKING:
    from branches.branch import Branch
    from branches.events import BranchEvent
    from bvp.multipoint import MultipointProblem
    from bvp.system import ImpactSystem

__all__ = [
    "PREDICTIONS", "QUERIED", "Columns", "Layout", "PackedFamily", "as_integers", "checksum_of_points", "decode", "encode",
    "folded", "label_intervals", "pack_family", "queried", "queried_rows", "stability_intervals", "stable_fraction", "unfolded",
]  # fmt: skip

QUERIED = ("h", "alpha", "arclength", "tau", "stable", "label")

_SMOOTH = ("start_u", "start_v", "flight_times", "tau_half", "unknowns", "tangents")

_ORDER = 3
"""Order of the differences of smooth columns: higher ones amplify rounding."""

Columns = dict[str, np.ndarray]
Layout = dict[str, list[tuple[str, str, list[int]]]]
"""Columns by kind: smooth, predicted, plain."""


def queried_rows(columns: Columns) -> list[tuple[Any, ...]]:
    """The columns `QUERIED` as rows of a table; NaN becomes None."""
    lists = [[None if value != value else value for value in columns[name].tolist()] for name in QUERIED]
    return list(zip(*lists, strict=True))


def queried(rows: list[tuple[Any, ...]]) -> Columns:
    """The inverse of `queried_rows`.

    Raises
    ------
    ValueError
        If a value has the wrong type.
    """
    types = {"stable": np.int8, "label": str}
    try:
        lists = zip(QUERIED, zip(*rows, strict=True), strict=True)
        return {name: np.array(values, dtype=types.get(name, float)) for name, values in lists}
    except (OverflowError, TypeError, ValueError) as error:
        raise ValueError(f"its points cannot be read: {error}") from error


def checksum_of_points(columns: Columns, arrays: bytes) -> int:
    """CRC32 of all that is stored of a family's points: the columns `QUERIED` and the .npz file."""
    crc = zlib.crc32(arrays)
    for name in QUERIED:
        crc = zlib.crc32(columns[name].tobytes(), crc)
    return crc


def encode(columns: Columns, problem: Any) -> tuple[bytes, Layout]:
    """All columns but `QUERIED` as an .npz file, with their layout.

    Raises
    ------
    ValueError
        For a column that cannot be stored.
    """
    layout: Layout = {"smooth": [], "predicted": [], "plain": []}
    parts: dict[str, list[np.ndarray]] = {kind: [] for kind in layout}
    for name, values in columns.items():
        if name in QUERIED:
            continue
        if values.dtype.kind not in "fcib":
            raise ValueError(f"column {name!r} of the points has the type {values.dtype}, expected numbers")
        kind, numbers = "plain", np.ascontiguousarray(values)
        if name in _SMOOTH:
            kind, numbers = "smooth", as_integers(values)
        elif name in PREDICTIONS and (predicted := _predicted(name, columns, problem)).shape == values.shape:
            kind, numbers = "predicted", as_integers(values) - as_integers(predicted)
        layout[kind].append((name, values.dtype.str, list(values.shape[1:])))
        parts[kind].append(numbers.view(np.uint8).reshape(len(values), _width(layout[kind][-1])))
    blocks = {kind: np.concatenate(block, axis=1) for kind, block in parts.items() if block}
    for kind, change in (("smooth", _differences), ("predicted", np.asarray)):
        if kind in blocks:
            blocks[kind] = folded(change(blocks[kind].view("<u8"))).view(np.uint8)
    file = io.BytesIO()
    np.savez_compressed(file, bytes=np.ascontiguousarray(np.concatenate(list(blocks.values()), axis=1).T))
    return file.getvalue(), layout


def decode(blob: bytes, layout: Layout, columns: Columns, problem: Any) -> Columns:
    """The inverse of `encode`: all columns, from the array's file, its layout, the columns `QUERIED` and the problem of the family's
    orbits.

    Raises
    ------
    ValueError
        If the file or its size is not as expected.
    """
    count, widths = len(columns["h"]), [sum(map(_width, listed)) for listed in layout.values()]
    try:
        stored = np.load(io.BytesIO(blob))["bytes"]
    except (OSError, KeyError, EOFError, ValueError, BadZipFile, zlib.error) as error:
        raise ValueError(f"its array cannot be read: {error}") from error
    if stored.shape != (sum(widths), count):
        raise ValueError(f"its array has the shape {stored.shape}, expected {sum(widths), count}")
    smooth, predicted, plain = (np.ascontiguousarray(block.T) for block in np.split(stored, np.cumsum(widths)[:-1]))
    columns = dict(columns)
    columns |= _columns(plain, layout["plain"])
    columns |= _columns(_ordered(_sums(unfolded(smooth))), layout["smooth"])
    if layout["predicted"]:
        others = [as_integers(_predicted(name, columns, problem)).reshape(count, -1) for name, _, _ in layout["predicted"]]
        columns |= _columns(_ordered(unfolded(predicted) + np.concatenate(others, axis=1)), layout["predicted"])
    return columns


def _columns(block: np.ndarray, listed: list[tuple[str, str, list[int]]]) -> Columns:
    """The columns in a block of numbers of all points."""
    data = block.view(np.uint8)
    columns, at = {}, 0
    for name, dtype, shape in listed:
        width = _width((name, dtype, shape))
        columns[name] = np.ascontiguousarray(data[:, at : at + width]).reshape(-1).view(dtype).reshape(len(data), *shape)
        at += width
    return columns


def _width(column: tuple[str, str, list[int]]) -> int:
    """Bytes of a column at each point."""
    _, dtype, shape = column
    return np.dtype(dtype).itemsize * math.prod(shape)


# -- integers -----------------------------------------------------------------------------------------------------------------


def as_integers(values: np.ndarray) -> np.ndarray:
    """Unsigned integers whose differences, modulo 2^64, count the floats between two values."""
    return _ordered(np.ascontiguousarray(values).view("<u8"))


def _ordered(bits: np.ndarray) -> np.ndarray:
    """Bits of floats as integers in order, and back: the bits of negative floats count backwards."""
    signed = bits.view("<i8")
    return (signed ^ ((signed >> 63) & np.int64(0x7FFFFFFFFFFFFFFF))).view("<u8")


def folded(differences: np.ndarray) -> np.ndarray:
    """Small unsigned integers for small differences of either sign."""
    signed = differences.view("<i8")
    return ((signed << 1) ^ (signed >> 63)).view("<u8")


def unfolded(values: np.ndarray) -> np.ndarray:
    """The inverse of `folded`, from an array of any type with 8 bytes a number."""
    numbers = values.view("<u8")
    return (numbers >> np.uint64(1)) ^ (np.uint64(0) - (numbers & np.uint64(1)))


def _differences(integers: np.ndarray) -> np.ndarray:
    for _ in range(_ORDER):
        integers = np.concatenate([integers[:1], integers[1:] - integers[:-1]])
    return integers


def _sums(differences: np.ndarray) -> np.ndarray:
    for _ in range(_ORDER):
        differences = np.cumsum(differences, axis=0, dtype=np.uint64)
    return differences


# -- predictions --------------------------------------------------------------------------------------------------------------


def _predicted(name: str, columns: Columns, problem: Any) -> np.ndarray:
    """A column as others give it; 0 where they give no finite number."""
    with np.errstate(all="ignore"):
        predicted = PREDICTIONS[name](columns, problem)
    return np.where(np.isfinite(predicted), predicted, 0.0)


def _multipliers(columns: Columns, problem: MultipointProblem) -> np.ndarray:
    """The pair of multipliers with product 1 and sum tau, (N, 2) complex."""
    half = 0.5 * columns["tau"]
    root = np.sqrt(np.abs((half - 1.0) * (half + 1.0)))
    outer = half + np.copysign(root, half)
    circle = np.abs(half) < 1.0
    pairs = np.zeros((len(half), 2), complex)
    pairs.real = np.where(circle, half, [outer, 1.0 / outer]).T
    pairs.imag = np.where(circle, [root, -root], 0.0).T
    return pairs


def _speeds(columns: Columns, problem: MultipointProblem) -> np.ndarray:
    """Impact speeds of exact flights from the start over the flight times; NaN for a system with damping."""
    if problem.pieces > 1:
        problem = type(problem)(problem.system, problem.ends, problem.sequence)  # what a reader has
    contacts, mean = problem.modes.contacts, problem.modes.mean
    start = np.concatenate([columns["start_u"], columns["start_v"]], axis=1)
    # Term by term: the last bits of a matrix product depend on the machine.
    state = np.array([sum(start[:, j] * row[j] for j in range(problem.size)) for row in problem.modes.from_state]).T
    starts, times = state, columns["flight_times"]
    ends = np.full((len(state), problem.inner + 1, problem.size), np.nan)
    for i in range(problem.inner + 1) if not mean.any() else ():
        ends[:, i] = _flown(problem, state, times[:, i])
        if i < problem.inner:
            hit = problem.contacts[i]
            rate = sum(ends[:, i, j] * contacts.rate[hit, j] for j in range(problem.size))
            state = ends[:, i] - ((1.0 + contacts.restitution[hit]) * rate)[:, None] * contacts.push[hit]
    return impact_speeds(problem, starts, ends)


def _flown(problem: MultipointProblem, states: np.ndarray, times: np.ndarray) -> np.ndarray:
    """States after undamped free flights over times (N,) from states (N, 2 n): the formulas of `bvp.kernels.flight`."""
    pairs, _, delta, matrix = problem.modes.flight
    out = np.full(states.shape, np.nan)
    for (i, j), square in zip(pairs, delta, strict=True):
        if j < 0:
            continue
        rate = np.sqrt(abs(square))
        c, s = (cos(rate * times), sin(rate * times) / rate) if square < 0.0 else (np.ones(len(times)), times)
        x, y = states[:, i], states[:, j]
        out[:, i] = (c + s * matrix[i, i]) * x + s * matrix[i, j] * y
        out[:, j] = s * matrix[j, i] * x + (c + s * matrix[j, j]) * y
    return out


PREDICTIONS: dict[str, Callable[[Columns, MultipointProblem], np.ndarray]] = {
    "frequency": lambda columns, _: 2.0 * np.pi / (4.0 * columns["alpha"]),
    "frequency_index": lambda columns, _: columns["half_waves"] * (2.0 * np.pi / (4.0 * columns["alpha"])),
    "velocities": lambda columns, problem: columns["start_v"] if problem.ends[0] == "origin" else np.full(columns["start_v"].shape, np.nan),
    "multipliers": _multipliers,
    "impact_speeds": _speeds,
}


@dataclass(frozen=True)
class PackedFamily:
    """The rows of one family, with the description of its system. `row` has the number 0, `points` have the columns `QUERIED`, and `arrays`
    is an .npz file with all other columns of the points."""

    system: dict[str, Any]
    row: FamilyRow
    points: list[tuple[Any, ...]]
    arrays: bytes
    events: list[tuple[Any, ...]]


def pack_family(branch: Branch) -> PackedFamily:
    """Pack a family into the rows of a catalogue, in any process; `saltus.Catalogue.add` takes them in place of the branch.

    Parameters
    ----------
    branch : Branch

    Raises
    ------
    ValueError
        For a column of its points that cannot be stored.
    """
    require_branch(branch)
    columns = branch.points
    arrays, layout = encode(columns, branch.problem)
    labels = label_intervals(columns, branch.events)
    stability = stability_intervals(columns, branch.events)
    ended = tuple((str(end.reason), end.text) for end in branch.ended)
    details = {"labels": labels, "stability": stability, "ended": ended, "layout": layout}
    forms = [(event.coefficient, event.criticality) for event in branch.events]
    if any(form != (None, None) for form in forms):
        details["normal_forms"] = forms
    row = FamilyRow(
        0, branch.id, branch.label, format_ends(branch.ends), branch.sequence,
        0.5 * impacts_per_period(branch.problem.sequence, branch.ends),
        *_range(columns["h"]), *_range(columns["alpha"]), len(branch), len(branch.events), int(branch.start), stable_fraction(stability),
        " ".join(dict.fromkeys(part.value for part in labels if part.value)),
        compact_json(details),
    )  # fmt: skip
    return PackedFamily(_described(branch.system), row, queried_rows(columns), arrays, [event_values(event) for event in branch.events])


@lru_cache(maxsize=4)
def _described(system: ImpactSystem) -> dict[str, Any]:
    return system.describe()


def label_intervals(columns: dict[str, np.ndarray], events: Sequence[BranchEvent]) -> tuple[Interval, ...]:
    """The labels along a family. Each interval begins where the last one ends, at the event of the change if there is one, so that
    no energy falls between them."""
    runs = _runs([str(label) for label in columns["label"]])
    changes = {event.point for event in events if event.type == "LB"}
    borders = [first if first in changes else first - 1 for _, first, _ in runs[1:]]
    spans = zip([0, *borders], [*borders, len(columns["label"]) - 1], strict=True)
    return tuple(Interval(label, *_ranges(columns, *span)) for (label, _, _), span in zip(runs, spans, strict=True))


def stability_intervals(columns: dict[str, np.ndarray], events: Sequence[BranchEvent]) -> tuple[Interval, ...]:
    """Stable, unstable and undecided intervals of a family.

    At a bifurcation a multiplier is at its bound and stability is undecided. Such a single point is the border of its neighbours, not an
    interval of its own.
    """
    codes = [int(code) for code in columns["stable"]]
    for point in {event.point for event in events}:
        if codes[point] == -1 and 0 < point < len(codes) - 1 and -1 not in (codes[point - 1], codes[point + 1]):
            codes[point] = codes[point - 1]
        elif codes[point] == -1 and len(codes) > 1 and point in (0, len(codes) - 1):
            codes[point] = codes[1] if point == 0 else codes[-2]
    runs = _runs(codes)
    return tuple(Interval(code, *_ranges(columns, max(first - 1, 0), last)) for code, first, last in runs)


def stable_fraction(stability: Sequence[Interval]) -> float:
    """The stable fraction of the arclength."""
    total = stability[-1].arclength[1] - stability[0].arclength[0]
    stable = sum(part.arclength[1] - part.arclength[0] for part in stability if part.value == 1)
    return stable / total if total > 0.0 else float(stability[0].value == 1)


def _runs(values: Sequence) -> list[tuple]:
    """(value, first, last) of each run of equal values."""
    borders = [0, *(i for i in range(1, len(values)) if values[i] != values[i - 1]), len(values)]
    return [(values[first], first, end - 1) for first, end in pairwise(borders)]


def _ranges(columns: dict[str, np.ndarray], first: int, last: int) -> list[tuple[float, float]]:
    """Ranges of arclength, energy and quarter period between two points."""
    part = slice(first, last + 1)
    ends = (float(columns["arclength"][first]), float(columns["arclength"][last]))
    return [ends, _range(columns["h"][part]), _range(columns["alpha"][part])]


def _range(values: np.ndarray) -> tuple[float, float]:
    return float(values.min()), float(values.max())
