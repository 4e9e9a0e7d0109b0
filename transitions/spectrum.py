"""The wavelet spectrum of a signal: the amplitude that it has at each frequency and time.

The complex Morlet wavelet psi(t) = exp(-t^2/B) exp(2 pi i C t)/sqrt(pi B) has unit response to a tone of its own frequency.
So twice the modulus of the transform, divided by the square root of the scale, is an amplitude: a pure tone of amplitude A shows A.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from bvp.shown import shown
from transitions.transform import PER_ENVELOPE, amplitude_rows, envelope

__all__ = ["Spectrum", "SpectrumRows", "TooCoarse", "Wavelet", "checked", "morlet_rows", "morlet_spectrum"]

_WIDTHS = 4.0  # standard deviations of the wavelet's own spectrum that stay below the Nyquist frequency
_UNTRUE = 0.02  # median of what the rate and the signal disagree by, in standard deviations of the signal
_STILL = 1e-6  # a stretch this much smaller than the largest has nothing to show
_CELLS = 3_000_000  # amplitudes up to which no time is left out
_POWER = 1e-4  # part of the power outside the band that is looked at by default, on each side


class TooCoarse(ValueError):
    """A record has too few samples for what was asked; the message is one line and says which step would do."""


@dataclass(frozen=True)
class Wavelet:
    """The complex Morlet wavelet.

    Parameters
    ----------
    bandwidth, centre : float
        B and C, above 0: at a frequency of one period a unit of time the envelope is exp(-t^2/(B C^2)), which lasts longer, and parts
        neighbouring frequencies better, the larger C sqrt(B) is.
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
        """Periods from an edge within which it is felt: the e-folding time of the response, sqrt(B) scales (Torrence & Compo, Bull. Am.
        Meteorol. Soc. 79 (1998) 61, Section 3g)."""
        return math.sqrt(self.bandwidth) * self.centre


