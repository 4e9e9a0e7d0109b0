"""Records for the tests: from formulas, and from conservative runs."""

from __future__ import annotations

import numpy as np

from bvp.run import run
from transitions.record import Record


def synthetic(times, signal, rate, energy=None, impacts=()):
    """A record of two coordinates whose difference is `signal`; the sink has all the energy."""
    still = np.zeros(len(times))
    energy = np.ones(len(times)) if energy is None else energy
    u, v = (np.stack([values, still], axis=1) for values in (signal, rate))
    lost = energy[0] - energy
    return Record(times, u, v, energy, energy, still, 0.75 * lost, 0.25 * lost, impacts)


def of_run(system, u, v, duration, step=0.02):
    """A record of a run of a system of absorber and primary; what dampers take is integrated by trapezoids, as the pictures and stages need
    no more."""
    result = run(system, u, v, duration)
    assert result.duration == duration
    times = step * np.arange(int(round(duration / step)) + 1)
    places, speeds = result.sample(np.minimum(times, duration))
    total = system.energy(places, speeds)
    a, b = system.absorber, system.primary
    gap = places[:, a] - places[:, b]
    nes = 0.5 * (system.mass[a, a] * speeds[:, a] ** 2 - system.stiffness[a, b] * gap**2)
    n = system.degrees_of_freedom
    before, after = (system.energy(states[:, :n], states[:, n:]) for states in (result.before, result.after))
    losses = np.concatenate([[0.0], np.cumsum(before - after)])
    power = np.einsum("mi,ij,mj->m", speeds, system.damping, speeds)
    damped = np.concatenate([[0.0], np.cumsum(0.5 * step * (power[1:] + power[:-1]))])
    stopped = losses[np.searchsorted(result.times, times, side="right")]
    return Record(times, places, speeds, total, nes, total - nes, stopped, damped, result.times[~result.touches])
