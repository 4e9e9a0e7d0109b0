"""The next impact of two undamped modes that oscillate, with one stop: for scans, which ask for it a hundred thousand times.

The gap coordinate is w(t) = sum of a_k cos w_k t + b_k sin w_k t. Steps of fixed lengths h, h/2, .. cost a few products, and are judged as
in `bvp.kernels.fast_path`: with W and J bounds of the fourth and the third derivative of w,

    W h^4/384 is the error of the cubic through both ends of a step, which lies within its four Bezier coefficients: a step has no impact
        if all of them are farther than this from the bounds;
    w' keeps its sign over a step if |w'| > J h^2/8 at both ends: then a bound that w passes is hit once.

All else is halved, down to h/2^(L-1), and then declined: `bvp.kernels.impact.next_hit` finds what is nearly a grazing.
"""

import math

import numpy as np
from numpy import int64

from bvp.kernels.compiled import inlined
from bvp.kernels.impact import HIT, NONE, quadratic_step
from bvp.kernels.two_modes import moves_away, zero_in_step

DECLINED = -1
"""In place of a status: not an ordinary impact."""

LEVELS = 8
STEP = 0.7
"""Number of lengths of a step, and the longest, in radians of the faster mode."""

ROUNDING = 1e-12
"""Rounding errors of w, as a part of its amplitudes."""


def step_table(squares: np.ndarray) -> np.ndarray:
    """Length h, then cos w h and sin w h of both modes, for each level: (LEVELS, 5); (0, 5) if a mode does not oscillate."""
    if not np.all(squares > 0.0):
        return np.zeros((0, 5))
    rates = np.sqrt(squares)
    lengths = STEP / rates.max() * 0.5 ** np.arange(LEVELS)
    first, second = lengths * rates[0], lengths * rates[1]
    return np.ascontiguousarray(np.column_stack([lengths, np.cos(first), np.sin(first), np.cos(second), np.sin(second)]))


SMALL = 1e-4
"""Angle up to which the third order of its cosine and sine is exact to rounding."""


@inlined
def turned_slightly(c, s, angle):
    """(cosine, sine) of an angle farther on by a `SMALL` one."""
    square = 0.5 * angle * angle
    cube = angle * square / 3.0
    return c - s * angle - c * square + s * cube, s + c * angle - s * square - c * cube


@inlined
def turn_mode(square, c, s, k, z, out):
    """Mode k of a state (4,) after a time t with c = cos w t, s = sin w t / w, as equation (2)."""
    q = z[k]
    p = z[k + 2]
    out[k] = c * q + s * p
    out[k + 2] = -square * s * q + c * p


@inlined
def turn_states(squares, rotations, a, b, out_a, out_b):
    """`bvp.kernels.shooting.fly_both` over a time whose (cos, sin) of both modes are given."""
    for k in range(2):
        c = rotations[2 * k]
        s = rotations[2 * k + 1] / math.sqrt(squares[k])
        turn_mode(squares[k], c, s, k, a, out_a)
        turn_mode(squares[k], c, s, k, b, out_b)


