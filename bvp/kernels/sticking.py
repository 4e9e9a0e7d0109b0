"""The end of chattering, and impacts while other contacts stick.

If a force presses a body against a stop, its bounces shrink by the restitution. The speed s after each impact obeys s -> restitution s (1 +
O(s)). The iterates of this map are a power series in restitution^k (Koenigs), and so are time, displacements, velocities and energies lost.
With q = restitution^stride, values after every stride-th impact are x_k = x + a_1 q^k + a_2 q^2k + ..., and Neville's scheme, equation
(28), takes one power away after the other.

The difference between the two last orders is the error of the lower one. The stride keeps q below 1/2, so rounding grows tenfold at most.

Newton's law holds at several contacts at once (Moreau), equation (8). A sticking contact has no speed before and after the impact. It takes
the impulse that this requires if the impulse presses. If it would pull, the contact opens and takes none. With r_i the rates and p_j the
changes by a unit impulse, the impulses a solve

    r_i . (z - sum_j a_j p_j) = -restitution r_i . z   at the contact that is hit, = 0 at those that keep sticking

Murty's principal pivoting finds the set that stays: the first contact with a wrong sign, a pull or an approach, changes sides. It ends,
since the matrix r_i . p_j is c_i M^-1 c_j with scaled columns, and sticking gaps do not depend on each other.

Bounces of several contacts that act on each other have one accumulation point. There all speeds across the contacts S are zero. The
velocity loses its part along M^-1 c_S, whatever the order of the bounces. The contacts that press under the present forces then stick;
the same pivoting finds them, with accelerations in place of rates. Bounces are followed one by one until none rises beyond the contact
tolerance. The remaining velocity is then removed at once, with an error of the distance that the bounces would still cover.
"""

import math

from numpy import int64

from bvp.kernels import contact_mode as entry
from bvp.kernels.compiled import kernel
from bvp.kernels.contact_mode import add, advance_clock, contacts_of, flight_of, sums_of
from bvp.kernels.flight import ROUNDING, copy_1, row_dot, set_1
from bvp.kernels.flights import NEAR_REACH, fastest, rounding_level
from bvp.kernels.impact import NEAR, RELEASED, gauge

LEVELS = 10
"""Orders kept."""

CHATTER_REACH = 0.3
"""Time left to the end of chattering, times the fastest rate, below which its series is begun."""

SWITCH_TIME = 1e-13
"""Error allowed to the end of chattering, times the fastest rate."""

SWITCH_LEVEL = 2e-14
"""Error allowed to a displacement or velocity there, of the largest one, and to the energies, of the largest one."""

FLAT = 1e-10
"""A bounce that rises less than this part of the contact tolerance, or no faster than rounding, is rest, though the series of the
chattering has not come to its end."""


@kernel
def stride_of(restitution):
    """Number of impacts between two values that the extrapolation uses."""
    return max(1, int(math.ceil(math.log(0.5) / math.log(restitution))))


@kernel
def extrapolate(table, rows, ratio, values):
    """Add the next values (W,) to the extrapolation; `rows` counts the earlier ones. `table` (LEVELS, W) keeps the last value of each
    order, the highest order in row min(rows, LEVELS - 1)."""
    for w in range(values.shape[0]):
        new = values[w]
        power = 1.0
        # Equation (28), one order after the other.
        for i in range(min(rows, LEVELS - 1) + 1):
            old = table[i, w]
            table[i, w] = new
            power *= ratio
            new = (new - power * old) / (1.0 - power)


@kernel
def out_of_reach(modes, f, c, z, span, speed, force):
    """True if no other contact can be hit within a short `span` in which contact c chatters."""
    for k in range(modes.side.shape[1]):
        if k == c or modes.bound[f, k] >= 1e299:
            continue
        d, slope, bend, tolerance = gauge(contacts_of(modes, f), k, z)
        kick = 0.0
        if (modes.sticking[f] >> k) & 1 == 0:
            for r in range(modes.push.shape[2]):
                kick += modes.rate[0, k, r] * modes.push[0, c, r]
        moved = span * (abs(slope) + abs(kick) * (speed + force * span)) + span * span * abs(bend)
        if d - 4.0 * moved <= tolerance:
            return False
    return True


