"""Flights with smooth forces: Taylor series in time, with the derivative by the state, and their paths.

The state z = (u, v) of a flight moves by u' = v, v' = A z + P f(w), where the inputs w of the smooth forces f are linear in z. A step is
the Taylor polynomial of order ORDER of the state and of its derivative by the state at the flight's begin (Jorba & Zou, Experimental
Mathematics 14 (2005) 99). Its length follows from the last coefficients, and is then confirmed inside the step by its defect, the
difference of the polynomial's acceleration from that of the forces along it. The last coefficients alone miss a force that begins with a
high power.

The steps of a flight are kept: they are its path, which searches for extrema and zeros evaluate.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy import int64

from bvp.kernels.compiled import inlined, kernel, sized
from bvp.kernels.expressions import Program, run
from bvp.kernels.extrema import bounds_at, look, track_of
from bvp.kernels.flight import copy_1, set_1, set_2, times_matrix
from bvp.kernels.flights import add_bend, energy_slope, flight_map, flow_product, fly, path_state, rate, slope_times, twice_energy
from bvp.kernels.jets import JetProgram, extend_jets

ORDER = 22
"""Order of the polynomials. The work of a step grows with its square, its length with eps^(-1/ORDER)."""

TRUNCATION = 2e-17
"""Largest last term, as a part of the speed in a step."""

DEFECT = 4e-16
"""Largest change of the velocity by the defect, as a part of that speed: rounding."""

NONE_LEFT = 1e-19
"""Part of the accelerations below which a power of small inputs is left out."""

STEPS = 256
"""Most steps of a flight."""


class Paths(NamedTuple):
    """The steps of J flights, as they were computed."""

    coefficients: np.ndarray  # (J, STEPS, ORDER + 1, N)
    times: np.ndarray  # (J, STEPS + 1) at which the steps begin, and the last one ends
    steps: np.ndarray  # (J, 2) int64 the number of steps, 0: none is kept, -1: it could not be computed; whether the map is known
    begins: np.ndarray  # (J, N + 1) state at the begin, and the duration
    ends: np.ndarray  # (J, N)
    maps: np.ndarray  # (J, N, N) derivatives of the end by the begin
    latest: np.ndarray  # (1,) int64 the flight that was computed last; the next one takes the place after it


class SmoothFlight(NamedTuple):
    """Motion with smooth forces, for N = 2 n states and I inputs of F forces: a kind of flight (`bvp.kernels.flights`)."""

    matrix: np.ndarray  # (N, N) that of z' = B z without the smooth forces
    rows: np.ndarray  # (I, N) the inputs, as rows on states
    push: np.ndarray  # (n, F) accelerations of unit forces
    program: JetProgram
    potential: Program  # the energy of the forces, as a function of the inputs
    jets: np.ndarray  # (registers, ORDER + 1) scratch
    probe: np.ndarray  # (registers, 1) scratch
    states: np.ndarray  # (ORDER + 1, N) scratch
    columns: np.ndarray  # (ORDER + 1, N, N) scratch
    inputs: np.ndarray  # (ORDER + 1, I, N) scratch
    sums: np.ndarray  # (1, N) scratch
    scratch: np.ndarray  # of the potential's program
    parts: np.ndarray  # (I,) its arguments
    value: np.ndarray  # (1,) what it writes
    slope: np.ndarray  # (N,) scratch
    projected: np.ndarray  # (STEPS, ORDER + 1) scratch
    bounds: np.ndarray  # (STEPS, 2) scratch
    paths: Paths


def make_paths(flights, size):
    """Room for the paths of so many flights."""
    return Paths(
        np.zeros((flights, STEPS, ORDER + 1, size)), np.zeros((flights, STEPS + 1)), np.zeros((flights, 2), dtype=np.int64),
        np.zeros((flights, size + 1)), np.zeros((flights, size)), np.zeros((flights, size, size)), np.zeros(1, dtype=np.int64),
    )  # fmt: skip


def make_smooth_flight(matrix, rows, push, program, potential, flights):
    """A `SmoothFlight`, with room for the paths of so many flights."""
    size, inputs = len(matrix), len(rows)
    return SmoothFlight(
        matrix, rows, push, program, potential, np.zeros((program.registers, ORDER + 1)), np.zeros((program.registers, 1)),
        np.zeros((ORDER + 1, size)), np.zeros((ORDER + 1, size, size)), np.zeros((ORDER + 1, inputs, size)), np.zeros((1, size)),
        np.zeros(inputs + len(potential.constants) + len(potential.code)), np.zeros(inputs), np.zeros(1), np.zeros(size),
        np.zeros((STEPS, ORDER + 1)), np.zeros((STEPS, 2)), make_paths(flights, size),
    )  # fmt: skip


@inlined
def smooth_rate(flight, z, least, out):
    """z' at a state z."""
    size = z.shape[0]
    n = size // 2
    for i in range(flight.rows.shape[0]):
        total = 0.0
        for r in range(size):
            total += flight.rows[i, r] * z[r]
        flight.probe[i, 0] = total
    extend_jets(flight.program, flight.probe, int64(0), least)
    for r in range(n):
        out[r] = z[n + r]
        total = 0.0
        for c in range(size):
            total += flight.matrix[n + r, c] * z[c]
        for f in range(flight.push.shape[1]):
            total += flight.push[r, f] * flight.probe[flight.program.forces[f], 0]
        out[n + r] = total


