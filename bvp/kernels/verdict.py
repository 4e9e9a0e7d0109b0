"""Whether one flight of an interval of starts is decided, from the records of its ends and of its middle."""

import math

from numba import int64

from bvp.kernels.compiled import kernel
from bvp.kernels.end_crossings import MARGIN, approaches
from bvp.kernels.follow import (
    ACCELERATION,
    CLEARANCE,
    CONTACT,
    DERIVATIVE,
    DURATION,
    FREE,
    RESIDUAL,
    SECOND,
    SPEED,
    STUCK,
    THIRD,
    TIME,
    amplitude,
    nearest_turns,
)
from bvp.kernels.impact import CONTACT_TOLERANCE
from bvp.kernels.segment import ORIGIN, REST, STOP

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
"""Distance below which a touch cannot be told from a hit, a fraction of the sizes that make it up."""


@kernel
def positive(value_a, rate_a, value_m, rate_m, value_b, rate_b, r, noise):
    """Whether a positive quantity stays so over an interval of half width r, sampled with its derivative at both ends and the middle, where
    `noise` is its rounding error (it may be zero at an end)."""
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


@kernel
def stays_positive(column, a, m, b, jac_a, jac_m, jac_b, r, grain, noise):
    """`positive` for one column of three records and the next one, its derivative; `noise`: besides what the grain of the starts makes."""
    return positive(
        a[column], a[column + 1] * jac_a, m[column], m[column + 1] * jac_m, b[column], b[column + 1] * jac_b, r,
        noise + 8.0 * grain * abs(m[column + 1]),
    )  # fmt: skip


@kernel
def touching(flow, row):
    """Distance to a stop, anywhere in a flight, below which a touch cannot be told from a hit."""
    size = 1.0
    for k in range(2):
        size += abs(flow.contacts.gap[0, k]) * amplitude(flow.squares[k], row[k], row[k + 2], row[THIRD], int64(0))
    return TOUCHING * size


