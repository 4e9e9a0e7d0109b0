"""The transform of a signal by a complex Morlet wavelet, one frequency after the other, in a time that grows as the signal does."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from transitions.spectrum import Wavelet

__all__ = ["PER_ENVELOPE", "amplitude_rows", "envelope"]

PER_ENVELOPE = 8
"""Times in a standard deviation of a wavelet's envelope at which a row is computed at least."""

_REACH = 9.0  # standard deviations, in time and in frequency, beyond which a Gaussian is below the rounding of its largest value
_NODES = np.arange(-2, 4)  # of the polynomials between the times of a slow row: off by 3e-7 of the amplitude


def envelope(wavelet: Wavelet, frequency: float) -> float:
    """Standard deviation of a wavelet's envelope, in time, at an angular frequency."""
    return wavelet.sharpness / frequency


def amplitude_rows(signal: np.ndarray, step: float, frequencies: np.ndarray, stride: int, wavelet: Wavelet) -> Iterator[np.ndarray]:
    """Amplitudes (m,) at each `stride`-th sample, for each of the rising angular frequencies.

    A wavelet is a Gaussian over frequency, so that a row has a narrow band around its frequency. Its inverse transform is taken at
    times as far apart as the band allows, and polynomials between these give the others: a row costs as much as it has times."""
    rates = [1]  # the row's times are so many of the asked ones apart
    for frequency in frequencies[::-1]:
        room = envelope(wavelet, frequency) / (PER_ENVELOPE * stride * step)
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
    """Rows whose times are `rate` of the asked ones apart."""
    from scipy.fft import ifft, next_fast_len, rfft

    count = -(-len(signal) // stride)
    reach = math.ceil(_REACH * envelope(wavelet, frequencies[0]) / step)
    columns = next_fast_len(-(-(len(signal) + 2 * reach) // (rate * stride)))
    length = columns * rate * stride
    transform = rfft(_at_rest(signal, step, lowest, reach, length), overwrite_x=True)
    spacing = 2.0 * math.pi / (length * step)
    weights = _weights(rate)
    ahead = np.arange(_NODES[0], -(-count // rate) + _NODES[-1]) % columns
    for frequency in frequencies:
        width = _REACH / envelope(wavelet, frequency)
        bins = np.arange(math.ceil((frequency - width) / spacing), math.floor((frequency + width) / spacing) + 1)
        # A real signal has the same transform, conjugate, at negative frequencies, and a sampled one repeats it above the Nyquist one.
        turned = bins % length
        beyond = turned > length // 2
        values = transform[np.where(beyond, length - turned, turned)]
        values[beyond] = values[beyond].conj()
        values *= np.exp(-0.5 * (envelope(wavelet, frequency) * (spacing * bins - frequency)) ** 2)
        # Turned back by the row's own frequency, of which the amplitude does not know: what is left varies as slowly as the envelope.
        narrow = np.zeros(columns, dtype=complex)
        np.add.at(narrow, (bins - bins[len(bins) // 2]) % columns, values)
        slow = 2.0 / (rate * stride) * ifft(narrow, overwrite_x=True)
        if rate > 1:
            slow = (np.lib.stride_tricks.sliding_window_view(slow[ahead], len(_NODES)) @ weights).ravel()
        yield np.abs(slow[:count])


def _weights(rate: int) -> np.ndarray:
    """Lagrange's polynomials (6, rate) of the nodes, at each part of the interval between the middle two."""
    at = np.arange(rate) / rate
    others = [np.delete(_NODES, k) for k in range(len(_NODES))]
    return np.array([np.prod([(at - j) / (node - j) for j in rest], axis=0) for node, rest in zip(_NODES, others, strict=True)])


def _at_rest(signal: np.ndarray, step: float, lowest: float, reach: int, length: int) -> np.ndarray:
    """The signal, in a circle of `length` samples, without what it rests about at its faint end, with `reach` samples more beyond the loud
    one, on which it rests where it is about there.

    One mean for all, taken off, would leave a step at the faint end that is larger than the motion there. The mean about an end is that
    over three of the longest periods, with Hann's weights, which pass over tones: at the lowest frequency to 1 %, at higher ones by the
    third power less."""
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
