"""An adaptive scan of a curve of starts: intervals are split until it is decided what each can hold.

For two degrees of freedom an orbit between ends is a zero of two numbers in the plane of start and time: the displacements (origin),
the velocities (rest), or the velocity along the stop at an impact (stop). An interval of starts is closed for one flight when

    the impacts hit are the same ones, and the flight's variation z' is known all over it: sampled at both ends and in the middle, which
        agree with each other, so that the starts between stay in a tube about the flight of the middle, of width |z'| times theirs;
    no turning point inside the tube reaches a stop, or the one that could moves monotonically and reaches it only at an end of the interval;
    no impact's speed reaches zero, or it does so monotonically at an end;
    each passage of the tube by zero is one where the Jacobian of (start, time) varies by less than itself: there is one orbit at most, and
        Newton's method finds it.

An interval that cannot be closed is split, and its halves begin with the flight that was open. Where the word of impacts changes, the grazing
between is located to rounding and becomes an end of both sides; on the side with the slow impact everything goes with the square root
of the distance, so that root is the parameter there.
"""

import math

import numpy as np
from numba import int64

from bvp.kernels.compiled import allocating, kernel, part
from bvp.kernels.follow import (
    ACCELERATION,
    CLEARANCE,
    CONTACT,
    DERIVATIVE,
    DURATION,
    FREE,
    MISS,
    SECOND,
    SPEED,
    STUCK,
    THIRD,
    TIME,
    advance,
    amplitude,
    follow,
    nearest_turns,
)
from bvp.kernels.impact import CONTACT_TOLERANCE
from bvp.kernels.segment import ORIGIN, REST, STOP

__all__ = ["COUNTS", "scan_interval"]

CLOSED, SPLIT, JUMP, DONE, ENDLESS = 0, 1, 2, 3, 4
"""Verdicts on one flight of an interval."""

COUNTS = ("starts", "split", "closed", "grazings", "open", "at_grazing", "budget")
(STARTS, SPLITS, CLOSURES, GRAZINGS, OPEN, AT_GRAZING, BUDGET) = range(7)

VARIATION = 0.35
"""How much z' may vary over a closed interval, relative to itself."""

TOUCHING = 3.0 * CONTACT_TOLERANCE
"""Distance below which a touch cannot be told from a hit, a fraction of the sizes that make it up."""

SLIVER = 4e-12
"""How far outside its interval, at most, Newton's method may end: about what is left out between the two sides of a grazing."""

MARGIN = 1.2
"""Factor on the bounds that are drawn from samples."""


@kernel
def place(low, high, kind, x):
    """Parameter of the start at x in [0, 1], and its derivative. kind: 0 linear, 1 square root at the low end, 2 at the high end, 3 both."""
    span = high - low
    if kind == 0:
        return low + span * x, span
    if kind == 1:
        return low + span * x * x, 2.0 * span * x
    if kind == 2:
        return high - span * (1.0 - x) * (1.0 - x), 2.0 * span * (1.0 - x)
    s = math.sin(0.5 * math.pi * x)
    return low + span * s * s, 0.5 * math.pi * span * math.sin(math.pi * x)


@kernel
def unplace(low, high, kind, theta):
    """x of a parameter, the inverse of `place`."""
    part = (theta - low) / (high - low)
    if kind == 0:
        return part
    if kind == 1:
        return math.sqrt(max(part, 0.0))
    if kind == 2:
        return 1.0 - math.sqrt(max((high - theta) / (high - low), 0.0))
    if part < 0.5:
        return 2.0 / math.pi * math.asin(math.sqrt(max(part, 0.0)))
    return 1.0 - 2.0 / math.pi * math.asin(math.sqrt(max((high - theta) / (high - low), 0.0)))


