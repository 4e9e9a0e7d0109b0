"""The motion of a system through its phases: exact flight, next impact or release, restitution, chattering, sticking.

The distance of a held contact is its force, so `next_impact` finds impacts and releases alike."""

from numba import int64

from bvp.kernels.bounds import dot, fastest_rate
from bvp.kernels.chatter import chatter
from bvp.kernels.compiled import kernel, part
from bvp.kernels.held_impact import comes_to_rest, settle, strike_held, touches_held
from bvp.kernels.impact import EXHAUSTED, HIT, NONE, OUTSIDE, PRESSED, TOUCH, next_impact, rounding_level
from bvp.kernels.ledger import fly, hold, lose, record, record_chatter
from bvp.kernels.phase import (
    BOUNCES,
    BREAK,
    BREAK_INDEX,
    CLEAR,
    CLEAR_TIME,
    CONTACT,
    EVENTS,
    IDLE,
    IMPACT,
    IMPACTS,
    KIND,
    LAST_IMPACT,
    LEAVING,
    LOSS,
    PASSES,
    PENDING,
    PHASE,
    PIECE,
    PROGRESS,
    RELEASE,
    SPAN,
    SPEED,
    START,
    STICK,
    SWITCH_ERROR,
    TIME,
    TIME_LOW,
    TOUCHED,
    TOUCHES,
    cannot_hit,
    find_phase,
    reset_loads,
    times_matrix,
    write_loads,
)  # fmt: skip
from bvp.kernels.restitution import restitute
from bvp.kernels.simultaneous import at_their_bounds, clash, sunk

__all__ = ["CYCLING", "FULL", "GAVE_UP", "INTERACTING", "MOST", "NEW_PHASE", "PAUSED", "PIERCED", "REACHED", "STARTED_OUTSIDE", "move"]

REACHED, FULL, NEW_PHASE, INTERACTING, STARTED_OUTSIDE, MOST, CYCLING, GAVE_UP, PIERCED, PAUSED = range(10)
"""How `move` returned: at the duration; the log is full (call again); the phase counts[PENDING] is wanted (add it and call again); two
stops are hit at once and their impulses interact; started beyond a stop; at the most impacts; phases follow each other without time
passing; the search for the next impact, or for a peak, gave up without time passing; carried beyond a stop by rounding; counts[PASSES] are
used up (set them and call again). After REACHED, too, the motion can be carried on, to a longer duration."""

PATIENCE, INSTANT, SEARCH = 256, 16, 64
"""For each contact, and two more, so much may be spent within a radian of the fastest motion: 1 for each event, this for one to which no
time passes, and for a search that gave up."""

LIFTS = 8
"""Rounds in which contacts are lifted off what they are beyond: one can push another down."""

REFRESH = 256
"""Impacts, and breaks, after which the loads' states are written anew. In between they are carried by the flights like all others: passing
through (u, v) each time would round in one direction."""


@kernel
def count_impact(phases, c, speed, loss, counts, clock, sums, marks):
    """Take an impact at contact c into the counts, the clock and the sums."""
    lose(phases, c, loss, counts, clock, sums, marks)
    counts[IMPACTS] += 1
    clock[LAST_IMPACT] = clock[TIME]
    clock[SPEED] = speed
    clock[LOSS] = loss
    counts[CONTACT] = c


@part
def strike(phases, still, moving, c, counts, clock, sums, marks, z, scratch):
    """The impact at contact c in phase 0, with `still` and `moving` of `at_their_bounds`. Returns (the held contacts that stay, whether c
    is one of them); -1 where restitution does not define what follows."""
    speed = phases.side[0, c] * dot(phases.rate[0], c, z)
    stay = int64(0)
    if moving:
        stay, part, span = comes_to_rest(phases, still, moving, c, z, scratch.impulses)
        if stay:
            decided, loss = settle(phases, stay, part, z, scratch.impulses)
            if not decided:
                return int64(-1), False
            count_impact(phases, c, speed, loss, counts, clock, sums, marks)
            clock[SWITCH_ERROR] = max(clock[SWITCH_ERROR], span)
            return stay, True
        unknown, span = clash(phases, moving, c, z)
        if unknown:
            return int64(-1), False
        clock[SWITCH_ERROR] = max(clock[SWITCH_ERROR], span)
    if still and touches_held(phases, still, c):
        stay, loss = strike_held(phases, still, c, z, scratch.impulses)
        if stay < 0:
            return int64(-1), False
    else:
        stay = still
        restitution = phases.restitution[c]
        restitute(phases.rate[0], phases.push[0], phases.restitution, c, z, z)
        loss = 0.5 * phases.contact_mass[c] * (1.0 - restitution) * (1.0 + restitution) * speed * speed
    count_impact(phases, c, speed, loss, counts, clock, sums, marks)
    return stay, False


