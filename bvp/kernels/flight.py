"""Exact free flight, equations (2) and (23): the exponential of a block-diagonal first-order matrix, block by block.

The state of a flight is z in R^N with z' = B z. B couples indices only within blocks, found once by `bvp.modes`. For a pair,
B = m I + D with D traceless, so D^2 = delta I and

    exp(B t) = exp(m t) (C I + S D),   C = cosh(sqrt(delta) t),   S = sinh(sqrt(delta) t) / sqrt(delta)

where both are entire functions of delta t^2: trigonometric for delta < 0, hyperbolic for delta > 0, and a series about
delta t^2 = 0 (rigid-body modes, critical damping), so nothing cancels and nothing divides by zero. Where a pair is strongly
overdamped its two rates are taken apart, the slow one as determinant over fast one, so nothing overflows. Blocks larger than a
pair exist only where `bvp.blocks` could not cut them; their exponential is Taylor's, scaled and squared.

Layout of the arrays, shared by all kernels
    pairs  (P, 2) int64    (i, j): indices of a pair; (i, -1): the index i alone; (i, -s): the s >= 3 indices i .. i + s - 1
    mean   (P,)   float64  m, half the trace of a pair, the trace over s of a block of s
    delta  (P,)   float64  delta, in 1/time^2 (0 for a block that is no pair)
    matrix (N, N) float64  B, zero outside the blocks

At the end there are short loops over arrays, element by element. Assignments to slices compile tens of times slower.
"""

import math
from typing import NamedTuple

import numpy as np

from bvp.kernels.compiled import allocating, inlined, kernel, part

SERIES_LIMIT = 0.03
"""|delta t^2| below which the Taylor series (seven terms, truncation below 1e-19) replaces the closed form."""

APART_LIMIT = 1.0
"""delta t^2 above which the two rates of an overdamped pair are taken apart."""

TAYLOR_TERMS = 18
"""Degree of the Taylor polynomial of a larger block at a norm of 1/2: truncation below 1e-22."""


class Flight(NamedTuple):
    """B of free flight in blocks, in the layout above.

    This is the seam between flights and what uses them: state and time -> end state (`flow_state`), its derivative by the state
    (`flow_matrix`) and by time (`block_product` with B), and a bound of |w''| for each gap (`bvp.kernels.bounds.amplitudes`). Loads and
    the gaps of sticking stops are states of their own (`bvp.contact_modes`), so a derivative by their size is one by the state. Another
    kind of flight provides the same.
    """

    pairs: np.ndarray  # (P, 2) int64
    mean: np.ndarray  # (P,)
    delta: np.ndarray  # (P,)
    matrix: np.ndarray  # (N, N)


class Contacts(NamedTuple):
    """Rows of m contacts: w = gap . z, w' = rate . z, w'' = acceleration . z; z+ = z - (1 + r) push (rate . z) at an impact."""

    gap: np.ndarray  # (m, N)
    rate: np.ndarray  # (m, N)
    acceleration: np.ndarray  # (m, N)
    side: np.ndarray  # (m,) +1 upper, -1 lower
    bound: np.ndarray  # (m,)
    push: np.ndarray  # (m, N)
    restitution: np.ndarray  # (m,)


@part
def circular(delta, t):
    """C = cosh(sqrt(delta) t) and S = sinh(sqrt(delta) t)/sqrt(delta), continued through delta <= 0."""
    # C and S of equation (23).
    x = delta * t * t
    if abs(x) < SERIES_LIMIT:
        c = 1.0 + x / 2.0 * (1.0 + x / 12.0 * (1.0 + x / 30.0 * (1.0 + x / 56.0 * (1.0 + x / 90.0 * (1.0 + x / 132.0)))))
        s = t * (1.0 + x / 6.0 * (1.0 + x / 20.0 * (1.0 + x / 42.0 * (1.0 + x / 72.0 * (1.0 + x / 110.0 * (1.0 + x / 156.0))))))
        return c, s
    if x < 0.0:
        w = math.sqrt(-delta)
        return math.cos(w * t), math.sin(w * t) / w
    w = math.sqrt(delta)
    return math.cosh(w * t), math.sinh(w * t) / w


