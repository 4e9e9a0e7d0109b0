"""Matrices with derivatives of first and second order: as `bvp.nilpotent`, for one direction and each of m parameters.

An array f (G, p, q), G = 2 + 2 m, has the value f[0], its derivative f[1] along a direction, the derivatives f[2 + j] by the parameters,
and those of second order f[2 + m + j], along the direction and by parameter j.
"""

import math

from bvp.kernels.compiled import inlined, kernel, short_loops
from bvp.kernels.flight import copy_1, set_2

CONVERGENCE = 0.45
"""Norm up to which a Taylor polynomial of degree 15 is the exponential to rounding, and so are its second derivatives."""

MOST_SQUARINGS = 60

COEFFICIENTS = tuple(1.0 / math.factorial(k) for k in range(16))


@inlined
def _add(f, g, corner, out):
    """out += f g. Below row `corner` the columns before `corner` are zero."""
    for r in range(f.shape[0]):
        for k in range(0 if r < corner else corner, f.shape[1]):
            value = f[r, k]
            if value != 0.0:
                for c in range(0 if k < corner else corner, g.shape[1]):
                    out[r, c] += value * g[k, c]


@short_loops
def multiply(f, g, corner, out):
    """out = f g. Where both have zeros below row `corner` in the columns before it, `corner` says so; else it is their size."""
    count = f.shape[0] // 2 - 1
    for part in range(out.shape[0]):
        set_2(out[part], 0.0)
    _add(f[0], g[0], corner, out[0])
    _add(f[1], g[0], corner, out[1])
    _add(f[0], g[1], corner, out[1])
    for j in range(2, 2 + count):
        _add(f[j], g[0], corner, out[j])
        _add(f[0], g[j], corner, out[j])
        _add(f[j + count], g[0], corner, out[j + count])
        _add(f[1], g[j], corner, out[j + count])
        _add(f[j], g[1], corner, out[j + count])
        _add(f[0], g[j + count], corner, out[j + count])


@inlined
def divide(f, g, out):
    """out = f/g for numbers g (G, 1, 1)."""
    count = f.shape[0] // 2 - 1
    d = g[0, 0, 0]
    for r in range(f.shape[1]):
        for c in range(f.shape[2]):
            out[0, r, c] = f[0, r, c] / d
            out[1, r, c] = (f[1, r, c] - out[0, r, c] * g[1, 0, 0]) / d
            for j in range(2, 2 + count):
                out[j, r, c] = (f[j, r, c] - out[0, r, c] * g[j, 0, 0]) / d
                total = f[j + count, r, c] - out[1, r, c] * g[j, 0, 0] - out[j, r, c] * g[1, 0, 0] - out[0, r, c] * g[j + count, 0, 0]
                out[j + count, r, c] = total / d


@kernel
def invert(f, work, out):
    """out = f^-1 for positive definite matrices; work (G, n, n): scratch."""
    n = f.shape[1]
    count = f.shape[0] // 2 - 1
    # Gauss and Jordan, without a choice of pivots.
    first, found = work[0], out[0]
    for r in range(n):
        for c in range(n):
            first[r, c] = f[0, r, c]
            found[r, c] = 1.0 if r == c else 0.0
    for k in range(n):
        d = 1.0 / first[k, k]
        for c in range(n):
            first[k, c] *= d
            found[k, c] *= d
        for r in range(n):
            factor = first[r, k]
            if r == k or factor == 0.0:
                continue
            for c in range(n):
                first[r, c] -= factor * first[k, c]
                found[r, c] -= factor * found[k, c]
    # (f^-1)' = -f^-1 f' f^-1
    for part in range(1, f.shape[0]):
        set_2(work[part], 0.0)
        set_2(out[part], 0.0)
    _add(f[1], found, n, work[1])
    _subtract_product(found, work[1], out[1])
    for j in range(2, 2 + count):
        _add(f[j], found, n, work[j])
        _subtract_product(found, work[j], out[j])
        _add(f[j + count], found, n, work[j + count])
        _add(f[1], out[j], n, work[j + count])
        _add(f[j], out[1], n, work[j + count])
        _subtract_product(found, work[j + count], out[j + count])


