"""The multipoint problem of an impacting orbit, equation (30): its data, its residual and its Jacobian.

Unknowns   y = (s, t_0, z_1, t_1, ..., z_k, t_k [, xi]):  start parameters, flight times, node states after each inner impact
Equations  R exp(B t_i) z_i - z_{i+1} = 0,  g . z_{i+1} - bound = 0   for each inner impact, then the closing equations:
           two ends   L exp(B t_k) z_k = L0                      (n equations; z_0 = Z s + c)
           periodic   R exp(B t_k) z_k + xi grad H(z_0) - z_0 = 0,  g . z_0 - bound = 0

The start of a periodic orbit is an impact, which is its phase condition. Without impacts it is where the sum of the modal displacements is
largest, g being the row of its rate. At a cut (`bvp.kernels.cuts`) t_i - t_{i+1} = 0 takes the place of the gap.

xi is the unfolding parameter of the conserved energy
(Munoz-Almaraz et al., Physica D 181 (2003) 1), given as a kick along grad H at the closure: H(z_0) = H(z_0 - xi grad H) forces
xi = 0 on every solution (the other root is of order one, far from any start). There is one unknown more than equations: a family.
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
