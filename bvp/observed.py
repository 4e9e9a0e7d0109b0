"""What is watched along the flights of an orbit."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from bvp.kernels.extrema import Observed
from bvp.system import ImpactSystem

__all__ = ["observed_of"]


@lru_cache(maxsize=64)
def observed_of(system: ImpactSystem) -> Observed:
    """The functionals that are watched along each flight: the gap of every stop, and the velocities of absorber and primary.
    Shared by all who ask, and not to be written to."""
    modes = system.modes
    size = 2 * system.degrees_of_freedom
    n = system.degrees_of_freedom
    gap = np.array([modes.to_state[:n].T @ np.asarray(stop.gap) for stop in system.stops]).reshape(-1, size)
    velocity = np.zeros((0, size))
    if system.absorber is not None and system.primary is not None:
        velocity = modes.to_state[[n + system.absorber, n + system.primary]]

    def derivative(rows: np.ndarray, times: int) -> np.ndarray:
        for _ in range(times):
            rows = rows @ modes.matrix
        return np.ascontiguousarray(rows)

    return Observed(
        derivative(gap, 0),
        derivative(gap, 1),
        derivative(gap, 2),
        derivative(gap, 3),
        np.array([stop.lower for stop in system.stops], dtype=float),
        np.array([stop.upper for stop in system.stops], dtype=float),
        derivative(velocity, 0),
        derivative(velocity, 1),
        derivative(velocity, 2),
    )
