"""Second derivatives along a direction of linear flights, impacts and releases: equations (38), (42) and (43).

With its loads a flight is autonomous: the states (u, v), 1 for a constant load, and the cosine and sine of each harmonic form a state of s
entries, xi' = A xi. Its end is exp(A t) xi. The matrix A depends on the parameters alone, so that its derivatives are those of
`bvp.kernels.nilpotent`. Those by states, times and phases are explicit.

Where the stops S stick, M^-1 is replaced by W = P M^-1. One stop after the other is taken away: W -= W c c' W/(c W c).
"""

import math
from typing import NamedTuple

import numpy as np

from bvp.kernels.compiled import inlined, kernel
from bvp.kernels.expressions import Program
from bvp.kernels.flight import inner, set_2
from bvp.kernels.nilpotent import divide, exponential, invert, multiply


class Bending(NamedTuple):
    """What the kernel knows of a problem with n coordinates, S stops, F contact modes, H harmonics and m parameters, whose nodes have k + 2
    rows; and its scratch. G = 2 + 2 m, and s = 2 n + q with the number q of states of the loads. Rows as in `LoadedSegment`."""

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
    entries: np.ndarray  # (G, E) scratch, whose first row has the constant entries
    square: np.ndarray  # (4, G, n, n) scratch: M, W, two more
    drive: np.ndarray  # (G, n, s) scratch: [-K, -C, loads]
    driven: np.ndarray  # (G, n, s) scratch
    rates: np.ndarray  # (G, s, s) scratch: A
    flow: np.ndarray  # (G, s, s) scratch: exp(A t)
    powers: np.ndarray  # (5, G, s, s) scratch
    units: np.ndarray  # (s,) scratch
    column: np.ndarray  # (2, G, n, 1) scratch
    row: np.ndarray  # (2, G, 1, n) scratch
    number: np.ndarray  # (G, 1, 1) scratch
    force: np.ndarray  # (G, 1, s) scratch
    lines: np.ndarray  # (10, max(s, m + 2)) scratch
    by_parameter: np.ndarray  # (m, s) scratch
    first: np.ndarray  # (2 n, N + 1) scratch: derivative of the end of a flight by its node and its time
    second: np.ndarray  # (2 n, N + 1) scratch: the derivative of that along the direction


@inlined
def set_direction(b, along):
    """Write the derivatives of the entries along a direction (m,) of the parameters."""
    count, rows = along.shape[0], b.rows.shape[0]
    for d in range(rows):
        total = 0.0
        for j in range(count):
            slope = b.out[rows + d * count + j]
            total += slope * along[j]
            b.entries[2 + j, b.rows[d]] = slope
            bend = 0.0
            for k in range(count):
                bend += b.out[rows * (1 + count) + (d * count + j) * count + k] * along[k]
            b.entries[2 + count + j, b.rows[d]] = bend
        b.entries[1, b.rows[d]] = total


@inlined
def _set_constant(row, out):
    """out (G, 1, n) = a constant row (n,)."""
    for g in range(out.shape[0]):
        for c in range(row.shape[0]):
            out[g, 0, c] = row[c] if g == 0 else 0.0


@kernel
def _weigh(b, row):
    """b.column[0] (G, n, 1) = W c and b.number = c W c for the constant row c (n,)."""
    n = row.shape[0]
    for g in range(b.number.shape[0]):
        total = 0.0
        for r in range(n):
            value = 0.0
            for c in range(n):
                value += b.square[1, g, r, c] * row[c]
            b.column[0, g, r, 0] = value
            total += row[r] * value
        b.number[g, 0, 0] = total


@kernel
def _take_away(b, row):
    """W after a stop with the gap row (n,) sticks."""
    n = row.shape[0]
    _weigh(b, row)
    divide(b.column[0], b.number, b.column[1])
    for g in range(b.number.shape[0]):
        for c in range(n):
            b.row[0, g, 0, c] = b.column[0, g, c, 0]
    multiply(b.column[1], b.row[0], n, b.square[2])
    for g in range(b.number.shape[0]):
        for r in range(n):
            for c in range(n):
                b.square[1, g, r, c] -= b.square[2, g, r, c]


