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

Inner loops count without a sign: an index that may be negative is looked at each time.
"""

import math

from numba import int64, uint64

from bvp.kernels.compiled import kernel, part


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
    v = uint64(first)
    x = uint64(first + shift)
    total = 0.0
    for r in range(uint64(last - first)):
        total += column[v + r] * other[x + r]
    total *= factor
    for r in range(uint64(last - first)):
        other[x + r] -= total * column[v + r]


@kernel
def _reflect_rows(column, first, last, factor, others, begin, end, shift):
    """The same for the rows begin .. end - 1 of `others`, three at a time: their sums do not wait for each other."""
    v = uint64(first)
    x = uint64(first + shift)
    size = uint64(last - first)
    a = uint64(begin)
    while a + uint64(2) < uint64(end):
        b = a + uint64(1)
        c = a + uint64(2)
        along_a = 0.0
        along_b = 0.0
        along_c = 0.0
        for r in range(size):
            head = column[v + r]
            along_a += head * others[a, x + r]
            along_b += head * others[b, x + r]
            along_c += head * others[c, x + r]
        along_a *= factor
        along_b *= factor
        along_c *= factor
        for r in range(size):
            head = column[v + r]
            others[a, x + r] -= along_a * head
            others[b, x + r] -= along_b * head
            others[c, x + r] -= along_c * head
        a += uint64(3)
    while a < uint64(end):
        along_a = 0.0
        for r in range(size):
            along_a += column[v + r] * others[a, x + r]
        along_a *= factor
        for r in range(size):
            others[a, x + r] -= along_a * column[v + r]
        a += uint64(1)


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
            _reflect_rows(column, j - base, end - base, f, window, j + 1, (i + 1) * rows, int64(0))
            if i + 1 < flights:
                _reflect_rows(column, j - base, end - base, f, window, (i + 1) * rows, (i + 2) * rows, base - i * rows)
            if i >= closing_first or i + 1 == flights:
                _reflect_rows(column, j - base, end - base, f, closing, int64(0), closers, base)
    first = flights * rows
    for e in range(closers):
        column = closing[e]
        d, f = _reflector(column, first + e, unknowns)
        diagonal[first + e] = d
        factor[first + e] = f
        if f == 0.0:
            continue
        reflections += 1
        _reflect_rows(column, first + e, unknowns, f, closing, e + 1, closers, int64(0))
    return reflections


@part
def forward(flights, rows, window, closing, diagonal, right):
    """Solve R^T x = right in place."""
    for i in range(flights):
        base = max(0, (i - 1) * rows)
        for e in range(rows):
            j = i * rows + e
            total = right[j]
            x = uint64(base)
            for r in range(uint64(j - base)):
                total -= window[j, r] * right[x + r]
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
