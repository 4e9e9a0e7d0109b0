"""The spectrum of a motion with the energy that it has at each time as abscissa."""

from __future__ import annotations

import numpy as np

__all__ = ["over_energy"]


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