@inlined
def _subtract_product(f, g, out):
    """out -= f g."""
    for r in range(f.shape[0]):
        for k in range(f.shape[1]):
            for c in range(g.shape[1]):
                out[r, c] -= f[r, k] * g[k, c]


@inlined
def _units(rates, n, t, units):
    """units (s,): what the states (u, v) and those of the loads are measured in, so that the matrix of rates has a small norm."""
    forward = 0.0
    back = 0.0
    turn = 1.0 / abs(t) if t != 0.0 else 1.0
    load = 0.0
    for r in range(n):
        for c in range(rates.shape[1]):
            lower = abs(rates[n + r, c])
            if c < n:
                back = max(back, lower)
            elif c < 2 * n:
                forward = max(forward, abs(rates[r, c]))
                turn = max(turn, lower)
            else:
                load = max(load, lower)
    velocity = max(math.sqrt(back), turn) if forward > 0.0 else 1.0
    velocity = 2.0 ** math.floor(math.log2(velocity)) if 0.0 < velocity < math.inf else 1.0
    phase = velocity * velocity / load if load > 0.0 else 1.0
    phase = 2.0 ** math.floor(math.log2(phase)) if 0.0 < phase < math.inf else 1.0
    for r in range(units.shape[0]):
        units[r] = 1.0 if r < n else velocity if r < 2 * n else phase


@kernel
def exponential(rates, n, t, units, powers, out):
    """out = exp(rates t), (G, s, s), of the rates of 2 n states (u, v) under loads, which are zero below row 2 n in the columns before it.

    By squaring and a Taylor polynomial of degree 15, in the scheme of Paterson and Stockmeyer (Higham, Functions of Matrices, SIAM (2008),
    sections 4.2 and 10.3). units (s,), powers (5, G, s, s): scratch. NaN where there would be too many squarings."""
    count, size, corner = rates.shape[0], rates.shape[1], 2 * n
    _units(rates[0], n, t, units)
    norm = 0.0
    for c in range(size):
        column = 0.0
        for r in range(size):
            column += abs(rates[0, r, c]) * units[c] / units[r]
        norm = max(norm, column)
    norm *= abs(t)
    squarings = 0
    while norm > CONVERGENCE and squarings < MOST_SQUARINGS:
        norm *= 0.5
        squarings += 1
    step = t if norm <= CONVERGENCE else math.nan
    for _ in range(squarings):
        step *= 0.5
    first, square, cube, fourth, work = powers[0], powers[1], powers[2], powers[3], powers[4]
    for g in range(count):
        for r in range(size):
            for c in range(size):
                first[g, r, c] = rates[g, r, c] * (units[c] / units[r]) * step
    multiply(first, first, corner, square)
    multiply(square, first, corner, cube)
    multiply(square, square, corner, fourth)
    for g in range(count):
        set_2(work[g], 0.0)
    for k in range(12, -4, -4):
        if k < 12:
            multiply(out, fourth, corner, work)
        for g in range(count):
            for r in range(size):
                for c in range(size):
                    total = COEFFICIENTS[k + 1] * first[g, r, c] + COEFFICIENTS[k + 2] * square[g, r, c]
                    out[g, r, c] = work[g, r, c] + total + COEFFICIENTS[k + 3] * cube[g, r, c]
        for r in range(size):
            out[0, r, r] += COEFFICIENTS[k]
    for _ in range(squarings):
        multiply(out, out, corner, work)
        for g in range(count):
            for r in range(size):
                copy_1(work[g, r], out[g, r])
    for g in range(count):
        for r in range(size):
            for c in range(size):
                out[g, r, c] *= units[r] / units[c]
