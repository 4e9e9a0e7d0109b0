"""Newton's law at several contacts at once (Moreau): an impact while other contacts are held, and the end of bounces that go on together.

A held contact has no speed, so restitution leaves it without: it takes the impulse that keeps it so, where that presses; where it would
pull, the contact parts and takes none. With r_i the rates and p_j the changes by a unit impulse, the impulses a solve

    r_i . (z - sum_j a_j p_j) = -restitution r_i . z   at the contact that is struck, = 0 at those that stay

The set that stays is found by Murty's principal pivoting: the first contact that errs, by a pull or by an approach, changes sides. It ends,
for the matrix r_i . p_j is c_i M^-1 c_j with scaled columns, and held gaps do not depend on each other.

Bounces of several contacts that act on each other have one accumulation point. All the speeds across them are zero there, so the velocity
is that before less its part M^-1 c_S, whatever the order of the bounces; the contacts S that are held from there on are those that press
under the present forces, by the same pivoting with accelerations in place of rates. Bounces are followed one by one until none rises
beyond the contact tolerance, and what is left is taken at once, which is right to the distance that they would still go."""

import math

from numba import int64

from bvp.kernels.bounds import dot
from bvp.kernels.compiled import kernel
from bvp.kernels.impact import gauge, rounding_level
from bvp.kernels.simultaneous import INTERACTION_LEVEL, interacts, low

__all__ = ["comes_to_rest", "settle", "strike_held", "touches_held"]


@kernel
def touches_held(phases, held, c):
    """True where an impulse at contact c acts on a held contact."""
    for k in range(phases.side.shape[1]):
        if (held >> k) & 1 != 0 and interacts(phases.rate[0], phases.push[0], c, k):
            return True
    return False


@kernel
def impulses_of(phases, active, rows, c, factor, z, table):
    """The impulses at the contacts of the bits of `active` that take away rows . z, and at c `factor` times that, into the last column of
    table (m, m + 1); 0 at all others, and at those whose gap depends on the others and stops with them. False where it would not."""
    contacts = table.shape[0]
    largest = 0.0
    for i in range(contacts):
        for j in range(contacts):
            table[i, j] = 0.0
            if (active >> i) & (active >> j) & 1 != 0:
                table[i, j] = dot(phases.rate[0], i, phases.push[0, j])
        value = dot(rows, i, z) if (active >> i) & 1 != 0 else 0.0
        table[i, contacts] = factor * value if i == c else value
        largest = max(largest, abs(table[i, contacts]))
        if (active >> i) & 1 == 0:
            table[i, i] = 1.0
    for k in range(contacts):
        # r_k . p_k is 1 before the others are eliminated.
        if not table[k, k] > INTERACTION_LEVEL:
            if k == c or not abs(table[k, contacts]) <= INTERACTION_LEVEL * largest:
                return False
            for j in range(contacts + 1):
                table[k, j] = 0.0
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
def pivot(phases, active, held, rows, c, factor, z, table):
    """The contacts of `active` that take an impulse, as `impulses_of`, which are in the last column of table: those of `held` only where it
    presses. -1 where rounding does not decide which these are."""
    contacts = table.shape[0]
    for _ in range(8 * (contacts + 1)):
        if not impulses_of(phases, active, rows, c, factor, z, table):
            return int64(-1)
        wrong = -1
        for k in range(contacts):
            if k == c or (held >> k) & 1 == 0:
                continue
            level = rounding_level(phases.pairs[0], phases.matrix[0], rows, k, z)
            if (active >> k) & 1 != 0:
                err = -phases.side[0, k] * table[k, contacts]
            else:
                err = dot(rows, k, z)
                for j in range(contacts):
                    err -= table[j, contacts] * dot(phases.rate[0], k, phases.push[0, j])
                err *= phases.side[0, k]
            if err > level:
                wrong = k
                break
        if wrong < 0:
            return active
        active ^= int64(1) << wrong
    return int64(-1)


@kernel
def push_off(phases, z, table):
    """Take the impulses in the last column of table from z."""
    contacts = table.shape[0]
    for j in range(contacts):
        for r in range(z.shape[0]):
            z[r] -= table[j, contacts] * phases.push[0, j, r]


@kernel
def strike_held(phases, held, c, z, table):
    """The impact at contact c while the contacts of the bits of `held` are held.

    z (N,) is the state of phase 0 before it, and after it on return; table (m, m + 1) is scratch. Returns (the held contacts that stay, the
    energy lost at c); (-1, 0) where rounding does not decide which stay."""
    struck = int64(1) << c
    restitution = phases.restitution[c]
    active = pivot(phases, held | struck, held, phases.rate[0], c, 1.0 + restitution, z, table)
    if active < 0:
        return int64(-1), 0.0
    loss = 0.5 * phases.contact_mass[c] * table[c, table.shape[0]] * (1.0 - restitution) * dot(phases.rate[0], c, z)
    push_off(phases, z, table)
    return active & ~struck, max(loss, 0.0)


@kernel
def comes_to_rest(phases, still, moving, c, z, table):
    """(contacts held from here on, contacts that only must not approach any more, time that bounces would still last) where contact c
    bounces no higher than the contact tolerance and is pressed, while others of the bits of `moving`, which are within the tolerance of
    their bound, bounce no higher either; `still` as of `at_their_bounds`. (0, 0, 0) where that is not so."""
    struck = int64(1) << c
    if not low(phases, c, z, 1.0) or phases.restitution[c] == 1.0:
        return int64(0), int64(0), 0.0
    company = int64(0)
    for k in range(phases.side.shape[1]):
        if (moving >> k) & 1 != 0 and phases.restitution[k] < 1.0 and low(phases, k, z, 1.0):
            company |= int64(1) << k
    if company == 0:
        return int64(0), int64(0), 0.0
    together = still | company | struck
    rows = phases.acceleration[0]
    stay = pivot(phases, together, together, rows, -1, 1.0, z, table)
    if stay < 0 or stay & struck == 0:
        return int64(0), int64(0), 0.0
    speed = 0.0
    press = math.inf
    left = 1.0
    for k in range(phases.side.shape[1]):
        if ((company | struck) >> k) & 1 != 0:
            d, slope, bend, _ = gauge(phases.gap[0], phases.rate[0], phases.acceleration[0], phases.side[0], phases.bound[0], k, z)
            speed = max(speed, math.sqrt(slope * slope + 2.0 * abs(bend) * max(d, 0.0)))
        if (stay >> k) & 1 != 0:
            own = abs(table[k, table.shape[0]])
            if own <= rounding_level(phases.pairs[0], phases.matrix[0], rows, k, z):
                stay &= ~(int64(1) << k)
            else:
                press = min(press, own)
                left = min(left, 1.0 - phases.restitution[k])
    return stay, together & ~stay, 2.0 * speed / (press * left)


@kernel
def settle(phases, stay, part, z, table):
    """Stop the speeds across the contacts of the bits of `stay`, and those towards the stop of the bits of `part`, at the state z of phase
    0. Returns (True, the energy lost); (False, 0) where rounding does not decide which are stopped."""
    if pivot(phases, stay | part, part, phases.rate[0], -1, 1.0, z, table) < 0:
        return False, 0.0
    loss = 0.0
    for k in range(table.shape[0]):
        before = dot(phases.rate[0], k, z)
        after = before
        for j in range(table.shape[0]):
            after -= table[j, table.shape[0]] * dot(phases.rate[0], k, phases.push[0, j])
        loss += 0.5 * phases.contact_mass[k] * table[k, table.shape[0]] * (before + after)
    push_off(phases, z, table)
    return True, max(loss, 0.0)
