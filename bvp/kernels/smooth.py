"""Flights with smooth forces: Taylor series in time, with the derivative by the state, and their paths.

The state z = (u, v) of a flight moves by u' = v, v' = A z + P f(w), where the inputs w of the smooth forces f are linear in z. A step is
the Taylor polynomial of order ORDER of the state and of its derivative by the state at the flight's begin (Jorba & Zou, Experimental
Mathematics 14 (2005) 99). Its length follows from the last coefficients, and is then confirmed inside the step by its defect, the
difference of the polynomial's acceleration from that of the forces along it. The last coefficients alone miss a force that begins with a
high power.

The steps of a flight are kept: they are its path, which searches for extrema and zeros evaluate.
"""

from typing import NamedTuple

import numpy as np
from numpy import int64

from bvp.kernels.compiled import inlined, kernel
from bvp.kernels.flight import copy_1, set_2
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
    steps: np.ndarray  # (J,) int64 how many steps a flight has; 0: nothing is kept; -1: it could not be computed
    begins: np.ndarray  # (J, N + 1) state at the begin, and the duration
    ends: np.ndarray  # (J, N)
    maps: np.ndarray  # (J, N, N) derivatives of the end by the begin
    latest: np.ndarray  # (1,) int64 the flight that was computed last


class SmoothFlight(NamedTuple):
    """Motion between impacts with smooth forces, for N = 2 n states and I inputs of F forces."""

    matrix: np.ndarray  # (N, N) that of z' = B z without the smooth forces
    rows: np.ndarray  # (I, N) the inputs, as rows on states
    push: np.ndarray  # (n, F) accelerations of unit forces
    program: JetProgram
    jets: np.ndarray  # (registers, ORDER + 1) scratch
    probe: np.ndarray  # (registers, 1) scratch
    states: np.ndarray  # (ORDER + 1, N) scratch
    columns: np.ndarray  # (ORDER + 1, N, N) scratch
    inputs: np.ndarray  # (ORDER + 1, I, N) scratch
    paths: Paths


def make_paths(flights, size):
    """Room for the paths of so many flights."""
    return Paths(
        np.zeros((flights, STEPS, ORDER + 1, size)), np.zeros((flights, STEPS + 1)), np.zeros(flights, dtype=np.int64),
        np.zeros((flights, size + 1)), np.zeros((flights, size)), np.zeros((flights, size, size)), np.zeros(1, dtype=np.int64),
    )  # fmt: skip


