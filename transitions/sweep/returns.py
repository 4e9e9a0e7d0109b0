"""Stroboscopic returns: the mean growth of a tangent vector, and the period of a motion.

Displacements along which no spring and no stop acts, such as the angle of a gear train, do not count: a motion that drifts along them
returns if the rest of it does."""

from __future__ import annotations

import math

import numpy as np

from bvp.closures import free_motions
from bvp.system import ImpactSystem

__all__ = [
    "LOOSEST", "RETURN", "SLACK", "distance_scale", "drift_directions", "find_period", "largest_exponent", "mean_growth", "multipliers_of",
    "shortest_period", "weighted_mean", "without_drift",
]  # fmt: skip

RETURN = 1e-9
"""Distance of two states, relative to the largest state of the motion, that counts as a return in any case."""

SLACK = 10.0
"""Factor on the distance that convergence leaves. Two states on opposite sides of their limit are twice as far from each other."""

LOOSEST = 1e-4
"""The largest such distance. A motion that converges so slowly that its own rate leaves more has no period yet."""


def weighted_mean(values: np.ndarray) -> float:
    """The mean of values (k,) with the weight exp(-1/(t (1 - t))), equation (21) of docs/theory.md.

    Along a quasiperiodic motion it converges faster than any power of 1/k, where the plain mean converges as 1/k (Das, Saiki, Sander &
    Yorke, Nonlinearity 30 (2017) 4111)."""
    t = (np.arange(len(values)) + 0.5) / len(values)
    weights = np.exp(-1.0 / (t * (1.0 - t)))
    return float(weights @ values / weights.sum())


def mean_growth(growths: np.ndarray) -> float:
    """The `weighted_mean` of logarithmic growths (P,): -inf where one of them is -inf, NaN without growths.

    Examples
    --------
    >>> turning = np.cos(np.arange(200.0))
    >>> abs(mean_growth(np.diff(turning, prepend=0.0) - 0.5) + 0.5) < 1e-8
    True
    """
    if not len(growths):
        return math.nan
    return -math.inf if np.any(np.isneginf(growths)) else weighted_mean(growths)


def largest_exponent(multipliers: np.ndarray, time: float) -> float:
    """Largest Lyapunov exponent of multipliers over some time; -inf where all are 0.

    Examples
    --------
    >>> largest_exponent(np.array([0.0, 0.0]), 1.0)
    -inf
    """
    largest = float(np.abs(multipliers).max())
    return math.log(largest) / time if largest > 0.0 else -math.inf


def drift_directions(system: ImpactSystem) -> np.ndarray:
    """Return orthonormal columns (n, f): the displacements along which no spring and no stop acts."""
    return np.linalg.qr(system.modes.shapes @ free_motions(system).T)[0]


def without_drift(system: ImpactSystem, states: np.ndarray) -> np.ndarray:
    """States (P, 2n) without their displacements along `drift_directions`."""
    free = drift_directions(system)
    n = len(free)
    return np.concatenate([states[:, :n] - states[:, :n] @ free @ free.T, states[:, n:]], axis=1) if free.size else states


def multipliers_of(system: ImpactSystem, monodromy: np.ndarray) -> np.ndarray:
    """Return the eigenvalues (2n - f,) of a monodromy matrix, without the multiplier 1 of each drift."""
    free = drift_directions(system)
    columns = np.concatenate([free, np.zeros_like(free)])
    others = np.linalg.qr(columns, mode="complete")[0][:, free.shape[1] :] if free.size else np.eye(len(monodromy))
    return np.linalg.eigvals(others.T @ monodromy @ others).astype(complex)


def distance_scale(states: np.ndarray, frequency: float) -> np.ndarray:
    """States (P, 2n) as (w u, v), whose differences are distances."""
    n = states.shape[1] // 2
    return np.concatenate([frequency * states[:, :n], states[:, n:]], axis=1)


def find_period(states: np.ndarray, frequency: float, growth: float, elapsed: float, size: float = 0.0) -> int:
    """The period of stroboscopic states, in periods of the loads: the smallest p with which the last p states return; 0 if there is none.

    A slow spiral with an angle near 2 pi/5 returns after five periods first. Then its distances after one period shrink as fast as the
    motion converges, and the period is 1.

    Parameters
    ----------
    states : (P, 2n) ndarray
        At the end of the last P periods.
    frequency : float
        Base frequency w.
    growth : float
        Mean logarithmic growth of a tangent vector in a period.
    elapsed : int
        Periods since the motion began; infinite: only `RETURN` counts. A motion that converges by exp(growth) in each period is still at
        a distance exp(growth elapsed) from its end. `SLACK` times this counts as a return, as `RETURN` does, up to `LOOSEST`.
    size : float
        Largest distance from 0 between the states, of (w u, v). At phase 0 a motion can be close to 0.
    """
    points = distance_scale(states, frequency)
    size = max(size, float(np.linalg.norm(points, axis=1).max(initial=0.0)))
    if not math.isfinite(size):
        return 0
    left = math.exp(growth * elapsed) if growth < 0.0 else 0.0
    level = size * max(RETURN, min(SLACK * left, LOOSEST))
    back = np.linalg.norm(points[-1:] - points[::-1][1 : len(points) // 2 + 1], axis=1)
    for p in (np.flatnonzero(back <= level) + 1).tolist():
        if np.linalg.norm(points[-p:] - points[-2 * p : -p], axis=1).max() <= level:
            return shortest_period(points, p, growth, size)
    return 0


def shortest_period(points: np.ndarray, p: int, growth: float, size: float) -> int:
    """Return the smallest divisor q of a period p such that the distances of points (P, 2n) after q periods shrink as exp(growth) in each
    period, by the slope of their logarithms; else p. If q is not a period of the motion, they tend to a constant."""
    for q in (q for q in range(1, p) if p % q == 0):
        back = np.linalg.norm(points[q:] - points[:-q], axis=1)
        slope = np.polyfit(np.arange(len(back)), np.log(np.maximum(back, np.finfo(float).eps * size)), 1)[0]
        if slope <= 0.5 * growth < 0.0:
            return q
    return p