@part
def flow_pair(mean, delta, b11, b12, b21, b22, t):
    """The four entries of exp(B t) for one 2 x 2 block.

    If the block oscillates, b21 is replaced by the value that belongs to the rounded frequency. Rounding errors of the determinant, and
    so of the energy, then have either sign and do not accumulate over many flights."""
    # Equation (23) for an oscillating pair. b21 follows from the rounded frequency.
    if delta < 0.0:
        w = math.sqrt(-delta)
        c, s = circular(-1.0, w * t)
        s /= w
        if mean != 0.0:
            e = math.exp(mean * t)
            c *= e
            s *= e
        half = 0.5 * (b11 - b22)
        return c + s * half, s * b12, -(w * (w * s) + half * (half * s)) / b12, c - s * half
    # Equation (23) with the two real rates apart: the slow one is determinant over fast one.
    if mean != 0.0 and delta * t * t > APART_LIMIT:
        w = math.sqrt(delta) if mean > 0.0 else -math.sqrt(delta)
        fast = mean + w
        far = math.exp(fast * t)
        near = math.exp((b11 * b22 - b12 * b21) / fast * t)
        c = 0.5 * (far + near)
        s = 0.5 * (far - near) / w
    else:
        c, s = circular(delta, t)
        e = 1.0 if mean == 0.0 else math.exp(mean * t)
        c *= e
        s *= e
    return c + s * (b11 - mean), s * b12, s * b21, c + s * (b22 - mean)


@allocating
def flow_block(mean, matrix, start, size, t):
    """exp(B t) of the block of `size` indices from `start`, (size, size): Taylor's series about the mean, scaled and
    squared."""
    norm = 0.0
    for r in range(size):
        row = 0.0
        for c in range(size):
            row += abs(matrix[start + r, start + c] - (mean if r == c else 0.0))
        norm = max(norm, row)
    norm *= abs(t)
    halvings = 0
    while norm > 0.5 and halvings < 1024:
        norm *= 0.5
        halvings += 1
    step = t * 0.5**halvings
    total = np.empty((size, size))
    product = np.empty((size, size))
    for r in range(size):
        for c in range(size):
            total[r, c] = 1.0 if r == c else 0.0
    # Horner's scheme for the Taylor series of exp((B - m) t/2^halvings).
    for k in range(TAYLOR_TERMS, 0, -1):
        for r in range(size):
            for c in range(size):
                entry = 0.0
                for q in range(size):
                    entry += (matrix[start + r, start + q] - (mean if r == q else 0.0)) * total[q, c]
                product[r, c] = entry * step / k + (1.0 if r == c else 0.0)
        total, product = product, total
    # exp(2 X) = exp(X)^2.
    for _ in range(halvings):
        for r in range(size):
            for c in range(size):
                entry = 0.0
                for q in range(size):
                    entry += total[r, q] * total[q, c]
                product[r, c] = entry
        total, product = product, total
    factor = math.exp(mean * t)
    for r in range(size):
        for c in range(size):
            total[r, c] *= factor
    return total


@allocating
def block_matrix(mean, matrix, start, size, t, out):
    """The block of `size` indices from `start` of out = exp(B t)."""
    block = flow_block(mean, matrix, start, size, t)
    for r in range(size):
        for c in range(size):
            out[start + r, start + c] = block[r, c]


@allocating
def block_state(mean, matrix, start, size, t, z, out):
    """The `size` entries from `start` of out = exp(B t) z."""
    block = flow_block(mean, matrix, start, size, t)
    for r in range(size):
        total = 0.0
        for c in range(size):
            total += block[r, c] * z[start + c]
        out[start + r] = total


