"""Instantaneous frequencies of a signal: ridges of its wavelet spectrum, and its intrinsic mode functions.

A ridge is a maximum over frequency that continues in time. Empirical mode decomposition splits a signal into modes; the Hilbert transform
gives their frequencies. The optional package EMD-signal does the sifting.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bvp.texts import brief, shown
from transitions.kernels import Maxima, link
from transitions.spectrum import Spectrum, checked

__all__ = [
    "IntrinsicModes", "LEAST_PERIODS", "NotInstalled", "Ridge", "RidgeInterval", "SHARE", "amplitude_of_motion", "beside",
    "decompose", "periods", "ridge_intervals", "ridges", "runs", "sifting",
]  # fmt: skip

SHARE = 0.2
"""Least share of the motion's amplitude that a ridge must have: a fifth."""

LEAST_PERIODS = 3.0
"""Least number of periods of an interval in which a ridge is the largest."""

_FAINT = 0.25 * SHARE  # maxima with a smaller share are ignored
_LEFT = 1e9  # maxima so far above the motion around them are traces of a louder time in slow wavelets
_DRIFT = 0.25  # octaves that a ridge may move in one of its periods; a faster change is a jump to another ridge
_ROUNDING = 64.0 * np.finfo(float).eps  # of the signal's range; the transform covers the full signal and rounds with its largest part


@dataclass(frozen=True, eq=False)
class Ridge:
    """A maximum of the spectrum that continues in time, from the column `first` on.

    At successive columns it has an angular frequency and an amplitude, interpolated between the rows of the spectrum, and a share of the
    motion's amplitude, (j,) each. The amplitude is corrected for the edges of the record.
    """

    first: int
    frequencies: np.ndarray
    amplitudes: np.ndarray
    shares: np.ndarray

    def __len__(self) -> int:
        return len(self.frequencies)


@dataclass(frozen=True)
class RidgeInterval:
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
        """Shares of the motion's amplitude."""
        return self._part(self.ridge.shares)


def periods(frequencies: np.ndarray, step: float) -> float:
    """Number of periods of a tone with these angular frequencies at successive times, `step` apart."""
    return float(np.sum(0.5 * (frequencies[1:] + frequencies[:-1]))) * step / (2.0 * math.pi)


