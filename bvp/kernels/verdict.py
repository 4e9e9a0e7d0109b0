"""The decision about one flight of an interval of starts, from the records of its ends and its middle.

`approaches` finds the crossings of the far ends, equation (34), and `refine_zero` the orbit that one of them holds.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy import int64

from bvp.kernels import shooting as column
from bvp.kernels.compiled import inlined, kernel
from bvp.kernels.impact import CONTACT_TOLERANCE
from bvp.kernels.multipoint import ORIGIN, REST, STOP
from bvp.kernels.shooting import Flow, amplitude, find_clearance, fly_both, follow_impacts

MARGIN = 1.2
"""Factor on the bounds that are drawn from samples."""


MIDDLE = 3
"""Besides the kinds of far ends: an impact in the middle of a segment. What is looked for are the states after the impacts that end flights
which begin up to the time `latest` of a search (`bvp.kernels.arcs`)."""


class StartSearch(NamedTuple):
    """The data of a scan of starts: its end sets and limits, and the records of the starts. D: number of times an interval is halved."""

    flow: Flow
    times: np.ndarray  # (4,) for each kind of far end the longest time; negative where it is not looked for
    impacts: np.ndarray  # (4,) int64 and the most inner impacts
    fold: bool  # whether a mirror image stands for the states after the impacts at the lower stop
    longest: float  # time that starts are followed for
    latest: float  # time up to which flights begin
    most: int  # and impacts
    records: np.ndarray  # (3 D + 3, K + 2, COLUMNS) see `follow_impacts`
    levels: np.ndarray  # (3 D + 3,) int64 rows filled of each record
    work: np.ndarray  # (16, 16) scratch


class Sample(NamedTuple):
    """One start of an interval: its record, the rows filled, and d theta/d x there."""

    record: np.ndarray  # (K + 2, COLUMNS)
    rows: int
    jacobian: float


class Samples(NamedTuple):
    """One flight of both ends and the middle of an interval of half width r: rows of records, and d theta/d x there."""

    a: np.ndarray
    m: np.ndarray
    b: np.ndarray
    jac_a: float
    jac_m: float
    jac_b: float
    r: float
    grain: float  # of the starts, as floating-point numbers


class Tube(NamedTuple):
    """Bounds for one flight from all starts within r of the middle."""

    row: np.ndarray  # of the middle's record
    along: np.ndarray  # (4,) derivative of the state by x
    r: float
    width: float  # how much the displacements (velocities) of starts may differ from that


class Visit(NamedTuple):
    """A time interval of a flight near a crossing."""

    entered: float
    left: float
    nearest: float  # of the least distance


class StartBracket(NamedTuple):
    """An interval of starts, with a margin for Newton's method outside it."""

    low: float
    high: float
    beyond_low: float
    beyond_high: float


@kernel
def approaches(flow, kind, tube, window, found, work):
    """Find the crossings of zero displacement (kind ORIGIN) or zero velocity (REST) by one flight, for all starts of a tube.

    `found` receives the times of the crossings that can contain an orbit, one each at most. Returns their number, or -1 if the interval
    must be split."""
    row, along, r, width = tube
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
    if row[column.TIME] == 0.0:
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
    # The distance changes no faster than this, so the steps below cannot pass a crossing.
    lipschitz = fastest + MARGIN * r * turning
    count = 0
    inside = False
    entered = 0.0
    best = math.inf
    best_time = 0.0
    for _ in range(100000):
        if t > window:
            break
        fly_both(flow.squares, t, row[:4], along, y, dy)
        size = math.hypot(y[at], y[at + 1])
        reach = MARGIN * r * (math.hypot(dy[at], dy[at + 1]) + width)
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
                count = gather(flow, kind, tube, Visit(entered, t, best_time), y, dy, found, count)
                if count < 0:
                    return -1
                fly_both(flow.squares, t, row[:4], along, y, dy)
            t += (size - reach) / lipschitz
    if not t > window:
        return -1
    if inside:
        count = gather(flow, kind, tube, Visit(entered, window, best_time), y, dy, found, count)
    return count


