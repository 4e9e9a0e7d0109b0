"""Second derivatives of linear flights, impacts and releases: equations (38), (42) and (43).

With its loads a flight is autonomous: the states (u, v), 1 for a constant load, and the cosine and sine of each harmonic form a state xi of
s entries, xi' = A xi. Its end is exp(A t) xi. The matrix A depends on the parameters alone, so that its derivatives are those of
`bvp.kernels.nilpotent`. Those by states, times and phases are explicit.

Where the stops S stick, M^-1 is replaced by W = P M^-1. One stop after the other is taken away: W -= W c c' W/(c W c).

What does not depend on the direction of a second derivative is kept for the orbit at which it was computed (`bend_orbit`).
"""

import math
from typing import NamedTuple

import numpy as np

from bvp.kernels.compiled import inlined, kernel
from bvp.kernels.expressions import Program, run
from bvp.kernels.flight import inner, set_1
from bvp.kernels.nilpotent import coefficients, exponential, invert, multiply, place_of


class Work(NamedTuple):
    """Scratch."""

    mass: np.ndarray  # (n, G n)
    flexible: np.ndarray  # (n, G n) W
    square: np.ndarray  # (2, n, G n)
    project: np.ndarray  # (s, G s) P
    drive: np.ndarray  # (n, G s) [-K, -C, loads]
    driven: np.ndarray  # (n, G s)
    rates: np.ndarray  # (s, G s) A
    flow: np.ndarray  # (s, G s) exp(A t)
    powers: np.ndarray  # (5, s, G s)
    units: np.ndarray  # (s,)
    column: np.ndarray  # (2, n, G)
    row: np.ndarray  # (1, G n)
    number: np.ndarray  # (4, 1, G)
    force: np.ndarray  # (1, G s)
    lines: np.ndarray  # (4, max(s, m + 2))
    first: np.ndarray  # (2 n, N + 1) derivative of the end of a flight by its node and its time
    second: np.ndarray  # (2 n, N + 1) the derivative of that along a direction


class BentOrbit(NamedTuple):
    """What is kept of an orbit: its parameters' entries, flights and impacts."""

    at: np.ndarray  # (u,) the orbit
    entries: np.ndarray  # (G, E)
    phase: np.ndarray  # (k + 1, 4, s) behind the state of a node: those of the loads, and their derivatives by its time
    flow: np.ndarray  # (k + 1, 1 + m, 2 n, s) exp(A t) and its derivatives by the parameters
    turn: np.ndarray  # (k + 1, 3, 2 n, s) its first three derivatives by t
    end: np.ndarray  # (k + 1, 2 n) the end of the flight
    by_parameter: np.ndarray  # (k + 1, G, 2 n) its derivatives by the parameters, first and second
    rate: np.ndarray  # (k + 1, 2 + m, 2 n) those by t: once, twice, and once with each parameter
    push: np.ndarray  # (k + 2, G, n) velocity that an impact takes away for a unit of speed
    force: np.ndarray  # (k + 1, 1 + m, s) contact force that opens a stop after the flight, by the state of the node there
    force_bend: np.ndarray  # (k + 1, G) that force, and its derivatives by the parameters


class Bending(NamedTuple):
    """What the kernels know of a problem with n coordinates, S stops, F contact modes, H harmonics and m parameters, whose nodes have k + 2
    rows. G as in `bvp.kernels.nilpotent`, s = 2 n + q with the number q of states of the loads. Rows as in `LoadedSegment`."""

    gap: np.ndarray  # (k + 2, N)
    contact: np.ndarray  # (k + 2, 2) int64
    closing: np.ndarray  # (2,)
    end_map: np.ndarray  # (2 n, 2 n)
    shape: np.ndarray  # (5,) int64
    mode: np.ndarray  # (k + 2,) int64 contact mode of each flight
    release: np.ndarray  # (k + 2,) int64 stop that opens at a node, or -1
    closed: np.ndarray  # (F, S) int64 1: the stop sticks
    weight: np.ndarray  # (F, S) of its force
    stops: np.ndarray  # (S, n) gaps
    harmonics: np.ndarray  # (H,)
    load_periods: float
    places: np.ndarray  # (4,) int64 of `ReleasedEntries`
    frequency: int
    program: Program  # the entries that depend on the parameters, and their derivatives of first and second order
    rows: np.ndarray  # (D,) int64 these entries
    values: np.ndarray  # (M,) of all parameters
    columns: np.ndarray  # (m,) int64 the released ones among them
    out: np.ndarray  # (D + D m + D m^2,) what the program writes
    kept: Program  # the user's equations in the same way
    kept_values: np.ndarray  # (M,), or (M + 2,) with the energy and the quarter period
    kept_out: np.ndarray
    scratch: np.ndarray  # of both programs
    work: Work
    orbit: BentOrbit


