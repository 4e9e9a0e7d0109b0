"""The extents of a motion: peaks, their times and root mean squares of displacements, and of linear functionals such as drifts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from bvp.interrupts import Pace
from bvp.kernels.extrema import PEAK_ROWS, peak_flight
from bvp.kernels.flight import Flight
from bvp.kernels.impact import work_array
from bvp.kernels.integral import integral_work
from transitions.kernels.extents import extents_of_motion

if TYPE_CHECKING:
    from bvp.motion import Motion
    from bvp.system import ImpactSystem

__all__ = ["Extents", "drift_rows", "extents"]


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


def extents(motion: Motion, rows: Any = None) -> Extents:
    """Extents of linear functionals of the displacements over a whole motion.

    Peaks are turning points, which bounds of the motion locate, as in `Motion.peaks`. Squares are integrated exactly.

    Parameters
    ----------
    motion : Motion
    rows : (R, n) array_like, optional
        row . u for each row; the displacements themselves by default.

    Raises
    ------
    ValueError
        For rows of another length.
    RuntimeError
        If the search for a peak gives up.

    Examples
    --------
    >>> from bvp.damped import simulate
    >>> from bvp.system import vibro_impact_nes
    >>> found = extents(simulate(vibro_impact_nes(sigma=0.0), [0.0, 0.0], [0.0, 0.5], 3.0), [[0.0, 1.0]])
    >>> found.peaks.round(12), found.times.round(7)
    (array([0.5]), array([1.5707963]))
    """
    n = motion.system.degrees_of_freedom
    wanted = np.eye(n) if rows is None else np.atleast_2d(np.asarray(rows, dtype=float))
    if wanted.ndim != 2 or wanted.shape[1] != n:
        raise ValueError(f"rows have an entry for each of {n} coordinates; received shape {wanted.shape}")
    phases = motion.contact_modes
    count, size = len(wanted), phases.matrix.shape[1]
    rows = np.concatenate([np.einsum("rn,fnk->frk", wanted, part) for part in (phases.leave[:, :n], phases.leave[:, n:])], axis=1)
    scratch = np.zeros((PEAK_ROWS, 1, size)), np.zeros((2, 1)), work_array(size, 1)
    peaks, squares, where = np.zeros(count), np.zeros(count), np.zeros(count, dtype=np.int64)
    work = np.ones(count), *scratch, integral_work(size, count), np.empty(count), np.empty(count)
    for part in Pace().blocks(len(motion.times)):
        higher, at = peaks.copy(), np.zeros(count, dtype=np.int64)
        if not extents_of_motion(phases, *motion.flights(part), rows, *work, higher, at, squares):
            raise RuntimeError("the search for the peaks gave up; run a shorter duration")
        where = np.where(higher > peaks, part.start + at, where)
        peaks = higher

    def reached(c: int, duration: float) -> bool:
        """Whether a peak is reached within this part of its flight."""
        k, f, best = where[c], motion.numbers[where[c], 2], np.zeros(1)
        own = np.ascontiguousarray(rows[f, [c, count + c]])
        flight = Flight(phases.pairs[f], phases.mean[f], phases.delta[f], phases.matrix[f])
        peak_flight(flight, own, motion.states[k], duration, best, *scratch)
        return bool(best[0] >= peaks[c] * (1.0 - 1e-15))

    times = np.zeros(count)
    for c in range(count):
        k = where[c]
        low, high = 0.0, float(motion.times[k + 1] if k + 1 < len(motion.times) else motion.duration) - float(motion.times[k])
        if reached(c, 0.0):
            high = 0.0
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if reached(c, middle) else (middle, high)
        times[c] = motion.times[k] + high
    # Rounding can make a mean square of 0 negative.
    rms = np.sqrt(np.maximum(squares, 0.0) / motion.duration) if motion.duration > 0.0 else peaks.copy()
    return Extents(peaks, times, rms)


def drift_rows(system: ImpactSystem, nes: tuple[int, ...] = ()) -> dict[str, np.ndarray]:
    """Rows (n,) of the drifts, by name: u_j - u_i for each spring between two coordinates outside the NES.

    A drift is the change of length of a spring. Between a coordinate and the ground it is the displacement.

    Examples
    --------
    >>> from bvp.system import ImpactSystem, Stop
    >>> chain = ImpactSystem([[1.0, 0], [0, 1]], [[0, 0], [0, 0]], [[2.0, -1], [-1, 1]], [Stop((1.0, 0), upper=1.0)], ("first", "second"))
    >>> drift_rows(chain)
    {'second - first': array([-1.,  1.])}
    """
    n, names = system.degrees_of_freedom, system.coordinates
    rows = {}
    for j in range(n):
        for i in range(j):
            if system.stiffness[i, j] and i not in nes and j not in nes:
                row = np.zeros(n)
                row[i], row[j] = -1.0, 1.0
                rows[f"{names[j]} - {names[i]}"] = row
    return rows