@kernel
def gather(flow, kind, tube, visit, y, dy, found, count):
    """Append the time of one crossing to `found`, which has `count` entries, if the crossing can contain an orbit. Returns the new
    number, or -1 if it is undecided or `found` is full."""
    verdict, time = crossing(flow, kind, tube, visit, y, dy)
    if verdict == 0:
        return count
    if verdict < 0 or count == found.shape[0]:
        return -1
    found[count] = time
    return count + 1


@inlined
def state_rates(flow, kind, y):
    """Velocities (kind ORIGIN) or accelerations (REST) of both modes at the state y."""
    if kind == ORIGIN:
        return y[2], y[3]
    return -flow.squares[0] * y[0], -flow.squares[1] * y[1]


@inlined
def crossing(flow, kind, tube, visit, y, dy):
    """Whether one crossing by zero can hold an orbit: 0 no, 1 one at most, -1 undecided; and the time of the least distance."""
    row, along, r, width = tube
    entered, left, nearest = visit
    at = 0 if kind == ORIGIN else 2
    t = nearest
    for _ in range(4):
        fly_both(flow.squares, t, row[:4], along, y, dy)
        v0, v1 = state_rates(flow, kind, y)
        square = v0 * v0 + v1 * v1
        if square == 0.0:
            return -1, t
        t = min(max(t - (y[at] * v0 + y[at + 1] * v1) / square, entered), left)
    fly_both(flow.squares, t, row[:4], along, y, dy)
    v0, v1 = state_rates(flow, kind, y)
    speed = math.hypot(v0, v1)
    a0 = -flow.squares[0] * y[at]
    a1 = -flow.squares[1] * y[at + 1]
    u0 = dy[at]
    u1 = dy[at + 1]
    w0, w1 = state_rates(flow, kind, dy)
    half = max(left - t, t - entered)
    # Equation (34): residual and derivative across the velocity, at the least distance.
    residual = (v0 * y[at + 1] - v1 * y[at]) / speed
    rate = (v0 * u1 - v1 * u0) / speed
    size = math.hypot(u0, u1)
    bend = math.hypot(a0, a1) + (abs(flow.squares[0]) + abs(flow.squares[1])) * speed * half
    vary = width + half * (math.hypot(w0, w1) + size * bend / speed)
    if abs(residual) > MARGIN * r * (size + width):
        return 0, t
    if abs(rate) <= MARGIN * vary:
        return -1, t
    if abs(residual) > MARGIN * r * (abs(rate) + vary):
        return 0, t
    return 1, t


@kernel
def refine_zero(search, kind, k, theta, time, bracket, record, pattern, out):
    """Newton's method for one orbit in (start, time) from the middle of an interval, kept inside it, where all starts have the impacts of
    `pattern`, the middle's record. out: theta, time within
    flight k, residual. Returns (whether it converged, starts followed)."""
    flow, work = search.flow, search.work
    low, high, beyond_low, beyond_high = bracket
    y = work[7, :4]
    dy = work[8, :4]
    at = 0 if kind == ORIGIN else 2
    last = math.inf
    span = high - low
    for count in range(12):
        levels = follow_impacts(flow, theta, search.longest, math.inf, k, record, work)
        if levels <= k:
            return False, count
        for i in range(k):
            if record[i, column.CONTACT] != pattern[i, column.CONTACT]:
                return False, count
        if kind == STOP:
            if record[k, column.CONTACT] != pattern[k, column.CONTACT]:
                return False, count
            # Newton's method in theta: the velocity along the stop vanishes.
            step = -record[k, column.RESIDUAL] / record[k, column.RESIDUAL + 1]
            time = record[k, column.DURATION]
            out[2] = abs(record[k, column.RESIDUAL])
        else:
            fly_both(flow.squares, time, record[k, :4], record[k, 4:8], y, dy)
            v0, v1 = state_rates(flow, kind, y)
            # Newton's method in (theta, time): the two displacements, or velocities, vanish.
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


