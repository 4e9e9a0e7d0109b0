"""Bounds that two stops have in common: the same gap, up to a factor, that ends at the same place. They are one obstacle, hit once.

Newton's law says what such a hit does where both have one restitution. Where they differ it asks for two speeds at once, and there is no
such system."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from bvp.checks import InvalidSystem

if TYPE_CHECKING:
    from bvp.system import Stop

__all__ = ["check_same_stops", "repeated_contacts"]

LEVEL = 1e-13
"""Part of their size up to which rows and bounds are the same: that of the contact tolerance, within which hits are at one instant."""


def _pairs(stops: Sequence[Stop]) -> list[tuple[tuple[int, float], tuple[int, float]]]:
    """(stop, side) and a later (stop, side) that are the same obstacle."""
    found: list[tuple[int, float, np.ndarray, float]] = []
    out = []
    for k, stop in enumerate(stops):
        row = np.array(stop.gap)
        size = float(np.abs(row).max())
        row = row / size
        for side, bound in ((-1.0, stop.lower), (1.0, stop.upper)):
            if math.isinf(bound):
                continue
            for first, first_side, first_row, first_bound in found:
                scale = float(np.linalg.norm(row) / np.linalg.norm(first_row))
                same_place = abs(bound / size * side - first_bound * scale) <= LEVEL * max(abs(bound / size), abs(first_bound * scale))
                if first != k and same_place and np.all(np.abs(side * row - first_row * scale) <= LEVEL):
                    out.append(((first, first_side), (k, side)))
                    break
            found.append((k, side, side * row, bound / size * side))
    return out


def check_same_stops(stops: Sequence[Stop]) -> None:
    """Refuse two restitutions at one place.

    Raises
    ------
    InvalidSystem
        For two stops that end the same gap at the same place with restitutions that differ.
    """
    for (first, side), (second, _) in _pairs(stops):
        a, b = stops[first], stops[second]
        if a.restitution != b.restitution:
            raise InvalidSystem(
                f"stops {a.name} and {b.name} end the same gap at the same place, {a.lower if side < 0.0 else a.upper:g} of stop {a.name}, "
                f"with restitutions {a.restitution:g} and {b.restitution:g}; give them one, or leave one of them out"
            )


def repeated_contacts(stops: Sequence[Stop]) -> set[int]:
    """Contacts (in the order of `bvp.modes.Modes`) that an earlier one stands for.

    Examples
    --------
    >>> from bvp.system import Stop
    >>> repeated_contacts([Stop((1.0, 0.0), -1.0, 1.0), Stop((-2.0, 0.0), lower=-2.0)])
    {2}
    """
    order = [(k, side) for k, stop in enumerate(stops) for side, bound in ((-1.0, stop.lower), (1.0, stop.upper)) if math.isfinite(bound)]
    return {order.index(later) for _, later in _pairs(stops)}
