"""An impact while other contacts are held: Newton's law at all of them at once (Moreau).

A held contact has no speed, so restitution leaves it without: it takes the impulse that keeps it so, where that presses; where it would
pull, the contact parts and takes none. With r_i the rates and p_j the changes by a unit impulse, the impulses a solve

    r_i . (z - sum_j a_j p_j) = -restitution r_i . z   at the contact that is struck, = 0 at those that stay

The set that stays is found by Murty's principal pivoting: the first contact that errs, by a pull or by an approach, changes sides. It ends,
for the matrix r_i . p_j is c_i M^-1 c_j with scaled columns, and held gaps do not depend on each other."""

from numba import int64

from bvp.kernels.bounds import dot
from bvp.kernels.compiled import kernel
from bvp.kernels.impact import gauge, rounding_level
from bvp.kernels.simultaneous import interacts, struck_with

__all__ = ["resting", "strike_held", "touches_held"]


@kernel
def resting(phases, c, z):
    """The contacts other than c that the state z of phase 0 is on without speed, held or not: a body may lie on its stop unpressed."""
    found = int64(0)
    for k in range(phases.side.shape[1]):
        if k == c:
            continue
        d, slope, _, tolerance = gauge(phases.gap[0], phases.rate[0], phases.acceleration[0], phases.side[0], phases.bound[0], k, z)
        if d <= tolerance and abs(slope) <= rounding_level(phases.pairs[0], phases.matrix[0], phases.rate[0], k, z):
            found |= int64(1) << k
    return found


@kernel
def touches_held(phases, held, c, z):
    """(True where an impulse at contact c or at one struck with it acts on a held contact, number of contacts struck)."""
    acts = False
    struck = 0
    hit = c
    while hit >= 0:
        struck += 1
        for k in range(phases.side.shape[1]):
            acts = acts or ((held >> k) & 1 != 0 and interacts(phases.rate[0], phases.push[0], hit, k))
        hit = struck_with(
            phases.pairs[0], phases.matrix[0], phases.gap[0], phases.rate[0], phases.acceleration[0], phases.side[0], phases.bound[0],
            c, -1 if hit == c else hit, z,
        )  # fmt: skip
    return acts, struck


@kernel
def impulses_of(phases, active, c, z, table):
    """The impulses at the contacts of the bits of `active`, c among them, into the last column of table (m, m + 1); 0 at all others."""
    contacts = table.shape[0]
    for i in range(contacts):
        for j in range(contacts):
            table[i, j] = 0.0
            if (active >> i) & (active >> j) & 1 != 0:
                table[i, j] = dot(phases.rate[0], i, phases.push[0, j])
        speed = dot(phases.rate[0], i, z) if (active >> i) & 1 != 0 else 0.0
        table[i, contacts] = (1.0 + phases.restitution[c]) * speed if i == c else speed
        if (active >> i) & 1 == 0:
            table[i, i] = 1.0
    for k in range(contacts):
        for i in range(contacts):
            if i != k and table[i, k] != 0.0:
                factor = table[i, k] / table[k, k]
                for j in range(k, contacts + 1):
                    table[i, j] -= factor * table[k, j]
    for k in range(contacts):
        table[k, contacts] /= table[k, k]


@kernel
def strike_held(phases, held, c, z, table):
    """The impact at contact c while the contacts of the bits of `held` are held.

    z (N,) is the state of phase 0 before it, and after it on return; table (m, m + 1) is scratch. Returns (the held contacts that stay, the
    energy lost at c); (-1, 0) where rounding does not decide which stay."""
    contacts = table.shape[0]
    active = held | (int64(1) << c)
    for _ in range(8 * (contacts + 1)):
        impulses_of(phases, active, c, z, table)
        wrong = -1
        for k in range(contacts):
            if k == c or (held >> k) & 1 == 0:
                continue
            level = rounding_level(phases.pairs[0], phases.matrix[0], phases.rate[0], k, z)
            if (active >> k) & 1 != 0:
                err = -phases.side[0, k] * table[k, contacts]
            else:
                err = dot(phases.rate[0], k, z)
                for j in range(contacts):
                    err -= table[j, contacts] * dot(phases.rate[0], k, phases.push[0, j])
                err *= phases.side[0, k]
            if err > level:
                wrong = k
                break
        if wrong < 0:
            loss = 0.5 * phases.contact_mass[c] * table[c, contacts] * (1.0 - phases.restitution[c]) * dot(phases.rate[0], c, z)
            for j in range(contacts):
                for r in range(z.shape[0]):
                    z[r] -= table[j, contacts] * phases.push[0, j, r]
            return active & ~(int64(1) << c), loss
        active ^= int64(1) << wrong
    return int64(-1), 0.0
