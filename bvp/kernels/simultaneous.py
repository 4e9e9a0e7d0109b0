"""Impacts at one instant: contacts within the contact tolerance of their bound and approaching when another one is hit.

They are taken one after the other where the impulse of one does not change the rate of the other (rows c_i M^-1 c_j = 0); else restitution
does not define what follows."""

from bvp.kernels.compiled import kernel
from bvp.kernels.impact import gauge, rounding_level

__all__ = ["independent", "interacts", "struck_with"]

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

