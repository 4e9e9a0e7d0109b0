"""A motion as columns over uniform times: displacements, velocities, energies and what was dissipated, with the times of the impacts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bvp.motion import Motion

__all__ = ["Record", "record_of"]

_UNIFORM = 1e-6  # of a step: differences of times that rounding of long records makes are far below


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
        Total; that of the sink (its kinetic energy and the coupling spring); that of the rest.
    dissipated_nes, dissipated_lo : (m,) array_like
        Dissipated since the first time: by stops and dampers on gap coordinates; by all other dampers.
    impacts : (k,) array_like
        Times of the impacts, in order.

    Raises
    ------
    ValueError
        For shapes that do not fit, values that are not finite, times that are not uniform, impacts out of order.

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
                values = np.array(getattr(self, item.name), dtype=float)
            except (TypeError, ValueError):
                raise ValueError(f"{item.name} of a record are numbers; received {getattr(self, item.name)!r}") from None
            if not np.isfinite(values).all():
                raise ValueError(f"{item.name} of a record are finite; number {int(np.argmax(~np.isfinite(values.ravel()))) + 1} is not")
            values.setflags(write=False)
            object.__setattr__(self, item.name, values)
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


def record_of(motion: Motion, step: float) -> Record:
    """A motion that has been run, sampled.

    Parameters
    ----------
    motion : bvp.motion.Motion
        With its dampers split as by default, those across the gaps and the rest.
    step : float
        Time between two samples; the last sample is the last one within the motion.

    Returns
    -------
    Record
        The sink's are the energy of the absorber, and what dampers across the gaps and stops have dissipated; the rest is the oscillator's.

    Raises
    ------
    ValueError
        For a step that is not above 0 or leaves fewer than two samples, a system without absorber, dampers that are named otherwise.

    Examples
    --------
    >>> from bvp.damped import run
    >>> from bvp.system import vibro_impact_nes
    >>> record = record_of(run(vibro_impact_nes(lam=0.01, rho=0.7), [0.0, 0.0], [0.0, 1.0], 40.0), 0.05)
    >>> balance = record.energy + record.dissipated_nes + record.dissipated_lo
    >>> len(record.times), len(record.impacts) > 5, bool(np.ptp(balance) < 1e-12)
    (801, True, True)
    """
    from bvp.motion import EventKind

    if not 0.0 < step <= motion.duration:
        raise ValueError(f"the step of a record lies above 0 and within the motion's duration {motion.duration:g}; received {step!r}")
    if "rest" not in motion.parts:
        raise ValueError(f"a record tells the dampers across the gaps from the rest; received dampers named {', '.join(motion.parts)}")
    times = np.minimum(step * np.arange(int(motion.duration / step * (1.0 + 1e-12)) + 1), motion.duration)
    u, v = motion.sample(times)
    nes, lo = motion.shares(times)
    spent = motion.spent(times)
    rest = motion.parts.index("rest")
    others = [i for i in range(len(motion.parts)) if i != rest]
    impacts = motion.times[motion.kinds == EventKind.IMPACT.value]
    return Record(times, u, v, nes + lo, nes, lo, spent[:, others].sum(axis=1), spent[:, rest], impacts)
