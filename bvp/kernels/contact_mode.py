"""The kernels' data: the contact modes of a system (see `bvp.contact_modes`), and the numbers of a motion through them."""

import math
from typing import NamedTuple

import numpy as np

from bvp.kernels.bounds import amplitudes
from bvp.kernels.compiled import kernel, part
from bvp.kernels.flight import Contacts, Flight

START, IMPACT, TOUCHED, STICK, RELEASE, BREAK, PIECE, CHATTER = range(8)
"""Kinds of events in the log: the start; an impact; a touch; a contact that sticks from here on; one that is released; a load that is
set anew; a flight that goes on; bounces that are summed up to the next event."""

(
    MODE, LEAVING, PENDING, KIND, CONTACT, EVENTS, IMPACTS, TOUCHES, IDLE, MARK, BREAK_INDEX, BOUNCES, ROWS, BOUNCING, CLEAR, RUNNING,
    PASSES, COUNTS,
) = range(18)  # fmt: skip
"""Entries of counts, and their number. RUNNING: whether a motion is under way; PASSES: of the loop over its events that are left in this
call."""

(
    TIME, TIME_LOW, INITIAL, LAST_IMPACT, STICKING_TIME, CLEAR_TIME, SWITCH_ERROR, REFERENCE, REFERENCE_LOW, SPEED, LOSS, SPAN, PROGRESS,
    CLOCK,
) = range(14)  # fmt: skip
"""Entries of clock, and their number."""


class ContactModes(NamedTuple):
    """F contact modes of N states (see `bvp.contact_modes`), and what they share, for n coordinates, m contacts, R terms and G loads."""

    sticking: np.ndarray  # (F,) int64 bits of the sticking contacts
    pairs: np.ndarray  # (F, P, 2)
    mean: np.ndarray  # (F, P)
    delta: np.ndarray  # (F, P)
    matrix: np.ndarray  # (F, N, N)
    leave: np.ndarray  # (F, 2 n, N)
    enter: np.ndarray  # (F, N, 2 n + 2 G)
    to_modes: np.ndarray  # (F, 2 n, N)
    from_modes: np.ndarray  # (F, N, 2 n + 2 G)
    gap: np.ndarray  # (F, m, N)
    rate: np.ndarray  # (F, m, N)
    acceleration: np.ndarray  # (F, m, N)
    push: np.ndarray  # (F, m, N)
    push_rest: np.ndarray  # (F, m, N) rounding errors of the doubles of push
    side: np.ndarray  # (F, m)
    bound: np.ndarray  # (F, m)
    first: np.ndarray  # (F, R, N)
    second: np.ndarray  # (F, R, N)
    restitution: np.ndarray  # (m,)
    contact_mass: np.ndarray  # (m,) 1/(c M^-1 c)
    contact_stop: np.ndarray  # (m,) int64
    weight: np.ndarray  # (R,)
    part: np.ndarray  # (R,) int64
    frequency: np.ndarray  # (G,)
    breaks: np.ndarray  # (K,)
    levels: np.ndarray  # (K, G, 2)
    shape: np.ndarray  # (3,) int64: n, dampers D, stops S


class MotionState(NamedTuple):
    """A motion under way: what changes from one event to the next."""

    z: np.ndarray  # (N,) state of the contact mode
    x: np.ndarray  # (2 n + 2 G,) modal coordinates, at the start (u, v), and states of the loads: a contact mode begins from these
    counts: np.ndarray  # (COUNTS,) int64
    clock: np.ndarray  # (CLOCK,)
    angles: np.ndarray  # (G, 2) angles of the loads, compensated sums
    sums: np.ndarray  # (D + S + 1, 2) dissipated by each damper and stop, and work done: compensated sums
    marks: np.ndarray  # (Q, D + S + 3) fractions of the initial energy, ascending; then the time at which each is gone, and the sums
    peaks: np.ndarray  # (n,) largest displacements; empty where they are not wanted


class Log(NamedTuple):
    """The record of each event; arrays without rows if nothing is recorded."""

    numbers: np.ndarray  # (E, 3) int64: kind, contact, contact mode after
    values: np.ndarray  # (E, 3) time, speed of approach, energy lost
    before: np.ndarray  # (E, 2 n) (u, v) just before
    states: np.ndarray  # (E, N) state of the contact mode after
    sums: np.ndarray  # (E, D + S + 1) dissipated by each damper and stop, work done, since the start


class Scratch(NamedTuple):
    """Scratch arrays of a motion. Their content need not be kept between calls."""

    table: np.ndarray  # (LEVELS, 2 n + D + S + 2) orders of the series of chattering
    values: np.ndarray  # (2 n + D + S + 2,)
    before: np.ndarray  # (2 n,) state just before an event
    kept: np.ndarray  # (N,) state of the contact mode in which an impact happens
    peak: np.ndarray  # (PEAK_ROWS, 1, N)
    edge: np.ndarray  # (2, 1)
    work: np.ndarray  # of `impact.work_array`
    integral: np.ndarray  # of `integral.integral_work`
    out: np.ndarray  # (R,)
    impulses: np.ndarray  # (m, m + 1) equations of an impact while contacts stick


@part
def flight_of(modes, f):
    """The blocks of contact mode f."""
    return Flight(modes.pairs[f], modes.mean[f], modes.delta[f], modes.matrix[f])


