"""Functionals along the path of a flight with smooth forces, of the kind that `bvp.kernels.taylor` computes.

The steps of a flight are kept: they are its path, which searches for extrema and zeros evaluate.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy import int64

from bvp.kernels.compiled import inlined
from bvp.kernels.extrema import bounds_at, look, track_of
from bvp.kernels.flight import copy_1, set_1
from bvp.kernels.flights import path_state
from bvp.kernels.sources import ORDER
from bvp.kernels.taylor import SmoothFlight, find_path, horner, step_at


class SmoothTrack(NamedTuple):
    """A linear functional f(t) = value . z(t) along the path of a flight: a polynomial in each step."""

    projected: np.ndarray  # (S, ORDER + 1) its coefficients
    bounds: np.ndarray  # (S, 2) bounds of |f''| and |f'''| in each step
    times: np.ndarray  # (S + 1,) at which the steps begin
    steps: Any
    level: float  # bound of |f|
    duration: float  # of the flight


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
