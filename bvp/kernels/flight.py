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

Then there are short loops over arrays, element by element. Assignments to slices compile tens of times slower. At the end there are
bounds of a linear functional f(t) = row . exp(B t) z and of its derivatives over a flight, and a step that cannot pass a root.
"""

import math
from typing import NamedTuple

import numpy as np

from bvp.kernels.compiled import allocating, inlined, kernel, shared

SERIES_LIMIT = 0.03
"""|delta t^2| below which the Taylor series (seven terms, truncation below 1e-19) replaces the closed form."""

APART_LIMIT = 1.0
"""delta t^2 above which the two rates of an overdamped pair are taken apart."""

ROUNDING = 16.0 * 2.220446049250313e-16
"""Sixteen rounding errors."""

TAYLOR_TERMS = 18
"""Degree of the Taylor polynomial of a larger block at a norm of 1/2: truncation below 1e-22."""

MARGIN = 1.0 + 1e-9
"""Bounds are widened by this, far more than their own rounding."""

SERIES_TERMS = 8
"""Terms of the series that bounds the motion of a larger block: its steps are at most its own time of growth."""

INVERSE_E = 0.36787944117144233
"""Maximum of x exp(-x)."""


class Flight(NamedTuple):
    """B of free flight in blocks, in the layout above.

    This is the seam between flights and what uses them: state and time -> end state (`flow_state`), its derivative by the state
    (`flow_matrix`) and by time (`block_product` with B), and a bound of |w''| for each gap (`amplitudes`). Loads and the gaps of sticking
    stops are states of their own (`bvp.contact_modes`), so a derivative by their size is one by the state. Another kind of flight provides
    the same."""

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


@inlined
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


@inlined
def real_rates(mean, delta, determinant):
    """The rates m +- sqrt(delta) of a pair, the faster one first; the slow one is determinant over fast one."""
    fast = mean + (math.sqrt(delta) if mean > 0.0 else -math.sqrt(delta))
    return fast, determinant / fast


@inlined
def damped(mean, delta, determinant, t):
    """exp(m t) C and exp(m t) S of a pair with the rates m +- sqrt(delta), whose product is `determinant`."""
    # Equation (23) with the two real rates apart.
    if mean != 0.0 and delta * t * t > APART_LIMIT:
        fast, slow = real_rates(mean, delta, determinant)
        far = math.exp(fast * t)
        near = math.exp(slow * t)
        return 0.5 * (far + near), (far - near) / (fast - slow)
    c, s = circular(delta, t)
    e = 1.0 if mean == 0.0 else math.exp(mean * t)
    return c * e, s * e


@inlined
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
    if mean != 0.0 and delta * t * t > APART_LIMIT:
        # What is left of the slow motion has its own rounding, however small it is beside the fast one.
        fast, slow = real_rates(mean, delta, b11 * b22 - b12 * b21)
        far = math.exp(fast * t) / (fast - slow)
        near = math.exp(slow * t) / (fast - slow)
        return (
            far * (b11 - slow) + near * (b22 - slow), (far - near) * b12, (far - near) * b21, far * (b22 - slow) + near * (b11 - slow)
        )
    c, s = damped(mean, delta, b11 * b22 - b12 * b21, t)
    return c + s * (b11 - mean), s * b12, s * b21, c + s * (b22 - mean)


@allocating
def flow_block(matrix, start, size, t):
    """exp(B t) of the block of `size` indices from `start`, (size, size): Taylor's series, scaled and squared."""
    norm = 0.0
    for r in range(size):
        row = 0.0
        for c in range(size):
            row += abs(matrix[start + r, start + c])
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
    # Horner's scheme for the Taylor series of exp(B t/2^halvings). A load's own entries stay exact, and no part of the block overflows.
    for k in range(TAYLOR_TERMS, 0, -1):
        for r in range(size):
            for c in range(size):
                entry = 0.0
                for q in range(size):
                    entry += matrix[start + r, start + q] * total[q, c]
                product[r, c] = entry * step / k + (1.0 if r == c else 0.0)
        total, product = product, total
    # exp(2 X) = exp(X)^2.
    for _ in range(halvings):
        for r in range(size):
            for c in range(size):
                product[r, c] = inner(total[r], total[:, c])
        total, product = product, total
    return total


@shared("none", allocates=True)
def block_matrix(matrix, start, size, t, out):
    """The block of `size` indices from `start` of out = exp(B t)."""
    block = flow_block(matrix, start, size, t)
    for r in range(size):
        copy_1(block[r], out[start + r, start : start + size])


@shared("none", allocates=True)
def block_state(matrix, start, size, t, z, out):
    """The `size` entries from `start` of out = exp(B t) z."""
    block = flow_block(matrix, start, size, t)
    for r in range(size):
        out[start + r] = row_dot(block, r, z[start : start + size])


@inlined
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
            block_state(matrix, i, -j, t, z, out)


@kernel
def flow_state(flight, z, t, out):
    """out = exp(B t) z."""
    flow_inside(flight, z, t, out)


