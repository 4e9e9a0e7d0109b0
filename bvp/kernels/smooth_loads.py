"""Flights with smooth forces under periodic loads, between the nodes of `bvp.kernels.loads`: (u, v), the time, released parameters.

The state is (u, v) itself: v' = M^-1 (g(t) - C v - K u - D' f(w)). A `bvp.kernels.taylor.SmoothFlight` computes it, with columns for the
time and for each parameter. The numbers of the forces' program follow the parameters.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy import int64

from bvp.kernels.compiled import chosen, inlined
from bvp.kernels.expressions import Program, run
from bvp.kernels.flight import set_1, set_2, times_matrix
from bvp.kernels.flights import comes_with_map, velocity_unit
from bvp.kernels.loads import LoadedFlight, Loads, advance_time, loaded_flight, loaded_rate
from bvp.kernels.sources import begin_sources
from bvp.kernels.taylor import SmoothFlight, evaluate_energy, find_path, largest_change, smooth_rate


class SmoothLoadedFlight(NamedTuple):
    """The flight seam with smooth forces under loads: nodes z (N,), N = 2 n + 1 + m."""

    taylor: SmoothFlight  # its potential gives the energy, its derivatives by the inputs, then by the parameters; nothing if there is none
    enter: np.ndarray  # (2 n, 2 n) identity
    loads: Loads
    numbers: Program  # the numbers of the forces' program, from the parameters
    scratch: np.ndarray  # of that program


@loaded_flight.of(SmoothLoadedFlight)
@inlined
def smooth_loaded_flight(flight, z, t, out, jacobian):
    """See `loaded_flight`."""
    slot = find_path(flight.taylor, z, t, True)
    size = flight.enter.shape[0]
    set_2(jacobian, 0.0)
    if slot < 0:
        set_1(out[:size], math.nan)
        set_2(jacobian[:size], math.nan)
    else:
        paths = flight.taylor.paths
        for r in range(size):
            out[r] = paths.ends[slot, r]
            for c in range(z.shape[0]):
                jacobian[r, c] = paths.maps[slot, r, c]
    advance_time(flight.loads, z, t, out, jacobian)


@loaded_rate.of(SmoothLoadedFlight)
@inlined
def smooth_loaded_rate(flight, z, out):
    """See `loaded_rate`."""
    loads = flight.loads
    size = flight.enter.shape[0]
    begin_sources(flight.taylor.sources, z)
    smooth_rate(flight.taylor, z, 0.0, 0.0, out)
    set_1(out[size:], 0.0)
    out[size] = loads.clock[0] / (2.0 * math.pi * loads.load_periods)


@comes_with_map.of(SmoothLoadedFlight)
@inlined
def comes_with_taylor_map(flight):
    """See `comes_with_map`."""
    return True


@velocity_unit.of(SmoothLoadedFlight)
@inlined
def smooth_loaded_velocity_unit(flight, end, velocity, duration):
    """See `velocity_unit`."""
    begin_sources(flight.taylor.sources, end)
    smooth_rate(flight.taylor, end, 0.0, 0.0, flight.taylor.slope)
    return largest_change(flight.taylor, velocity, duration)


@chosen
def renew_forces(flight, node):
    """Compute what the smooth forces are at the released parameters of a node."""


@renew_forces.of(LoadedFlight)
@inlined
def no_forces(flight, node):
    """See `renew_forces`: there are none."""


@renew_forces.of(SmoothLoadedFlight)
@inlined
def renew_numbers(flight, node):
    """See `renew_forces`."""
    run(flight.numbers, node[flight.enter.shape[0] + 1 :], flight.scratch, flight.taylor.program.numbers)


@chosen
def evaluate_stored(flight, node):
    """Compute the energy of the smooth forces at a node, and its derivatives, for `stored_energy` and `stored_slope`."""


@evaluate_stored.of(LoadedFlight)
@inlined
def nothing_stored(flight, node):
    """See `evaluate_stored`."""


@evaluate_stored.of(SmoothLoadedFlight)
@inlined
def evaluate_potential(flight, node):
    """See `evaluate_stored`."""
    taylor = flight.taylor
    size = flight.enter.shape[0]
    inputs = taylor.rows.shape[0]
    times_matrix(taylor.rows, node, taylor.parts)
    for j in range(taylor.parts.shape[0] - inputs):
        taylor.parts[inputs + j] = node[size + 1 + j]
    evaluate_energy(taylor)


@chosen
def stored_energy(flight, j):
    """The energy of the smooth forces (j = 0), or its derivative by released parameter j - 1."""


@stored_energy.of(LoadedFlight)
@inlined
def no_energy(flight, j):
    """See `stored_energy`."""
    return 0.0


@stored_energy.of(SmoothLoadedFlight)
@inlined
def smooth_energy(flight, j):
    """See `stored_energy`."""
    return flight.taylor.value[0 if j == 0 else flight.taylor.rows.shape[0] + j]


@chosen
def stored_slope(flight, r):
    """The derivative of that energy by entry r of the state."""


@stored_slope.of(LoadedFlight)
@inlined
def no_slope(flight, r):
    """See `stored_slope`."""
    return 0.0


@stored_slope.of(SmoothLoadedFlight)
@inlined
def energy_slope_by_state(flight, r):
    """See `stored_slope`."""
    total = 0.0
    for i in range(flight.taylor.rows.shape[0]):
        total += flight.taylor.rows[i, r] * flight.taylor.value[1 + i]
    return total


@chosen
def first_kicked(flight):
    """The first entry of (u, v) that the unfolding of a free orbit changes."""


@first_kicked.of(LoadedFlight)
@inlined
def kicked_state(flight):
    """See `first_kicked`."""
    return int64(0)


@first_kicked.of(SmoothLoadedFlight)
@inlined
def kicked_velocity(flight):
    """See `first_kicked`."""
    return int64(flight.enter.shape[0] // 2)
