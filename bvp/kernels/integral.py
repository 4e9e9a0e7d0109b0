"""Exact integrals of products along a flight: sum over R products of weight (a . z(s)) (b . z(s)), integrated over 0 <= s <= t.

Where every block that takes part turns or decays at rates that differ - pairs that oscillate, pairs whose two real rates are apart, single
rates, loads that are constant - a . z is a sum of exponentials, and the integral of each product is

    (exp(x t) - 1)/x,   x a sum of two rates,

from the exponentials themselves, and from a series where |x t| is small, so nothing cancels. Everything else (near critical damping, rigid
bodies, loads joined with a block, ramps) is the product of two Taylor series, over stretches on which these converge; where there would be
many stretches, the integral of the matrix exp(B's) a b' exp(B s) is doubled, P(2 t) = P(t) + exp(B't) P(t) exp(B t) (Van Loan, IEEE Trans.
Automat. Control 23 (1978) 395, without its inverse): each sum is of terms of one sign where a = b.
"""

import math

import numpy as np

from bvp.kernels.arrays import dot
from bvp.kernels.bounds import fastest_rate
from bvp.kernels.compiled import allocating, kernel
from bvp.kernels.flight import block_product, flow_matrix, flow_state

TERMS = 19
"""Taylor terms on a stretch with a rate times time of 1 at most: truncation below 1e-17."""

STRETCHES = 24
"""Stretches above which the doubled matrix is cheaper."""

SMALL = 0.1
"""|x t| below which (exp(x t) - 1)/(x t) is a series."""

SERIES = 9
RECIPROCAL = tuple(1.0 / k for k in range(2, 64))
"""1/2, 1/3, ..."""

LOST = 4.0
"""Size of the two exponentials of a pair, in the largest value of their sum over the flight, up to which they are taken apart: the square
of it is the digits that a product can lose."""

ROWS = 8


def integral_work(size, products):
    """Scratch array of `integrals` for N = `size` states."""
    return np.zeros((ROWS + 2 * products, max(2 * size, TERMS + 1)))


@kernel
def mean_exponential(real, imaginary, end_real, end_imaginary, t):
    """Integral of exp((real + i imaginary) s) over 0 <= s <= t, given its value at the end."""
    x = real * t
    y = imaginary * t
    if abs(x) + abs(y) > SMALL:
        below = real * real + imaginary * imaginary
        a = end_real - 1.0
        return (a * real + end_imaginary * imaginary) / below, (end_imaginary * real - a * imaginary) / below
    total = 1.0
    other = 0.0
    for k in range(SERIES - 1, -1, -1):
        product = (total * x - other * y) * RECIPROCAL[k]
        other = (total * y + other * x) * RECIPROCAL[k]
        total = product + 1.0
    return total * t, other * t


@kernel
def rates(flight, t, work):
    """Rates of the two exponentials of each block and their values at t, into rows 0-3 of work (real, imaginary, value); larger blocks
    have none."""
    pairs, mean, delta, matrix = flight
    for k in range(pairs.shape[0]):
        i = pairs[k, 0]
        j = pairs[k, 1]
        m = mean[k]
        for slot in (2 * k, 2 * k + 1):
            work[0, slot] = m
            work[1, slot] = 0.0
            work[2, slot] = 1.0
            work[3, slot] = 0.0
        if j >= 0 and delta[k] < 0.0:
            w = math.sqrt(-delta[k])
            e = math.exp(m * t) if m != 0.0 else 1.0
            work[1, 2 * k] = w
            work[2, 2 * k] = e * math.cos(w * t)
            work[3, 2 * k] = e * math.sin(w * t)
        elif j >= 0 and delta[k] > 0.0:
            w = math.sqrt(delta[k]) if m > 0.0 else -math.sqrt(delta[k])
            near = (matrix[i, i] * matrix[j, j] - matrix[i, j] * matrix[j, i]) / (m + w)
            work[0, 2 * k] = m + w
            work[2, 2 * k] = math.exp((m + w) * t)
            work[0, 2 * k + 1] = near
            work[2, 2 * k + 1] = math.exp(near * t)
        elif m != 0.0:
            work[2, 2 * k] = math.exp(m * t)


