"""Records for the tests: from formulas, and from runs."""

from __future__ import annotations

import numpy as np

from bvp.simulate import simulate
from transitions.record import SampledMotion, sampled
from transitions.sharing import sharing_of


def synthetic(times, signal, rate, energy=None, impacts=()):
    """A record of two coordinates whose difference is `signal`; the sink has all the energy."""
    still = np.zeros(len(times))
    energy = np.ones(len(times)) if energy is None else energy
    u, v = (np.stack([values, still], axis=1) for values in (signal, rate))
    lost = energy[0] - energy
    return SampledMotion(times, u, v, energy, energy, still, 0.75 * lost, 0.25 * lost, impacts)


def of_run(system, u, v, duration, step=0.02):
    """A record of a run."""
    shared = sharing_of(system, (system.absorber,), (system.primary,))
    motion = simulate(system, u, v, duration, dampers=shared.dampers)
    assert motion.duration == duration
    return sampled(motion, shared, round(duration / step) + 1)