@kernel
def expand(flight, least):
    """The Taylor coefficients of the state about states[0], and the jets of the forces."""
    matrix, rows, push, program, jets, states = flight.matrix, flight.rows, flight.push, flight.program, flight.jets, flight.states
    size = matrix.shape[0]
    n = size // 2
    for k in range(ORDER):
        z = states[k]
        after = states[k + 1]
        part = 1.0 / (k + 1)
        for i in range(rows.shape[0]):
            total = 0.0
            for r in range(size):
                total += rows[i, r] * z[r]
            jets[i, k] = total
        extend_jets(program, jets, k, least)
        for r in range(n):
            after[r] = part * z[n + r]
            total = 0.0
            for c in range(size):
                total += matrix[n + r, c] * z[c]
            for f in range(push.shape[1]):
                total += push[r, f] * jets[program.forces[f], k]
            after[n + r] = part * total


@inlined
def _expand_columns(flight, columns, inputs, sums):
    """The Taylor coefficients of `columns`, about columns[0], from the jets of the derivatives of the forces. sums (1, N): scratch."""
    matrix, rows, push, slopes, jets = flight.matrix, flight.rows, flight.push, flight.program.slopes, flight.jets
    size = columns.shape[2]
    n = size // 2
    for k in range(ORDER):
        for i in range(rows.shape[0]):
            for c in range(size):
                inputs[k, i, c] = 0.0
            for r in range(size):
                factor = rows[i, r]
                for c in range(size):
                    inputs[k, i, c] += factor * columns[k, r, c]
        part = 1.0 / (k + 1)
        for r in range(n):
            for c in range(size):
                columns[k + 1, r, c] = part * columns[k, n + r, c]
                columns[k + 1, n + r, c] = 0.0
            for s in range(size):
                factor = part * matrix[n + r, s]
                if factor != 0.0:
                    for c in range(size):
                        columns[k + 1, n + r, c] += factor * columns[k, s, c]
        for d in range(slopes.shape[0]):
            i = slopes[d, 1]
            slope = jets[slopes[d, 2]]
            for c in range(size):
                sums[0, c] = 0.0
            for j in range(k + 1):
                factor = slope[j]
                for c in range(size):
                    sums[0, c] += factor * inputs[k - j, i, c]
            for r in range(n):
                factor = part * push[r, slopes[d, 0]]
                if factor != 0.0:
                    for c in range(size):
                        columns[k + 1, n + r, c] += factor * sums[0, c]


@inlined
def _advance_columns(columns, h, out):
    """columns[0] = the polynomials at h. out (N, N): scratch."""
    size = columns.shape[2]
    for r in range(size):
        for c in range(0, size, 2):
            first = columns[ORDER, r, c]
            second = columns[ORDER, r, c + 1]
            for k in range(ORDER - 1, -1, -1):
                first = first * h + columns[k, r, c]
                second = second * h + columns[k, r, c + 1]
            out[r, c] = first
            out[r, c + 1] = second
    for r in range(size):
        for c in range(size):
            columns[0, r, c] = out[r, c]


