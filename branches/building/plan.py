"""The plan of a build: its limits, its names, and the energies at which it searches, level by level."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

__all__ = ["Bounds", "Plan", "energies_of", "open_ranges"]

GENERATIONS = 0
"""Families without a reversal that come of such a family, and of those again, so many times. Nothing bounds their number: where they graze,
others of their kind meet them."""


@dataclass(frozen=True)
class Bounds:
    """Limits of a catalogue.

    Parameters
    ----------
    energy : (float, float)
    quarter_period : float
        Longest.
    impacts : int
        Most in half a period.

    Raises
    ------
    ValueError
        For limits that are reversed, negative or no numbers.

    Examples
    --------
    >>> Bounds((0.05, 100.0), 5.1, 10).holds(alpha=2.0, impacts=20)
    True
    >>> Bounds((0.05, 100.0), 5.1, 10).holds(alpha=5.2, impacts=20)
    False
    """

    energy: tuple[float, float]
    quarter_period: float
    impacts: int

    def __post_init__(self) -> None:
        low, high = self.energy
        if not 0.0 < low < high < math.inf:
            raise ValueError(f"the energies {low:g}:{high:g} are empty, reversed or without a bound; expected 0 < LO < HI")
        if not 0.0 < self.quarter_period < math.inf:
            raise ValueError(f"the longest quarter period is {self.quarter_period:g}; expected a number above 0")
        if self.impacts < 1:
            raise ValueError(f"the most impacts in half a period are {self.impacts}; expected 1 or more")

    def holds(self, *, alpha: float, impacts: int) -> bool:
        """Whether a quarter period and a number of impacts in a whole period are within the limits."""
        return alpha <= self.quarter_period and impacts <= 2 * self.impacts

    def plain(self) -> dict[str, Any]:
        """As JSON values."""
        return {"energy": list(self.energy), "quarter_period": self.quarter_period, "impacts": self.impacts}

    @classmethod
    def of(cls, plain: dict[str, Any]) -> Bounds:
        """The inverse of `plain`."""
        low, high = plain["energy"]
        return cls((float(low), float(high)), float(plain["quarter_period"]), int(plain["impacts"]))


@dataclass(frozen=True)
class Plan:
    """What a build looks for.

    Parameters
    ----------
    bounds : Bounds
        In which everything is followed.
    named : Bounds
        Wider ones, in which the families that have names are followed, and their direct neighbours.
    names : tuple of str
    pins : mapping
        Cited points that choose among the matches of a name.
    generations : int
        How often families without a reversal give rise to further ones.
    """

    bounds: Bounds
    named: Bounds
    names: tuple[str, ...] = ()
    pins: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    generations: int = GENERATIONS

    def __post_init__(self) -> None:
        # Seeds carry their plan to other processes, so it is plain data.
        object.__setattr__(self, "pins", {name: dict(pin) for name, pin in self.pins.items()})

    @classmethod
    def within(cls, bounds: Bounds) -> Plan:
        """Everything inside the bounds, and no names."""
        return cls(bounds, bounds)

    def plain(self) -> dict[str, Any]:
        """As JSON values."""
        return {
            "bounds": self.bounds.plain(),
            "named": self.named.plain(),
            "names": list(self.names),
            "pins": dict(self.pins),
            "generations": self.generations,
        }


COARSE = 0.5
"""Step in log h of the first energies searched."""

GAPS = 4
"""Steps of the last level between energies at which searches settled, from which on what is between them counts as open."""

INSIDE = 1e-6
"""Part of the range of log h by which the outermost energies are inside the bounds."""


def energies_of(level: int, energy: tuple[float, float]) -> list[float]:
    """Energies of a level: those of all levels together are even in log h. The first has two just inside the bounds, too: they meet
    all the families that lie across these, however little of them is inside.

    Examples
    --------
    >>> [round(h, 3) for h in energies_of(0, (1.0, 2.0))], [round(h, 3) for h in energies_of(1, (1.0, 2.0))]
    ([1.0, 1.189, 1.682, 2.0], [1.414])
    """
    low, high = np.log(energy)
    count = _count(energy)
    if level == 0:
        parts = np.concatenate([[INSIDE], (np.arange(count) + 0.5) / count, [1.0 - INSIDE]])
    else:
        fine = count * 2 ** (level - 1)
        parts = np.arange(1, fine) / fine if level == 1 else (np.arange(fine) + 0.5) / fine
    return [float(h) for h in np.exp(low + parts * (high - low))]


def open_ranges(levels: int, energy: tuple[float, float], without: Collection[float]) -> list[tuple[float, float]]:
    """Where neighbours among all levels' energies, some left out, are more than `GAPS` steps of the last level apart.

    Examples
    --------
    >>> open_ranges(2, (1.0, 2.0), [])
    []
    >>> every = sorted(h for level in range(4) for h in energies_of(level, (1.0, 2.0)))
    >>> [(round(low, 3), round(high, 3)) for low, high in open_ranges(4, (1.0, 2.0), every[4:9])]
    [(1.139, 1.477)]
    """
    every = np.sort([h for level in range(levels) for h in energies_of(level, energy)])
    kept = np.array([energy[0], *every[~np.isin(every, list(without))], energy[1]])
    step = math.log(energy[1] / energy[0]) / (_count(energy) * 2 ** (levels - 1))
    wide = np.flatnonzero(np.diff(np.log(kept)) > (GAPS + 0.5) * step)
    return [(float(kept[i]), float(kept[i + 1])) for i in wide]


def _count(energy: tuple[float, float]) -> int:
    return max(2, math.ceil(math.log(energy[1] / energy[0]) / COARSE))
