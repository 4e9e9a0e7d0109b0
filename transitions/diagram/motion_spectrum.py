"""What the figure of a motion shows of its spectrum: the range of frequencies, and the spectrum over the energy at each time."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from transitions.ridges import SHARE
from transitions.spectrum import Spectrum, TooCoarse

if TYPE_CHECKING:
    from transitions.record import Record
    from transitions.transition import Transition

__all__ = ["band", "gradual_energy", "over_energy", "shown_spectrum"]

_POWER = 1e-3  # part of the power above the highest frequency of the first and last parts of a record


def shown_spectrum(transition: Transition) -> Spectrum:
    """The spectrum of a motion that holds what is fast near the ends of its record, too.

    By default a spectrum covers the band of the record under a window that vanishes at both ends. A damped motion is fastest where it
    begins, so the band of the record with mirror images before and behind it may reach higher.
    """
    spectrum, record = transition.spectrum, transition.record
    if transition.frequencies is not None:
        return spectrum
    w, _ = record.along(transition.gap)
    whole = np.pad(w - w.mean(), len(w) // 2, mode="reflect")
    power = np.abs(np.fft.rfft(whole * np.hanning(len(whole)))) ** 2
    if not power.sum() > 0.0:
        return spectrum
    shares = np.cumsum(power) / power.sum()
    high = 4.0 * np.pi * float(np.fft.rfftfreq(len(whole), record.step)[np.searchsorted(shares, 1.0 - _POWER)])
    if high <= spectrum.frequencies[-1]:
        return spectrum
    try:
        return replace(transition, frequencies=(float(spectrum.frequencies[0]), high)).spectrum
    except TooCoarse:
        return spectrum


def band(spectrum: Spectrum) -> tuple[float, float]:
    """Lowest and highest frequency with a fifth of the largest amplitude at any time, with room for names below and a third of an octave
    above. Low frequencies do not count where the edges of the record are felt: what begins there is no slow motion."""
    clear = spectrum.frequencies[:, None] > spectrum.cone[None, :]
    inside = np.where(clear, spectrum.amplitudes, 0.0) if clear.any() else spectrum.amplitudes
    last = len(spectrum.frequencies) - 1
    slow = np.flatnonzero(inside.max(axis=1) >= SHARE * inside.max())
    fast = np.flatnonzero(spectrum.amplitudes.max(axis=1) >= SHARE * inside.max())
    if not len(slow):
        return float(spectrum.frequencies[0]), float(spectrum.frequencies[last])
    high = float(spectrum.frequencies[min(last, int(fast[-1]) + max(1, round(1.0 / (3.0 * spectrum.octaves))))])
    low = float(spectrum.frequencies[max(0, int(slow[0]) - 1)])
    return max(float(spectrum.frequencies[0]), low - 0.1 * (high - low)), high


def gradual_energy(record: Record, times: np.ndarray) -> np.ndarray:
    """The energy at some times (m,) as it falls where no impact took it at once: each jump, in the logarithm of the energy, is spread over
    half of the shorter flight beside the impact, before it and behind it.

    A wavelet averages over several flights. Over the energy itself, which is constant between impacts of an undamped motion, its amplitudes
    would stand in a few columns with nothing between them.
    """
    level = np.log(np.maximum(record.energy, 1e-300))
    out = np.interp(times, record.times, level)
    if not len(record.impacts):
        return np.exp(out)
    edges = np.concatenate([record.times[:1], record.impacts, record.times[-1:]])
    reach = 0.5 * np.minimum(np.diff(edges)[:-1], np.diff(edges)[1:])
    for time, half in zip(record.impacts, reach, strict=True):
        # The record holds the impact between two samples.
        k = int(np.clip(np.searchsorted(record.times, time), 1, len(level) - 1))
        jump = level[k] - level[k - 1]
        near = slice(*np.searchsorted(times, (min(time - half, record.times[k - 1]), max(time + half, record.times[k]))))
        at = times[near]
        step = np.interp(at, record.times[[k - 1, k]], (0.0, 1.0))
        ramp = np.clip(0.5 + 0.5 * (at - time) / half, 0.0, 1.0) if half > 0.0 else step
        out[near] += jump * (ramp - step)
    return np.exp(out)


def over_energy(energies: np.ndarray, amplitudes: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Amplitudes at each frequency, in intervals of the energy.

    Parameters
    ----------
    energies : (m,) float
        Of the motion at successive times, above 0.
    amplitudes : (k, m) float
    edges : (j + 1,) float
        Rising, above 0.

    Returns
    -------
    (k, j) float
        The largest amplitude that the motion has while its energy is within each interval; NaN where it never is. An impact takes energy
        at once: the intervals that are passed then have amplitudes between those at the times before and after it, in the logarithm of
        the energy.
    """
    level, bounds = np.log(energies), np.log(edges)
    out = np.full((len(amplitudes), len(edges) - 1), -np.inf)
    middles = 0.5 * (bounds[1:] + bounds[:-1])
    place = np.clip(np.searchsorted(bounds, level, side="right") - 1, 0, len(middles) - 1)
    inside = (level >= bounds[0]) & (level <= bounds[-1])
    for column in np.flatnonzero(inside):
        np.maximum(out[:, place[column]], amplitudes[:, column], out=out[:, place[column]])
    for column in np.flatnonzero(np.abs(np.diff(place)) > 1):
        low, high = sorted((place[column], place[column + 1]))
        between = np.arange(low + 1, high)
        part = (middles[between] - level[column]) / (level[column + 1] - level[column])
        passed = amplitudes[:, column, None] * (1.0 - part) + amplitudes[:, column + 1, None] * part
        out[:, between] = np.maximum(out[:, between], passed)
    return np.where(np.isfinite(out), out, np.nan)
