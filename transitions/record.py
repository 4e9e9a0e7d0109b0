"""A motion as columns over uniform times, and the extents of a motion: peaks, their times and root mean squares."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from bvp.checks import read_only, reals, require_motion
from bvp.dense import product
from bvp.interrupts import Pace
from bvp.kernels.energy_budget import integral_work
from bvp.kernels.extrema import PEAK_ROWS
from bvp.kernels.impact import work_array
from bvp.motion import Motion
from bvp.system import ImpactSystem
from bvp.texts import brief, shown
from transitions.kernels import ExtentsScratch, extents_of_motion
from transitions.sharing import Sharing

__all__ = ["PER_PERIOD", "Extents", "SampledMotion", "drift_rows", "extents", "require", "sampled", "samples_of"]

PER_PERIOD = 256
"""Samples in the shortest period of free vibration. Impacts excite harmonics far above its frequency."""

_UNIFORM = 1e-6  # largest difference from a uniform time, in steps; the rounding of long records is far smaller
_ENERGIES = ("energy", "nes_energy", "lo_energy", "dissipated_nes", "dissipated_lo")
_REST = 1e-13  # of the largest displacement and velocity; smaller values at the start are rounding


def require(value: Any, kind: type, what: str, example: str) -> None:
    """Raise a TypeError for a value of another type; the message has an example of an expression that makes the right one."""
    if not isinstance(value, kind):
        raise TypeError(f"{what}: received {shown(value)}, expected a {kind.__name__} such as {example}")


@brief
@dataclass(frozen=True, eq=False)
class SampledMotion:
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
    >>> record = SampledMotion(times, u, np.gradient(u, times, axis=0), still + 1.0, still, still, still, still, [])
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
        times, wide = self.times, self.displacements.shape
        if times.ndim != 1 or len(times) < 2:
            raise ValueError(f"times of a record are a list of two or more; received shape {times.shape}")
        if len(wide) != 2 or wide[0] != len(times) or wide[1] < 1:
            raise ValueError(f"displacements of a record have shape ({len(times)}, n); received {wide}")
        for name in ("velocities", *_ENERGIES):
            shape, expected = getattr(self, name).shape, wide if name == "velocities" else times.shape
            if shape != expected:
                raise ValueError(f"{name} of a record have shape {expected}; received {shape}")
        if self.impacts.ndim != 1 or np.any(np.diff(self.impacts) < 0.0):
            raise ValueError("impacts of a record are times in order")
        step = (times[-1] - times[0]) / (len(times) - 1)
        away = np.abs(times - np.linspace(times[0], times[-1], len(times)))
        if not (step > 0.0 and away.max() <= _UNIFORM * step):
            worst = int(np.argmax(away))
            raise ValueError(f"times of a record rise in equal steps; received {times[worst]:.10g} as number {worst + 1}")

    @property
    def step(self) -> float:
        """Time between two samples."""
        return float((self.times[-1] - self.times[0]) / (len(self.times) - 1))

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
        return product(self.displacements, row), product(self.velocities, row)


def samples_of(motion: Motion, span: float) -> int:
    """Default number of samples in the record of the first `span` of a motion."""
    fastest = float(motion.system.underlying.modes.frequencies.max())
    return 2 + int(PER_PERIOD * (1.0 + span * fastest / (2.0 * math.pi)))


def sampled(motion: Motion, sharing: Sharing, samples: int | None = None, span: float | None = None) -> SampledMotion:
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
    TypeError
        For a motion or a sharing that is none.
    ValueError
        For a motion without duration.

    Examples
    --------
    >>> from bvp.simulate import simulate
    >>> from bvp.system import vibro_impact_nes
    >>> from transitions.sharing import sharing_of
    >>> system = vibro_impact_nes(lam=0.01, rho=0.7)
    >>> shared = sharing_of(system, (0,), (1,))
    >>> record = sampled(simulate(system, [0, 0], [0, 2], 20.0, dampers=shared.dampers), shared)
    >>> bool(abs(record.energy[-1] + record.dissipated_nes[-1] + record.dissipated_lo[-1] - 2.0) < 1e-12)
    True
    """
    from bvp.motion import EventKind
    from transitions.sharing import Sharing

    require_motion(motion)
    require(sharing, Sharing, "the sharing", "saltus.sharing_of(system)")
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
    return SampledMotion(times, u, v, energy, nes, lo, by_nes, by_lo, impacts[impacts <= span])


