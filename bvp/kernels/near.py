"""A flight near the stop that it has just left, where the distance d(t) = t s(t) comes from its own Taylor series.

d(0) = 0, so bound - w would cancel. The search for a return runs on s, with |s''| <= J/3 for a third derivative of d bounded
by J: the start is no root of s, and a speed of leaving as tiny as rounding allows is resolved.
"""

import math

from bvp.kernels.bounds import dot, fastest_rate, free_step
from bvp.kernels.compiled import kernel
from bvp.kernels.flight import block_product

__all__ = ["SERIES_REACH", "SERIES_TERMS", "near_return", "near_slope", "series"]

SERIES_TERMS = 14
SERIES_REACH = 0.25
"""|B| t up to which the series from the start is used: its 14 terms truncate below 1e-19."""


@kernel
def series(pairs, matrix, gap, side, c, z, coefficients, state, other):
    """coefficients[k] = d^(k)(0)/k! for k >= 1 by repeated B. Returns a rate that bounds how fast the terms can grow."""
    for r in range(z.shape[0]):
        state[r] = z[r]
    factor = 1.0
    for k in range(1, SERIES_TERMS + 1):
        block_product(pairs, matrix, state, other)
        factor /= k
        coefficients[k] = -side[c] * dot(gap, c, other) * factor
        for r in range(z.shape[0]):
            state[r] = other[r]
    return fastest_rate(pairs, matrix)


@kernel
def near_slope(coefficients, t):
    """s(t) = d(t)/t and its derivative from the series of d."""
    s = 0.0
    derivative = 0.0
    for k in range(SERIES_TERMS, 0, -1):
        derivative = derivative * t + s
        s = s * t + coefficients[k]
    return s, derivative


@kernel
def near_return(coefficients, jerk, t, window):
    """One look at the contact just left: (True, time of the return) or (False, step without a return)."""
    s, fall = near_slope(coefficients, t)
    s = max(s, 0.0)
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
