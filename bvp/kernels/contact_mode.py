"""What the kernels know of a system's contact modes (see `bvp.contact_modes`), and where a motion through them keeps its numbers."""

import math
from typing import NamedTuple

import numpy as np

from bvp.kernels.bounds import amplitudes
from bvp.kernels.compiled import kernel, part
from bvp.kernels.flight import Contacts, Flight

START, IMPACT, TOUCHED, STICK, RELEASE, BREAK, PIECE, CHATTER = range(8)
"""Kinds of events in the log: the start; an impact; a touch; a contact that is held from here on; one that is held no more; a load that is
set anew; a flight that goes on; bounces that are summed up to the next event."""

(
    MODE, LEAVING, PENDING, KIND, CONTACT, EVENTS, IMPACTS, TOUCHES, IDLE, MARK, BREAK_INDEX, BOUNCES, ROWS, BOUNCING, CLEAR, RUNNING,
    PASSES, COUNTS,
) = range(18)  # fmt: skip
"""Entries of counts, and their number. RUNNING: whether a motion is under way; PASSES: of the loop over its events that are left in this
call."""

(
    TIME, TIME_LOW, INITIAL, LAST_IMPACT, HELD_TIME, CLEAR_TIME, SWITCH_ERROR, REFERENCE, REFERENCE_LOW, SPEED, LOSS, SPAN, PROGRESS, CLOCK,
) = range(14)  # fmt: skip
"""Entries of clock, and their number."""


class ContactModes(NamedTuple):
    """F contact modes of N states (see `bvp.contact_modes`), and what they share, for n coordinates, m contacts, R terms and G loads."""

    held: np.ndarray  # (F,) int64
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
    push_rest: np.ndarray  # (F, m, N) what the doubles of push leave
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


class Log(NamedTuple):
    """What is recorded of each event; no rows where nothing is."""

    numbers: np.ndarray  # (E, 3) int64: kind, contact, contact mode after
    values: np.ndarray  # (E, 3) time, speed of approach, energy lost
    before: np.ndarray  # (E, 2 n) (u, v) just before
    states: np.ndarray  # (E, N) state of the contact mode after
    sums: np.ndarray  # (E, D + S + 1) dissipated by each damper and stop, work done, since the start


class Scratch(NamedTuple):
    """Arrays that a motion writes into, and that need not be kept."""

    table: np.ndarray  # (LEVELS, 2 n + D + S + 2) orders of the series of chattering
    values: np.ndarray  # (2 n + D + S + 2,)
    before: np.ndarray  # (2 n,) state just before an event
    kept: np.ndarray  # (N,) state of the contact mode in which an impact happens
    peak: np.ndarray  # (PEAK_ROWS, 1, N)
    edge: np.ndarray  # (2, 1)
    work: np.ndarray  # of `impact.work_array`
    integral: np.ndarray  # of `integral.integral_work`
    out: np.ndarray  # (R,)
    impulses: np.ndarray  # (m, m + 1) equations of an impact while contacts are held


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
def begin_anew(counts, clock, turns, sums):
    """The numbers of a motion at time 0, on no contact, in the contact mode without one held; but for the passes left in this call."""
    for k in range(COUNTS):
        if k != PASSES:
            counts[k] = 0
    for k in range(CLOCK):
        clock[k] = 0.0
    counts[LEAVING] = -1
    for g in range(turns.shape[0]):
        turns[g, 0] = 0.0
        turns[g, 1] = 0.0
    for i in range(sums.shape[0]):
        sums[i, 0] = 0.0
        sums[i, 1] = 0.0


@kernel
def find_mode(modes, held):
    """Index of the contact mode in which just these contacts are held, or -1."""
    for f in range(modes.held.shape[0]):
        if modes.held[f] == held:
            return f
    return -1


@kernel
def cannot_hit(modes, f, z):
    """True where the bound of every gap, over all time to come, stays below its stop."""
    for c in range(modes.side.shape[1]):
        if (modes.held[f] >> c) & 1 != 0:
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
def write_loads(modes, index, clock, turns, x):
    """The present states of the loads, into x[2 n:]. The angles of harmonics are compensated sums, turns (G, 2): the product of a frequency
    with a long time would round to less than the flights are exact to."""
    at = 2 * modes.shape[0]
    for g in range(modes.frequency.shape[0]):
        if modes.frequency[g] > 0.0:
            c = math.cos(turns[g, 0])
            s = math.sin(turns[g, 0])
            x[at + 2 * g] = c - turns[g, 1] * s
            x[at + 2 * g + 1] = s + turns[g, 1] * c
        else:
            slope = modes.levels[index, g, 1]
            x[at + 2 * g] = modes.levels[index, g, 0] + slope * ((clock[TIME] - modes.breaks[index]) + clock[TIME_LOW])
            x[at + 2 * g + 1] = slope


@kernel
def reset_loads(modes, f, index, z):
    """What a break adds to the levels and slopes of the loads, in z."""
    span = modes.breaks[index] - modes.breaks[index - 1]
    at = 2 * modes.shape[0]
    for g in range(modes.frequency.shape[0]):
        slope = modes.levels[index, g, 1] - modes.levels[index - 1, g, 1]
        level = modes.levels[index, g, 0] - (modes.levels[index - 1, g, 0] + modes.levels[index - 1, g, 1] * span)
        for r in range(z.shape[0]):
            z[r] += modes.enter[f, r, at + 2 * g] * level + modes.enter[f, r, at + 2 * g + 1] * slope
