"""The fast path of `motion.move`: many motions of two oscillating modes and one stop, without a record of events.

The gap coordinate is the sum of its two modes, w = p_1 + p_2. Each is the real part of a number p - i q that rotates and decays,

    p(t) = e^{mt} (p cos wt + q sin wt),   q(t) = e^{mt} (q cos wt - p sin wt)

so a step of one fixed length h costs a few products. The cubic with the values and slopes of w at both ends of a step lies within its four
Bezier coefficients. It differs from w by at most W h^4/384, where |w''''| <= W.

    If all coefficients are farther than this from the bounds, the step has no impact.
    If w passes a bound and |w'| > J h^2/8 at both ends, where |w'''| <= J, then w' keeps its sign and the step has exactly one impact.
    Otherwise the step is halved.

A motion is declined, and left to `motion.move`, if it needs a step below h/2^11 (grazing), chatters to its end or sticks.
"""

import math
from typing import NamedTuple

import numpy as np

from bvp.kernels import two_modes as entry
from bvp.kernels.compiled import inlined, kernel
from bvp.kernels.contact_mode import kick
from bvp.kernels.flight import copy_1, set_1
from bvp.kernels.two_modes import (
    changing,
    fraction_time,
    mode_rotations,
    moves_away,
    numbers,
    product,
    radii,
    raised,
    rotated_slightly,
    spend,
    turned,
    zero_in_step,
)

CLEARED, TIMED, FULL_COUNT, DECLINED = range(4)
"""Reasons: no impact is possible any more; the duration; the most impacts; not an ordinary motion."""

REASON, TIME, IMPACTS, LAST, PEAKS, SPENT = 0, 1, 2, 3, 4, 6
"""Columns of a result: reason, time reached, impacts, time of the last one (NaN: none), peaks of |u_1| and |u_2|, dissipated by each of
three parts."""

TIMES = COLUMNS = SPENT + entry.PARTS
"""Then the times at which each fraction is dissipated (NaN: not reached)."""

SLOW = 1e-7
"""Speeds below this part of the largest possible are left to `motion.move`."""

CHATTER_REACH, CHATTER_MOST = 0.3, 3
"""Bounces, whose sum to the end of chattering takes less than this over the fastest rate, that are still followed here."""

ROUNDING = 1e-12
FAR = 4096
"""Number of steps after which the state is computed anew from the start of the flight, so that rounding errors do not accumulate."""


@inlined
def summed(total, low, value):
    """Add to a compensated sum (Neumaier)."""
    result = total + value
    if abs(total) >= abs(value):
        low += (total - result) + value
    else:
        low += (value - result) + total
    return result, low


class RunLimits(NamedTuple):
    """Limits at which a motion ends."""

    duration: float
    unbounded: bool  # whether dissipation after the last possible impact counts to infinite time
    most: int  # impacts


class Systems(NamedTuple):
    """The systems of a batch of B motions."""

    numbers: np.ndarray  # one row a system, see `bvp.kernels.two_modes`
    terms: np.ndarray  # terms of each
    unbounded: np.ndarray  # of each, see `RunLimits`
    which: np.ndarray  # (B,) the system of each motion


