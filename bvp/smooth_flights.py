"""Flights with smooth forces for the multipoint problem: the arrays that `bvp.kernels.taylor` takes, in modal coordinates."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bvp.kernels.taylor import SmoothFlight, fly_smooth, make_smooth_flight

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["sample_smooth", "smooth_flight"]

PIECE = 5.0
"""Time in which a flight is computed at once, where only its path is wanted."""


def smooth_flight(system: ImpactSystem, flights: int) -> SmoothFlight:
    """The flights of a conservative system with smooth forces, with room for the paths of so many.

    The state is that of the modes of its linear part, u = Phi q: forces f along the rows d of the coordinates accelerate q by -(d Phi)^T f.
    """
    forces, modes = system.smooth_forces, system.modes
    assert forces is not None
    n = system.degrees_of_freedom
    inputs = np.hstack([forces.inputs[:, :n] @ modes.shapes, forces.inputs[:, n:] @ modes.shapes])
    push = np.ascontiguousarray(-(forces.directions @ modes.shapes).T)
    return make_smooth_flight(modes.matrix, inputs, push, forces.program()[0], forces.energy_program(), flights)


def sample_smooth(system: ImpactSystem, begins: np.ndarray, flights: np.ndarray, times: np.ndarray, states: np.ndarray) -> None:
    """States (m, N) at times (m,), of flights that begin at times (P,), ascending, with states (P, N).

    Each flight is computed piece by piece, so a long one is no matter; from one time to the next no more steps than a flight can have."""
    path = smooth_flight(system, 1)
    place = np.searchsorted(begins, times, side="right") - 1
    for k in range(len(begins)):
        here, state = float(begins[k]), np.array(flights[k], float)
        for i in sorted(np.flatnonzero(place == k), key=lambda i: times[i]):
            ahead = float(times[i]) - here
            pieces = max(1, round(ahead / PIECE))
            for _ in range(pieces if ahead > 0.0 else 0):
                if not fly_smooth(path, 0, state, ahead / pieces, False):
                    state = np.full_like(state, np.nan)
                    break
                state = path.paths.ends[0].copy()
            here = float(times[i])
            states[i] = state
