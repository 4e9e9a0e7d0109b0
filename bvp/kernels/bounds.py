"""Bounds of a linear functional f(t) = row . exp(B t) z and of its derivatives over a flight, and steps that cannot pass a root."""

import math

import numpy as np

from bvp.kernels.compiled import allocating, kernel, part
from bvp.kernels.flight import block_product, row_dot

MARGIN = 1.0 + 1e-9
"""Bounds are widened by this, far more than their own rounding."""

SERIES_TERMS = 8
"""Terms of the series that bounds the motion of a larger block: its steps are at most its own time of growth."""

INVERSE_E = 0.36787944117144233
"""Maximum of x exp(-x)."""


@part
def growth_rate(flight):
    """(steady, growth). steady: no block damps or grows. growth >= 0: a bound of the growth rate of every block."""
    pairs, mean, delta, matrix = flight
    steady = True
    growth = 0.0
    for k in range(pairs.shape[0]):
        i = pairs[k, 0]
        j = pairs[k, 1]
        if mean[k] != 0.0 or delta[k] > 0.0 or j < -1:
            steady = False
            if j < -1:
                growth = max(growth, block_growth(matrix, i, -j))
            else:
                growth = max(growth, mean[k] + (math.sqrt(delta[k]) if delta[k] > 0.0 else 0.0))
    return steady, growth


@kernel
def block_growth(matrix, start, size):
    """Largest eigenvalue of the symmetric part of a block, bounded by Gershgorin's circles: |exp(B t)| <= exp(this t)."""
    worst = -math.inf
    for r in range(start, start + size):
        total = matrix[r, r]
        for c in range(start, start + size):
            if c != r:
                total += 0.5 * abs(matrix[r, c] + matrix[c, r])
        worst = max(worst, total)
    return worst


@kernel
def fastest_rate(flight):
    """A rate that bounds how fast the terms of the series of exp(B t) can grow."""
    pairs, _, _, matrix = flight
    fastest = 0.0
    for k in range(pairs.shape[0]):
        i = pairs[k, 0]
        j = pairs[k, 1]
        if j >= 0:
            half = 0.5 * (matrix[i, i] - matrix[j, j])
            width = math.sqrt(half * half + abs(matrix[i, j] * matrix[j, i]))
            fastest = max(fastest, 0.5 * abs(matrix[i, i] + matrix[j, j]) + width)
        else:
            for r in range(i, i - j):
                total = 0.0
                for q in range(i, i - j):
                    total += abs(matrix[r, q])
                fastest = max(fastest, total)
    return fastest


@allocating
def block_amplitudes(matrix, start, size, rows, c, z, weight, growth, horizon):
    """The bounds of `amplitudes` for the block of `size` indices from `start`, by Taylor's series with its remainder. `weight`: norm of the
    row's part.

    The series of a translation under constant forces ends after a few terms, so these bounds stay sharp for any distance."""
    state = np.empty(size)
    other = np.empty(size)
    for r in range(size):
        state[r] = z[start + r]
    level = 0.0
    second = 0.0
    third = 0.0
    rest = math.exp(growth * horizon) if growth > 0.0 else 1.0
    term, term_second, term_third = 1.0, 0.0, 0.0
    for k in range(SERIES_TERMS + 4):
        value = 0.0
        norm = 0.0
        for r in range(size):
            value += rows[c, start + r] * state[r]
            norm += state[r] * state[r]
        if k < SERIES_TERMS:
            value = abs(value)
        else:
            value = weight * math.sqrt(norm) * rest
        if k <= SERIES_TERMS:
            level += value * term
        if 2 <= k <= SERIES_TERMS + 2:
            term_second = 1.0 if k == 2 else term_second * horizon / (k - 2)
            second += value * term_second
        if 3 <= k:
            term_third = 1.0 if k == 3 else term_third * horizon / (k - 3)
            third += value * term_third
        term *= horizon / (k + 1)
        for r in range(size):
            other[r] = 0.0
            for q in range(size):
                other[r] += matrix[start + r, start + q] * state[q]
        state, other = other, state
    return level, second, third


