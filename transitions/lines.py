"""The lines of a motion: the ridge that is followed and those beside it, and how unlike they are to the harmonics of an orbit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from transitions.families import NEAR
from transitions.ridges import HOLDS, Held, Ridge, beside

__all__ = ["Around", "Lines", "lines_of", "partner", "unlike"]


@dataclass(frozen=True, eq=False)
class Around:
    """Means over three periods around places of a ridge, or as much of that as there is.

    Parameters
    ----------
    turns : (m,) float
        Periods of the ridge since its first column, rising.
    places : (j,) int
        Columns, rising.
    """

    turns: np.ndarray
    places: np.ndarray

    def window(self, length: float = HOLDS) -> tuple[np.ndarray, np.ndarray]:
        """Turns (j,) at which windows of so many periods around the places begin and end, within the ridge."""
        at = self.turns[self.places]
        return np.clip(at - 0.5 * length, 0.0, self.turns[-1]), np.clip(at + 0.5 * length, 0.0, self.turns[-1])

    @cached_property
    def _three(self) -> tuple[np.ndarray, np.ndarray]:
        return self.window()

    def reached(self, first: int, stop: int) -> slice:
        """The places whose means feel the columns `first` to `stop` - 1."""
        low, high = self._three
        return slice(int(np.searchsorted(high, self.turns[first], "right")), int(np.searchsorted(low, self.turns[stop - 1], "left")))

    def mean(self, values: np.ndarray, first: int = 0, at: slice = slice(None)) -> np.ndarray:
        """Means of values at the columns from `first` on, zero elsewhere, at some of the places."""
        turns = self.turns[first : first + len(values)]
        area = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(turns))])
        low, high = (edge[at] for edge in self._three)
        return (np.interp(high, turns, area) - np.interp(low, turns, area)) / (high - low)


@dataclass(frozen=True, eq=False)
class Lines:
    """Lines of a motion at places of the ridge that is followed, which is the first of them.

    Parameters
    ----------
    ratios, amplitudes : (s, j) float
        Frequencies in that of the first, and amplitudes, both 0 where there is none: means over three periods.
    """

    ratios: np.ndarray
    amplitudes: np.ndarray


def lines_of(found: Sequence[Ridge], interval: Held, around: Around) -> Lines:
    """The lines of a motion in an interval.

    Parameters
    ----------
    found : sequence of Ridge
        All of the motion, in the order in which they begin.
    interval : Held
        The ridge that is followed.
    around : Around
        Of its columns.
    """
    count = len(around.places)
    rows = [(np.ones(count), around.mean(interval.amplitudes))]
    free = [count]  # from which place on a row has room for another ridge
    for ridge in beside(found, interval):
        first, stop = max(interval.first, ridge.first), min(interval.last + 1, ridge.first + len(ridge))
        if stop - first < 2:
            continue
        here = slice(first - interval.first, stop - interval.first)
        at = around.reached(here.start, here.stop)
        if at.start >= at.stop:
            continue
        own = slice(first - ridge.first, stop - ridge.first)
        amplitudes = ridge.amplitudes[own]
        size = around.mean(amplitudes, here.start, at)
        pitch = around.mean(amplitudes * np.log(ridge.frequencies[own] / interval.frequencies[here]), here.start, at)
        k = next((k for k, place in enumerate(free) if place <= at.start), len(rows))
        if k == len(rows):
            rows.append((np.zeros(count), np.zeros(count)))
            free.append(0)
        with np.errstate(divide="ignore", invalid="ignore"):
            rows[k][0][at] = np.where(size > 0.0, np.exp(pitch / size), 0.0)
        rows[k][1][at] = size
        free[k] = at.stop
    return Lines(np.array([row[0] for row in rows]), np.array([row[1] for row in rows]))


def _partners(ratios: np.ndarray, harmonic: int, most: int) -> tuple[np.ndarray, np.ndarray]:
    """The nearest harmonic to each line, and whether it is within 0.05 octave: both (s, j)."""
    turn = ratios * harmonic
    k = np.clip(np.round(turn), 1, most)
    with np.errstate(divide="ignore"):
        return k.astype(int), np.abs(np.log2(turn / k)) <= NEAR


def unlike(shares: np.ndarray, harmonic: int, ratios: np.ndarray, parts: np.ndarray) -> np.ndarray:
    """Largest difference (j,) between the lines of a motion and the harmonics of an orbit, as part of the amplitude.

    Parameters
    ----------
    shares : (j, k) float
        Parts of the orbit's amplitude that its harmonics 1 to k carry.
    harmonic : int
        The one that the first line is at.
    ratios, parts : (s, j) float
        Frequencies of the lines in that of the first, and the parts of the motion's amplitude that they carry. A line without a partner
        counts whole.

    Examples
    --------
    >>> orbit = np.array([[0.8, 0.0, 0.1]])
    >>> np.round(unlike(orbit, 1, np.array([[1.0], [3.02]]), np.array([[0.7], [0.15]])), 6).tolist()
    [0.1]
    """
    left = shares.copy()
    rows = np.arange(len(left))
    worst = np.zeros(len(left))
    for k, near, part in zip(*_partners(ratios, harmonic, left.shape[1]), parts, strict=True):
        own = left[rows, k - 1]
        worst = np.maximum(worst, np.where(near, np.abs(part - own), part))
        left[rows, k - 1] = np.where(near, 0.0, own)
    return np.maximum(worst, left.max(axis=1))


def partner(count: int, harmonic: int, ratios: np.ndarray, parts: np.ndarray) -> np.ndarray:
    """The part of a motion's amplitude (k, j) that its line at each of the harmonics 1 to k carries, 0 where there is none.

    Parameters
    ----------
    count : int
        k.
    harmonic, ratios, parts
        As for `unlike`.

    Examples
    --------
    >>> partner(4, 1, np.array([[1.0], [3.02]]), np.array([[0.75], [0.25]]))[:, 0].tolist()
    [0.75, 0.0, 0.25, 0.0]
    """
    out = np.zeros((count, ratios.shape[1]))
    columns = np.arange(ratios.shape[1])
    for k, near, part in zip(*_partners(ratios, harmonic, count), parts, strict=True):
        out[k - 1, columns] = np.maximum(out[k - 1, columns], np.where(near, part, 0.0))
    return out