@kernel
def _weigh(work, count, row):
    """work.column[0] (n, G) = W c and work.column[1] = W c/(c W c) for the constant row c (n,)."""
    n, parts = row.shape[0], coefficients(count)
    column, number = work.column, work.number
    for g in range(parts):
        total = 0.0
        for r in range(n):
            column[0, r, g] = inner(row, work.flexible[r, g * n : (g + 1) * n])
            total += row[r] * column[0, r, g]
        number[0, 0, g] = total
    invert(count, number[0], number[1:3], number[3])
    multiply(count, column[0], number[3], n, column[1])


@kernel
def _take_away(work, count, row):
    """W after a stop with the gap row (n,) sticks."""
    n = row.shape[0]
    _weigh(work, count, row)
    for g in range(coefficients(count)):
        for c in range(n):
            work.row[0, g * n + c] = work.column[0, c, g]
    multiply(count, work.column[1], work.row, n, work.square[0])
    for r in range(n):
        for c in range(work.flexible.shape[1]):
            work.flexible[r, c] -= work.square[0, r, c]


@kernel
def _set_motion(b, mode, without):
    """Write M, W and the drive in a contact mode, but for one of its stops; -1: for none."""
    work, count, n = b.work, b.columns.shape[0], b.stops.shape[1]
    size = work.units.shape[0]
    constants = 1 if b.harmonics.shape[0] > 0 and b.harmonics[0] == 0.0 else 0
    for g in range(coefficients(count)):
        entries = b.orbit.entries[g]
        for r in range(n):
            for c in range(n):
                at = r * n + c
                work.mass[r, g * n + c] = entries[at]
                work.drive[r, g * size + n + c] = -entries[n * n + at]
                work.drive[r, g * size + c] = -entries[2 * n * n + at]
            for h in range(b.harmonics.shape[0]):
                if h < constants:
                    work.drive[r, g * size + 2 * n] = entries[b.places[1] + r]
                    continue
                at = g * size + 2 * n + constants + 2 * (h - constants)
                work.drive[r, at] = entries[b.places[2] + (h - constants) * n + r]
                work.drive[r, at + 1] = entries[b.places[3] + (h - constants) * n + r]
    invert(count, work.mass, work.square, work.flexible)
    for s in range(b.closed.shape[1]):
        if b.closed[mode, s] == 1 and s != without:
            _take_away(work, count, b.stops[s])


@inlined
def _set_rates(b, sticks):
    """Write A of a flight, and P where a stop sticks."""
    work, count, n = b.work, b.columns.shape[0], b.stops.shape[1]
    size = work.units.shape[0]
    constants = 1 if b.harmonics.shape[0] > 0 and b.harmonics[0] == 0.0 else 0
    multiply(count, work.flexible, work.drive, n, work.driven)
    if sticks:
        multiply(count, work.flexible, work.mass, n, work.square[0])
    for r in range(size):
        set_1(work.rates[r], 0.0)
        set_1(work.project[r], 0.0)
        work.project[r, r] = 1.0
    for g in range(coefficients(count)):
        at = g * size
        for r in range(n):
            if sticks:
                for c in range(n):
                    work.rates[r, at + n + c] = work.square[0, r, g * n + c]
                    work.project[n + r, at + n + c] = work.square[0, r, g * n + c]
            elif g == 0:
                work.rates[r, n + r] = 1.0
            for c in range(size):
                work.rates[n + r, at + c] = work.driven[r, at + c]
        for h in range(constants, b.harmonics.shape[0]):
            place = 2 * n + constants + 2 * (h - constants)
            rate = b.harmonics[h] * b.orbit.entries[g, b.frequency]
            work.rates[place, at + place + 1] = -rate
            work.rates[place + 1, at + place] = rate


@inlined
def _set_phases(b, n, s, phase):
    """phase (4, s): the states of the loads at the time s, behind 2 n entries, and their first three derivatives by s."""
    at = 2 * n
    for h in range(b.harmonics.shape[0]):
        rate = b.harmonics[h] * 2.0 * math.pi * b.load_periods
        cosine = math.cos(rate * s)
        sine = math.sin(rate * s)
        phase[0, at] = cosine
        phase[1, at] = -rate * sine
        phase[2, at] = -rate * rate * cosine
        phase[3, at] = rate * rate * rate * sine
        at += 1
        if rate > 0.0:
            phase[0, at] = sine
            phase[1, at] = rate * cosine
            phase[2, at] = -rate * rate * sine
            phase[3, at] = -rate * rate * rate * cosine
            at += 1


@inlined
def _times(matrix, first, x, out):
    """out = matrix[:, first : first + s] x for the rows of out."""
    for r in range(out.shape[0]):
        out[r] = inner(x, matrix[r, first : first + x.shape[0]])