def amplitude_of_motion(times: np.ndarray, signal: np.ndarray, at: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
    """Half of the range of a signal (m,) at uniform times within one period before and after given times, (j,). `frequencies` (j,) are the
    angular frequencies that define the periods."""
    step = (times[-1] - times[0]) / (len(times) - 1)
    period = 2.0 * math.pi / frequencies
    first, last = (np.clip(np.round((at + side * period - times[0]) / step).astype(int), 0, len(signal) - 1) for side in (-1.0, 1.0))
    level = np.floor(np.log2(last - first + 1)).astype(int)
    out = np.empty(len(at))
    begin = int(first.min(initial=len(signal)))
    first, last = first - begin, last - begin
    # Maxima and minima over 2^b samples from each one on. Two of these cover any window of 2^b to 2^(b+1) samples.
    highest = lowest = signal[begin : begin + int(last.max(initial=-1)) + 1]
    for b in range(int(level.max(initial=-1)) + 1):
        if b:
            half = 2 ** (b - 1)
            highest, lowest = np.maximum(highest[:-half], highest[half:]), np.minimum(lowest[:-half], lowest[half:])
        mine = level == b
        one, other = first[mine], last[mine] + 1 - 2**b
        out[mine] = 0.5 * (np.maximum(highest[one], highest[other]) - np.minimum(lowest[one], lowest[other]))
    return out


def ridges(spectrum: Spectrum, times: np.ndarray, signal: np.ndarray) -> list[Ridge]:
    """All ridges of a spectrum that are not faint, sorted by their first column. `times` and `signal` (m,) are those of the spectrum.

    Maxima of successive columns belong to one ridge if each is the other's nearest in frequency. They may move by a quarter of an octave in
    one of their periods, or by one row of the spectrum. A gap of less than a period does not end a ridge. Maxima below the rounding of the
    transform, 1e-14 of the signal's range, are ignored.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    step = float(spectrum.times[1] - spectrum.times[0])
    columns, level, heights, shares = _strong(spectrum, times, signal)
    order = np.argsort(columns, kind="stable")  # the frequencies at each time rise, because the rows do
    columns, level, heights, shares = columns[order], level[order], heights[order], shares[order]
    reach = np.maximum(spectrum.octaves, _DRIFT * 2.0**level * step / (2.0 * math.pi))
    maxima = Maxima(columns, level, np.searchsorted(columns, np.arange(len(spectrum.times) + 1)), reach)
    following, opened = np.empty((2, len(columns)), dtype=np.int64)
    link(maxima, spectrum.octaves, _DRIFT, step, following, np.empty(len(columns), dtype=np.bool_), opened)
    linked = np.flatnonzero(following >= 0)
    # scipy 1.11 prints an error at other integers, and gives no chains.
    ends = linked.astype(np.int32), following[linked].astype(np.int32)
    links = coo_array((np.ones(len(linked)), ends), shape=(len(columns),) * 2)
    count, number = connected_components(links, directed=False)  # chains, in the order of their first maxima
    order = np.argsort(number, kind="stable")
    out: list[Ridge] = []
    for part in np.split(order, np.searchsorted(number[order], np.arange(1, count))):
        if len(part):
            out += _ridges(columns[part], level[part], heights[part], shares[part], max(spectrum.octaves, _DRIFT), step)
    return sorted(out, key=lambda ridge: ridge.first)


def _maxima(spectrum: Spectrum) -> Iterator[tuple[np.ndarray, ...]]:
    """Columns (j,) at which a row is above both of its neighbours; the row's number there; the logarithms of the three amplitudes."""
    yield (np.zeros(0, dtype=int),) * 2 + (np.zeros(0),) * 3  # for a spectrum of two rows
    below = here = np.zeros(0)
    for row, above in enumerate(spectrum.rows()):
        if row > 1:
            columns = np.flatnonzero((here > below) & (here >= above))
            middle = here[columns]
            # Neighbouring rows of a tone are nearly as high. Lower values are rounding, not part of a parabola.
            three = (np.log(np.maximum(values, 0.5 * middle)) for values in (below[columns], middle, above[columns]))
            yield columns, np.full(len(columns), row - 1), *three
        below, here = here, above


def _strong(spectrum: Spectrum, times: np.ndarray, signal: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Columns, frequencies in octaves, amplitudes, and shares of the motion's amplitude of the maxima that are not faint."""
    columns, rows, below, here, above = (np.concatenate(values) for values in zip(*_maxima(spectrum), strict=True))
    # The logarithm of the response to a tone is nearly a parabola in the logarithm of the frequency.
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


def _ridges(columns: np.ndarray, level: np.ndarray, heights: np.ndarray, shares: np.ndarray, drift: float, step: float) -> Iterator[Ridge]:
    """The ridges of a chain of maxima, which is cut where it moves by more than `drift` octaves in one of its periods.

    The steps from column to column do not show this: each of them is at most a row of the spectrum."""
    every = np.arange(columns[0], columns[-1] + 1)
    level, heights, shares = (np.interp(every, columns, values) for values in (level, heights, shares))
    cycles = np.cumsum(2.0**level) * (step / (2.0 * math.pi))
    after = np.searchsorted(cycles, cycles + 0.5, "right") - 1
    fast = np.abs(level[after] - level[np.searchsorted(cycles, cycles - 0.5)]) > drift
    cuts = [0]
    for first, stop in runs(fast):
        while first < stop and fast[first]:
            # One cut in each period, at the largest step.
            last = min(stop, max(first + 1, int(np.searchsorted(cycles, cycles[first] + 1.0, "right"))))
            jumps = np.abs(np.diff(level[first : last + 1]))
            if len(jumps):
                cuts.append(first + 1 + int(np.argmax(jumps)))
            first = last
    for first, stop in zip(cuts, [*cuts[1:], len(every)], strict=True):
        yield Ridge(int(every[first]), 2.0 ** level[first:stop], heights[first:stop], shares[first:stop])


def beside(found: Sequence[Ridge], interval: RidgeInterval) -> list[Ridge]:
    """The other ridges with a column in an interval, in the order of `found`."""
    firsts = np.array([ridge.first for ridge in found])
    stops = firsts + [len(ridge) for ridge in found]
    there = np.flatnonzero((firsts <= interval.last) & (stops > interval.first)).tolist()
    return [found[k] for k in there if found[k] is not interval.ridge]


def ridge_intervals(spectrum: Spectrum, found: list[Ridge]) -> list[RidgeInterval]:
    """The intervals in which one of the ridges `found` is the largest and has a fifth of the motion's amplitude, for three of its periods
    or more, in order of time. An interval goes on if another ridge is larger for less than three periods."""
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
        while k >= 0 and stack[k][0] != number and lasts(*stack[k]) < LEAST_PERIODS:
            k -= 1
        if k >= 0 and stack[k][0] == number and lasts(number, stack[k][2], run[1]) < LEAST_PERIODS:
            run = number, stack[k][1], stop - 1
            del stack[k:]
        stack.append(run)
    return [RidgeInterval(found[number], first, last) for number, first, last in stack if lasts(number, first, last) >= LEAST_PERIODS]


def runs(values: np.ndarray) -> list[tuple[int, int]]:
    """The intervals of equal values: the first index, and the one after the last."""
    bounds = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1, [len(values)]]).tolist()
    return list(zip(bounds[:-1], bounds[1:], strict=True))


