"""A study on disk: its plan, its blocks of results, the finished runs as arrays by name, and their statistics.

A block is an NPZ or a Parquet file. It holds the columns, the digest of the study, the number of the block, and a CRC of all numbers.
"""

from __future__ import annotations

import json
import os
import zipfile
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np

from branches.files import one_line, reason, replacing, write_text
from bvp.texts import brief, listed, shown
from transitions.study.plan import Axis, StudyPlan, digest_of
from transitions.study.runs import Ending, block_columns, results_of

PLAN = "study.json"
SCHEMA = 1
FORMATS = ("npz", "parquet")
_ABOUT = "about"


class NoStudy(ValueError):
    """A path that holds no study, or another one."""


class DamagedBlock(ValueError):
    """A block on disk differs from the block that was written; the message names it and gives the reason."""


class ForeignBlock(ValueError):
    """An intact block of another study."""


def write_plan(folder: Path, plan: StudyPlan, kind: str, version: str) -> None:
    """Write the plan of a study beside its blocks, which have the format `kind`."""
    about = {"schema": SCHEMA, "saltus": version, "digest": plan.digest, "format": kind}
    about |= {"columns": list(block_columns(plan)), "plan": plan.plain()}
    write_text(folder / PLAN, json.dumps(about, indent=1) + "\n")


def read_plan(folder: Path) -> tuple[StudyPlan, str, str]:
    """(plan, digest, format) of a study's folder; NoStudy if it holds none."""
    try:
        about = json.loads((folder / PLAN).read_text(encoding="utf-8"))
        plan, digest, kind = about["plan"], about["digest"], about["format"]
        if digest_of(plan) != digest or not isinstance(plan["title"], str) or kind not in FORMATS:
            raise ValueError
        return StudyPlan.from_plain(plan), digest, kind
    except FileNotFoundError:
        raise NoStudy(f"{folder} is not a study; expected a folder that saltus study has made, with {PLAN} in it") from None
    except OSError as error:
        raise NoStudy(f"cannot read {folder / PLAN}: {reason(error)}") from error
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        damaged = f"{folder / PLAN} is damaged: it differs from the plan that was written"
        raise NoStudy(f"{damaged}; the same saltus study command writes it again") from error


def block_path(folder: Path, number: int, kind: str) -> Path:
    """The file of a block, such as shock.study/block-000007.npz."""
    return folder / f"block-{number:06d}.{kind}"


def write_block(path: Path, columns: Mapping[str, np.ndarray], digest: str, number: int) -> None:
    """Write columns (b,) of results as a block, completely or not at all. The suffix of the path selects the format; `digest` identifies
    the study's plan. `branches.files.WriteFailure` if that fails."""
    about = json.dumps({"study": digest, "block": number, "crc": _crc(columns)})
    with replacing(path) as beside:
        if path.suffix == ".parquet":
            import pyarrow
            import pyarrow.parquet

            table = pyarrow.table({name: np.ascontiguousarray(values) for name, values in columns.items()})
            pyarrow.parquet.write_table(table.replace_schema_metadata({_ABOUT: about}), beside, use_dictionary=False)
            return
        with open(beside, "wb") as file:
            arrays: dict[str, Any] = {_ABOUT: np.frombuffer(about.encode(), dtype=np.uint8), **columns}
            np.savez(file, **arrays)


def read_block(path: Path, digest: str, number: int, count: int) -> dict[str, np.ndarray]:
    """The columns of a block of `count` runs; the other arguments are those of `write_block`.

    DamagedBlock if the file cannot be read, its CRC does not fit its numbers, or it is another block. ForeignBlock if it is an intact block
    of another study.
    """
    with _readable(path):
        about, columns = _read(path)
        recorded = json.loads(about)
        if recorded["crc"] != _crc(columns):
            raise ValueError("its CRC is not that of its numbers")
        if recorded["study"] != digest:
            raise ForeignBlock(f"{path.name} belongs to another study; expected an empty folder, or one of this study")
        if recorded["block"] != number:
            raise ValueError(f"it is block {recorded['block']}")
        if any(len(values) != count for values in columns.values()):
            raise ValueError(f"it has not {count} runs")
    return columns


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """Errors while a block is read become DamagedBlock."""
    try:
        yield
    except ForeignBlock:
        raise
    except OSError as error:
        raise DamagedBlock(f"{path.name} cannot be read: {reason(error)}") from error
    except (ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError) as error:
        raise DamagedBlock(f"{path.name} is damaged: {one_line(error)}") from error


