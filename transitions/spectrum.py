"""The wavelet spectrum of a signal: its amplitude at each frequency and time.

The complex Morlet wavelet psi(t) = exp(-t^2/B) exp(2 pi i C t)/sqrt(pi B) has unit response to a tone of its own frequency.
So twice the modulus of the transform, divided by the square root of the scale, is an amplitude: a pure tone of amplitude A shows A.

The wavelet is a Gaussian over frequency, so that a row of the spectrum has a narrow band around its frequency. The inverse transform is
taken at times as far apart as the band allows, and polynomials between these give the others. A row then costs as much as it has times.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from bvp.texts import brief, shown

__all__ = ["Spectrum", "TooCoarse", "Wavelet", "checked", "morlet_spectrum"]

_WIDTHS = 4.0  # standard deviations of the wavelet's own spectrum that stay below the Nyquist frequency
_UNTRUE = 0.02  # largest median difference of the rate and the signal's rises, in standard deviations of the signal
_STILL = 1e-6  # an interval this much smaller than the largest is not checked
_CELLS = 3_000_000  # number of amplitudes above which times are left out
_POWER = 1e-4  # fraction of the power outside the default band, on each side
_PER_ENVELOPE = 8  # least number of times in a standard deviation of a wavelet's envelope
_REACH = 9.0  # standard deviations, in time and in frequency, beyond which a Gaussian is below the rounding of its largest value
_NODES = np.arange(-2, 4)  # of the polynomials between the times of a slow row; their error is 3e-7 of the amplitude


class TooCoarse(ValueError):
    """A record has too few samples; the message is one line and says which step is fine enough."""


@dataclass(frozen=True)
class Wavelet:
    """The complex Morlet wavelet.

    Parameters
    ----------
    bandwidth, centre : float
        B and C, above 0. At a frequency of one period in a unit of time the envelope is exp(-t^2/(B C^2)). A larger C sqrt(B) makes it
        longer, and separates neighbouring frequencies better.
    """

    bandwidth: float = 2.0
    centre: float = 1.5

    def __post_init__(self) -> None:
        for name in ("bandwidth", "centre"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ValueError(f"the {name} of a wavelet is a finite number above 0; received {shown(getattr(self, name))}")
        if self.sharpness < 5.0:
            raise ValueError(
                f"a wavelet with bandwidth {self.bandwidth:g} and centre {self.centre:g} has no zero mean: "
                f"expected 2 pi centre sqrt(bandwidth/2) of 5 or more; received {self.sharpness:.3g}"
            )

    @property
    def sharpness(self) -> float:
        """Centre frequency in standard deviations of the wavelet's own spectrum, 2 pi C sqrt(B/2)."""
        return 2.0 * math.pi * self.centre * math.sqrt(0.5 * self.bandwidth)

    @property
    def reach(self) -> float:
        """Periods over which an edge of the record has an effect: the e-folding time of the response, sqrt(B) scales (Torrence & Compo,
        Bull. Am. Meteorol. Soc. 79 (1998) 61, Section 3g)."""
        return math.sqrt(self.bandwidth) * self.centre

    def envelope(self, frequency: float) -> float:
        """Standard deviation of the envelope, in time, at an angular frequency."""
        return self.sharpness / frequency


