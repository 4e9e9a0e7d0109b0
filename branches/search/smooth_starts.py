"""A scan of starts at the origin for orbits of smooth systems without impacts, two degrees of freedom.

From a start at the origin the kinetic energy passes extrema, at which the modal velocity is perpendicular to the acceleration. With the
angle of the start the component along that perpendicular changes its sign where the velocity is zero: there the motion reaches rest, and
is a quarter of an orbit. The distance from the origin does the same for half an orbit between two origins.

The scan compares neighbouring angles. It proves nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from branches.search.starts import ScannedSegment
from bvp.kernels.smooth import ORDER, fly_smooth
from bvp.smooth_flights import smooth_flight

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["SmoothSampler"]

SAMPLES = 6
"""Points of a Taylor step at which an extremum is looked for."""

PIECES = 40
"""Most pieces in which a long motion is computed."""

NARROWED = 12
"""Secant steps in the angle of a start; Newton's method does the rest."""

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

    def segments(self, energy: float, angles: int) -> Iterator[ScannedSegment]:
        """The segment of each change of sign between neighbouring angles, as many in half a turn, in order of the angles. The other half
        turn is the mirror image."""
        grid = (np.arange(angles + 1) + 0.5) * (math.pi / angles)
        before = self.extrema(energy, grid[0])
        for low, high in zip(grid[:-1], grid[1:], strict=True):
            after = self.extrema(energy, high)
            for i, j in _pairs(before[0], after[0]):
                if before[1][i] * after[1][j] <= 0.0:
                    found = self._narrowed(energy, (low, *(part[i] for part in before)), (high, *(part[j] for part in after)))
                    if found is not None:
                        yield found
            before = after

    def extrema(self, energy: float, angle: float) -> tuple[np.ndarray, np.ndarray]:
        """The times (k,) of the extrema of a start's motion, and what changes its sign at an orbit (k,)."""
        state = math.sqrt(2.0 * energy) * np.array([0.0, 0.0, math.cos(angle), math.sin(angle)])
        times, values, gone = [], [], 0.0
        path = self.flight.paths
        for _ in range(PIECES):
            left = self.longest - gone
            while not fly_smooth(self.flight, 0, state, left, False):
                left *= 0.5
                if left < 1e-6 * self.longest:
                    return np.array(times), np.array(values)
            steps = int(path.steps[0, 0])
            found, value = _extrema(path.coefficients[0, :steps], path.times[0, : steps + 1], self.end == "origin")
            times.append(gone + found)
            values.append(value)
            gone += left
            state = path.ends[0].copy()
            if gone >= self.longest * (1.0 - 1e-12):
                break
        return np.concatenate(times), np.concatenate(values)

    def _narrowed(self, energy: float, low: tuple[float, ...], high: tuple[float, ...]) -> ScannedSegment | None:
        """The segment between two starts (angle, time, value); None if the extremum is not there between them."""
        first, last = low, high
        middle = first
        for _ in range(NARROWED):
            part = first[2] / (first[2] - last[2]) if first[2] != last[2] else 0.5
            angle = first[0] + min(max(part, 0.02), 0.98) * (last[0] - first[0])
            times, values = self.extrema(energy, angle)
            guess = first[1] + (angle - first[0]) / (last[0] - first[0]) * (last[1] - first[1])
            if not len(times):
                return None
            k = int(np.argmin(np.abs(times - guess)))
            middle = angle, float(times[k]), float(values[k])
            if middle[2] * first[2] > 0.0:
                first = middle
            else:
                last = middle
            if abs(last[0] - first[0]) < 1e-9:
                break
        angle, time, value = min((first, last, middle), key=lambda one: abs(one[2]))
        start = math.sqrt(2.0 * energy) * np.array([0.0, 0.0, math.cos(angle), math.sin(angle)])
        return ScannedSegment(("origin", self.end), (), start, np.zeros((0, 4)), np.array([time]), angle, low[0], high[0], value)


def _pairs(first: np.ndarray, second: np.ndarray) -> Iterator[tuple[int, int]]:
    """Indices of the extrema of two neighbouring starts that belong together, by their times."""
    if not len(first) or not len(second):
        return
    spacing = np.diff(first, prepend=-np.inf, append=np.inf)
    for i, time in enumerate(first):
        j = int(np.argmin(np.abs(second - time)))
        if abs(second[j] - time) <= APART * min(spacing[i], spacing[i + 1]):
            yield i, j


def _extrema(coefficients: np.ndarray, times: np.ndarray, of_distance: bool) -> tuple[np.ndarray, np.ndarray]:
    """Times at which the speed is extreme, or the distance from the origin, along the Taylor steps (S, ORDER + 1, 4) of a path; and there
    the velocity across the acceleration, or the displacement across the velocity."""
    orders = np.arange(ORDER + 1)
    lengths = np.diff(times)
    at = np.linspace(0.0, 1.0, SAMPLES + 1)[None, :] * lengths[:, None]
    place = np.repeat(np.arange(len(lengths)), SAMPLES)

    def look(step: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        powers = t[..., None] ** orders
        rows = coefficients[step]
        state = np.einsum("...k,...kr->...r", powers, rows)
        rates = np.einsum("...k,...kr->...r", powers[..., :-1] * orders[1:], rows[..., 1:, 2:])
        a, b = (state[..., :2], state[..., 2:]) if of_distance else (state[..., 2:], rates)
        along = np.einsum("...r,...r->...", a, b)
        # Of a start at the origin the acceleration is zero, and so are both.
        size = np.linalg.norm(b, axis=-1)
        return along, (a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]) / np.where(size > 0.0, size, 1.0)

    along, _ = look(np.arange(len(lengths))[:, None].repeat(SAMPLES + 1, 1), at)
    # The far end is a least distance from the origin, or a least speed: what it is along rises through zero there.
    rising = ((along[:, :-1] < 0.0) & (along[:, 1:] >= 0.0)).ravel()
    step, low, high = place[rising], at[:, :-1].ravel()[rising], at[:, 1:].ravel()[rising]
    f_low, f_high = along[:, :-1].ravel()[rising], along[:, 1:].ravel()[rising]
    for _ in range(8):
        t = np.clip(low + f_low / (f_low - f_high) * (high - low), low, high) if len(step) else low
        f, _ = look(step, t)
        below = f < 0.0
        # Illinois' rule: the value of an end that stays is halved.
        f_high = np.where(below, 0.5 * f_high, f)
        f_low = np.where(below, f, 0.5 * f_low)
        low, high = np.where(below, t, low), np.where(below, high, t)
    t = np.where(np.abs(f_low) < np.abs(f_high), low, high) if len(step) else low
    return times[step] + t, look(step, t)[1] if len(step) else np.zeros(0)