@part
def flow_inside(flight, z, t, out):
    """`flow_state`, compiled into the loop that calls it: passing so many arrays to a function takes as long as the flight itself."""
    pairs, mean, delta, matrix = flight
    # Equation (23) for each block, times the state; equation (2) where nothing damps.
    for k in range(pairs.shape[0]):
        i = pairs[k, 0]
        j = pairs[k, 1]
        if j >= 0:
            e11, e12, e21, e22 = flow_pair(mean[k], delta[k], matrix[i, i], matrix[i, j], matrix[j, i], matrix[j, j], t)
            a = z[i]
            b = z[j]
            out[i] = e11 * a + e12 * b
            out[j] = e21 * a + e22 * b
        elif j == -1:
            out[i] = math.exp(mean[k] * t) * z[i]
        else:
            block_state(mean[k], matrix, i, -j, t, z, out)


@kernel
def flow_state(flight, z, t, out):
    """out = exp(B t) z."""
    flow_inside(flight, z, t, out)


@inlined
def flow_matrix(flight, t, out):
    """out = exp(B t), dense (N, N)."""
    pairs, mean, delta, matrix = flight
    size = out.shape[1]
    for r in range(size):
        for c in range(size):
            out[r, c] = 0.0
    # Equation (23) for each block.
    for k in range(pairs.shape[0]):
        i = pairs[k, 0]
        j = pairs[k, 1]
        if j >= 0:
            e11, e12, e21, e22 = flow_pair(mean[k], delta[k], matrix[i, i], matrix[i, j], matrix[j, i], matrix[j, j], t)
            out[i, i] = e11
            out[i, j] = e12
            out[j, i] = e21
            out[j, j] = e22
        elif j == -1:
            out[i, i] = math.exp(mean[k] * t)
        else:
            block_matrix(mean[k], matrix, i, -j, t, out)


@inlined
def block_product(pairs, matrix, z, out):
    """out = matrix z for a matrix that is zero outside the blocks: B itself, or exp(B t) of `flow_matrix`. `out` and z must differ."""
    for k in range(pairs.shape[0]):
        i = pairs[k, 0]
        j = pairs[k, 1]
        if j >= 0:
            a = z[i]
            b = z[j]
            out[i] = matrix[i, i] * a + matrix[i, j] * b
            out[j] = matrix[j, i] * a + matrix[j, j] * b
        elif j == -1:
            out[i] = matrix[i, i] * z[i]
        else:
            for r in range(i, i - j):
                total = 0.0
                for c in range(i, i - j):
                    total += matrix[r, c] * z[c]
                out[r] = total


@kernel
def flight_at(begins, time):
    """Index of the flight at a given time: the last one that has begun. begins (F,): ascending times."""
    low = 0
    high = begins.shape[0]
    while high - low > 1:
        middle = (low + high) // 2
        if begins[middle] <= time:
            low = middle
        else:
            high = middle
    return low


@kernel
def sample_flights(flight, begins, states, times, out):
    """out[i] = state at times[i] of flights of one system that begin at begins (F,) with states (F, N), as in `flight_at`."""
    for i in range(times.shape[0]):
        k = flight_at(begins, times[i])
        flow_state(flight, states[k], times[i] - begins[k], out[i])


@kernel
def set_1(array, value):
    """array (n,) = value."""
    for i in range(array.shape[0]):
        array[i] = value


@kernel
def set_2(array, value):
    """array (m, n) = value."""
    for i in range(array.shape[0]):
        for j in range(array.shape[1]):
            array[i, j] = value


@kernel
def inner(a, b):
    """a . b"""
    total = 0.0
    for r in range(a.shape[0]):
        total += a[r] * b[r]
    return total


@kernel
def row_dot(rows, c, z):
    """rows[c] . z, without the cost of making a view."""
    total = 0.0
    for r in range(z.shape[0]):
        total += rows[c, r] * z[r]
    return total