@kernel
def weights(flight, rows, c, z, t, work, at):
    """Complex weights of the exponentials in rows[c] . z(s), into rows at and at + 1 of work; False where they would cancel or do not
    exist."""
    pairs, mean, delta, matrix = flight
    for k in range(pairs.shape[0]):
        i = pairs[k, 0]
        j = pairs[k, 1]
        for slot in (2 * k, 2 * k + 1):
            work[at, slot] = 0.0
            work[at + 1, slot] = 0.0
        if j == -1:
            work[at, 2 * k] = rows[c, i] * z[i]
        elif j >= 0:
            m = mean[k]
            alpha = rows[c, i] * z[i] + rows[c, j] * z[j]
            beta = rows[c, i] * ((matrix[i, i] - m) * z[i] + matrix[i, j] * z[j])
            beta += rows[c, j] * (matrix[j, i] * z[i] + (matrix[j, j] - m) * z[j])
            if alpha == 0.0 and beta == 0.0:
                continue
            if delta[k] == 0.0 and beta == 0.0:
                work[at, 2 * k] = alpha
                continue
            w = math.sqrt(abs(delta[k]))
            lasting = min(t, 1.0 / abs(m))
            if abs(beta) > LOST * w * max(abs(alpha), abs(beta) * lasting):
                return False
            if delta[k] < 0.0:
                work[at, 2 * k] = alpha
                work[at + 1, 2 * k] = -beta / w
            else:
                if m <= 0.0:
                    w = -w
                work[at, 2 * k] = 0.5 * (alpha + beta / w)
                work[at, 2 * k + 1] = 0.5 * (alpha - beta / w)
        else:
            for r in range(i, i - j):
                if rows[c, r] != 0.0:
                    return False
    return True


@kernel
def product_integral(slots, work, first, second, t):
    """Integral of the product of two sums of exponentials whose weights stand in rows `first` and `second` (and the next ones)."""
    total = 0.0
    for k in range(slots):
        if work[first, k] == 0.0 and work[first + 1, k] == 0.0:
            continue
        for q in range(k if first == second else 0, slots):
            if work[second, q] == 0.0 and work[second + 1, q] == 0.0:
                continue
            part = 0.0
            for sign in (1.0, -1.0):
                weight = work[first, k] * work[second, q] - sign * work[first + 1, k] * work[second + 1, q]
                turned = sign * work[first, k] * work[second + 1, q] + work[first + 1, k] * work[second, q]
                end = work[2, k] * work[2, q] - sign * work[3, k] * work[3, q]
                end_turned = sign * work[2, k] * work[3, q] + work[3, k] * work[2, q]
                real, imaginary = mean_exponential(
                    work[0, k] + work[0, q], work[1, k] + sign * work[1, q], end, end_turned, t
                )
                part += weight * real - turned * imaginary
            total += part if first == second and q > k else 0.5 * part
    return total


@kernel
def terms_of(x):
    """Taylor terms whose rest is below 1e-17 of the first for a rate times time of x <= 1: x^k/k! falls below."""
    size = 1.0
    terms = 1
    while size > 1e-17 and terms < TERMS:
        size *= x * RECIPROCAL[terms - 1]
        terms += 1
    return terms


