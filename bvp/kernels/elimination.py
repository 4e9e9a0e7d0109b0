"""Orthogonal elimination of the multipoint Jacobian, cost linear in the number of impacts.

The Jacobian J has one row less than columns. Its transpose is block bidiagonal - a flight couples its own node with the next
one only - so Householder reflections that work inside a moving window give J^T = Q [R; 0] without pivoting and without growth:

    least-norm solution of J d = f:   d = Q [R^-T f; 0]
    null vector of J:                 t = Q e_last

both backward stable, for whatever growth the orbit has. Closing equations may couple the last node with the first; they are kept
as full columns, and are eliminated last.

Layout of the factor arrays (m = N + 1 equations a flight, k full flights, c closing equations, u = k m + c + 1 unknowns)
    window  (k m, width)  row j holds column j of J^T from row `base` = max(0, (j // m - 1) m); R above the pivot, the reflector
                          below, the pivot's own place holding the reflector's head
    closing (c, u)        the closing columns, from row 0
    diagonal (k m + c,)   diagonal of R
    factor   (k m + c,)   2 / (v . v) of each reflector (0: no reflection)
"""

import math

from numba import int64

from bvp.kernels.compiled import kernel, part

__all__ = ["eliminate", "forward", "apply_reflectors"]


@part
def _reflector(column, first, last):
    """Turn column[first:last] into a reflector; return the diagonal entry of R and 2/(v.v)."""
    total = 0.0
    for r in range(first + 1, last):
        total += column[r] * column[r]
    head = column[first]
    if total == 0.0:
        return head, 0.0
    norm = math.sqrt(head * head + total)
    if head > 0.0:
        norm = -norm
    head -= norm
    column[first] = head
    return norm, 2.0 / (head * head + total)


@kernel
def _reflect(column, first, last, factor, other, shift):
    """other <- (1 - factor v v^T) other, v = column[first:last], `other` shifted by `shift` rows."""
    total = 0.0
    for r in range(first, last):
        total += column[r] * other[r + shift]
    total *= factor
    if total != 0.0:
        for r in range(first, last):
            other[r + shift] -= total * column[r]


@part
def eliminate(flights, rows, start, closing_first, window, closing, diagonal, factor):
    """Reduce J^T in place. `rows` = m; `start` = size of the first block of unknowns; `closing_first` = first flight whose
    unknowns the closing equations touch. Returns (sign of the determinant of [R], number of reflections)."""
    unknowns = closing.shape[1]
    closers = closing.shape[0]
    reflections = 0
    for i in range(flights):
        base = max(0, (i - 1) * rows)
        end = start + (i + 1) * rows
        for e in range(rows):
            j = i * rows + e
            column = window[j]
            d, f = _reflector(column, j - base, end - base)
            diagonal[j] = d
            factor[j] = f
            if f == 0.0:
                continue
            reflections += 1
            for other in range(e + 1, rows):
                _reflect(column, j - base, end - base, f, window[i * rows + other], int64(0))
            if i + 1 < flights:
                shift = base - i * rows
                for other in range(rows):
                    _reflect(column, j - base, end - base, f, window[(i + 1) * rows + other], shift)
            if i >= closing_first or i + 1 == flights:
                for other in range(closers):
                    _reflect(column, j - base, end - base, f, closing[other], base)
    first = flights * rows
    for e in range(closers):
        column = closing[e]
        d, f = _reflector(column, first + e, unknowns)
        diagonal[first + e] = d
        factor[first + e] = f
        if f == 0.0:
            continue
        reflections += 1
        for other in range(e + 1, closers):
            _reflect(column, first + e, unknowns, f, closing[other], int64(0))
    return reflections


@part
def forward(flights, rows, window, closing, diagonal, right):
    """Solve R^T x = right in place."""
    for i in range(flights):
        base = max(0, (i - 1) * rows)
        for e in range(rows):
            j = i * rows + e
            total = right[j]
            for r in range(base, j):
                total -= window[j, r - base] * right[r]
            right[j] = total / diagonal[j]
    first = flights * rows
    for e in range(closing.shape[0]):
        total = right[first + e]
        for r in range(first + e):
            total -= closing[e, r] * right[r]
        right[first + e] = total / diagonal[first + e]


@kernel
def apply_reflectors(flights, rows, start, window, closing, factor, x):
    """x <- Q x, in place; x has one entry for each unknown."""
    unknowns = closing.shape[1]
    first = flights * rows
    for e in range(closing.shape[0] - 1, -1, -1):
        if factor[first + e] != 0.0:
            _reflect(closing[e], first + e, unknowns, factor[first + e], x, int64(0))
    for i in range(flights - 1, -1, -1):
        base = max(0, (i - 1) * rows)
        end = start + (i + 1) * rows
        for e in range(rows - 1, -1, -1):
            j = i * rows + e
            if factor[j] != 0.0:
                _reflect(window[j], j - base, end - base, factor[j], x, base)