CLOSED, SPLIT, JUMP, DONE, ENDLESS, GRAZED = 0, 1, 2, 3, 4, 5
"""Verdicts on a flight: decided; to be split; the ends are on different sides of a grazing; no more flights; more impacts than are
followed. GRAZED is said of what a grazing leaves out. The verdicts below are reasons to split."""

ENDED, PRESSED, LATE, DIFFERENT, COARSE, UNEVEN, TOUCHES, SLOW, SKIMS, NEAR_ORIGIN, NEAR_REST, NEAR_STOP = range(10, 22)
"""Some starts have no such flight; one stays pressed against a stop; some leave the time searched; the impacts differ; it is too wide
at the start; its variation is not even; a turning point may touch a stop; an impact's speed may reach zero; an impact may be skimmed
over; it is not decided what it holds of orbits that end at an origin, at rest, at a stop."""

VARIATION = 0.35
"""How much z' may vary over a closed interval, relative to itself."""

SLACK = 1e-10
"""How much the samples of an interval may disagree, relative to the state: rounding errors grow with the instability of the motion, and
what moves a state by less has impacts slower than this."""

TOUCHING = 3.0 * CONTACT_TOLERANCE
"""Distance below which a touch cannot be distinguished from a hit, as a part of the sizes that make it up."""


@kernel
def positive_between(value_a, rate_a, value_m, rate_m, value_b, rate_b, r, noise):
    """Whether a positive quantity stays positive over an interval of half width r. It may be zero at an end.

    Its values and derivatives are known at both ends and the middle. `noise` is its rounding error."""
    if not (value_a > -noise and value_m > -noise and value_b > -noise):
        return False
    least = min(value_a, value_m, value_b)
    most = max(abs(rate_a), abs(rate_m), abs(rate_b))
    if MARGIN * r * most < least:
        return True
    if abs(value_b - value_a - r / 3.0 * (rate_a + 4.0 * rate_m + rate_b)) > 0.1 * r * most + noise + SLACK:
        return False
    if (rate_a > 0.0) != (rate_m > 0.0) or (rate_b > 0.0) != (rate_m > 0.0):
        return False
    return min(abs(rate_a), abs(rate_b), abs(rate_m)) > 0.2 * most or (min(value_a, value_b) < noise and value_m < 10.0 * noise)


@inlined
def deviation(first, middle, second):
    """Bound of the change of a quantity over an interval, from its values at both ends and in the middle."""
    return 0.5 * abs(second - first) + abs(0.5 * (first + second) - middle)


@kernel
def stays_positive(column, samples, noise):
    """`positive_between` for one column of three records, with the next column as its derivative. `noise`: without that of the grain."""
    a, m, b, jac_a, jac_m, jac_b, r, grain = samples
    return positive_between(
        a[column], a[column + 1] * jac_a, m[column], m[column + 1] * jac_m, b[column], b[column + 1] * jac_b, r,
        noise + 8.0 * grain * abs(m[column + 1]),
    )  # fmt: skip


@kernel
def touch_distance(flow, row):
    """Distance to a stop, anywhere in a flight, below which a touch cannot be distinguished from a hit."""
    size = 1.0
    for k in range(2):
        size += abs(flow.contacts.gap[0, k]) * amplitude(flow.squares[k], row[k], row[k + 2], row[column.THIRD], int64(0))
    return TOUCHING * size


