"""The motion of a system through its contact modes: flight, next impact or release, restitution, chattering, sticking.

The distance of a sticking contact is its force, so `next_impact` finds impacts and releases alike.
Below are many motions in one call, and the states and sums of a recorded motion at any time.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy import int64

from bvp.kernels import contact_mode as entry
from bvp.kernels.compiled import inlined, kernel, shared
from bvp.kernels.contact_mode import (
    begin_anew,
    bounce,
    cannot_hit,
    contacts_of,
    find_mode,
    flight_of,
    log_event,
    reset_loads,
    settle,
    sums_of,
    write_loads,
)
from bvp.kernels.energy_budget import dissipated_energy, fly, log_chatter, lose, stop_contact
from bvp.kernels.flight import copy_1, flight_at, row_dot, set_1, times_matrix
from bvp.kernels.flights import begin_path, fastest, hold_path, path_state, rounding_level
from bvp.kernels.impact import EXHAUSTED, HIT, NONE, OUTSIDE, PRESSED, TOUCH, next_impact
from bvp.kernels.smooth_motion import SmoothModes
from bvp.kernels.sticking import (
    at_their_bounds,
    bring_to_rest,
    chatter,
    clash,
    closed_contacts,
    comes_to_rest,
    driven_together,
    impact_while_sticking,
    sunk,
    touches_sticking,
)

KINDS_OF_MODES = (entry.ContactModes, SmoothModes)
"""What a motion goes through: a kernel has imported the kinds that it contains."""

REACHED, FULL, NEW_MODE, INTERACTING, STARTED_OUTSIDE, MOST, CYCLING, GAVE_UP, PIERCED, PAUSED, UNRESOLVED = range(11)
"""How `move` returned: at the duration; the log is full (call again); the mode counts[PENDING] is wanted (add it and call again); two
stops are hit at once and their impulses interact; started beyond a stop; at the most impacts; modes follow each other without time
passing; the search for the next impact, or for a peak, gave up without time passing; carried beyond a stop by rounding; counts[PASSES] are
used up (set them and call again); the smooth forces are too large for a step. After REACHED, too, the motion can be carried on, to a
longer duration."""

PATIENCE, INSTANT, SEARCH = 256, 16, 64
"""For each contact, and two more, so much may be spent within a radian of the fastest motion: 1 for each event, this for one to which no
time passes, and for a search that gave up."""

LIFTS = 8
"""Rounds in which contacts are lifted off what they are beyond: one can push another down."""

REFRESH = 256
"""Impacts, and breaks, after which the loads' states are written anew. In between they are carried by the flights like all others: passing
through (u, v) each time would round in one direction."""


@kernel
def count_impact(modes, c, speed, loss, motion):
    """Take an impact at contact c into the counts, the clock and the sums."""
    counts, clock = motion.counts, motion.clock
    lose(modes, c, loss, motion)
    counts[entry.IMPACTS] += 1
    clock[entry.LAST_IMPACT] = clock[entry.TIME]
    clock[entry.SPEED] = speed
    clock[entry.LOSS] = loss
    counts[entry.CONTACT] = c


@shared(("integer", "boolean"))
def resolve_impact(modes, still, moving, sticking, c, motion, scratch):
    """Resolve the impact at contact c in mode 0. still, moving: of `at_their_bounds`; sticking: those of `still` that stick.

    Returns (the contacts that keep sticking, whether c is one of them); -1 where restitution does not define what follows."""
    z, clock = motion.z, motion.clock
    speed = modes.side[0, c] * row_dot(modes.rate[0], c, z)
    stay = int64(0)
    if moving:
        # Several contacts bounce no higher than the tolerance: they come to rest at once.
        stay, part, span = comes_to_rest(modes, still, moving, c, z, scratch.impulses)
        if stay:
            decided, loss = bring_to_rest(modes, stay, part, z, scratch.impulses)
            if not decided:
                return int64(-1), False
            count_impact(modes, c, speed, loss, motion)
            clock[entry.SWITCH_ERROR] = max(clock[entry.SWITCH_ERROR], span)
            return stay, True
        unknown, span = clash(modes, moving, c, z)
        if unknown:
            return int64(-1), False
        clock[entry.SWITCH_ERROR] = max(clock[entry.SWITCH_ERROR], span)
    closed = closed_contacts(modes, still, sticking, c, z)
    if closed and touches_sticking(modes, closed, c):
        # Equation (8).
        stay, loss = impact_while_sticking(modes, closed, c, z, scratch.impulses)
        if stay < 0:
            return int64(-1), False
    else:
        stay = closed
        # The restitution of both is that of the rounded sum.
        jump = 1.0 + modes.restitution[c]
        bounce(modes.rate[0], modes.push[0], modes.push_rest[0], c, jump, z)
        # Equation (9), with 1 - rho^2 = (2 - jump) jump.
        loss = 0.5 * modes.contact_mass[c] * (2.0 - jump) * jump * speed * speed
    if still & ~closed and driven_together(modes, still & ~closed, c, z):
        return int64(-1), False
    count_impact(modes, c, speed, loss, motion)
    return stay, False


@kernel
def lift(modes, freed, x, z):
    """Move x (2 n + 2 G,), modal, so that no contact of the bits of `freed` is beyond its bound. Contacts that stuck until now can be so by
    rounding, others by what counts as a touch. z (N,) is scratch."""
    n = modes.shape[0]
    for _ in range(LIFTS):
        still = True
        for c in range(modes.side.shape[1]):
            if (freed >> c) & 1 == 0:
                continue
            times_matrix(modes.from_modes[0], x, z)
            beyond = row_dot(modes.gap[0], c, z) - modes.bound[0, c]
            if modes.side[0, c] * beyond > 0.0:
                still = False
                # Displacements move along M^-1 c, like velocities at an impact.
                for i in range(n):
                    x[i] -= beyond * row_dot(modes.to_modes[0], n + i, modes.push[0, c])
        if still:
            break


@inlined
def impatient(modes, f, exhausted, flight, counts, clock):
    """Count the event after a flight in contact mode f; True where too many have come since the fastest motion has turned by a radian."""
    if exhausted:
        cost = SEARCH
    elif flight == 0.0:
        cost = INSTANT
    else:
        cost = 1
    counts[entry.IDLE] += cost
    if counts[entry.IDLE] <= PATIENCE * (2 + modes.side.shape[1]):
        return False
    now = clock[entry.TIME] + flight
    if (now - clock[entry.PROGRESS]) * fastest(flight_of(modes, f)) < 1.0:
        return True
    counts[entry.IDLE] = cost
    clock[entry.PROGRESS] = now
    return False


@kernel
def request_mode(counts, sticking, kind):
    """Make the contact mode in which exactly these contacts stick begin next, after an event of this kind."""
    counts[entry.PENDING] = sticking
    counts[entry.KIND] = kind
    counts[entry.BOUNCES] = 0


@shared("integer")
def move(modes, duration, most, motion, log, scratch):
    """Carry a motion on until its duration, its most impacts, or a reason to return. Returns the reason.

    It returns after counts[PASSES] events at most, the work for each of which is bounded. In the end it returns, whatever happens: impacts
    faster than rounding are at most `most`, and between two of them, or two breaks, every event is counted within each radian of the
    fastest motion, the more where it takes no time or makes no way (`impatient`).
    """
    z, x, counts, clock, angles = motion.z, motion.x, motion.counts, motion.clock, motion.angles
    before = scratch.before
    work = scratch.work
    logged = log.numbers.shape[0] > 0
    contacts = modes.side.shape[1]
    while True:
        # A contact mode begins: equation (6) for the contacts that stick.
        if counts[entry.PENDING] >= 0:
            f = find_mode(modes, counts[entry.PENDING])
            if f < 0:
                return NEW_MODE
            write_loads(modes, counts[entry.BREAK_INDEX], clock, angles, x)
            if counts[entry.KIND] == entry.START:
                times_matrix(modes.enter[f], x, z)
            else:
                lift(modes, modes.sticking[counts[entry.MODE]] & ~modes.sticking[f], x, z)
                times_matrix(modes.from_modes[f], x, z)
            counts[entry.MODE] = f
            counts[entry.PENDING] = -1
            if clock[entry.SPAN] > 0.0:
                log_chatter(modes, f, log, motion, before, scratch)
            log_event(log, counts[entry.KIND], counts[entry.CONTACT], motion, before, z)
        if log.numbers.shape[0] and log.numbers.shape[0] - counts[entry.EVENTS] <= contacts + 3:
            return FULL
        if counts[entry.IMPACTS] >= most:
            return MOST
        if counts[entry.PASSES] <= 0:
            return PAUSED
        counts[entry.PASSES] -= 1
        f = counts[entry.MODE]
        sticking = modes.sticking[f]
        ahead = counts[entry.BREAK_INDEX] + 1
        end = duration
        if ahead < modes.breaks.shape[0] and modes.breaks[ahead] < duration:
            end = modes.breaks[ahead]
        horizon = max((end - clock[entry.TIME]) - clock[entry.TIME_LOW], 0.0)
        # Equation (3): the next impact, or the next release, whose distance is the contact force (7).
        known = begin_path(flight_of(modes, f), z, horizon)
        if known < 0.0:
            return UNRESOLVED
        settle(modes, f, z)
        status, c, flight = next_impact(flight_of(modes, f), contacts_of(modes, f), counts[entry.LEAVING], z, known, work)
        if impatient(modes, f, status == EXHAUSTED, flight, counts, clock):
            return GAVE_UP if status == EXHAUSTED else CYCLING
        clock[entry.SPEED] = 0.0
        clock[entry.LOSS] = 0.0
        counts[entry.LEAVING] = -1
        releases = c >= 0 and (sticking >> max(c, 0)) & 1 != 0
        begin = clock[entry.TIME]
        if status == OUTSIDE and not releases:
            return STARTED_OUTSIDE if clock[entry.TIME] == 0.0 and counts[entry.IMPACTS] == 0 else PIERCED
        if status == EXHAUSTED and flight == 0.0:
            return GAVE_UP
        if not fly(modes, f, flight, motion, scratch):
            return GAVE_UP
        if logged:
            times_matrix(modes.leave[f], z, before)
        if status == NONE and known == horizon:
            # No event up to the duration, or to the next break of a load.
            if end == duration:
                if cannot_hit(modes, f, z):
                    counts[entry.CLEAR] = 1
                    clock[entry.CLEAR_TIME] = begin
                return REACHED
            clock[entry.TIME] = end
            clock[entry.TIME_LOW] = 0.0
            counts[entry.BREAK_INDEX] = ahead
            counts[entry.BOUNCES] = 0
            counts[entry.IDLE] = 0
            clock[entry.PROGRESS] = end
            if ahead % REFRESH == 0:
                times_matrix(modes.to_modes[f], z, x)
                write_loads(modes, ahead, clock, angles, x)
                times_matrix(modes.from_modes[f], x, z)
            else:
                reset_loads(modes, f, ahead, z)
            log_event(log, entry.BREAK, -1, motion, before, z)
            continue
        if status == HIT and not releases and modes.side[f, c] * row_dot(modes.rate[f], c, z) < 0.0:
            status = TOUCH  # the distance is rounding there, and the contact opens
        if f != 0 or status != HIT:
            times_matrix(modes.to_modes[f], z, x)
        if status == EXHAUSTED or status == NONE:
            log_event(log, entry.PIECE, -1, motion, before, z)
            continue
        if status == TOUCH:
            counts[entry.LEAVING] = c
            if not releases:
                counts[entry.TOUCHES] += 1
                log_event(log, entry.TOUCHED, c, motion, before, z)
            continue
        counts[entry.CONTACT] = c
        # The contact force has come to 0: the contact opens.
        if releases:
            request_mode(counts, sticking & ~(int64(1) << c), entry.RELEASE)
            counts[entry.LEAVING] = -2 - c
            continue
        # The contact presses at zero speed: it sticks.
        if status == PRESSED:
            stop_contact(modes, c, motion, work)
            request_mode(counts, sticking | (int64(1) << c), entry.STICK)
            continue
        after = f
        if f != 0:
            copy_1(z, scratch.kept)
            write_loads(modes, counts[entry.BREAK_INDEX], clock, angles, x)
            times_matrix(modes.from_modes[0], x, z)
            settle(modes, int64(0), z)
            counts[entry.MODE] = 0
        still, moving = at_their_bounds(modes, c, z)
        if moving and sunk(modes, moving | (int64(1) << c), z):
            times_matrix(modes.to_modes[0], z, x)
            write_loads(modes, counts[entry.BREAK_INDEX], clock, angles, x)
            lift(modes, moving | (int64(1) << c), x, z)
            times_matrix(modes.from_modes[0], x, z)
        still |= sticking
        fast = abs(row_dot(modes.rate[0], c, z)) > rounding_level(flight_of(modes, 0), modes.rate[0], c, z)
        left, resolved = resolve_impact(modes, still, moving & ~sticking, sticking, c, motion, scratch)
        if left < 0:
            return INTERACTING
        if fast:
            counts[entry.IDLE] = 0
            clock[entry.PROGRESS] = clock[entry.TIME]
        elastic = modes.restitution[c] == 1.0 and modes.shape[1] == 0  # without losses
        if f != 0 or resolved or not elastic or modes.frequency.shape[0]:
            times_matrix(modes.to_modes[0], z, x)
        if resolved:
            log_event(log, entry.IMPACT, c, motion, before, z)
            if logged:
                times_matrix(modes.leave[0], z, before)
            clock[entry.SPEED] = 0.0
            clock[entry.LOSS] = 0.0
            lift(modes, moving & ~left, x, work[0, : z.shape[0]])
            request_mode(counts, left, entry.STICK)
            continue
        alone = left == sticking
        left &= sticking
        if f != 0 and alone:
            # All that stick, and no others, take part: the same impact within their mode takes nothing through other coordinates.
            copy_1(scratch.kept, z)
            bounce(modes.rate[f], modes.push[f], modes.push_rest[f], c, 1.0 + modes.restitution[c], z)
            times_matrix(modes.to_modes[f], z, x)
            if modes.frequency.shape[0] and counts[entry.IMPACTS] % REFRESH == 0:
                write_loads(modes, counts[entry.BREAK_INDEX], clock, angles, x)
                times_matrix(modes.from_modes[f], x, z)
            counts[entry.MODE] = f
        elif f != 0:
            rebound = row_dot(modes.rate[0], c, z)
            lift(modes, (sticking & ~left) | (int64(1) << c), x, work[0, : z.shape[0]])
            after = find_mode(modes, left)
            if after < 0:
                request_mode(counts, left, entry.IMPACT)
                counts[entry.LEAVING] = c
                continue
            times_matrix(modes.from_modes[after], x, z)
            rebound -= row_dot(modes.rate[after], c, z)
            for r in range(z.shape[0]):
                z[r] += rebound * modes.push[after, c, r]
            counts[entry.MODE] = after
        elif modes.frequency.shape[0] and counts[entry.IMPACTS] % REFRESH == 0:
            write_loads(modes, counts[entry.BREAK_INDEX], clock, angles, x)
            times_matrix(modes.from_modes[0], x, z)
        log_event(log, entry.IMPACT, c, motion, before, z)
        counts[entry.LEAVING] = c
        if elastic:
            counts[entry.BOUNCES] = 0
            continue
        rest = (end - clock[entry.TIME]) - clock[entry.TIME_LOW]
        settle(modes, after, z)
        # Equation (28): the bounces end here, and the contact sticks.
        if chatter(modes, after, c, rest, motion, scratch.table, scratch.values):
            if logged:
                times_matrix(modes.from_modes[0], x, work[0])
                times_matrix(modes.leave[0], work[0], before)
            stop_contact(modes, c, motion, work)
            request_mode(counts, left | (int64(1) << c), entry.STICK)
            counts[entry.CONTACT] = c
            counts[entry.LEAVING] = -1


class BatchArrays(NamedTuple):
    """The motions of a batch."""

    starts: np.ndarray  # (B, 2 n) (u, v); become final states
    fractions: np.ndarray  # (Q,) of the initial energy, ascending
    summary: np.ndarray  # (B, 9 + (D + S + 1) + Q (D + S + 2) + n), see `many`
    modal: np.ndarray  # (B, 2 n) final states in modal coordinates


@kernel
def many(modes, batch, duration, most, first, motion, log, scratch):
    """Run a batch of motions from number `first` on, without a record of events.

    Row of the summary: reason, time reached, impacts, touches, last impact (NaN: none), clear from (NaN: not proven), time sticking,
    initial energy (given), 0, sums, each mark's time (NaN: not reached) and sums, and the peaks if required.

    Returns (reason, start). NEW_MODE: this start needs one more contact mode; add it and call again from this start. PAUSED:
    counts[PASSES] are used up; counts[RUNNING] makes the next call continue. REACHED with B: all motions are finished."""
    starts, fractions, summary, modal = batch
    z, x, counts, clock, angles, sums, marks, peaks = motion
    width = 2 * modes.shape[0]
    parts = sums.shape[0]
    for b in range(first, starts.shape[0]):
        if counts[entry.RUNNING] == 0:
            begin_anew(motion)
            copy_1(starts[b], x[:width])
            clock[entry.INITIAL] = summary[b, 7]
            for q in range(fractions.shape[0]):
                marks[q, 0] = fractions[q]
            if not clock[entry.INITIAL] > 0.0:
                counts[entry.MARK] = fractions.shape[0]
            set_1(peaks, 0.0)
        counts[entry.RUNNING] = 0
        status = move(modes, duration, most, motion, log, scratch)
        if status == PAUSED:
            counts[entry.RUNNING] = 1
        if status == NEW_MODE or status == PAUSED:
            return status, b
        row = summary[b]
        row[0] = status
        row[1] = duration if status == REACHED else clock[entry.TIME]
        row[2] = counts[entry.IMPACTS]
        row[3] = counts[entry.TOUCHES]
        row[4] = clock[entry.LAST_IMPACT] if counts[entry.IMPACTS] > 0 else math.nan
        row[5] = clock[entry.CLEAR_TIME] if counts[entry.CLEAR] > 0 else math.nan
        row[6] = clock[entry.STICKING_TIME]
        times_matrix(modes.leave[counts[entry.MODE]], z, x)
        copy_1(x, starts[b])
        times_matrix(modes.to_modes[counts[entry.MODE]], z, modal[b])
        sums_of(sums, row[9:])
        at = 9 + parts
        reached = counts[entry.MARK] if clock[entry.INITIAL] > 0.0 else 0
        for q in range(fractions.shape[0]):
            set_1(row[at : at + 1 + parts], math.nan)
            if q < reached:
                copy_1(marks[q, 1:], row[at : at + 1 + parts])
            at += 1 + parts
        copy_1(peaks, row[at : at + peaks.shape[0]])
    return REACHED, starts.shape[0]


@kernel
def states_after(modes, numbers, states, out):
    """out[k] = (u, v) with which the k-th flight begins, of flights as in `sample`."""
    for k in range(states.shape[0]):
        times_matrix(modes.leave[numbers[k, 2]], states[k], out[k])


@kernel
def sample(modes, begins, numbers, states, times, z, out):
    """out[i] = (u, v) at times[i] of flights that begin at begins (ascending) in the modes numbers[:, 2] with the given states; the last
    begin counts. z (N,) is scratch."""
    latest = 0.0
    for i in range(times.shape[0]):
        latest = max(latest, times[i])
    for i in range(times.shape[0]):
        k = flight_at(begins, times[i])
        f = numbers[k, 2]
        end = begins[k + 1] if k + 1 < begins.shape[0] else latest
        hold_path(flight_of(modes, f), states[k], end - begins[k])
        path_state(flight_of(modes, f), states[k], times[i] - begins[k], z)
        times_matrix(modes.leave[f], z, out[i])


@kernel
def spent(modes, begins, numbers, states, sums, times, work, integral, out):
    """out[i] = the sums at times[i], of flights as in `sample` that begin with the given sums."""
    latest = 0.0
    for i in range(times.shape[0]):
        latest = max(latest, times[i])
    for i in range(times.shape[0]):
        k = flight_at(begins, times[i])
        f = numbers[k, 2]
        end = begins[k + 1] if k + 1 < begins.shape[0] else latest
        hold_path(flight_of(modes, f), states[k], end - begins[k])
        dissipated_energy(modes, f, states[k], times[i] - begins[k], work, integral)
        copy_1(sums[k], out[i])
        for r in range(modes.part.shape[0]):
            out[i, modes.part[r]] += integral[r]


class Flights(NamedTuple):
    """Flights of a motion, one after the other."""

    begins: np.ndarray  # (F,) times
    numbers: np.ndarray  # (F, 3) int64, of which the last is the contact mode
    states: np.ndarray  # (F, N) at the begin of each
    end: float  # time at which the last one ends