@kernel
def chatter(modes, f, c, left, motion, table, values):
    """After an impact at contact c in contact mode f: True where chattering ends here, with x and the clock and the sums at its end.

    `left`: time to the duration or the next break. `table` (LEVELS, 2 n + 2 + D + S), `values` one row of it.
    """
    z, x, counts, clock, angles, sums = motion.z, motion.x, motion.counts, motion.clock, motion.angles, motion.sums
    restitution = modes.restitution[c]
    _, slope, bend, tolerance = gauge(contacts_of(modes, f), c, z)
    width = 2 * modes.shape[0]
    parts = sums.shape[0]
    quickest = fastest(flight_of(modes, f))
    small = slope * abs(slope) <= -2.0 * bend * FLAT * tolerance
    # So is one whose speed is rounding, and one within the tolerance that outlasts the series of its distance: the dampers end it there.
    small |= slope <= rounding_level(flight_of(modes, f), modes.rate[f], c, z)
    small |= slope * quickest > -0.5 * bend * NEAR_REACH and -2.0 * slope * slope >= bend * tolerance
    if restitution == 1.0:
        # Where a damper acts on its gap, each elastic bounce is slower than the one before, too: those within the tolerance are none.
        kick, slowed = row_dot(modes.rate[f], c, modes.push[f, c]), -row_dot(modes.acceleration[f], c, modes.push[f, c])
        small = slope * slowed / kick > -ROUNDING * bend and -2.0 * slope * slope >= bend * tolerance
    small &= bend < 0.0
    if restitution == 0.0 or restitution == 1.0 or bend >= 0.0:
        counts[entry.BOUNCES] = 0
        return small
    # Time to the end of the bounces, were the press constant: a geometric series.
    span = -2.0 * slope / (bend * (1.0 - restitution))
    if span * quickest > CHATTER_REACH or counts[entry.BOUNCING] != c:
        counts[entry.BOUNCES] = 0
        counts[entry.BOUNCING] = c
    if span * quickest <= CHATTER_REACH:
        stride = stride_of(restitution)
        if counts[entry.BOUNCES] == 0:
            clock[entry.REFERENCE] = clock[entry.TIME]
            clock[entry.REFERENCE_LOW] = clock[entry.TIME_LOW]
            counts[entry.ROWS] = 0
        fresh = counts[entry.BOUNCES] % stride == 0
        counts[entry.BOUNCES] += 1
        if fresh:
            values[0] = (clock[entry.TIME] - clock[entry.REFERENCE]) + (clock[entry.TIME_LOW] - clock[entry.REFERENCE_LOW])
            copy_1(x, values[1 : 1 + width])
            sums_of(sums, values[1 + width :])
            extrapolate(table, counts[entry.ROWS], restitution**stride, values)
            counts[entry.ROWS] += 1
            order = min(counts[entry.ROWS], LEVELS) - 1
            if order > 0:
                # The error estimate is the difference of the two highest orders.
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
                energy = abs(clock[entry.INITIAL])
                energy_error = 0.0
                for i in range(parts):
                    k = 1 + width + i
                    energy = max(energy, abs(values[k]))
                    energy_error += abs(table[order, k] - table[order - 1, k])
                good = time_error * quickest <= SWITCH_TIME and state_error_u <= SWITCH_LEVEL * max(size_u, size_v / quickest)
                good = good and state_error_v <= SWITCH_LEVEL * max(size_v, size_u * quickest)
                good = good and energy_error <= SWITCH_LEVEL * energy
                if (good or small) and 0.0 <= ahead < left and out_of_reach(modes, f, c, z, 2.0 * span, slope, -bend):
                    clock[entry.SWITCH_ERROR] = max(clock[entry.SWITCH_ERROR], time_error)
                    copy_1(table[order, 1:], x[:width])
                    for i in range(parts):
                        add(sums, i, table[order, 1 + width + i] - values[1 + width + i])
                    advance_clock(modes, clock, angles, ahead)
                    if modes.sticking[f] != 0:
                        clock[entry.STICKING_TIME] += ahead
                    clock[entry.SPAN] = ahead
                    return True
    if small:
        clock[entry.SWITCH_ERROR] = max(clock[entry.SWITCH_ERROR], span)
    return small


@kernel
def touches_sticking(modes, sticking, c):
    """True where an impulse at contact c acts on a sticking contact."""
    for k in range(modes.side.shape[1]):
        if (sticking >> k) & 1 != 0 and interacts(modes.rate[0], modes.push[0], c, k):
            return True
    return False


@kernel
def closed_contacts(modes, still, sticking, c, z):
    """The contacts of the bits of `still` that keep closed under an impact at contact c, at the state z of mode 0: those that stick, and
    those without rebound, which need no force. At an impact of rounding, as where bodies collapse, it is all of them."""
    level = RELEASED * rounding_level(flight_of(modes, 0), modes.rate[0], c, z)
    if abs(row_dot(modes.rate[0], c, z)) <= level:
        return still
    closed = still & sticking
    for k in range(modes.side.shape[1]):
        if (still >> k) & 1 != 0 and modes.restitution[k] == 0.0:
            closed |= int64(1) << k
    return closed