def _read(path: Path, names: Sequence[str] | None = None) -> tuple[bytes, dict[str, np.ndarray]]:
    """What a block says of itself, and its columns: all, or those of the names."""
    if path.suffix == ".parquet":
        import pyarrow.parquet

        table: Any = pyarrow.parquet.read_table(path, columns=None if names is None else list(names))
        return (table.schema.metadata or {})[_ABOUT.encode()], {name: table[name].to_numpy() for name in table.column_names}
    with np.load(path, allow_pickle=False) as arrays:
        columns = {name: arrays[name] for name in names or arrays.files if name != _ABOUT}
        return arrays[_ABOUT].tobytes(), columns


def _crc(columns: Mapping[str, np.ndarray]) -> int:
    """CRC-32 of the names, types and bytes of all columns."""
    crc = 0
    for name, values in columns.items():
        plain = np.ascontiguousarray(values)
        crc = zlib.crc32(f"{name}:{plain.dtype.str}:{plain.shape};".encode(), crc)
        crc = zlib.crc32(plain.data, crc)
    return crc


def _blocks(
    folder: Path, plan: StudyPlan, digest: str, kind: str, damaged: Callable[[DamagedBlock], object]
) -> Iterator[tuple[int, dict[str, np.ndarray]]]:
    """The numbers and columns of the intact blocks on disk; `damaged` is called with the error of each other block."""
    for number in range(plan.blocks):
        path = block_path(folder, number, kind)
        if not path.exists():
            continue
        first, last = plan.block_range(number)
        try:
            yield number, read_block(path, digest, number, last - first)
        except DamagedBlock as error:
            damaged(error)


def finished_blocks(folder: Path, plan: StudyPlan, digest: str, kind: str, damaged: Callable[[str], None]) -> set[int]:
    """The numbers of the intact blocks on disk; `damaged` is called with a message for each other block. ForeignBlock for a block of
    another study."""
    return {number for number, _ in _blocks(folder, plan, digest, kind, lambda error: damaged(str(error)))}


@brief
@dataclass(frozen=True)
class Best:
    """The best run.

    Attributes
    ----------
    run : int
        Its number.
    value : float
        Of the result that is largest.
    given : dict
        Its parameters, a family by name.
    neighbours : (k,) int64 ndarray
        Runs around it. In a grid: one step away along one axis or several. In a hypercube of d axes: the 2 d + 1 nearest runs, with each
        axis scaled to 0..1.
    """

    run: int
    value: float
    given: dict[str, Any]
    neighbours: np.ndarray


def _result(plan: StudyPlan, column: Callable[[str], np.ndarray], name: str) -> np.ndarray:
    """A result from the columns of blocks, in the units of the clearance where it is a length or an energy."""
    if name == "left_share":
        return 1.0 - column("nes_share") - column("lo_share")
    if name != "energy" and not name.startswith("peak_"):
        return column(name)
    clearance = column("given.clearance") if "clearance" in plan.names else float(plan.fixed.get("clearance", 1.0))
    return clearance**2 * column("h") if name == "energy" else clearance * column(name)


