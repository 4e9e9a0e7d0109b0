"""The fast path of `motion.move`: many motions of two oscillating modes and one stop, without a record of events.

Unusual motions are declined.

The gap coordinate is the sum of its two modes, w = p_1 + p_2, each the real part of a number p - i q that rotates and decays,

    p(t) = e^{mt} (p cos wt + q sin wt),   q(t) = e^{mt} (q cos wt - p sin wt)

so that a step of one fixed length h costs a few products. Over a step the cubic that has the values and slopes of w at both ends differs
from w by no more than W h^4/384 with |w''''| <= W, and stays within its four Bezier coefficients: where these keep from the bounds by more,
there is no impact. Else the step is halved, or holds one impact for certain: w' keeps its sign where it does at both ends by more than
J h^2/8, |w'''| <= J. What needs a step below h/2^11 (grazing), chatters to its end or sticks is declined, and left to `motion.move`.
"""

import math
from typing import NamedTuple

import numpy as np

from bvp.kernels import two_modes as entry
from bvp.kernels.compiled import kernel, part
from bvp.kernels.impact import kick
from bvp.kernels.two_modes import fraction_time, raised, rotated, rotated_slightly, spend

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


@part
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
    p1 = q1 = p2 = q2 = 0.0
    for k in range(4):
        p1 += system[entry.INTO + k] * start[k]
        q1 += system[entry.INTO + 4 + k] * start[k]
        p2 += system[entry.INTO + 8 + k] * start[k]
        q2 += system[entry.INTO + 12 + k] * start[k]
    square1 = m1 * m1 + w1 * w1
    square2 = m2 * m2 + w2 * w2
    rate1 = math.sqrt(square1)
    rate2 = math.sqrt(square2)
    fastest = max(rate1, rate2)
    reach = min(upper, -lower)
    # Peaks: rows over (p, q) of u_1 and u_2, and what an amplitude of a mode makes of them.
    a11, b11, a12, b12 = system[entry.OUT], system[entry.OUT + 1], system[entry.OUT + 2], system[entry.OUT + 3]
    a21, b21, a22, b22 = system[entry.OUT + 4], system[entry.OUT + 5], system[entry.OUT + 6], system[entry.OUT + 7]
    rates, row1, row2 = (m1, w1, m2, w2), (a11, b11, a12, b12), (a21, b21, a22, b22)
    size11 = math.sqrt(a11 * a11 + b11 * b11)
    size12 = math.sqrt(a12 * a12 + b12 * b12)
    size21 = math.sqrt(a21 * a21 + b21 * b21)
    size22 = math.sqrt(a22 * a22 + b22 * b22)
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
        radius1 = math.sqrt(p1 * p1 + q1 * q1)
        radius2 = math.sqrt(p2 * p2 + q2 * q2)
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
        value1 = abs(a11 * p1 + b11 * q1 + a12 * p2 + b12 * q2)
        value2 = abs(a21 * p1 + b21 * q1 + a22 * p2 + b22 * q2)
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
        v = m1 * p1 + w1 * q1 + m2 * p2 + w2 * q2
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
            vn = m1 * n1 + w1 * j1 + m2 * n2 + w2 * j2
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
                    off = (
                        slope > 0.0 and slope + bend * h / 6.0 > 0.0 and slope + bend * h / 3.0 + jerk * h * h / 18.0 > 0.0
                        and slope + bend * h / 2.0 + jerk * h * h / 6.0 - fourth * h * h * h / 24.0 > 0.0
                    )  # fmt: skip
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
                        # Zero of the cubic with the values and slopes of both ends.
                        s = (bound - w) / (wn - w)
                        ca = v * h
                        cc = vn * h
                        rise = wn - w
                        for _ in range(3):
                            value = w + s * (ca + s * ((3.0 * rise - 2.0 * ca - cc) + s * (ca + cc - 2.0 * rise))) - bound
                            slope = ca + s * (2.0 * (3.0 * rise - 2.0 * ca - cc) + 3.0 * s * (ca + cc - 2.0 * rise))
                            s = min(max(s - value / slope, 0.0), 1.0) if slope != 0.0 else s
                        guess = t + s * h
                        break
                    level += 1
                    if level >= entry.LEVELS:
                        return DECLINED
                    continue
            if watch1:
                value = abs(a11 * n1 + b11 * j1 + a12 * n2 + b12 * j2)
                if max(value, value1) + second1 * h * h * 0.125 > peak1:
                    peak1 = raised(rates, row1, third1, fourth1, (r1, i1, r2, i2), (n1, j1, n2, j2), min(h, left - t), h, peak1)
                value1 = value
            if watch2:
                value = abs(a21 * n1 + b21 * j1 + a22 * n2 + b22 * j2)
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
                    c1, s1 = rotated(m1, w1, t)
                    c2, s2 = rotated(m2, w2, t)
                    r1 = p1 * c1 + q1 * s1
                    i1 = q1 * c1 - p1 * s1
                    r2 = p2 * c2 + q2 * s2
                    i2 = q2 * c2 - p2 * s2
                    w = r1 + r2
                now1 = math.sqrt(r1 * r1 + i1 * i1)
                now2 = math.sqrt(r2 * r2 + i2 * i2)
                cleared = cleared or now1 + now2 + noise < reach
                watch1 = watch1 and size11 * now1 + size12 * now2 > peak1
                watch2 = watch2 and size21 * now1 + size22 * now2 > peak2
        # -- its end
        flight = left
        c1 = s1 = c2 = s2 = 0.0
        n1 = j1 = n2 = j2 = 0.0
        if side != 0:
            bound = upper if side > 0 else lower
            flight = guess
            for _ in range(20):
                c1, s1 = rotated(m1, w1, flight)
                c2, s2 = rotated(m2, w2, flight)
                n1 = p1 * c1 + q1 * s1
                j1 = q1 * c1 - p1 * s1
                n2 = p2 * c2 + q2 * s2
                j2 = q2 * c2 - p2 * s2
                residual = bound - (n1 + n2)
                x1 = m1 * n1 + w1 * j1
                y1 = m1 * j1 - w1 * n1
                x2 = m2 * n2 + w2 * j2
                y2 = m2 * j2 - w2 * n2
                v = x1 + x2
                g1 = m1 * x1 + w1 * y1
                g2 = m2 * x2 + w2 * y2
                bend = g1 + g2
                f1 = m1 * y1 - w1 * x1
                f2 = m2 * y2 - w2 * x2
                z1 = m1 * g1 + w1 * f1
                z2 = m2 * g2 + w2 * f2
                jerk = z1 + z2
                snap = m1 * z1 + w1 * (m1 * f1 - w1 * g1) + m2 * z2 + w2 * (m2 * f2 - w2 * g2)
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
            c1, s1 = rotated_slightly(m1, w1, change, c1, s1)
            c2, s2 = rotated_slightly(m2, w2, change, c2, s2)
            n1 = p1 * c1 + q1 * s1
            j1 = q1 * c1 - p1 * s1
            n2 = p2 * c2 + q2 * s2
            j2 = q2 * c2 - p2 * s2
            if flight >= left:
                side = 0
                flight = left
        infinite = side == 0 and cleared and unbounded
        if side == 0 and not infinite:
            c1, s1 = rotated(m1, w1, flight)
            c2, s2 = rotated(m2, w2, flight)
            n1 = p1 * c1 + q1 * s1
            j1 = q1 * c1 - p1 * s1
            n2 = p2 * c2 + q2 * s2
            j2 = q2 * c2 - p2 * s2
        elif infinite:
            flight = math.inf
            c1 = s1 = c2 = s2 = 0.0
            n1 = j1 = n2 = j2 = 0.0
        length = flight - t
        if guess > 0.0 and length > 0.0:
            if watch1:
                peak1 = raised(rates, row1, third1, fourth1, (r1, i1, r2, i2), (n1, j1, n2, j2), length, length, peak1)
            if watch2:
                peak2 = raised(rates, row2, third2, fourth2, (r1, i1, r2, i2), (n1, j1, n2, j2), length, length, peak2)
        # Equation (29): what the dampers take over the flight.
        spent = spend(system, terms, (p1, q1, p2, q2), flight, (c1, s1, c2, s2), taken)
        x0 = taken[0]
        x1 = taken[1]
        if mark < marks:
            before = (d0 + d1 + d2) + (e0 + e1 + e2)
            while mark < marks and before + spent >= fractions[mark] * initial:
                wanted = fractions[mark] * initial - before
                out[TIMES + mark] = time + fraction_time(system, terms, (p1, q1, p2, q2), flight, spent, wanted, taken)
                mark += 1
        d0, e0 = summed(d0, e0, x0)
        d1, e1 = summed(d1, e1, x1)
        p1, q1, p2, q2 = n1, j1, n2, j2
        if side == 0:
            reason = CLEARED if cleared else TIMED
            if not infinite:
                time = duration
                time_low = 0.0
            break
        time, time_low = summed(time, time_low, flight)
        # -- the impact
        v = m1 * p1 + w1 * q1 + m2 * p2 + w2 * q2
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
        bend = float(side) * (
            m1 * (m1 * p1 + w1 * q1) + w1 * (m1 * q1 - w1 * p1) + m2 * (m2 * p2 + w2 * q2) + w2 * (m2 * q2 - w2 * p2)
        )
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
        at = entry.OUT + 4 * k
        start[k] = system[at] * p1 + system[at + 1] * q1 + system[at + 2] * p2 + system[at + 3] * q2
    return reason


@kernel
def fast_path_batch(systems, starts, initial, duration, most, fractions, state, taken, out):
    """Run `fast_path_run` from each row (u, v) of `starts` (B, 4) with energy initial[b].

    most (B,): largest numbers of impacts. out (B, COLUMNS + Q): results; if a motion is declined, only its reason, and NaN elsewhere.
    state (4,) and taken (PARTS,) are scratch. Each row of `starts` becomes the final state, unless the motion is declined."""
    for b in range(starts.shape[0]):
        for k in range(4):
            state[k] = starts[b, k]
        for k in range(out.shape[1]):
            out[b, k] = math.nan
        s = systems.which[b]
        limits = RunLimits(duration, systems.unbounded[s], most[b])
        reason = fast_path_run(systems.numbers[s], systems.terms[s], state, initial[b], limits, fractions, taken, out[b])
        out[b, REASON] = reason
        if reason == DECLINED:
            for k in range(fractions.shape[0]):
                out[b, TIMES + k] = math.nan
            continue
        for k in range(4):
            starts[b, k] = state[k]