@kernel
def driven_together(modes, touching, c, z):
    """True where the impact at contact c, after which the state is z of mode 0, has made a contact of the bits of `touching` approach.

    These touch without a force between them. The impact goes on through them at the same instant, and its outcome depends on whether they
    touch: restitution does not define it."""
    for k in range(modes.side.shape[1]):
        if (touching >> k) & 1 != 0 and interacts(modes.rate[0], modes.push[0], c, k):
            if modes.side[0, k] * row_dot(modes.rate[0], k, z) > rounding_level(flight_of(modes, 0), modes.rate[0], k, z):
                return True
    return False


@kernel
def impulses_of(modes, active, rows, c, factor, z, table):
    """Solve equation (8) for the impulses at the contacts of the bits of `active`, into the last column of table (m, m + 1).

    The impulses take away rows . z at each contact, and `factor` times that at contact c. They are 0 at all other contacts. The gap of a
    contact can depend on those of the others. If it stops with them, its impulse is 0; if not, the result is False."""
    contacts = table.shape[0]
    largest = 0.0
    # The matrix and right side of equation (8).
    for i in range(contacts):
        for j in range(contacts):
            table[i, j] = 0.0
            if (active >> i) & (active >> j) & 1 != 0:
                table[i, j] = row_dot(modes.rate[0], i, modes.push[0, j])
        value = row_dot(rows, i, z) if (active >> i) & 1 != 0 else 0.0
        table[i, contacts] = factor * value if i == c else value
        largest = max(largest, abs(table[i, contacts]))
        if (active >> i) & 1 == 0:
            table[i, i] = 1.0
    for k in range(contacts):
        # Gauss-Jordan elimination of equation (8).
        # r_k . p_k is 1 before the others are eliminated.
        if not table[k, k] > INTERACTION_LEVEL:
            if k == c or not abs(table[k, contacts]) <= INTERACTION_LEVEL * largest:
                return False
            set_1(table[k], 0.0)
            for i in range(contacts):
                table[i, k] = 0.0
            table[k, k] = 1.0
            continue
        for i in range(contacts):
            if i != k and table[i, k] != 0.0:
                factor = table[i, k] / table[k, k]
                for j in range(k, contacts + 1):
                    table[i, j] -= factor * table[k, j]
    for k in range(contacts):
        table[k, contacts] /= table[k, k]
    return True


@kernel
def pivot(modes, active, sticking, rows, c, factor, z, table):
    """The contacts of `active` that take an impulse; those of `sticking` take one only where it presses. They are in the last column of
    table, as of `impulses_of`. Returns -1 where rounding does not decide which contacts these are."""
    contacts = table.shape[0]
    for _ in range(8 * (contacts + 1)):
        if not impulses_of(modes, active, rows, c, factor, z, table):
            return int64(-1)
        # Murty's rule: the first contact that pulls, or that approaches without an impulse, changes sides.
        wrong = -1
        for k in range(contacts):
            if k == c or (sticking >> k) & 1 == 0:
                continue
            level = rounding_level(flight_of(modes, 0), rows, k, z)
            if (active >> k) & 1 != 0:
                err = -modes.side[0, k] * table[k, contacts]
            else:
                err = row_dot(rows, k, z)
                for j in range(contacts):
                    err -= table[j, contacts] * row_dot(modes.rate[0], k, modes.push[0, j])
                err *= modes.side[0, k]
            if err > level:
                wrong = k
                break
        if wrong < 0:
            return active
        active ^= int64(1) << wrong
    return int64(-1)


@kernel
def push_off(modes, z, table):
    """Apply the impulses in the last column of table to z."""
    # Equation (8): z less its impulses.
    contacts = table.shape[0]
    for j in range(contacts):
        for r in range(z.shape[0]):
            z[r] -= table[j, contacts] * modes.push[0, j, r]


@kernel
def impact_while_sticking(modes, sticking, c, z, table):
    """The impact at contact c while the contacts of the bits of `sticking` stick.

    z (N,) is the state of mode 0 before it, and after it on return; table (m, m + 1) is scratch. Returns (the contacts that keep sticking,
    the energy lost at c); (-1, 0) where rounding does not decide which these are."""
    hit = int64(1) << c
    restitution = modes.restitution[c]
    active = pivot(modes, sticking | hit, sticking, modes.rate[0], c, 1.0 + restitution, z, table)
    if active < 0:
        return int64(-1), 0.0
    # Energy lost at c: impulse times the mean speed before and after.
    loss = 0.5 * modes.contact_mass[c] * table[c, table.shape[0]] * (1.0 - restitution) * row_dot(modes.rate[0], c, z)
    push_off(modes, z, table)
    return active & ~hit, max(loss, 0.0)


