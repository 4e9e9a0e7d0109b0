"""What all kinds of flights give: the end and its derivative, the path, the rate of the state, and the energy.

This is the seam between flights and the multipoint problem, and between flights and simulation. `bvp.kernels.flight` has linear flights,
which are exact; `bvp.kernels.smooth` those with smooth forces, and `bvp.kernels.pieces` those of a simulation with them. States are modal
coordinates of the linear part, whose mass matrix is the identity.
"""

import math

from bvp.kernels.compiled import chosen, inlined, kernel
from bvp.kernels.flight import ROUNDING, Flight, amplitudes, block_product, fastest_rate, flow_inside, flow_state, growth_rate

NEAR_TERMS = 14
NEAR_REACH = 0.25
"""|B| t up to which the series from the start is used: its 14 terms truncate below 1e-19."""


@chosen
def path_state(flight, z, t, out):
    """out (N,) = the state at time t on the path of a flight from z."""


@path_state.of(Flight)
@inlined
def linear_path_state(flight, z, t, out):
    """See `path_state`."""
    flow_state(flight, z, t, out)


@chosen
def carry_change(flight, z, change, t, out):
    """out (N,) = the derivative of a flight's end by its begin z, times a vector `change`."""


@carry_change.of(Flight)
@inlined
def flow_change(flight, z, change, t, out):
    """See `carry_change`: it moves as a state does."""
    flow_state(flight, change, t, out)


@chosen
def rate(flight, z, out):
    """out (N,) = z'."""


@rate.of(Flight)
@inlined
def linear_rate(flight, z, out):
    """See `rate`: B z."""
    block_product(flight.pairs, flight.matrix, z, out)


@chosen
def velocity_unit(flight, end, velocity, duration):
    """The unit of residuals of velocities at the end of a flight: a typical velocity; or the change of the velocities there in a typical
    duration, if the forces are so large that this is more. A duration is known to a part eps, so no residual is below eps of that."""


@chosen
def comes_with_map(flight):
    """Whether the end of a flight takes so long that a new factorisation of its derivatives costs little beside it."""


@chosen
def potential_energy(flight, z):
    """The energy of the smooth forces at a state."""


@potential_energy.of(Flight)
@inlined
def no_potential_energy(flight, z):
    """See `potential_energy`: there are none."""
    return 0.0


@chosen
def begin_path(flight, z, horizon):
    """Begin a flight from z. Returns the time up to which it is known, at most a horizon; -1 where it cannot be computed.

    The functions below hold for the flight that began last, up to this time."""


@begin_path.of(Flight)
@inlined
def begin_exact(flight, z, horizon):
    """See `begin_path`: a formula holds at all times."""
    return horizon


@chosen
def hold_path(flight, z, t):
    """Make ready for calls at several times up to t of the flight from z."""


@hold_path.of(Flight)
@inlined
def hold_nothing(flight, z, t):
    """See `hold_path`."""


@chosen
def along_path(flight, z, t, out):
    """out (N,) = the state at time t of the flight from z."""


@along_path.of(Flight)
@inlined
def along_exact(flight, z, t, out):
    """See `along_path`."""
    flow_inside(flight, z, t, out)


@chosen
def path_growth(flight):
    """(steady, growth). steady: bounds of one instant hold at all later ones. growth > 0: they hold for 1/growth at most."""


@path_growth.of(Flight)
@inlined
def exact_growth(flight):
    """See `path_growth`."""
    return growth_rate(flight)


@chosen
def bounds_window(flight, t, window):
    """The part of a time `window` after t over which `path_bounds` holds."""


@bounds_window.of(Flight)
@inlined
def exact_window(flight, t, window):
    """See `bounds_window`: all of it."""
    return window


@chosen
def path_bounds(flight, rows, c, t, state, window):
    """Bounds of |f|, |f''| and |f'''| for f = rows[c] . z over a window after t, when the state is `state`."""


@path_bounds.of(Flight)
@inlined
def exact_bounds(flight, rows, c, t, state, window):
    """See `path_bounds`."""
    return amplitudes(flight, rows[c], state, window)


@chosen
def fastest(flight):
    """A rate that bounds how fast the terms of the series of a path can grow."""


@fastest.of(Flight)
@inlined
def fastest_exact(flight):
    """See `fastest`."""
    return fastest_rate(flight)


@kernel
def rounding_level(flight, rows, c, z):
    """Sixteen rounding errors of rows[c] . z for a computed state z. The two entries of a pair have a common rounding error, that of the
    larger one."""
    pairs, matrix = flight.pairs, flight.matrix
    total = 0.0
    for k in range(pairs.shape[0]):
        i = pairs[k, 0]
        j = pairs[k, 1]
        if j >= 0:
            # The two entries of a pair exchange their energy, so each rounds with the size of both: at its frequency, or its fast rate.
            down = abs(matrix[j, i])
            up = abs(matrix[i, j])
            pace = max(math.sqrt(down * up), 0.5 * abs(matrix[i, i] + matrix[j, j])) if up > 0.0 and down > 0.0 else math.inf
            ratio = down / pace
            inverse = up / pace
            total += abs(rows[c, i]) * (abs(z[i]) + inverse * abs(z[j])) + abs(rows[c, j]) * (abs(z[j]) + ratio * abs(z[i]))
        else:
            weight = 0.0
            size = 0.0
            for r in range(i, i - j):
                weight += abs(rows[c, r])
                size += abs(z[r])
            total += weight * size
    return ROUNDING * total


@chosen
def parting(flight, contacts, c, z, horizon, window, state, other, further):
    """(time for which a contact is certain to separate, order of the first derivative of its distance that is not 0 to rounding).

    Distance, rate and acceleration are 0 to rounding. Times are up to `horizon`; bounds of one instant hold over `window`. The
    time is 0 where that derivative is negative: the contact presses. The order is 0
    where there is none: the distance stays 0. state, other, further (N,) are scratch."""


@chosen
def series(flight, contacts, c, z, coefficients, state, other):
    """coefficients[k] = d^(k)(0)/k! for k >= 1. Returns a rate that bounds how fast the terms can grow."""