@kernel
def set_motion(b, mode, without):
    """Write M, W and the drive in a contact mode, but for one of its stops; -1: for none."""
    count, n = b.drive.shape[0], b.drive.shape[1]
    constants = 1 if b.harmonics.shape[0] > 0 and b.harmonics[0] == 0.0 else 0
    for g in range(count):
        entries = b.entries[g]
        for r in range(n):
            for c in range(n):
                at = r * n + c
                b.square[0, g, r, c] = entries[at]
                b.drive[g, r, n + c] = -entries[n * n + at]
                b.drive[g, r, c] = -entries[2 * n * n + at]
            for h in range(b.harmonics.shape[0]):
                if h < constants:
                    b.drive[g, r, 2 * n] = entries[b.places[1] + r]
                    continue
                at = 2 * n + constants + 2 * (h - constants)
                b.drive[g, r, at] = entries[b.places[2] + (h - constants) * n + r]
                b.drive[g, r, at + 1] = entries[b.places[3] + (h - constants) * n + r]
    invert(b.square[0], b.square[2], b.square[1])
    for s in range(b.closed.shape[1]):
        if b.closed[mode, s] == 1 and s != without:
            _take_away(b, b.stops[s])


@inlined
def _set_rates(b, sticks):
    """Write A of a flight; b.square[3] = P where a stop sticks."""
    count, n, size = b.drive.shape[0], b.drive.shape[1], b.rates.shape[1]
    constants = size - 2 * n - 2 * (b.harmonics.shape[0] - (1 if b.harmonics.shape[0] > 0 and b.harmonics[0] == 0.0 else 0))
    multiply(b.square[1], b.drive, n, b.driven)
    if sticks:
        multiply(b.square[1], b.square[0], n, b.square[3])
    for g in range(count):
        set_2(b.rates[g], 0.0)
        for r in range(n):
            if sticks:
                for c in range(n):
                    b.rates[g, r, n + c] = b.square[3, g, r, c]
            elif g == 0:
                b.rates[0, r, n + r] = 1.0
            for c in range(size):
                b.rates[g, n + r, c] = b.driven[g, r, c]
        for at in range(2 * n + constants, size, 2):
            k = b.harmonics[b.harmonics.shape[0] - (size - at) // 2]
            b.rates[g, at, at + 1] = -k * b.entries[g, b.frequency]
            b.rates[g, at + 1, at] = k * b.entries[g, b.frequency]


@inlined
def _set_phases(b, n, s, phases, slope, bend):
    """The states of the loads at the time s, their derivative by s, and the second one: into the entries from 2 n on."""
    at = 2 * n
    for h in range(b.harmonics.shape[0]):
        rate = b.harmonics[h] * 2.0 * math.pi * b.load_periods
        cosine = math.cos(rate * s)
        sine = math.sin(rate * s)
        phases[at] = cosine
        slope[at] = -rate * sine
        bend[at] = -rate * rate * cosine
        at += 1
        if rate > 0.0:
            phases[at] = sine
            slope[at] = rate * cosine
            bend[at] = -rate * rate * sine
            at += 1


@inlined
def _times(matrix, x, out):
    """out = matrix x."""
    for r in range(matrix.shape[0]):
        out[r] = inner(matrix[r], x)


@kernel
def bend_flight(b, i, z, t, a, t_along):
    """b.first and b.second for flight i from a node z (N,) in the time t; a (N,), t_along: the direction. b.lines[4], b.lines[5]: the end
    and its derivative along the direction."""
    n, size = b.drive.shape[1], b.rates.shape[1]
    count = b.by_parameter.shape[0]
    sticks = False
    for s in range(b.closed.shape[1]):
        sticks = sticks or b.closed[b.mode[i], s] == 1
    set_motion(b, b.mode[i], -1)
    _set_rates(b, sticks)
    exponential(b.rates, n, t, b.units, b.powers, b.flow)
    flow, rates = b.flow, b.rates
    if sticks:
        # Only P v of the velocities flies.
        for g in range(rates.shape[0]):
            for r in range(size):
                for c in range(size):
                    b.powers[1, g, r, c] = 1.0 if g == 0 and r == c else 0.0
            for r in range(n):
                for c in range(n):
                    b.powers[1, g, n + r, n + c] = b.square[3, g, r, c]
        multiply(b.flow, b.powers[1], 2 * n, b.powers[0])
        flow = b.powers[0]
    start, slope, bend, start_along = b.lines[0], b.lines[1], b.lines[2], b.lines[3]
    end, end_along, rate, work = b.lines[4], b.lines[5], b.lines[6], b.lines[7]
    for r in range(2 * n):
        start[r] = z[r]
        start_along[r] = a[r]
        slope[r] = 0.0
        bend[r] = 0.0
    _set_phases(b, n, z[2 * n], start, slope, bend)
    for r in range(2 * n, size):
        start_along[r] = slope[r] * a[2 * n]
    _times(flow[0], start, end)
    _times(rates[0], end, rate)
    for r in range(size):
        end_along[r] = inner(flow[0, r], start_along) + inner(flow[1, r], start) + rate[r] * t_along
    for j in range(count):
        _times(flow[2 + j], start, b.by_parameter[j])
    first, second = b.first, b.second
    width = 2 * n + 1 + count
    for r in range(2 * n):
        for c in range(2 * n):
            first[r, c] = flow[0, r, c]
            second[r, c] = flow[1, r, c]
        first[r, 2 * n] = inner(flow[0, r], slope)
        second[r, 2 * n] = inner(flow[1, r], slope) + inner(flow[0, r], bend) * a[2 * n]
        first[r, width] = rate[r]
        second[r, width] = inner(rates[0, r], end_along) + inner(rates[1, r], end)
        for j in range(count):
            first[r, 2 * n + 1 + j] = b.by_parameter[j, r]
            total = inner(flow[2 + j, r], start_along) + inner(flow[2 + count + j, r], start)
            total += t_along * (inner(rates[2 + j, r], end) + inner(rates[0, r], b.by_parameter[j]))
            second[r, 2 * n + 1 + j] = total
    if t_along != 0.0:
        for c in range(2 * n + 1):
            # The rate of each column of exp(A t).
            for r in range(size):
                work[r] = flow[0, r, c] if c < 2 * n else inner(flow[0, r], slope)
            for r in range(2 * n):
                second[r, c] += t_along * inner(rates[0, r], work)


@kernel
def bend_impact(b, row):
    """b.first and b.second after the impact of a row of nodes; those of W are the flight's."""
    n, count = b.drive.shape[1], b.by_parameter.shape[0]
    if b.contact[row, 0] < 0:
        return
    gap = b.gap[row, :n]
    set_push(b, row)
    push = b.column[0]
    speed = inner(gap, b.lines[4, n : 2 * n])
    speed_along = inner(gap, b.lines[5, n : 2 * n])
    for c in range(2 * n + 2 + count):
        j = c - 2 * n - 1 if c < 2 * n + 1 + count else -1
        change = 0.0
        change_along = 0.0
        for r in range(n):
            change += gap[r] * b.first[n + r, c]
            change_along += gap[r] * b.second[n + r, c]
        for r in range(n):
            total = push[0, r, 0] * change_along + push[1, r, 0] * change
            if j >= 0:
                total += push[2 + j, r, 0] * speed_along + push[2 + count + j, r, 0] * speed
            b.second[n + r, c] -= total


@inlined
def set_push(b, row):
    """b.column[0] (G, n, 1) = the velocity that the impact of a row takes away for a unit of speed."""
    n = b.drive.shape[1]
    _weigh(b, b.gap[row, :n])
    divide(b.column[0], b.number, b.column[1])
    for g in range(b.number.shape[0]):
        bounce = b.entries[g, b.contact[row, 1]] if b.contact[row, 1] >= 0 else 0.0
        b.number[g, 0, 0] = bounce + (1.0 if g == 0 else 0.0)
    multiply(b.column[1], b.number, n, b.column[0])


@inlined
def bend_bound(b, row, first, line):
    """Add the bound of a row of nodes to its equation; first: where its parameters begin."""
    count = b.by_parameter.shape[0]
    for j in range(count):
        line[first + j] -= b.entries[2 + count + j, b.contact[row, 0]]


@kernel
def bend_release(b, i, z, a, line):
    """The equation of a contact force that vanishes at the node z after flight i; a (N,): the direction."""
    n, size, count = b.drive.shape[1], b.rates.shape[1], b.by_parameter.shape[0]
    stop = b.release[i]
    set_motion(b, b.mode[i], stop)
    _weigh(b, b.stops[stop])
    divide(b.column[0], b.number, b.column[1])
    for g in range(b.number.shape[0]):
        for c in range(n):
            b.row[0, g, 0, c] = b.column[1, g, c, 0] * b.weight[b.mode[i], stop]
    multiply(b.row[0], b.drive, n, b.force)
    start, slope, bend, along = b.lines[0], b.lines[1], b.lines[2], b.lines[3]
    for r in range(2 * n):
        start[r] = z[r]
        along[r] = a[r]
        slope[r] = 0.0
        bend[r] = 0.0
        line[r] = b.force[1, 0, r]
    _set_phases(b, n, z[2 * n], start, slope, bend)
    for r in range(2 * n, size):
        along[r] = slope[r] * a[2 * n]
    line[2 * n] = inner(b.force[1, 0], slope) + inner(b.force[0, 0], bend) * a[2 * n]
    for j in range(count):
        line[2 * n + 1 + j] = inner(b.force[2 + j, 0], along) + inner(b.force[2 + count + j, 0], start)
