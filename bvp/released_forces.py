"""Smooth forces in which parameters are released: the programs that the core takes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from bvp.jet_programs import plain_powers
from bvp.kernels.expressions import Program
from bvp.kernels.jets import JetProgram
from bvp.programs import derivative, program_of

if TYPE_CHECKING:
    from bvp.smooth_forces import SmoothForces

__all__ = ["ReleasedForces", "released_forces"]


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
