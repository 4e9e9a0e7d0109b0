"""Largest displacements over a flight: at its ends and where a velocity passes zero, which is found as the next impact of that velocity."""

import math

from bvp.kernels.bounds import amplitudes, dot
from bvp.kernels.compiled import kernel
from bvp.kernels.flight import flow_state
from bvp.kernels.impact import EXHAUSTED, NONE, OUTSIDE, TOUCH, next_impact, rounding_level

__all__ = ["PEAK_ROWS", "peak_flight"]

PEAK_ROWS = 6
"""Rows of the scratch array."""

IDLE_LIMIT = 8
"""Searches without time passing after which there is no way on."""

FRUITLESS = 2
"""Such searches after which time is made to pass."""

PAUSE = 1e-3
"""That time, in radians. Rate and two derivatives are zero to rounding at its begin, so that |u| can exceed its values at both
ends by no more than a part 1e-13 of its amplitude."""


@kernel
def row_times_matrix(rows, c, matrix, out):
    """out[0] = rows[c] matrix."""
    for r in range(matrix.shape[1]):
        total = 0.0
        for k in range(matrix.shape[0]):
            total += rows[c, k] * matrix[k, r]
        out[0, r] = total


@kernel
def peak_flight(pairs, mean, delta, matrix, leave, z, flight, peaks, scratch, edge, work):
    """peaks (n,): the larger of themselves and |u| over a flight from z (N,), with (u, v) = leave z. False where the search gave up.

    scratch (PEAK_ROWS, 1, N), edge (2, 1), work of `impact.work_array`."""
    n = peaks.shape[0]
    now = scratch[3, 0]
    later = scratch[4, 0]
    side = edge[0]
    bound = edge[1]
    bound[0] = 0.0
    for i in range(n):
        level, _, _ = amplitudes(pairs, mean, delta, matrix, leave, i, z, flight)
        if level <= peaks[i]:
            continue
        peaks[i] = max(peaks[i], abs(dot(leave, i, z)))
        for r in range(z.shape[0]):
            now[r] = z[r]
            scratch[0, 0, r] = leave[n + i, r]
        row_times_matrix(leave, n + i, matrix, scratch[1])
        row_times_matrix(scratch[1], 0, matrix, scratch[2])
        rate = dot(leave, n + i, z)
        # At rest, or without acceleration too, as where an impulse hits another coordinate, the next derivative tells where it goes.
        if abs(rate) <= rounding_level(pairs, matrix, leave, n + i, z):
            rate = dot(scratch[1], 0, z)
            if abs(rate) <= rounding_level(pairs, matrix, scratch[1], 0, z):
                rate = dot(scratch[2], 0, z)
        side[0] = -1.0 if rate > 0.0 else 1.0
        left = flight
        leaving = -1
        idle = 0
        while left > 0.0 and peaks[i] < level:
            status, _, step = next_impact(
                pairs, mean, delta, matrix, scratch[0], scratch[1], scratch[2], side, bound, leaving, now, left, work
            )
            if status == NONE:
                step = left
            idle = idle + 1 if step == 0.0 else 0
            if idle > IDLE_LIMIT:
                return False
            resumed = idle > FRUITLESS
            if resumed:
                # At rest with no derivative that tells where it goes, as where a force on a far coordinate begins: a little later one does.
                rate, bend, _ = amplitudes(pairs, mean, delta, matrix, scratch[0], 0, now, left)
                step = min(left, PAUSE * math.sqrt(rate / bend)) if bend > 0.0 else left
            flow_state(pairs, mean, delta, matrix, now, step, later)
            peaks[i] = max(peaks[i], abs(dot(leave, i, later)))
            for r in range(z.shape[0]):
                now[r] = later[r]
            left -= step
            if status != TOUCH and status != EXHAUSTED:
                side[0] = -side[0]
            leaving = -1 if status == OUTSIDE or status == EXHAUSTED else 0
            if resumed:
                leaving = -1
                side[0] = -1.0 if dot(scratch[0], 0, now) > 0.0 else 1.0
    return True
