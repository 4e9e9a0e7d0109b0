"""Flights of a simulation with smooth forces: pieces of a few Taylor steps, which are kept, and bounds along their polynomials.

The state of a flight is Z = (q, p, y, f, f', f''): displacements and velocities in the modes of the linear part, the states y of the loads
(`bvp.forcing`), and the F smooth forces with two derivatives by time. The last three follow from the others. With them, gaps, their rates
and accelerations, and the forces of sticking contacts are rows on Z. `bvp.kernels.smooth_motion` has the contact modes of such flights.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy import int64

from bvp.kernels.compiled import inlined, kernel, shared
from bvp.kernels.expressions import run
from bvp.kernels.flight import fastest_rate, inner, times_matrix
from bvp.kernels.flights import (
    NEAR_REACH,
    NEAR_TERMS,
    along_path,
    begin_path,
    bounds_window,
    carry_change,
    fastest,
    hold_path,
    parting,
    path_bounds,
    path_growth,
    path_state,
    potential_energy,
    rate,
    rounding_level,
    series,
)
from bvp.kernels.sources import ORDER
from bvp.kernels.taylor import SmoothFlight, fly_smooth, horner, step_at

PIECE = 8
"""Most steps of a flight: where an impact ends it early, the rest was computed in vain."""

ROOM = 32 * PIECE
"""Steps that are kept of a flight, at most. From its begin to an event, or to the end of a period, it is computed again at once, with the
derivatives: in a slow load's period that takes many steps."""

MARGIN = 1.0 + 1e-12
"""Bounds are widened by this, more than their own rounding."""


class MotionFlight(NamedTuple):
    """The flight of one contact mode."""

    pairs: np.ndarray  # (P, 2)
    matrix: np.ndarray  # (N, N)
    taylor: SmoothFlight
    mode: Any  # its number
    owner: np.ndarray
    current: np.ndarray
    polynomials: np.ndarray


@shared("float")
def find_piece(flight, z, t, most):
    """Compute the flight from Z that lasts t, or find it among those that are kept. It becomes the current one.

    Returns the time up to which it is known, after so many steps at most; -1 where it cannot be computed."""
    taylor = flight.taylor
    paths = taylor.paths
    width = paths.begins.shape[1] - 1
    for slot in range(paths.steps.shape[0]):
        if paths.steps[slot, 0] <= 0 or flight.owner[slot] != flight.mode:
            continue
        until = paths.begins[slot, width]
        same = 0.0 <= t <= until or until == t
        for r in range(width):
            same = same and paths.begins[slot, r] == z[r]
        if same:
            flight.current[0] = slot
            return abs(t)
    slot = (paths.latest[0] + 1) % paths.steps.shape[0]
    paths.latest[0] = slot
    flight.owner[slot] = flight.mode
    flight.current[0] = slot
    taylor.sources.most[0] = most
    # A flight that takes no time has a path, too: derivatives are taken from it.
    if not fly_smooth(taylor, slot, z[:width], t if t != 0.0 else 1e-9, False):
        return -1.0
    return min(abs(t), abs(paths.begins[slot, width]))


@kernel
def is_finite_piece(flight):
    """Whether Z is finite in the last step of the current path: the derivatives of a force overflow before the state does."""
    paths = flight.taylor.paths
    slot = flight.current[0]
    last = paths.steps[slot, 0] - 1
    h = paths.times[slot, last + 1] - paths.times[slot, last]
    coefficients = paths.coefficients[slot, last]
    for r in range(coefficients.shape[1]):
        total = 0.0
        for k in range(ORDER, -1, -1):
            total = total * h + abs(coefficients[k, r])
        if not total < math.inf:
            return False
    return True


@begin_path.of(MotionFlight)
@inlined
def begin_piece(flight, z, horizon):
    """See `begin_path`."""
    known = find_piece(flight, z, horizon, PIECE)
    return known if known < 0.0 or is_finite_piece(flight) else -1.0


@hold_path.of(MotionFlight)
@inlined
def hold_piece(flight, z, t):
    """See `hold_path`."""
    find_piece(flight, z, t, ROOM)


@inlined
def on_piece(flight, t, out):
    """out = Z at the time t of the current path, which can go back."""
    paths = flight.taylor.paths
    slot = flight.current[0]
    place = step_at(paths.times[slot], paths.steps[slot, 0], abs(t))
    at = abs(t) - paths.times[slot, place]
    horner(paths.coefficients[slot, place], at if t >= 0.0 else -at, out)


@along_path.of(MotionFlight)
@kernel
def along_piece(flight, z, t, out):
    """See `along_path`."""
    on_piece(flight, t, out)


@path_state.of(MotionFlight)
@kernel
def piece_state(flight, z, t, out):
    """See `path_state`."""
    if find_piece(flight, z, t, ROOM) < 0.0:
        for r in range(out.shape[0]):
            out[r] = math.nan
    else:
        on_piece(flight, t, out)