@brief
@dataclass(frozen=True, eq=False)
class Spectrum:
    """Amplitudes over time and frequency, which are computed when they are first needed."""

    times: np.ndarray  # (m,) uniform, from the first of the record to near its last
    frequencies: np.ndarray  # (k,) angular, rising, equally spaced in their logarithm
    span: tuple[float, float]  # first and last time of the record
    wavelet: Wavelet
    signal: np.ndarray  # in units of `unit`, at all times of the record; `times` are every `stride`-th of them
    unit: float
    step: float
    stride: int

    def rows(self) -> Iterator[np.ndarray]:
        """The amplitudes (m,) at each frequency, lowest first, one row at a time."""
        if "amplitudes" in vars(self):
            yield from self.amplitudes
            return
        for row in _rows(self.signal, self.step, self.frequencies, self.stride, self.wavelet):
            yield self.unit * row

    @cached_property
    def amplitudes(self) -> np.ndarray:
        """All amplitudes, (k, m)."""
        out = np.empty((len(self.frequencies), len(self.times)))
        for kept, row in zip(out, self.rows(), strict=True):
            kept[:] = row
        return out

    @cached_property
    def octaves(self) -> float:
        """Spacing of the frequencies in octaves."""
        return float(np.log2(self.frequencies[-1] / self.frequencies[0]) / (len(self.frequencies) - 1))

    @property
    def cone(self) -> np.ndarray:
        """Lowest angular frequency (m,) at each time without an effect of the record's edges; infinite at the edges."""
        near = np.minimum(self.times - self.span[0], self.span[1] - self.times)
        with np.errstate(divide="ignore"):
            return np.where(near > 0.0, 2.0 * math.pi * self.wavelet.reach / near, np.inf)

    def inside(self, times: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
        """Fraction of the wavelet (...) inside the record, 1/2 to 1, at times and frequencies of one shape. Near an edge a tone shows this
        fraction of its amplitude."""
        from scipy.special import erf

        with np.errstate(divide="ignore"):
            scale = self.wavelet.reach * 2.0 * math.pi / np.asarray(frequencies)
        times = np.asarray(times)
        return 0.5 * (erf((times - self.span[0]) / scale) + erf((self.span[1] - times) / scale))


def morlet_spectrum(
    times: np.ndarray,
    signal: np.ndarray,
    rate: np.ndarray | None = None,
    *,
    frequencies: tuple[float, float] | None = None,
    per_octave: int = 24,
    wavelet: Wavelet | None = None,
    most: int | None = None,
) -> Spectrum:
    """The wavelet spectrum of a signal, by the complex Morlet wavelet.

    Parameters
    ----------
    times : (m,) float
        Uniform.
    signal : (m,) float
        Its rest position at each end is subtracted. Otherwise the edges of the record would show it.
    rate : (m,) float, optional
        Its derivative at the same times. With it a record with too large a step is found at any frequency: a tone between the samples
        has another rate than the tone that they seem to show.
    frequencies : (float, float), optional
        Lowest and highest angular frequency. By default the band with all but 1e-4 of the power, and an octave more on each side. The
        record limits it: below by the cone of influence, above by the Nyquist frequency.
    per_octave : int
        Frequencies in an octave.
    wavelet : Wavelet, optional
    most : int, optional
        Largest number of times, for a figure.

    Returns
    -------
    Spectrum
        Its times are every k-th of the record's. Where that loses nothing, there are fewer than 3e6 amplitudes.

    Raises
    ------
    TooCoarse
        If the step is too large for the highest frequency, or for the signal.
    ValueError
        For times that are not uniform, a signal that is not finite, or a range of frequencies that is empty or too low for the record.

    Examples
    --------
    >>> times = np.linspace(0.0, 200.0, 4001)
    >>> spectrum = morlet_spectrum(times, 0.3 * np.cos(2.0 * times), frequencies=(1.0, 4.0))
    >>> middle = spectrum.amplitudes[:, len(spectrum.times) // 2]
    >>> round(float(spectrum.frequencies[np.argmax(middle)]), 6), round(float(middle.max()), 4)
    (2.0, 0.3)
    """
    wavelet = wavelet or Wavelet()
    times, signal, step = checked(times, signal)
    if isinstance(per_octave, bool) or not isinstance(per_octave, int) or per_octave < 1:
        raise ValueError(f"per_octave is an integer of 1 or more; received {shown(per_octave)}")
    span = (float(times[0]), float(times[-1]))
    largest = float(np.abs(signal).max())
    # In units of a power of two, which does not round, no square of the signal overflows.
    size = math.ldexp(1.0, math.frexp(largest)[1] - 1) if largest > 0.0 else 1.0
    signal = signal / size
    lowest = 4.0 * math.pi * wavelet.reach / (span[1] - span[0])
    highest = math.pi / (step * (1.0 + _WIDTHS / wavelet.sharpness))
    low, high = frequencies if frequencies is not None else _band(signal - signal.mean(), step, lowest, highest)
    if not 0.0 < low < high < math.inf:
        raise ValueError(f"frequencies are a lowest and a higher one, above 0; received {low:g} to {high:g}")
    if low < lowest * (1.0 - 1e-9):
        raise ValueError(f"the record lasts {span[1] - span[0]:g} and shows angular frequencies from {lowest:.4g}; received {low:g}")
    if high > highest * (1.0 + 1e-9):
        raise TooCoarse(
            f"the record's step {step:.4g} shows angular frequencies up to {highest:.4g}; received {high:g}: "
            f"expected a step of at most {step * highest / high:.4g}"
        )
    if rate is not None:
        _require_fine(signal, np.asarray(rate, dtype=float) / size, step, window=2.0 * math.pi / low)
    count = max(2, round(per_octave * math.log2(high / low)) + 1)
    grid = np.geomspace(low, high, count)
    stride = max(1, int(wavelet.envelope(high) / (_PER_ENVELOPE * step)))
    stride = min(stride, max(1, math.ceil(count * len(times) / _CELLS)))
    if most is not None:
        stride = max(stride, math.ceil(len(times) / most))
    return Spectrum(times[::stride], grid, span, wavelet, signal, size, step, stride)


def checked(times: Any, signal: Any) -> tuple[np.ndarray, np.ndarray, float]:
    """Times, signal and step of a signal at uniform times; a ValueError for anything else."""
    for values in (times, signal):
        if np.iscomplexobj(values):
            raise ValueError(f"the times and values of a signal are real numbers; received {np.asarray(values).dtype}")
    times, signal = np.asarray(times, dtype=float), np.asarray(signal, dtype=float)
    if times.ndim != 1 or len(times) < 8 or signal.shape != times.shape:
        raise ValueError(f"a signal has a row of 8 times or more and as many values; received shapes {times.shape} and {signal.shape}")
    if not (np.isfinite(times).all() and np.isfinite(signal).all()):
        raise ValueError("the times and values of a signal are finite numbers; received others")
    step = float((times[-1] - times[0]) / (len(times) - 1))
    if not step > 0.0 or np.abs(np.diff(times) - step).max() > 1e-6 * step:
        steps = np.diff(times)
        raise ValueError(f"the times of a signal rise in equal steps; received steps of {steps.min():g} to {steps.max():g}")
    return times, signal, step


def _band(signal: np.ndarray, step: float, lowest: float, highest: float) -> tuple[float, float]:
    """The band with the power of the signal and an octave more on each side, within the limits of the record."""
    if lowest >= highest:
        raise TooCoarse(f"a record of {len(signal)} samples has no frequency with room for a wavelet; expected more samples")
    power = np.abs(np.fft.rfft(signal * np.hanning(len(signal)))) ** 2
    if not power.sum() > 0.0:
        return lowest, highest
    shares = np.cumsum(power) / power.sum()
    at = 2.0 * math.pi * np.fft.rfftfreq(len(signal), step)
    low, high = at[np.searchsorted(shares, _POWER)], at[np.searchsorted(shares, 1.0 - _POWER)]
    low, high = max(lowest, 0.5 * low), min(highest, 2.0 * high)
    return (low, high) if low < high else (lowest, highest)


def _require_fine(signal: np.ndarray, rate: np.ndarray, step: float, window: float) -> None:
    """Refuse samples whose step is too large: the signal's rises differ from the integral of its rate.

    The integral is taken by the trapezoid. For a tone whose phase advances by x in a step, the difference is |2 sin(x/2) - x cos(x/2)| of
    its amplitude. This is small while x is small, and more than 2 from x = pi on, where the samples show another tone. The median leaves
    out the few steps with an impact, where the rate jumps.
    """
    if rate.shape != signal.shape or not np.isfinite(rate).all():
        raise ValueError(f"the rate has a finite value for each of the {len(signal)} of the signal; received shape {rate.shape}")
    off = np.diff(signal) - 0.5 * step * (rate[1:] + rate[:-1])
    length = min(len(off), max(8, math.ceil(window / step)))
    size = np.ptp(signal) / math.sqrt(8.0)
    for first in range(0, len(off), length):
        part = slice(min(first, len(off) - length), min(first, len(off) - length) + length)
        here = float(np.std(signal[part]))
        wrong = float(np.median(np.abs(off[part])))
        # A tone so fast that the samples hardly move still shows in the rate.
        if max(here, wrong) > _STILL * size and wrong > _UNTRUE * here:
            better = step * min(0.5, _UNTRUE * here / wrong)
            raise TooCoarse(
                f"the record's step {step:.4g} is too coarse near time {first * step:.4g} after its start: its rates and its rises "
                f"differ by {wrong / max(here, 1e-300):.2g} of the signal, expected below {_UNTRUE:g}; try a step of {better:.2g}"
            )


def _rows(signal: np.ndarray, step: float, frequencies: np.ndarray, stride: int, wavelet: Wavelet) -> Iterator[np.ndarray]:
    """Amplitudes (m,) at each `stride`-th sample, for each of the rising angular frequencies."""
    rates = [1]  # for each row: every how many times of the result it is transformed
    for frequency in frequencies[::-1]:
        room = wavelet.envelope(frequency) / (_PER_ENVELOPE * stride * step)
        rates.append(max(rates[-1], 2 ** max(0, math.floor(math.log2(room)))))
    rates = rates[:0:-1]
    first = 0
    while first < len(frequencies):
        stop = first + rates[first:].count(rates[first])
        yield from _octave(signal, step, frequencies[first:stop], frequencies[0], stride, rates[first], wavelet)
        first = stop


def _octave(
    signal: np.ndarray, step: float, frequencies: np.ndarray, lowest: float, stride: int, rate: int, wavelet: Wavelet
) -> Iterator[np.ndarray]:
    """Rows that are transformed at every `rate`-th time of the result."""
    from scipy.fft import ifft, next_fast_len, rfft

    count = -(-len(signal) // stride)
    reach = math.ceil(_REACH * wavelet.envelope(frequencies[0]) / step)
    columns = next_fast_len(-(-(len(signal) + 2 * reach) // (rate * stride)))
    length = columns * rate * stride
    transform = rfft(_at_rest(signal, step, lowest, reach, length), overwrite_x=True)
    spacing = 2.0 * math.pi / (length * step)
    # Lagrange's polynomials (6, rate) of the nodes, at each part of the interval between the middle two
    parts = np.arange(rate) / rate
    weights = np.array([np.prod([(parts - j) / (node - j) for j in _NODES if j != node], axis=0) for node in _NODES])
    ahead = np.arange(_NODES[0], -(-count // rate) + _NODES[-1]) % columns
    for frequency in frequencies:
        width = _REACH / wavelet.envelope(frequency)
        bins = np.arange(math.ceil((frequency - width) / spacing), math.floor((frequency + width) / spacing) + 1)
        # The transform of a real signal is conjugate at negative frequencies, and repeats above the Nyquist frequency.
        wrapped = bins % length
        beyond = wrapped > length // 2
        values = transform[np.where(beyond, length - wrapped, wrapped)]
        values[beyond] = values[beyond].conj()
        values *= np.exp(-0.5 * (wavelet.envelope(frequency) * (spacing * bins - frequency)) ** 2)
        # Shifted by the row's own frequency, which does not change the amplitude: the result varies as slowly as the envelope.
        narrow = np.zeros(columns, dtype=complex)
        np.add.at(narrow, (bins - bins[len(bins) // 2]) % columns, values)
        slow = 2.0 / (rate * stride) * ifft(narrow, overwrite_x=True)
        if rate > 1:
            slow = (np.lib.stride_tricks.sliding_window_view(slow[ahead], len(_NODES)) @ weights).ravel()
        yield np.abs(slow[:count])


def _at_rest(signal: np.ndarray, step: float, lowest: float, reach: int, length: int) -> np.ndarray:
    """The signal in a circle of `length` samples, without its rest position at the faint end. Beyond the loud end, `reach` samples have the
    rest position of that end.

    Subtracting one mean would leave a step at the faint end that is larger than the motion there. The rest position at an end is the mean
    over three of the longest periods with Hann's weights. These suppress tones: the lowest frequency to 1 %, higher ones by the third power
    more."""
    count = min(len(signal), max(8, math.ceil(6.0 * math.pi / (lowest * step))))
    weights = np.hanning(count + 2)[1:-1]
    weights /= weights.sum()
    begin, end = signal[:count], signal[-count:]
    first, last = float(weights @ begin), float(weights @ end)
    out = np.zeros(length)
    if np.ptp(begin) < np.ptp(end):
        out[: len(signal)] = signal - first
        out[len(signal) : len(signal) + reach] = last - first
    else:
        out[: len(signal)] = signal - last
        out[-reach:] = first - last
    return out