@kernel
def fast_path_run(system, terms, start, initial, limits, fractions, taken, out):
    """Run one motion from `start` (4,) = (u, v), which becomes the final state. Fills `out` (COLUMNS + fractions,) and returns the
    reason of the end."""
    duration, unbounded, most = limits
    m1 = system[entry.MEAN]
    m2 = system[entry.MEAN + 1]
    w1 = system[entry.FREQUENCY]
    w2 = system[entry.FREQUENCY + 1]
    longest = system[entry.STEP]
    lower = system[entry.LOWER]
    upper = system[entry.UPPER]
    restitution = system[entry.RESTITUTION]
    given = numbers(start, 0)
    p1 = product(numbers(system, entry.INTO), given)
    q1 = product(numbers(system, entry.INTO + 4), given)
    p2 = product(numbers(system, entry.INTO + 8), given)
    q2 = product(numbers(system, entry.INTO + 12), given)
    square1 = m1 * m1 + w1 * w1
    square2 = m2 * m2 + w2 * w2
    rate1 = math.sqrt(square1)
    rate2 = math.sqrt(square2)
    fastest = max(rate1, rate2)
    reach = min(upper, -lower)
    # Peaks: rows over (p, q) of u_1 and u_2, and what an amplitude of a mode makes of them.
    rates, row1, row2 = (m1, w1, m2, w2), numbers(system, entry.OUT), numbers(system, entry.OUT + 4)
    size11, size12 = radii(row1)
    size21, size22 = radii(row2)
    peak1 = abs(start[0])
    peak2 = abs(start[1])
    time = 0.0
    time_low = 0.0
    d0 = d1 = d2 = e0 = e1 = e2 = 0.0
    mark = 0
    marks = fractions.shape[0] if initial > 0.0 else 0
    impacts = 0
    last = math.nan
    leaving = 0
    bounces = 0
    reason = DECLINED
    scale = 0.0
    while True:
        state = p1, q1, p2, q2
        radius1, radius2 = radii(state)
        if impacts == 0:
            scale = rate1 * radius1 + rate2 * radius2
            near = 1e-9 * (radius1 + radius2 + reach)
            if not lower + near < p1 + p2 < upper - near:
                return DECLINED
        if impacts >= most:
            reason = FULL_COUNT
            break
        third = square1 * rate1 * radius1 + square2 * rate2 * radius2
        fourth = square1 * square1 * radius1 + square2 * square2 * radius2
        noise = ROUNDING * (radius1 + radius2)
        watch1 = size11 * radius1 + size12 * radius2 > peak1
        watch2 = size21 * radius1 + size22 * radius2 > peak2
        value1 = abs(product(row1, state))
        value2 = abs(product(row2, state))
        second1 = square1 * size11 * radius1 + square2 * size12 * radius2
        second2 = square1 * size21 * radius1 + square2 * size22 * radius2
        third1 = square1 * rate1 * size11 * radius1 + square2 * rate2 * size12 * radius2
        fourth1 = square1 * square1 * size11 * radius1 + square2 * square2 * size12 * radius2
        third2 = square1 * rate1 * size21 * radius1 + square2 * rate2 * size22 * radius2
        fourth2 = square1 * square1 * size21 * radius1 + square2 * square2 * size22 * radius2
        left = (duration - time) - time_low
        # -- the flight, step by step
        r1, i1, r2, i2 = p1, q1, p2, q2
        t = 0.0
        side = 0
        level = 0
        guess = 0.0
        cleared = radius1 + radius2 < reach
        steps = 0
        w = p1 + p2
        if leaving != 0:
            w = upper if leaving > 0 else lower
        v = product(rates, state)
        fresh = leaving != 0
        while not (cleared and not watch1 and not watch2) and t < left:
            h = longest / float(1 << level)
            at = entry.ROTATIONS + 4 * level
            # A step of fixed length: two complex products.
            n1 = r1 * system[at] + i1 * system[at + 1]
            j1 = i1 * system[at] - r1 * system[at + 1]
            n2 = r2 * system[at + 2] + i2 * system[at + 3]
            j2 = i2 * system[at + 2] - r2 * system[at + 3]
            wn = n1 + n2
            vn = product(rates, (n1, j1, n2, j2))
            safe = cleared
            if not safe:
                # Equation (11): the inner Bezier coefficients, and the error of the cubic.
                first = w + h * v * (1.0 / 3.0)
                second = wn - h * vn * (1.0 / 3.0)
                error = fourth * (h * h * h * h * (1.0 / 384.0)) + noise
                safe = max(first, second, wn) + error < upper and min(first, second, wn) - error > lower
                if fresh:
                    # Off the stop: the distance over the time, a cubic, stays positive.
                    away = -float(leaving)
                    bend = away * (
                        (m1 * m1 - w1 * w1) * r1 + 2.0 * m1 * w1 * i1 + (m2 * m2 - w2 * w2) * r2 + 2.0 * m2 * w2 * i2
                    )  # fmt: skip
                    jerk = away * (
                        m1 * (m1 * m1 - 3.0 * w1 * w1) * r1 + w1 * (3.0 * m1 * m1 - w1 * w1) * i1
                        + m2 * (m2 * m2 - 3.0 * w2 * w2) * r2 + w2 * (3.0 * m2 * m2 - w2 * w2) * i2
                    )  # fmt: skip
                    slope = away * v
                    off = moves_away(slope, bend, jerk, fourth, h)
                    if leaving > 0:
                        safe = off and min(first, second, wn) - error > lower
                    else:
                        safe = off and max(first, second, wn) + error < upper
                    gone = off
                else:
                    gone = True
                if not safe:
                    bound = 0.0
                    ahead = 0
                    if gone and wn > upper + noise and v > 0.0:
                        ahead = 1
                        bound = upper
                    elif gone and wn < lower - noise and v < 0.0:
                        ahead = -1
                        bound = lower
                    if ahead != 0 and v * vn > 0.0 and min(abs(v), abs(vn)) > third * (h * h * 0.125):
                        side = ahead
                        guess = t + zero_in_step(w, v, wn, vn, h, bound) * h
                        break
                    level += 1
                    if level >= entry.LEVELS:
                        return DECLINED
                    continue
            if watch1:
                value = abs(product(row1, (n1, j1, n2, j2)))
                if max(value, value1) + second1 * h * h * 0.125 > peak1:
                    peak1 = raised(rates, row1, third1, fourth1, (r1, i1, r2, i2), (n1, j1, n2, j2), min(h, left - t), h, peak1)
                value1 = value
            if watch2:
                value = abs(product(row2, (n1, j1, n2, j2)))
                if max(value, value2) + second2 * h * h * 0.125 > peak2:
                    peak2 = raised(rates, row2, third2, fourth2, (r1, i1, r2, i2), (n1, j1, n2, j2), min(h, left - t), h, peak2)
                value2 = value
            r1, i1, r2, i2 = n1, j1, n2, j2
            w = wn
            v = vn
            fresh = False
            t += h
            if level:
                level -= 1
            steps += 1
            if steps % 16 == 0:
                if steps % FAR == 0:
                    r1, i1, r2, i2 = turned(state, mode_rotations(rates, t))
                    w = r1 + r2
                now1, now2 = radii((r1, i1, r2, i2))
                cleared = cleared or now1 + now2 + noise < reach
                watch1 = watch1 and size11 * now1 + size12 * now2 > peak1
                watch2 = watch2 and size21 * now1 + size22 * now2 > peak2
        # -- its end
        flight = left
        way = later = 0.0, 0.0, 0.0, 0.0
        if side != 0:
            bound = upper if side > 0 else lower
            flight = guess
            for _ in range(20):
                way = mode_rotations(rates, flight)
                later = turned(state, way)
                rate = changing(rates, later)
                bent = changing(rates, rate)
                jerked = changing(rates, bent)
                residual = bound - (later[0] + later[2])
                v = rate[0] + rate[2]
                bend = bent[0] + bent[2]
                jerk = jerked[0] + jerked[2]
                snap = product(rates, jerked)
                # The zero of the Taylor polynomial of fourth order about the present guess.
                change = residual / v
                for _ in range(3):
                    value = change * (v + change * (0.5 * bend + change * (jerk * (1.0 / 6.0) + change * snap * (1.0 / 24.0)))) - residual
                    change -= value / (v + change * (bend + change * (0.5 * jerk + change * snap * (1.0 / 6.0))))
                if not abs(change) <= longest:
                    return DECLINED
                flight += change
                size = fastest * abs(change)
                if size <= 0.02 and fourth * size * size * size * size * abs(change) <= 1e-15 * abs(v) * flight:
                    break
            # The last change is small: the rotations by it are their series.
            c1, s1 = rotated_slightly(m1, w1, change, way[0], way[1])
            c2, s2 = rotated_slightly(m2, w2, change, way[2], way[3])
            way = c1, s1, c2, s2
            later = turned(state, way)
            if flight >= left:
                side = 0
                flight = left
        infinite = side == 0 and cleared and unbounded
        if side == 0 and not infinite:
            way = mode_rotations(rates, flight)
            later = turned(state, way)
        elif infinite:
            flight = math.inf
            way = later = 0.0, 0.0, 0.0, 0.0
        length = flight - t
        if guess > 0.0 and length > 0.0:
            if watch1:
                peak1 = raised(rates, row1, third1, fourth1, (r1, i1, r2, i2), later, length, length, peak1)
            if watch2:
                peak2 = raised(rates, row2, third2, fourth2, (r1, i1, r2, i2), later, length, length, peak2)
        # Equation (29): what the dampers take over the flight.
        spent = spend(system, terms, state, flight, way, taken)
        x0 = taken[0]
        x1 = taken[1]
        if mark < marks:
            before = (d0 + d1 + d2) + (e0 + e1 + e2)
            while mark < marks and before + spent >= fractions[mark] * initial:
                wanted = fractions[mark] * initial - before
                out[TIMES + mark] = time + fraction_time(system, terms, state, flight, spent, wanted, taken)
                mark += 1
        d0, e0 = summed(d0, e0, x0)
        d1, e1 = summed(d1, e1, x1)
        p1, q1, p2, q2 = later
        if side == 0:
            reason = CLEARED if cleared else TIMED
            if not infinite:
                time = duration
                time_low = 0.0
            break
        time, time_low = summed(time, time_low, flight)
        # -- the impact
        v = product(rates, later)
        if not float(side) * v * restitution > SLOW * scale:
            return DECLINED
        # The restitution of both is that of the rounded sum.
        # Equations (4) and (9).
        jump = 1.0 + restitution
        loss = 0.5 * system[entry.MASS] * (2.0 - jump) * jump * v * v
        d2, e2 = summed(d2, e2, loss)
        change = jump * v
        p1 -= kick(change, system[entry.PUSH], system[entry.PUSH_REST])
        q1 -= kick(change, system[entry.PUSH + 1], system[entry.PUSH_REST + 1])
        p2 -= kick(change, system[entry.PUSH + 2], system[entry.PUSH_REST + 2])
        q2 -= kick(change, system[entry.PUSH + 3], system[entry.PUSH_REST + 3])
        impacts += 1
        last = time + time_low
        leaving = side
        if mark < marks:
            before = (d0 + d1 + d2) + (e0 + e1 + e2)
            while mark < marks and before >= fractions[mark] * initial:
                out[TIMES + mark] = last
                mark += 1
        bend = float(side) * product(rates, changing(rates, (p1, q1, p2, q2)))
        if bend > 0.0 and restitution < 1.0 and 2.0 * restitution * abs(v) * fastest <= CHATTER_REACH * bend * (1.0 - restitution):
            bounces += 1
            if bounces > CHATTER_MOST:
                return DECLINED
        else:
            bounces = 0
    out[REASON] = reason
    out[TIME] = last if reason == CLEARED and unbounded and impacts else 0.0 if reason == CLEARED and unbounded else time + time_low
    out[IMPACTS] = impacts
    out[LAST] = last
    out[PEAKS] = peak1
    out[PEAKS + 1] = peak2
    out[SPENT] = d0 + e0
    out[SPENT + 1] = d1 + e1
    out[SPENT + 2] = d2 + e2
    for k in range(4):
        start[k] = product(numbers(system, entry.OUT + 4 * k), (p1, q1, p2, q2))
    return reason


@kernel
def fast_path_batch(systems, starts, initial, duration, most, fractions, state, taken, out):
    """Run `fast_path_run` from each row (u, v) of `starts` (B, 4) with energy initial[b].

    most (B,): largest numbers of impacts. out (B, COLUMNS + Q): results; if a motion is declined, only its reason, and NaN elsewhere.
    state (4,) and taken (PARTS,) are scratch. Each row of `starts` becomes the final state, unless the motion is declined."""
    for b in range(starts.shape[0]):
        copy_1(starts[b], state)
        set_1(out[b], math.nan)
        s = systems.which[b]
        limits = RunLimits(duration, systems.unbounded[s], most[b])
        reason = fast_path_run(systems.numbers[s], systems.terms[s], state, initial[b], limits, fractions, taken, out[b])
        out[b, REASON] = reason
        if reason == DECLINED:
            set_1(out[b, TIMES:], math.nan)
            continue
        copy_1(state, starts[b])
