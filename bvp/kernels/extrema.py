"""Extrema and sign changes of a linear functional f = c . z along an exact flight, by bounds instead of sampling.

With |f''| <= W over the flight, f keeps its sign over the step (|f'| + sqrt(f'^2 + 2 W |f|))/W away from zero (with f' counted
against it where it points to zero), and f is monotone over |f'|/W. With |f'''| <= V, f' keeps its sign, and f is monotone, over the
step of the same form for f' and f''. Steps take the longest of these, so each holds at most one zero, and that one changes the sign.
A step in which f changes by its rounding alone is not divided: what is smaller cannot be seen.

Where no mode damps or grows, f(t) is a sum over the modes of alpha C(t) + beta S(t): its parts (alpha, beta) are found once a flight, and
give f, f' and f'' from one sine and cosine of each mode.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy import int64

from bvp.kernels.compiled import chosen, inlined, kernel, shared
from bvp.kernels.flight import Contacts, Flight, amplitudes, block_product, circular, copy_1, flow_state, free_step, inner, row_dot
from bvp.kernels.flights import path_growth, path_state, rounding_level
from bvp.kernels.impact import EXHAUSTED, NONE, OUTSIDE, TOUCH, next_impact

STEP_LIMIT = 100000
"""Steps after which a search gives up and says so; a flight of a thousand periods takes some ten thousand."""

ROUNDING = 4e-16
"""Of a functional, as a part of its bound: two units."""

TIE = 1e-13
"""Part of its size by which rounding can change a distance, a speed or a time of an orbit. Of two nearer than this, the earlier counts."""

INSTANT = 1e-8
"""Part of a flight by which two instants are apart at least; a turning point is found to a tenth of it."""


class Observed(NamedTuple):
    """Functionals that are observed along each flight. S stops, N entries a state."""

    rows: np.ndarray  # (S [+ 2], 4, N) each gap w, then the velocities of absorber and primary if there are any; and three derivatives
    bounds: np.ndarray  # (2, S) lower and upper bounds of the gaps


class Track(NamedTuple):
    """A linear functional f(t) = value . z(t) along one flight from z, and its bounds. The search loops of this file evaluate it."""

    flight: Flight
    value: np.ndarray  # (N,) row of f
    rate: np.ndarray  # (N,) row of f'
    second: np.ndarray  # (N,) row of f''
    z: np.ndarray  # (N,)
    parts: np.ndarray  # (N,) alpha and beta of each mode where `pure`, else scratch
    pure: bool  # every block is a pair that neither damps nor grows
    level: float  # bound of |f|
    curvature: float  # of |f''|
    jerk: float  # of |f'''|
    duration: float  # of the flight


@chosen
def track_of(flight, value, rate, second, z, duration, parts):
    """The track of value . z(t) for 0 <= t <= duration, on the flight from z: `look` and `bounds_at` describe it."""


@track_of.of(Flight)
@inlined
def linear_track(flight, value, rate, second, z, duration, parts):
    """See `track_of`: a `Track`."""
    pure, level, curvature, jerk = separate(flight, value, z, duration, parts)
    return Track(flight, value, rate, second, z, parts, pure, level, curvature, jerk, duration)


@inlined
def separate(flight, value, z, horizon, parts):
    """(pure, bound of |f|, of |f''|, of |f'''|) for f = value . z(t), 0 <= t <= horizon; parts (N,) are filled if the flight is
    pure."""
    pairs, mean, delta, matrix = flight
    level = 0.0
    curvature = 0.0
    jerk = 0.0
    for k in range(pairs.shape[0]):
        i = pairs[k, 0]
        j = pairs[k, 1]
        if j < 0 or mean[k] != 0.0 or delta[k] > 0.0:
            level, curvature, jerk = amplitudes(flight, value, z, horizon)
            return False, level, curvature, jerk
        # f = alpha cos w t + beta sin(w t)/w for this mode; equation (24) sums its bounds.
        alpha = value[i] * z[i] + value[j] * z[j]
        beta = value[i] * (matrix[i, i] * z[i] + matrix[i, j] * z[j]) + value[j] * (matrix[j, i] * z[i] + matrix[j, j] * z[j])
        parts[2 * k] = alpha
        parts[2 * k + 1] = beta
        square = -delta[k]
        slope = math.sqrt(square * alpha * alpha + beta * beta)  # amplitude of f'
        frequency = math.sqrt(square)
        level += min(slope / frequency if frequency > 0.0 else math.inf, abs(alpha) + abs(beta) * horizon)
        curvature += frequency * slope
        jerk += square * slope
    return True, level, curvature * (1.0 + 1e-12), jerk * (1.0 + 1e-12)


@chosen
def look(track, t):
    """f, f' and f'' at time t."""


@chosen
def bounds_at(track, t):
    """Bounds of |f''| and |f'''| from time t on (0: none known), and the time up to which they hold."""


@bounds_at.of(Track)
@inlined
def linear_bounds(track, t):
    """See `bounds_at`."""
    return track.curvature, track.jerk, math.inf


@look.of(Track)
@inlined
def look_linear(track, t):
    """See `look`."""
    delta = track.flight.delta
    parts = track.parts
    f = 0.0
    slope = 0.0
    bend = 0.0
    # Equation (2) for each mode, or the exact flight where modes damp or grow.
    if track.pure and t == 0.0:  # every search begins here
        for k in range(delta.shape[0]):
            f += parts[2 * k]
            slope += parts[2 * k + 1]
            bend += delta[k] * parts[2 * k]
    elif track.pure:
        for k in range(delta.shape[0]):
            c, s = circular(delta[k], t)
            here = parts[2 * k] * c + parts[2 * k + 1] * s
            f += here
            slope += parts[2 * k + 1] * c + delta[k] * parts[2 * k] * s
            bend += delta[k] * here
    else:
        flow_state(track.flight, track.z, t, parts)
        f = inner(track.value, parts)
        slope = inner(track.rate, parts)
        bend = inner(track.second, parts)
    return f, slope, bend


@inlined
def safe_step(f, slope, bend, curvature, jerk):
    """Longest step in which f has no zero or is monotone. `curvature`, `jerk`: bounds of |f''| and |f'''| (0: none known)."""
    step = math.inf
    # Equation (26) for f; and for f', which is monotone or keeps its sign over the last one.
    if curvature > 0.0:
        step = max(abs(slope) / curvature, free_step(abs(f), slope if f >= 0.0 else -slope, curvature))
        if jerk > 0.0:
            step = max(step, free_step(abs(slope), bend if slope >= 0.0 else -bend, jerk))
    return step


@inlined
def next_sign_change(track, floor, inside, first, last, sign, before, f_before, t, steps):
    """Go on to the next sample at which f has another sign than `sign` (0: any sign), in steps that hold one zero at most.

    (before, f_before) is the last sample and t the time of the next one. A value up to `inside`, or up to `first` and `last` at the ends of
    the flight, has no sign. Where one of these is infinite, f is zero at that end, and has the sign there that it has beside it: what is
    returned as its value has this sign alone. Steps are at least `floor` long.

    Returns (True, last sample before, its value, sample with the sign, its value, time of the next one, steps made), or (False, ...) at the
    end, where the next time is infinite, and after STEP_LIMIT steps."""
    found = False
    here = before
    f = f_before
    while not found and t <= track.duration and steps < STEP_LIMIT:
        before = here
        f_before = f
        here = t
        f, slope, bend = look(track, here)
        steps += 1
        curvature, jerk, until = bounds_at(track, here)
        step = safe_step(f, slope, bend, curvature, jerk)
        least = first if here == 0.0 else last if here >= track.duration else inside
        if least == math.inf:
            f = slope if here == 0.0 else -slope
            least = 0.0
        found = abs(f) > least and (sign == 0 or (f > 0.0) != (sign > 0))
        if step * step * curvature < ROUNDING * track.level:
            # Beside a tangency: f and its changes in this time are rounding.
            step = math.sqrt(ROUNDING * track.level / curvature)
        step = max(min(step, until - here), floor)
        t = math.inf if here >= track.duration else min(track.duration, here + step)
    return found, before, f_before, here, f, t, steps


@inlined
def refine(track, low, f_low, high, f_high, tolerance):
    """The zero of f between low and high, where it changes sign once."""
    root = low + f_low / (f_low - f_high) * (high - low)
    positive = f_high <= 0.0
    for _ in range(100):
        if not (low <= root <= high):
            root = 0.5 * (low + high)
        f, slope, bend = look(track, root)
        if (f > 0.0) == positive:
            low = root
        else:
            high = root
        divisor = slope * slope - 0.5 * f * bend
        better = root - f * slope / divisor if divisor != 0.0 else 0.5 * (low + high)  # Halley
        if not (low <= better <= high):
            better = 0.5 * (low + high)
        if abs(better - root) <= tolerance:
            return better
        root = better
    return root


@kernel
def rises(flight, value, rate, second, z, duration, sign, times, work):
    """Times in [0, duration) at which f = value . z(t) crosses zero upwards, into `times`, after an earlier `sign` of f (0: none yet).

    Values within rounding of zero have no sign. A crossing at the beginning, where the flight before ended below zero, is at time 0.
    Returns (count, last sign); count is -1 where the search gave up or there is no room."""
    track = track_of(flight, value, rate, second, z, duration, work)
    level = 1e-13 * (track.level + 1e-300)
    floor, tolerance, count = 1e-13 * duration, 1e-16 * duration, 0
    here, f, t, steps = 0.0, 0.0, 0.0, 0
    while True:
        found, before, f_before, here, f, t, steps = next_sign_change(track, floor, level, level, level, sign, here, f, t, steps)
        if not found:
            return count if t == math.inf and count <= times.shape[0] else -1, sign
        if sign != 0 and f > 0.0:
            if count < times.shape[0]:
                times[count] = refine(track, before, f_before, here, f, tolerance) if here > 0.0 else 0.0
            count += 1
        sign = int64(1) if f > 0.0 else int64(-1)


@inlined
def tie_of(gap, rate, position, velocity, duration):
    """Difference of two distances w = gap . position, with the speeds w' = rate . velocity, that is a tie in a flight of `duration`."""
    size = 0.0
    for r in range(gap.shape[0]):
        size += abs(gap[r] * position[r]) + duration * abs(rate[r] * velocity[r])
    return TIE * size


@inlined
def slack_of(time, last, slack):
    """How much later a contact at `time` may be and still count as the earlier one: any time behind `last`."""
    return math.inf if time > last else slack


@inlined
def nearer(best, best_side, best_time, distance, side, time, tie, slack):
    """The nearer of two contacts (distance, side, time). At a tie the distance is the smaller one, side and time are those of the earlier:
    the second one is where it is not later than the first by `slack`."""
    if distance < best - tie or (distance < best + tie and time < best_time + slack):
        best_side = side
        best_time = time
    return distance if distance < best else best, best_side, best_time


@inlined
def note_contact(place, best, earliest, moment, flight, stop, distance, side, time, tie, slack):
    """Write a contact into `place` - flight, stop, side, time - if it is nearer than the nearest so far, at `best`, or as near and earlier.

    moment, earliest: their instants in the orbit; instants apart by less than `slack` are one. Return the distance and the instant of the
    nearer one."""
    if distance < best - tie or (distance < best + tie and moment < earliest - slack):
        earliest = moment
        place[0] = flight
        place[1] = stop
        place[2] = side
        place[3] = time
    return distance if distance < best else best, earliest


@inlined
def nearest_turn(flight, observed, stop, z, duration, sign, steps, tie, last, work):
    """See `clearance`, for a piece of a flight: sign is that of w' before it (0: the flight begins here), steps those made before.

    last: turning points after this time are at the end of a closed orbit, and so at its begin: at a tie they are the first.
    Returns (distance, side, time, sign, steps)."""
    gap = observed.rows[stop]
    track = track_of(flight, gap[1], gap[2], gap[3], z, duration, work[0, : z.shape[0]])
    state = work[1, : z.shape[0]]
    best = math.inf
    best_side = 0.0
    best_time = 0.0
    here, f, t = 0.0, 0.0, 0.0
    while True:
        found, before, f_before, here, f, t, steps = next_sign_change(track, 1e-13 * duration, 0.0, 0.0, 0.0, sign, here, f, t, steps)
        if not found:
            return best if t == math.inf else math.nan, best_side, best_time, sign, steps
        if sign != 0:
            turn = refine(track, before, f_before, here, f, 1e-9 * duration)
            path_state(flight, z, turn, state)
            w = inner(gap[0], state)
            distance = observed.bounds[1, stop] - w if sign > 0 else w - observed.bounds[0, stop]
            side = 1.0 if sign > 0 else -1.0
            best, best_side, best_time = nearer(best, best_side, best_time, distance, side, turn, tie, slack_of(turn, last, 0.0))
        sign = 1 if f > 0.0 else -1


@inlined
def clearance(flight, observed, stop, z, duration, tie, last, work):
    """Smallest distance of w from the bounds of one stop at its turning points inside a flight: (distance, side, time).

    Of equal distances (`tie_of`) the first counts; last: see `nearest_turn`. The distance is infinite if w has no turning point, and NaN
    if the search gave up. work (2, N)."""
    distance, side, time, _, _ = nearest_turn(flight, observed, stop, z, duration, 0, 0, tie, last, work)
    return distance, side, time


PEAK_ROWS = 7
"""Rows of the scratch array."""

IDLE_LIMIT = 8
"""Searches without time passing after which there is no way on."""

FRUITLESS = 2
"""Such searches after which time is made to pass."""

SHARP = 4.5
"""A bound over a flight is sharp if it is no more than this times the bound over its first half: a parabola has 4."""

SLOW = 1e-3
"""Part of the bound of a velocity below which it counts as nearly zero."""

EQUAL_PEAKS = 1.0 + 1e-15
"""Factor within which two peaks are equal."""

LEAST = 1e-14
"""Part of the bound of |u| that is rounding."""

PAUSE = 1e-3
"""That time, in radians. Rate and two derivatives are zero to rounding at its begin, so that |u| can exceed its values at both
ends by no more than a part 1e-13 of its amplitude."""


@kernel
def row_times_matrix(flight, rows, c, out):
    """out[0] = rows[c] B. A contact mode with fewer states has no blocks for the others."""
    for r in range(out.shape[1]):
        out[0, r] = 0.0
    block_product(flight.pairs, flight.matrix.T, rows[c], out[0])


@inlined
def time_to(rise, derivative, power):
    """(rise/|derivative|)^power"""
    return (rise / abs(derivative)) ** power if derivative != 0.0 else math.inf


@chosen
def peak_flight(flight, leave, z, duration, peaks, when, scratch, edge, work):
    """Raise peaks (n,) to the largest |u| over a flight of `duration` from z (N,), with (u, v) = leave z. when (n,), or empty: the times
    of those that are raised. False if the search gave up.

    scratch (PEAK_ROWS, 1, N), edge (2, 1), work of `impact.work_array`."""


@inlined
def raise_peak(i, value, time, peaks, when):
    """Raise peaks[i] to |value|, reached at a time. Of values that are equal to rounding the first one counts."""
    if abs(value) > peaks[i]:
        if when.shape[0] > 0 and abs(value) > EQUAL_PEAKS * peaks[i]:
            when[i] = time
        peaks[i] = abs(value)


@kernel
def sharp_piece(flight, leave, i, z, duration, growth):
    """The part of a flight of `duration` from z over which the bounds of u and u'' are sharp; and these bounds.

    Beside a resonance large parts of the state cancel, and their bounds grow exponentially where the sum grows as a power of time."""
    piece = duration
    level, bend, _ = amplitudes(flight, leave[i], z, piece)
    while growth * piece > 1.0:
        half, half_bend, _ = amplitudes(flight, leave[i], z, 0.5 * piece)
        if level <= SHARP * half:
            break
        piece *= 0.5
        level = half
        bend = half_bend
    return piece, level, bend


@peak_flight.of(Flight)
@shared("boolean")
def peak_exact(flight, leave, z, duration, peaks, when, scratch, edge, work):
    """See `peak_flight`."""
    _, growth = path_growth(flight)
    n = peaks.shape[0]
    begin, end = scratch[6, 0], scratch[5, 0]
    flow_state(flight, z, duration, end)
    for i in range(n):
        raise_peak(i, row_dot(leave, i, z), 0.0, peaks, when)
        # A flight that is short beside the time in which its velocity can change has no turning point, or none that matters.
        _, bend, _ = amplitudes(flight, leave[i], z, duration)
        bend *= duration
        highest, turning = abs(row_dot(leave, i, end)), row_dot(leave, n + i, z) + row_dot(leave, n + i, end)
        if abs(turning) > bend or max(highest, abs(row_dot(leave, i, z))) + 0.125 * bend * duration <= peaks[i]:
            raise_peak(i, highest, duration, peaks, when)
            continue
        copy_1(z, begin)
        time = 0.0
        while True:
            piece, level, bend = sharp_piece(flight, leave, i, begin, duration - time, growth)
            if level > peaks[i] and not peak_of_piece(
                flight, leave, i, Piece(begin, time, piece, level, bend), peaks, when, scratch, edge, work
            ):
                return False
            if not time < time + piece < duration:
                break
            time += piece
            flow_state(flight, z, time, begin)
    return True


class Piece(NamedTuple):
    """A part of a flight."""

    z: np.ndarray  # (N,) its start
    time: float  # at which it begins
    duration: float
    level: float  # bound of |u|
    bend: float  # bound of |u''|


@inlined
def peak_of_piece(flight, leave, i, piece, peaks, when, scratch, edge, work):
    """Raise peaks[i] to the largest |u_i| over a piece of a flight, as `peak_flight` does."""
    n = peaks.shape[0]
    z, began, duration, level, bend = piece
    now = scratch[3, 0]
    later = scratch[4, 0]
    side = edge[0]
    bound = edge[1]
    bound[0] = 0.0
    # The velocity takes the place of a gap, so that its next zero is found as an impact is, by equation (3). A restitution that is not 0
    # says that its rates are exact.
    watched = Contacts(scratch[0], scratch[1], scratch[2], side, bound, scratch[0], side)
    raise_peak(i, row_dot(leave, i, z), began, peaks, when)
    flow_state(flight, z, duration, later)
    highest = abs(row_dot(leave, i, later))
    reached = max(highest, peaks[i], LEAST * level, rounding_level(flight, leave, i, z))
    copy_1(z, now)
    copy_1(leave[n + i], scratch[0, 0])
    row_times_matrix(flight, leave, n + i, scratch[1])
    row_times_matrix(flight, scratch[1], 0, scratch[2])
    rate = row_dot(leave, n + i, z)
    # At rest, or without acceleration too, as where an impulse hits another coordinate, the next derivative decides where it goes.
    if abs(rate) <= rounding_level(flight, leave, n + i, z):
        rate = row_dot(scratch[1], 0, z)
        if abs(rate) <= rounding_level(flight, scratch[1], 0, z):
            rate = row_dot(scratch[2], 0, z)
    side[0] = -1.0 if rate > 0.0 else 1.0
    left = duration
    leaving = -1
    idle = 0
    while left > 0.0 and max(peaks[i], highest) < level:
        step = 0.0
        rate = row_dot(scratch[0], 0, now)
        if rate * rate < SLOW * SLOW * bend * level:
            # What begins at rest and is moved through other coordinates has a velocity that is nearly zero for long. There the terms of
            # u's Taylor series, and a bound of the fourth derivative, give a time in which |u| stays below a value that it reaches.
            ahead, _, _ = amplitudes(flight, leave[i], now, left)
            _, fourth, _ = amplitudes(flight, scratch[1, 0], now, left)
            rise = 0.25 * max(reached - abs(row_dot(leave, i, now)), 0.0)
            step = min(left, time_to(rise, rate, 1.0), time_to(2.0 * rise, row_dot(scratch[1], 0, now), 0.5))
            step = min(step, time_to(6.0 * rise, row_dot(scratch[2], 0, now), 1.0 / 3.0), time_to(24.0 * rise, fourth, 0.25))
            if ahead <= max(peaks[i], highest) or step >= left:
                break
            if not step**4 * fourth > SLOW * reached:
                step = 0.0
        if step > 0.0:
            flow_state(flight, now, step, later)
            copy_1(later, now)
            left -= step
            leaving = -1
            side[0] = -1.0 if row_dot(scratch[0], 0, now) > 0.0 else 1.0
            continue
        status, _, step = next_impact(flight, watched, leaving, now, left, work)
        if status == NONE:
            step = left
        idle = idle + 1 if step == 0.0 else 0
        if idle > IDLE_LIMIT:
            return False
        resumed = idle > FRUITLESS
        if resumed:
            # At rest with no derivative that decides where it goes, as where a force on a far coordinate begins. A little later one
            # does.
            rate, bend, _ = amplitudes(flight, scratch[0, 0], now, left)
            step = min(left, PAUSE * math.sqrt(rate / bend)) if bend > 0.0 else left
        flow_state(flight, now, step, later)
        raise_peak(i, row_dot(leave, i, later), began + (duration - left) + step, peaks, when)
        copy_1(later, now)
        left -= step
        if status != TOUCH and status != EXHAUSTED:
            side[0] = -side[0]
        leaving = -1 if status == OUTSIDE or status == EXHAUSTED else 0
        if resumed:
            leaving = -1
            side[0] = -1.0 if row_dot(scratch[0], 0, now) > 0.0 else 1.0
    raise_peak(i, highest, began + duration, peaks, when)
    return True
