"""What all kinds of flights give: the end and its derivative, the path, the rate of the state, and the energy.

This is the seam between flights and the multipoint problem. `bvp.kernels.flight` has linear flights, which are exact;
`bvp.kernels.smooth` those with smooth forces. States are modal coordinates of the linear part, whose mass matrix is the identity.
"""

from typing import NamedTuple

import numpy as np

from bvp.kernels.compiled import chosen, inlined
from bvp.kernels.flight import Flight, block_product, flow_matrix, flow_state


@chosen
def flight_end(flight, z, t, out, jacobian):
    """out (N,) = the state after a flight of time t from z, jacobian (N, N) = its derivative by z. Both are NaN where it has no end."""


@flight_end.of(Flight)
@inlined
def fly_linear(flight, z, t, out, jacobian):
    """See `flight_end`: exp(B t)."""
    flow_matrix(flight, t, jacobian)
    block_product(flight.pairs, jacobian, z, out)


@chosen
def flight_map(flight, z, t, jacobian):
    """The derivative of the end by the state z at the begin alone."""


@flight_map.of(Flight)
@inlined
def linear_map(flight, z, t, jacobian):
    """See `flight_map`."""
    flow_matrix(flight, t, jacobian)


@chosen
def flow_product(flight, flow, z, out):
    """out = flow z, flow being a derivative of ends by begins."""


@flow_product.of(Flight)
@inlined
def linear_flow_product(flight, flow, z, out):
    """See `flow_product`: the derivative is in blocks."""
    block_product(flight.pairs, flow, z, out)


@chosen
def path_state(flight, z, t, out):
    """out (N,) = the state at time t on the path of a flight from z."""


@path_state.of(Flight)
@inlined
def linear_path_state(flight, z, t, out):
    """See `path_state`."""
    flow_state(flight, z, t, out)


@chosen
def rate(flight, z, out):
    """out (N,) = z'."""


@rate.of(Flight)
@inlined
def linear_rate(flight, z, out):
    """See `rate`: B z."""
    block_product(flight.pairs, flight.matrix, z, out)


@chosen
def twice_energy(flight, weights, z):
    """2 H. weights (N,): those of the quadratic part, sum(weights z^2)."""


@twice_energy.of(Flight)
@inlined
def twice_quadratic_energy(flight, weights, z):
    """See `twice_energy`."""
    total = 0.0
    for r in range(z.shape[0]):
        total += weights[r] * z[r] * z[r]
    return total


class QuadraticSlope(NamedTuple):
    """grad H of a quadratic energy at the state z scale."""

    weights: np.ndarray  # (N,)
    z: np.ndarray  # (N,)
    scale: float


@chosen
def energy_slope(flight, weights, z, scale):
    """grad H at the state z scale: its entries are `slope_times` of what is returned."""


@energy_slope.of(Flight)
@inlined
def quadratic_slope(flight, weights, z, scale):
    """See `energy_slope`."""
    return QuadraticSlope(weights, z, scale)


@chosen
def slope_times(slope, r, factor):
    """Entry r of grad H, times a factor."""


@slope_times.of(QuadraticSlope)
@inlined
def quadratic_slope_times(slope, r, factor):
    """See `slope_times`."""
    return factor * slope.weights[r] * slope.z[r] * slope.scale


@chosen
def add_bend(flight, z, factor, e, scale, column):
    """Add row e of the second derivative of the smooth forces' energy at z, times a factor and the columns' scale, to a column."""


@add_bend.of(Flight)
@inlined
def no_bend(flight, z, factor, e, scale, column):
    """See `add_bend`: there are none."""
