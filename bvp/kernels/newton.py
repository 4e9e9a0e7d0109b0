"""Newton's corrections of the multipoint problem, by orthogonal elimination of its Jacobian, equation (32).

The Jacobian J has one row less than columns. Its transpose is block bidiagonal - a flight couples its own node with the next one only - so
Householder reflections that work inside a moving window give J^T = Q [R; 0] without pivoting and without growth. The cost is linear in the
number of impacts:

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

from numpy import int64

from bvp.kernels.compiled import chosen, inlined, kernel
from bvp.kernels.flight import copy_1, inner
from bvp.kernels.flights import comes_with_map
from bvp.kernels.multipoint import evaluate, fill

LINEARISED = -1
"""In place of the most iterations: the residual and its Jacobian alone are computed."""


@inlined
def reflector(column, first, last):
    """Turn column[first:last] into a reflector; return the diagonal entry of R and 2/(v.v)."""
    # Householder's reflection, with the sign that does not cancel.
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
def reflect(column, first, last, factor, other, shift):
    """other <- (1 - factor v v^T) other, v = column[first:last], `other` shifted by `shift` rows."""
    total = 0.0
    for r in range(first, last):
        total += column[r] * other[r + shift]
    total *= factor
    for r in range(first, last):
        other[r + shift] -= total * column[r]


@kernel
def _reflect_rows(column, first, last, factor, others, begin, end, shift):
    """The same for the rows begin .. end - 1 of `others`, three at a time: their sums do not wait for each other."""
    a = begin
    while a + 2 < end:
        b = a + 1
        c = a + 2
        along_a = 0.0
        along_b = 0.0
        along_c = 0.0
        for r in range(first, last):
            head = column[r]
            along_a += head * others[a, r + shift]
            along_b += head * others[b, r + shift]
            along_c += head * others[c, r + shift]
        along_a *= factor
        along_b *= factor
        along_c *= factor
        for r in range(first, last):
            head = column[r]
            others[a, r + shift] -= along_a * head
            others[b, r + shift] -= along_b * head
            others[c, r + shift] -= along_c * head
        a += 3
    while a < end:
        reflect(column, first, last, factor, others[a], shift)
        a += 1


@inlined
def eliminate(flights, rows, start, closing_first, window, closing, diagonal, factor):
    """Reduce J^T in place. `rows` = m; `start` = size of the first block of unknowns; `closing_first` = first flight whose
    unknowns the closing equations touch. Returns (sign of the determinant of [R], number of reflections)."""
    unknowns = closing.shape[1]
    closers = closing.shape[0]
    reflections = 0
    # Equation (32): J^T = Q R, flight by flight, inside a window of two nodes.
    for i in range(flights):
        base = max(0, (i - 1) * rows)
        end = start + (i + 1) * rows
        for e in range(rows):
            j = i * rows + e
            column = window[j]
            d, f = reflector(column, j - base, end - base)
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
        d, f = reflector(column, first + e, unknowns)
        diagonal[first + e] = d
        factor[first + e] = f
        if f == 0.0:
            continue
        reflections += 1
        _reflect_rows(column, first + e, unknowns, f, closing, e + 1, closers, int64(0))
    return reflections


@inlined
def forward(flights, rows, window, closing, diagonal, right):
    """Solve R^T x = right in place."""
    # Equation (32): R^-T f.
    for i in range(flights):
        base = max(0, (i - 1) * rows)
        for e in range(rows):
            j = i * rows + e
            total = right[j]
            for r in range(j - base):
                total -= window[j, r] * right[base + r]
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
    # Equation (32): Q x, the reflections in reverse order.
    unknowns = closing.shape[1]
    first = flights * rows
    for e in range(closing.shape[0] - 1, -1, -1):
        if factor[first + e] != 0.0:
            reflect(closing[e], first + e, unknowns, factor[first + e], x, int64(0))
    for i in range(flights - 1, -1, -1):
        base = max(0, (i - 1) * rows)
        end = start + (i + 1) * rows
        for e in range(rows - 1, -1, -1):
            j = i * rows + e
            if factor[j] != 0.0:
                reflect(window[j], j - base, end - base, factor[j], x, base)


RESIDUAL_ROUNDING = 2e-15
"""Scaled residual that is nothing but rounding: 9 eps, for states at the ends of flights of size 1."""

CONVERGED_RESIDUAL = 1e-15
"""Scaled residual of a converged solution."""

SHORT_UPDATE = 1e-6
"""Newton's update, in units of the unknowns' sizes, below which the next one is beyond double precision: its square."""


NEAR = 1e-2
"""The same, below which new derivatives shorten the next update more than those of the iterate before."""


@chosen
def set_scale(segment, y, factor):
    """Fill factor.scale with the sizes of the unknowns at y. Returns those of displacements, velocities and flight times."""


@inlined
def factorise(segment, y, factor, displacement, velocity):
    """Factorise the Jacobian at y, which is in the factor arrays (`fill`). displacement, velocity: their scales, from `set_scale`.

    Returns two numbers for the test of branch points: the sign of the determinant (diagonal of R times the parity of the reflections), and
    the smallest diagonal entry of R relative to the length of its column.

    The length of a closing column is at least the scale of its end condition. Of a mode that moves alone, the column is only that mode's
    cosine. A pivot relative to the cosine would jump from -1 to 1 where the cosine is zero."""
    size = segment.gap.shape[1]
    rows = size + 1
    k = segment.shape[0]
    start = segment.start_map.shape[1] + 1
    closing_first = 0 if segment.shape[1] != 0 else max(0, k - 1)
    norms = factor.work[1]
    for i in range(k):
        for e in range(rows):
            norms[i * rows + e] = inner(factor.window[i * rows + e], factor.window[i * rows + e])
    for e in range(factor.closing.shape[0]):
        norms[k * rows + e] = inner(factor.closing[e], factor.closing[e])
        if segment.shape[1] == 0:
            total = 0.0
            for r in range(size):
                total += (segment.end_map[e, r] * (displacement if r < size // 2 else velocity)) ** 2
            norms[k * rows + e] = max(norms[k * rows + e], total)
    reflections = eliminate(k, rows, start, closing_first, factor.window, factor.closing, factor.diagonal, factor.factor)
    sign = -1.0 if reflections % 2 else 1.0
    smallest = 1.0
    for j in range(factor.diagonal.shape[0]):
        d = factor.diagonal[j]
        if d < 0.0:
            sign = -sign
        smallest = min(smallest, abs(d) / math.sqrt(norms[j]) if norms[j] > 0.0 else 0.0)
    return sign, smallest


@inlined
def solve(segment, factor, right, out):
    """Least-norm solution (in scaled unknowns) of J out = right; `right` is overwritten."""
    rows = segment.gap.shape[1] + 1
    k = segment.shape[0]
    unknowns = factor.scale.shape[0]
    # Equation (32): the least-norm correction.
    forward(k, rows, factor.window, factor.closing, factor.diagonal, right)
    copy_1(right, out[: unknowns - 1])
    out[unknowns - 1] = 0.0
    apply_reflectors(k, rows, segment.start_map.shape[1] + 1, factor.window, factor.closing, factor.factor, out)
    for j in range(unknowns):
        out[j] *= factor.scale[j]


@inlined
def conditioning(segment, factor, right):
    """Size of the smallest singular value of the last factorised Jacobian, its equations scaled to length 1: from the growth of two right
    sides of unit entries with irregular signs. `right` is overwritten."""
    rows = segment.gap.shape[1] + 1
    norms = factor.work[1]
    largest = 0.0
    for pattern in range(2):
        for j in range(right.shape[0]):
            size = math.sqrt(norms[j])
            right[j] = size if (j * (7 + 4 * pattern) + j * j * (3 - pattern)) % 5 < 3 - pattern else -size
        forward(segment.shape[0], rows, factor.window, factor.closing, factor.diagonal, right)
        for j in range(right.shape[0]):
            largest = max(largest, abs(right[j]))
    return 1.0 / largest if largest > 0.0 else 1.0


@inlined
def null_vector(segment, factor, out):
    """Null vector of the last factorised Jacobian, unit length in the scaled unknowns; returned: its entry before unscaling
    is +1 along the last reflected axis, so its orientation is the one that the determinant's sign refers to."""
    rows = segment.gap.shape[1] + 1
    unknowns = factor.scale.shape[0]
    # Equation (32): the tangent Q e_last.
    out[:unknowns] = 0.0
    out[unknowns - 1] = 1.0
    apply_reflectors(
        segment.shape[0], rows, segment.start_map.shape[1] + 1, factor.window, factor.closing, factor.factor, out
    )
    for j in range(unknowns):
        out[j] *= factor.scale[j]


