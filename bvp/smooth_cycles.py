"""Closed smooth orbits without impacts: the instants at which they can start, and their symmetries.

Such an orbit is solved from a maximum of the sum of its modal displacements. Its mirror image starts at a minimum.
"""

from __future__ import annotations

import math

import numpy as np
import saltus_core as core

from bvp.checks import EPSILON
from bvp.closures import Cycle, EndsError
from bvp.smooth_flights import flight_of

__all__ = ["covers", "is_without_impacts", "nearest_maximum", "nearest_rise", "reversal_instants", "start_instants", "states_at"]

NEAR = 1e-9
"""Part of the period within which two instants are one."""

_ROUNDS = 8
"""Most corrections of an instant that is known to `NEAR`."""

_BESIDE = 1e-6
"""Part of the period by which they can move it. The start of an orbit is among the instants even if nothing is zero there."""


def is_without_impacts(cycle: Cycle) -> bool:
    """Whether nothing is hit in the period."""
    return bool(np.all(cycle.contact < 0))


def states_at(cycle: Cycle, times: np.ndarray) -> np.ndarray:
    """Modal states (m, N) at times (m,)."""
    return np.hstack(cycle.sample(np.asarray(times, float))) @ cycle.system.modes.from_state.T


def _zeros(cycle: Cycle, row: np.ndarray) -> np.ndarray:
    """Instants in [0, T) at which row . z can be zero: where it changes its sign, and the nodes; ascending."""
    flight, matrix = flight_of(cycle.system), cycle.system.modes.matrix
    rows = np.array([row, row @ matrix, row @ matrix @ matrix])
    found = [cycle.times]
    for begin, z, duration in zip(cycle.times, np.ascontiguousarray(cycle.after), cycle.duration.tolist(), strict=True):
        times = core.path(flight, z, duration).crossings(rows)
        found += [begin + times] if times is not None else []
    period = cycle.period
    instants = np.concatenate(found) % period
    instants[instants > (1.0 - NEAR) * period] = 0.0
    instants.sort()
    return instants[np.concatenate([[True], np.diff(instants) > NEAR * period])]


def _row(cycle: Cycle, part: int) -> np.ndarray:
    """The sum of the modal displacements (0) or velocities (1) of a state."""
    row = np.zeros(cycle.after.shape[1])
    half = len(row) // 2
    row[part * half : (part + 1) * half] = 1.0
    return row


def start_instants(cycle: Cycle, sign: float = 1.0) -> np.ndarray:
    """Times in [0, T) of the maxima (sign 1) or minima (-1) of the sum of the modal displacements, ascending."""
    half = cycle.after.shape[1] // 2
    instants = _zeros(cycle, _row(cycle, 1))
    sums = states_at(cycle, np.concatenate([instants, instants[:1] + cycle.period]))[:, :half].sum(axis=1)
    middles = states_at(cycle, instants + 0.5 * np.diff(np.append(instants, instants[0] + cycle.period)))[:, :half].sum(axis=1)
    # Between two neighbouring instants the sum only rises, or only falls.
    return instants[(sign * sums[:-1] > sign * middles) & (sign * sums[:-1] > sign * np.roll(middles, 1))]


def nearest_maximum(cycle: Cycle) -> float:
    """The instant of the maximum of the sum of the modal displacements that is nearest to the start of an orbit.

    Raises
    ------
    EndsError
        If there is none.
    """
    found = _nearest(cycle, 1, start_instants(cycle))
    if found is None:
        raise EndsError("the sum of the modal displacements has no maximum, at which a closed orbit without impacts starts")
    return found


def nearest_rise(cycle: Cycle) -> float:
    """The same where that sum rises through zero."""
    instants = _zeros(cycle, _row(cycle, 0))
    found = _nearest(cycle, 0, instants[states_at(cycle, instants) @ _row(cycle, 1) > 0.0])
    if found is None:
        words = "a closed orbit without impacts is followed in a parameter from where the sum of its modal displacements rises through zero"
        raise EndsError(f"{words}; it never does")
    return found


def _nearest(cycle: Cycle, part: int, instants: np.ndarray) -> float | None:
    """The zero of a sum, see `_row`, that is nearest to the start, of those near such instants."""
    flight, row, period = flight_of(cycle.system), _row(cycle, part), cycle.period
    for begun in sorted(instants.tolist(), key=lambda time: min(time, period - time)):
        i = int(np.searchsorted(cycle.times, begun, side="right")) - 1
        path = core.path(flight, np.ascontiguousarray(cycle.after[i]), float(cycle.duration[i]))
        first = float(cycle.times[i]) - (period if i < 0 else 0.0)  # before the first node, the last flight goes on
        time = begun
        for _ in range(_ROUNDS):
            state, change = path.motion(time - first)
            value, rate = float(row @ state), float(row @ change)
            step = -value / rate if rate != 0.0 else math.inf
            if not abs(time + step - begun) < _BESIDE * period:
                break
            if abs(step) <= 4.0 * EPSILON * period:
                return time
            time += step
    return None


def reversal_instants(cycle: Cycle, tolerance: float) -> list[tuple[float, int]]:
    """(instant, e) in [0, T) with u(c + s) = e u(c - s): all velocities are zero there (1), or all displacements (-1)."""
    half = cycle.after.shape[1] // 2
    sizes = np.abs(states_at(cycle, np.linspace(0.0, cycle.period, 65)))
    found = []
    for part, e in ((1, 1), (0, -1)) if cycle.system.has_odd_symmetry else ((1, 1),):
        instants = _zeros(cycle, _row(cycle, part))
        entries = slice(part * half, (part + 1) * half)
        small = np.max(np.abs(states_at(cycle, instants)[:, entries]), axis=1) <= tolerance * np.max(sizes[:, entries])
        found += [(float(instant), e) for instant in instants[small]]
    return sorted(found)


def covers(cycle: Cycle, tolerance: float) -> tuple[int, bool]:
    """How often an orbit repeats itself in its period, and whether the primitive orbit has u(t + T/2) = -u(t)."""
    half = cycle.after.shape[1] // 2
    begin = states_at(cycle, np.zeros(1))[0]
    sizes = np.max(np.abs(states_at(cycle, np.linspace(0.0, cycle.period, 65))), axis=0)
    near = tolerance * np.repeat([sizes[:half].max(), sizes[half:].max()], half)
    most = len(start_instants(cycle))
    later = states_at(cycle, cycle.period / np.arange(1, most + 1))
    cover = max((k for k in range(1, most + 1) if np.all(np.abs(later[k - 1] - begin) <= near)), default=1)
    opposite = states_at(cycle, np.array([0.5 * cycle.period / cover]))[0]
    return cover, cycle.system.has_odd_symmetry and bool(np.all(np.abs(opposite + begin) <= near))