@inlined
def two_mode_hit(table, squares, gap, limits, z, leaving, horizon, rotations):
    """The first hit of the flight from z = (q_1, q_2, p_1, p_2) within 0 < t <= horizon.

    table: of `step_table`. gap (m, 4), limits (2,): row (the same for both bounds) and bounds of the gap coordinate. leaving: +1 or -1
    where the flight starts on the upper or the lower bound, else 0. rotations (4,): receives cos w t and sin w t of both modes at a hit.
    Returns (NONE, 0, horizon), (HIT, +1 or -1 for the bound, time), or (DECLINED, 0, 0)."""
    declined = int64(DECLINED), 0.0, 0.0
    lower = limits[0]
    upper = limits[1]
    square1 = squares[0]
    square2 = squares[1]
    w1 = math.sqrt(square1)
    w2 = math.sqrt(square2)
    a1 = gap[0, 0] * z[0]
    a2 = gap[0, 1] * z[1]
    b1 = gap[0, 0] * z[2] / w1
    b2 = gap[0, 1] * z[3] / w2
    radius1 = math.sqrt(a1 * a1 + b1 * b1)
    radius2 = math.sqrt(a2 * a2 + b2 * b2)
    noise = ROUNDING * (radius1 + radius2)
    if radius1 + radius2 + noise < min(upper, -lower):
        return int64(NONE), 0.0, horizon
    third = square1 * w1 * radius1 + square2 * w2 * radius2
    fourth = square1 * square1 * radius1 + square2 * square2 * radius2
    w = a1 + a2
    v = w1 * b1 + w2 * b2
    if leaving != 0.0:
        w = upper if leaving > 0.0 else lower
    elif not lower + noise < w < upper - noise:
        return declined
    c1, d1, c2, d2 = a1, b1, a2, b2
    fresh = leaving != 0.0
    side = 0.0
    bound = 0.0
    guess = 0.0
    h = 0.0
    t = 0.0
    level = 0
    while side == 0.0:
        if t >= horizon:
            return int64(NONE), 0.0, horizon
        h = table[level, 0]
        n1 = c1 * table[level, 1] + d1 * table[level, 2]
        m1 = d1 * table[level, 1] - c1 * table[level, 2]
        n2 = c2 * table[level, 3] + d2 * table[level, 4]
        m2 = d2 * table[level, 3] - c2 * table[level, 4]
        wn = n1 + n2
        vn = w1 * m1 + w2 * m2
        # Equation (11): the inner Bezier coefficients, and the error of the cubic.
        first = w + h * v * (1.0 / 3.0)
        second = wn - h * vn * (1.0 / 3.0)
        error = fourth * (h * h * h * h * (1.0 / 384.0)) + noise
        above = max(first, second, wn) + error < upper
        below = min(first, second, wn) - error > lower
        gone = True
        if fresh:
            bend = -(square1 * c1 + square2 * c2)
            jerk = -(square1 * w1 * d1 + square2 * w2 * d2)
            gone = moves_away(-leaving * v, -leaving * bend, -leaving * jerk, fourth, h)
            if leaving > 0.0:
                above = gone
            else:
                below = gone
        if above and below:
            c1, d1, c2, d2 = n1, m1, n2, m2
            w = wn
            v = vn
            fresh = False
            t += h
            if level > 0:
                level -= 1
            continue
        if gone and v * vn > 0.0 and min(abs(v), abs(vn)) > third * (h * h * 0.125):
            if wn > upper + noise and v > 0.0:
                side = 1.0
                bound = upper
            elif wn < lower - noise and v < 0.0:
                side = -1.0
                bound = lower
        if side != 0.0:
            guess = t + zero_in_step(w, v, wn, vn, h, bound) * h
        else:
            level += 1
            if level == table.shape[0]:
                return declined
    time = guess
    last = math.inf
    x1 = y1 = x2 = y2 = change = 0.0
    for _ in range(30):
        x1 = math.cos(w1 * time)
        y1 = math.sin(w1 * time)
        x2 = math.cos(w2 * time)
        y2 = math.sin(w2 * time)
        n1 = a1 * x1 + b1 * y1
        m1 = b1 * x1 - a1 * y1
        n2 = a2 * x2 + b2 * y2
        m2 = b2 * x2 - a2 * y2
        slope = -side * (w1 * m1 + w2 * m2)
        if slope >= 0.0:
            return declined
        # Third order, as `bvp.kernels.impact.polish_root`.
        change = quadratic_step(side * (bound - (n1 + n2)), slope, side * (square1 * n1 + square2 * n2))
        time += change
        size = abs(change)
        if third * size * size * size <= -1e-17 * time * slope or size >= last:
            break
        last = size
    if not abs(time - guess) <= h or time <= 0.0:
        return declined
    if time > horizon:
        return int64(NONE), 0.0, horizon
    if max(w1, w2) * abs(change) <= SMALL:
        x1, y1 = turned_slightly(x1, y1, w1 * change)
        x2, y2 = turned_slightly(x2, y2, w2 * change)
    else:
        x1, y1, x2, y2 = math.cos(w1 * time), math.sin(w1 * time), math.cos(w2 * time), math.sin(w2 * time)
    rotations[0] = x1
    rotations[1] = y1
    rotations[2] = x2
    rotations[3] = y2
    return int64(HIT), side, time
