"""Flights with smooth forces for the multipoint problem: the arrays that `bvp.kernels.taylor` takes, in modal coordinates."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bvp.kernels.taylor import SmoothFlight, make_smooth_flight

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["smooth_flight"]


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
