"""Values and Taylor coefficients of expressions, by their programs."""

import numpy as np

from bvp.kernels import expressions
from bvp.kernels.jets import DIVIDE, MULTIPLY, SQUARE, extend_jets
from bvp.programs import scratch_size

__all__ = ["DIVIDE", "MULTIPLY", "SQUARE", "run", "taylor"]


def run(program, point, scratch=None):
    """Return the values (O,) of a program (`bvp.programs.program_of`) at a point (N,), and whether all are finite."""
    point, out = np.array(point, dtype=float), np.zeros(len(program.outputs))
    known = expressions.run(program, point, np.zeros(scratch or scratch_size(program, len(point))), out)
    return out, bool(known)


def taylor(program, inputs, order):
    """Return the Taylor coefficients (registers, order + 1) of a jet program along polynomials of the time, one row for each input."""
    jets = np.zeros((program.registers, order + 1))
    for k, motion in enumerate(inputs):
        jets[k, : len(motion)] = motion[: order + 1]
    for k in range(order + 1):
        extend_jets(program, jets, np.int64(k), 0.0)
    return jets
