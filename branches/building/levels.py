"""The energies at which a build searches, level by level, each twice as fine as the one before."""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np

__all__ = ["energies_of", "open_ranges"]

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
