"""Crossings of motions by the far ends: which flights can hold an orbit, and where it is."""

import math

from numba import int64

from bvp.kernels.compiled import kernel, part
from bvp.kernels.follow import CONTACT, DURATION, RESIDUAL, TIME, advance, amplitude, follow
from bvp.kernels.segment import ORIGIN, REST, STOP

MARGIN = 1.2
"""Factor on the bounds that are drawn from samples."""


@kernel
def approaches(flow, kind, row, along, r, tube, window, found, work):
    """Crossings of one flight by zero displacement (kind ORIGIN) or zero velocity (REST), seen by all starts within r of the middle.

    along (4,): derivative of the state by x; tube: how much its displacements (velocities) may differ from that. Times of crossings that
    hold one orbit at most go into `found`. Returns their number, -1 where the interval has to be split."""
    y = work[7, :4]
    dy = work[8, :4]
    at = 0 if kind == ORIGIN else 2
    fastest = 0.0
    turning = 0.0
    first = int64(1) if kind == ORIGIN else int64(2)
    for k in range(2):
        v = amplitude(flow.squares[k], row[k], row[k + 2], window, first)
        fastest += v * v
        v = amplitude(flow.squares[k], along[k], along[k + 2], window, first)
        turning += v * v
    fastest = math.sqrt(fastest)
    turning = math.sqrt(turning)
    t = 0.0
    if row[TIME] == 0.0:
        # The start itself is no crossing: from zero the motion goes on in one direction for at least this long.
        first_rate = 0.0
        bend = 0.0
        for k in range(2):
            p = row[k + 2] if kind == ORIGIN else flow.squares[k] * row[k]
            first_rate += p * p
            v = amplitude(flow.squares[k], row[k], row[k + 2], window, int64(2) if kind == ORIGIN else int64(1))
            if kind == REST:
                v *= abs(flow.squares[k])
            bend += v * v
        size = 0.0
        for k in range(2):
            size += row[at + k] * row[at + k]
        if size <= 1e-20 * first_rate and bend > 0.0:
            t = math.sqrt(first_rate / bend)
    lipschitz = fastest + MARGIN * r * turning
    count = 0
    inside = False
    entered = 0.0
    best = math.inf
    best_time = 0.0
    for _ in range(100000):
        if t > window:
            break
        advance(flow.squares, t, row[:4], along, y, dy)
        size = math.hypot(y[at], y[at + 1])
        reach = MARGIN * r * (math.hypot(dy[at], dy[at + 1]) + tube)
        near = size <= 1.5 * reach
        if near:
            if not inside:
                inside = True
                entered = t
                best = math.inf
            if size < best:
                best = size
                best_time = t
            if (t - entered) * fastest > 30.0 * reach + 1e-12:
                return -1
            t += max(0.3 * reach, 1e-15) / lipschitz
        else:
            if inside:
                inside = False
                count = gather(flow, kind, row, along, r, tube, entered, t, best_time, y, dy, found, count)
                if count < 0:
                    return -1
                advance(flow.squares, t, row[:4], along, y, dy)
            t += (size - reach) / lipschitz
    if not t > window:
        return -1
    if inside:
        count = gather(flow, kind, row, along, r, tube, entered, window, best_time, y, dy, found, count)
    return count


@kernel
def gather(flow, kind, row, along, r, tube, entered, left, nearest, y, dy, found, count):
    """Add the time of one crossing to the first `count` in `found` where it can hold an orbit. Returns their number, -1 where it is
    undecided or there is no room."""
    verdict, time = crossing(flow, kind, row, along, r, tube, entered, left, nearest, y, dy)
    if verdict == 0:
        return count
    if verdict < 0 or count == found.shape[0]:
        return -1
    found[count] = time
    return count + 1


