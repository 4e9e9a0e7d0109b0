"""The units of arclength along a family of orbits under periodic loads."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bvp.forced import ForcedProblem

__all__ = ["forced_metric"]


def forced_metric(problem: ForcedProblem) -> np.ndarray:
    """What a unit of arclength is for each entry of the first node, (N,).

    A displacement: the smallest width of a stop that confines it, else the larger of the smallest gap and the largest
    |(K + nu^2 M)^-1 C| of the loads C cos(nu t), beside smooth forces also of |K^-1 C|. A velocity: that times the fastest frequency.
    The time: the period. A parameter that cannot be zero: its logarithm; another one: its default."""
    n, system, layout = problem.degrees_of_freedom, problem.system, problem.parametric.layout
    entries = problem.parametric.entries(problem.values)
    base = float(entries[layout.frequency][0])
    gaps = [abs(bound) for stop in system.stops for bound in (stop.lower, stop.upper) if math.isfinite(bound) and bound]
    size = min(gaps, default=0.0)
    forces = [entries[layout.constant], *entries[layout.cosine].reshape(-1, n), *entries[layout.sine].reshape(-1, n)]
    for k, force in zip([1, *layout.harmonics, *layout.harmonics], forces, strict=True):
        for rate in (k * base, 0.0) if problem.is_smooth else (k * base,):
            size = max(size, float(np.abs(np.linalg.lstsq(system.stiffness + rate**2 * system.mass, force, rcond=None)[0]).max()))
    reach = np.full(n, size or 1.0)
    for stop in system.stops:
        row = np.asarray(stop.gap)
        if math.isfinite(stop.upper - stop.lower) and np.count_nonzero(row) == 1:
            place = int(np.argmax(np.abs(row)))
            reach[place] = min(reach[place], 0.5 * (stop.upper - stop.lower) / abs(row[place]))
    fastest = max(base, float(np.sqrt(np.abs(system.modes.squares).max()))) or 1.0
    units = [
        0.0 if problem.values[name] > 0.0 and problem.parametric.violation(problem.values | {name: 0.0})
        else abs(problem.parametric.values[name]) or 1.0
        for name in problem.released
    ]  # fmt: skip
    return np.array([*reach, *(reach * fastest), 1.0, *units])
