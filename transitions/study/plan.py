"""The plan of a study: a grid or a Latin hypercube over parameters of the system and of the start, in a fixed order."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from bvp.forcing import Force

__all__ = ["CLEAR", "FAMILY", "FRACTIONS", "IMPULSIVE", "PARAMETERS", "SCALES", "Axis", "StudyPlan", "load_as_data", "loads_as_data"]

FAMILY = "family"

PARAMETERS = ("mu", "sigma", "rho", "lam", "clearance", "energy", "impulse", FAMILY)
"""Parameters that a study can vary or fix."""

SCALES = ("linear", "log")

CLEAR = "clear"
"""Value of `until` for a run that lasts until no impact is possible any more."""

IMPULSIVE = "impulsive"
"""Value of `FAMILY` for a start with the oscillator's velocity alone."""

FRACTIONS = (0.5, 0.9, 0.99)
"""Fractions of the initial energy. A run records the time at which each is dissipated."""


@dataclass(frozen=True)
class Axis:
    """One varied parameter.

    Examples
    --------
    >>> Axis("energy", low=0.1, high=10.0, scale="log", points=3).grid()
    (0.1, 1.0, 10.0)
    >>> Axis("rho", values=(0.5, 0.7)).place(np.array([0.0, 0.49, 0.51]))
    array([0.5, 0.5, 0.7])
    """

    name: str  # one of `PARAMETERS`
    values: tuple[float, ...] | tuple[str, ...] = ()  # the listed values; empty for a range
    low: float = math.nan  # end of the range; NaN for listed values
    high: float = math.nan  # its other end
    scale: str = "linear"  # how the range is divided: linear or log
    points: int = 0  # number of grid values in the range, both ends included; 0 for a hypercube

    @property
    def is_family(self) -> bool:
        """Whether the values are names of families."""
        return self.name == FAMILY

    def grid(self) -> tuple[float, ...] | tuple[str, ...]:
        """The values of a grid."""
        if self.values:
            return self.values
        spaced = np.geomspace if self.scale == "log" else np.linspace
        return tuple(spaced(self.low, self.high, self.points).tolist())

    def place(self, fractions: np.ndarray) -> np.ndarray:
        """Values (b,) at fractions in [0, 1) of the axis. Listed values have equal parts of it; names give their indices."""
        if self.values:
            index = np.minimum((fractions * len(self.values)).astype(np.int64), len(self.values) - 1)
            return self.numbers()[index]
        if self.scale == "log":
            low, high = math.log(self.low), math.log(self.high)
            found = np.exp(low + (high - low) * fractions)
        else:
            found = self.low + (self.high - self.low) * fractions
        return np.clip(found, self.low, self.high)  # rounding must not leave the range

    def numbers(self) -> np.ndarray:
        """The values of a grid as numbers; of names the indices."""
        return np.arange(float(len(self.values))) if self.is_family else np.array(self.grid(), dtype=float)

    def plain(self) -> dict[str, object]:
        """The axis as plain data for JSON."""
        if self.values:
            return {"name": self.name, "values": list(self.values)}
        return {"name": self.name, "from": self.low, "to": self.high, "scale": self.scale, "points": self.points}

    @classmethod
    def from_plain(cls, plain: dict) -> Axis:
        """The inverse of `plain`."""
        if "values" in plain:
            return cls(plain["name"], tuple(plain["values"]))
        return cls(plain["name"], (), plain["from"], plain["to"], plain["scale"], plain["points"])


@dataclass(frozen=True)
class StudyPlan:
    """A study before it is run."""

    system: Mapping[str, Any]  # the scene's system as `ImpactSystem.describe` gives it, with the fixed parameters of its model
    nes: tuple[int, ...]  # coordinates of the sink
    lo: tuple[int, ...]  # coordinates of the oscillator
    axes: tuple[Axis, ...]  # in the order of the file; in a grid the last one changes fastest
    fixed: Mapping[str, Any]  # the clearance, and the parameters of the start that are not varied
    design: str  # grid or hypercube
    runs: int = 0  # of a hypercube, as the seed
    seed: int = 0
    units: str = "natural"  # or physical: lengths in those of the clearance, h = energy/clearance^2, and V is impulse/clearance
    until: float | str = CLEAR  # the duration, or until no impact is possible any more
    longest: float = 1e4  # time limit of a run that lasts until it is clear
    impacts: int = 10_000_000  # limit of the number of impacts in a run
    block: int = 4096  # runs in one block of results
    title: str = ""
    forces: tuple[Any, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """The varied parameters."""
        return tuple(axis.name for axis in self.axes)

    @property
    def families(self) -> tuple[str, ...]:
        """The starting families; a single one if they are not varied."""
        varied = [axis.values for axis in self.axes if axis.is_family]
        return tuple(map(str, varied[0])) if varied else (str(self.fixed.get(FAMILY, IMPULSIVE)),)

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values along each axis of a grid; number of runs of a hypercube."""
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
        """The latest end time of a run."""
        return self.longest if self.until == CLEAR else float(self.until)

    def block_range(self, number: int) -> tuple[int, int]:
        """First run of a block, and first run of the next block."""
        return number * self.block, min((number + 1) * self.block, self.count)

    def values(self, first: int, last: int) -> dict[str, np.ndarray]:
        """The varied parameters (b,) of the runs from `first` to before `last`. A family is given by its index."""
        if self.design == "grid":
            index = np.unravel_index(np.arange(first, last), self.shape)
            return {axis.name: axis.numbers()[k] for axis, k in zip(self.axes, index, strict=True)}
        sample = _sample(len(self.axes), self.runs, self.seed)[first:last].T
        return {axis.name: axis.place(fractions) for axis, fractions in zip(self.axes, sample, strict=True)}

    def plain(self) -> dict[str, Any]:
        """The plan as plain data for JSON."""
        own = {f.name: getattr(self, f.name) for f in fields(self)}
        return {**own, "axes": [axis.plain() for axis in self.axes], "forces": [load_as_data(force) for force in self.forces]} | {
            "system": dict(self.system), "fixed": dict(self.fixed), "nes": list(self.nes), "lo": list(self.lo)
        }  # fmt: skip

    @property
    def digest(self) -> str:
        """A hash of the plan without its title. It identifies the study."""
        return digest_of(self.plain())

    @classmethod
    def from_plain(cls, plain: Mapping[str, Any]) -> StudyPlan:
        """The inverse of `plain`, without the loads: a plan that is read back is not run."""
        known = {**plain, "axes": tuple(map(Axis.from_plain, plain["axes"])), "forces": ()}
        return cls(**{**known, "nes": tuple(plain["nes"]), "lo": tuple(plain["lo"])})


def digest_of(plain: Mapping[str, Any]) -> str:
    """Return the hash of a plan as plain data, without its title."""
    content = {key: value for key, value in plain.items() if key != "title"}
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]


@lru_cache(maxsize=1)
def _sample(axes: int, runs: int, seed: int) -> np.ndarray:
    """A Latin hypercube (runs, axes) in [0, 1)."""
    from scipy.stats import qmc

    return qmc.LatinHypercube(axes, seed=seed).random(runs)


def load_as_data(force: Force) -> dict[str, Any]:
    """A load as plain data for JSON."""
    own = {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in vars(force).items()}
    return {"kind": type(force).__name__, **own}


def loads_as_data(forces: Sequence[Force]) -> list[dict[str, Any]]:
    """Loads as plain data for JSON, with kinds as scenes write them."""
    return [{**data, "kind": data["kind"].lower()} for data in map(load_as_data, forces)]