@brief
@dataclass(frozen=True, eq=False)
class Extents:
    """The largest absolute value of each functional, its time, and the functional's root mean square over the motion.

    Attributes
    ----------
    peaks, times, rms : (R,) ndarray
        The time of a flat peak has half the digits of the peak. Of equal peaks the first one counts.
    """

    peaks: np.ndarray
    times: np.ndarray
    rms: np.ndarray


def extents(motion: Motion, rows: Any = None, on_progress: Callable[[float], object] | None = None) -> Extents:
    """Extents of linear functionals of the displacements over a full motion.

    Peaks are turning points, which bounds of the motion locate, as in `Motion.peaks`. Squares are integrated exactly.

    Parameters
    ----------
    motion : Motion
    rows : (R, n) array_like, optional
        row . u for each row; the displacements themselves by default.
    on_progress : callable, optional
        Called with the part of the motion that is searched, 0 to 1.

    Raises
    ------
    ValueError
        For rows of another length.
    RuntimeError
        If the search for a peak gives up.

    Examples
    --------
    >>> from bvp.simulate import simulate
    >>> from bvp.system import vibro_impact_nes
    >>> found = extents(simulate(vibro_impact_nes(sigma=0.0), [0.0, 0.0], [0.0, 0.5], 3.0), [[0.0, 1.0]])
    >>> found.peaks.round(12), found.times.round(7)
    (array([0.5]), array([1.5707963]))
    """
    require_motion(motion)
    n = motion.system.degrees_of_freedom
    wanted = np.eye(n) if rows is None else np.atleast_2d(np.asarray(rows, dtype=float))
    if wanted.ndim != 2 or wanted.shape[1] != n:
        raise ValueError(f"rows have an entry for each of {n} coordinates; received shape {wanted.shape}")
    modes = motion.contact_modes
    count, size = len(wanted), modes.matrix.shape[1]
    rows = np.concatenate([np.einsum("rn,fnk->frk", wanted, part) for part in (modes.leave[:, :n], modes.leave[:, n:])], axis=1)
    scratch = np.zeros((PEAK_ROWS, 1, size)), np.zeros((2, 1)), work_array(size, 1)
    peaks, squares, times = np.zeros(count), np.zeros(count), np.zeros(count)
    work = ExtentsScratch(*scratch, integral_work(size, count), np.empty(count), np.empty(count))
    for part in Pace().blocks(len(motion.times)):
        if not extents_of_motion(modes, motion.flights(part), rows, np.ones(count), work, peaks, times, squares):
            raise RuntimeError("the search for the peaks gave up; run a shorter duration")
        if on_progress is not None:
            on_progress(part.stop / len(motion.times))
    # Rounding can make a mean square of 0 negative.
    rms = np.sqrt(np.maximum(squares, 0.0) / motion.duration) if motion.duration > 0.0 else peaks.copy()
    return Extents(peaks, times, rms)


def drift_rows(system: ImpactSystem, nes: tuple[int, ...] = ()) -> dict[str, np.ndarray]:
    """Rows (n,) of the drifts, by name: u_j - u_i for each spring between two coordinates outside the NES.

    A drift is the change of length of a spring, linear or not. Between a coordinate and the ground it is the displacement.

    Examples
    --------
    >>> from bvp.system import ImpactSystem, Stop
    >>> chain = ImpactSystem([[1.0, 0], [0, 1]], [[0, 0], [0, 0]], [[2.0, -1], [-1, 1]], [Stop((1.0, 0), upper=1.0)], ("first", "second"))
    >>> drift_rows(chain)
    {'second - first': array([-1.,  1.])}
    """
    names, unit = system.coordinates, np.eye(system.degrees_of_freedom)
    joined = system.stiffness != 0.0
    for spring in system.springs:
        joined[np.ix_(*2 * [np.flatnonzero(spring.row)])] = True
    springs = [(i, j) for j in range(len(unit)) for i in range(j) if joined[i, j] and i not in nes and j not in nes]
    return {f"{names[j]} - {names[i]}": unit[j] - unit[i] for i, j in springs}
