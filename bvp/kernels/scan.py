"""Many starts at once: follow each through its impacts, and measure how far it misses each set of ends on its way.

For two degrees of freedom an orbit between ends is a zero of one number: what is transverse to the end's condition when the rest of
it holds. At an impact that is the velocity along the stop; where the gap coordinate passes zero, the other displacement (origin);
where its velocity passes zero, the other velocity (rest).
"""

import math

import numpy as np
from numba import int64

from bvp.kernels.compiled import allocating, kernel
from bvp.kernels.extrema import dot, look, refine, safe_step, separate
from bvp.kernels.flight import flow_state
from bvp.kernels.impact import HIT, NONE, TOUCH, next_impact
from bvp.kernels.restitution import restitute
from bvp.kernels.segment import STOP

__all__ = ["scan", "crossings"]

CROSSING_LIMIT = 20000


@kernel
def crossings(pairs, mean, delta, matrix, value, rate, second, z, duration, times, work):
    """Times in (0, duration) where value . z(t) changes sign, into `times`; a zero at the very end is no change. Returns how many there
    are (those beyond the length of `times` are counted, not kept); -1 when the search gave up."""
    pure, level, curvature, jerk = separate(pairs, mean, delta, matrix, value, second, z, duration, work)
    level *= 1e-13
    floor = 1e-12 * duration
    count = 0
    before = 0.0
    f_before = 0.0
    t = 0.0
    for _ in range(CROSSING_LIMIT):
        f, slope, bend = look(pairs, mean, delta, matrix, pure, work, value, rate, second, z, t)
        if t == 0.0:
            if abs(f) <= level:
                f = math.copysign(level, slope)
        elif (f > 0.0) != (f_before > 0.0) and (t < duration or abs(f) > level):
            guess = before + f_before / (f_before - f) * (t - before)
            root = refine(
                pairs, mean, delta, matrix, pure, value, rate, second, z, before, t, guess, f_before > 0.0, 1e-13 * duration, work
            )
            if count < times.shape[0]:
                times[count] = root
            count += 1
        if t >= duration:
            return count
        before = t
        f_before = f
        t = min(duration, t + max(safe_step(f, slope, bend, curvature, jerk), floor))
    return -1


@allocating
def scan(
    pairs, mean, delta, matrix, gap, gap_rate, acceleration, side, bound, push, restitution, kind, transverse, functional, starts,
    wanted, most_impacts, longest, word, times, values, ends, status, nodes, instants, work,
):
    """Follow each row of `starts` (M, N) for up to `most_impacts` inner impacts and the time `longest`.

    kind: ORIGIN, REST or STOP. transverse (2, N): the row that measures the miss, twice (after an impact at either contact).
    functional (3, N): the row whose zeros are the crossings (origin, rest), its derivative and its second one.
    wanted (K + 1,): 1 where the crossings after k inner impacts are looked for.
    word (M, K + 1): contacts hit, -1 after the last. times, values (M, K + 1, C): time and miss of the c-th crossing after k inner
    impacts, NaN where there is none (for STOP, C = 1 and the crossing is impact k + 1 itself). ends (M,): time followed.
    status (M,): 0 followed to a limit, 1 the next impact was not found (sticking, or a search that gave up).
    nodes (M, K, N), instants (M, K): states after the inner impacts and their times; of length 0 where they are not wanted.
    work: of `impact.work_array`."""
    size = starts.shape[1]
    z = np.empty(size)
    before = np.empty(size)
    scratch = np.empty(size)
    crossing_times = np.empty(times.shape[2])
    for m in range(starts.shape[0]):
        for r in range(size):
            z[r] = starts[m, r]
        leaving = int64(-1)
        elapsed = 0.0
        status[m] = 0
        for k in range(most_impacts + 1):
            horizon = longest - elapsed
            duration = 0.0
            for r in range(size):
                before[r] = z[r]
            while True:
                found, contact, time = next_impact(
                    pairs, mean, delta, matrix, gap, gap_rate, acceleration, side, bound, leaving, z, horizon - duration, work
                )
                if found != TOUCH:
                    break
                duration += time
                flow_state(pairs, mean, delta, matrix, z, time, scratch)
                for r in range(size):
                    z[r] = scratch[r]
                leaving = contact
            if found != HIT and found != NONE:
                status[m] = 1
                break
            duration += time
            if kind != STOP and wanted[k] == 1:
                count = crossings(
                    pairs, mean, delta, matrix, functional[0], functional[1], functional[2], before, duration, crossing_times, scratch
                )
                if count < 0:
                    status[m] = 1
                    break
                for c in range(min(count, times.shape[2])):
                    flow_state(pairs, mean, delta, matrix, before, crossing_times[c], scratch)
                    times[m, k, c] = elapsed + crossing_times[c]
                    values[m, k, c] = dot(transverse[0], scratch)
            elapsed += duration
            if found == NONE:
                break
            flow_state(pairs, mean, delta, matrix, before, duration, scratch)
            word[m, k] = contact
            if kind == STOP:
                times[m, k, 0] = elapsed
                values[m, k, 0] = dot(transverse[0], scratch)
            restitute(gap_rate, push, restitution, contact, scratch, z)
            if nodes.shape[0] > 0 and k < most_impacts:
                instants[m, k] = elapsed
                for r in range(size):
                    nodes[m, k, r] = z[r]
            leaving = contact
        ends[m] = elapsed