@part
def contacts_of(modes, f):
    """The contacts in contact mode f."""
    return Contacts(
        modes.gap[f], modes.rate[f], modes.acceleration[f], modes.side[f], modes.bound[f], modes.push[f], modes.restitution
    )


@kernel
def begin_anew(motion):
    """Set the numbers of a motion to those at time 0, on no contact, with none sticking. The passes left in this call are kept."""
    counts, clock, angles, sums = motion.counts, motion.clock, motion.angles, motion.sums
    for k in range(COUNTS):
        if k != PASSES:
            counts[k] = 0
    for k in range(CLOCK):
        clock[k] = 0.0
    counts[LEAVING] = -1
    for g in range(angles.shape[0]):
        angles[g, 0] = 0.0
        angles[g, 1] = 0.0
    for i in range(sums.shape[0]):
        sums[i, 0] = 0.0
        sums[i, 1] = 0.0


@kernel
def find_mode(modes, sticking):
    """Index of the contact mode in which exactly these contacts stick, or -1."""
    for f in range(modes.sticking.shape[0]):
        if modes.sticking[f] == sticking:
            return f
    return -1


@kernel
def cannot_hit(modes, f, z):
    """True if the bound of every gap, for all later times, stays below its stop."""
    # Equation (24) over all time to come.
    for c in range(modes.side.shape[1]):
        if (modes.sticking[f] >> c) & 1 != 0:
            return False
        level, _, _ = amplitudes(flight_of(modes, f), modes.gap[f], c, z, math.inf)
        if not level < modes.side[f, c] * modes.bound[f, c]:
            return False
    return True


@kernel
def times_matrix(matrix, x, out):
    """out = matrix x."""
    for r in range(matrix.shape[0]):
        total = 0.0
        for c in range(matrix.shape[1]):
            total += matrix[r, c] * x[c]
        out[r] = total


@kernel
def write_loads(modes, index, clock, angles, x):
    """The present states of the loads, into x[2 n:]. The angles (G, 2) of harmonics are compensated sums: the product of a frequency
    with a long time would round to less than the flights are exact to."""
    at = 2 * modes.shape[0]
    for g in range(modes.frequency.shape[0]):
        # y of equation (5): a rotation for a harmonic, level and slope else.
        if modes.frequency[g] > 0.0:
            c = math.cos(angles[g, 0])
            s = math.sin(angles[g, 0])
            x[at + 2 * g] = c - angles[g, 1] * s
            x[at + 2 * g + 1] = s + angles[g, 1] * c
        else:
            slope = modes.levels[index, g, 1]
            x[at + 2 * g] = modes.levels[index, g, 0] + slope * ((clock[TIME] - modes.breaks[index]) + clock[TIME_LOW])
            x[at + 2 * g + 1] = slope


@kernel
def reset_loads(modes, f, index, z):
    """Add, at a break, the jumps of the loads' levels and slopes to z."""
    span = modes.breaks[index] - modes.breaks[index - 1]
    at = 2 * modes.shape[0]
    for g in range(modes.frequency.shape[0]):
        slope = modes.levels[index, g, 1] - modes.levels[index - 1, g, 1]
        level = modes.levels[index, g, 0] - (modes.levels[index - 1, g, 0] + modes.levels[index - 1, g, 1] * span)
        for r in range(z.shape[0]):
            z[r] += modes.enter[f, r, at + 2 * g] * level + modes.enter[f, r, at + 2 * g + 1] * slope


@kernel
def add(sums, i, value):
    """Add to a compensated sum: sums[i, 0] + sums[i, 1] (Neumaier)."""
    total = sums[i, 0] + value
    if abs(sums[i, 0]) >= abs(value):
        sums[i, 1] += (sums[i, 0] - total) + value
    else:
        sums[i, 1] += (value - total) + sums[i, 0]
    sums[i, 0] = total


@part
def advance_clock(modes, clock, angles, flight):
    """Add a flight to the time, kept in two parts, and to the angles of the loads."""
    for g in range(modes.frequency.shape[0]):
        add(angles, g, modes.frequency[g] * flight)
    # A compensated sum.
    total = clock[TIME] + flight
    clock[TIME_LOW] += (clock[TIME] - total) + flight if clock[TIME] >= flight else (flight - total) + clock[TIME]
    clock[TIME] = total + clock[TIME_LOW]
    clock[TIME_LOW] = (total - clock[TIME]) + clock[TIME_LOW]


@kernel
def log_event(log, kind, contact, motion, before, z):
    """Write one event, where there is room."""
    counts, clock, sums = motion.counts, motion.clock, motion.sums
    row = counts[EVENTS]
    if row >= log.numbers.shape[0]:
        return
    log.numbers[row, 0] = kind
    log.numbers[row, 1] = contact
    log.numbers[row, 2] = counts[MODE]
    log.values[row, 0] = clock[TIME]
    log.values[row, 1] = clock[SPEED]
    log.values[row, 2] = clock[LOSS]
    for r in range(log.before.shape[1]):
        log.before[row, r] = before[r]
    for r in range(z.shape[0]):
        log.states[row, r] = z[r]
    for i in range(sums.shape[0]):
        log.sums[row, i] = sums[i, 0] + sums[i, 1]
    counts[EVENTS] = row + 1