@brief
class Study:
    """The results of many runs.

    ``study["nes_share"]`` is an array over the finished runs, in the order of the plan. Lengths and energies are in the units of the
    clearance (`peak_*`, `energy` = clearance^2 h). Everything else is in natural units. `given` has the parameters as the file gives them.

    Parameters
    ----------
    path : path-like
        The folder that `saltus study` made.

    Attributes
    ----------
    plan : StudyPlan
    runs : (N,) int64 ndarray
        Numbers of the finished runs.
    given : dict of str to (N,) ndarray
        The varied parameters; a family by its name.

    Raises
    ------
    NoStudy
        If the folder holds none.
    DamagedBlock
        For a damaged block. The same `saltus study` command computes it again.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self.plan, digest, kind = read_plan(self.path)

        def refuse(error: DamagedBlock) -> None:
            raise DamagedBlock(f"{self.path}: {error}; the same saltus study command does it again") from error

        self._kind = kind
        self._blocks = [number for number, _ in _blocks(self.path, self.plan, digest, kind, refuse)]

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        title = f"Study {self.path}: {len(self)} of {self.plan.count} runs"
        return title, [("varied", listed(self.plan.names)), ("results", listed(self.names))]

    @cached_property
    def runs(self) -> np.ndarray:
        """Numbers of the finished runs, (N,) int64."""
        return np.concatenate([np.zeros(0, dtype=np.int64), *(np.arange(*self.plan.block_range(number)) for number in self._blocks)])

    @cached_property
    def given(self) -> dict[str, np.ndarray]:
        """The varied parameters by name, (N,) each; a family by its name."""
        return {axis.name: self._named(axis) for axis in self.plan.axes}

    @cached_property
    def _column(self) -> Callable[[str], np.ndarray]:
        """A column by its name, read when it is first asked for."""
        return cache(self._read_column)

    def _read_column(self, name: str) -> np.ndarray:
        """A column from the blocks, which were checked when the study was opened."""
        parts = []
        for number in self._blocks:
            path = block_path(self.path, number, self._kind)
            with _readable(path):
                parts.append(_read(path, [name])[1][name])
        return np.concatenate(parts) if parts else np.zeros(0)

    def read(self, name: str) -> np.ndarray:
        """The same as `study[name]`, which the study does not keep in memory."""
        return _result(self.plan, self._read_column, name)

    def __len__(self) -> int:
        return sum(last - first for first, last in map(self.plan.block_range, self._blocks))

    @property
    def complete(self) -> bool:
        """Whether all runs are finished."""
        return len(self) == self.plan.count

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the results."""
        return ("energy", "left_share", *results_of(self.plan))

    def __getitem__(self, name: str) -> np.ndarray:
        """A result of each finished run, (N,).

        Raises
        ------
        KeyError
            For an unknown result.
        """
        if name not in self.names:
            raise KeyError(f"no result {shown(name)}; expected one of {', '.join(self.names)}")
        return _result(self.plan, self._column, name)

    def numbers(self, name: str) -> np.ndarray:
        """A varied parameter as numbers, (N,); a family by its index."""
        return self._column(f"given.{name}")

    def endings(self) -> dict[Ending, int]:
        """Number of runs with each ending."""
        counts = Counter(self["ended"].tolist())
        return {ending: counts[ending.code] for ending in Ending if ending.code in counts}

    def best(self, name: str = "nes_share") -> Best:
        """The run with the largest result of a name, and the runs around it.

        Raises
        ------
        KeyError
            For an unknown result.
        ValueError
            If no finished run has it.
        """
        values = self[name]
        if not np.isfinite(values).any():
            raise ValueError(f"no finished run of {self.path} has {name}; finish the study first")
        at = int(np.argmax(np.isclose(values, np.nanmax(values), rtol=1e-12, atol=0.0)))  # the first of those equal to rounding
        given = {key: column[at].item() for key, column in self.given.items()}
        return Best(int(self.runs[at]), float(values[at]), given, self._neighbours(at))

    def _neighbours(self, at: int) -> np.ndarray:
        """The runs around one run, without it."""
        if self.plan.design == "grid":
            index = np.array(np.unravel_index(self.runs, self.plan.shape))
            steps = np.abs(index - index[:, at : at + 1])
            # Families have no order: only runs of the same family are near.
            steps[[axis.is_family for axis in self.plan.axes]] *= 2
            return self.runs[steps.max(axis=0) == 1]
        places = np.array([self._place(axis) for axis in self.plan.axes])
        distance = np.square(places - places[:, at : at + 1]).sum(axis=0)
        nearest = np.argsort(distance.round(12), kind="stable")  # equal to rounding: in the order of runs
        # If all parameters are lists, other runs can have the same parameters as the best one.
        return self.runs[nearest[nearest != at][: 2 * len(places) + 1]]

    def _place(self, axis: Axis) -> np.ndarray:
        """Position of each run on an axis, 0 to 1; families lie 10 apart."""
        values = self.numbers(axis.name)
        if axis.is_family:
            return 10.0 * values
        values = np.log(values) if axis.scale == "log" and np.all(values > 0.0) else values
        span = np.ptp(values)
        return (values - values.min()) / span if span > 0.0 else np.zeros(len(values))

    def _named(self, axis: Axis) -> np.ndarray:
        values = self.numbers(axis.name)
        return np.array(axis.values)[values.astype(np.int64)] if axis.is_family else values


