"""Impulsive motions: at the start nothing is displaced, and only the oscillator (the primary mass) moves.

At one energy the impulsive motion is one trajectory. `impulsive_manifold` gives the curve of all impulsive motions, periodic and
quasiperiodic: the dominant frequency of the relative motion against energy.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.fft import next_fast_len, rfft

from branches.tables import plain_columns
from bvp.checks import checked_energy_range, require_system
from bvp.motion import MotionStatus
from bvp.simulate import simulate
from bvp.system import ImpactSystem
from bvp.texts import brief, shown

__all__ = [
    "Manifold", "PERIODS", "WINDOW", "check_system", "dominant_frequency", "impulsive_manifold", "impulsive_state", "oscillator_period",
]  # fmt: skip


def check_system(system: ImpactSystem) -> tuple[int, int]:
    """Indices of the absorber and the primary. Raises ValueError for a system that does not name them, or that loses energy."""
    require_system(system)
    if system.absorber is None or system.primary is None:
        raise ValueError(
            "an impulsive orbit starts with the velocity of the primary alone, and this system names no absorber and primary "
            "(in a scene NES and LO under [coordinates])"
        )
    require_system(system, conservative="impulsive orbits at an energy")
    return system.absorber, system.primary


def impulsive_state(system: ImpactSystem, energy: float) -> tuple[np.ndarray, np.ndarray]:
    """Displacements and velocities (n,) with all of the energy in the velocity of the primary, which is positive.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> impulsive_state(vibro_impact_nes(), 2.0)
    (array([0., 0.]), array([0., 2.]))
    """
    _, primary = check_system(system)
    velocity = np.zeros(system.degrees_of_freedom)
    velocity[primary] = math.sqrt(2.0 * energy / system.mass[primary, primary])
    return np.zeros(system.degrees_of_freedom), velocity


def oscillator_period(system: ImpactSystem) -> float:
    """Period of the primary alone on its spring to the ground, the row sum of the stiffness.

    Without such a spring it is the period of the slowest mode that vibrates.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> oscillator_period(vibro_impact_nes(mu=0.1, sigma=0.1)) / (2.0 * math.pi)
    1.0
    """
    _, primary = check_system(system)
    ground = float(np.sum(system.stiffness[primary]))
    if ground > 1e-12 * float(np.max(np.abs(system.stiffness[primary]))):
        return 2.0 * math.pi * math.sqrt(float(system.mass[primary, primary]) / ground)
    frequencies = system.modes.frequencies
    return 2.0 * math.pi / float(np.min(frequencies[frequencies > 0.0]))


PERIODS = 200
"""Periods of the oscillator that each motion is followed for."""

DENSITY = 100
"""Energies in a decade."""

SAMPLES = 16
"""Samples in the shortest of: the shortest linear period, and the mean time between two impacts on the same side."""

_MOST_IMPACTS = 1 << 23


@brief
@dataclass(frozen=True, eq=False)
class Manifold:
    """Dominant frequency of the impulsive motions against energy.

    h, frequency : (N,) energies, ascending, and angular frequencies; NaN if the motion could not be followed. breaks : (N - 1,) bool,
    True if the curve jumps between two energies and is not drawn there. rate : (N,) samples in a period of the oscillator. failed :
    energy and reason of each motion that could not be followed.
    """

    h: np.ndarray
    frequency: np.ndarray
    breaks: np.ndarray
    rate: np.ndarray
    periods: int
    window: str
    failed: tuple[tuple[float, str], ...] = ()

    @property
    def sampling(self) -> str:
        """The range of sampling rates, as text."""
        if not np.isfinite(self.rate).any():
            return "no motion was followed"
        return f"{np.nanmin(self.rate):.0f} to {np.nanmax(self.rate):.0f} samples a period"

    def record(self) -> dict[str, Any]:
        """As plain data: null for a missing frequency; `breaks` lists the indices after which the curve jumps."""
        return {
            **plain_columns({"h": self.h, "frequency": self.frequency}),
            "breaks": np.flatnonzero(self.breaks).tolist(),
            **plain_columns({"samples_per_period": self.rate}),
            "window": self.window,
            "periods": self.periods,
            "failed": [{"h": h, "reason": reason} for h, reason in self.failed],
        }


def impulsive_manifold(
    system: ImpactSystem,
    energy: tuple[float, float],
    *,
    density: int = DENSITY,
    periods: int = PERIODS,
    on_energy: Callable[[int], object] | None = None,
) -> Manifold:
    """Follow the impulsive start at many energies, and take the largest peak of the spectrum of the gap coordinate.

    Parameters
    ----------
    system : ImpactSystem
        Undamped and elastic, absorber and primary named.
    energy : (float, float)
    density : int
        Energies in a decade, spaced evenly in the logarithm.
    periods : int
        Periods of the oscillator that each motion is followed for.
    on_energy : callable, optional
        Called with the number of energies done.

    Returns
    -------
    Manifold
        A jump is a change by more than a power law of exponent one allows, and by more than one line of the spectrum.

    Raises
    ------
    ValueError
        For another system, an empty or reversed range, and a density or number of periods below 1.
    """
    check_system(system)
    for name, value in (("density", density), ("periods", periods)):
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1:
            raise ValueError(f"{name} = {shown(value)}: expected an integer, at least 1")
    low, high = checked_energy_range(energy, positive=True)
    levels = np.geomspace(low, high, max(2, math.ceil(density * math.log10(high / low)) + 1))
    frequency, rate = np.full(len(levels), np.nan), np.full(len(levels), np.nan)
    failed = []
    for i, h in enumerate(levels):
        try:
            frequency[i], rate[i] = peak_at(system, float(h), periods)
        except RuntimeError as error:
            failed.append((float(h), str(error)))
        if on_energy is not None:
            on_energy(i + 1)
    line = 2.0 * math.pi / (periods * oscillator_period(system))
    steepest = np.maximum(frequency[:-1], frequency[1:]) * np.diff(np.log(levels))
    breaks = ~(np.abs(np.diff(frequency)) <= steepest + line)
    return Manifold(levels, frequency, breaks, rate, periods, WINDOW, tuple(failed))


def peak_at(system: ImpactSystem, energy: float, periods: int = PERIODS) -> tuple[float, float]:
    """Dominant angular frequency of the gap coordinate of the first stop after an impulsive start, and the samples taken in a period of
    the oscillator. RuntimeError where the motion cannot be followed."""
    period = oscillator_period(system)
    duration = periods * period
    u, v = impulsive_state(system, energy)
    gap = np.asarray(system.stops[0].gap)
    motion = simulate(system, u, v, duration, max_impacts=_MOST_IMPACTS)
    if motion.status is not MotionStatus.DURATION_REACHED:
        raise RuntimeError(f"the motion ends at {motion.duration:.6g} of {duration:.6g}: {motion.status.value}")
    fastest = period * float(np.nanmax(system.modes.frequencies)) / (2.0 * math.pi)
    rate = SAMPLES * max(fastest, 1.0, 0.5 * len(motion.stop_events) / periods)
    count = math.ceil(rate * periods)
    step = duration / count
    displacement, _ = motion.sample((np.arange(count) + 0.5) * step)
    return dominant_frequency(displacement @ gap, step), count / periods


WINDOW = "Hann"
"""w(t) = sin^2(pi t/T): its side lobes fall as the third power of the distance, so two modes hardly move each other's peak."""

_PADDING = 2
_STEPS = 8


def dominant_frequency(signal: np.ndarray, step: float) -> float:
    """Angular frequency of the largest peak of the spectrum of a signal under the Hann window.

    The mean under the window is taken off. The largest line of the padded discrete transform and its neighbours give a first place, by
    the parabola through the logarithms of their amplitudes; from there Newton's method goes to the maximum of the transform itself,
    which is defined at all frequencies. A single tone in the signal is returned to a relative 1e-6 and better. What has fewer than two
    periods in the signal cannot be distinguished from a drift of its mean, and is left out.

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