@part
def crossing(flow, kind, row, along, r, tube, entered, left, nearest, y, dy):
    """Whether one crossing by zero can hold an orbit: 0 no, 1 one at most, -1 undecided; and the time of the least distance."""
    at = 0 if kind == ORIGIN else 2
    t = nearest
    v0 = 0.0
    v1 = 0.0
    for _ in range(4):
        advance(flow.squares, t, row[:4], along, y, dy)
        v0 = y[2] if kind == ORIGIN else -flow.squares[0] * y[0]
        v1 = y[3] if kind == ORIGIN else -flow.squares[1] * y[1]
        square = v0 * v0 + v1 * v1
        if square == 0.0:
            return -1, t
        t = min(max(t - (y[at] * v0 + y[at + 1] * v1) / square, entered), left)
    advance(flow.squares, t, row[:4], along, y, dy)
    v0 = y[2] if kind == ORIGIN else -flow.squares[0] * y[0]
    v1 = y[3] if kind == ORIGIN else -flow.squares[1] * y[1]
    speed = math.hypot(v0, v1)
    a0 = -flow.squares[0] * y[at]
    a1 = -flow.squares[1] * y[at + 1]
    u0 = dy[at]
    u1 = dy[at + 1]
    w0 = dy[2] if kind == ORIGIN else -flow.squares[0] * dy[0]
    w1 = dy[3] if kind == ORIGIN else -flow.squares[1] * dy[1]
    half = max(left - t, t - entered)
    residual = (v0 * y[at + 1] - v1 * y[at]) / speed
    rate = (v0 * u1 - v1 * u0) / speed
    size = math.hypot(u0, u1)
    bend = math.hypot(a0, a1) + (abs(flow.squares[0]) + abs(flow.squares[1])) * speed * half
    vary = tube + half * (math.hypot(w0, w1) + size * bend / speed)
    if abs(residual) > MARGIN * r * (size + tube):
        return 0, t
    if abs(rate) <= MARGIN * vary:
        return -1, t
    if abs(residual) > MARGIN * r * (abs(rate) + vary):
        return 0, t
    return 1, t


@kernel
def refine_zero(
    flow, kind, k, theta, time, low, high, beyond_low, beyond_high, longest, most, record, pattern, work, out
):  # fmt: skip
    """Newton's method for one orbit in (start, time) from the middle of an interval, kept inside it, where all starts have the impacts of
    `pattern`, the middle's record. It may end outside by so much: beyond_low, beyond_high. out: theta, time within
    flight k, residual. Returns (whether it converged, starts followed)."""
    y = work[7, :4]
    dy = work[8, :4]
    at = 0 if kind == ORIGIN else 2
    last = math.inf
    span = high - low
    for count in range(12):
        levels = follow(flow, theta, longest, most, record, work)
        if levels <= k:
            return False, count
        for i in range(k):
            if record[i, CONTACT] != pattern[i, CONTACT]:
                return False, count
        if kind == STOP:
            if record[k, CONTACT] != pattern[k, CONTACT]:
                return False, count
            step = -record[k, RESIDUAL] / record[k, RESIDUAL + 1]
            time = record[k, DURATION]
            out[2] = abs(record[k, RESIDUAL])
        else:
            advance(flow.squares, time, record[k, :4], record[k, 4:8], y, dy)
            v0 = y[2] if kind == ORIGIN else -flow.squares[0] * y[0]
            v1 = y[3] if kind == ORIGIN else -flow.squares[1] * y[1]
            determinant = dy[at] * v1 - dy[at + 1] * v0
            if determinant == 0.0:
                return False, count
            step = (-y[at] * v1 + y[at + 1] * v0) / determinant
            time += (-dy[at] * y[at + 1] + dy[at + 1] * y[at]) / determinant
            out[2] = math.hypot(y[at], y[at + 1])
        out[0] = theta
        out[1] = time
        if not (abs(step) < math.inf):
            return False, count
        if abs(step) <= 4e-16 * (1.0 + abs(theta)) or (count > 2 and abs(step) >= 0.5 * last and last < 1e-8 * span + 1e-13):
            return True, count + 1
        if (theta == low and step < 0.0) or (theta == high and step > 0.0):
            # It lies outside; how far outside the step says. Within the sliver that a grazing leaves out it is still this interval's.
            out[0] = theta if -beyond_low <= step <= beyond_high else theta + step
            return True, count + 1
        theta = min(max(theta + step, low), high)
        last = abs(step)
    return False, 12
