"""A study on disk: its plan and the blocks that are finished, as arrays by name."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from branches.files import one_line, reason, write_text
from bvp.shown import shown
from transitions.study.axes import Axis
from transitions.study.blocks import DamagedBlock, block_path, read_block
from transitions.study.endings import Ending
from transitions.study.plan import Plan
from transitions.study.runs import block_columns, results_of

__all__ = ["Best", "NoStudy", "Study", "finished_blocks", "write_plan"]

PLAN = "study.json"
SCHEMA = 1


class NoStudy(ValueError):
    """A path that holds no study, or another one."""


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
        Runs about it: in a grid those a step away along one axis or several; in a hypercube the 2 d + 1 nearest, each axis from 0 to 1.
    """

    run: int
    value: float
    given: dict[str, Any]
    neighbours: np.ndarray


def write_plan(folder: Path, plan: Plan, kind: str, version: str) -> None:
    """Write what a study is beside its blocks."""
    about = {"schema": SCHEMA, "saltus": version, "digest": plan.digest, "format": kind}
    about |= {"columns": list(block_columns(plan)), "plan": plan.plain()}
    write_text(folder / PLAN, json.dumps(about, indent=1) + "\n")


def read_plan(folder: Path) -> tuple[Plan, str, str]:
    """(plan, digest, format) of a study's folder.

    Raises
    ------
    NoStudy
        Where there is none.
    """
    try:
        about = json.loads((folder / PLAN).read_text(encoding="utf-8"))
        return Plan.from_plain(about["plan"]), str(about["digest"]), str(about["format"])
    except FileNotFoundError:
        raise NoStudy(f"{folder} holds no study; expected a folder that saltus study has made, with {PLAN} in it") from None
    except OSError as error:
        raise NoStudy(f"cannot read {folder / PLAN}: {reason(error)}") from error
    except (ValueError, KeyError, TypeError) as error:
        raise NoStudy(f"{folder / PLAN} is damaged: {one_line(error)}; the same saltus study command writes it again") from error


def finished_blocks(folder: Path, plan: Plan, digest: str, kind: str, damaged: Callable[[str], None]) -> set[int]:
    """The blocks that are on disk and whole; `damaged` is told of each that is not.

    Raises
    ------
    ForeignBlock
        For one of another study.
    """
    found = set()
    for number in range(plan.blocks):
        path = block_path(folder, number, kind)
        if not path.exists():
            continue
        first, last = plan.block_range(number)
        try:
            read_block(path, digest, number, last - first)
        except DamagedBlock as error:
            damaged(str(error))
        else:
            found.add(number)
    return found