@kernel
def positive(value_a, rate_a, value_m, rate_m, value_b, rate_b, r, noise):
    """Whether a positive quantity stays so over an interval of half width r, sampled with its derivative at both ends and the middle, where
    `noise` is its rounding error (it may be zero at an end)."""
    if not (value_a > -noise and value_m > 0.0 and value_b > -noise):
        return False
    least = min(value_a, value_m, value_b)
    most = max(abs(rate_a), abs(rate_m), abs(rate_b))
    if MARGIN * r * most < least:
        return True
    if abs(value_b - value_a - r / 3.0 * (rate_a + 4.0 * rate_m + rate_b)) > 0.1 * r * most + noise:
        return False
    if (rate_a > 0.0) != (rate_m > 0.0) or (rate_b > 0.0) != (rate_m > 0.0):
        return False
    return min(abs(rate_a), abs(rate_b), abs(rate_m)) > 0.2 * most or (min(value_a, value_b) < noise and value_m < 10.0 * noise)


@kernel
def touching(flow, row):
    """Distance to a stop, anywhere in a flight, below which a touch cannot be told from a hit."""
    size = 1.0
    for k in range(2):
        size += abs(flow.gap[0, k]) * amplitude(flow.squares[k], row[k], row[k + 2], row[THIRD], int64(0))
    return TOUCHING * size


