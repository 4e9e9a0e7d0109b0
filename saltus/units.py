"""Units of what is told: natural ones, or those of a system with a clearance and a natural frequency."""

from __future__ import annotations

import argparse
from dataclasses import dataclass

from saltus.arguments import positive

__all__ = ["Units", "add_arguments", "from_arguments"]


@dataclass(frozen=True)
class Units:
    """What the natural units are in those that results are given in.

    Attributes
    ----------
    length : float
        The clearance.
    frequency : float
        The natural frequency of the oscillator alone, in rad/s; energies are those of an oscillator of unit mass.

    Examples
    --------
    >>> metres = Units(0.02, 10.0)
    >>> round(metres.time, 12), round(metres.speed, 12), round(metres.energy, 12)
    (0.1, 0.2, 0.04)
    """

    length: float = 1.0
    frequency: float = 1.0

    @property
    def time(self) -> float:
        """Unit of time."""
        return 1.0 / self.frequency

    @property
    def speed(self) -> float:
        """Unit of velocity."""
        return self.length * self.frequency

    @property
    def energy(self) -> float:
        """Unit of energy."""
        return self.speed**2


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add ``--clearance`` and ``--natural-frequency``."""
    parser.add_argument(
        "--clearance", metavar="D", type=positive, default=1.0, help="give lengths for this clearance, and energies for its square"
    )
    parser.add_argument(
        "--natural-frequency", metavar="W", type=positive, default=1.0, help="give times for this frequency of the oscillator, in rad/s"
    )


def from_arguments(arguments: argparse.Namespace) -> Units:
    """The units asked for."""
    return Units(arguments.clearance, arguments.natural_frequency)
