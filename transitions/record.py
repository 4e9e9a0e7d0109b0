"""A motion as columns over uniform times: displacements, velocities, energies, dissipated energies, and the times of the impacts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

from bvp.checks import reals
from bvp.frozen import read_only
from bvp.shown import shown

if TYPE_CHECKING:
    from bvp.motion import Motion
    from transitions.sharing import Sharing

__all__ = ["PER_PERIOD", "Record", "sampled", "samples_of"]

PER_PERIOD = 256
"""Samples in the shortest period of free vibration. Impacts excite harmonics far above its frequency."""

_UNIFORM = 1e-6  # largest difference from a uniform time, in steps; the rounding of long records is far smaller
_REST = 1e-13  # of the largest displacement and velocity; smaller values at the start are rounding


@dataclass(frozen=True, eq=False)
class Record:
    """A motion sampled at m uniform times, in natural units (time 1/sqrt(k/M), lengths in clearances).

    Parameters
    ----------
    times : (m,) array_like
        Uniform and rising, m >= 2.
    displacements, velocities : (m, n) array_like
        At an impact the velocities are those after it.
    energy, nes_energy, lo_energy : (m,) array_like
        Total; of the sink (its kinetic energy and the coupling spring); of the rest.
    dissipated_nes, dissipated_lo : (m,) array_like
        Dissipated since the first time by stops and dampers on gap coordinates, and by all other dampers.
    impacts : (k,) array_like
        Times of the impacts, in order.

    Raises
    ------
    ValueError
        For wrong shapes, values that are not finite, times that are not uniform, or impacts out of order.

    Examples
    --------
    >>> times = np.linspace(0.0, 10.0, 101)
    >>> u = np.stack([np.cos(times), 0.1 * np.cos(times)], axis=1)
    >>> still = np.zeros(101)
    >>> record = Record(times, u, np.gradient(u, times, axis=0), still + 1.0, still, still, still, still, [])
    >>> record.step, float(record.along((1.0, -1.0))[0][0])
    (0.1, 0.9)
    """

    times: np.ndarray
    displacements: np.ndarray
    velocities: np.ndarray
    energy: np.ndarray
    nes_energy: np.ndarray
    lo_energy: np.ndarray
    dissipated_nes: np.ndarray
    dissipated_lo: np.ndarray
    impacts: np.ndarray

    def __post_init__(self) -> None:
        for item in fields(self):
            try:
                values = reals(getattr(self, item.name))
            except (TypeError, ValueError):
                raise ValueError(f"{item.name} of a record are numbers; received {shown(getattr(self, item.name))}") from None
            if not np.isfinite(values).all():
                raise ValueError(f"{item.name} of a record are finite; number {int(np.argmax(~np.isfinite(values.ravel()))) + 1} is not")
            object.__setattr__(self, item.name, read_only(values))
        times = self.times
        if times.ndim != 1 or len(times) < 2:
            raise ValueError(f"times of a record are a list of two or more; received shape {times.shape}")
        count = len(times)
        if self.displacements.ndim != 2 or len(self.displacements) != count or self.displacements.shape[1] < 1:
            raise ValueError(f"displacements of a record have shape ({count}, n); received {self.displacements.shape}")
        if self.velocities.shape != self.displacements.shape:
            raise ValueError(f"velocities of a record have shape {self.displacements.shape}; received {self.velocities.shape}")
        for name in ("energy", "nes_energy", "lo_energy", "dissipated_nes", "dissipated_lo"):
            if getattr(self, name).shape != (count,):
                raise ValueError(f"{name} of a record has shape ({count},); received {getattr(self, name).shape}")
        if self.impacts.ndim != 1 or np.any(np.diff(self.impacts) < 0.0):
            raise ValueError("impacts of a record are times in order")
        step = (times[-1] - times[0]) / (count - 1)
        if not step > 0.0:
            raise ValueError(f"times of a record rise; received {times[0]:g} to {times[-1]:g}")
        away = np.abs(times - (times[0] + step * np.arange(count)))
        if away.max() > _UNIFORM * step:
            raise ValueError(
                f"times of a record are uniform; received {times[int(np.argmax(away))]:.10g} "
                f"where steps of {step:g} expect {times[0] + step * int(np.argmax(away)):.10g}"
            )

    @property
    def step(self) -> float:
        """Time between two samples."""
        return float((self.times[-1] - self.times[0]) / (len(self.times) - 1))

    @property
    def duration(self) -> float:
        """From the first time to the last."""
        return float(self.times[-1] - self.times[0])

    @property
    def from_rest(self) -> bool:
        """Whether the first state has no energy, or is 0 within rounding of the largest displacement and velocity."""
        states = np.abs(self.displacements), np.abs(self.velocities)
        return not self.energy[0] > 0.0 or all(values[0].max() <= _REST * values.max() for values in states)

    @property
    def degrees_of_freedom(self) -> int:
        """n."""
        return self.displacements.shape[1]

    def along(self, gap: Sequence[float] | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A gap coordinate w = gap . u and its rate.

        Parameters
        ----------
        gap : (n,) float
            (1, -1) for u1 - u2.

        Returns
        -------
        w, rate : (m,) float

        Raises
        ------
        ValueError
            For another number of entries.
        """
        row = np.asarray(gap, dtype=float)
        if row.shape != (self.degrees_of_freedom,):
            raise ValueError(f"the gap coordinate has {row.size} entries; the record has {self.degrees_of_freedom} coordinates")
        return self.displacements @ row, self.velocities @ row


def samples_of(motion: Motion, span: float) -> int:
    """Default number of samples in the record of the first `span` of a motion."""
    fastest = float(motion.system.underlying.modes.frequencies.max())
    return 2 + int(PER_PERIOD * (1.0 + span * fastest / (2.0 * math.pi)))


def sampled(motion: Motion, sharing: Sharing, samples: int | None = None, span: float | None = None) -> Record:
    """The record of a motion at uniform times, in the units of its system.

    Parameters
    ----------
    motion : Motion
        With a duration above 0, and the dampers of `sharing`.
    sharing : Sharing
        If the energy has no shares, all of it counts as that of the rest.
    samples : int, optional
        By default `samples_of`, 256 in the shortest period of free vibration without damping.
    span : float, optional
        End of the record; by default the end of the motion.

    Raises
    ------
    ValueError
        For a motion without duration.

    Examples
    --------
    >>> from bvp.damped import simulate
    >>> from bvp.system import vibro_impact_nes
    >>> from transitions.sharing import sharing_of
    >>> system = vibro_impact_nes(lam=0.01, rho=0.7)
    >>> shared = sharing_of(system, (0,), (1,))
    >>> record = sampled(simulate(system, [0, 0], [0, 2], 20.0, dampers=shared.dampers), shared)
    >>> bool(abs(record.energy[-1] + record.dissipated_nes[-1] + record.dissipated_lo[-1] - 2.0) < 1e-12)
    True
    """
    from bvp.motion import EventKind

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