@kernel
def lift(phases, freed, x, z):
    """Move x (2 n + 2 G,), modal, so that the contacts of the bits of `freed` are not beyond their bounds: those held until now by what has
    been rounded since, others by what counts as a touch. z (N,) is scratch."""
    n = phases.shape[0]
    for _ in range(LIFTS):
        still = True
        for c in range(phases.side.shape[1]):
            if (freed >> c) & 1 == 0:
                continue
            times_matrix(phases.from_modes[0], x, z)
            beyond = dot(phases.gap[0], c, z) - phases.bound[0, c]
            if phases.side[0, c] * beyond > 0.0:
                still = False
                for i in range(n):
                    x[i] -= beyond * dot(phases.to_modes[0], n + i, phases.push[0, c])
        if still:
            break


@part
def impatient(phases, f, exhausted, flight, counts, clock):
    """Count the event after a flight in phase f; True where too many have come since the fastest motion has turned by a radian."""
    if exhausted:
        cost = SEARCH
    elif flight == 0.0:
        cost = INSTANT
    else:
        cost = 1
    counts[IDLE] += cost
    if counts[IDLE] <= PATIENCE * (2 + phases.side.shape[1]):
        return False
    now = clock[TIME] + flight
    if (now - clock[PROGRESS]) * fastest_rate(phases.pairs[f], phases.matrix[f]) < 1.0:
        return True
    counts[IDLE] = cost
    clock[PROGRESS] = now
    return False


