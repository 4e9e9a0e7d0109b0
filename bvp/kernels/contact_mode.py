"""Contact modes of a system (see `bvp.contact_modes`), the numbers of a motion through them, and restitution at an impact.

Restitution R, equation (4), is linear, so it maps a perturbation as it maps a state. But a perturbed motion arrives at another time. After
the flight time t the state is z-, and the perturbation dz of the start has become exp(B t) dz. The arrival moves by

    dt = -(g . exp(B t) dz)/(g . B z-)

and the perturbation on the stop, after the impact, is J dz + F dt with J = R exp(B t) and F = R B z-.
"""

import math
from typing import NamedTuple

import numpy as np

from bvp.kernels.compiled import chosen, inlined, kernel, shared
from bvp.kernels.flight import Contacts, Flight, amplitudes, copy_1, inner, row_dot, set_1, set_2

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


@chosen
def flight_of(modes, f):
    """The flight in contact mode f."""


@flight_of.of(ContactModes)
@inlined
def blocks_of_mode(modes, f):
    """See `flight_of`: its blocks."""
    return Flight(modes.pairs[f], modes.mean[f], modes.delta[f], modes.matrix[f])


@inlined
def contacts_of(modes, f):
    """The contacts in contact mode f."""
    return Contacts(
        modes.gap[f], modes.rate[f], modes.acceleration[f], modes.side[f], modes.bound[f], modes.push[f], modes.restitution
    )


@kernel
def begin_anew(motion):
    """Set the numbers of a motion to those at time 0, on no contact, with none sticking. The passes left in this call are kept."""
    passes = motion.counts[PASSES]
    for k in range(COUNTS):
        motion.counts[k] = 0
    motion.counts[LEAVING] = -1
    motion.counts[PASSES] = passes
    set_1(motion.clock, 0.0)
    set_2(motion.angles, 0.0)
    set_2(motion.sums, 0.0)


@kernel
def find_mode(modes, sticking):
    """Index of the contact mode in which exactly these contacts stick, or -1."""
    for f in range(modes.sticking.shape[0]):
        if modes.sticking[f] == sticking:
            return f
    return -1


@chosen
def settle(modes, f, z):
    """Bring the entries of a state z of contact mode f that follow from others up to date."""


@settle.of(ContactModes)
@inlined
def settled(modes, f, z):
    """See `settle`: there are none."""


@chosen
def cannot_hit(modes, f, z):
    """True if the bound of every gap, for all later times, stays below its stop."""


@cannot_hit.of(ContactModes)
@shared("boolean")
def stays_within(modes, f, z):
    """See `cannot_hit`."""
    # Equation (24) over all time to come.
    for c in range(modes.side.shape[1]):
        if (modes.sticking[f] >> c) & 1 != 0:
            return False
        level, _, _ = amplitudes(flight_of(modes, f), modes.gap[f, c], z, math.inf)
        if not level < modes.side[f, c] * modes.bound[f, c]:
            return False
    return True


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


@chosen
def renew_loads(modes, motion, z):
    """Write the loads' states into z after a flight, where the flight has not carried them exactly."""


@renew_loads.of(ContactModes)
@inlined
def exact_loads(modes, motion, z):
    """See `renew_loads`: it has."""


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


@kernel
def sums_of(sums, out):
    """out = the values of compensated sums."""
    for i in range(sums.shape[0]):
        out[i] = sums[i, 0] + sums[i, 1]


@inlined
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
    copy_1(before, log.before[row])
    copy_1(z, log.states[row])
    sums_of(sums, log.sums[row])
    counts[EVENTS] = row + 1


SPLIT = 134217729.0
"""2^27 + 1, for the upper half of the digits of a double (Veltkamp)."""


@inlined
def kick(change, near, rest):
    """change (near + rest), rounded to either side alike. `near` is the nearest double to a number, and `rest` what it leaves.

    Were rest left out, or added to a rounded product, every product would be off to the same side."""
    scaled = near * SPLIT
    head = scaled - (scaled - near)
    return change * head + change * ((near - head) + rest)


@inlined
def bounce(rate_rows, push, push_rest, c, jump, z):
    """`apply_impact`, in place, along a push that is known beyond double precision, so that the energy of many impacts does not drift."""
    # Equation (4), with the impulse in twice the digits.
    change = jump * row_dot(rate_rows, c, z)
    for r in range(z.shape[0]):
        z[r] -= kick(change, push[c, r], push_rest[c, r])


@inlined
def apply_impact(rate_rows, push, c, jump, z, out):
    """out = z - jump push (rate . z), the impact at contact c: jump = 1 + r, 0 leaves it out (out may be z)."""
    # Equation (4): the impulse along M^-1 c.
    change = jump * row_dot(rate_rows, c, z)
    for r in range(z.shape[0]):
        out[r] = z[r] - change * push[c, r]


@kernel
def restitute_state(contacts, c, z, out):
    """`apply_impact` with the contact's own restitution."""
    apply_impact(contacts.rate, contacts.push, c, 1.0 + contacts.restitution[c], z, out)


@kernel
def impact_columns(rate_rows, push, c, jump, matrix):
    """`apply_impact` each column of a matrix (N, N), in place."""
    # Equation (4) for each column.
    size = matrix.shape[1]
    for column in range(size):
        change = jump * inner(rate_rows[c], matrix[:, column])
        if change != 0.0:
            for r in range(size):
                matrix[r, column] -= change * push[c, r]


@inlined
def arrive(rows, c, velocity, change):
    """Move a perturbation `change` along the flow onto rows[c] . z = constant: change += velocity dt. Returns dt."""
    # Equation (27): the change of the arrival's time.
    shift = -row_dot(rows, c, change) / row_dot(rows, c, velocity)
    for r in range(change.shape[0]):
        change[r] += shift * velocity[r]
    return shift