@kernel
def expand_columns(flight):
    """The Taylor coefficients of the columns about columns[0]; those of the state are known."""
    if flight.matrix.shape[0] == 4:
        # The compiler unrolls loops along four entries.
        _expand_columns(flight, sized(flight.columns, 4), sized(flight.inputs, 4), sized(flight.sums, 4))
    else:
        _expand_columns(flight, flight.columns, flight.inputs, flight.sums)


@kernel
def advance_columns(columns, h, out):
    """See `_advance_columns`."""
    if out.shape[0] == 4:
        _advance_columns(sized(columns, 4), h, sized(out, 4))
    else:
        _advance_columns(columns, h, out)


@inlined
def horner(coefficients, t, out):
    """The polynomial (ORDER + 1, N) at t."""
    size = coefficients.shape[1]
    for r in range(size):
        out[r] = coefficients[ORDER, r]
    for k in range(ORDER - 1, -1, -1):
        for r in range(size):
            out[r] = out[r] * t + coefficients[k, r]


@kernel
def _defect(flight, h, least, state, change, slope):
    """How far the acceleration along the polynomial is from that of the forces, at the time h in the step."""
    states = flight.states
    size = states.shape[1]
    n = size // 2
    horner(states, h, state)
    smooth_rate(flight, state, least, change)
    for r in range(size):
        slope[r] = ORDER * states[ORDER, r]
    for k in range(ORDER - 1, 0, -1):
        for r in range(size):
            slope[r] = slope[r] * h + k * states[k, r]
    worst = 0.0
    for r in range(n, size):
        distance = abs(slope[r] - change[r])
        if not distance <= worst:
            worst = distance
    return worst


@kernel
def _step_length(states, columns, with_columns, left):
    """The length at which the last two terms of the velocities are below TRUNCATION."""
    size = states.shape[1]
    n = size // 2
    speed = 0.0
    for r in range(n, size):
        speed = max(speed, abs(states[0, r]))
    length = left
    for _ in range(2):
        # A motion that begins at rest has the speed of its first terms.
        reached = speed
        power = 1.0
        for k in range(1, 4):
            power *= length
            for r in range(n, size):
                reached = max(reached, abs(states[k, r]) * power)
        if reached == 0.0:
            return left, 0.0
        length = left
        for k in range(ORDER - 1, ORDER + 1):
            last = 0.0
            for r in range(n, size):
                last = max(last, abs(states[k, r]))
            if last > 0.0:
                length = min(length, (TRUNCATION * reached / last) ** (1.0 / k))
    if with_columns:
        power = length ** (ORDER - 1)
        for c in range(size):
            first = 0.0
            last = 0.0
            for r in range(n, size):
                first = max(first, abs(columns[0, r, c]), abs(columns[1, r, c]) * length)
                last = max(last, abs(columns[ORDER - 1, r, c]))
            if last * power > TRUNCATION * first and first > 0.0:
                length = min(length, (TRUNCATION * first / last) ** (1.0 / (ORDER - 1)))
                power = length ** (ORDER - 1)
    return length, reached


@kernel
def fly_smooth(flight, slot, z, t, with_columns):
    """Compute a flight of time t from z, and keep it in a slot of the paths. Returns whether it could be computed.

    t < 0: the flight goes back in time."""
    paths, states, columns = flight.paths, flight.states, flight.columns
    size = z.shape[0]
    n = size // 2
    state = paths.ends[slot]
    change = paths.maps[slot, 0]
    slope = paths.maps[slot, 1]
    copy_1(z, paths.begins[slot, :size])
    paths.begins[slot, size] = t
    copy_1(z, states[0])
    set_2(columns[0], 0.0)
    for r in range(size):
        columns[0, r, r] = 1.0
    paths.times[slot, 0] = 0.0
    at = 0.0
    count = 0
    direction = 1.0 if t >= 0.0 else -1.0
    largest = 0.0
    while at < abs(t):
        if count == STEPS:
            paths.steps[slot, 0] = -1
            return False
        smooth_rate(flight, states[0], 0.0, change)
        for r in range(n, size):
            largest = max(largest, abs(change[r]))
        least = NONE_LEFT * largest
        expand(flight, least)
        if with_columns:
            expand_columns(flight)
        length, speed = _step_length(states, columns, with_columns, abs(t) - at)
        if not length > 0.0:
            paths.steps[slot, 0] = -1
            return False
        confirmed = False
        while not confirmed:
            confirmed = True
            for part in range(1, 4):
                h = length * part / 3.0
                if not _defect(flight, direction * h, least, state, change, slope) * h <= ORDER * DEFECT * speed:
                    confirmed = False
                    break
            if not confirmed:
                length *= 0.8
                if at + length == at:
                    paths.steps[slot, 0] = -1
                    return False
        for k in range(ORDER + 1):
            copy_1(states[k], paths.coefficients[slot, count, k])
        at += length
        count += 1
        paths.times[slot, count] = at
        h = direction * length
        horner(states, h, state)
        copy_1(state, states[0])
        if with_columns:
            advance_columns(columns, h, paths.maps[slot])
    copy_1(states[0], state)
    for r in range(size):
        copy_1(columns[0, r], paths.maps[slot, r])
    paths.steps[slot, 0] = count
    paths.steps[slot, 1] = int64(1) if with_columns else int64(0)
    return True