@kernel
def _fly(b, i, z, t):
    """Keep the flight i from a node z (N,) in the time t, the last flight before it being i - 1. W of its contact mode is left."""
    work, orbit, count, n = b.work, b.orbit, b.columns.shape[0], b.stops.shape[1]
    size = work.units.shape[0]
    sticks = False
    for s in range(b.closed.shape[1]):
        sticks = sticks or b.closed[b.mode[i], s] == 1
    if i == 0 or b.mode[i] != b.mode[i - 1]:
        _set_motion(b, b.mode[i], -1)
        _set_rates(b, sticks)
    exponential(count, work.rates, n, t, work.units, work.powers, work.flow)
    flow, rates = work.flow, work.rates
    if sticks:
        # Only P v of the velocities flies.
        multiply(count, work.flow, work.project, 2 * n, work.powers[0])
        flow = work.powers[0]
    phase = orbit.phase[i]
    _set_phases(b, n, z[2 * n], phase)
    start, end, rate, turned = work.lines[0, :size], work.lines[1, :size], work.lines[2, :size], work.lines[3, :size]
    for r in range(size):
        start[r] = z[r] if r < 2 * n else phase[0, r]
    _times(flow, 0, start, end)
    _times(rates, 0, end, rate)
    for r in range(2 * n):
        orbit.end[i, r] = end[r]
        orbit.rate[i, 0, r] = rate[r]
        for c in range(size):
            for j in range(1 + count):
                orbit.flow[i, j, r, c] = flow[r, j * size + c]
    _times(rates, 0, rate, orbit.rate[i, 1])
    for g in range(1, coefficients(count)):
        _times(flow, g * size, start, turned)
        for r in range(2 * n):
            orbit.by_parameter[i, g, r] = turned[r]
            if g <= count:
                orbit.rate[i, 1 + g, r] = inner(turned, rates[r, :size]) + inner(end, rates[r, g * size : (g + 1) * size])
    for order in range(3):
        before = flow if order == 0 else work.powers[order]
        after = work.powers[order + 1]
        for r in range(size):
            for c in range(size):
                total = 0.0
                for q in range(size):
                    total += rates[r, q] * before[q, c]
                after[r, c] = total
                if r < 2 * n:
                    orbit.turn[i, order, r, c] = total


@kernel
def _keep_push(b, row):
    """Keep the impulse of the impact of a row of nodes; those of W are the flight's."""
    work, count, n = b.work, b.columns.shape[0], b.stops.shape[1]
    if b.contact[row, 0] < 0:
        return
    _weigh(work, count, b.gap[row, :n])
    for g in range(coefficients(count)):
        bounce = b.orbit.entries[g, b.contact[row, 1]] if b.contact[row, 1] >= 0 else 0.0
        work.number[0, 0, g] = bounce + (1.0 if g == 0 else 0.0)
    multiply(count, work.column[1], work.number[0], n, work.column[0])
    for g in range(coefficients(count)):
        for r in range(n):
            b.orbit.push[row, g, r] = work.column[0, r, g]


@kernel
def _keep_force(b, i, z):
    """Keep the contact force that vanishes at the node z after flight i."""
    work, orbit, count, n = b.work, b.orbit, b.columns.shape[0], b.stops.shape[1]
    size = work.units.shape[0]
    stop = b.release[i]
    _set_motion(b, b.mode[i], stop)
    _weigh(work, count, b.stops[stop])
    for g in range(coefficients(count)):
        for c in range(n):
            work.row[0, g * n + c] = work.column[1, c, g] * b.weight[b.mode[i], stop]
    multiply(count, work.row, work.drive, n, work.force)
    start = work.lines[0, :size]
    phase = orbit.phase[i + 1]
    _set_phases(b, n, z[2 * n], phase)
    for r in range(size):
        start[r] = z[r] if r < 2 * n else phase[0, r]
        for j in range(1 + count):
            orbit.force[i, j, r] = work.force[0, j * size + r]
    for g in range(coefficients(count)):
        orbit.force_bend[i, g] = inner(start, work.force[0, g * size : (g + 1) * size])


@kernel
def bend_orbit(b, y):
    """Keep all that the second derivatives at the orbit y (u,) need, unless it is kept."""
    orbit = b.orbit
    known = True
    for r in range(y.shape[0]):
        known = known and orbit.at[r] == y[r]
    if known:
        return
    count, n, width, k = b.columns.shape[0], b.stops.shape[1], b.gap.shape[1], b.shape[0]
    for j in range(count):
        b.values[b.columns[j]] = y[2 * n + 1 + j]
    run(b.program, b.values, b.scratch, b.out)
    depending = b.rows.shape[0]
    for d in range(depending):
        orbit.entries[0, b.rows[d]] = b.out[d]
        for j in range(count):
            orbit.entries[1 + j, b.rows[d]] = b.out[depending + d * count + j]
            for other in range(j + 1):
                bend = b.out[depending * (1 + count) + (d * count + j) * count + other]
                orbit.entries[place_of(count, j, other), b.rows[d]] = bend
    for i in range(k + 1):
        at = i * (width + 1)
        _fly(b, i, y[at : at + width], y[at + width])
        _keep_push(b, i)
    # The start of a segment between ends has the contact mode of its last flight: none.
    _keep_push(b, k + 1)
    for i in range(k):
        if b.release[i] >= 0:
            at = (i + 1) * (width + 1)
            _keep_force(b, i, y[at : at + width])
    for r in range(y.shape[0]):
        orbit.at[r] = y[r]