@kernel
def approaches(flow, kind, row, along, r, tube, window, found, work):
    """Passages of one flight by zero displacement (kind ORIGIN) or zero velocity (REST), seen by all starts within r of the middle.

    along (4,): derivative of the state by x; tube: how much its displacements (velocities) may differ from that. Times of passages that
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
        # The start itself is no passage: from zero the motion goes on in one direction for at least this long.
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
                verdict, time = passage(flow, kind, row, along, r, tube, entered, t, best_time, y, dy)
                if verdict < 0:
                    return -1
                if verdict > 0:
                    if count == found.shape[0]:
                        return -1
                    found[count] = time
                    count += 1
                advance(flow.squares, t, row[:4], along, y, dy)
            t += (size - reach) / lipschitz
    if inside:
        verdict, time = passage(flow, kind, row, along, r, tube, entered, window, best_time, y, dy)
        if verdict < 0:
            return -1
        if verdict > 0:
            if count == found.shape[0]:
                return -1
            found[count] = time
            count += 1
    return count


@kernel
def passage(flow, kind, row, along, r, tube, entered, left, nearest, y, dy):
    """Whether one passage by zero can hold an orbit: 0 no, 1 one at most, -1 undecided; and the time of the least distance."""
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
    miss = (v0 * y[at + 1] - v1 * y[at]) / speed
    rate = (v0 * u1 - v1 * u0) / speed
    size = math.hypot(u0, u1)
    bend = math.hypot(a0, a1) + (abs(flow.squares[0]) + abs(flow.squares[1])) * speed * half
    vary = tube + half * (math.hypot(w0, w1) + size * bend / speed)
    if abs(miss) > MARGIN * r * (size + tube):
        return 0, t
    if abs(rate) <= MARGIN * vary:
        return -1, t
    if abs(miss) > MARGIN * r * (abs(rate) + vary):
        return 0, t
    return 1, t


@kernel
def flight_verdict(flow, k, a, b, m, levels_a, levels_b, levels_m, jac_a, jac_b, jac_m, r, grain, times, impacts, longest, most, found, count, work):
    """Judge flight k of an interval from the records of its ends and middle (`jac_`: d theta/d x there; r: half its width in x).

    times, impacts (3,): for each kind of far end, the longest time and most inner impacts; a negative time where it is not looked for.
    found (3, P): times of passages of each kind (for STOP of the impact), count (3,): how many. Returns the verdict."""
    for kind in range(3):
        count[kind] = 0
    earliest = math.inf
    if k < levels_a:
        earliest = min(earliest, a[k, TIME])
    if k < levels_b:
        earliest = min(earliest, b[k, TIME])
    if k < levels_m:
        earliest = min(earliest, m[k, TIME])
    horizon = -1.0
    onward = False
    for kind in range(3):
        if k <= impacts[kind] and times[kind] > earliest:
            horizon = max(horizon, times[kind] - earliest)
            if k < impacts[kind]:
                onward = True
    if horizon < 0.0:
        return DONE
    if k >= levels_a or k >= levels_b or k >= levels_m:
        return 10
    # -- how the flight ends
    ra = a[k]
    rb = b[k]
    rm = m[k]
    if ra[CONTACT] == STUCK or rb[CONTACT] == STUCK or rm[CONTACT] == STUCK:
        return 11
    far = 0
    for row in (ra, rb, rm):
        if row[CONTACT] == FREE or row[DURATION] > horizon:
            far += 1
    last = far == 3
    if not last:
        if ra[CONTACT] != rb[CONTACT]:
            # Where one of them only leaves the time searched, halves will show it.
            return 12 if (ra[CONTACT] == FREE or rb[CONTACT] == FREE) and r * jac_m > 1e-5 else JUMP
        if ra[CONTACT] != rm[CONTACT] or ra[CONTACT] == FREE:
            return 13
        # The same stop, but one flight goes on past the impact that ends the other.
        most = max(abs(ra[DURATION + 1] * jac_a), abs(rb[DURATION + 1] * jac_b), abs(rm[DURATION + 1] * jac_m))
        if r * jac_m < 1e-4 and abs(rb[DURATION] - ra[DURATION]) > 20.0 * r * most + 1e-9:
            return JUMP
    if onward and not last and k == most:
        return ENDLESS
    # -- the tube about the flight of the middle
    along = work[1, :4]
    vary = work[2, :4]
    size = 0.0
    spread = 0.0
    wide = 0.0
    tube_q = 0.0
    tube_p = 0.0
    window = min(rm[DURATION], horizon)
    for c in range(4):
        along[c] = rm[DERIVATIVE + c] * jac_m
        first = ra[DERIVATIVE + c] * jac_a
        second = rb[DERIVATIVE + c] * jac_b
        vary[c] = 0.5 * abs(second - first) + abs(0.5 * (first + second) - along[c])
    force = 0.0
    for c in range(2):
        inner = amplitude(flow.squares[c], along[c], along[c + 2], window, int64(0))
        outer = amplitude(flow.squares[c], vary[c], vary[c + 2], window, int64(0))
        size += inner * inner
        spread += outer * outer
        wide += abs(flow.gap[0, c]) * (inner + outer)
        tube_q += outer * outer
        force += abs(flow.gap[0, c] * flow.squares[c]) * (inner + outer)
        outer = amplitude(flow.squares[c], vary[c], vary[c + 2], window, int64(1))
        tube_p += outer * outer
    # On the section of an impact the gap does not vary: from there its variation grows with time.
    near = 0.5 * force * window * window
    for c in range(0, 4, 2):
        first = (flow.gap[0, 0] * ra[DERIVATIVE + c] + flow.gap[0, 1] * ra[DERIVATIVE + c + 1]) * jac_a
        second = (flow.gap[0, 0] * rb[DERIVATIVE + c] + flow.gap[0, 1] * rb[DERIVATIVE + c + 1]) * jac_b
        middle = (flow.gap[0, 0] * rm[DERIVATIVE + c] + flow.gap[0, 1] * rm[DERIVATIVE + c + 1]) * jac_m
        most = abs(middle) + 0.5 * abs(second - first) + abs(0.5 * (first + second) - middle)
        near += most if c == 0 else most * window
    wide = MARGIN * r * min(wide, near)
    tube_q = MARGIN * math.sqrt(tube_q)
    tube_p = MARGIN * math.sqrt(tube_p)
    if k == 0 and r * jac_m > 0.1:
        return 14
    if spread > VARIATION * VARIATION * size:
        return 15
    # -- no turning point reaches a stop
    if rm[CLEARANCE] != rm[CLEARANCE]:
        nearest_turns(flow, rm, 1.05 * longest - rm[TIME], work)
    if rm[CLEARANCE] <= wide:
        if rm[SECOND] <= wide:
            return 16
        if ra[CLEARANCE] != ra[CLEARANCE]:
            nearest_turns(flow, ra, 1.05 * longest - ra[TIME], work)
        if rb[CLEARANCE] != rb[CLEARANCE]:
            nearest_turns(flow, rb, 1.05 * longest - rb[TIME], work)
        if not positive(
            ra[CLEARANCE], ra[CLEARANCE + 1] * jac_a, rm[CLEARANCE], rm[CLEARANCE + 1] * jac_m, rb[CLEARANCE], rb[CLEARANCE + 1] * jac_b, r,
            touching(flow, rm) + 8.0 * grain * abs(rm[CLEARANCE + 1]),
        ):
            return 17
    # -- the impact is a transversal one, and its arrival is known over the interval
    if not last:
        if not positive(ra[SPEED], ra[SPEED + 1] * jac_a, rm[SPEED], rm[SPEED + 1] * jac_m, rb[SPEED], rb[SPEED + 1] * jac_b, r, 8.0 * grain * abs(rm[SPEED + 1])):
            return 18
        if rm[ACCELERATION] > 0.0 and rm[SPEED] * rm[SPEED] <= 2.0 * rm[ACCELERATION] * wide:
            return 19
        mean = (ra[DURATION + 1] * jac_a + 4.0 * rm[DURATION + 1] * jac_m + rb[DURATION + 1] * jac_b) * r / 3.0
        most = max(abs(ra[DURATION + 1] * jac_a), abs(rb[DURATION + 1] * jac_b), abs(rm[DURATION + 1] * jac_m))
        if abs(rb[DURATION] - ra[DURATION] - mean) > 0.1 * r * most + 1e-13 * (1.0 + longest) + 8.0 * grain / jac_m * most:
            return 25
        if onward and (k + 1 < levels_a and k + 1 < levels_b and k + 1 < levels_m):
            off = 0.0
            size = 0.0
            spread = 0.0
            noise = 0.0
            for c in range(4):
                weight = 1.0 if c >= 2 else math.sqrt(abs(flow.squares[c]))
                first = a[k + 1, DERIVATIVE + c] * jac_a
                second = b[k + 1, DERIVATIVE + c] * jac_b
                middle = m[k + 1, DERIVATIVE + c] * jac_m
                value = weight * (b[k + 1, c] - a[k + 1, c] - r / 3.0 * (first + 4.0 * middle + second))
                off += value * value
                value = weight * (0.5 * abs(second - first) + abs(0.5 * (first + second) - middle))
                spread += value * value
                size += weight * weight * middle * middle
                noise += weight * weight * m[k + 1, c] * m[k + 1, c]
            if spread > VARIATION * VARIATION * size:
                return 20
            if math.sqrt(off) > 0.1 * r * math.sqrt(size) + 1e-13 * math.sqrt(noise) + 8.0 * grain / jac_m * math.sqrt(size):
                return 21
    # -- orbits
    reach = min(window + MARGIN * r * abs(rm[DURATION + 1] * jac_m), horizon) if not last else horizon
    struck = k > 0 or flow.shape[1] >= 0  # motions without any impact are modes, known in closed form
    if struck and k <= impacts[ORIGIN] and times[ORIGIN] > earliest:
        count[ORIGIN] = approaches(
            flow, int64(ORIGIN), rm, along, r, tube_q, min(reach, times[ORIGIN] - earliest), found[ORIGIN], work
        )
        if count[ORIGIN] < 0:
            return 22
    if struck and k <= impacts[REST] and times[REST] > earliest:
        count[REST] = approaches(flow, int64(REST), rm, along, r, tube_p, min(reach, times[REST] - earliest), found[REST], work)
        if count[REST] < 0:
            return 23
    if not last and k <= impacts[STOP] and times[STOP] > earliest + window - MARGIN * r * abs(rm[DURATION + 1] * jac_m):
        first = ra[MISS + 1] * jac_a
        second = rb[MISS + 1] * jac_b
        rate = rm[MISS + 1] * jac_m
        change = MARGIN * (0.5 * abs(second - first) + abs(0.5 * (first + second) - rate))
        if abs(rm[MISS]) <= MARGIN * r * (abs(rate) + change):
            if abs(rate) <= change:
                return 24
            found[STOP, 0] = rm[DURATION]
            count[STOP] = 1
    return CLOSED


@kernel
def refine_zero(flow, kind, k, theta, time, low, high, longest, most, record, pattern, work, out):
    """Newton's method for one orbit in (start, time) from the middle of an interval, kept inside it, where all starts have the impacts of
    `pattern`, the middle's record. out: theta, time within flight k, miss. Returns (whether it converged, starts followed)."""
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
            step = -record[k, MISS] / record[k, MISS + 1]
            time = record[k, DURATION]
            out[2] = abs(record[k, MISS])
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
            out[0] = theta if abs(step) <= SLIVER else theta + step
            return True, count + 1
        theta = min(max(theta + step, low), high)
        last = abs(step)
    return False, 12


