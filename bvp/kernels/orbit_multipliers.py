"""Multipliers of an orbit under loads whose impacts take no direction away: eigenvalues of the product of its flights and saltations."""

from bvp.kernels.compiled import kernel
from bvp.kernels.flight import inner
from bvp.kernels.forced import motion_size
from bvp.kernels.stroboscopic import map_eigenvalues


@kernel
def orbit_multipliers(segment, y, factor, slowest, found):
    """found.values (2, 2 n): the multipliers of the orbit y that was evaluated last, in no order. found: `Stroboscopic`.

    slowest: the impact speed, over the size of the velocities, below which an impact grazes. Returns whether they are found: no impact
    grazes, and the iteration converges."""
    size = found.scale.shape[0]
    n = size // 2
    displacement, velocity, _ = motion_size(segment, y, factor.before)
    for r in range(n):
        found.scale[r] = displacement
        found.scale[n + r] = velocity
    for i in range(segment.shape[0] + 1):
        if segment.contact[i, 0] >= 0 and segment.side[i] * inner(segment.gap[i, :n], factor.before[i, n:size]) < slowest * velocity:
            return False
    return map_eigenvalues(segment, factor.flights, factor.before, found)
