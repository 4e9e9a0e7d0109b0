"""Synthetic accelerograms: white noise through two filters of the ground, under an envelope.

A layer of ground with frequency w_g and damping z_g shakes as a(t) = -(2 z_g w_g x' + w_g^2 x), x'' + 2 z_g w_g x' + w_g^2 x = -n(t), for
white noise n in the rock below (Kanai 1957, Tajimi 1960). A second filter, y'' + 2 z_f w_f y' + w_f^2 y = a, gives y''. It removes
frequencies far below w_f, so that the velocity does not drift (Clough & Penzien, Dynamics of Structures, 1975). The envelope rises as the
square of time, stays constant, and decays exponentially (Jennings, Housner & Tsai, 1968). The noise is constant over each step. For such
noise the filters are exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bvp.texts import brief, shown

__all__ = ["Ground", "filtered", "record_text", "synthetic_record"]


@brief
@dataclass(frozen=True)
class Ground:
    """The ground of a synthetic record: frequencies (rad/s) and damping ratios of two filters. The defaults are those of firm soil."""

    frequency: float = 15.0
    damping: float = 0.6
    low_frequency: float = 1.5
    low_damping: float = 0.6

    def __post_init__(self) -> None:
        _require_positive("the ground", **vars(self))


def _require_positive(what: str, **values: float) -> None:
    for name, value in values.items():
        if not 0.0 < value < np.inf:
            raise ValueError(f"{name} of {what} is a finite number above 0; received {shown(value)}")


def filtered(noise: np.ndarray, step: float, ground: Ground) -> np.ndarray:
    """The acceleration (m,) at the times 0, step, ... of ground at rest at time 0, for noise (m,) that is constant over each step."""
    from scipy.signal import lsim

    w, z, v, y = ground.frequency, ground.damping, ground.low_frequency, ground.low_damping
    # states x, x', y, y'
    matrix = np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [-w * w, -2.0 * z * w, 0.0, 0.0],
            [0.0, 0.0, 0.0, 1.0],
            [-w * w, -2.0 * z * w, -v * v, -2.0 * y * v],
        ]
    )
    inputs = np.array([[0.0], [-1.0], [0.0], [0.0]])
    return lsim((matrix, inputs, matrix[3:], np.zeros((1, 1))), noise, step * np.arange(len(noise)), interp=False)[1]


def synthetic_record(
    seed: int,
    *,
    duration: float = 20.0,
    step: float = 0.02,
    peak: float = 3.0,
    ground: Ground | None = None,
    rise: float = 2.0,
    decay_from: float = 8.0,
    decay: float = 3.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Times and accelerations of a synthetic record.

    Parameters
    ----------
    seed : int
        Seed of the noise. The same seed gives the same record.
    duration, step : float
        The record has a sample at 0, step, ..., duration.
    peak : float
        Largest acceleration.
    ground : Ground, optional
    rise, decay_from, decay : float
        The envelope is (t/rise)^2 up to `rise`, 1 up to `decay_from`, then exp(-(t - decay_from)/decay).

    Returns
    -------
    times, accelerations : (m,) ndarray

    Raises
    ------
    ValueError
        For values that are not finite and above 0, or a record of fewer than two samples.

    Examples
    --------
    >>> times, accelerations = synthetic_record(1)
    >>> len(times), float(times[-1]), float(abs(accelerations).max())
    (1001, 20.0, 3.0)
    """
    _require_positive("a record", duration=duration, step=step, peak=peak, rise=rise, decay_from=decay_from, decay=decay)
    count = round(duration / step)
    if count < 1:
        raise ValueError(f"a record of {duration:g} in steps of {step:g} has one sample; expected two at least")
    times = np.linspace(0.0, duration, count + 1)
    # RandomState: its streams stay the same in all versions of numpy.
    noise = np.random.RandomState(seed).standard_normal(count + 1)
    envelope = np.where(times < rise, (times / rise) ** 2, np.exp(-np.maximum(times - decay_from, 0.0) / decay))
    shaped = filtered(noise * envelope, step, ground or Ground())
    return times, shaped * (peak / np.abs(shaped).max())


def record_text(times: np.ndarray, accelerations: np.ndarray, remark: str = "") -> str:
    """A record as CSV: columns time and acceleration, to a millionth of the unit.

    Parameters
    ----------
    times, accelerations : (j,) array_like
    remark : str, optional
        A first line, after #.

    Examples
    --------
    >>> print(record_text(np.array([0.0, 0.02]), np.array([0.0, -1.5]), "by hand"), end="")
    # by hand
    time,acceleration
    0,0.000000
    0.02,-1.500000
    """
    rows = [f"{time:.10g},{value + 0.0:.6f}" for time, value in zip(times, accelerations, strict=True)]
    return "\n".join([*([f"# {remark}"] if remark else []), "time,acceleration", *rows]) + "\n"