@kernel
def move(phases, duration, most, z, x, counts, clock, turns, sums, marks, peaks, log, scratch):
    """Carry a motion on until its duration, its most impacts, or a reason to return.

    z (N,) state of the phase; x (2 n + 2 G,) the modal coordinates (at the start (u, v)) and the states of the loads, from which a pending
    phase begins; counts (COUNTS,), clock (CLOCK,): see above; turns (G, 2) angles of the loads and sums (D + S + 1, 2), compensated; marks
    (Q, 3 + D + S): fractions of the initial energy, ascending, then filled with the time at which that much is gone and the sums there;
    peaks (n,) largest displacements, or empty where they are not wanted. Returns the reason.

    It returns after counts[PASSES] events at most, the work for each of which is bounded. In the end it returns, whatever happens: impacts
    faster than rounding are at most `most`, and between two of them, or two breaks, every event is counted within each radian of the
    fastest motion, the more where it takes no time or makes no way (`impatient`).
    """
    before = scratch.before
    work = scratch.work
    logged = log.numbers.shape[0] > 0
    contacts = phases.side.shape[1]
    while True:
        if counts[PENDING] >= 0:
            f = find_phase(phases, counts[PENDING])
            if f < 0:
                return NEW_PHASE
            write_loads(phases, counts[BREAK_INDEX], clock, turns, x)
            if counts[KIND] == START:
                times_matrix(phases.enter[f], x, z)
            else:
                lift(phases, phases.held[counts[PHASE]] & ~phases.held[f], x, z)
                times_matrix(phases.from_modes[f], x, z)
            counts[PHASE] = f
            counts[PENDING] = -1
            if clock[SPAN] > 0.0:
                record_chatter(phases, f, log, counts, clock, before, z, sums, scratch)
            record(log, counts[KIND], counts[CONTACT], counts, clock, before, z, sums)
        if log.numbers.shape[0] and log.numbers.shape[0] - counts[EVENTS] <= contacts + 3:
            return FULL
        if counts[IMPACTS] >= most:
            return MOST
        if counts[PASSES] <= 0:
            return PAUSED
        counts[PASSES] -= 1
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
        if impatient(phases, f, status == EXHAUSTED, flight, counts, clock):
            return GAVE_UP if status == EXHAUSTED else CYCLING
        clock[SPEED] = 0.0
        clock[LOSS] = 0.0
        counts[LEAVING] = -1
        holds = c >= 0 and (held >> max(c, 0)) & 1 != 0
        begin = clock[TIME]
        if status == OUTSIDE and not holds:
            return STARTED_OUTSIDE if clock[TIME] == 0.0 and counts[IMPACTS] == 0 else PIERCED
        if status == EXHAUSTED and flight == 0.0:
            return GAVE_UP
        if not fly(phases, f, z, flight, counts, clock, turns, sums, marks, peaks, scratch):
            return GAVE_UP
        if logged:
            times_matrix(phases.leave[f], z, before)
        if status == NONE:
            if end == duration:
                if cannot_hit(phases, f, z):
                    counts[CLEAR] = 1
                    clock[CLEAR_TIME] = begin
                return REACHED
            clock[TIME] = end
            clock[TIME_LOW] = 0.0
            counts[BREAK_INDEX] = ahead
            counts[BOUNCES] = 0
            counts[IDLE] = 0
            clock[PROGRESS] = end
            if ahead % REFRESH == 0:
                times_matrix(phases.to_modes[f], z, x)
                write_loads(phases, ahead, clock, turns, x)
                times_matrix(phases.from_modes[f], x, z)
            else:
                reset_loads(phases, f, ahead, z)
            record(log, BREAK, -1, counts, clock, before, z, sums)
            continue
        if f != 0 or status != HIT:
            times_matrix(phases.to_modes[f], z, x)
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
            for r in range(z.shape[0]):
                scratch.kept[r] = z[r]
            write_loads(phases, counts[BREAK_INDEX], clock, turns, x)
            times_matrix(phases.from_modes[0], x, z)
            counts[PHASE] = 0
        still, moving = at_their_bounds(phases, c, z)
        if moving and sunk(phases, moving | (int64(1) << c), z):
            times_matrix(phases.to_modes[0], z, x)
            write_loads(phases, counts[BREAK_INDEX], clock, turns, x)
            lift(phases, moving | (int64(1) << c), x, z)
            times_matrix(phases.from_modes[0], x, z)
        still |= held
        fast = abs(dot(phases.rate[0], c, z)) > rounding_level(phases.pairs[0], phases.matrix[0], phases.rate[0], c, z)
        left, settled = strike(phases, still, moving & ~held, c, counts, clock, sums, marks, z, scratch)
        if left < 0:
            return INTERACTING
        if fast:
            counts[IDLE] = 0
            clock[PROGRESS] = clock[TIME]
        elastic = phases.restitution[c] == 1.0
        if f != 0 or settled or not elastic or phases.frequency.shape[0]:
            times_matrix(phases.to_modes[0], z, x)
        if settled:
            record(log, IMPACT, c, counts, clock, before, z, sums)
            if logged:
                times_matrix(phases.leave[0], z, before)
            clock[SPEED] = 0.0
            clock[LOSS] = 0.0
            lift(phases, moving & ~left, x, work[0, : z.shape[0]])
            counts[PENDING] = left
            counts[KIND] = STICK
            counts[BOUNCES] = 0
            continue
        alone = left == held
        left &= held
        if f != 0 and alone:
            # All that are held, and no others, take part: the same impact within their phase takes nothing through other coordinates.
            for r in range(z.shape[0]):
                z[r] = scratch.kept[r]
            restitute(phases.rate[f], phases.push[f], phases.restitution, c, z, z)
            times_matrix(phases.to_modes[f], z, x)
            if phases.frequency.shape[0] and counts[IMPACTS] % REFRESH == 0:
                write_loads(phases, counts[BREAK_INDEX], clock, turns, x)
                times_matrix(phases.from_modes[f], x, z)
            counts[PHASE] = f
        elif f != 0:
            rebound = dot(phases.rate[0], c, z)
            lift(phases, (held & ~left) | (int64(1) << c), x, work[0, : z.shape[0]])
            after = find_phase(phases, left)
            if after < 0:
                counts[PENDING] = left
                counts[KIND] = IMPACT
                counts[LEAVING] = c
                counts[BOUNCES] = 0
                continue
            times_matrix(phases.from_modes[after], x, z)
            rebound -= dot(phases.rate[after], c, z)
            for r in range(z.shape[0]):
                z[r] += rebound * phases.push[after, c, r]
            counts[PHASE] = after
        elif phases.frequency.shape[0] and counts[IMPACTS] % REFRESH == 0:
            write_loads(phases, counts[BREAK_INDEX], clock, turns, x)
            times_matrix(phases.from_modes[0], x, z)
        record(log, IMPACT, c, counts, clock, before, z, sums)
        counts[LEAVING] = c
        if elastic:
            counts[BOUNCES] = 0
            continue
        rest = (end - clock[TIME]) - clock[TIME_LOW]
        if chatter(phases, after, c, z, x, rest, counts, clock, turns, sums, scratch.table, scratch.values):
            if logged:
                times_matrix(phases.from_modes[0], x, work[0])
                times_matrix(phases.leave[0], work[0], before)
            hold(phases, c, x, counts, clock, sums, marks, work)
            counts[PENDING] = left | (int64(1) << c)
            counts[KIND] = STICK
            counts[CONTACT] = c
            counts[LEAVING] = -1
            counts[BOUNCES] = 0
