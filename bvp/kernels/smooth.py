"""Flights with smooth forces: the kind of flight that `bvp.kernels.taylor` computes, its energy, and functionals along its path.

The steps of a flight are kept: they are its path, which searches for extrema and zeros evaluate.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy import int64

from bvp.kernels.compiled import inlined, kernel
from bvp.kernels.extrema import bounds_at, look, track_of
from bvp.kernels.flight import copy_1, set_1, set_2, times_matrix
from bvp.kernels.flights import (
    add_bend,
    comes_with_map,
    energy_slope,
    flight_end,
    flight_map,
    flow_product,
    path_state,
    rate,
    slope_times,
    squared_speed,
    twice_energy,
    velocity_unit,
)
from bvp.kernels.sources import ORDER
from bvp.kernels.taylor import (
    SmoothFlight,
    evaluate_energy,
    find_path,
    horner,
    largest_change,
    smooth_rate,
    state_with_acceleration,
    step_at,
)


@flight_end.of(SmoothFlight)
@inlined
def fly_taylor(flight, z, t, out, jacobian):
    """See `flight_end`."""
    slot = find_path(flight, z, t, True)
    if slot < 0:
        set_1(out, math.nan)
        set_2(jacobian, math.nan)
    else:
        copy_1(flight.paths.ends[slot], out)
        for r in range(out.shape[0]):
            copy_1(flight.paths.maps[slot, r], jacobian[r])


@flight_map.of(SmoothFlight)
@inlined
def taylor_map(flight, z, t, jacobian):
    """See `flight_map`."""
    slot = find_path(flight, z, t, True)
    if slot < 0:
        set_2(jacobian, math.nan)
    else:
        for r in range(z.shape[0]):
            copy_1(flight.paths.maps[slot, r], jacobian[r])


@flow_product.of(SmoothFlight)
@inlined
def dense_flow_product(flight, flow, z, out):
    """See `flow_product`."""
    times_matrix(flow, z, out)


@path_state.of(SmoothFlight)
@inlined
def taylor_path_state(flight, z, t, out):
    """See `path_state`."""
    slot = find_path(flight, z, t, False)
    paths = flight.paths
    if slot < 0:
        set_1(out, math.nan)
    elif t == paths.begins[slot, z.shape[0]]:
        copy_1(paths.ends[slot], out)
    else:
        place = step_at(paths.times[slot], paths.steps[slot, 0], t)
        horner(paths.coefficients[slot, place], t - paths.times[slot, place], out)


@rate.of(SmoothFlight)
@inlined
def smooth_state_rate(flight, z, out):
    """See `rate`."""
    smooth_rate(flight, z, 0.0, 0.0, out)


@velocity_unit.of(SmoothFlight)
@inlined
def smooth_velocity_unit(flight, end, velocity, duration):
    """See `velocity_unit`."""
    smooth_rate(flight, end, 0.0, 0.0, flight.slope)
    return largest_change(flight, velocity, duration)


@comes_with_map.of(SmoothFlight)
@inlined
def comes_with_taylor_map(flight):
    """See `comes_with_map`."""
    return True


@twice_energy.of(SmoothFlight)
@inlined
def twice_smooth_energy(flight, weights, z):
    """See `twice_energy`."""
    total = 0.0
    for r in range(z.shape[0]):
        total += weights[r] * z[r] * z[r]
    times_matrix(flight.rows, z, flight.parts)
    evaluate_energy(flight)
    return total + 2.0 * flight.value[0]


@squared_speed.of(SmoothFlight)
@inlined
def smooth_squared_speed(flight, weights, z):
    """See `squared_speed`."""
    return twice_smooth_energy(flight, weights, z)


class SmoothSlope(NamedTuple):
    """grad H at a state."""

    entries: np.ndarray  # (N,)


@energy_slope.of(SmoothFlight)
@inlined
def smooth_slope(flight, weights, z, scale):
    """See `energy_slope`: in modal coordinates, the part of the displacements is minus the acceleration."""
    n = z.shape[0] // 2
    state = flight.states[ORDER]
    for r in range(2 * n):
        state[r] = z[r] * scale
    smooth_rate(flight, state, 0.0, 0.0, flight.slope)
    for r in range(n):
        flight.slope[r] = -flight.slope[n + r]
        flight.slope[n + r] = state[n + r]
    return SmoothSlope(flight.slope)


@slope_times.of(SmoothSlope)
@inlined
def smooth_slope_times(slope, r, factor):
    """See `slope_times`."""
    return factor * slope.entries[r]


@add_bend.of(SmoothFlight)
@inlined
def smooth_bend(flight, z, factor, e, scale, column):
    """See `add_bend`."""
    n = z.shape[0] // 2
    if e < n:
        smooth_rate(flight, z, 0.0, 0.0, flight.slope)
        for d in range(flight.program.slopes.shape[0]):
            i = flight.program.slopes[d, 1]
            part = flight.push[e, flight.program.slopes[d, 0]] * flight.probe[flight.program.slopes[d, 2], 0]
            for c in range(n):
                column[c] -= factor * part * flight.rows[i, c] * scale[c]


class SmoothTrack(NamedTuple):
    """A linear functional f(t) = value . z(t) along the path of a flight: a polynomial in each step."""

    projected: np.ndarray  # (S, ORDER + 1) its coefficients
    bounds: np.ndarray  # (S, 2) bounds of |f''| and |f'''| in each step
    times: np.ndarray  # (S + 1,) at which the steps begin
    steps: Any
    level: float  # bound of |f|
    duration: float  # of the flight


@track_of.of(SmoothFlight)
@inlined
def smooth_track(flight, value, rate, second, z, duration, parts):
    """See `track_of`: a `SmoothTrack`."""
    return track_along(flight, find_path(flight, z, duration, False), value, duration)


@inlined
def track_along(flight, slot, value, duration):
    """The `SmoothTrack` of value . z on a path. Where there is none, slot -1, f is no number."""
    paths = flight.paths
    steps = paths.steps[slot, 0] if slot >= 0 else int64(1)
    level = 0.0
    for place in range(steps):
        row = flight.projected[place]
        if slot < 0:
            set_1(row, math.nan)
            continue
        for k in range(ORDER + 1):
            total = 0.0
            for r in range(value.shape[0]):
                total += value[r] * paths.coefficients[slot, place, k, r]
            row[k] = total
        h = paths.times[slot, place + 1] - paths.times[slot, place]
        reach = 0.0
        bend = 0.0
        jerk = 0.0
        for k in range(ORDER, -1, -1):
            reach = reach * h + abs(row[k])
            if k > 1:
                bend = bend * h + k * (k - 1) * abs(row[k])
            if k > 2:
                jerk = jerk * h + k * (k - 1) * (k - 2) * abs(row[k])
        level = max(level, reach)
        flight.bounds[place, 0] = bend * (1.0 + 1e-12)
        flight.bounds[place, 1] = jerk * (1.0 + 1e-12)
    return SmoothTrack(flight.projected, flight.bounds, paths.times[max(slot, int64(0))], steps, level, duration)


@look.of(SmoothTrack)
@inlined
def look_along(track, t):
    """See `look`."""
    place = step_at(track.times, track.steps, t)
    row = track.projected[place]
    x = t - track.times[place]
    f = 0.0
    slope = 0.0
    bend = 0.0
    for k in range(ORDER, -1, -1):
        bend = bend * x + slope
        slope = slope * x + f
        f = f * x + row[k]
    return f, slope, 2.0 * bend


@bounds_at.of(SmoothTrack)
@inlined
def smooth_bounds(track, t):
    """See `bounds_at`."""
    place = step_at(track.times, track.steps, t)
    return track.bounds[place, 0], track.bounds[place, 1], track.times[place + 1]


@inlined
def _across(row, t, of_distance, state, change):
    """Of the speed, v . a and the part of v across a; or of the distance from the origin, u . v and the part of u across v; n = 2, at the
    time t in a step with the coefficients `row`."""
    state_with_acceleration(row, t, state, change)
    x, y = state[2], state[3]
    a, b = change[2], change[3]
    if of_distance:
        x, y, a, b = state[0], state[1], x, y
    size = math.sqrt(a * a + b * b)
    return x * a + y * b, (x * b - y * a) / size if size > 0.0 else 0.0


@kernel
def least_values(flight, slot, of_distance, parts, times, values):
    """The times at which the speed on a path is least, or the distance from the origin, n = 2; with what `_across` gives there.

    Each step is looked at in so many parts. Returns how many there are; those beyond the length of `times` are not kept."""
    paths = flight.paths
    state, change = flight.slope, flight.states[ORDER]
    count = 0
    for place in range(paths.steps[slot, 0]):
        row = paths.coefficients[slot, place]
        begin = paths.times[slot, place]
        length = paths.times[slot, place + 1] - begin
        before, _ = _across(row, 0.0, of_distance, state, change)
        for part in range(parts):
            low = length * part / parts
            high = length * (part + 1) / parts
            after, _ = _across(row, high, of_distance, state, change)
            if before < 0.0 and after >= 0.0:
                f_low = before
                f_high = after
                root = low
                value = 0.0
                for _ in range(60):
                    root = low + f_low / (f_low - f_high) * (high - low)
                    f, value = _across(row, root, of_distance, state, change)
                    # Illinois' rule: the value of an end that stays is halved.
                    if f < 0.0:
                        low = root
                        f_low = f
                        f_high *= 0.5
                    else:
                        high = root
                        f_high = f
                        f_low *= 0.5
                    if f == 0.0 or high - low <= 1e-15 * length or not low <= root <= high:
                        break
                if count < times.shape[0]:
                    times[count] = begin + root
                    values[count] = value
                count += 1
            before = after
    return count