@chosen
def residual_level(segment):
    """Scaled residual at which a solution needs no further update to show that the updates shrink."""


@chosen
def scaled_residual(segment, residual, before, displacement, velocity, longest):
    """Largest residual, displacements and velocities each by their own scale: see `bvp.kernels.flights.velocity_unit`.

    before: the states at the ends of the flights."""


@inlined
def correct(segment, y, row, target, factor, residual, maximum, rounding):
    """Correct y in place by Newton's method, and factorise the Jacobian at the solution.

    y stays on row . y = target. With a row of zeros the corrections are of least norm. A factorisation is used again as long as each
    update is a tenth of the one before. Where flights come with their derivatives, it is renewed after each update below `NEAR`. The
    iteration ends when

        the update no longer shrinks, and it or the residual is at rounding level (the update from a residual that is rounding is rounding,
            however badly the equations are conditioned);
        the residual is at rounding level, and by the last ratio the next update would be far below it;
        the same after a short update by derivatives of its own iterate: what is left of the residual is rounding;
        the updates grow, or `maximum` is reached. With maximum = 0, y is only evaluated. With LINEARISED nothing is solved: the residual is
            in `residual`, and the Jacobian in the factor arrays, for the scales that are there.

    Returns (converged, iterations, worst ratio of successive updates, scaled residual, sign and smallest pivot of `factorise` at the
    solution). factor.work[4] then contains the `null_vector` there."""
    unknowns = y.shape[0]
    z = factor.work[2]
    update = factor.work[3]
    null = factor.work[4]
    size = segment.gap.shape[1]
    always_fresh = comes_with_map(segment.flight)
    constrained = False
    for j in range(unknowns):
        if row[j] != 0.0:
            constrained = True
    iteration = 0
    length = math.inf
    previous = math.inf
    contraction = 0.0
    worst = math.inf
    sign = 0.0
    smallest = 0.0
    displacement = 1.0
    velocity = 1.0
    longest = 1.0
    fresh = True
    good = False
    ended = False
    while True:
        # one loop, so that each of these functions is compiled in one place
        evaluate(segment, y, factor.before, factor.flights, z[:size], residual)
        if iteration > 0:
            noise = worst <= max(RESIDUAL_ROUNDING, residual_level(segment)) and length < SHORT_UPDATE
            worst = scaled_residual(segment, residual, factor.before, displacement, velocity, longest)
            ratio = length / previous
            fresh = always_fresh and length < NEAR
            if length <= rounding:
                good = True
                ended = True
            elif always_fresh and length < SHORT_UPDATE and worst <= residual_level(segment):
                contraction = max(contraction, ratio)
                good = True
                ended = True
            elif iteration > 1:
                if ratio > 0.5 and (length < 1e-9 or noise):
                    good = worst < 1e-12
                    ended = True
                else:
                    if length > 1e-12 and not noise:
                        contraction = max(contraction, ratio)
                    if worst <= residual_level(segment) and ratio <= 0.1 and ratio * length <= 0.1 * rounding:
                        good = True
                        ended = True
                    elif ratio > 2.0 and length > 1e-3:
                        ended = True
                fresh = fresh or ratio > 0.1
            previous = length
            if iteration == maximum and not ended:
                good = worst < 1e-12 and (previous < 1e-9 or noise)
                ended = True
            if ended and not good:
                break
        if maximum != LINEARISED and (fresh or ended):
            displacement, velocity, longest = set_scale(segment, y, factor)
        if maximum == 0:
            worst = scaled_residual(segment, residual, factor.before, displacement, velocity, longest)
            good = worst < 1e-12
            ended = True
        if fresh or ended:
            fill(segment, y, factor)
            if maximum == LINEARISED:
                break
            sign, smallest = factorise(segment, y, factor, displacement, velocity)
            null_vector(segment, factor, null)
        if ended:
            break
        for j in range(residual.shape[0]):
            residual[j] = -residual[j]
        solve(segment, factor, residual, update)
        iteration += 1
        # A multiple of the null vector takes the correction to the plane row . y = target.
        if constrained:
            along = -target
            slope = 0.0
            for j in range(unknowns):
                along += row[j] * (y[j] + update[j])
                slope += row[j] * null[j]
            if slope == 0.0:
                return False, iteration - 1, contraction, worst, sign, smallest
            for j in range(unknowns):
                update[j] -= along / slope * null[j]
        length = 0.0
        finite = True
        for j in range(unknowns):
            y[j] += update[j]
            length = max(length, abs(update[j]) / factor.scale[j])
            finite = finite and math.isfinite(y[j])
        if not finite:
            return False, iteration - 1, contraction, math.inf, sign, smallest
    return good, iteration, contraction, worst, sign, smallest
