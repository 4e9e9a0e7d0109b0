"""A scan of starts at the origin for orbits of smooth systems without impacts, two degrees of freedom.

On its way from the origin a motion is slowest where the modal velocity is perpendicular to the acceleration. From start to start the
velocity along that perpendicular changes its sign where it is zero. There the motion reaches rest, and is a quarter of an orbit. The
distance from the origin does the same for half an orbit between two origins.

The scan compares neighbouring angles. It proves nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from branches.search.starts import ScannedSegment
from bvp.kernels.smooth import least_values
from bvp.kernels.taylor import fly_smooth
from bvp.smooth_flights import smooth_flight

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["SmoothSampler"]

SAMPLES = 4
"""Parts of a Taylor step in which an extremum is looked for."""

MOST = 2000
"""Most extrema of a motion."""

PIECES = 40
"""Most pieces in which a long motion is computed."""

NARROWED = 2
"""Steps in the angle of a start; Newton's method does the rest."""

BEYOND = 1.02
"""How far a motion is computed to find its extremum near a time, beside that time."""

APART = 0.25
"""Largest change of an extremum's time between neighbouring starts, beside the time to the nearest other one."""


class SmoothSampler:
    """Scans one system from the origin to a far end of one kind: "origin" or "rest".

    quarter_period: the longest.
    """

    def __init__(self, system: ImpactSystem, end: str, quarter_period: float):
        self.end = end
        self.longest = quarter_period * (2.0 if end == "origin" else 1.0)
        self.flight = smooth_flight(system, 1)
        self.found = np.zeros(MOST), np.zeros(MOST)

    def segments(self, energy: float, angles: int, part: float = 1.0) -> Iterator[ScannedSegment]:
        """The segment of each change of sign between neighbouring angles, as many in half a turn, in order of the angles. The other half
        turn is the mirror image. part: of the longest quarter period."""
        grid = (np.arange(angles + 1) + 0.5) * (math.pi / angles)
        longest = part * self.longest
        before = self.extrema(energy, grid[0], longest)
        for low, high in zip(grid[:-1], grid[1:], strict=True):
            after = self.extrema(energy, high, longest)
            for i, j in _pairs(before[0], after[0]):
                if before[1][i] * after[1][j] <= 0.0:
                    yield self._narrowed(energy, (low, before[0][i], before[1][i]), (high, after[0][j], after[1][j]))
            before = after

    def extrema(self, energy: float, angle: float, longest: float) -> tuple[np.ndarray, np.ndarray]:
        """The times (k,) at which a start's motion is slowest, or nearest to the origin, and what changes its sign at an orbit (k,)."""
        state = math.sqrt(2.0 * energy) * np.array([0.0, 0.0, math.cos(angle), math.sin(angle)])
        times: list[np.ndarray] = []
        values: list[np.ndarray] = []
        gone = 0.0
        path = self.flight.paths
        for _ in range(PIECES):
            left = longest - gone
            while not fly_smooth(self.flight, 0, state, left, False):
                left *= 0.5
                if left < 1e-6 * longest:
                    return np.concatenate([*times, np.zeros(0)]), np.concatenate([*values, np.zeros(0)])
            count = least_values(self.flight, 0, self.end == "origin", SAMPLES, *self.found)
            times.append(gone + self.found[0][:count])
            values.append(self.found[1][:count].copy())
            gone += left
            if gone >= longest * (1.0 - 1e-12):
                break
            state = path.ends[0].copy()
        return np.concatenate(times), np.concatenate(values)

    def _narrowed(self, energy: float, first: tuple[float, ...], last: tuple[float, ...]) -> ScannedSegment:
        """The segment between two starts (angle, time, value), by some steps of the rule of false position."""
        low, high = first[0], last[0]
        middle = first
        for _ in range(NARROWED):
            part = first[2] / (first[2] - last[2]) if first[2] != last[2] else 0.5
            angle, guess = (first[k] + part * (last[k] - first[k]) for k in range(2))
            times, values = self.extrema(energy, angle, BEYOND * guess)
            if not len(times):
                break
            k = int(np.argmin(np.abs(times - guess)))
            middle = angle, float(times[k]), float(values[k])
            if middle[2] * first[2] > 0.0:
                first = middle
            else:
                last = middle
        angle, time, value = min((first, last, middle), key=lambda one: abs(one[2]))
        start = math.sqrt(2.0 * energy) * np.array([0.0, 0.0, math.cos(angle), math.sin(angle)])
        return ScannedSegment(("origin", self.end), (), start, np.zeros((0, 4)), np.array([time]), angle, low, high, value)


def _pairs(first: np.ndarray, second: np.ndarray) -> Iterator[tuple[int, int]]:
    """Indices of the extrema of two neighbouring starts that belong together, by their times."""
    if not len(first) or not len(second):
        return
    spacing = np.diff(first, prepend=-np.inf, append=np.inf)
    for i, time in enumerate(first):
        j = int(np.argmin(np.abs(second - time)))
        if abs(second[j] - time) <= APART * min(spacing[i], spacing[i + 1]):
            yield i, j
