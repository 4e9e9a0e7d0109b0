"""Up to which energies, quarter periods and impacts families are followed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

__all__ = ["Bounds"]


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
