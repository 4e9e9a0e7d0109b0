"""Ridges of a wavelet spectrum: maxima over frequency that go on from one time to the next, and when one of them holds."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from transitions.kernels.ridges import chains, link
from transitions.spectrum import SpectrumRows

__all__ = ["HOLDS", "SHARE", "Held", "Ridge", "amplitude_of_motion", "beside", "held", "periods", "ridges", "runs"]

SHARE = 0.2
"""Least part of the motion's amplitude that a ridge carries: a fifth."""

HOLDS = 3.0
"""Periods for which a ridge holds at least."""

_FAINT = 0.25 * SHARE  # maxima with a smaller part are not looked at
_LEFT = 1e9  # maxima so many times above the motion around them are what a louder time leaves in slow wavelets
_DRIFT = 0.25  # octaves in one period of its own that a ridge may move: what goes faster is a jump to another
_TOGETHER = 1_000_000  # maxima of which the shares are found at once
_ROUNDING = 64.0 * np.finfo(float).eps  # of the signal: the transform turns over the whole of it at once, and rounds with its largest part


@dataclass(frozen=True, eq=False)
class Ridge:
    """A maximum of the spectrum that goes on in time.

    Parameters
    ----------
    first : int
        Its first column of the spectrum.
    frequencies, amplitudes, shares : (j,) float
        Angular frequency and amplitude at successive columns, read between the rows of the spectrum, and the part of the motion's
        amplitude. What an edge of the record takes of the amplitude is given back.
    """

    first: int
    frequencies: np.ndarray
    amplitudes: np.ndarray
    shares: np.ndarray

    def __len__(self) -> int:
        return len(self.frequencies)


@dataclass(frozen=True)
class Held:
    """An interval in which one ridge is the largest: columns `first` to `last` of the spectrum, both included."""

    ridge: Ridge
    first: int
    last: int

    def _part(self, values: np.ndarray) -> np.ndarray:
        return values[self.first - self.ridge.first : self.last + 1 - self.ridge.first]

    @property
    def frequencies(self) -> np.ndarray:
        """Angular frequencies of the ridge in it."""
        return self._part(self.ridge.frequencies)

    @property
    def amplitudes(self) -> np.ndarray:
        """Amplitudes of the ridge in it."""
        return self._part(self.ridge.amplitudes)

    @property
    def shares(self) -> np.ndarray:
        """Parts of the motion's amplitude."""
        return self._part(self.ridge.shares)


def periods(frequencies: np.ndarray, step: float) -> float:
    """Turns of a phase of these angular frequencies at successive times, `step` apart."""
    return float(np.sum(0.5 * (frequencies[1:] + frequencies[:-1]))) * step / (2.0 * math.pi)