@inlined
def flow_matrix(flight, t, out):
    """out = exp(B t), dense (N, N)."""
    pairs, mean, delta, matrix = flight
    set_2(out, 0.0)
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
            block_matrix(matrix, i, -j, t, out)


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
                out[r] = inner(matrix[r, i : i - j], z[i : i - j])


@kernel
def flight_at(begins, time):
    """Index of the flight at a given time: the last one that has begun. begins (F,): ascending times."""
    return max(np.searchsorted(begins, time, side="right") - 1, 0)


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
def copy_1(array, out):
    """out (n,) = array."""
    for i in range(out.shape[0]):
        out[i] = array[i]


@kernel
def row_dot(rows, c, z):
    """rows[c] . z, without the cost of making a view."""
    total = 0.0
    for r in range(z.shape[0]):
        total += rows[c, r] * z[r]
    return total


@kernel
def times_matrix(matrix, x, out):
    """out = matrix x."""
    for r in range(matrix.shape[0]):
        out[r] = row_dot(matrix, r, x[: matrix.shape[1]])


@kernel
def inner(a, b):
    """a . b"""
    total = 0.0
    for r in range(a.shape[0]):
        total += a[r] * b[r]
    return total


@inlined
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
            elif mean[k] < 0.0 < delta[k]:
                growth = max(growth, real_rates(mean[k], delta[k], matrix[i, i] * matrix[j, j] - matrix[i, j] * matrix[j, i])[1])
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
    pairs, matrix = flight.pairs, flight.matrix
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
def block_amplitudes(matrix, start, size, row, z, weight, growth, horizon):
    """The bounds of `amplitudes` for the block of `size` indices from `start`, by Taylor's series with its remainder. `weight`: norm of the
    row's part.

    The series of a translation under constant forces ends after a few terms, so these bounds stay sharp for any distance."""
    state = np.empty(size)
    other = np.empty(size)
    copy_1(z[start : start + size], state)
    level = 0.0
    second = 0.0
    third = 0.0
    rest = math.exp(growth * horizon) if growth > 0.0 else 1.0
    term, term_second, term_third = 1.0, 0.0, 0.0
    for k in range(SERIES_TERMS + 4):
        value = 0.0
        norm = 0.0
        for r in range(size):
            value += row[start + r] * state[r]
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
            other[r] = inner(matrix[start + r, start : start + size], state)
        state, other = other, state
    return level, second, third


@shared(("float", "float", "float"))
def amplitudes(flight, row, z, horizon):
    """Bounds of |f|, |f''| and |f'''| for f(t) = row . exp(B t) z over 0 <= t <= horizon."""
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
            size = abs(row[i] * z[i]) * (math.exp(m * horizon) if m > 0.0 else 1.0)
            level += size
            second += m * m * size
            third += abs(m * m * m) * size
        elif j >= 0:
            # f = exp(m t) (C alpha + S beta); a derivative takes (alpha, beta) to (m alpha + beta, m beta + delta alpha)
            alpha = row[i] * z[i] + row[j] * z[j]
            beta = row[i] * ((matrix[i, i] - m) * z[i] + matrix[i, j] * z[j])
            beta += row[j] * (matrix[j, i] * z[i] + (matrix[j, j] - m) * z[j])
            # Equation (24) for an undamped mode.
            if m == 0.0 and delta[k] < 0.0:
                size = math.sqrt(alpha * alpha - beta * beta / delta[k])
                level += size
                second -= delta[k] * size
                third += -delta[k] * math.sqrt(-delta[k]) * size
                continue
            if m < 0.0 and delta[k] > 0.5 * m * m and delta[k] * horizon * horizon > APART_LIMIT:
                # Two real rates: f = far exp(fast t) + near exp(slow t). A fast part that is rounding does not move f, but it is in the
                # computed f''.
                fast, slow = real_rates(m, delta[k], matrix[i, i] * matrix[j, j] - matrix[i, j] * matrix[j, i])
                a, b = row[i] * (matrix[i, i] - slow) * z[i], row[i] * matrix[i, j] * z[j]
                d, e = row[j] * matrix[j, i] * z[i], row[j] * (matrix[j, j] - slow) * z[j]
                far = (a + b + d + e) / (fast - slow)
                noise = ROUNDING * (abs(a) + abs(b) + abs(d) + abs(e)) / (slow - fast)
                near = abs(alpha - far) * (math.exp(slow * horizon) if slow > 0.0 else 1.0)
                size = abs(far) if abs(far) > noise else 0.0
                level += size + near
                second += fast * fast * size + slow * slow * near
                third += abs(fast * fast * fast) * max(size, noise) + abs(slow * slow * slow) * near
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
                weight += row[r] * row[r]
                norm += z[r] * z[r]
                for q in range(i, i - j):
                    square += matrix[r, q] * matrix[r, q]
            size *= math.sqrt(weight * norm)
            near, near_second, near_third = size, square * size, square * math.sqrt(square) * size
            if weight > 0.0 and horizon < math.inf:
                series = block_amplitudes(matrix, i, -j, row, z, math.sqrt(weight), growth, horizon)
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