@kernel
def amplitudes(flight, rows, c, z, horizon):
    """Bounds of |f|, |f''| and |f'''| for f(t) = rows[c] . exp(B t) z over 0 <= t <= horizon."""
    pairs, mean, delta, matrix = flight
    level = 0.0
    second = 0.0
    third = 0.0
    for k in range(pairs.shape[0]):
        i = pairs[k, 0]
        j = pairs[k, 1]
        m = mean[k]
        # A single rate: f = a exp(m t).
        if j == -1:
            size = abs(rows[c, i] * z[i]) * (math.exp(m * horizon) if m > 0.0 else 1.0)
            level += size
            second += m * m * size
            third += abs(m * m * m) * size
        elif j >= 0:
            # f = exp(m t) (C alpha + S beta); a derivative takes (alpha, beta) to (m alpha + beta, m beta + delta alpha)
            alpha = rows[c, i] * z[i] + rows[c, j] * z[j]
            beta = rows[c, i] * ((matrix[i, i] - m) * z[i] + matrix[i, j] * z[j])
            beta += rows[c, j] * (matrix[j, i] * z[i] + (matrix[j, j] - m) * z[j])
            # Equation (24) for an undamped mode.
            if m == 0.0 and delta[k] < 0.0:
                size = math.sqrt(alpha * alpha - beta * beta / delta[k])
                level += size
                second -= delta[k] * size
                third += -delta[k] * math.sqrt(-delta[k]) * size
                continue
            # A damped pair: both terms of (23) by their largest values over the flight.
            cosine, sine = pair_envelope(m, delta[k], horizon)
            for order in range(4):
                size = 0.0
                if alpha != 0.0:
                    size += abs(alpha) * cosine
                if beta != 0.0:
                    size += abs(beta) * sine
                if delta[k] < 0.0:
                    size = min(
                        size, math.sqrt(alpha * alpha - beta * beta / delta[k]) * (math.exp(m * horizon) if m > 0.0 else 1.0)
                    )
                if order == 0:
                    level += size
                elif order == 2:
                    second += size
                elif order == 3:
                    third += size
                alpha, beta = m * alpha + beta, m * beta + delta[k] * alpha
        else:
            # A larger block: |exp(B t)| <= exp(growth t), or its Taylor series with remainder, whichever is less.
            growth = block_growth(matrix, i, -j)
            size = math.exp(growth * horizon) if growth > 0.0 else 1.0
            weight = 0.0
            norm = 0.0
            square = 0.0
            for r in range(i, i - j):
                weight += rows[c, r] * rows[c, r]
                norm += z[r] * z[r]
                for q in range(i, i - j):
                    square += matrix[r, q] * matrix[r, q]
            size *= math.sqrt(weight * norm)
            near, near_second, near_third = size, square * size, square * math.sqrt(square) * size
            if weight > 0.0 and horizon < math.inf:
                series = block_amplitudes(matrix, i, -j, rows, c, z, math.sqrt(weight), growth, horizon)
                near, near_second, near_third = min(near, series[0]), min(near_second, series[1]), min(near_third, series[2])
            level += near
            second += near_second
            third += near_third
    return level * MARGIN, second * MARGIN, third * MARGIN


@kernel
def pair_envelope(mean, delta, horizon):
    """Bounds of exp(m t) |C| and exp(m t) |S| over 0 <= t <= horizon (which may be infinite for a stable pair)."""
    width = math.sqrt(delta) if delta > 0.0 else 0.0
    slowest = mean + width
    c = math.exp(slowest * horizon) if slowest > 0.0 else 1.0
    s = horizon * c
    if slowest < 0.0:
        s = min(s, INVERSE_E / -slowest)
    if width > 0.0:
        s = min(s, 0.5 * c / width)
    if delta < 0.0:
        s = min(s, c / math.sqrt(-delta))
    return c, s


@kernel
def free_step(d, slope, second_bound):
    """2 d/(-d' + sqrt(d'^2 + 2 W d)), in the form that does not cancel; infinite where d never returns to 0."""
    # Equation (3): its positive zero.
    if slope < 0.0:
        return 2.0 * d / (-slope + math.sqrt(slope * slope + 2.0 * second_bound * d))
    if second_bound <= 0.0:
        return math.inf
    return (slope + math.sqrt(slope * slope + 2.0 * second_bound * d)) / second_bound


NEAR_TERMS = 14
NEAR_REACH = 0.25
"""|B| t up to which the series from the start is used: its 14 terms truncate below 1e-19."""


@kernel
def series(flight, contacts, c, z, coefficients, state, other):
    """coefficients[k] = d^(k)(0)/k! for k >= 1 by repeated B. Returns a rate that bounds how fast the terms can grow."""
    for r in range(z.shape[0]):
        state[r] = z[r]
    factor = 1.0
    for k in range(1, NEAR_TERMS + 1):
        block_product(flight.pairs, flight.matrix, state, other)
        factor /= k
        coefficients[k] = -contacts.side[c] * row_dot(contacts.gap, c, other) * factor
        for r in range(z.shape[0]):
            state[r] = other[r]
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
