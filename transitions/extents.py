"""How far a motion goes: peaks, when they are reached, and root mean squares, of displacements and of any sums of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from bvp.kernels.integral import integral_work
from transitions.kernels.extents import largest_of_motion

if TYPE_CHECKING:
    from bvp.damped import Motion

__all__ = ["Extents", "extents"]


@dataclass(frozen=True, eq=False)
class Extents:
    """Of each functional: its largest absolute value, the time at which it is first reached, its root mean square over the motion.

    Attributes
    ----------
    peaks, times, rms : (R,) ndarray
    """

    peaks: np.ndarray
    times: np.ndarray
    rms: np.ndarray


def extents(motion: Motion, rows: Any = None) -> Extents:
    """Extents of linear functionals of the displacements over a whole motion.

    Peaks are found between turning points that bounds of the motion locate, not between samples; squares are integrated exactly.

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
        Where the search for a turning point gives up.

    Examples
    --------
    >>> from bvp.damped import run
    >>> from bvp.system import vibro_impact_nes
    >>> found = extents(run(vibro_impact_nes(sigma=0.0), [0.0, 0.0], [0.0, 0.5], 3.0), [[0.0, 1.0]])
    >>> found.peaks.round(12), found.times.round(7)
    (array([0.5]), array([1.5707963]))
    """
    n = motion.system.degrees_of_freedom
    wanted = np.eye(n) if rows is None else np.atleast_2d(np.asarray(rows, dtype=float))
    if wanted.ndim != 2 or wanted.shape[1] != n:
        raise ValueError(f"rows have an entry for each of {n} coordinates; received shape {wanted.shape}")
    phases = motion.mover.table.stacked
    count, size = len(wanted), phases.matrix.shape[1]
    derivatives = [np.einsum("rn,fnk->frk", wanted, phases.leave[:, :n])]
    for _ in range(3):
        derivatives.append(np.einsum("frk,fkq->frq", derivatives[-1], phases.matrix))
    peaks, times, squares = np.zeros(count), np.zeros(count), np.zeros(count)
    settled = largest_of_motion(
        phases, motion.times, motion.numbers, motion.states, motion.duration, np.ascontiguousarray(derivatives), np.ones(count),
        np.empty(2 * size), np.empty(size), integral_work(size, count), np.empty(count), peaks, times, squares,
    )  # fmt: skip
    if not settled:
        raise RuntimeError("the search for the peaks of the motion gave up; ask for a shorter duration")
    # A mean of squares that is 0 but for rounding may come out below it.
    rms = np.sqrt(np.maximum(squares, 0.0) / motion.duration) if motion.duration > 0.0 else peaks.copy()
    return Extents(peaks, times, rms)