@kernel
def find_path(flight, z, t, with_map):
    """The slot of the flight of time t from z, or of a longer one; it is computed where it is not kept. -1: it could not be computed."""
    paths = flight.paths
    size = z.shape[0]
    for slot in range(paths.steps.shape[0]):
        if paths.steps[slot, 0] == 0:
            continue
        same = paths.begins[slot, size] == t or (not with_map and 0.0 <= t <= paths.begins[slot, size])
        for r in range(size):
            same = same and paths.begins[slot, r] == z[r]
        if same and (not with_map or paths.steps[slot, 1] == 1):
            return slot if paths.steps[slot, 0] > 0 else int64(-1)
    slot = (paths.latest[0] + 1) % paths.steps.shape[0]
    paths.latest[0] = slot
    return slot if fly_smooth(flight, slot, z, t, with_map) else int64(-1)


@fly.of(SmoothFlight)
@inlined
def fly_taylor(flight, z, t, out, jacobian):
    """See `fly`."""
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


@inlined
def _step_at(times, steps, t):
    """The step of a flight that contains the time t."""
    place = int64(0)
    while place < steps - 1 and times[place + 1] <= t:
        place += 1
    return place


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
        place = _step_at(paths.times[slot], paths.steps[slot, 0], t)
        horner(paths.coefficients[slot, place], t - paths.times[slot, place], out)


@rate.of(SmoothFlight)
@inlined
def smooth_state_rate(flight, z, out):
    """See `rate`."""
    smooth_rate(flight, z, 0.0, out)


@twice_energy.of(SmoothFlight)
@inlined
def twice_smooth_energy(flight, weights, z):
    """See `twice_energy`."""
    total = 0.0
    for r in range(z.shape[0]):
        total += weights[r] * z[r] * z[r]
    for i in range(flight.rows.shape[0]):
        along = 0.0
        for r in range(z.shape[0]):
            along += flight.rows[i, r] * z[r]
        flight.parts[i] = along
    run(flight.potential, flight.parts, flight.scratch, flight.value)
    return total + 2.0 * flight.value[0]


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
    smooth_rate(flight, state, 0.0, flight.slope)
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
        smooth_rate(flight, z, 0.0, flight.slope)
        for d in range(flight.program.slopes.shape[0]):
            i = flight.program.slopes[d, 1]
            part = flight.push[e, flight.program.slopes[d, 0]] * flight.probe[flight.program.slopes[d, 2], 0]
            for c in range(n):
                column[c] -= factor * part * flight.rows[i, c] * scale[c]


class SmoothTrack(NamedTuple):
    """A linear functional f(t) = value . z(t) along the path of a flight: a polynomial in each step."""

    projected: np.ndarray  # (STEPS, ORDER + 1) its coefficients
    bounds: np.ndarray  # (STEPS, 2) bounds of |f''| and |f'''| in each step
    times: np.ndarray  # (STEPS + 1,) at which the steps begin
    steps: Any
    level: float  # bound of |f|
    duration: float  # of the flight


@track_of.of(SmoothFlight)
@inlined
def smooth_track(flight, value, rate, second, z, duration, parts):
    """See `track_of`: a `SmoothTrack`. Where the flight has no path, f is no number."""
    slot = find_path(flight, z, duration, False)
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
            for r in range(z.shape[0]):
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
    place = _step_at(track.times, track.steps, t)
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
    place = _step_at(track.times, track.steps, t)
    return track.bounds[place, 0], track.bounds[place, 1], track.times[place + 1]
