"""Matrices with all their derivatives of first and second order by m parameters: as `bvp.nilpotent`.

A matrix (p, q) has G = 1 + m + m (m + 1)/2 coefficients: the value, the derivatives by each parameter, and those by the pairs j <= k. They
stand side by side in an array f (p, G q): coefficient g is f[:, g q : (g + 1) q].
"""

import math

from bvp.kernels.compiled import inlined, kernel
from bvp.kernels.flight import copy_1, set_1

CONVERGENCE = 0.45
"""Norm up to which a Taylor polynomial of degree 15 is the exponential to rounding, and so are its second derivatives."""

MOST_SQUARINGS = 60

COEFFICIENTS = tuple(1.0 / math.factorial(k) for k in range(16))


@inlined
def place_of(count, j, k):
    """The coefficient of the second derivative by parameters j and k of m = `count`."""
    first, last = min(j, k), max(j, k)
    return 1 + count + first * count - first * (first - 1) // 2 + last - first


@inlined
def coefficients(count):
    """G for m = `count` parameters."""
    return 1 + count + count * (count + 1) // 2


@kernel
def _add_row(value, row, start, out, at, length):
    """out[at : at + length] += value row[start : start + length]"""
    for c in range(length):
        out[at + c] += value * row[start + c]


@kernel
def multiply(count, f, g, corner, out):
    """out = f g for m = `count` parameters. Where both have zeros below row `corner` in the columns before it, `corner` says so; else it is
    their size."""
    parts = coefficients(count)
    inner, q = f.shape[1] // parts, g.shape[1] // parts
    for r in range(f.shape[0]):
        line = out[r]
        set_1(line, 0.0)
        for k in range(0 if r < corner else corner, inner):
            value = f[r, k]
            if value != 0.0:
                _add_row(value, g[k], 0, line, 0, parts * q)
            for j in range(count):
                value = f[r, (1 + j) * inner + k]
                if value != 0.0:
                    _add_row(value, g[k], 0, line, (1 + j) * q, q)
                    for other in range(count):
                        part = place_of(count, j, other)
                        _add_row(2.0 * value if other == j else value, g[k], (1 + other) * q, line, part * q, q)
            for part in range(1 + count, parts):
                value = f[r, part * inner + k]
                if value != 0.0:
                    _add_row(value, g[k], 0, line, part * q, q)


@kernel
def invert(count, f, work, out):
    """out = f^-1 for positive definite matrices f (n, G n). work (2, n, G n): scratch."""
    n = f.shape[0]
    first, other = work[0], work[1]
    # Gauss and Jordan, without a choice of pivots.
    for r in range(n):
        set_1(out[r], 0.0)
        for c in range(n):
            first[r, c] = f[r, c]
        out[r, r] = 1.0
    for k in range(n):
        d = 1.0 / first[k, k]
        for c in range(n):
            first[k, c] *= d
            out[k, c] *= d
        for r in range(n):
            factor = first[r, k]
            if r != k and factor != 0.0:
                _add_row(-factor, first[k], 0, first[r], 0, n)
                _add_row(-factor, out[k], 0, out[r], 0, n)
    # Newton's x (2 - f x): the derivatives are right after two rounds.
    for _ in range(2):
        multiply(count, f, out, n, first)
        multiply(count, out, first, n, other)
        for r in range(n):
            for c in range(other.shape[1]):
                out[r, c] = 2.0 * out[r, c] - other[r, c]


@inlined
def _set_units(rates, n, size, t, units):
    """units (s,): what the states (u, v) and those of the loads are measured in, so that the matrix of rates has a small norm."""
    back = 0.0
    turn = 1.0 / abs(t) if t != 0.0 else 1.0
    load = 0.0
    for r in range(n):
        for c in range(size):
            lower = abs(rates[n + r, c])
            if c < n:
                back = max(back, lower)
            elif c < 2 * n:
                turn = max(turn, lower)
            else:
                load = max(load, lower)
    velocity = max(math.sqrt(back), turn)
    velocity = 2.0 ** math.floor(math.log2(velocity)) if velocity < math.inf else 1.0
    phase = velocity * velocity / load if load > 0.0 else 1.0
    phase = 2.0 ** math.floor(math.log2(phase)) if 0.0 < phase < math.inf else 1.0
    for r in range(size):
        units[r] = 1.0 if r < n else velocity if r < 2 * n else phase


@kernel
def exponential(count, rates, n, t, units, powers, out):
    """out = exp(rates t), (s, G s), of the rates of 2 n states (u, v) under loads, which are zero below row 2 n in the columns before it.

    By squaring and a Taylor polynomial of degree 15, in the scheme of Paterson and Stockmeyer (Higham, Functions of Matrices, SIAM (2008),
    sections 4.2 and 10.3). units (s,), powers (5, s, G s): scratch. NaN where there would be too many squarings."""
    size, corner, length = rates.shape[0], 2 * n, rates.shape[1]
    _set_units(rates, n, size, t, units)
    norm = 0.0
    for c in range(size):
        column = 0.0
        for r in range(size):
            column += abs(rates[r, c]) * units[c] / units[r]
        norm = max(norm, column)
    norm *= abs(t)
    squarings = 0
    step = t
    while norm > CONVERGENCE and squarings < MOST_SQUARINGS:
        norm *= 0.5
        step *= 0.5
        squarings += 1
    if not norm <= CONVERGENCE:
        step = math.nan
    first, square, cube, fourth, work = powers[0], powers[1], powers[2], powers[3], powers[4]
    for r in range(size):
        for c in range(length):
            first[r, c] = rates[r, c] * (units[c % size] / units[r] * step)
        set_1(work[r], 0.0)
    multiply(count, first, first, corner, square)
    multiply(count, square, first, corner, cube)
    multiply(count, square, square, corner, fourth)
    for k in range(12, -4, -4):
        if k < 12:
            multiply(count, out, fourth, corner, work)
        a, b, c3 = COEFFICIENTS[k + 1], COEFFICIENTS[k + 2], COEFFICIENTS[k + 3]
        for r in range(size):
            for c in range(length):
                out[r, c] = work[r, c] + a * first[r, c] + b * square[r, c] + c3 * cube[r, c]
            out[r, r] += COEFFICIENTS[k]
    for _ in range(squarings):
        multiply(count, out, out, corner, work)
        for r in range(size):
            copy_1(work[r], out[r])
    for r in range(size):
        for c in range(length):
            out[r, c] *= units[r] / units[c % size]