@kernel
def comes_to_rest(modes, still, moving, c, z, table):
    """Whether contact c and others come to rest together.

    They do if they bounce no higher than the contact tolerance, and c is pressed. still, moving: the other contacts at their bounds, as
    `at_their_bounds` returns them. Returns (bits of the contacts that stick from here on, bits of those that only must not approach any
    more, time that bounces would still last), or (0, 0, 0) if c does not come to rest."""
    hit = int64(1) << c
    if not low(modes, c, z, 1.0) or modes.restitution[c] == 1.0:
        return int64(0), int64(0), 0.0
    others = int64(0)
    for k in range(modes.side.shape[1]):
        if (moving >> k) & 1 != 0 and modes.restitution[k] < 1.0 and low(modes, k, z, 1.0):
            others |= int64(1) << k
    if others == 0:
        return int64(0), int64(0), 0.0
    together = still | others | hit
    rows = modes.acceleration[0]
    stay = pivot(modes, together, together, rows, -1, 1.0, z, table)
    if stay < 0 or stay & hit == 0:
        return int64(0), int64(0), 0.0
    speed = 0.0
    press = math.inf
    left = 1.0
    for k in range(modes.side.shape[1]):
        if ((others | hit) >> k) & 1 != 0:
            d, slope, bend, _ = gauge(contacts_of(modes, 0), k, z)
            speed = max(speed, math.sqrt(slope * slope + 2.0 * abs(bend) * max(d, 0.0)))
        if (stay >> k) & 1 != 0:
            own = abs(table[k, table.shape[0]])
            if own <= rounding_level(flight_of(modes, 0), rows, k, z):
                stay &= ~(int64(1) << k)
            else:
                press = min(press, own)
                left = min(left, 1.0 - modes.restitution[k])
    return stay, together & ~stay, 2.0 * speed / (press * left)


@kernel
def bring_to_rest(modes, stay, part, z, table):
    """Stop contacts, at the state z (N,) of mode 0.

    Those of the bits of `stay` lose all speed across the contact, those of `part` only a speed towards the stop. Returns (True, the energy
    lost), or (False, 0) if rounding does not decide which of `part` are stopped."""
    if pivot(modes, stay | part, part, modes.rate[0], -1, 1.0, z, table) < 0:
        return False, 0.0
    loss = 0.0
    for k in range(table.shape[0]):
        before = row_dot(modes.rate[0], k, z)
        after = before
        for j in range(table.shape[0]):
            after -= table[j, table.shape[0]] * row_dot(modes.rate[0], k, modes.push[0, j])
        loss += 0.5 * modes.contact_mass[k] * table[k, table.shape[0]] * (before + after)
    push_off(modes, z, table)
    return True, max(loss, 0.0)


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
def at_their_bounds(modes, c, z):
    """Bits of the contacts other than c within the contact tolerance of their bound, at the state z of mode 0: (those without speed, those
    with). The former need not stick: a body may lie on its stop unpressed."""
    still = int64(0)
    moving = int64(0)
    for k in range(modes.side.shape[1]):
        if k == c:
            continue
        d, slope, _, tolerance = gauge(contacts_of(modes, 0), k, z)
        if d <= tolerance:
            if abs(slope) <= rounding_level(flight_of(modes, 0), modes.rate[0], k, z):
                still |= int64(1) << k
            else:
                moving |= int64(1) << k
    return still, moving


@kernel
def sunk(modes, bits, z):
    """True where rounding has carried a contact of `bits` a good part of the tolerance beyond its bound, at the state z of mode 0."""
    for k in range(modes.side.shape[1]):
        if (bits >> k) & 1 != 0:
            d, _, _, tolerance = gauge(contacts_of(modes, 0), k, z)
            if d < -0.25 * tolerance:
                return True
    return False


@kernel
def low(modes, k, z, heights):
    """True if contact k moves so slowly that its accelerations, at full size, would stop it within `heights` contact tolerances."""
    _, slope, _, tolerance = gauge(contacts_of(modes, 0), k, z)
    size = 0.0
    for r in range(z.shape[0]):
        size += abs(modes.acceleration[0, k, r] * z[r])
    return slope * slope <= 2.0 * size * heights * tolerance


@kernel
def clash(modes, moving, c, z):
    """(True if it cannot be decided which of two contacts hits first; uncertainty of the end of bounces, in time).

    The two contacts are c and one of the bits of `moving`. They arrive together and act on each other."""
    open_time = 0.0
    _, speed, press, _ = gauge(contacts_of(modes, 0), c, z)
    for k in range(modes.side.shape[1]):
        if (moving >> k) & 1 == 0 or not interacts(modes.rate[0], modes.push[0], c, k):
            continue
        d, slope, bend, _ = gauge(contacts_of(modes, 0), k, z)
        if slope > 0.0:
            continue
        if not (low(modes, c, z, NEAR) and low(modes, k, z, NEAR)):
            return True, 0.0
        if d <= rounding_level(flight_of(modes, 0), modes.gap[0], k, z):
            open_time = max(open_time, (abs(speed) + abs(slope)) / max(abs(press), abs(bend)))
    return False, open_time