@kernel
def series_integrals(flight, first, second, weight, z, t, fastest, stretches, work, out):
    """out += the integrals, stretch by stretch, by Taylor series."""
    pairs, _, _, matrix = flight
    size = z.shape[0]
    h = t / stretches
    state = work[4, :size]
    term = work[5, :size]
    other = work[6, :size]
    terms = terms_of(fastest * h)
    for r in range(size):
        state[r] = z[r]
    for stretch in range(stretches):
        for r in range(size):
            term[r] = state[r]
        for k in range(terms + 1):
            for c in range(first.shape[0]):
                work[ROWS + 2 * c, k] = dot(first, c, term)
                work[ROWS + 2 * c + 1, k] = dot(second, c, term)
            block_product(pairs, matrix, term, other)
            factor = h if k == 0 else h * RECIPROCAL[k - 1]
            for r in range(size):
                term[r] = other[r] * factor
        for c in range(first.shape[0]):
            a = ROWS + 2 * c
            total = 0.0
            for order in range(2 * terms, 0, -1):
                part = 0.0
                for k in range(max(0, order - terms), min(order, terms) + 1):
                    part += work[a, k] * work[a + 1, order - k]
                total += part * RECIPROCAL[order - 1]
            out[c] += weight[c] * (total + work[a, 0] * work[a + 1, 0]) * h
        if stretch + 1 < stretches:
            flow_state(flight, state, h, other)
            for r in range(size):
                state[r] = other[r]


@allocating
def doubled_integrals(flight, first, second, weight, z, t, fastest, out):
    """out += the integrals, by doubling."""
    matrix = flight.matrix
    size = z.shape[0]
    doublings = 0
    h = t
    while fastest * h > 1.0 and doublings < 1100:
        h *= 0.5
        doublings += 1
    flow = np.empty((size, size))
    half = np.empty((size, size))
    grown = np.empty((size, size))
    a = np.empty((TERMS + 1, size))
    b = np.empty((TERMS + 1, size))
    for c in range(first.shape[0]):
        for r in range(size):
            a[0, r] = first[c, r]
            b[0, r] = second[c, r]
        for k in range(1, TERMS + 1):
            for r in range(size):
                left = 0.0
                right = 0.0
                for q in range(size):
                    left += a[k - 1, q] * matrix[q, r]
                    right += b[k - 1, q] * matrix[q, r]
                a[k, r] = left * h / k
                b[k, r] = right * h / k
        for r in range(size):
            for q in range(size):
                entry = 0.0
                for k in range(TERMS, -1, -1):
                    for j in range(TERMS, -1, -1):
                        entry += a[k, r] * b[j, q] / (k + j + 1)
                half[r, q] = entry * h
        span = h
        for _ in range(doublings):
            flow_matrix(flight, span, flow)
            for r in range(size):
                for q in range(size):
                    entry = 0.0
                    for k in range(size):
                        entry += half[r, k] * flow[k, q]
                    grown[r, q] = entry
            for r in range(size):
                for q in range(size):
                    a[0, q] = 0.0
                    for k in range(size):
                        a[0, q] += flow[k, r] * grown[k, q]
                for q in range(size):
                    half[r, q] += a[0, q]
            span *= 2.0
        total = 0.0
        for r in range(size):
            for q in range(size):
                total += z[r] * half[r, q] * z[q]
        out[c] += weight[c] * total


@kernel
def integrals(flight, first, second, weight, z, t, work, out):
    """out (R,) = weight times the integral of (first . z(s)) (second . z(s)) over 0 <= s <= t. `work` comes from `integral_work`."""
    pairs = flight.pairs
    products = first.shape[0]
    for c in range(products):
        out[c] = 0.0
    if products == 0 or t == 0.0:
        return
    apart = True
    for c in range(products):
        at = ROWS
        apart = weights(flight, second, c, z, t, work, 4)
        if apart:
            apart = weights(flight, first, c, z, t, work, at)
        if not apart:
            break
        if c == 0:
            rates(flight, t, work)
        same = True
        for k in range(2 * pairs.shape[0]):
            same = same and work[4, k] == work[at, k] and work[5, k] == work[at + 1, k]
        out[c] = weight[c] * product_integral(2 * pairs.shape[0], work, 4, 4 if same else at, t)
    if apart:
        return
    for c in range(products):
        out[c] = 0.0
    fastest = fastest_rate(flight)
    if fastest * t <= STRETCHES:
        series_integrals(flight, first, second, weight, z, t, fastest, int(fastest * t) + 1, work, out)
    else:
        doubled_integrals(flight, first, second, weight, z, t, fastest, out)
