"""What the kernels of all multipoint problems share: their kinds of ends, the result of a step, and the work space of Newton's method.

Conservative orbits are those of the compiled core (`bvp/core/problem.hpp`), whose results have the same entries.
"""

from typing import NamedTuple

import numpy as np

from bvp.kernels.compiled import chosen, inlined

ORIGIN, REST, STOP, PERIODIC = 0, 1, 2, 3
"""Kinds of an end."""

OPEN, UNFOLDED, CLOSED = 0, 1, 2
"""Whether a segment runs between two ends, or closes on itself: with an unfolding parameter, or without."""


@inlined
def total_time(matrix, start_map, shape, y):
    """Sum of the flight times in the unknowns y, or in a change of them."""
    total = 0.0
    at = start_map.shape[1]
    for _ in range(shape[0] + 1):
        total += y[at]
        at += matrix.shape[1] + 1
    return total


@chosen
def unpack(packed):
    """The segment of a problem as kernels use it, from the form in which Python gives it to them."""


RESULT = tuple(
    """
    converged iterations contraction residual energy quarter_period slope turn branching clearance clearance_flight clearance_stop
    clearance_side clearance_time speed speed_node flight flight_index absorber_start absorber_end waves_absorber waves_primary
    first_quarter second_quarter in_phase gave_up a b c d magnified trace determinant larger_real larger_imaginary smaller_real
    smaller_imaginary trivial singular speeds steepness conditioning
    """.split()
)
(
    CONVERGED, ITERATIONS, CONTRACTION, RESIDUAL, ENERGY, QUARTER_PERIOD, SLOPE, TURN, BRANCHING, CLEARANCE, CLEARANCE_FLIGHT,
    CLEARANCE_STOP, CLEARANCE_SIDE, CLEARANCE_TIME, SPEED, SPEED_NODE, FLIGHT, FLIGHT_INDEX, ABSORBER_START, ABSORBER_END,
    WAVES_ABSORBER, WAVES_PRIMARY, FIRST_QUARTER, SECOND_QUARTER, IN_PHASE, GAVE_UP, HALF_A, HALF_B, HALF_C, HALF_D, MAGNIFIED, TRACE,
    DETERMINANT, LARGER_REAL, LARGER_IMAGINARY, SMALLER_REAL, SMALLER_IMAGINARY, TRIVIAL, SINGULAR,
    SPEEDS, STEEPNESS, CONDITIONING,
) = range(42)  # fmt: skip
"""Entries of the result of a step. Under loads ENERGY is the first released parameter, and QUARTER_PERIOD the period."""


class Factor(NamedTuple):
    """Work space and the last factorisation (see `bvp.kernels.newton`)."""

    window: np.ndarray
    closing: np.ndarray
    diagonal: np.ndarray
    factor: np.ndarray
    scale: np.ndarray  # (u,) scale of each unknown
    before: np.ndarray  # (k + 1, N) state at the end of each flight, where the problem was last evaluated
    flights: np.ndarray  # (k + 1, N, N) exp(B t) of each flight there
    work: np.ndarray  # (7, max(u, N) + 2) scratch
    square: np.ndarray  # (N, N) scratch


def make_factor(segment):
    """Work space for `segment`."""
    size = segment.gap.shape[1]
    k = int(segment.shape[0])
    start = segment.start_map.shape[1] + 1
    unfolded = int(segment.shape[1] == UNFOLDED)
    closers = size + unfolded if segment.shape[1] else segment.end_map.shape[0]
    unknowns = start + k * (size + 1) + unfolded
    return Factor(
        np.zeros((k * (size + 1), start + 2 * (size + 1))),
        np.zeros((closers, unknowns)),
        np.zeros(unknowns - 1),
        np.zeros(unknowns - 1),
        np.ones(unknowns),
        np.zeros((k + 1, size)),
        np.zeros((k + 1, size, size)),
        np.zeros((7, max(unknowns, size) + 2)),
        np.zeros((size, size)),
    )


@chosen
def evaluate(segment, y, before, flights, z, residual):
    """Residual of the problem at y (u,). For each flight, before (k + 1, N) receives the node at its end, and flights (k + 1, N, N) its
    derivative by the node at its begin. z (N,): scratch."""


@chosen
def fill(segment, y, factor):
    """Write the scaled transpose of the Jacobian at y into the factor arrays (before: `evaluate` at y)."""
