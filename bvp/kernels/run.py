"""The event-driven run: exact flight, next impact, restitution, again and again.

Simultaneous impacts: contacts within the contact tolerance of their bound and approaching when another one is hit. They are
taken one after the other where the impulse of one does not change the rate of the other (rows c_i M^-1 c_j = 0); else the run
stops.

Chattering: once a bounce would rise less than the contact tolerance, it cannot be told from rest on the stop, and the run
stops.
"""

from bvp.kernels.compiled import kernel
from bvp.kernels.flight import flow_state
from bvp.kernels.impact import EXHAUSTED, HIT, NONE, OUTSIDE, PRESSED, TOUCH, gauge, next_impact, rounding_level
from bvp.kernels.restitution import restitute

__all__ = ["CHATTERING", "FULL", "GAVE_UP", "REACHED", "SIMULTANEOUS", "STARTED_OUTSIDE", "STICKING", "run", "sample"]

REACHED, FULL, CHATTERING, STICKING, SIMULTANEOUS, STARTED_OUTSIDE, GAVE_UP = 0, 1, 2, 3, 4, 5, 6
"""How a run ended: at its duration; with the output arrays full; in ever smaller bounces; pressed against a stop; in
simultaneous impacts that interact; before it began, beyond a stop; in a search that gave up."""

INTERACTION_LEVEL = 1e-13
"""c_i M^-1 c_j below this fraction of the sizes it is summed from is rounding."""


@kernel
def interacts(rate_rows, push, first, second):
    """True where the impulse of contact `first` changes the rate of contact `second` by more than rounding."""
    change = 0.0
    size = 0.0
    for r in range(rate_rows.shape[1]):
        part = rate_rows[second, r] * push[first, r]
        change += part
        size += abs(part)
    return abs(change) > INTERACTION_LEVEL * size


@kernel
def struck_with(pairs, matrix, gap, rate_rows, acceleration, side, bound, hit, after, z):
    """The first contact after `after`, other than `hit`, that is within the tolerance and approaching; -1 where there is
    none."""
    for c in range(after + 1, side.shape[0]):
        if c == hit:
            continue
        d, slope, _, tolerance = gauge(gap, rate_rows, acceleration, side, bound, c, z)
        if d <= tolerance and slope < -rounding_level(pairs, matrix, rate_rows, c, z):
            return c
    return -1


@kernel
def independent(pairs, matrix, gap, rate_rows, acceleration, side, bound, push, hit, z):
    """True where no two of the contacts struck together (`hit` and those that `struck_with` finds) interact."""
    first = hit
    while first >= 0:
        after = -1 if first == hit else first
        second = struck_with(pairs, matrix, gap, rate_rows, acceleration, side, bound, hit, after, z)
        while second >= 0:
            if interacts(rate_rows, push, first, second):
                return False
            second = struck_with(pairs, matrix, gap, rate_rows, acceleration, side, bound, hit, second, z)
        first = struck_with(pairs, matrix, gap, rate_rows, acceleration, side, bound, hit, after, z)
    return True


@kernel
def settles(gap, rate_rows, acceleration, side, bound, c, z):
    """True where the motion after an impact presses back so soon that the bounce stays within the contact tolerance."""
    _, slope, bend, tolerance = gauge(gap, rate_rows, acceleration, side, bound, c, z)
    return bend < 0.0 and slope * abs(slope) <= -2.0 * bend * tolerance


@kernel
def run(
    pairs, mean, delta, matrix, gap, rate_rows, acceleration, side, bound, push, restitution, leaving, duration,
    times, contacts, touches, before, after, z, work,
):  # fmt: skip
    """Run z for `duration` from a start on contact `leaving` (-1: none); z becomes the final state.

    Each event fills a row of times (E,), contacts (E,), touches (E,) (1: a touch, 0: an impact), before and after (E, N).
    `work` comes from `impact.work_array`. Returns (status, events, time reached).
    """
    size = z.shape[0]
    room = times.shape[0]
    count = 0
    t = 0.0
    while True:
        if count == room:
            return FULL, count, t
        status, c, flight = next_impact(
            pairs, mean, delta, matrix, gap, rate_rows, acceleration, side, bound, leaving, z, duration - t, work
        )
        if status == OUTSIDE:
            return STARTED_OUTSIDE, count, t
        if status == EXHAUSTED:
            return GAVE_UP, count, t
        if status == PRESSED:
            return STICKING, count, t
        flow_state(pairs, mean, delta, matrix, z, flight, work[0])
        for r in range(size):
            z[r] = work[0, r]
        if status == NONE:
            return REACHED, count, duration
        t += flight
        leaving = c
        if status == HIT and not independent(pairs, matrix, gap, rate_rows, acceleration, side, bound, push, c, z):
            return SIMULTANEOUS, count, t
        hit = c
        while hit >= 0:
            if count == room:
                return FULL, count, t
            times[count] = t
            contacts[count] = hit
            touches[count] = 1 if status == TOUCH else 0
            for r in range(size):
                before[count, r] = z[r]
            if status == HIT:
                restitute(rate_rows, push, restitution, hit, z, z)
            for r in range(size):
                after[count, r] = z[r]
            count += 1
            if status == HIT and settles(gap, rate_rows, acceleration, side, bound, hit, z):
                return (STICKING if restitution[hit] == 0.0 else CHATTERING), count, t
            hit = struck_with(pairs, matrix, gap, rate_rows, acceleration, side, bound, hit, -1, z) if status == HIT else -1


@kernel
def sample(pairs, mean, delta, matrix, begins, states, times, out):
    """out[i] = state at times[i] of flights that begin at begins (F,) (ascending) with states (F, N); the last begin counts."""
    for i in range(times.shape[0]):
        low = 0
        high = begins.shape[0]
        while high - low > 1:
            middle = (low + high) // 2
            if begins[middle] <= times[i]:
                low = middle
            else:
                high = middle
        flow_state(pairs, mean, delta, matrix, states[low], times[i] - begins[low], out[i])
