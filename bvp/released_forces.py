"""Smooth forces in which parameters are released, and their flights under loads: the arrays that `bvp.kernels.smooth_loads` takes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from bvp.jet_programs import plain_powers
from bvp.kernels.expressions import Program
from bvp.kernels.jets import JetProgram
from bvp.kernels.loads import Loads
from bvp.kernels.smooth_loads import SmoothLoadedFlight
from bvp.kernels.sources import make_load_sources
from bvp.kernels.taylor import STEPS, make_smooth_flight
from bvp.programs import derivative, program_of, scratch_size

if TYPE_CHECKING:
    from bvp.smooth_forces import SmoothForces

__all__ = ["ReleasedForces", "released_forces", "released_flight"]

SINGLE = 2048
"""Most steps of a flight that is a whole period of loads. Pieces of it share twice as many."""


class ReleasedForces(NamedTuple):
    """Smooth forces in which m released parameters vary: I inputs, F forces, n coordinates."""

    rows: np.ndarray  # (I, 2 n) of the inputs, on (u, v)
    directions: np.ndarray  # (F, n) along which the forces act
    program: JetProgram
    numbers: Program  # those of that program, from the parameters
    energy: Program  # the potential, its derivatives by the inputs, then by the parameters; nothing where there is none


def released_forces(forces: SmoothForces) -> ReleasedForces:
    """Smooth forces whose parameters are released."""
    from sympy import sympify

    program, numbers = forces.released_program()
    known = [*forces.symbols, *forces.parameters]
    potential: Any = sympify(0 if forces.is_called else forces.potential)  # that of a Python function is in the program of the forces
    energy = [] if forces.potential is None else [potential, *(derivative(potential, symbol) for symbol in known)]
    return ReleasedForces(
        np.ascontiguousarray(forces.inputs), forces.directions, program, numbers, program_of([plain_powers(e) for e in energy], known)
    )


def released_flight(
    forces: ReleasedForces, matrix: np.ndarray, enter: np.ndarray, loads: Loads, change: np.ndarray, flights: int
) -> SmoothLoadedFlight:
    """The flights of smooth forces under loads. Arrays as in `bvp.kernels.loads.LoadedFlight`, in (u, v); flights: rows of nodes."""
    count, n = forces.directions.shape
    push, slope = np.zeros((n, count)), np.zeros((len(change), n, count))
    steps = max(STEPS, 2 * SINGLE // flights)
    taylor = make_smooth_flight(
        matrix, forces.rows, push, forces.program, forces.energy, flights + 1, make_load_sources(loads, change, slope), steps
    )
    if forces.program.called.address != 0:
        from bvp.kernels.collocation import collocated

        taylor = collocated(taylor)
    scratch = np.zeros(scratch_size(forces.numbers, len(loads.clock) - 1))
    return SmoothLoadedFlight(taylor, enter, loads, forces.numbers, scratch)