FEWEST = 20
"""Least mean number of a hypercube's runs in a bin."""

MOST = 40
"""Largest number of bins on an axis."""

_SINGLE = 0.05


@dataclass(frozen=True, eq=False)
class Bins:
    """The bins of an axis.

    In a grid the edges lie half-way between the values, and as far beyond the first and the last value. So a map has cells of full size at
    its borders. A single value has a twentieth of itself on each side.
    """

    edges: np.ndarray  # (k + 1,) ascending
    centres: np.ndarray  # (k,) the values of a grid; else the middles of the bins
    which: np.ndarray  # (N,) the bin of each run


@dataclass(frozen=True, eq=False)
class Map:
    """A result over two parameters: the medians (k, j), NaN if no run has it, and the number of runs in each bin."""

    x: Bins
    y: Bins
    medians: np.ndarray
    counts: np.ndarray


def numeric_axes(study: Study) -> tuple[Axis, ...]:
    """The varied parameters except the family."""
    return tuple(axis for axis in study.plan.axes if not axis.is_family)


def bins_of(study: Study, axis: Axis, most: int) -> Bins:
    """The bins of an axis: one for each value of a grid or a list; else `most` bins of equal width on the axis's scale."""
    values = study.given[axis.name]
    to_scale, from_scale = (np.log, np.exp) if axis.scale == "log" else (np.array, np.array)
    if study.plan.design == "grid" or axis.values:
        centres = np.unique(np.array(axis.grid(), dtype=float))
        which = np.searchsorted(centres, values)
        if len(centres) == 1:
            half = _SINGLE * abs(centres[0]) or 1.0
            return Bins(np.array([centres[0] - half, centres[0] + half]), centres, which)
        places = to_scale(centres)
        between = 0.5 * (places[1:] + places[:-1])
        edges = np.concatenate([[2.0 * places[0] - between[0]], between, [2.0 * places[-1] - between[-1]]])
        return Bins(from_scale(edges), centres, which)
    low, high = to_scale([axis.low, axis.high])
    edges = np.linspace(low, high, most + 1)
    which = np.clip(np.searchsorted(edges, to_scale(values), side="right") - 1, 0, most - 1)
    ends = np.concatenate([[axis.low], from_scale(edges[1:-1]), [axis.high]])  # the very ends, unrounded
    return Bins(ends, from_scale(0.5 * (edges[1:] + edges[:-1])), which)


def along(study: Study, axis: Axis, values: np.ndarray, some: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Centres of an axis's bins, (k,), and the quartiles and median of the values (N,) in each, (k, 3); NaN if no run has a value. `some`
    (N,) selects the runs."""
    chosen = np.isfinite(values) if some is None else np.isfinite(values) & some
    bins = bins_of(study, axis, int(np.clip(chosen.sum() // FEWEST, 1, MOST)))
    out = np.full((len(bins.centres), 3), np.nan)
    for k in range(len(out)):
        here = values[chosen & (bins.which == k)]
        if len(here):
            out[k] = np.quantile(here, [0.25, 0.5, 0.75])
    return bins.centres, out


def over(study: Study, x: Axis, y: Axis, values: np.ndarray) -> Map:
    """Medians of the values over two axes."""
    chosen = np.isfinite(values)
    most = int(np.clip(np.sqrt(chosen.sum() / FEWEST), 1, MOST))
    first, second = bins_of(study, x, most), bins_of(study, y, most)
    shape = (len(first.centres), len(second.centres))
    cell = np.ravel_multi_index((first.which[chosen], second.which[chosen]), shape)
    counts = np.bincount(cell, minlength=shape[0] * shape[1])
    parts = np.split(values[chosen][np.argsort(cell, kind="stable")], np.cumsum(counts)[:-1])
    medians = np.array([np.median(part) if len(part) else np.nan for part in parts])
    return Map(first, second, medians.reshape(shape), counts.reshape(shape))