class Study:
    """The results of many runs.

    ``study["nes_share"]`` is an array over the finished runs, in the order of the plan. Lengths and energies are in the units of the
    clearance (`peak_*`, `energy` = clearance^2 h), all else in natural units. `given` has the parameters as the file gives them.

    Parameters
    ----------
    path : path-like
        The folder that `saltus study` made.

    Attributes
    ----------
    plan : Plan
    runs : (N,) int64 ndarray
        Numbers of the finished runs.
    given : dict of str to (N,) ndarray
        The varied parameters; a family as its name.

    Raises
    ------
    NoStudy
        Where there is none.
    DamagedBlock
        For a block that is not what was written: the same `saltus study` command does it again.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self.plan, self._digest, self._kind = read_plan(self.path)
        columns: dict[str, list[np.ndarray]] = {name: [] for name in block_columns(self.plan)}
        runs: list[np.ndarray] = []
        for number in range(self.plan.blocks):
            place = block_path(self.path, number, self._kind)
            if not place.exists():
                continue
            first, last = self.plan.block_range(number)
            try:
                block = read_block(place, self._digest, number, last - first)
            except DamagedBlock as error:
                raise DamagedBlock(f"{self.path}: {error}; the same saltus study command does it again") from error
            runs.append(np.arange(first, last))
            for name, parts in columns.items():
                parts.append(block[name])
        self.runs = np.concatenate(runs) if runs else np.zeros(0, dtype=np.int64)
        self._columns = {name: np.concatenate(parts) if parts else np.zeros(0) for name, parts in columns.items()}
        self.given = {axis.name: self._named(axis) for axis in self.plan.axes}

    def __len__(self) -> int:
        return len(self.runs)

    @property
    def complete(self) -> bool:
        """Whether all runs are finished."""
        return len(self) == self.plan.count

    @property
    def names(self) -> tuple[str, ...]:
        """The results that it has."""
        return ("energy", "left_share", *results_of(self.plan))

    @cached_property
    def clearance(self) -> np.ndarray:
        """The clearance of each run."""
        return self.given.get("clearance", np.full(len(self), float(self.plan.fixed.get("clearance", 1.0))))

    def __getitem__(self, name: str) -> np.ndarray:
        """A result of each finished run, (N,).

        Raises
        ------
        KeyError
            For a result that there is not.
        """
        if name == "energy":
            return self.clearance**2 * self._columns["h"]
        if name == "left_share":
            return 1.0 - self._columns["nes_share"] - self._columns["lo_share"]
        if name not in results_of(self.plan):
            raise KeyError(f"no result {shown(name)}; expected one of {', '.join(self.names)}")
        values = self._columns[name]
        return self.clearance * values if name.startswith("peak_") else values

    def numbers(self, name: str) -> np.ndarray:
        """A varied parameter as numbers, (N,): a family as its index."""
        return self._columns[f"given.{name}"]

    @property
    def nbytes(self) -> int:
        """Bytes that its arrays take."""
        return sum(values.nbytes for values in self._columns.values())

    def endings(self) -> dict[Ending, int]:
        """How many runs ended how."""
        codes = {ending.code: ending for ending in Ending}
        found, counts = np.unique(self._columns["ended"], return_counts=True)
        return {codes[int(code)]: int(count) for code, count in zip(found, counts, strict=True)}

    def best(self, name: str = "nes_share") -> Best:
        """The run with the largest result of a name, and those about it.

        Raises
        ------
        KeyError
            For a result that there is not.
        ValueError
            Where no finished run has it.
        """
        values = self[name]
        if not np.isfinite(values).any():
            raise ValueError(f"no finished run of {self.path} has {name}; finish the study first")
        at = int(np.nanargmax(values))
        given = {key: column[at].item() for key, column in self.given.items()}
        return Best(int(self.runs[at]), float(values[at]), given, self._neighbours(at))

    def _neighbours(self, at: int) -> np.ndarray:
        """Runs about the one at a place, without it."""
        if self.plan.design == "grid":
            index = np.array(np.unravel_index(self.runs, self.plan.shape))
            steps = np.abs(index - index[:, at : at + 1])
            # Families have no order: only runs of the same one are near.
            steps[[axis.is_family for axis in self.plan.axes]] *= 2
            return self.runs[steps.max(axis=0) == 1]
        places = np.array([self._place(axis) for axis in self.plan.axes])
        distance = np.square(places - places[:, at : at + 1]).sum(axis=0)
        nearest = np.argsort(distance, kind="stable")
        # Other runs can lie at the very place of the best one, where all that varies is listed.
        return self.runs[nearest[nearest != at][: 2 * len(places) + 1]]

    def _place(self, axis: Axis) -> np.ndarray:
        """Where each run lies on an axis, 0 to 1."""
        values = self.numbers(axis.name)
        if axis.is_family:
            return 10.0 * values
        values = np.log(values) if axis.scale == "log" and np.all(values > 0.0) else values
        span = np.ptp(values)
        return (values - values.min()) / span if span > 0.0 else np.zeros(len(values))

    def _named(self, axis: Axis) -> np.ndarray:
        values = self.numbers(axis.name)
        return np.array(axis.values)[values.astype(np.int64)] if axis.is_family else values
