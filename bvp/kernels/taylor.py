"""Flights with smooth forces, and their derivatives: the Taylor series of their steps, and the paths that the steps make.

The state z = (u, v) of a flight moves by u' = v, v' = A z + P f(w) + g(t), where the inputs w of the smooth forces f are linear in z, and
the sources g are loads (`bvp.kernels.sources`). A step is the Taylor polynomial of order ORDER of the state and of its derivatives, by the
state at the flight's begin and by what the sources depend on (Jorba & Zou, Experimental Mathematics 14 (2005) 99). Its length follows
from the last coefficients, and is then confirmed inside the step by its defect, the difference of the polynomial's acceleration from that
of the forces along it. The last coefficients alone miss a force that begins with a high power.

The steps of a flight are kept: they are its path, which searches for extrema and zeros evaluate.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy import int64

from bvp.kernels import driving  # noqa: F401  a kind of sources
from bvp.kernels.columns import advance_columns, column_room, expand_columns
from bvp.kernels.compiled import inlined, kernel, shared
from bvp.kernels.expressions import Program
from bvp.kernels.flight import copy_1, inner, set_2
from bvp.kernels.jets import JetProgram, extend_jets
from bvp.kernels.sources import (
    ORDER,
    Unforced,
    begin_sources,
    expand_sources,
    is_enough,
    keep_step,
    number_of_fours,
    plus_source,
    plus_source_now,
    sources_at,
)

TRUNCATION = 1e-16
"""Largest last term, as a part of the speed in a step: rounding. The terms that are left out are smaller."""

COLUMN_TRUNCATION = 1e-15
"""The same of columns, for their last term but one. Shorter steps made derivatives no more exact, where the growth of flights allows ten
digits to sixteen. The defect of columns is not looked at."""

DEFECT = 4e-16
"""Largest change of the velocity by the defect, as a part of that speed: rounding."""

ROUNDING = 4e-16
"""Relative rounding of an input of the forces."""

NONE_LEFT = 1e-19
"""Part of the accelerations, over the largest factor of a force, below which a power of small inputs is left out."""

EARLY = 1e-3
"""Part of a step after which an input that begins at rest has a rate."""

SHORTEST = 1e-14
"""Part of a flight below which a step is too short: the forces are too large for a number, or not smooth."""

STEPS = 256
"""Most steps of a flight of a conservative system."""

UNFORCED = Unforced(0)


class Paths(NamedTuple):
    """The steps of J flights, at most S of each, as they were computed. A flight begins at a node of W entries: its state and more."""

    coefficients: np.ndarray  # (J, S, ORDER + 1, N)
    times: np.ndarray  # (J, S + 1) at which the steps begin, and the last one ends
    # (J, 2) int64: the number of steps, and whether the map is known. 0: none is kept. -1: the flight could not be computed, and how many
    # of its steps could
    steps: np.ndarray
    begins: np.ndarray  # (J, W + 1) node at the begin, and the duration
    ends: np.ndarray  # (J, N)
    maps: np.ndarray  # (J, N, C) derivatives of the end by the state at the begin, and by what the sources depend on
    latest: np.ndarray  # (1,) int64 the flight that was computed last; the next one takes the place after it


class SmoothFlight(NamedTuple):
    """Motion with smooth forces, for N = 2 n states and I inputs of F forces, with C columns of derivatives.

    Without sources it is a kind of flight (`bvp.kernels.flights`): W = C = N."""

    matrix: np.ndarray  # (N, N) that of z' = B z without the smooth forces
    rows: np.ndarray  # (I, N) the inputs, as rows on states
    push: np.ndarray  # (n, F) accelerations of unit forces
    program: JetProgram
    sources: Any  # of `bvp.kernels.sources`
    potential: Program  # the energy of the forces, as a function of the inputs; with released parameters also its derivatives
    jets: np.ndarray  # (registers, ORDER + 1) scratch
    probe: np.ndarray  # (registers, 1) scratch
    states: np.ndarray  # (ORDER + 1, N) scratch
    columns: np.ndarray  # (B, ORDER + 1, N, 4) scratch: in blocks of four columns, the last one filled up with zeros
    inputs: np.ndarray  # (ORDER + 1, I, 4) scratch
    sums: np.ndarray  # (D, 2, 4) scratch, for D derivatives of forces
    # (n + I, N + 1) int64 scratch: for the rows of velocities in the matrix, then for those of inputs, the first entry that is not zero,
    # and behind each entry the next one that is not; N where there is none
    places: np.ndarray
    scratch: np.ndarray  # of the potential's program
    parts: np.ndarray  # its arguments
    value: np.ndarray  # what it writes
    slope: np.ndarray  # (N,) scratch
    rates: np.ndarray  # (I, 2) scratch
    projected: np.ndarray  # (S, ORDER + 1) scratch
    bounds: np.ndarray  # (S, 2) scratch
    paths: Paths


def make_smooth_flight(matrix, rows, push, program, potential, flights, sources=UNFORCED, steps=STEPS):
    """A `SmoothFlight`, with room for the paths of so many flights of so many steps."""
    size, inputs, columns = len(matrix), len(rows), len(matrix) + sources.columns
    # The derivatives by an input follow each other.
    program = program._replace(slopes=program.slopes[np.argsort(program.slopes[:, 1], kind="stable")])
    arguments = inputs + max(0, sources.columns - 1)
    paths = Paths(
        np.zeros((flights, steps, ORDER + 1, size)), np.zeros((flights, steps + 1)), np.zeros((flights, 2), dtype=np.int64),
        np.zeros((flights, columns + 1)), np.zeros((flights, size)), np.zeros((flights, size, columns)), np.zeros(1, dtype=np.int64),
    )  # fmt: skip
    return SmoothFlight(
        matrix, rows, push, program, sources, potential, np.zeros((program.registers, ORDER + 1)), np.zeros((program.registers, 1)),
        np.zeros((ORDER + 1, size)), np.zeros((number_of_fours(columns), ORDER + 1, size, 4)), np.zeros((ORDER + 1, inputs, 4)),
        np.zeros((len(program.slopes), 2, 4)), np.zeros((size // 2 + inputs, size + 1), dtype=np.int64),
        np.zeros(arguments + len(potential.constants) + len(potential.code)), np.zeros(arguments), np.zeros(len(potential.outputs)),
        np.zeros(size), np.zeros((inputs, 2)),
        np.zeros((steps, ORDER + 1)), np.zeros((steps, 2)), paths,
    )  # fmt: skip


@shared("none")
def smooth_rate(flight, z, at, least, out):
    """z' at a state z, at a time of the flight from the node that `begin_sources` was given last."""
    size = flight.matrix.shape[0]
    n = size // 2
    sources_at(flight.sources, at)
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
        out[n + r] = plus_source_now(flight.sources, total, r)