@part
def leave_open(openings, opening, theta, width, flight, reason, counts):
    """Add an interval to those that stay open; returns their number."""
    counts[OPEN] += 1
    if opening < openings.shape[0]:
        openings[opening, 0] = theta
        openings[opening, 1] = width
        openings[opening, 2] = flight
        openings[opening, 3] = reason
    return opening + 1


@allocating
def scan_interval(flow, low, high, ends, times, impacts, longest, most, records, levels, stack, candidates, openings, budget, counts, work):
    """Scan the starts between two parameters. ends (3,): those between which `place` maps, and its kind: where the curve of starts
    itself ends at a stop, its end is one of them.

    times, impacts (3,): see `flight_verdict`. records (3 D + 3, K + 2, COLUMNS), levels (3 D + 3,), stack (2 D, 10): room for D halvings. candidates (C, 8): kind,
    inner impacts, theta, time, miss, converged, low and high end of the interval. openings (O, 4): theta, width, flight and reason of what stays open. counts (7,): see COUNTS, added
    to. Returns (candidates, openings); more than their room says that there was too little of it."""
    found = np.empty((3, 8))
    count = np.zeros(3, np.int64)
    out = np.empty(3)
    candidate = 0
    opening = 0
    depth_limit = levels.shape[0] // 3 - 1
    levels[0] = follow(flow, low, longest, most, records[0], work)
    levels[1] = follow(flow, high, longest, most, records[1], work)
    spare = 2
    counts[STARTS] += 2
    top = 1
    stack[0, 0] = ends[0]
    stack[0, 1] = ends[1]
    stack[0, 2] = ends[2]
    stack[0, 3] = unplace(ends[0], ends[1], int64(ends[2]), low)
    stack[0, 4] = unplace(ends[0], ends[1], int64(ends[2]), high)
    stack[0, 5] = 0.0
    stack[0, 6] = 1.0
    stack[0, 7] = 0.0
    stack[0, 8] = 0.0
    used = 0
    while top > 0:
        top -= 1
        map_low = stack[top, 0]
        map_high = stack[top, 1]
        kind = int64(stack[top, 2])
        x_a = stack[top, 3]
        x_b = stack[top, 4]
        i_a = int64(stack[top, 5])
        i_b = int64(stack[top, 6])
        k = int64(stack[top, 7])
        depth = int64(stack[top, 8])
        x_m = 0.5 * (x_a + x_b)
        theta_a, jac_a = place(map_low, map_high, kind, x_a)
        theta_b, jac_b = place(map_low, map_high, kind, x_b)
        theta_m, _ = place(map_low, map_high, kind, x_m)
        grain = 4.5e-16 * max(abs(theta_a), abs(theta_b), 1.0)
        if theta_b - theta_a <= 8.0 * grain or depth >= depth_limit or used >= budget:
            jumped = stack[top, 9] == JUMP
            if k < levels[i_a] and k < levels[i_b]:
                jumped = jumped or records[i_a, k, CONTACT] != records[i_b, k, CONTACT]
            if jumped and theta_b - theta_a <= 8.0 * grain:
                counts[AT_GRAZING] += 1
            else:
                opening = leave_open(openings, opening, theta_a, theta_b - theta_a, k, stack[top, 9], counts)
                if used >= budget:
                    counts[BUDGET] += 1
            continue
        x_m = unplace(map_low, map_high, kind, theta_m)
        _, jac_m = place(map_low, map_high, kind, x_m)
        i_m = spare + 3 * depth
        i_p = i_m + 1
        i_q = i_m + 2
        levels[i_m] = follow(flow, theta_m, longest, most, records[i_m], work)
        counts[STARTS] += 1
        used += 1
        r = 0.5 * (x_b - x_a)
        verdict = CLOSED
        while verdict == CLOSED:
            verdict = flight_verdict(
                flow, k, records[i_a], records[i_b], records[i_m], levels[i_a], levels[i_b], levels[i_m], jac_a, jac_b, jac_m, r,
                grain, times, impacts, longest, most, found, count, work,
            )
            if verdict != CLOSED:
                break
            first = candidate
            for end in range(3):
                for c in range(count[end]):
                    converged, steps = refine_zero(
                        flow, int64(end), k, theta_m, found[end, c], theta_a, theta_b, longest, k, records[i_p], records[i_m],
                        work, out,
                    )
                    counts[STARTS] += steps
                    used += steps
                    if not converged and theta_b - theta_a > 1e6 * grain:
                        verdict = SPLIT
                        continue
                    if converged and (out[0] < theta_a or out[0] > theta_b):
                        continue
                    if converged and (out[1] < -1e-9 or out[1] > records[i_p, k, DURATION] + 1e-9):
                        continue
                    if candidate < candidates.shape[0]:
                        candidates[candidate, 0] = end
                        candidates[candidate, 1] = k
                        candidates[candidate, 2] = out[0] if converged else theta_m
                        candidates[candidate, 3] = out[1] if converged else found[end, c]
                        candidates[candidate, 4] = out[2]
                        candidates[candidate, 5] = 1.0 if converged else 0.0
                        candidates[candidate, 6] = theta_a
                        candidates[candidate, 7] = theta_b
                    candidate += 1
            if verdict == SPLIT:
                candidate = first
                break
            k += 1
        if verdict == DONE:
            counts[CLOSURES] += 1
            continue
        if verdict == ENDLESS:
            opening = leave_open(openings, opening, theta_a, theta_b - theta_a, k, ENDLESS, counts)
            continue
        counts[SPLITS] += 1
        if verdict == JUMP:
            # -- the grazing between a and b, to rounding
            one = i_a
            two = i_b
            theta_1 = theta_a
            theta_2 = theta_b
            for step in range(120):
                width = theta_2 - theta_1
                if width <= 4.0 * grain:
                    break
                early, late = (one, two) if records[one, k, DURATION] < records[two, k, DURATION] else (two, one)
                if records[late, k, CLEARANCE] != records[late, k, CLEARANCE]:
                    nearest_turns(flow, records[late, k], 1.05 * longest - records[late, k, TIME], work)
                bend = abs(records[early, k, ACCELERATION])
                below = records[early, k, SPEED] ** 2 / (2.0 * bend) if bend > 0.0 else math.inf
                above = abs(records[late, k, CLEARANCE])
                probe = 0.5 * (theta_1 + theta_2)
                if step % 4 != 3 and below + above < math.inf:
                    part = below / (below + above)
                    if early == two:
                        part = 1.0 - part
                    guess = theta_1 + part * width
                    nudge = max(2.0 * grain, 0.02 * min(guess - theta_1, theta_2 - guess))
                    probe = guess + nudge if part < 0.5 else guess - nudge
                    if step % 2 == 1:
                        probe = guess - nudge if part < 0.5 else guess + nudge
                    probe = min(max(probe, theta_1 + grain), theta_2 - grain)
                if not (theta_1 < probe < theta_2):
                    break
                slot = i_m if one != i_m and two != i_m else i_p if one != i_p and two != i_p else i_q
                levels[slot] = follow(flow, probe, longest, most, records[slot], work)
                counts[STARTS] += 1
                used += 1
                if levels[slot] <= k:
                    break
                like_one = records[slot, k, CONTACT] == records[one, k, CONTACT]
                if like_one and records[one, k, CONTACT] == records[two, k, CONTACT]:
                    like_one = abs(records[slot, k, DURATION] - records[one, k, DURATION]) < abs(
                        records[slot, k, DURATION] - records[two, k, DURATION]
                    )
                if like_one:
                    one = slot
                    theta_1 = probe
                else:
                    two = slot
                    theta_2 = probe
            counts[GRAZINGS] += 1
            early_one = records[one, k, DURATION] < records[two, k, DURATION]
            # -- the ends of both sides, as far from grazing as lets rounding tell them apart
            late = two if early_one else one
            if records[late, k, CLEARANCE] != records[late, k, CLEARANCE]:
                nearest_turns(flow, records[late, k], 1.05 * longest - records[late, k, TIME], work)
            slope = abs(records[late, k, CLEARANCE + 1])
            offset = 16.0 * grain
            if slope > 0.0:
                offset = max(offset, touching(flow, records[late, k]) / slope)
            edge_1 = theta_1
            edge_2 = theta_2
            theta_1 = min(theta_1, edge_2 - min(offset, 0.25 * (edge_2 - theta_a)))
            theta_2 = max(theta_2, edge_1 + min(offset, 0.25 * (theta_b - edge_1)))
            if theta_1 > theta_a and theta_1 < edge_1:
                slot = i_m if one != i_m and two != i_m else i_p if one != i_p and two != i_p else i_q
                levels[slot] = follow(flow, theta_1, longest, most, records[slot], work)
                one = slot
            if theta_2 < theta_b and theta_2 > edge_2:
                slot = i_m if one != i_m and two != i_m else i_p if one != i_p and two != i_p else i_q
                levels[slot] = follow(flow, theta_2, longest, most, records[slot], work)
                two = slot
            counts[STARTS] += 2
            used += 2
            left_root = (kind == 1 or kind == 3) and x_a <= 1e-3
            right_root = (kind == 2 or kind == 3) and x_b >= 1.0 - 1e-3
            if two != i_b and theta_b > theta_2:
                stack[top, 0] = theta_2 if early_one else edge_1
                stack[top, 1] = map_high if right_root else theta_b
                code = (0 if early_one else 1) + (2 if right_root else 0)
                stack[top, 2] = code
                stack[top, 3] = unplace(stack[top, 0], stack[top, 1], int64(code), theta_2)
                stack[top, 4] = unplace(stack[top, 0], stack[top, 1], int64(code), theta_b)
                stack[top, 5] = two
                stack[top, 6] = i_b
                stack[top, 7] = k
                stack[top, 8] = depth + 1
                stack[top, 9] = verdict
                top += 1
            if one != i_a and theta_1 > theta_a:
                stack[top, 0] = map_low if left_root else theta_a
                stack[top, 1] = edge_2 if early_one else theta_1
                code = (1 if left_root else 0) + (2 if early_one else 0)
                stack[top, 2] = code
                stack[top, 3] = unplace(stack[top, 0], stack[top, 1], int64(code), theta_a)
                stack[top, 4] = unplace(stack[top, 0], stack[top, 1], int64(code), theta_1)
                stack[top, 5] = i_a
                stack[top, 6] = one
                stack[top, 7] = k
                stack[top, 8] = depth + 1
                stack[top, 9] = verdict
                top += 1
            continue
        stack[top, 0] = map_low
        stack[top, 1] = map_high
        stack[top, 2] = kind
        stack[top, 3] = x_m
        stack[top, 4] = x_b
        stack[top, 5] = i_m
        stack[top, 6] = i_b
        stack[top, 7] = k
        stack[top, 8] = depth + 1
        stack[top, 9] = verdict
        top += 1
        stack[top, 0] = map_low
        stack[top, 1] = map_high
        stack[top, 2] = kind
        stack[top, 3] = x_a
        stack[top, 4] = x_m
        stack[top, 5] = i_a
        stack[top, 6] = i_m
        stack[top, 7] = k
        stack[top, 8] = depth + 1
        stack[top, 9] = verdict
        top += 1
    return candidate, opening
