"""The largest peak of the windowed spectrum of a signal, to more digits than the spacing of its lines."""

from __future__ import annotations

import numpy as np
from scipy.fft import next_fast_len, rfft

__all__ = ["WINDOW", "dominant_frequency"]

WINDOW = "Hann"
"""w(t) = sin^2(pi t/T): its side lobes fall as the third power of the distance, so two modes hardly move each other's peak."""

_PADDING = 2
_STEPS = 8


def dominant_frequency(signal: np.ndarray, step: float) -> float:
    """Angular frequency of the largest peak of the spectrum of a signal under the Hann window.

    The mean under the window is taken off. The largest line of the padded discrete transform and its neighbours give a first place, by
    the parabola through the logarithms of their amplitudes; from there Newton's method goes to the maximum of the transform itself,
    which is defined at all frequencies. A single tone in the signal is returned to a relative 1e-6 and better. What has fewer than two
    periods in the signal cannot be told from a drift of its mean, and is left out.

    Parameters
    ----------
    signal : (N,) float
        At equal time steps; N at least 8.
    step : float

    Returns
    -------
    float
        0.0 for a signal that does not vary.

    Examples
    --------
    >>> times = np.arange(4096) * 0.05
    >>> round(dominant_frequency(np.sin(1.234567 * times) + 0.3, 0.05), 7)
    1.234567
    """
    values = np.asarray(signal, dtype=float)
    count = len(values)
    if count < 8:
        raise ValueError(f"a spectrum of {count} samples; expected 8 or more")
    window = np.sin(np.pi * (np.arange(count) + 0.5) / count) ** 2
    windowed = (values - np.sum(window * values) / np.sum(window)) * window
    if not np.max(np.abs(windowed)) > 1e-13 * np.max(np.abs(values), initial=1e-300):
        return 0.0
    padded = next_fast_len(_PADDING * count, real=True)
    amplitude = np.abs(rfft(windowed, padded))
    lowest = -(-2 * padded // count)
    peak = int(np.argmax(amplitude[lowest:-1])) + lowest
    left, middle, right = np.log(np.maximum(amplitude[peak - 1 : peak + 2], 1e-300))
    bend = left - 2.0 * middle + right
    line = 2.0 * np.pi / (padded * step)
    frequency = line * (peak + (0.5 * (left - right) / bend if bend < 0.0 else 0.0))
    times = (np.arange(count) - 0.5 * (count - 1)) * step
    squares = times * times
    for _ in range(_STEPS):
        turned = windowed * np.exp(-1j * frequency * times)
        value, first, second = np.sum(turned), -1j * (times @ turned), -(squares @ turned)
        slope = 2.0 * (value.conjugate() * first).real
        curvature = 2.0 * (abs(first) ** 2 + (value.conjugate() * second).real)
        change = -slope / curvature if curvature < 0.0 else 0.0
        if abs(change) > 2.0 * line:  # the parabola has found no maximum near the line
            break
        frequency += change
        if abs(change) <= 1e-12 * frequency:
            break
    return float(frequency)