@inlined
def largest_change(flight, velocity, duration):
    """A velocity, or the change by the largest acceleration of the rate in `flight.slope` in a duration, if that is more."""
    size = flight.slope.shape[0]
    for r in range(size // 2, size):
        velocity = max(velocity, abs(flight.slope[r]) * duration)
    return velocity


@inlined
def _find_places(rows, first, places):
    """Write down which entries of rows are not zero, for rows `first` and up of `places`: sums do without the others."""
    count = rows.shape[1]
    for r in range(rows.shape[0]):
        after = count
        for c in range(count - 1, -1, -1):
            places[first + r, c + 1] = after
            if rows[r, c] != 0.0:
                after = c
        places[first + r, 0] = after


@kernel
def expand(flight, at, least):
    """The Taylor coefficients of the state about states[0], which is that at a time of the flight, and the jets of the forces."""
    matrix, rows, push, program, jets, states = flight.matrix, flight.rows, flight.push, flight.program, flight.jets, flight.states
    places = flight.places
    size = matrix.shape[0]
    n = size // 2
    expand_sources(flight.sources, at)
    _find_places(matrix[push.shape[0] :], int64(0), places)
    _find_places(rows, push.shape[0], places)
    for k in range(ORDER):
        z = states[k]
        after = states[k + 1]
        part = 1.0 / (k + 1)
        for i in range(rows.shape[0]):
            total = 0.0
            c = places[n + i, 0]
            while c < size:
                total += rows[i, c] * z[c]
                c = places[n + i, c + 1]
            jets[i, k] = total
        extend_jets(program, jets, k, least)
        for r in range(n):
            after[r] = part * z[n + r]
            total = 0.0
            c = places[r, 0]
            while c < size:
                total += matrix[n + r, c] * z[c]
                c = places[r, c + 1]
            for f in range(push.shape[1]):
                total += push[r, f] * jets[program.forces[f], k]
            after[n + r] = part * plus_source(flight.sources, total, k, r)


@inlined
def horner(coefficients, t, out):
    """The polynomial (ORDER + 1, 2 n) at t."""
    n = coefficients.shape[1] // 2
    for r in range(n):
        place = coefficients[ORDER, r]
        velocity = coefficients[ORDER, n + r]
        for k in range(ORDER - 1, -1, -1):
            place = place * t + coefficients[k, r]
            velocity = velocity * t + coefficients[k, n + r]
        out[r] = place
        out[n + r] = velocity


@inlined
def state_with_acceleration(coefficients, t, out, slope):
    """The same; and the derivative of the velocities, behind n entries of slope."""
    n = coefficients.shape[1] // 2
    for r in range(n):
        place = coefficients[ORDER, r]
        velocity = coefficients[ORDER, n + r]
        acceleration = ORDER * velocity
        for k in range(ORDER - 1, 0, -1):
            place = place * t + coefficients[k, r]
            velocity = velocity * t + coefficients[k, n + r]
            acceleration = acceleration * t + k * coefficients[k, n + r]
        out[r] = place * t + coefficients[0, r]
        out[n + r] = velocity * t + coefficients[0, n + r]
        slope[n + r] = acceleration


@inlined
def step_at(times, steps, t):
    """The step of a flight that contains the time t."""
    place = int64(0)
    while place < steps - 1 and times[place + 1] <= t:
        place += 1
    return place


@kernel
def _defect(flight, at, h, least, state, change, slope):
    """How far the acceleration along the polynomial is from that of the forces, at the time h in the step that begins at a time.

    What the rounding of the state changes in the forces is left out: it is no error of the step."""
    states, slopes = flight.states, flight.program.slopes
    size = states.shape[1]
    n = size // 2
    state_with_acceleration(states, h, state, slope)
    smooth_rate(flight, state, at + h, least, change)
    for r in range(n, size):
        rounding = 0.0
        for c in range(size):
            rounding += abs(flight.matrix[r, c] * state[c])
        slope[r] = abs(slope[r] - change[r]) - ROUNDING * rounding
    for d in range(slopes.shape[0]):
        rounding = 0.0
        for r in range(size):
            rounding += abs(flight.rows[slopes[d, 1], r] * state[r])
        rounding *= ROUNDING * abs(flight.probe[slopes[d, 2], 0])
        for r in range(n, size):
            slope[r] -= rounding * abs(flight.push[r - n, slopes[d, 0]])
    worst = 0.0
    for r in range(n, size):
        if not slope[r] <= worst:
            worst = slope[r]
    return worst


@inlined
def _rate_of_input(flight, i, t):
    """The rate of an input at the time t in a step, by its coefficients."""
    rate = 0.0
    for k in range(ORDER - 1, 0, -1):
        rate = rate * t + k * flight.jets[i, k]
    return rate


@inlined
def _turning_time(flight, i, low, rate_low, high, rate_high):
    """Where an input turns in a step: its rate has other signs at low and high. What lies between is halved six times. In the rest
    the rate is a straight line."""
    for _ in range(6):
        middle = 0.5 * (low + high)
        rate = _rate_of_input(flight, i, middle)
        if (rate > 0.0) == (rate_low > 0.0):
            low, rate_low = middle, rate
        else:
            high, rate_high = middle, rate
    return low + rate_low / (rate_low - rate_high) * (high - low)


@kernel
def _is_confirmed(flight, at, length, least, limit, state, change, slope):
    """Whether the defect of a step changes the velocities by no more than a limit. It is looked at after each third. Where an input has
    rates of other signs at both ends of a third, it is also looked at where the input turns: the force of a near contact is largest there,
    and a step could jump over it."""
    rows, rates = flight.rows, flight.rates
    before = EARLY * length  # the rate of what begins at rest is zero at the begin
    for i in range(rows.shape[0]):
        rates[i, 0] = _rate_of_input(flight, i, before)
    for part in range(1, 4):
        h = length * part / 3.0
        if not _defect(flight, at, h, least, state, change, slope) * abs(h) <= limit:
            return False
        for i in range(rows.shape[0]):
            rates[i, 1] = inner(rows[i], change)
        for i in range(rows.shape[0]):
            if rates[i, 0] * rates[i, 1] < 0.0:
                turn = _turning_time(flight, i, before, rates[i, 0], h, rates[i, 1])
                if not _defect(flight, at, turn, least, state, change, slope) * abs(turn) <= limit:
                    return False
            rates[i, 0] = rates[i, 1]
        before = h
    return True


@kernel
def _step_length(states, columns, with_columns, left):
    """The length at which the last two terms of the velocities are below TRUNCATION, and of the columns' velocities the last but one below
    COLUMN_TRUNCATION."""
    size = states.shape[1]
    n = size // 2
    speed = 0.0
    for r in range(n, size):
        speed = max(speed, abs(states[0, r]))
    length = left
    for attempt in range(2):
        # A motion that begins at rest has the speed of its first terms.
        reached = speed
        power = 1.0
        for k in range(1, 4):
            power *= length
            for r in range(n, size):
                reached = max(reached, abs(states[k, r]) * power)
        if reached == 0.0:
            return left, 0.0
        room = math.inf
        if with_columns and attempt == 1:
            room = COLUMN_TRUNCATION / TRUNCATION * column_room(columns, length)
        length = left
        for k in range(ORDER - 1, ORDER + 1):
            last = 0.0
            for r in range(n, size):
                last = max(last, abs(states[k, r]))
            room = min(room, reached / last)
            if length**k > TRUNCATION * room:
                length = (TRUNCATION * room) ** (1.0 / k)
            room = math.inf
    return length, reached


@kernel
def _natural_acceleration(matrix, z, t):
    """The acceleration that linear springs give a motion with the speeds of a state: at an origin there is none yet."""
    n = matrix.shape[0] // 2
    stiffest = 0.0
    for r in range(n):
        for c in range(n):
            stiffest = max(stiffest, abs(matrix[n + r, c]))
    while_it_grows = min(t, 1.0 / math.sqrt(stiffest)) if stiffest > 0.0 else 0.0
    largest = 0.0
    for r in range(n):
        total = 0.0
        for c in range(n):
            total += abs(matrix[n + r, c] * z[n + c])
        largest = max(largest, total * while_it_grows)
    return largest


@shared("boolean")
def fly_smooth(flight, slot, z, t, with_columns):
    """Compute a flight of time t from a node z, and keep it in a slot of the paths. Returns whether it could be computed.

    t < 0: the flight goes back in time. It can end earlier (`is_enough`)."""
    paths, states, columns = flight.paths, flight.states, flight.columns
    size = states.shape[1]
    width = z.shape[0]
    n = size // 2
    state = paths.ends[slot]
    change = paths.maps[slot, 0]
    slope = paths.maps[slot, 1]
    copy_1(z, paths.begins[slot, :width])
    paths.begins[slot, width] = t
    copy_1(z[:size], states[0])
    begin_sources(flight.sources, z)
    for block in range(columns.shape[0]):
        set_2(columns[block, 0], 0.0)
    for r in range(size):
        columns[r // 4, 0, r, r % 4] = 1.0
    paths.times[slot, 0] = 0.0
    at = 0.0
    count = 0
    direction = 1.0 if t >= 0.0 else -1.0
    largest = _natural_acceleration(flight.matrix, z, abs(t))
    weight = 1.0
    for r in range(n):
        for f in range(flight.push.shape[1]):
            weight = max(weight, abs(flight.push[r, f]))
    for i in range(flight.program.numbers.shape[0]):
        weight = max(weight, weight * abs(flight.program.numbers[i]))
    paths.steps[slot, 0] = -1
    while at < abs(t) and not is_enough(flight.sources, count, with_columns):
        paths.steps[slot, 1] = count
        if count == paths.coefficients.shape[1]:
            return False
        here = direction * at
        smooth_rate(flight, states[0], here, 0.0, change)
        for r in range(n, size):
            largest = max(largest, abs(change[r]))
        least = NONE_LEFT * largest / weight
        expand(flight, here, least)
        if with_columns:
            expand_columns(flight, here)
        length, speed = _step_length(states, columns, with_columns, abs(t) - at)
        if not (length > SHORTEST * abs(t) or length == abs(t) - at):
            return False
        limit = ORDER * DEFECT * speed
        while not _is_confirmed(flight, here, direction * length, least, limit, state, change, slope):
            length *= 0.8
            if not length > SHORTEST * abs(t):
                return False
        keep_step(flight.sources, flight, least, paths.coefficients[slot, count])
        at += length
        count += 1
        paths.times[slot, count] = at
        h = direction * length
        horner(states, h, state)
        copy_1(state, states[0])
        if with_columns:
            advance_columns(columns, h)
    if at < abs(t):
        paths.begins[slot, width] = direction * at
    copy_1(states[0], state)
    for r in range(size):
        for c in range(paths.maps.shape[2]):
            paths.maps[slot, r, c] = columns[c // 4, 0, r, c % 4]
    paths.steps[slot, 0] = count
    paths.steps[slot, 1] = int64(1) if with_columns else int64(0)
    return True


@shared("integer")
def find_path(flight, z, t, with_map):
    """The slot of the flight of time t from a node z, or of a longer one, which is computed where it is not kept. -1: it could not be."""
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
