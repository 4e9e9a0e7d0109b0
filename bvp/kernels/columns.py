"""The derivatives of a Taylor flight by its begin, and by what its sources depend on: columns, four in one register of the processor.

A column obeys the linearised motion: its forces are the slopes of the forces, times its inputs. The Taylor coefficients of the slopes are
known from the state (`bvp.kernels.jets`).
"""

import math

from numpy import int64

from bvp.kernels import driving  # noqa: F401  a kind of sources
from bvp.kernels.compiled import four_of, inlined, plus_times, shared, sized, spread, times, write_four
from bvp.kernels.sources import ORDER, column_source, source_terms


@inlined
def _sum_pairs(flight, inputs, k, lines, sums):
    """sums (D, 2, 4) = the parts of the orders k and k + 1 of the products of slopes and inputs that follow from the inputs below k, for as
    many slopes as `lines`. Of two orders at once they do not wait for each other."""
    slopes, jets = flight.program.slopes, flight.jets
    for line in range(lines):
        i = slopes[line, 1]
        slope = jets[slopes[line, 2]]
        now = spread(0.0)
        later = spread(0.0)
        for j in range(k):
            four = four_of(inputs[j, i])
            now = plus_times(now, slope[k - j], four)
            later = plus_times(later, slope[k + 1 - j], four)
        write_four(sums[line, 0], now)
        write_four(sums[line, 1], later)


@inlined
def _expand_block(flight, block, columns, inputs, sums):
    """The Taylor coefficients of four columns (ORDER + 1, N, 4), about columns[0], from the jets of the derivatives of the forces. inputs
    (ORDER + 1, I, 4), sums (D, 2, 4): scratch."""
    matrix, rows, push, places, sources = flight.matrix, flight.rows, flight.push, flight.places, flight.sources
    slopes, jets = flight.program.slopes, flight.jets
    states = rows.shape[1]
    n = states // 2
    for k in range(ORDER):
        odd = k & 1
        if odd == 0:
            _sum_pairs(flight, inputs, k, slopes.shape[0], sums)
        after = columns[k + 1]
        part = 1.0 / (k + 1.0)
        for r in range(n):
            write_four(after[r], times(part, four_of(columns[k, n + r])))
            total = times(part, column_source(sources, block, k, r))
            s = places[r, 0]
            while s < states:
                total = plus_times(total, part * matrix[n + r, s], four_of(columns[k, s]))
                s = places[r, s + 1]
            write_four(after[n + r], total)
        line = 0
        for i in range(rows.shape[0]):
            w = spread(0.0)
            s = places[n + i, 0]
            while s < states:
                w = plus_times(w, rows[i, s], four_of(columns[k, s]))
                s = places[n + i, s + 1]
            write_four(inputs[k, i], w)
            while line < slopes.shape[0] and slopes[line, 1] == i:
                slope = jets[slopes[line, 2]]
                # The input that is known last comes last.
                total = four_of(sums[line, odd])
                if odd == 1:
                    total = plus_times(total, slope[1], four_of(inputs[k - 1, i]))
                total = plus_times(total, slope[0], w)
                for r in range(n):
                    factor = part * push[r, slopes[line, 0]]
                    if factor != 0.0:
                        write_four(after[n + r], plus_times(four_of(after[n + r]), factor, total))
                line += 1


