"""What a study runs: a grid or a Latin hypercube over parameters of the system and of the start, in a fixed order."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from transitions.study.axes import FAMILY, Axis

__all__ = ["CLEAR", "FRACTIONS", "IMPULSIVE", "Plan"]

CLEAR = "clear"
"""`until` for a run that lasts until no impact is possible any more."""

IMPULSIVE = "impulsive"
"""The starting family that is none: the oscillator's velocity alone."""

FRACTIONS = (0.5, 0.9, 0.99)
"""Fractions of the initial energy whose times are found."""


@dataclass(frozen=True)
class Plan:
    """A study before it is run.

    Attributes
    ----------
    system : mapping
        The scene's system as `ImpactSystem.describe` gives it, with the fixed parameters of its model.
    nes, lo : tuple of int
        Coordinates of the sink and of the oscillator.
    forces : tuple of bvp.forcing loads
    axes : tuple of Axis
        In the order of the file; the last one changes fastest in a grid.
    fixed : mapping
        Parameters of the start that are not varied, and the clearance.
    design : {"grid", "hypercube"}
    runs, seed : int
        Of a hypercube.
    units : {"natural", "physical"}
        Whether energies and impulses are given as h and in natural units, or with their lengths in the units of the clearance: then
        h = energy/clearance^2, and an impulse V is V/clearance.
    until : float or "clear"
        The duration, or until no impact is possible any more.
    longest : float
        The time at which a run that is to become clear is given up.
    impacts : int
        The impacts at which a run is given up.
    block : int
        Runs in one block of results.
    title : str
    """

    system: Mapping[str, Any]
    nes: tuple[int, ...]
    lo: tuple[int, ...]
    axes: tuple[Axis, ...]
    fixed: Mapping[str, Any]
    design: str
    runs: int = 0
    seed: int = 0
    units: str = "natural"
    until: float | str = CLEAR
    longest: float = 1e4
    impacts: int = 10_000_000
    block: int = 4096
    title: str = ""
    forces: tuple[Any, ...] = field(default=())

    @property
    def names(self) -> tuple[str, ...]:
        """The varied parameters."""
        return tuple(axis.name for axis in self.axes)

    @property
    def families(self) -> tuple[str, ...]:
        """The starting families; one alone where they are not varied."""
        for axis in self.axes:
            if axis.is_family:
                return tuple(str(value) for value in axis.values)
        return (str(self.fixed.get(FAMILY, IMPULSIVE)),)

    @property
    def shape(self) -> tuple[int, ...]:
        """Values along each axis of a grid; the number of runs of a hypercube."""
        return tuple(len(axis.grid()) for axis in self.axes) if self.design == "grid" else (self.runs,)

    @property
    def count(self) -> int:
        """Number of runs."""
        return math.prod(self.shape)

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return -(-self.count // self.block)

    @property
    def duration(self) -> float:
        """The time at which a run ends at the latest."""
        return self.longest if self.until == CLEAR else float(self.until)

    def block_range(self, number: int) -> tuple[int, int]:
        """First run of a block, and of the next one."""
        return number * self.block, min((number + 1) * self.block, self.count)

    def values(self, first: int, last: int) -> dict[str, np.ndarray]:
        """The varied parameters of the runs from `first` to before `last`, (b,) each; a family as its index."""
        if self.design == "grid":
            index = np.unravel_index(np.arange(first, last), self.shape)
            grids = [np.arange(float(len(axis.values))) if axis.is_family else np.array(axis.grid()) for axis in self.axes]
            return {axis.name: grid[k] for axis, grid, k in zip(self.axes, grids, index, strict=True)}
        return {axis.name: axis.place(_sample(len(self.axes), self.runs, self.seed)[first:last, k]) for k, axis in enumerate(self.axes)}

    def plain(self) -> dict[str, Any]:
        """As JSON has it."""
        own = {f.name: getattr(self, f.name) for f in fields(self)}
        return {**own, "axes": [axis.plain() for axis in self.axes], "forces": [_plain(force) for force in self.forces]} | {
            "system": dict(self.system), "fixed": dict(self.fixed), "nes": list(self.nes), "lo": list(self.lo)
        }  # fmt: skip

    @property
    def digest(self) -> str:
        """What tells this study from all others: a hash of the plan, without its title."""
        plain = {key: value for key, value in self.plain().items() if key != "title"}
        return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()[:16]

    @classmethod
    def from_plain(cls, plain: Mapping[str, Any]) -> Plan:
        """The inverse of `plain`, but for the loads, which a plan that is read back has no use for."""
        known = {**plain, "axes": tuple(map(Axis.from_plain, plain["axes"])), "forces": ()}
        return cls(**{**known, "nes": tuple(plain["nes"]), "lo": tuple(plain["lo"])})


@lru_cache(maxsize=1)
def _sample(axes: int, runs: int, seed: int) -> np.ndarray:
    """A Latin hypercube, (runs, axes), in [0, 1)."""
    from scipy.stats import qmc

    return qmc.LatinHypercube(axes, seed=seed).random(runs)


def _plain(value: Any) -> Any:
    """A load as JSON has it."""
    if is_dataclass(value):
        return {"kind": type(value).__name__} | {f.name: _plain(getattr(value, f.name)) for f in fields(value)}
    return value.tolist() if isinstance(value, np.ndarray) else value
