"""Contacts near their bound when another one is hit: which lie on it, which come down on it, and whether it is known which comes first.

An impact is taken alone; what it throws onto its stop, or what arrives within rounding, is the next impact. Where the impulse of one does
not change the rate of the other (rows c_i M^-1 c_j = 0) their order is the same to both. Where it does, the order is told by the distances
as long as bounces are followed that are near their stop; of fast bodies that arrive within the contact tolerance of each other it is not
told, and restitution does not define what follows."""

from numba import int64

from bvp.kernels.compiled import kernel
from bvp.kernels.impact import NEAR, gauge, rounding_level

__all__ = ["at_their_bounds", "clash", "interacts", "low", "sunk"]

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
def at_their_bounds(phases, c, z):
    """Bits of the contacts other than c within the contact tolerance of their bound, at the state z of phase 0: (those without speed, held
    or not, for a body may lie on its stop unpressed; those with)."""
    still = int64(0)
    moving = int64(0)
    for k in range(phases.side.shape[1]):
        if k == c:
            continue
        d, slope, _, tolerance = gauge(phases.gap[0], phases.rate[0], phases.acceleration[0], phases.side[0], phases.bound[0], k, z)
        if d <= tolerance:
            if abs(slope) <= rounding_level(phases.pairs[0], phases.matrix[0], phases.rate[0], k, z):
                still |= int64(1) << k
            else:
                moving |= int64(1) << k
    return still, moving


@kernel
def sunk(phases, bits, z):
    """True where rounding has carried a contact of `bits` a good part of the tolerance beyond its bound, at the state z of phase 0."""
    for k in range(phases.side.shape[1]):
        if (bits >> k) & 1 != 0:
            d, _, _, tolerance = gauge(phases.gap[0], phases.rate[0], phases.acceleration[0], phases.side[0], phases.bound[0], k, z)
            if d < -0.25 * tolerance:
                return True
    return False


@kernel
def low(phases, k, z, heights):
    """True where contact k moves so slowly that its accelerations, taken by their sizes, stop it within `heights` contact tolerances."""
    _, slope, _, tolerance = gauge(phases.gap[0], phases.rate[0], phases.acceleration[0], phases.side[0], phases.bound[0], k, z)
    size = 0.0
    for r in range(z.shape[0]):
        size += abs(phases.acceleration[0, k, r] * z[r])
    return slope * slope <= 2.0 * size * heights * tolerance


@kernel
def clash(phases, moving, c, z):
    """(True where a contact of the bits of `moving` arrives together with c, acts on it, and it is not known which is first; how far the
    end of bounces is left open where rounding tells, in time)."""
    open_time = 0.0
    _, speed, press, _ = gauge(phases.gap[0], phases.rate[0], phases.acceleration[0], phases.side[0], phases.bound[0], c, z)
    for k in range(phases.side.shape[1]):
        if (moving >> k) & 1 == 0 or not interacts(phases.rate[0], phases.push[0], c, k):
            continue
        d, slope, bend, _ = gauge(phases.gap[0], phases.rate[0], phases.acceleration[0], phases.side[0], phases.bound[0], k, z)
        if slope > 0.0:
            continue
        if not (low(phases, c, z, NEAR) and low(phases, k, z, NEAR)):
            return True, 0.0
        if d <= rounding_level(phases.pairs[0], phases.matrix[0], phases.gap[0], k, z):
            open_time = max(open_time, (abs(speed) + abs(slope)) / max(abs(press), abs(bend)))
    return False, open_time