@inlined
def _expand_two(flight, block, columns, inputs, sums, springs, lines, damped):
    """`_expand_block` for two coordinates: their coefficients stay in registers from order to order. springs, lines: the numbers of inputs
    and of derivatives. damped: whether accelerations or inputs depend on velocities. The compiler knows them where they are written out."""
    matrix, rows, push, sources = sized(flight.matrix, 4), sized(flight.rows, 4), flight.push, flight.sources
    slopes, jets = flight.program.slopes, flight.jets
    u_1, u_2, v_1, v_2 = four_of(columns[0, 0]), four_of(columns[0, 1]), four_of(columns[0, 2]), four_of(columns[0, 3])
    for k in range(ORDER):
        odd = k & 1
        if odd == 0:
            _sum_pairs(flight, inputs, k, lines, sums)
        part = 1.0 / (k + 1.0)
        a_1, a_2 = column_source(sources, block, k, 0), column_source(sources, block, k, 1)
        if damped:
            a_1 = plus_times(plus_times(a_1, matrix[2, 2], v_1), matrix[2, 3], v_2)
            a_2 = plus_times(plus_times(a_2, matrix[3, 2], v_1), matrix[3, 3], v_2)
        a_1 = plus_times(plus_times(a_1, matrix[2, 0], u_1), matrix[2, 1], u_2)
        a_2 = plus_times(plus_times(a_2, matrix[3, 0], u_1), matrix[3, 1], u_2)
        line = 0
        for i in range(springs):
            w = plus_times(times(rows[i, 0], u_1), rows[i, 1], u_2)
            if damped:
                w = plus_times(plus_times(w, rows[i, 2], v_1), rows[i, 3], v_2)
            write_four(inputs[k, i], w)
            while line < lines and (springs == 1 or slopes[line, 1] == i):
                slope = jets[slopes[line, 2]]
                force = slopes[line, 0]
                # The input that is known last comes last.
                total = four_of(sums[line, odd])
                if odd == 1:
                    total = plus_times(total, slope[1], four_of(inputs[k - 1, i]))
                a_1 = plus_times(plus_times(a_1, push[0, force], total), push[0, force] * slope[0], w)
                a_2 = plus_times(plus_times(a_2, push[1, force], total), push[1, force] * slope[0], w)
                line += 1
        u_1, u_2, v_1, v_2 = times(part, v_1), times(part, v_2), times(part, a_1), times(part, a_2)
        after = columns[k + 1]
        write_four(after[0], u_1)
        write_four(after[1], u_2)
        write_four(after[2], v_1)
        write_four(after[3], v_2)


@inlined
def _depends_on_velocities(matrix, rows):
    """Whether accelerations or inputs of two coordinates do."""
    found = matrix[2, 2] != 0.0 or matrix[2, 3] != 0.0 or matrix[3, 2] != 0.0 or matrix[3, 3] != 0.0
    for i in range(rows.shape[0]):
        found = found or rows[i, 2] != 0.0 or rows[i, 3] != 0.0
    return found


@inlined
def _advance_block(columns, h):
    """columns[0] = the polynomials (ORDER + 1, N, 4) at h: c_0 + h (odd + h even), with two polynomials of h^2 that do not wait for each
    other."""
    square = h * h
    for r in range(columns.shape[1]):
        even, odd = four_of(columns[ORDER, r]), four_of(columns[ORDER - 1, r])
        for pair in range(1, ORDER // 2):
            k = ORDER - 2 * pair
            even = plus_times(four_of(columns[k, r]), square, even)
            odd = plus_times(four_of(columns[k - 1, r]), square, odd)
        write_four(columns[0, r], plus_times(four_of(columns[0, r]), h, plus_times(odd, h, even)))


@shared("none", loops="short")
def expand_columns(flight, at):
    """The Taylor coefficients of the columns about columns[0]; those of the state are known, and the places in its matrix."""
    source_terms(flight.sources, flight, at)
    inputs, sums = sized(flight.inputs, 4), sized(flight.sums, 4)
    springs, lines = flight.rows.shape[0], flight.program.slopes.shape[0]
    two = flight.matrix.shape[0] == 4
    damped = two and _depends_on_velocities(flight.matrix, flight.rows)
    for block in range(flight.columns.shape[0]):
        columns = sized(flight.columns[block], 4)
        if two and springs == 1 and lines == 1 and not damped:
            _expand_two(flight, block, columns, inputs, sums, int64(1), int64(1), False)
        elif two:
            _expand_two(flight, block, columns, inputs, sums, springs, lines, damped)
        else:
            _expand_block(flight, block, columns, inputs, sums)


@inlined
def column_room(columns, length):
    """The least ratio of a column's velocities in a step of some length to their coefficients of order ORDER - 1."""
    size = columns.shape[2]
    least = math.inf
    for block in range(columns.shape[0]):
        for e in range(4):
            first = 0.0
            last = 0.0
            for r in range(size // 2, size):
                first = max(first, abs(columns[block, 0, r, e]), abs(columns[block, 1, r, e]) * length)
                last = max(last, abs(columns[block, ORDER - 1, r, e]))
                if 4 * block + e >= size:  # it is zero at the begin of the flight
                    first = max(first, abs(columns[block, 2, r, e]) * length**2, abs(columns[block, 3, r, e]) * length**3)
            if first > 0.0 and first < least * last:
                least = first / last
    return least


@shared("none", loops="short")
def advance_columns(columns, h):
    """columns[:, 0] = the polynomials at h."""
    for block in range(columns.shape[0]):
        _advance_block(sized(columns[block], 4), h)