@shared("integer")
def map_of_piece(flight, z, t):
    """The path that has the derivative of the flight of time t from Z by its state; -1 where it cannot be computed."""
    taylor = flight.taylor
    paths = taylor.paths
    width = paths.begins.shape[1] - 1
    for slot in range(paths.steps.shape[0]):
        same = paths.steps[slot, 0] > 0 and paths.steps[slot, 1] == 1 and flight.owner[slot] == flight.mode
        same = same and paths.begins[slot, width] == t
        for r in range(width):
            same = same and paths.begins[slot, r] == z[r]
        if same:
            return slot
    slot = (paths.latest[0] + 1) % paths.steps.shape[0]
    paths.latest[0] = slot
    flight.owner[slot] = flight.mode
    return slot if fly_smooth(taylor, slot, z[:width], t, True) else int64(-1)


@carry_change.of(MotionFlight)
@kernel
def carry_over_piece(flight, z, change, t, out):
    """See `carry_change`: of displacements and velocities. What follows from these is left at 0, and the loads do not change."""
    size = flight.taylor.matrix.shape[0]
    for r in range(out.shape[0]):
        out[r] = change[r] if r < size else 0.0
    if t == 0.0:
        return
    slot = map_of_piece(flight, z, t)
    for r in range(size):
        out[r] = inner(flight.taylor.paths.maps[slot, r], change[:size]) if slot >= 0 else math.nan


@rate.of(MotionFlight)
@inlined
def piece_rate(flight, z, out):
    """See `rate`: of Z, but for the second derivatives of the forces."""
    times_matrix(flight.matrix, z, out)


@potential_energy.of(MotionFlight)
@kernel
def piece_energy(flight, z):
    """See `potential_energy`."""
    taylor = flight.taylor
    times_matrix(taylor.rows, z[: taylor.matrix.shape[0]], taylor.parts)
    run(taylor.potential, taylor.parts, taylor.scratch, taylor.value)
    return taylor.value[0]


@path_growth.of(MotionFlight)
@inlined
def piece_growth(flight):
    """See `path_growth`: bounds hold in one step each."""
    return False, 1e-300


@bounds_window.of(MotionFlight)
@inlined
def step_window(flight, t, window):
    """See `bounds_window`: up to the end of the Taylor step."""
    paths = flight.taylor.paths
    slot = flight.current[0]
    place = step_at(paths.times[slot], paths.steps[slot, 0], t)
    return min(window, paths.times[slot, place + 1] - t)


@inlined
def project_step(flight, rows, c, place, out):
    """out (ORDER + 1,) = the coefficients of rows[c] . Z in a step of the current path. Returns the step's length."""
    paths = flight.taylor.paths
    slot = flight.current[0]
    coefficients = paths.coefficients[slot, place]
    for k in range(ORDER + 1):
        out[k] = 0.0
    for r in range(coefficients.shape[1]):
        factor = rows[c, r]
        if factor != 0.0:
            for k in range(ORDER + 1):
                out[k] += factor * coefficients[k, r]
    return paths.times[slot, place + 1] - paths.times[slot, place]


@path_bounds.of(MotionFlight)
@kernel
def step_bounds(flight, rows, c, t, state, window):
    """See `path_bounds`: over the Taylor step at t."""
    paths = flight.taylor.paths
    slot = flight.current[0]
    row = flight.polynomials[0]
    h = project_step(flight, rows, c, step_at(paths.times[slot], paths.steps[slot, 0], t), row)
    level = 0.0
    bend = 0.0
    jerk = 0.0
    for k in range(ORDER, -1, -1):
        level = level * h + abs(row[k])
        if k > 1:
            bend = bend * h + k * (k - 1) * abs(row[k])
        if k > 2:
            jerk = jerk * h + k * (k - 1) * (k - 2) * abs(row[k])
    return level * MARGIN, bend * MARGIN, jerk * MARGIN


@fastest.of(MotionFlight)
@inlined
def fastest_smooth(flight):
    """See `fastest`: of the linear part, and of the series that began last. Its length is a sixth of where it converges."""
    paths = flight.taylor.paths
    return max(fastest_rate(flight), 1.0 / (6.0 * paths.times[flight.current[0], 1]))


@parting.of(MotionFlight)
@kernel
def piece_parting(flight, contacts, c, z, horizon, window, state, other, further):
    """See `parting`: by the Taylor coefficients of the first step."""
    row = flight.polynomials[0]
    h = project_step(flight, contacts.gap, c, int64(0), row)
    coefficients = flight.taylor.paths.coefficients[flight.current[0], 0]
    order = 3
    while order * (order - 1) * abs(row[order]) <= rounding_level(flight, contacts.acceleration, c, coefficients[order - 2]):
        order += 1
        if order > ORDER:
            return 0.0, 0
    lead = -contacts.side[c] * row[order]
    if lead < 0.0:
        return 0.0, order
    # lead t^order exceeds the rest of the series for all shorter times.
    rest = 0.0
    for k in range(ORDER, order, -1):
        rest = rest * h + abs(row[k])
    return min(lead / rest, h) if rest > 0.0 else h, order


@series.of(MotionFlight)
@kernel
def piece_series(flight, contacts, c, z, coefficients, state, other):
    """See `series`: of the first step. The terms that are left out are those of a third of it, below 1e-19."""
    row = flight.polynomials[0]
    h = project_step(flight, contacts.gap, c, int64(0), row)
    for k in range(1, NEAR_TERMS + 1):
        coefficients[k] = -contacts.side[c] * row[k]
    return NEAR_REACH / (0.3 * h)
