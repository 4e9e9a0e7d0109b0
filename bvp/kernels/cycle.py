"""The whole period of an orbit, unfolded from the solved segment by its reversals.

An orbit is continued beyond an end by the reversal that the end belongs to: (q, p) -> (-q, p) at an origin, (q, p) -> (q, -p) at a rest or
stop end, with time reversed. A segment between an origin and a rest or stop end is a quarter: after its reflection the orbit
stands at minus its start, and the second half period is the negative of the first.
"""

from numba import int64

from bvp.kernels.compiled import inlined, kernel, part
from bvp.kernels.segment import ORIGIN, STOP, start_state

__all__ = ["count_impacts", "unfold"]


@part
def count_impacts(shape):
    """Impacts in the whole period."""
    k = shape[0]
    if shape[1] == 1:
        return k + 1
    turn = 2 * k + (1 if shape[4] == STOP else 0) + (1 if shape[3] == STOP else 0)
    return turn * 2 if shape[2] == 1 else turn


@kernel
def _put(before, after, row, count, ahead, first, source_before, source_after, node, sign, flip_q, flip_p, duration):
    """Add one impact; `ahead` is the free time since the last one."""
    half = before.shape[1] // 2
    for r in range(half):
        before[count, r] = sign * flip_q * source_before[r]
        before[count, half + r] = sign * flip_p * source_before[half + r]
        after[count, r] = sign * flip_q * source_after[r]
        after[count, half + r] = sign * flip_p * source_after[half + r]
    row[count] = node
    if count == 0:
        first = ahead
    else:
        duration[count - 1] = ahead
    return count + 1, first


@inlined
def unfold(segment, y, ends, before, after, duration, row, work):
    """Impacts of the whole period in order of time: states before and after each (P, N), the free time after it (P,), and the
    row of the node arrays that describes its contact (P,). `ends` (k + 1, N) holds the state at the end of each flight. Returns
    (impacts, time from the start to the first one)."""
    size = segment.matrix.shape[0]
    half = size // 2
    k = segment.shape[0]
    s = segment.start_map.shape[1]
    start = work[0, :size]
    mirror = work[1, :size]
    start_state(segment.start_map, segment.start_offset, y, start)
    count = int64(0)
    first = 0.0
    if segment.shape[1] == 1:
        for i in range(k + 1):
            at = s if i == 0 else s + 1 + (i - 1) * (size + 1) + size
            duration[i] = y[at]
            source = start if i == 0 else y[at - size : at]
            node = k if i == 0 else i - 1
            row[i] = node
            for r in range(size):
                after[i, r] = source[r]
                before[i, r] = ends[k if i == 0 else i - 1, r]
        return k + 1, 0.0
    reflect_q = -1.0 if segment.shape[4] == ORIGIN else 1.0
    sign = 1.0
    ahead = 0.0
    for _ in range(2 if segment.shape[2] == 1 else 1):
        for i in range(k + 1):
            at = s + i * (size + 1)
            ahead += y[at]
            if i < k:
                count, first = _put(
                    before, after, row, count, ahead, first, ends[i], y[at + 1 : at + 1 + size], i, sign, 1.0, 1.0, duration
                )
                ahead = 0.0
        if segment.shape[4] == STOP:
            for r in range(half):
                mirror[r] = ends[k, r]
                mirror[half + r] = -ends[k, half + r]
            count, first = _put(before, after, row, count, ahead, first, ends[k], mirror, k, sign, 1.0, 1.0, duration)
            ahead = 0.0
        for i in range(k, -1, -1):
            at = s + i * (size + 1)
            ahead += y[at]
            if i > 0:
                count, first = _put(
                    before, after, row, count, ahead, first, y[at - size : at], ends[i - 1], i - 1, sign,
                    reflect_q, -reflect_q, duration,
                )
                ahead = 0.0
        if segment.shape[2] == 1:
            sign = -sign
        if segment.shape[3] == STOP:
            for r in range(half):
                mirror[r] = start[r]
                mirror[half + r] = -start[half + r]
            count, first = _put(before, after, row, count, ahead, first, mirror, start, k + 1, sign, 1.0, 1.0, duration)
            ahead = 0.0
    if count > 0:
        duration[count - 1] = ahead + first
    return count, first
