"""Up to which energies, quarter periods and impacts families are followed, and which of them further."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

__all__ = ["Bounds", "Plan"]

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
