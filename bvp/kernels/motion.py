"""The motion of a system through its phases: exact flight, next impact or release, restitution, chattering, sticking, energies.

Phases are the sets of contacts held (`bvp.phases`); the distance of a held contact is its force, so `next_impact` finds impacts and releases
alike. Energies are sums of integrals over flights and of the losses of impacts, compensated (Neumaier), never differences of energies.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import int64

from bvp.kernels.bounds import amplitudes, dot, fastest_rate
from bvp.kernels.chatter import LEVELS, extrapolate, stride_of
from bvp.kernels.compiled import kernel
from bvp.kernels.flight import flow_state
from bvp.kernels.impact import EXHAUSTED, HIT, NONE, OUTSIDE, PRESSED, TOUCH, gauge, next_impact, rounding_level
from bvp.kernels.integral import integrals
from bvp.kernels.restitution import restitute
from bvp.kernels.run import independent, interacts, struck_with

__all__ = [
    "BREAK", "CLEAR", "CLEAR_TIME", "CLOCK", "COUNTS", "CYCLING", "EVENTS", "FULL", "GAVE_UP", "HELD_TIME", "IMPACT", "IMPACTS", "INITIAL",
    "INTERACTING", "LAST_IMPACT", "MOST", "NEW_PHASE", "PENDING", "PHASE", "PIECE", "REACHED", "RELEASE", "START", "STARTED_OUTSIDE", "STICK",
    "SWITCH_ERROR", "TIME", "TIME_LOW", "TOUCHES", "TOUCHED", "Log", "Phases", "many", "move", "sample", "spent",
]  # fmt: skip

REACHED, FULL, NEW_PHASE, INTERACTING, STARTED_OUTSIDE, MOST, CYCLING, GAVE_UP = range(8)
"""How `move` returned: at the duration; the log is full (call again); the phase counts[PENDING] is wanted (add it and call again); two stops
are hit at once and their impulses interact; beyond a stop; at the most impacts; phases follow each other without time passing; the search for
the next impact gave up without time passing."""

START, IMPACT, TOUCHED, STICK, RELEASE, BREAK, PIECE = range(7)
"""Kinds of events in the log: the start; an impact; a touch; a contact that is held from here on; one that is held no more; a load that is
set anew; a flight that goes on."""

(PHASE, LEAVING, PENDING, KIND, CONTACT, EVENTS, IMPACTS, TOUCHES, IDLE, MARK, BREAK_INDEX, BOUNCES, ROWS, BOUNCING, CLEAR, COUNTS) = range(16)
"""Entries of counts, and their number."""

(TIME, TIME_LOW, INITIAL, LAST_IMPACT, HELD_TIME, CLEAR_TIME, SWITCH_ERROR, REFERENCE, REFERENCE_LOW, SPEED, LOSS, CLOCK) = range(12)
"""Entries of clock, and their number."""

CHATTER_REACH = 0.3
"""Time left to the end of chattering, times the fastest rate, below which its series is begun."""

SWITCH_TIME = 1e-13
"""Error allowed to the end of chattering, times the fastest rate."""

SWITCH_LEVEL = 2e-14
"""Error allowed to a displacement or velocity there, of the largest one, and to the energies, of the initial one."""


REFRESH = 256
"""Impacts, and breaks, after which the loads' states are written anew. In between they are carried by the flights like all others: passing
through (u, v) each time would round in one direction."""

FLAT = 1e-10
"""A bounce that rises less than this part of the contact tolerance is rest, though the series of the chattering has not come to its end."""


class Phases(NamedTuple):
    """F phases of N states (see `bvp.phases`), and what they share, for n coordinates, m contacts, R meters and G loads."""

    held: np.ndarray  # (F,) int64
    pairs: np.ndarray  # (F, P, 2)
    mean: np.ndarray  # (F, P)
    delta: np.ndarray  # (F, P)
    matrix: np.ndarray  # (F, N, N)
    leave: np.ndarray  # (F, 2 n, N)
    enter: np.ndarray  # (F, N, 2 n + 2 G)
    gap: np.ndarray  # (F, m, N)
    rate: np.ndarray  # (F, m, N)
    acceleration: np.ndarray  # (F, m, N)
    push: np.ndarray  # (F, m, N), of phase 0
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

    numbers: np.ndarray  # (E, 3) int64: kind, contact, phase after
    values: np.ndarray  # (E, 3) time, speed of approach, energy lost
    before: np.ndarray  # (E, 2 n) (u, v) just before
    states: np.ndarray  # (E, N) state of the phase after
    sums: np.ndarray  # (E, D + S + 1) dissipated by each damper and stop, work done, since the start


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
def advance_clock(phases, clock, turns, flight):
    """Add a flight to the time, kept in two parts, and to the angles of the loads."""
    for g in range(phases.frequency.shape[0]):
        add(turns, g, phases.frequency[g] * flight)
    total = clock[TIME] + flight
    clock[TIME_LOW] += (clock[TIME] - total) + flight if clock[TIME] >= flight else (flight - total) + clock[TIME]
    clock[TIME] = total + clock[TIME_LOW]
    clock[TIME_LOW] = (total - clock[TIME]) + clock[TIME_LOW]


@kernel
def write_loads(phases, index, clock, turns, x):
    """The present states of the loads, into x[2 n:]. The angles of harmonics are compensated sums, turns (G, 2): the product of a frequency
    with a long time would round to less than the flights are exact to."""
    at = 2 * phases.shape[0]
    for g in range(phases.frequency.shape[0]):
        if phases.frequency[g] > 0.0:
            c = math.cos(turns[g, 0])
            s = math.sin(turns[g, 0])
            x[at + 2 * g] = c - turns[g, 1] * s
            x[at + 2 * g + 1] = s + turns[g, 1] * c
        else:
            slope = phases.levels[index, g, 1]
            x[at + 2 * g] = phases.levels[index, g, 0] + slope * ((clock[TIME] - phases.breaks[index]) + clock[TIME_LOW])
            x[at + 2 * g + 1] = slope


@kernel
def reset_loads(phases, f, index, z):
    """What a break adds to the levels and slopes of the loads, in z."""
    span = phases.breaks[index] - phases.breaks[index - 1]
    at = 2 * phases.shape[0]
    for g in range(phases.frequency.shape[0]):
        slope = phases.levels[index, g, 1] - phases.levels[index - 1, g, 1]
        level = phases.levels[index, g, 0] - (phases.levels[index - 1, g, 0] + phases.levels[index - 1, g, 1] * span)
        for r in range(z.shape[0]):
            z[r] += phases.enter[f, r, at + 2 * g] * level + phases.enter[f, r, at + 2 * g + 1] * slope


@kernel
def times_matrix(matrix, x, out):
    """out = matrix x."""
    for r in range(matrix.shape[0]):
        total = 0.0
        for c in range(matrix.shape[1]):
            total += matrix[r, c] * x[c]
        out[r] = total


@kernel
def dissipated(sums, parts):
    """Sum of what the first `parts` sums hold."""
    total = 0.0
    for i in range(parts):
        total += sums[i, 0] + sums[i, 1]
    return total


@kernel
def note_mark(marks, counts, time, sums):
    """Write the time and the sums at the next mark."""
    row = counts[MARK]
    marks[row, 1] = time
    for i in range(sums.shape[0]):
        marks[row, 2 + i] = sums[i, 0] + sums[i, 1]
    counts[MARK] = row + 1


@kernel
def damped(phases, f, z, t, work, out):
    """What the dampers take over a flight of t from z; out (R,) the integrals."""
    integrals(
        phases.pairs[f], phases.mean[f], phases.delta[f], phases.matrix[f], phases.first[f], phases.second[f], phases.weight, z, t, work, out
    )
    total = 0.0
    for k in range(phases.part.shape[0]):
        if phases.part[k] < phases.shape[1]:
            total += out[k]
    return total


@kernel
def mark_flight(phases, f, z, flight, total, counts, clock, sums, marks, work, out):
    """Write the marks that are passed within a flight on which `total` is dissipated."""
    parts = phases.shape[1] + phases.shape[2]
    start = dissipated(sums, parts)
    while counts[MARK] < marks.shape[0] and start + total >= marks[counts[MARK], 0] * clock[INITIAL]:
        wanted = marks[counts[MARK], 0] * clock[INITIAL] - start
        low = 0.0
        high = flight
        miss_low = -wanted
        miss_high = total - wanted
        at = high
        last = 0
        for _ in range(200):
            if miss_high <= 0.0 or miss_low >= 0.0 or high - low <= 4e-16 * high:
                break
            at = high - miss_high * (high - low) / (miss_high - miss_low)
            if not low < at < high:
                at = 0.5 * (low + high)
            miss = damped(phases, f, z, at, work, out) - wanted
            if abs(miss) <= 1e-16 * clock[INITIAL]:
                break
            if miss > 0.0:
                high = at
                miss_high = miss
                if last == 1:
                    miss_low *= 0.5
                last = 1
            else:
                low = at
                miss_low = miss
                if last == -1:
                    miss_high *= 0.5
                last = -1
        damped(phases, f, z, at, work, out)
        row = counts[MARK]
        note_mark(marks, counts, clock[TIME] + at, sums)
        for k in range(phases.part.shape[0]):
            marks[row, 2 + phases.part[k]] += out[k]


@kernel
def fly(phases, f, z, flight, counts, clock, turns, sums, marks, work, out, integral_work):
    """Carry z, the clock and the sums over a flight."""
    if flight == 0.0:
        return
    total = damped(phases, f, z, flight, integral_work, out)
    if counts[MARK] < marks.shape[0]:
        mark_flight(phases, f, z, flight, total, counts, clock, sums, marks, integral_work, out)
        damped(phases, f, z, flight, integral_work, out)
    for k in range(phases.part.shape[0]):
        add(sums, phases.part[k], out[k])
    flow_state(phases.pairs[f], phases.mean[f], phases.delta[f], phases.matrix[f], z, flight, work[0])
    for r in range(z.shape[0]):
        z[r] = work[0, r]
    advance_clock(phases, clock, turns, flight)
    if phases.held[f] != 0:
        clock[HELD_TIME] += flight


@kernel
def lose(phases, c, loss, counts, clock, sums, marks):
    """Add the loss of an impact at contact c."""
    add(sums, phases.shape[1] + phases.contact_stop[c], loss)
    if counts[MARK] < marks.shape[0]:
        total = dissipated(sums, phases.shape[1] + phases.shape[2])
        while counts[MARK] < marks.shape[0] and total >= marks[counts[MARK], 0] * clock[INITIAL]:
            note_mark(marks, counts, clock[TIME], sums)


@kernel
def record(log, kind, contact, counts, clock, before, z, sums):
    """Write one event, where there is room."""
    row = counts[EVENTS]
    if row >= log.numbers.shape[0]:
        return
    log.numbers[row, 0] = kind
    log.numbers[row, 1] = contact
    log.numbers[row, 2] = counts[PHASE]
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


@kernel
def find_phase(phases, held):
    """Index of the phase in which just these contacts are held, or -1."""
    for f in range(phases.held.shape[0]):
        if phases.held[f] == held:
            return f
    return -1


@kernel
def cannot_hit(phases, f, z):
    """True where the bound of every gap, over all time to come, stays below its stop."""
    for c in range(phases.side.shape[1]):
        if (phases.held[f] >> c) & 1 != 0:
            return False
        level, _, _ = amplitudes(phases.pairs[f], phases.mean[f], phases.delta[f], phases.matrix[f], phases.gap[f], c, z, math.inf)
        if not level < phases.side[f, c] * phases.bound[f, c]:
            return False
    return True


@kernel
def out_of_reach(phases, f, c, z, span, speed, force):
    """True where no other contact can be met within a short `span` in which contact c chatters."""
    for k in range(phases.side.shape[1]):
        if k == c or phases.bound[f, k] >= 1e299:
            continue
        d, slope, bend, tolerance = gauge(phases.gap[f], phases.rate[f], phases.acceleration[f], phases.side[f], phases.bound[f], k, z)
        kick = 0.0
        if (phases.held[f] >> k) & 1 == 0:
            for r in range(phases.push.shape[2]):
                kick += phases.rate[0, k, r] * phases.push[0, c, r]
        moved = span * (abs(slope) + abs(kick) * (speed + force * span)) + span * span * abs(bend)
        if d - 4.0 * moved <= tolerance:
            return False
    return True


@kernel
def chatter(phases, f, c, z, x, left, counts, clock, turns, sums, table, values):
    """After an impact at contact c in phase f: True where chattering ends here, with x and the clock and the sums at its end.

    `left`: time to the duration or the next break. `table` (LEVELS, 2 n + 2 + D + S), `values` one row of it.
    """
    restitution = phases.restitution[c]
    _, slope, bend, tolerance = gauge(phases.gap[f], phases.rate[f], phases.acceleration[f], phases.side[f], phases.bound[f], c, z)
    width = 2 * phases.shape[0]
    parts = sums.shape[0]
    small = restitution < 1.0 and bend < 0.0 and slope * abs(slope) <= -2.0 * bend * FLAT * tolerance
    if restitution == 0.0 or restitution == 1.0 or bend >= 0.0:
        counts[BOUNCES] = 0
        return small
    fastest = fastest_rate(phases.pairs[f], phases.matrix[f])
    span = -2.0 * slope / (bend * (1.0 - restitution))
    if span * fastest > CHATTER_REACH or counts[BOUNCING] != c:
        counts[BOUNCES] = 0
        counts[BOUNCING] = c
    if span * fastest <= CHATTER_REACH:
        stride = stride_of(restitution)
        if counts[BOUNCES] == 0:
            clock[REFERENCE] = clock[TIME]
            clock[REFERENCE_LOW] = clock[TIME_LOW]
            counts[ROWS] = 0
        fresh = counts[BOUNCES] % stride == 0
        counts[BOUNCES] += 1
        if fresh:
            values[0] = (clock[TIME] - clock[REFERENCE]) + (clock[TIME_LOW] - clock[REFERENCE_LOW])
            for r in range(width):
                values[1 + r] = x[r]
            for i in range(parts):
                values[1 + width + i] = sums[i, 0] + sums[i, 1]
            extrapolate(table, counts[ROWS], restitution**stride, values)
            counts[ROWS] += 1
            order = min(counts[ROWS], LEVELS) - 1
            if order > 0:
                ahead = table[order, 0] - values[0]
                time_error = abs(table[order, 0] - table[order - 1, 0])
                size_u = 0.0
                size_v = 0.0
                state_error_u = 0.0
                state_error_v = 0.0
                for r in range(phases.shape[0]):
                    size_u = max(size_u, abs(x[r]))
                    size_v = max(size_v, abs(x[phases.shape[0] + r]))
                    state_error_u = max(state_error_u, abs(table[order, 1 + r] - table[order - 1, 1 + r]))
                    k = 1 + phases.shape[0] + r
                    state_error_v = max(state_error_v, abs(table[order, k] - table[order - 1, k]))
                energy_error = 0.0
                for i in range(parts):
                    k = 1 + width + i
                    energy_error += abs(table[order, k] - table[order - 1, k])
                good = time_error * fastest <= SWITCH_TIME and state_error_u <= SWITCH_LEVEL * max(size_u, size_v / fastest)
                good = good and state_error_v <= SWITCH_LEVEL * max(size_v, size_u * fastest)
                good = good and energy_error <= SWITCH_LEVEL * abs(clock[INITIAL])
                if (good or small) and 0.0 <= ahead < left and out_of_reach(phases, f, c, z, 2.0 * span, slope, -bend):
                    clock[SWITCH_ERROR] = max(clock[SWITCH_ERROR], time_error)
                    for r in range(width):
                        x[r] = table[order, 1 + r]
                    for i in range(parts):
                        add(sums, i, table[order, 1 + width + i] - values[1 + width + i])
                    advance_clock(phases, clock, turns, ahead)
                    return True
    if small:
        clock[SWITCH_ERROR] = max(clock[SWITCH_ERROR], span)
    return small


@kernel
def strike_all(phases, c, z, counts, clock, sums, marks, log, before):
    """The impacts at contact c and at those struck with it, in phase 0; False where their impulses interact."""
    pairs = phases.pairs[0]
    matrix = phases.matrix[0]
    gap = phases.gap[0]
    rate = phases.rate[0]
    acceleration = phases.acceleration[0]
    side = phases.side[0]
    bound = phases.bound[0]
    push = phases.push[0]
    if not independent(pairs, matrix, gap, rate, acceleration, side, bound, push, c, z):
        return False
    hit = c
    while hit >= 0:
        speed = side[hit] * dot(rate, hit, z)
        times_matrix(phases.leave[0], z, before)
        restitution = phases.restitution[hit]
        restitute(rate, push, phases.restitution, hit, z, z)
        loss = 0.5 * phases.contact_mass[hit] * (1.0 - restitution) * (1.0 + restitution) * speed * speed
        lose(phases, hit, loss, counts, clock, sums, marks)
        counts[IMPACTS] += 1
        clock[LAST_IMPACT] = clock[TIME]
        clock[SPEED] = speed
        clock[LOSS] = loss
        counts[CONTACT] = hit
        hit = struck_with(pairs, matrix, gap, rate, acceleration, side, bound, hit, -1, z)
        if hit >= 0:
            record(log, IMPACT, counts[CONTACT], counts, clock, before, z, sums)
    return True


@kernel
def held_after(phases, held, c, z):
    """The held contacts that an impact at contact c leaves held, from the state z of phase 0 after it; -1 where it presses one of them."""
    left = held
    for k in range(phases.side.shape[1]):
        if (held >> k) & 1 != 0 and interacts(phases.rate[0], phases.push[0], c, k):
            _, slope, _, _ = gauge(phases.gap[0], phases.rate[0], phases.acceleration[0], phases.side[0], phases.bound[0], k, z)
            if slope < -rounding_level(phases.pairs[0], phases.matrix[0], phases.rate[0], k, z):
                return -1
            left &= ~(int64(1) << k)
    return left


@kernel
def hold(phases, c, x, counts, clock, sums, marks, work):
    """Stop what is left of the velocity across contact c, as a loss at its stop."""
    times_matrix(phases.enter[0], x, work[0])
    speed = dot(phases.rate[0], c, work[0, : phases.matrix.shape[1]])
    loss = 0.5 * phases.contact_mass[c] * speed * speed
    lose(phases, c, loss, counts, clock, sums, marks)
    clock[SPEED] = abs(speed)
    clock[LOSS] = loss


@kernel
def move(phases, duration, most, z, x, counts, clock, turns, sums, marks, table, values, before, log, work, integral_work, out):
    """Carry a motion on until its duration, its most impacts, or a reason to return.

    z (N,) state of the phase; x (2 n + 2 G,) (u, v) and the states of the loads, from which a pending phase begins; counts (COUNTS,), clock
    (CLOCK,): see above; turns (G, 2) angles of the loads and sums (D + S + 1, 2), compensated; marks (Q, 3 + D + S): fractions of the initial energy, ascending, then filled with
    the time at which that much is gone and the sums there. out (R,); the other arrays are scratch. Returns the reason.
    """
    width = 2 * phases.shape[0]
    contacts = phases.side.shape[1]
    while True:
        if counts[PENDING] >= 0:
            f = find_phase(phases, counts[PENDING])
            if f < 0:
                return NEW_PHASE
            write_loads(phases, counts[BREAK_INDEX], clock, turns, x)
            times_matrix(phases.enter[f], x, z)
            counts[PHASE] = f
            counts[PENDING] = -1
            record(log, counts[KIND], counts[CONTACT], counts, clock, before, z, sums)
        if log.numbers.shape[0] and log.numbers.shape[0] - counts[EVENTS] <= contacts + 2:
            return FULL
        if counts[IMPACTS] >= most:
            return MOST
        f = counts[PHASE]
        held = phases.held[f]
        ahead = counts[BREAK_INDEX] + 1
        end = duration
        if ahead < phases.breaks.shape[0] and phases.breaks[ahead] < duration:
            end = phases.breaks[ahead]
        horizon = max((end - clock[TIME]) - clock[TIME_LOW], 0.0)
        status, c, flight = next_impact(
            phases.pairs[f], phases.mean[f], phases.delta[f], phases.matrix[f], phases.gap[f], phases.rate[f], phases.acceleration[f],
            phases.side[f], phases.bound[f], counts[LEAVING], z, horizon, work,
        )  # fmt: skip
        counts[IDLE] = counts[IDLE] + 1 if flight == 0.0 else 0
        if counts[IDLE] > 8 + 4 * contacts:
            return CYCLING
        clock[SPEED] = 0.0
        clock[LOSS] = 0.0
        counts[LEAVING] = -1
        holds = c >= 0 and (held >> max(c, 0)) & 1 != 0
        if status == NONE:
            begin = clock[TIME]
            fly(phases, f, z, flight, counts, clock, turns, sums, marks, work, out, integral_work)
            if end == duration:
                if cannot_hit(phases, f, z):
                    counts[CLEAR] = 1
                    clock[CLEAR_TIME] = begin
                return REACHED
            clock[TIME] = end
            clock[TIME_LOW] = 0.0
            counts[BREAK_INDEX] = ahead
            counts[BOUNCES] = 0
            times_matrix(phases.leave[f], z, x)
            for r in range(width):
                before[r] = x[r]
            if ahead % REFRESH == 0:
                write_loads(phases, ahead, clock, turns, x)
                times_matrix(phases.enter[f], x, z)
            else:
                reset_loads(phases, f, ahead, z)
            record(log, BREAK, -1, counts, clock, before, z, sums)
            continue
        if status == OUTSIDE and not holds:
            return STARTED_OUTSIDE
        if status == EXHAUSTED and flight == 0.0:
            return GAVE_UP
        fly(phases, f, z, flight, counts, clock, turns, sums, marks, work, out, integral_work)
        times_matrix(phases.leave[f], z, x)
        for r in range(width):
            before[r] = x[r]
        if status == EXHAUSTED:
            record(log, PIECE, -1, counts, clock, before, z, sums)
            continue
        if status == TOUCH:
            counts[LEAVING] = c
            if not holds:
                counts[TOUCHES] += 1
                record(log, TOUCHED, c, counts, clock, before, z, sums)
            continue
        counts[CONTACT] = c
        if holds:
            counts[PENDING] = held & ~(int64(1) << c)
            counts[KIND] = RELEASE
            counts[LEAVING] = -2 - c
            counts[BOUNCES] = 0
            continue
        if status == PRESSED:
            hold(phases, c, x, counts, clock, sums, marks, work)
            counts[PENDING] = held | (int64(1) << c)
            counts[KIND] = STICK
            counts[BOUNCES] = 0
            continue
        after = f
        if f != 0:
            write_loads(phases, counts[BREAK_INDEX], clock, turns, x)
            times_matrix(phases.enter[0], x, z)
            counts[PHASE] = 0
        if not strike_all(phases, c, z, counts, clock, sums, marks, log, before):
            return INTERACTING
        times_matrix(phases.leave[0], z, x)
        if counts[CONTACT] != c:
            counts[BOUNCES] = 0
            c = counts[CONTACT]
        left = held_after(phases, held, c, z) if held else held
        if left < 0:
            return INTERACTING
        if f != 0:
            after = find_phase(phases, left)
            if after < 0:
                counts[PENDING] = left
                counts[KIND] = IMPACT
                counts[LEAVING] = c
                counts[BOUNCES] = 0
                continue
            times_matrix(phases.enter[after], x, z)
            counts[PHASE] = after
        elif phases.frequency.shape[0] and counts[IMPACTS] % REFRESH == 0:
            write_loads(phases, counts[BREAK_INDEX], clock, turns, x)
            times_matrix(phases.enter[0], x, z)
        record(log, IMPACT, c, counts, clock, before, z, sums)
        counts[LEAVING] = c
        if chatter(phases, after, c, z, x, (end - clock[TIME]) - clock[TIME_LOW], counts, clock, turns, sums, table, values):
            for r in range(width):
                before[r] = x[r]
            hold(phases, c, x, counts, clock, sums, marks, work)
            counts[PENDING] = left | (int64(1) << c)
            counts[KIND] = STICK
            counts[CONTACT] = c
            counts[LEAVING] = -1
            counts[BOUNCES] = 0


@kernel
def sample(phases, begins, numbers, states, times, z, out):
    """out[i] = (u, v) at times[i] of flights that begin at begins (ascending) in the phases numbers[:, 2] with the given states; the last
    begin counts. z (N,) is scratch."""
    for i in range(times.shape[0]):
        low = 0
        high = begins.shape[0]
        while high - low > 1:
            middle = (low + high) // 2
            if begins[middle] <= times[i]:
                low = middle
            else:
                high = middle
        f = numbers[low, 2]
        flow_state(phases.pairs[f], phases.mean[f], phases.delta[f], phases.matrix[f], states[low], times[i] - begins[low], z)
        times_matrix(phases.leave[f], z, out[i])


@kernel
def spent(phases, begins, numbers, states, sums, times, work, integral, out):
    """out[i] = the sums at times[i], of flights as in `sample` that begin with the given sums."""
    for i in range(times.shape[0]):
        low = 0
        high = begins.shape[0]
        while high - low > 1:
            middle = (low + high) // 2
            if begins[middle] <= times[i]:
                low = middle
            else:
                high = middle
        f = numbers[low, 2]
        damped(phases, f, states[low], times[i] - begins[low], work, integral)
        for k in range(out.shape[1]):
            out[i, k] = sums[low, k]
        for k in range(phases.part.shape[0]):
            out[i, phases.part[k]] += integral[k]


@kernel
def many(phases, starts, duration, most, first, fractions, z, x, counts, clock, turns, sums, marks, table, values, before, log, work,
         integral_work, out, summary):
    """Motions from starts (B, 2 n), the `first`-th and on, without a record of events: one row of summary (B, 9 + (D + S + 1) +
    Q (D + S + 2)) each: reason, time reached, impacts, touches, last impact (NaN: none), clear from (NaN: not proven), time held, initial
    energy (read), final energy (left to the caller), sums, then each mark's time (NaN: not reached) and sums. starts become final states.

    Returns (reason, start): NEW_PHASE at the start that wants one more phase - add it and call again from there - or REACHED and B.
    """
    width = 2 * phases.shape[0]
    parts = sums.shape[0]
    for b in range(first, starts.shape[0]):
        for k in range(COUNTS):
            counts[k] = 0
        for k in range(CLOCK):
            clock[k] = 0.0
        counts[LEAVING] = -1
        for g in range(turns.shape[0]):
            turns[g, 0] = 0.0
            turns[g, 1] = 0.0
        for k in range(parts):
            sums[k, 0] = 0.0
            sums[k, 1] = 0.0
        for k in range(width):
            x[k] = starts[b, k]
        clock[INITIAL] = summary[b, 7]
        for q in range(fractions.shape[0]):
            marks[q, 0] = fractions[q]
        if not clock[INITIAL] > 0.0:
            counts[MARK] = fractions.shape[0]
        status = move(
            phases, duration, most, z, x, counts, clock, turns, sums, marks, table, values, before, log, work, integral_work, out
        )
        if status == NEW_PHASE:
            return NEW_PHASE, b
        row = summary[b]
        row[0] = status
        row[1] = duration if status == REACHED else clock[TIME]
        row[2] = counts[IMPACTS]
        row[3] = counts[TOUCHES]
        row[4] = clock[LAST_IMPACT] if counts[IMPACTS] > 0 else math.nan
        row[5] = clock[CLEAR_TIME] if counts[CLEAR] > 0 else math.nan
        row[6] = clock[HELD_TIME]
        times_matrix(phases.leave[counts[PHASE]], z, x)
        for k in range(width):
            starts[b, k] = x[k]
        for k in range(parts):
            row[9 + k] = sums[k, 0] + sums[k, 1]
        at = 9 + parts
        reached = counts[MARK] if clock[INITIAL] > 0.0 else 0
        for q in range(fractions.shape[0]):
            for k in range(1 + parts):
                row[at + k] = marks[q, 1 + k] if q < reached else math.nan
            at += 1 + parts
    return REACHED, starts.shape[0]