@kernel
def flight_verdict(
    flow, k, a, b, m, levels_a, levels_b, levels_m, jac_a, jac_b, jac_m, r, grain, times, impacts, longest, most, found, count, work
):
    """Judge flight k of an interval from the records of its ends and middle (`jac_`: d theta/d x there; r: half its width in x).

    times, impacts (3,): for each kind of far end, the longest time and most inner impacts; a negative time where it is not looked for.
    found (3, P): times of crossings of each kind (for STOP of the impact), count (3,): how many. Returns the verdict."""
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
        return ENDED
    # -- how the flight ends
    ra = a[k]
    rb = b[k]
    rm = m[k]
    if ra[CONTACT] == STUCK or rb[CONTACT] == STUCK or rm[CONTACT] == STUCK:
        return PRESSED
    far = 0
    for row in (ra, rb, rm):
        if row[CONTACT] == FREE or row[DURATION] > horizon:
            far += 1
    last = far == 3
    if not last:
        if ra[CONTACT] != rb[CONTACT]:
            # Where one of them only leaves the time searched, halves will show it.
            return LATE if (ra[CONTACT] == FREE or rb[CONTACT] == FREE) and r * jac_m > 1e-5 else JUMP
        if ra[CONTACT] != rm[CONTACT] or ra[CONTACT] == FREE:
            return DIFFERENT
        # The same stop, but one flight goes on past the impact that ends the other.
        steepest = max(abs(ra[DURATION + 1] * jac_a), abs(rb[DURATION + 1] * jac_b), abs(rm[DURATION + 1] * jac_m))
        if r * jac_m < 1e-4 and abs(rb[DURATION] - ra[DURATION]) > 20.0 * r * steepest + 1e-9:
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
        wide += abs(flow.contacts.gap[0, c]) * (inner + outer)
        tube_q += outer * outer
        force += abs(flow.contacts.gap[0, c] * flow.squares[c]) * (inner + outer)
        outer = amplitude(flow.squares[c], vary[c], vary[c + 2], window, int64(1))
        tube_p += outer * outer
    # On the section of an impact the gap does not vary: from there its variation grows with time.
    near = 0.5 * force * window * window
    for c in range(0, 4, 2):
        first = (flow.contacts.gap[0, 0] * ra[DERIVATIVE + c] + flow.contacts.gap[0, 1] * ra[DERIVATIVE + c + 1]) * jac_a
        second = (flow.contacts.gap[0, 0] * rb[DERIVATIVE + c] + flow.contacts.gap[0, 1] * rb[DERIVATIVE + c + 1]) * jac_b
        middle = (flow.contacts.gap[0, 0] * rm[DERIVATIVE + c] + flow.contacts.gap[0, 1] * rm[DERIVATIVE + c + 1]) * jac_m
        largest = abs(middle) + 0.5 * abs(second - first) + abs(0.5 * (first + second) - middle)
        near += largest if c == 0 else largest * window
    wide = MARGIN * r * min(wide, near)
    tube_q = MARGIN * math.sqrt(tube_q)
    tube_p = MARGIN * math.sqrt(tube_p)
    if k == 0 and r * jac_m > 0.1:
        return COARSE
    if spread > VARIATION * VARIATION * size:
        return UNEVEN
    # -- no turning point reaches a stop
    if rm[CLEARANCE] != rm[CLEARANCE]:
        nearest_turns(flow, rm, 1.05 * longest - rm[TIME], work)
    if rm[CLEARANCE] <= wide:
        if rm[SECOND] <= wide:
            return TOUCHES
        if ra[CLEARANCE] != ra[CLEARANCE]:
            nearest_turns(flow, ra, 1.05 * longest - ra[TIME], work)
        if rb[CLEARANCE] != rb[CLEARANCE]:
            nearest_turns(flow, rb, 1.05 * longest - rb[TIME], work)
        if not stays_positive(CLEARANCE, ra, rm, rb, jac_a, jac_m, jac_b, r, grain, touching(flow, rm)):
            return TOUCHES
    # -- the impact is a transversal one, and its arrival is known over the interval
    if not last:
        if not stays_positive(SPEED, ra, rm, rb, jac_a, jac_m, jac_b, r, grain, 0.0):
            return SLOW
        if rm[ACCELERATION] > 0.0 and rm[SPEED] * rm[SPEED] <= 2.0 * rm[ACCELERATION] * wide:
            return SKIMS
        mean = (ra[DURATION + 1] * jac_a + 4.0 * rm[DURATION + 1] * jac_m + rb[DURATION + 1] * jac_b) * r / 3.0
        steepest = max(abs(ra[DURATION + 1] * jac_a), abs(rb[DURATION + 1] * jac_b), abs(rm[DURATION + 1] * jac_m))
        if abs(rb[DURATION] - ra[DURATION] - mean) > 0.1 * r * steepest + SLACK * (1.0 + longest) + 8.0 * grain / jac_m * steepest:
            return UNEVEN
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
                return UNEVEN
            if math.sqrt(off) > 0.1 * r * math.sqrt(size) + SLACK * math.sqrt(noise) + 8.0 * grain / jac_m * math.sqrt(size):
                return UNEVEN
    # -- orbits
    reach = min(window + MARGIN * r * abs(rm[DURATION + 1] * jac_m), horizon) if not last else horizon
    struck = k > 0 or flow.shape[1] >= 0  # motions without any impact are modes, known in closed form
    if struck and k <= impacts[ORIGIN] and times[ORIGIN] > earliest:
        count[ORIGIN] = approaches(flow, int64(ORIGIN), rm, along, r, tube_q, min(reach, times[ORIGIN] - earliest), found[ORIGIN], work)
        if count[ORIGIN] < 0:
            return NEAR_ORIGIN
    if struck and k <= impacts[REST] and times[REST] > earliest:
        count[REST] = approaches(flow, int64(REST), rm, along, r, tube_p, min(reach, times[REST] - earliest), found[REST], work)
        if count[REST] < 0:
            return NEAR_REST
    if not last and k <= impacts[STOP] and times[STOP] > earliest + window - MARGIN * r * abs(rm[DURATION + 1] * jac_m):
        first = ra[RESIDUAL + 1] * jac_a
        second = rb[RESIDUAL + 1] * jac_b
        rate = rm[RESIDUAL + 1] * jac_m
        change = MARGIN * (0.5 * abs(second - first) + abs(0.5 * (first + second) - rate))
        if abs(rm[RESIDUAL]) <= MARGIN * r * (abs(rate) + change):
            if abs(rate) <= change:
                return NEAR_STOP
            found[STOP, 0] = rm[DURATION]
            count[STOP] = 1
    return CLOSED