class NotInstalled(ImportError):
    """An optional package is missing; the message is one line and says what to install."""


@brief
@dataclass(frozen=True, eq=False)
class IntrinsicModes:
    """A signal as a sum of intrinsic mode functions and a residue.

    Parameters
    ----------
    times : (m,) float
    functions : (k, m) float
        The intrinsic mode functions, fastest first.
    residue : (m,) float
        The rest, which does not oscillate. The signal is the sum of the functions and the residue.
    frequencies : (k, m) float
        Instantaneous angular frequencies, the rate of the phase of the analytic signal. They are negative where a mode has riding waves,
        and have no meaning near the ends of the record.
    amplitudes : (k, m) float
        Modulus of the analytic signal.
    """

    times: np.ndarray
    functions: np.ndarray
    residue: np.ndarray
    frequencies: np.ndarray
    amplitudes: np.ndarray

    @property
    def mean_frequencies(self) -> np.ndarray:
        """Mean angular frequency (k,) of each mode, weighted by its squared amplitude: the centre of its power spectrum."""
        return np.sum(self.frequencies * self.amplitudes**2, axis=1) / np.sum(self.amplitudes**2, axis=1)

    @property
    def orthogonality(self) -> float:
        """Index of orthogonality, 0 for orthogonal parts: sum_t sum_{i != j} c_i(t) c_j(t) / sum_t X(t)^2 with X the sum of all parts c.

        It is the index of Huang et al. (1998), but with separate sums over time in numerator and denominator, because X passes through
        zero."""
        parts = np.vstack([self.functions, self.residue])
        total = float(np.sum(np.sum(parts, axis=0) ** 2))
        return (total - float(np.sum(parts**2))) / total if total > 0.0 else 0.0


def sifting() -> Any:
    """Return the sifting object of the package EMD-signal.

    Raises
    ------
    NotInstalled
        If the package is missing.
    """
    try:
        from PyEMD import EMD
    except ImportError as error:
        message = 'empirical mode decomposition needs the package EMD-signal, which is not installed; expected: pip install "saltus[emd]"'
        raise NotInstalled(message) from error
    return EMD()


def decompose(times: np.ndarray, signal: np.ndarray, *, most: int | None = None) -> IntrinsicModes:
    """Decompose a signal into intrinsic mode functions.

    Parameters
    ----------
    times : (m,) float
        Uniform.
    signal : (m,) float
    most : int, optional
        Largest number of functions.

    Returns
    -------
    IntrinsicModes

    Raises
    ------
    NotInstalled
        If EMD-signal is missing.
    ValueError
        For times that are not uniform, or fewer than eight.

    Notes
    -----
    Huang, Shen, Long, Wu, Shih, Zheng, Yen, Tung, Liu, Proc. R. Soc. Lond. A 454 (1998) 903.
    """
    from scipy.signal import hilbert

    times, signal, step = checked(times, signal)
    if most is not None and (isinstance(most, bool) or not isinstance(most, int) or most < 1):
        raise ValueError(f"most is an integer of 1 or more; received {shown(most)}")
    # EMD-signal stops at absolute ranges and sums, which fit signals of size 1.
    size = float(np.ptp(signal)) or 1.0
    sifter = sifting()
    sifter.emd(signal / size, times - times[0], max_imf=-1 if most is None else most)
    functions = size * np.asarray(sifter.get_imfs_and_residue()[0], dtype=float).reshape(-1, len(times))
    analytic = np.array([hilbert(function) for function in functions]).reshape(functions.shape)
    frequencies = np.gradient(np.unwrap(np.angle(analytic), axis=1), step, axis=1)
    return IntrinsicModes(times, functions, signal - functions.sum(axis=0), frequencies, np.abs(analytic))
