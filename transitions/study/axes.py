"""A parameter that a study varies: listed values, or a range with a scale."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

__all__ = ["FAMILY", "PARAMETERS", "SCALES", "Axis"]

FAMILY = "family"

PARAMETERS = ("mu", "sigma", "rho", "lam", "clearance", "energy", "impulse", FAMILY)
"""What can be varied or fixed."""

SCALES = ("linear", "log")


@dataclass(frozen=True)
class Axis:
    """One varied parameter.

    Attributes
    ----------
    name : str
        One of `PARAMETERS`.
    values : tuple of float, or of str
        Where they are listed; else empty.
    low, high : float
        The range, where one is given.
    scale : {"linear", "log"}
        How the range is divided.
    points : int
        Into how many values of a grid, both ends included; 0 for a hypercube.

    Examples
    --------
    >>> Axis("energy", low=0.1, high=10.0, scale="log", points=3).grid()
    (0.1, 1.0, 10.0)
    >>> Axis("rho", values=(0.5, 0.7)).place(np.array([0.0, 0.49, 0.51]))
    array([0.5, 0.5, 0.7])
    """

    name: str
    values: tuple[float, ...] | tuple[str, ...] = ()
    low: float = math.nan
    high: float = math.nan
    scale: str = "linear"
    points: int = 0

    @property
    def is_family(self) -> bool:
        """Whether the values are names."""
        return self.name == FAMILY

    def grid(self) -> tuple[float, ...] | tuple[str, ...]:
        """The values of a grid."""
        if self.values:
            return self.values
        spaced = np.geomspace if self.scale == "log" else np.linspace
        return tuple(spaced(self.low, self.high, self.points).tolist())

    def place(self, fractions: np.ndarray) -> np.ndarray:
        """The values at fractions in [0, 1) of the axis, (b,): of listed ones, each has an equal part; of names, their indices."""
        if not self.values:
            return self._between(fractions)
        index = np.minimum((fractions * len(self.values)).astype(np.int64), len(self.values) - 1)
        return index.astype(float) if self.is_family else np.array(self.values, dtype=float)[index]

    def _between(self, fractions: np.ndarray) -> np.ndarray:
        if self.scale == "log":
            low, high = math.log(self.low), math.log(self.high)
            # Rounding must not leave the range.
            return np.clip(np.exp(low + (high - low) * fractions), self.low, self.high)
        return np.clip(self.low + (self.high - self.low) * fractions, self.low, self.high)

    def plain(self) -> dict[str, object]:
        """As JSON has it."""
        if self.values:
            return {"name": self.name, "values": list(self.values)}
        return {"name": self.name, "from": self.low, "to": self.high, "scale": self.scale, "points": self.points}

    @classmethod
    def from_plain(cls, plain: dict) -> Axis:
        """The inverse of `plain`."""
        if "values" in plain:
            return cls(plain["name"], tuple(plain["values"]))
        return cls(plain["name"], (), plain["from"], plain["to"], plain["scale"], plain["points"])
