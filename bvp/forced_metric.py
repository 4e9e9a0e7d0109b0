"""The coordinates of arclength along a family of orbits under periodic loads.

They are those of the first node. Its state x, in units of the system, gives x/R and log R, R = sqrt(1 + |x|^2). A step then is a part of
the unit for a small motion, and a part of the motion for a large one. A parameter p with a unit P gives asinh(p/P), in the same way. One
that cannot be zero gives log p. The time gives s; of free orbits, where s is 0, the logarithm of the duration that is solved.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bvp.forced import ForcedProblem

__all__ = ["forced_metric", "position_slopes"]


_LIGHT = 0.1
"""A light damper, beside inertia at the fastest frequency: a twentieth of critical damping."""


def forced_metric(problem: ForcedProblem) -> np.ndarray:
    """The unit of each entry of the first node, (N,).

    A displacement: the smallest width of a stop that confines it, else the larger of the smallest gap and the largest
    |(K + nu^2 M)^-1 C| of the loads C cos(nu t), beside smooth forces also of |K^-1 C|. A velocity: that times the fastest frequency.
    The time: the period. A parameter that cannot be zero: 0, as its logarithm has no unit. Another one: see `_parameter_unit`.

    Of free orbits a velocity has the unit sqrt(2 h/m) of its coordinate, a displacement that over the fastest frequency, the time 0.
    Without a frequency `_rate` takes its place."""
    n, system, layout = problem.degrees_of_freedom, problem.system, problem.parametric.layout
    entries = problem.parametric.entries(problem.values)
    base = float(entries[layout.frequency][0])
    gaps = [abs(bound) for stop in system.stops for bound in (stop.lower, stop.upper) if math.isfinite(bound) and bound]
    speeds = np.sqrt(2.0 * problem.energy / np.diag(system.mass))
    fastest = max(base, float(np.sqrt(np.abs(system.modes.squares).max()))) or _rate(problem, speeds, min(gaps, default=0.0))
    size = max(min(gaps, default=0.0), _load_response(problem, entries, base)) or float(speeds.max()) / fastest or 1.0
    reach = np.full(n, size)
    for stop in system.stops:
        row = np.asarray(stop.gap)
        if math.isfinite(stop.upper - stop.lower) and np.count_nonzero(row) == 1:
            place = int(np.argmax(np.abs(row)))
            reach[place] = min(reach[place], 0.5 * (stop.upper - stop.lower) / abs(row[place]))
    units = [
        0.0 if problem.values[name] > 0.0 and problem.parametric.violation(problem.values | {name: 0.0})
        else _parameter_unit(problem, name, size, fastest)
        for name in problem.released
    ]  # fmt: skip
    reach, time = (speeds / fastest, 0.0) if problem.energy > 0.0 else (reach, 1.0)
    return np.array([*reach, *(reach * fastest), time, *units])


def _rate(problem: ForcedProblem, speeds: np.ndarray, gap: float) -> float:
    """A frequency where no spring is linear: one over the time in which free motion at these speeds (n,) comes where its potential is its
    energy, or through the gap; of a motion under losses, without speeds, the largest |C|/|M|. 1 if there is none of these."""
    system, forces = problem.system, problem.system.smooth_forces
    if problem.energy > 0.0 and forces is not None and not forces.is_called:
        times = np.geomspace(1e-60, 1e60, 1201)  # between which the potential is taken for a power
        heights = np.abs(forces.energy(times[:, None, None] * np.diag(speeds))).sum(axis=1) / problem.energy
        i = int(np.argmax(heights >= 1.0))
        if i > 0 and heights[i - 1] > 0.0:
            return math.exp(-float(np.interp(0.0, np.log(heights[i - 1 : i + 1]), np.log(times[i - 1 : i + 1]))))
    return (float(speeds.max()) / gap if gap else 0.0) or float(np.abs(system.damping).max() / np.abs(system.mass).max()) or 1.0


def _load_response(problem: ForcedProblem, entries: np.ndarray, base: float) -> float:
    """The largest |(K + nu^2 M)^-1 C| of the loads among some entries (E,), beside smooth forces also of |K^-1 C|."""
    n, system, layout = problem.degrees_of_freedom, problem.system, problem.parametric.layout
    loads = [entries[layout.constant], *entries[layout.cosine].reshape(-1, n), *entries[layout.sine].reshape(-1, n)]
    size = 0.0
    for k, load in zip([1, *layout.harmonics, *layout.harmonics], loads, strict=True):
        for rate in (k * base, 0.0) if problem.is_smooth else (k * base,):
            size = max(size, float(np.abs(np.linalg.lstsq(system.stiffness + rate**2 * system.mass, load, rcond=None)[0]).max()))
    return size


def _parameter_unit(problem: ForcedProblem, name: str, size: float, fastest: float) -> float:
    """The change of a parameter, by its derivatives, that changes the system by as much as it has: a bound or the response to loads by the
    unit of displacements, a matrix by inertia at the fastest frequency, damping by a tenth of that, a restitution by 1. If all derivatives
    are zero: its value, or 1."""
    layout, slopes = problem.parametric.layout, problem.parametric.derivatives(problem.values, [name])[:, 0]
    base, mass = float(problem.parametric.entries(problem.values)[layout.frequency][0]), float(np.abs(problem.system.mass).max())
    parts = [(layout.mass, mass), (layout.damping, _LIGHT * mass * fastest), (layout.stiffness, mass * fastest**2)]
    parts += [(layout.frequency, fastest), (layout.lower, size), (layout.upper, size), (layout.restitution, 1.0)]
    changes = [float(np.abs(slopes[part]).max(initial=0.0)) / unit for part, unit in parts]
    change = max(*changes, _load_response(problem, slopes, base) / size)
    return 1.0 / change if change > 0.0 else abs(problem.values[name]) or 1.0


def position_slopes(problem: ForcedProblem, y: np.ndarray) -> np.ndarray:
    """The derivatives (2 n + 2 + m, u) of `ForcedProblem.position` by the unknowns y (u,)."""
    size, units, count = problem.size, problem.units, len(problem.units)
    x, times = problem.states(y)[0] / units[:size], np.arange(problem.inner + 1) * (size + 1)
    reach = math.sqrt(1.0 + float(x @ x))
    found = np.zeros((count + 1, len(y)))
    found[:size, 1 : size + 1] = (np.eye(size) - np.outer(x, x) / reach**2) / (reach * units[:size])
    if problem.has_clock:
        found[size, 0] = 1.0
    else:
        found[size, times] = 1.0 / np.sum(y[times])
    rest = np.arange(count - size - 1)
    found[size + 1 + rest, problem.place + rest] = 1.0 / np.hypot(units[size + 1 :], problem.released_values(y))
    found[count, 1 : size + 1] = x / (reach**2 * units[:size])
    return found
