"""A damped motion as the record whose spectrum and stages are told."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bvp.motion import EventKind
from transitions.record import Record

if TYPE_CHECKING:
    from bvp.motion import Motion
    from transitions.sharing import Sharing

__all__ = ["PER_PERIOD", "sampled", "samples_of"]

PER_PERIOD = 256
"""Samples in the shortest period of free vibration: impacts bring harmonics far above it."""


def samples_of(motion: Motion, span: float) -> int:
    """How many samples the record of the first `span` of a motion has by default."""
    fastest = float(motion.system.underlying.modes.frequencies.max())
    return 2 + int(PER_PERIOD * (1.0 + span * fastest / (2.0 * math.pi)))


def sampled(motion: Motion, sharing: Sharing, samples: int | None = None, span: float | None = None) -> Record:
    """The record of a motion at uniform times, in the units of its system.

    Parameters
    ----------
    motion : Motion
        Of a duration above 0, run with the dampers of `sharing`.
    sharing : Sharing
        Where it has no shares of the energy, all of it is that of the rest.
    samples : int, optional
        By default `samples_of`, 256 in the shortest period of free vibration without damping.
    span : float, optional
        The record ends there; by default with the motion.

    Raises
    ------
    ValueError
        For a motion without duration.

    Examples
    --------
    >>> from bvp.run import run
    >>> from bvp.system import vibro_impact_nes
    >>> from transitions.sharing import sharing_of
    >>> system = vibro_impact_nes(lam=0.01, rho=0.7)
    >>> shared = sharing_of(system, (0,), (1,))
    >>> record = sampled(run(system, [0, 0], [0, 2], 20.0, dampers=shared.dampers), shared)
    >>> bool(abs(record.energy[-1] + record.dissipated_nes[-1] + record.dissipated_lo[-1] - 2.0) < 1e-12)
    True
    """
    if not motion.duration > 0.0:
        raise ValueError("a motion without duration has no record; run it for a time above 0")
    span = motion.duration if span is None else span
    times = np.linspace(0.0, span, samples_of(motion, span) if samples is None else samples)
    energy, nes, lo = sharing.energies(motion, times)
    if sharing.mass is None:
        nes, lo = np.zeros_like(energy), energy
    by_nes, by_lo, _ = sharing.dissipated(motion, times)
    u, v = motion.sample(times)
    impacts = motion.times[motion.kinds == EventKind.IMPACT.value]
    return Record(times, u, v, energy, nes, lo, by_nes, by_lo, impacts[impacts <= span])