def make_smooth_flight(matrix, rows, push, program, flights):
    """A `SmoothFlight`, with room for the paths of so many flights."""
    size, inputs = len(matrix), len(rows)
    return SmoothFlight(
        matrix, rows, push, program, np.zeros((program.registers, ORDER + 1)), np.zeros((program.registers, 1)),
        np.zeros((ORDER + 1, size)), np.zeros((ORDER + 1, size, size)), np.zeros((ORDER + 1, inputs, size)), make_paths(flights, size),
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
def expand(flight, with_columns, least):
    """The Taylor coefficients of state and columns about states[0] and columns[0]."""
    matrix, rows, push, program, jets, _, states, columns, inputs, _ = flight
    size = matrix.shape[0]
    n = size // 2
    for k in range(ORDER):
        z = states[k]
        after = states[k + 1]
        for i in range(rows.shape[0]):
            total = 0.0
            for r in range(size):
                total += rows[i, r] * z[r]
            jets[i, k] = total
        extend_jets(program, jets, k, least)
        for r in range(n):
            after[r] = z[n + r] / (k + 1)
            total = 0.0
            for c in range(size):
                total += matrix[n + r, c] * z[c]
            for f in range(push.shape[1]):
                total += push[r, f] * jets[program.forces[f], k]
            after[n + r] = total / (k + 1)
        if not with_columns:
            continue
        x = columns[k]
        later = columns[k + 1]
        for i in range(rows.shape[0]):
            for c in range(size):
                total = 0.0
                for r in range(size):
                    total += rows[i, r] * x[r, c]
                inputs[k, i, c] = total
        for r in range(n):
            for c in range(size):
                later[r, c] = x[n + r, c] / (k + 1)
                later[n + r, c] = 0.0
            for s in range(size):
                factor = matrix[n + r, s]
                if factor != 0.0:
                    for c in range(size):
                        later[n + r, c] += factor * x[s, c]
        for d in range(program.slopes.shape[0]):
            slope = jets[program.slopes[d, 2]]
            i = program.slopes[d, 1]
            # The product's coefficient is summed in the row that the last coefficient has room for.
            total_row = columns[ORDER, 0]
            for c in range(size):
                total_row[c] = 0.0
            for j in range(k + 1):
                factor = slope[j]
                line = inputs[k - j, i]
                for c in range(size):
                    total_row[c] += factor * line[c]
            for r in range(n):
                factor = push[r, program.slopes[d, 0]]
                if factor != 0.0:
                    for c in range(size):
                        later[n + r, c] += factor * total_row[c]
        for r in range(n):
            for c in range(size):
                later[n + r, c] /= k + 1


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
def _defect(flight, h, least, state, rate, slope):
    """How far the acceleration along the polynomial is from that of the forces, at the time h in the step."""
    states = flight.states
    size = states.shape[1]
    n = size // 2
    horner(states, h, state)
    smooth_rate(flight, state, least, rate)
    for r in range(size):
        slope[r] = ORDER * states[ORDER, r]
    for k in range(ORDER - 1, 0, -1):
        for r in range(size):
            slope[r] = slope[r] * h + k * states[k, r]
    worst = 0.0
    for r in range(n, size):
        distance = abs(slope[r] - rate[r])
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
        for c in range(size):
            first = 0.0
            last = 0.0
            for r in range(n, size):
                first = max(first, abs(columns[0, r, c]), abs(columns[1, r, c]) * length)
                last = max(last, abs(columns[ORDER - 1, r, c]))
            if last * length ** (ORDER - 1) > TRUNCATION * first and first > 0.0:
                length = min(length, (TRUNCATION * first / last) ** (1.0 / (ORDER - 1)))
    return length, reached


@kernel
def fly_smooth(flight, slot, z, t, with_columns):
    """Compute a flight of time t from z, and keep it in a slot of the paths. Returns whether it could be computed.

    t < 0: the flight goes back in time."""
    paths, states, columns = flight.paths, flight.states, flight.columns
    size = z.shape[0]
    n = size // 2
    state = paths.ends[slot]
    rate = paths.maps[slot, 0]
    slope = paths.maps[slot, 1]
    paths.latest[0] = slot
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
            paths.steps[slot] = -1
            return False
        smooth_rate(flight, states[0], 0.0, rate)
        for r in range(n, size):
            largest = max(largest, abs(rate[r]))
        least = NONE_LEFT * largest
        expand(flight, with_columns, least)
        length, speed = _step_length(states, columns, with_columns, abs(t) - at)
        if not length > 0.0:
            paths.steps[slot] = -1
            return False
        confirmed = False
        while not confirmed:
            confirmed = True
            for part in range(1, 4):
                h = length * part / 3.0
                if not _defect(flight, direction * h, least, state, rate, slope) * h <= ORDER * DEFECT * speed:
                    confirmed = False
                    break
            if not confirmed:
                length *= 0.8
                if at + length == at:
                    paths.steps[slot] = -1
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
            for r in range(size):
                for c in range(size):
                    total = columns[ORDER, r, c]
                    for k in range(ORDER - 1, -1, -1):
                        total = total * h + columns[k, r, c]
                    columns[0, r, c] = total
    copy_1(states[0], state)
    for r in range(size):
        copy_1(columns[0, r], paths.maps[slot, r])
    paths.steps[slot] = count
    return True
