"""The end of chattering from the impacts before it.

The bounces on a stop that presses back shrink by the restitution: the speed s of leaving obeys s -> restitution s (1 + O(s)), a map whose
iterates are a power series in restitution^k (Koenigs), and so is everything that moves with them: time, displacements, velocities, energies
lost. With q = restitution^stride, values after every stride-th impact are x_k = x + a_1 q^k + a_2 q^2k + ..., and Neville's scheme with
these known ratios takes one power away after the other:

    x_k^(i) = (x_k^(i-1) - q^i x_(k-1)^(i-1))/(1 - q^i)

The difference between the two last orders is the error of the lower one. The stride keeps q below 1/2, so rounding grows tenfold at most.
"""

import math

from bvp.kernels import contact_mode as entry
from bvp.kernels.bounds import fastest_rate
from bvp.kernels.compiled import kernel, part
from bvp.kernels.contact_mode import contacts_of, flight_of
from bvp.kernels.energy_budget import add, advance_clock
from bvp.kernels.impact import gauge

LEVELS = 10
"""Orders kept."""

CHATTER_REACH = 0.3
"""Time left to the end of chattering, times the fastest rate, below which its series is begun."""

SWITCH_TIME = 1e-13
"""Error allowed to the end of chattering, times the fastest rate."""

SWITCH_LEVEL = 2e-14
"""Error allowed to a displacement or velocity there, of the largest one, and to the energies, of the initial one."""

FLAT = 1e-10
"""A bounce that rises less than this part of the contact tolerance is rest, though the series of the chattering has not come to its end."""


@kernel
def stride_of(restitution):
    """Impacts between two values used."""
    return max(1, int(math.ceil(math.log(0.5) / math.log(restitution))))


@kernel
def extrapolate(table, rows, ratio, values):
    """Take in the next values (W,), the `rows`-th since the chatter began (from 0); `table` (LEVELS, W) keeps the last value of each order,
    the highest one in row min(rows, LEVELS - 1)."""
    for w in range(values.shape[0]):
        new = values[w]
        power = 1.0
        for i in range(min(rows, LEVELS - 1) + 1):
            old = table[i, w]
            table[i, w] = new
            power *= ratio
            new = (new - power * old) / (1.0 - power)


@kernel
def out_of_reach(modes, f, c, z, span, speed, force):
    """True where no other contact can be met within a short `span` in which contact c chatters."""
    for k in range(modes.side.shape[1]):
        if k == c or modes.bound[f, k] >= 1e299:
            continue
        d, slope, bend, tolerance = gauge(contacts_of(modes, f), k, z)
        kick = 0.0
        if (modes.held[f] >> k) & 1 == 0:
            for r in range(modes.push.shape[2]):
                kick += modes.rate[0, k, r] * modes.push[0, c, r]
        moved = span * (abs(slope) + abs(kick) * (speed + force * span)) + span * span * abs(bend)
        if d - 4.0 * moved <= tolerance:
            return False
    return True


@part
def chatter(modes, f, c, z, x, left, counts, clock, turns, sums, table, values):
    """After an impact at contact c in contact mode f: True where chattering ends here, with x and the clock and the sums at its end.

    `left`: time to the duration or the next break. `table` (LEVELS, 2 n + 2 + D + S), `values` one row of it.
    """
    restitution = modes.restitution[c]
    _, slope, bend, tolerance = gauge(contacts_of(modes, f), c, z)
    width = 2 * modes.shape[0]
    parts = sums.shape[0]
    small = restitution < 1.0 and bend < 0.0 and slope * abs(slope) <= -2.0 * bend * FLAT * tolerance
    if restitution == 0.0 or restitution == 1.0 or bend >= 0.0:
        counts[entry.BOUNCES] = 0
        return small
    fastest = fastest_rate(flight_of(modes, f))
    span = -2.0 * slope / (bend * (1.0 - restitution))
    if span * fastest > CHATTER_REACH or counts[entry.BOUNCING] != c:
        counts[entry.BOUNCES] = 0
        counts[entry.BOUNCING] = c
    if span * fastest <= CHATTER_REACH:
        stride = stride_of(restitution)
        if counts[entry.BOUNCES] == 0:
            clock[entry.REFERENCE] = clock[entry.TIME]
            clock[entry.REFERENCE_LOW] = clock[entry.TIME_LOW]
            counts[entry.ROWS] = 0
        fresh = counts[entry.BOUNCES] % stride == 0
        counts[entry.BOUNCES] += 1
        if fresh:
            values[0] = (clock[entry.TIME] - clock[entry.REFERENCE]) + (clock[entry.TIME_LOW] - clock[entry.REFERENCE_LOW])
            for r in range(width):
                values[1 + r] = x[r]
            for i in range(parts):
                values[1 + width + i] = sums[i, 0] + sums[i, 1]
            extrapolate(table, counts[entry.ROWS], restitution**stride, values)
            counts[entry.ROWS] += 1
            order = min(counts[entry.ROWS], LEVELS) - 1
            if order > 0:
                ahead = table[order, 0] - values[0]
                time_error = abs(table[order, 0] - table[order - 1, 0])
                size_u = 0.0
                size_v = 0.0
                state_error_u = 0.0
                state_error_v = 0.0
                for r in range(modes.shape[0]):
                    size_u = max(size_u, abs(x[r]))
                    size_v = max(size_v, abs(x[modes.shape[0] + r]))
                    state_error_u = max(state_error_u, abs(table[order, 1 + r] - table[order - 1, 1 + r]))
                    k = 1 + modes.shape[0] + r
                    state_error_v = max(state_error_v, abs(table[order, k] - table[order - 1, k]))
                energy_error = 0.0
                for i in range(parts):
                    k = 1 + width + i
                    energy_error += abs(table[order, k] - table[order - 1, k])
                good = time_error * fastest <= SWITCH_TIME and state_error_u <= SWITCH_LEVEL * max(size_u, size_v / fastest)
                good = good and state_error_v <= SWITCH_LEVEL * max(size_v, size_u * fastest)
                good = good and energy_error <= SWITCH_LEVEL * abs(clock[entry.INITIAL])
                if (good or small) and 0.0 <= ahead < left and out_of_reach(modes, f, c, z, 2.0 * span, slope, -bend):
                    clock[entry.SWITCH_ERROR] = max(clock[entry.SWITCH_ERROR], time_error)
                    for r in range(width):
                        x[r] = table[order, 1 + r]
                    for i in range(parts):
                        add(sums, i, table[order, 1 + width + i] - values[1 + width + i])
                    advance_clock(modes, clock, turns, ahead)
                    if modes.held[f] != 0:
                        clock[entry.HELD_TIME] += ahead
                    clock[entry.SPAN] = ahead
                    return True
    if small:
        clock[entry.SWITCH_ERROR] = max(clock[entry.SWITCH_ERROR], span)
    return small