@dataclass(frozen=True, eq=False)
class SpectrumRows(ABC):
    """Amplitudes over time and frequency, one row after the other.

    Parameters
    ----------
    times : (m,) float
        Uniform, from the first of the record to near its last.
    frequencies : (k,) float
        Angular, rising, equally spaced in their logarithm.
    span : (float, float)
        First and last time of the record.
    wavelet : Wavelet
    """

    times: np.ndarray
    frequencies: np.ndarray
    span: tuple[float, float]
    wavelet: Wavelet

    @abstractmethod
    def rows(self) -> Iterator[np.ndarray]:
        """The amplitudes (m,) at each frequency, from the lowest on."""

    @cached_property
    def octaves(self) -> float:
        """Spacing of the frequencies in octaves."""
        return float(np.log2(self.frequencies[-1] / self.frequencies[0]) / (len(self.frequencies) - 1))

    @property
    def cone(self) -> np.ndarray:
        """Lowest angular frequency (m,) at each time that the edges of the record do not reach; infinite at the edges."""
        near = np.minimum(self.times - self.span[0], self.span[1] - self.times)
        with np.errstate(divide="ignore"):
            return np.where(near > 0.0, 2.0 * math.pi * self.wavelet.reach / near, np.inf)

    def inside(self, times: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
        """Part of the wavelet (...) that lies within the record, 1/2 to 1, at times and frequencies of one shape: what is left of a tone's
        amplitude near an edge."""
        from scipy.special import erf

        with np.errstate(divide="ignore"):
            scale = self.wavelet.reach * 2.0 * math.pi / np.asarray(frequencies)
        times = np.asarray(times)
        return 0.5 * (erf((times - self.span[0]) / scale) + erf((self.span[1] - times) / scale))


@dataclass(frozen=True, eq=False)
class Spectrum(SpectrumRows):
    """Amplitudes over time and frequency.

    Parameters
    ----------
    amplitudes : (k, m) float
    times, frequencies, span, wavelet
        As of `SpectrumRows`.
    """

    amplitudes: np.ndarray

    def rows(self) -> Iterator[np.ndarray]:
        return iter(self.amplitudes)


@dataclass(frozen=True, eq=False)
class _Computed(SpectrumRows):
    """A spectrum whose rows are computed each time they are asked for: at every `stride`-th sample of a signal in parts of `size`."""

    signal: np.ndarray
    step: float
    stride: int
    size: float

    def rows(self) -> Iterator[np.ndarray]:
        for row in amplitude_rows(self.signal, self.step, self.frequencies, self.stride, self.wavelet):
            yield self.size * row


def morlet_spectrum(times: np.ndarray, signal: np.ndarray, rate: np.ndarray | None = None, **options: Any) -> Spectrum:
    """The wavelet spectrum of a signal, as `morlet_rows` computes it.

    Parameters
    ----------
    times, signal, rate, **options
        As for `morlet_rows`, which says what is refused, too.

    Examples
    --------
    >>> times = np.linspace(0.0, 200.0, 4001)
    >>> spectrum = morlet_spectrum(times, 0.3 * np.cos(2.0 * times), frequencies=(1.0, 4.0))
    >>> middle = spectrum.amplitudes[:, len(spectrum.times) // 2]
    >>> round(float(spectrum.frequencies[np.argmax(middle)]), 6), round(float(middle.max()), 4)
    (2.0, 0.3)
    """
    found = morlet_rows(times, signal, rate, **options)
    amplitudes = np.empty((len(found.frequencies), len(found.times)))
    for kept, row in zip(amplitudes, found.rows(), strict=True):
        kept[:] = row
    return Spectrum(found.times, found.frequencies, found.span, found.wavelet, amplitudes)


def morlet_rows(
    times: np.ndarray,
    signal: np.ndarray,
    rate: np.ndarray | None = None,
    *,
    frequencies: tuple[float, float] | None = None,
    per_octave: int = 24,
    wavelet: Wavelet | None = None,
    most: int | None = None,
) -> SpectrumRows:
    """The wavelet spectrum of a signal, by the complex Morlet wavelet, row by row.

    Parameters
    ----------
    times : (m,) float
        Uniform.
    signal : (m,) float
        What it rests about at each end is taken off, as the edges of the record would show it otherwise.
    rate : (m,) float, optional
        Its derivative at the same times. A tone that the samples cannot show has another rate than the tone that they seem to show, so
        with it a record that is too coarse is told from one that is not, whatever its frequencies.
    frequencies : (float, float), optional
        Lowest and highest angular frequency. By default an octave more on each side than the band with all but 1e-4 of the power, as far
        as the record goes: down to where the cone of influence closes, up to where the wavelet passes the Nyquist frequency.
    per_octave : int
        Frequencies in an octave.
    wavelet : Wavelet, optional
    most : int, optional
        Times at most, for a picture: what happens between them is left out.

    Returns
    -------
    SpectrumRows
        Its times are each so many-th of the record's, so that there are fewer than 3e6 amplitudes where that loses nothing.

    Raises
    ------
    TooCoarse
        Where the samples lie too far apart for the highest frequency, or for the signal.
    ValueError
        For times that are not uniform, a signal that is not finite, a range of frequencies that is empty or below what the record can show.
    """
    wavelet = wavelet or Wavelet()
    times, signal, step = checked(times, signal)
    if isinstance(per_octave, bool) or not isinstance(per_octave, int) or per_octave < 1:
        raise ValueError(f"per_octave is a whole number of 1 or more; received {shown(per_octave)}")
    span = (float(times[0]), float(times[-1]))
    size = _power_of_two(signal)
    signal = signal / size  # so that no square of it leaves the range of doubles
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
    stride = max(1, int(envelope(wavelet, high) / (PER_ENVELOPE * step)))
    stride = min(stride, max(1, math.ceil(count * len(times) / _CELLS)))
    if most is not None:
        stride = max(stride, math.ceil(len(times) / most))
    return _Computed(times[::stride], grid, span, wavelet, signal, step, stride, size)


def _power_of_two(signal: np.ndarray) -> float:
    """The power of two next to the largest value, by which others are divided without rounding; 1 of nothing."""
    largest = float(np.abs(signal).max())
    return math.ldexp(1.0, math.frexp(largest)[1] - 1) if largest > 0.0 else 1.0


def checked(times: Any, signal: Any) -> tuple[np.ndarray, np.ndarray, float]:
    """Times, signal and step of a signal at uniform times.

    Raises
    ------
    ValueError
        In one line, for what is none.
    """
    complex_one = next((part for part in (np.asarray(times), np.asarray(signal)) if np.iscomplexobj(part)), None)
    if complex_one is not None:
        raise ValueError(f"the times and values of a signal are real numbers; received {complex_one.dtype}")
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
    """The band with the power of the signal, an octave wider on each side, within the bounds of the record."""
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
    """Refuse samples between which the signal does other things than they show: its rises are not those of the rate.

    Over a step the signal rises by the integral of the rate, for which the trapezoid is taken. A tone that turns by an angle x in a step is
    off by |2 sin(x/2) - x cos(x/2)| of its amplitude: little while x is small, more than twice from x = pi on, where it is seen as another.
    The median passes over the few steps with an impact in them, where the rate jumps.
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
        # What turns so fast that the samples hardly move still shows in the rate.
        if max(here, wrong) > _STILL * size and wrong > _UNTRUE * here:
            better = step * min(0.5, _UNTRUE * here / wrong)
            raise TooCoarse(
                f"the record's step {step:.4g} is too coarse near time {first * step:.4g} after its start: its rates and its rises "
                f"differ by {wrong / max(here, 1e-300):.2g} of the signal, expected below {_UNTRUE:g}; try a step of {better:.2g}"
            )
