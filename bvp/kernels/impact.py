"""The next impact of a flight, by bounds instead of sampling.

A contact has the signed distance d(t) = side (bound - w(t)), w = g . z(t), with d >= 0 in free flight. `flight.amplitudes`
bounds |w''| <= W and |w'''| <= J over what is left of the flight. From d, d', d'' at one instant follows, by equations
(3) and (25),

    a step without a root          h = 2 d/(-d' + sqrt(d'^2 + 2 W d)),  or  3 d''/J  where d' >= 0 and d'' > 0;
    a certified root               where d' < 0 and 4 W d <= d'^2: exactly one root within 2 d/|d'| (Newton-Kantorovich); d here
                                   counts the contact tolerance, so that rounding cannot make a hit of a touch;
                                   or where |d'''| <= J keeps d' below a third of its start until d < 0: d falls through its one root;
    a certified turning point      where d' < 0 < d'' and 4 J |d'| <= d''^2: d falls to its one minimum within 2 |d'|/d'' and is
                                   convex there, so the value at the minimum decides between passing, a touch and a hit.

Steps therefore shrink onto a root quadratically until it is certified, and Newton on the exact flight does the rest.

Only the contact just left is treated apart, and only until its distance is well above the tolerance: d(t)/t then comes
from the series of d at the start, see `near_return`.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy import int64

from bvp.kernels.compiled import inlined, kernel, shared
from bvp.kernels.flight import Flight, amplitudes, block_product, copy_1, fastest_rate, flow_state, free_step, row_dot
from bvp.kernels.flights import (
    NEAR_REACH,
    NEAR_TERMS,
    along_path,
    bounds_window,
    parting,
    path_bounds,
    path_growth,
    rounding_level,
    series,
)
from bvp.kernels.pieces import MotionFlight

KINDS_OF_FLIGHTS = (Flight, MotionFlight)
"""What the search takes: a kernel has imported the kinds that it contains."""

CONTACT_TOLERANCE = 1e-13
"""THE contact tolerance, a fraction of the sizes that make up a distance, |bound| + sum |g_i z_i|. A turning point of w
within it of the bound, on either side, is a touch: it is reported and the motion goes on. Beyond it w crosses and hits."""

NONE, HIT, TOUCH, PRESSED, OUTSIDE, EXHAUSTED = 0, 1, 2, 3, 4, 5
"""What `next_impact` found: no impact up to the horizon; a hit; a touch; the motion stays pressed against the stop it starts
on; the start lies beyond a stop; the search gave up after `STEP_LIMIT` steps."""

TURN, CROSSED = 6, 7
"""Verdicts inside the search: a certified turning point ahead; beyond the bound without a certificate before."""

STEP_LIMIT = 100_000
NEAR = 1e9
"""A start counts as near its stop until the distance is this many contact tolerances: a return from less, at a speed below 1e-2 or so,
would be known no better than rounding of w over that speed."""
WORK_ROWS = 5
RUNGS, HALVINGS = 8, 60
"""Steps along which one derivative of a distance is followed to its zero, and halvings of a step."""

STEADY_FALL = 1.0 / 3.0
"""Part of its rate at which a distance falls at least until it passes 0, where that certifies the root."""

RENEW = 8
"""Steps after which the bounds of a motion that decays are taken anew: they stay valid, but it becomes smaller."""

RELEASED = 1000.0
"""Roundings within which a contact just released counts as being without rate and acceleration: its force has gone through other
numbers."""


def work_array(size, contacts):
    """Scratch array of the kernels here for N = `size` states and m = `contacts`."""
    return np.zeros((WORK_ROWS, max(size, contacts, NEAR_TERMS + 1)))


class Gap(NamedTuple):
    """The distance of a contact at one instant."""

    d: float
    slope: float  # d'
    bend: float  # d''
    tolerance: float  # the contact tolerance, in units of d


class GapBounds(NamedTuple):
    """Bounds of the derivatives of a distance."""

    curvature: float  # of |d''|
    jerk: float  # of |d'''|
    window: float  # time over which they hold


@inlined
def gauge(contacts, c, z):
    """(d, d', d'', contact tolerance) of contact c at the state z."""
    w = 0.0
    slope = 0.0
    bend = 0.0
    size = abs(contacts.bound[c])
    # d, d' and d'' of the distance in equation (3).
    for r in range(z.shape[0]):
        part = contacts.gap[c, r] * z[r]
        w += part
        size += abs(part)
        slope += contacts.rate[c, r] * z[r]
        bend += contacts.acceleration[c, r] * z[r]
    return contacts.side[c] * (contacts.bound[c] - w), -contacts.side[c] * slope, -contacts.side[c] * bend, CONTACT_TOLERANCE * size


@inlined
def quadratic_step(d, slope, bend):
    """The zero of d + d' h + d'' h^2/2 nearest to h = 0, for d' < 0; Newton's step if there is no zero."""
    square = slope * slope - 2.0 * bend * d
    return 2.0 * d / (-slope + math.sqrt(square)) if square > 0.0 else -d / slope


@kernel
def polish_root(flight, contacts, c, curvature, jerk, z, t, state):
    """Refine a nearby zero of d along the exact flight to rounding, by steps of third order."""
    last = math.inf
    for _ in range(60):
        along_path(flight, z, t, state)
        d, slope, bend, _ = gauge(contacts, c, state)
        if slope >= 0.0:
            break
        # Third order: the zero of the parabola through d, d' and d''.
        step = quadratic_step(d, slope, max(-curvature, min(bend, curvature)))
        t = max(t + step, 0.0)
        size = abs(step)
        if jerk * size * size * size <= -1e-17 * t * slope or size >= last:
            break
        last = size
    return t


@kernel
def resolve_turn(flight, contacts, c, bounds, z, t, gap, fresh, state):
    """Classify a certified turning point after time t: (HIT or TOUCH, its time), or (NONE, length of a step from t without either).

    `gap`: the contact's distance at t. `fresh`: as in `judge_gap`."""
    curvature, jerk, _ = bounds
    _, slope, bend, tolerance = gap
    turn = t
    last = t - 2.0 * slope / bend  # the certificate's; rounding of what is nearly 0 would lead anywhere
    d = 0.0
    for count in range(30):
        # Newton's method for d' = 0.
        change = -slope / bend
        turn = min(max(turn + change, t), last)
        if count > 0 and 0.5 * bend * change * change <= 1e-3 * tolerance:
            break
        along_path(flight, z, turn, state)
        d, slope, bend, tolerance = gauge(contacts, c, state)
    # d at the turning point decides whether the flight passes, touches or hits.
    least = d - 0.5 * slope * slope / bend
    if least > tolerance or (fresh and least >= -tolerance):
        ahead = free_step(max(least, 0.0), 0.0, curvature)
        if jerk > 0.0 or fresh:
            ahead = max(ahead, 3.0 * bend / jerk)
        return NONE, turn - t + ahead
    if least >= -tolerance:
        return TOUCH, max(turn, t)
    start = max(turn - math.sqrt(-2.0 * least / bend), t)
    return HIT, polish_root(flight, contacts, c, curvature, jerk, z, start, state)


@kernel
def judge_gap(gap, bounds, fresh):
    """(verdict, step) from d and its derivatives at one instant.

    verdict NONE: no root within `step`. HIT: a certified root at about `step`. TURN: a certified turning point ahead. TOUCH,
    CROSSED: w is within the tolerance of the bound and past its turning point, or beyond the bound, without a certificate
    before (roots of third order and more, which the walk in steps of the tolerance finds).
    `fresh`: the contact may be within the tolerance because the flight began there, which is no touch.
    """
    d, slope, bend, tolerance = gap
    curvature, jerk, window = bounds
    if d < -tolerance:
        return CROSSED, quadratic_step(d, slope, bend) if slope < 0.0 else 0.0
    distance = max(d, 0.0)
    # Equation (3) with the bound over the full flight, then with a tighter one over a short time.
    step = free_step(distance, slope, curvature)
    trial = 2.0 * step
    local = jerk * trial / 3.0 - bend
    if local < curvature:
        step = max(step, min(trial, free_step(distance, slope, max(local, 0.0))))
    if d <= tolerance:
        # This is passed over, for steps must not shrink to nothing: less than the tolerance, or a crossing would be missed.
        step = max(step, free_step(distance + 0.25 * tolerance, slope, curvature))
    if slope >= 0.0:
        if d <= tolerance and not fresh:
            return TOUCH, 0.0
        if bend > 0.0 and jerk > 0.0:
            step = max(step, 3.0 * bend / jerk)
        return NONE, step
    if step >= window:
        return NONE, step
    # Equation (25), first certificate. The tolerance is added so that rounding cannot make an impact of a touch.
    reach = -2.0 * (distance + tolerance) / slope
    if 4.0 * min(curvature, abs(bend) + jerk * reach) * (distance + tolerance) <= slope * slope and reach <= window:
        return HIT, quadratic_step(d, slope, bend)
    # d' stays below a third of its value until d < 0, so d falls through exactly one zero.
    guess = quadratic_step(distance + tolerance, slope, bend)
    ahead = 1.25 * guess
    if ahead <= window and slope + ahead * (bend + 0.5 * jerk * ahead) <= STEADY_FALL * slope:
        if distance + tolerance + ahead * (slope + ahead * (0.5 * bend + jerk * ahead / 6.0)) <= 0.0:
            return HIT, guess
    # Equation (25), second certificate.
    if bend > 0.0 and -4.0 * jerk * slope <= bend * bend and -2.0 * slope <= bend * window:
        return TURN, 0.0
    return NONE, step


@kernel
def start_contact(flight, contacts, leaving, z):
    """(status, contact that the flight leaves): OUTSIDE with the violated contact; else NONE with `leaving`, or with a contact that z is
    on."""
    for c in range(contacts.side.shape[0]):
        if c == leaving:
            continue
        d, slope, _, tolerance = gauge(contacts, c, z)
        # Where the bound and all displacements vanish, rounding is that of the velocities.
        if not d >= -tolerance and not d >= -rounding_level(flight, contacts.gap, c, z):
            return OUTSIDE, c
        if leaving < 0 and d <= tolerance and slope >= -rounding_level(flight, contacts.rate, c, z):
            leaving = c
    return NONE, leaving


@kernel
def differentiate(flight, order, z, state, other):
    """state = B^order z; other (N,) is scratch."""
    copy_1(z, state)
    for _ in range(order):
        block_product(flight.pairs, flight.matrix, state, other)
        copy_1(other, state)


@parting.of(Flight)
@kernel
def exact_parting(flight, contacts, c, z, horizon, window, state, other, further):
    """See `parting`."""
    rows, side = contacts.acceleration, contacts.side[c]
    order = 3
    differentiate(flight, 1, z, state, other)
    while abs(row_dot(rows, c, state)) <= rounding_level(flight, rows, c, state):
        # Derivatives that are 0 up to the number of states vanish for ever (Cayley and Hamilton).
        if order > z.shape[0]:
            return 0.0, 0
        block_product(flight.pairs, flight.matrix, state, other)
        copy_1(other, state)
        order += 1
    if -side * row_dot(rows, c, state) < 0.0:
        return 0.0, order
    if order == 3:
        _, fourth, _ = amplitudes(flight, rows[c], z, window)
        third = -side * row_dot(rows, c, state)
        return min(third / fourth, window) if fourth > 0.0 else window, order
    # While a derivative is positive, those below it, and the distance, rise from 0. It is followed towards its zero; then the derivative
    # below it is, down to the rate.
    time = 0.0
    step = horizon
    for level in range(order, 0, -1):
        for _ in range(RUNGS):
            flow_state(flight, z, time, further)
            step = positive_step(flight, contacts, c, level, further, min(4.0 * step, horizon - time), state, other)
            time += step
            if step <= 0.01 * time:
                break
        step = max(step, 0.01 * time)
    return time, order


@kernel
def positive_step(flight, contacts, c, level, z, longest, state, other):
    """A time, up to `longest`, in which the derivative of order `level` of a contact's distance stays positive; 0 where it is not above
    rounding."""
    if level > 1:
        rows = contacts.acceleration
        differentiate(flight, level - 2, z, state, other)
    else:
        rows = contacts.rate
        copy_1(z, state)
    value = -contacts.side[c] * row_dot(rows, c, state)
    if value <= rounding_level(flight, rows, c, state):
        return 0.0
    step = longest
    for _ in range(HALVINGS):
        # The value exceeds the other terms of its Taylor series, and the remainder.
        if level > 1:
            differentiate(flight, level - 2, z, state, other)
        else:
            copy_1(z, state)
        change = 0.0
        factor = 1.0
        for k in range(1, NEAR_TERMS):
            block_product(flight.pairs, flight.matrix, state, other)
            copy_1(other, state)
            factor *= step / k
            change += factor * abs(row_dot(rows, c, state))
        block_product(flight.pairs, flight.matrix, state, other)
        bound, _, _ = amplitudes(flight, rows[c], other, step)
        if change + factor * step / NEAR_TERMS * bound < value:
            return step
        step *= 0.5
    return 0.0


@series.of(Flight)
@kernel
def exact_series(flight, contacts, c, z, coefficients, state, other):
    """See `series`: by repeated B."""
    copy_1(z, state)
    factor = 1.0
    for k in range(1, NEAR_TERMS + 1):
        block_product(flight.pairs, flight.matrix, state, other)
        factor /= k
        coefficients[k] = -contacts.side[c] * row_dot(contacts.gap, c, other) * factor
        copy_1(other, state)
    return fastest_rate(flight)


@kernel
def near_slope(coefficients, t):
    """s(t) = d(t)/t and its derivative from the series of d."""
    s = 0.0
    derivative = 0.0
    # Horner's scheme for d(t)/t = d'(0) + d''(0) t/2 + ... and its derivative.
    for k in range(NEAR_TERMS, 0, -1):
        derivative = derivative * t + s
        s = s * t + coefficients[k]
    return s, derivative


@kernel
def near_return(coefficients, jerk, t, window):
    """One test of the contact just left: (True, time of the return), or (False, length of a step without a return)."""
    s, fall = near_slope(coefficients, t)
    s = max(s, 0.0)
    # Equation (25) for d(t)/t, whose bend is at most V/3.
    if fall >= 0.0 or 4.0 * jerk * s > 3.0 * fall * fall or -2.0 * s < fall * window:
        return False, free_step(s, fall, jerk / 3.0)
    root = t
    last = math.inf
    for _ in range(60):
        step = -s / fall
        root += step
        if abs(step) <= 1e-16 * root or abs(step) >= last:
            break
        last = abs(step)
        s, fall = near_slope(coefficients, root)
    return True, root


@shared(("integer", "integer", "float"))
def next_impact(flight, contacts, leaving, z, horizon, work):
    """The first hit or touch of the flight from z within 0 <= t <= horizon, which is known up to there (`flights.begin_path`).

    leaving
        c: the flight starts on contact c. Its distance there is 0 exactly, and its rate is exact unless restitution has made it 0.
        -1: no contact is given. If z is on a contact, its rate counts only beyond rounding.
        -2 - c: the force of contact c has just come to 0. It starts with distance, rate and acceleration 0.
    work
        See `work_array`.

    Any other contact within the tolerance at the start counts as it moves: away, or a hit at t = 0.

    Returns (status, contact, time): (NONE, -1, horizon), (HIT or TOUCH, contact, time), (PRESSED, contact, 0),
    (OUTSIDE, contact, 0), (EXHAUSTED, -1, time reached).
    """
    size = z.shape[0]
    state = work[0, :size]
    curvature = work[1]
    jerk = work[2]
    coefficients = work[3]
    other = work[4, :size]
    given = leaving >= 0
    released = leaving < -1
    if released:
        leaving = -2 - leaving
    status, leaving = start_contact(flight, contacts, leaving, z)
    if status != NONE:
        return status, leaving, 0.0
    steady, growth = path_growth(flight)
    near = leaving >= 0
    fresh = int64(-1)  # bits of the contacts that have been within the tolerance since the start
    reach = -1.0
    parts = 0  # order of the first derivative with which the contact just left opens; 0: the first or second
    apart = 0.0  # time up to which it is certain not to return
    rests = int64(0)  # bits of the contacts whose distance stays 0
    near_jerk = 0.0
    t = 0.0
    found = -1
    kind = NONE
    copy_1(z, state)
    level, second, third = 0.0, 0.0, 0.0
    for count in range(STEP_LIMIT):
        # The bounds hold over a window: all of the flight where nothing damps or grows.
        renew = count == 0 or (not steady and (growth > 0.0 or count % RENEW == 0))
        window = math.inf if steady else 2.0 * (horizon - t)
        if growth > 0.0:
            window = bounds_window(flight, t, min(window, 1.0 / growth))
        step = min(window, horizon - t)
        known = -1
        for c in range(contacts.side.shape[0]):
            if c == found:
                continue
            if renew:
                shared = c > 0 and known == c - 1  # the two contacts of one stop share their bounds
                for r in range(size if shared else 0):
                    shared = shared and contacts.gap[c, r] == contacts.gap[c - 1, r]
                if not shared:
                    # Equation (24).
                    level, second, third = path_bounds(flight, contacts.gap, c, t, state, min(window, 2.0 * (horizon - t)))
                known = c
                jerk[c] = third
                curvature[c] = -1.0 if level < contacts.side[c] * contacts.bound[c] else second  # -1: w cannot reach the bound
            if curvature[c] < 0.0 or (rests >> c) & 1 != 0:
                continue
            d, slope, bend, tolerance = gauge(contacts, c, state)
            bend = max(-curvature[c], min(bend, curvature[c]))  # its rounding is that of the fastest mode, even where that has died out
            own = c == leaving and near
            if own:
                near_jerk = max(near_jerk, jerk[c])
            # At the start of a flight from a contact the distance is 0 exactly; its derivatives decide whether the contact opens. Of
            # another one without distance and speed they do, too: these are rounding.
            if count == 0 and (own or (d <= tolerance and abs(slope) <= rounding_level(flight, contacts.rate, c, z))):
                exact = own and given and contacts.restitution[c] != 0.0
                force = -math.inf
                still = 0.0
                if not (exact and slope > 0.0):
                    force = rounding_level(flight, contacts.acceleration, c, z)
                    still = rounding_level(flight, contacts.rate, c, z)
                if own and released:
                    force *= RELEASED
                    still *= RELEASED
                if slope < -still:
                    return HIT, c, 0.0
                ahead = 0.0
                if slope <= (0.0 if exact else still) and bend <= force:
                    order = 2
                    if bend >= -force:
                        ahead, order = parting(flight, contacts, c, z, horizon, window, state, other, coefficients[:size])
                        copy_1(z, state)
                    if order == 0:
                        rests |= int64(1) << c  # it stays on the stop without pressing
                        continue
                    if ahead == 0.0:
                        return PRESSED, c, 0.0
                    if own:
                        apart = ahead
                        parts = order
                if bend > 0.0 and jerk[c] > 0.0:
                    ahead = max(ahead, 3.0 * bend / jerk[c])
                ahead = max(ahead, free_step(0.0, max(slope, 0.0), curvature[c]))
                step = min(step, ahead)
                continue
            if own:
                if t < apart:
                    step = min(step, apart - t)
                    continue
                if d > NEAR * tolerance:
                    near = False
                else:
                    # Near the stop d is rounding, so d(t)/t comes from the series of d at the start.
                    if reach < 0.0:
                        reach = series(flight, contacts, c, z, coefficients, state, other)
                        for k in range(1, min(parts, NEAR_TERMS + 1)):
                            coefficients[k] = 0.0
                        along_path(flight, z, t, state)
                    near = reach * t <= NEAR_REACH
            if d > tolerance:
                fresh &= ~(int64(1) << c)
            if c == leaving and near:
                returns, value = near_return(coefficients, near_jerk, t, window)
                status = HIT if returns else NONE
            else:
                new = (fresh >> c) & 1 != 0
                gap, bounds = Gap(d, slope, bend, tolerance), GapBounds(curvature[c], jerk[c], window)
                status, value = judge_gap(gap, bounds, new)
                if status == HIT or (status == CROSSED and slope < 0.0):
                    status = HIT
                    start = max(t + value, 0.0)
                    value = polish_root(flight, contacts, c, curvature[c], jerk[c], z, start, other)
                elif status == TURN:
                    status, value = resolve_turn(flight, contacts, c, bounds, z, t, gap, new, other)
                elif status == TOUCH:
                    value = t
                elif status == CROSSED:
                    status = HIT
                    value = t
            if status == NONE:
                step = min(step, value)
            elif value < horizon:
                kind = status
                found = c
                horizon = value
        if t + step >= horizon:
            return kind, found, horizon
        t += step
        along_path(flight, z, t, state)
    return EXHAUSTED, -1, t


@kernel
def next_hit(flight, contacts, leaving, z, horizon, work, state):
    """`next_impact`, but touches are skipped: z (N,) moves to the last touch before the hit. Returns (status, contact, time from the
    given z). `state` (N,) is scratch."""
    elapsed = 0.0
    while True:
        status, contact, time = next_impact(flight, contacts, leaving, z, horizon - elapsed, work)
        elapsed += time
        if status != TOUCH:
            return status, contact, elapsed
        flow_state(flight, z, time, state)
        copy_1(state, z)
        leaving = int64(contact)