@kernel
def flight_verdict(search, k, sample_a, sample_b, sample_m, r, grain, found, count):
    """Judge flight k of an interval from its ends and middle; r: half its width in x; grain: of the starts, as floating-point numbers.

    found (3, P): times of crossings of each kind (for STOP of the impact), count (3,): how many. Returns the verdict."""
    flow, times, impacts, _, longest, latest, most, _, _, work = search
    a, levels_a, jac_a = sample_a
    b, levels_b, jac_b = sample_b
    m, levels_m, jac_m = sample_m
    for kind in range(3):
        count[kind] = 0
    earliest = math.inf
    for sample in (sample_a, sample_b, sample_m):
        if k < sample.rows:
            earliest = min(earliest, sample.record[k, column.TIME])
    horizon = -1.0
    onward = False
    for kind in range(3):
        if k <= impacts[kind] and times[kind] > earliest:
            horizon = max(horizon, times[kind] - earliest)
            if k < impacts[kind]:
                onward = True
    if k <= impacts[MIDDLE] and earliest <= latest:
        horizon = max(horizon, times[MIDDLE] - earliest)
        onward = True
    if horizon < 0.0:
        return DONE
    if k >= levels_a or k >= levels_b or k >= levels_m:
        return ENDED
    # -- how the flight ends
    ra = a[k]
    rb = b[k]
    rm = m[k]
    if ra[column.CONTACT] == column.AHEAD or rb[column.CONTACT] == column.AHEAD or rm[column.CONTACT] == column.AHEAD:
        return ENDED
    if ra[column.CONTACT] == column.STUCK or rb[column.CONTACT] == column.STUCK or rm[column.CONTACT] == column.STUCK:
        return PRESSED
    far = 0
    for row in (ra, rb, rm):
        if row[column.CONTACT] == column.FREE or row[column.DURATION] > horizon:
            far += 1
    last = far == 3
    steepest = max(abs(ra[column.DURATION + 1] * jac_a), abs(rb[column.DURATION + 1] * jac_b), abs(rm[column.DURATION + 1] * jac_m))
    if not last:
        if ra[column.CONTACT] != rb[column.CONTACT]:
            # Where one of them only leaves the time searched, halves will show it.
            return LATE if (ra[column.CONTACT] == column.FREE or rb[column.CONTACT] == column.FREE) and r * jac_m > 1e-5 else JUMP
        if ra[column.CONTACT] != rm[column.CONTACT] or ra[column.CONTACT] == column.FREE:
            return DIFFERENT
        # The same stop, but one flight goes on past the impact that ends the other.
        if r * jac_m < 1e-4 and abs(rb[column.DURATION] - ra[column.DURATION]) > 20.0 * r * steepest + 1e-9:
            return JUMP
        if k <= impacts[MIDDLE] and (k + 1 >= levels_a or k + 1 >= levels_b or k + 1 >= levels_m):
            return ENDED
    if onward and not last and k == most:
        return ENDLESS
    # -- the tube about the flight of the middle
    along = work[1, :4]
    vary = work[2, :4]
    size = 0.0
    spread = 0.0
    wide = 0.0
    tube_p = 0.0
    window = min(rm[column.DURATION], horizon)
    for c in range(4):
        along[c] = rm[column.DERIVATIVE + c] * jac_m
        vary[c] = deviation(ra[column.DERIVATIVE + c] * jac_a, along[c], rb[column.DERIVATIVE + c] * jac_b)
    force = 0.0
    gap = flow.contacts.gap
    for c in range(2):
        inner = amplitude(flow.squares[c], along[c], along[c + 2], window, int64(0))
        outer = amplitude(flow.squares[c], vary[c], vary[c + 2], window, int64(0))
        size += inner * inner
        spread += outer * outer
        wide += abs(gap[0, c]) * (inner + outer)
        force += abs(gap[0, c] * flow.squares[c]) * (inner + outer)
        outer = amplitude(flow.squares[c], vary[c], vary[c + 2], window, int64(1))
        tube_p += outer * outer
    # On the section of an impact the gap does not vary: from there its variation grows with time.
    near = 0.5 * force * window * window
    for c in range(0, 4, 2):
        at = column.DERIVATIVE + c
        first = (gap[0, 0] * ra[at] + gap[0, 1] * ra[at + 1]) * jac_a
        second = (gap[0, 0] * rb[at] + gap[0, 1] * rb[at + 1]) * jac_b
        middle = (gap[0, 0] * rm[at] + gap[0, 1] * rm[at + 1]) * jac_m
        largest = abs(middle) + 0.5 * abs(second - first) + abs(0.5 * (first + second) - middle)
        near += largest if c == 0 else largest * window
    wide = MARGIN * r * min(wide, near)
    tube_q = MARGIN * math.sqrt(spread)
    tube_p = MARGIN * math.sqrt(tube_p)
    if k == 0 and r * jac_m > 0.1:
        return COARSE
    if spread > VARIATION * VARIATION * size:
        return UNEVEN
    # -- no turning point reaches a stop
    samples = Samples(ra, rm, rb, jac_a, jac_m, jac_b, r, grain)
    find_clearance(flow, rm, longest, work)
    if rm[column.CLEARANCE] <= wide:
        if rm[column.SECOND] <= wide:
            return TOUCHES
        find_clearance(flow, ra, longest, work)
        find_clearance(flow, rb, longest, work)
        if not stays_positive(column.CLEARANCE, samples, touch_distance(flow, rm)):
            return TOUCHES
    # -- the impact is a transversal one, and its arrival is known over the interval
    if not last:
        if not stays_positive(column.SPEED, samples, 0.0):
            return SLOW
        if rm[column.ACCELERATION] > 0.0 and rm[column.SPEED] * rm[column.SPEED] <= 2.0 * rm[column.ACCELERATION] * wide:
            return SKIMS
        mean = (ra[column.DURATION + 1] * jac_a + 4.0 * rm[column.DURATION + 1] * jac_m + rb[column.DURATION + 1] * jac_b) * r / 3.0
        off = abs(rb[column.DURATION] - ra[column.DURATION] - mean)
        if off > 0.1 * r * steepest + SLACK * (1.0 + longest) + 8.0 * grain / jac_m * steepest:
            return UNEVEN
        if onward and (k + 1 < levels_a and k + 1 < levels_b and k + 1 < levels_m):
            off = 0.0
            size = 0.0
            spread = 0.0
            noise = 0.0
            for c in range(4):
                weight = 1.0 if c >= 2 else math.sqrt(abs(flow.squares[c]))
                first = a[k + 1, column.DERIVATIVE + c] * jac_a
                second = b[k + 1, column.DERIVATIVE + c] * jac_b
                middle = m[k + 1, column.DERIVATIVE + c] * jac_m
                value = weight * (b[k + 1, c] - a[k + 1, c] - r / 3.0 * (first + 4.0 * middle + second))
                off += value * value
                value = weight * deviation(first, middle, second)
                spread += value * value
                size += weight * weight * middle * middle
                noise += weight * weight * m[k + 1, c] * m[k + 1, c]
            if spread > VARIATION * VARIATION * size:
                return UNEVEN
            if math.sqrt(off) > 0.1 * r * math.sqrt(size) + SLACK * math.sqrt(noise) + 8.0 * grain / jac_m * math.sqrt(size):
                return UNEVEN
    # -- orbits
    reach = min(window + MARGIN * r * abs(rm[column.DURATION + 1] * jac_m), horizon) if not last else horizon
    with_impacts = k > 0 or flow.shape[1] >= 0  # motions without any impact are modes, known in closed form
    if with_impacts and k <= impacts[ORIGIN] and times[ORIGIN] > earliest:
        tube = Tube(rm, along, r, tube_q)
        count[ORIGIN] = approaches(flow, int64(ORIGIN), tube, min(reach, times[ORIGIN] - earliest), found[ORIGIN], work)
        if count[ORIGIN] < 0:
            return NEAR_ORIGIN
    if with_impacts and k <= impacts[REST] and times[REST] > earliest:
        tube = Tube(rm, along, r, tube_p)
        count[REST] = approaches(flow, int64(REST), tube, min(reach, times[REST] - earliest), found[REST], work)
        if count[REST] < 0:
            return NEAR_REST
    if not last and k <= impacts[STOP] and times[STOP] > earliest + window - MARGIN * r * abs(rm[column.DURATION + 1] * jac_m):
        rate = rm[column.RESIDUAL + 1] * jac_m
        change = MARGIN * deviation(ra[column.RESIDUAL + 1] * jac_a, rate, rb[column.RESIDUAL + 1] * jac_b)
        if abs(rm[column.RESIDUAL]) <= MARGIN * r * (abs(rate) + change):
            if abs(rate) <= change:
                return NEAR_STOP
            found[STOP, 0] = rm[column.DURATION]
            count[STOP] = 1
    return CLOSED
