"""Flights with smooth forces for the multipoint problem: the arrays that `bvp.kernels.smooth` takes, in modal coordinates."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bvp.kernels.smooth import SmoothFlight, make_smooth_flight

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["smooth_flight"]


def smooth_flight(system: ImpactSystem, flights: int) -> SmoothFlight:
    """The flights of a conservative system with smooth forces, with room for the paths of so many.

    The state is that of the modes of its linear part: u = Phi q, so the forces f on the inputs w = c . u accelerate q by -(c Phi)^T f.
    """
    forces, modes = system.smooth_forces, system.modes
    assert forces is not None
    n = system.degrees_of_freedom
    along = forces.rows @ modes.shapes
    rows = np.hstack([along, np.zeros((len(along), n))])
    return make_smooth_flight(modes.matrix, rows, np.ascontiguousarray(-along.T), forces.program, forces.potential, flights)