def amplitude_of_motion(times: np.ndarray, signal: np.ndarray, at: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
    """Half of the range of a signal within one period before and after each of some times, (j,).

    Parameters
    ----------
    times, signal : (m,) float
        Uniform times.
    at, frequencies : (j,) float
        Times, and the angular frequencies whose periods are meant.
    """
    step = (times[-1] - times[0]) / (len(times) - 1)
    period = 2.0 * math.pi / frequencies
    first, last = (np.clip(np.round((at + side * period - times[0]) / step).astype(int), 0, len(signal) - 1) for side in (-1.0, 1.0))
    level = np.floor(np.log2(last - first + 1)).astype(int)
    out = np.empty(len(at))
    begin = int(first.min(initial=len(signal)))
    first, last = first - begin, last - begin
    # What the windows reach; over 2^b samples from each on: two of these cover any window of up to twice as many.
    highest = lowest = signal[begin : begin + int(last.max(initial=-1)) + 1]
    for b in range(int(level.max(initial=-1)) + 1):
        if b:
            half = 2 ** (b - 1)
            highest, lowest = np.maximum(highest[:-half], highest[half:]), np.minimum(lowest[:-half], lowest[half:])
        mine = level == b
        one, other = first[mine], last[mine] + 1 - 2**b
        out[mine] = 0.5 * (np.maximum(highest[one], highest[other]) - np.minimum(lowest[one], lowest[other]))
    return out


def ridges(spectrum: SpectrumRows, times: np.ndarray, signal: np.ndarray) -> list[Ridge]:
    """All ridges that are not faint, in the order in which they begin.

    Parameters
    ----------
    spectrum : SpectrumRows
        Its rows are looked at one after the other.
    times, signal : (m,) float
        What it is the spectrum of.

    Returns
    -------
    list of Ridge
        Maxima of successive columns are one ridge where each is the other's nearest in frequency, and no further than a quarter of an
        octave in one of their periods, or one row of the spectrum. A ridge that is lost for less than a period goes on. What is lost in
        the rounding of the transform, 1e-14 of the signal's range, has none.
    """
    step = float(spectrum.times[1] - spectrum.times[0])
    some: list[tuple[np.ndarray, ...]] = []
    kept: list[tuple[np.ndarray, ...]] = []
    for found in _maxima(spectrum):
        some.append(found)
        if sum(len(columns) for columns, *_ in some) >= _TOGETHER:
            kept.append(_strong(spectrum, times, signal, some))
            some = []
    kept.append(_strong(spectrum, times, signal, some))
    columns, level, heights, shares = (np.concatenate(values) for values in zip(*kept, strict=True))
    del some, kept  # of a long motion these are large
    order = np.argsort(columns, kind="stable")  # the rows rise, and so do the levels at each time
    columns, level, heights, shares = columns[order], level[order], heights[order], shares[order]
    following = _linked(columns, level, len(spectrum.times), spectrum.octaves, step)
    number = np.empty(len(columns), dtype=np.int64)
    count = chains(following, number)
    order = np.argsort(number, kind="stable")
    bounds = np.searchsorted(number[order], np.arange(count + 1))
    out: list[Ridge] = []
    for first, stop in zip(bounds[:-1], bounds[1:], strict=True):
        part = order[first:stop]
        out += _ridges(columns[part], level[part], heights[part], shares[part], max(spectrum.octaves, _DRIFT), step)
    return sorted(out, key=lambda ridge: ridge.first)


def _maxima(spectrum: SpectrumRows) -> Iterator[tuple[np.ndarray, ...]]:
    """Columns (j,) at which a row is above both of its neighbours; the row's number there; the logarithms of the three amplitudes."""
    below = here = np.zeros(0)
    for row, above in enumerate(spectrum.rows()):
        if row > 1:
            columns = np.flatnonzero((here > below) & (here >= above))
            middle = here[columns]
            # Neighbouring rows of a tone are nearly as high: what is not is rounding, and no parabola.
            three = (np.log(np.maximum(values, 0.5 * middle)) for values in (below[columns], middle, above[columns]))
            yield columns, np.full(len(columns), row - 1), *three
        below, here = here, above


def _strong(
    spectrum: SpectrumRows, times: np.ndarray, signal: np.ndarray, some: list[tuple[np.ndarray, ...]]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Columns, frequencies in octaves, amplitudes, and shares of the motion's amplitude, of those maxima that are not faint."""
    if not some:
        return np.empty(0, dtype=np.int64), np.empty(0), np.empty(0), np.empty(0)
    columns, rows, below, here, above = (np.concatenate(values) for values in zip(*some, strict=True))
    # The logarithm of the response to a tone is nearly a parabola of that of the frequency.
    bend = below - 2.0 * here + above
    shift = np.where(bend < 0.0, 0.5 * (below - above) / np.where(bend < 0.0, bend, -1.0), 0.0)
    level = np.log2(spectrum.frequencies[rows]) + shift * spectrum.octaves
    frequencies = 2.0**level
    at = spectrum.times[columns]
    heights = np.exp(here - 0.25 * (below - above) * shift) / spectrum.inside(at, frequencies)
    motion = amplitude_of_motion(times, signal, at, frequencies)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        shares = np.where(motion > 0.0, heights / motion, 0.0)
    kept = (shares >= _FAINT) & (shares <= _LEFT) & (heights > _ROUNDING * np.ptp(signal))
    return columns[kept], level[kept], heights[kept], shares[kept]


def _ridges(
    columns: np.ndarray, level: np.ndarray, heights: np.ndarray, shares: np.ndarray, drift: float, step: float
) -> Iterator[Ridge]:
    """A chain of maxima, cut where it moves by more than `drift` octaves in a period of its own: from one column to the next, a row apart
    at most, that does not show."""
    every = np.arange(columns[0], columns[-1] + 1)
    level, heights, shares = (np.interp(every, columns, values) for values in (level, heights, shares))
    turns = np.cumsum(2.0**level) * (step / (2.0 * math.pi))
    after = np.searchsorted(turns, turns + 0.5, "right") - 1
    fast = np.abs(level[after] - level[np.searchsorted(turns, turns - 0.5)]) > drift
    cuts = [0]
    for first, stop in runs(fast):
        while first < stop and fast[first]:
            # In each period of it, where it moves most.
            last = min(stop, max(first + 1, int(np.searchsorted(turns, turns[first] + 1.0, "right"))))
            jumps = np.abs(np.diff(level[first : last + 1]))
            if len(jumps):
                cuts.append(first + 1 + int(np.argmax(jumps)))
            first = last
    for first, stop in zip(cuts, [*cuts[1:], len(every)], strict=True):
        yield Ridge(int(every[first]), 2.0 ** level[first:stop], heights[first:stop], shares[first:stop])


def _linked(columns: np.ndarray, level: np.ndarray, count: int, spacing: float, step: float) -> np.ndarray:
    """Index of the maximum that follows each, -1 where none does: `columns` do not fall, `level` is the frequency in octaves."""
    bounds = np.searchsorted(columns, np.arange(count + 1))
    reach = np.maximum(spacing, _DRIFT * 2.0**level * step / (2.0 * math.pi))
    following, scratch = np.empty((2, len(columns)), dtype=np.int64)
    link(columns, level, bounds, reach, spacing, _DRIFT, step, following, np.empty(len(columns), dtype=np.bool_), scratch)
    return following


def beside(found: Sequence[Ridge], interval: Held) -> list[Ridge]:
    """The other ridges with a column in an interval, in the order of `found`."""
    firsts = np.array([ridge.first for ridge in found])
    stops = firsts + [len(ridge) for ridge in found]
    there = np.flatnonzero((firsts <= interval.last) & (stops > interval.first)).tolist()
    return [found[k] for k in there if found[k] is not interval.ridge]


def held(spectrum: SpectrumRows, found: list[Ridge]) -> list[Held]:
    """The intervals in which one ridge is the largest and carries a fifth of the motion's amplitude, for three of its periods or more.

    Parameters
    ----------
    spectrum : SpectrumRows
    found : list of Ridge
        As `ridges` gives them.

    Returns
    -------
    list of Held
        In order of time. A ridge that goes on is not interrupted where it is not the largest for less than three periods.
    """
    step = float(spectrum.times[1] - spectrum.times[0])
    best = np.full(len(spectrum.times), -1)
    height = np.zeros(len(spectrum.times))
    for number, ridge in enumerate(found):
        part = slice(ridge.first, ridge.first + len(ridge))
        larger = (ridge.shares >= SHARE) & (ridge.amplitudes > height[part])
        best[part] = np.where(larger, number, best[part])
        height[part] = np.where(larger, ridge.amplitudes, height[part])

    def lasts(number: int, first: int, last: int) -> float:
        return periods(found[number].frequencies[first - found[number].first : last + 1 - found[number].first], step)

    stack: list[tuple[int, int, int]] = []
    for first, stop in runs(best):
        number = int(best[first])
        if number < 0:
            continue
        run = number, first, stop - 1
        k = len(stack) - 1
        while k >= 0 and stack[k][0] != number and lasts(*stack[k]) < HOLDS:
            k -= 1
        if k >= 0 and stack[k][0] == number and lasts(number, stack[k][2], run[1]) < HOLDS:
            run = number, stack[k][1], stop - 1
            del stack[k:]
        stack.append(run)
    return [Held(found[number], first, last) for number, first, last in stack if lasts(number, first, last) >= HOLDS]


def runs(values: np.ndarray) -> list[tuple[int, int]]:
    """Stretches of one value: the first index, and that after the last."""
    bounds = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1, [len(values)]]).tolist()
    return list(zip(bounds[:-1], bounds[1:], strict=True))
