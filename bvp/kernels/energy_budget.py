"""Exact integrals of products along a flight: sum over R products of weight (a . z(s)) (b . z(s)), integrated over 0 <= s <= t.

There are three methods.

1. If every block has distinct rates, a . z is a sum of exponentials. Such blocks are oscillating pairs, pairs with two separate real
   rates, single rates and constant loads. The integral of each product of exponentials is

       (exp(x t) - 1)/x,   x a sum of two rates.

   It is computed from the exponentials, or from a series if |x t| is small, so nothing cancels.
2. Otherwise (near critical damping, rigid bodies, loads joined with a block, ramps) it is the product of two Taylor series. The flight
   is divided into parts on which they converge.
3. If there were many parts, the integral W of the matrix z(s) z(s)' is doubled: W(2 t) = W(t) + exp(B t) W(t) exp(B't) (Van Loan, IEEE
   Trans. Automat. Control 23 (1978) 395, without its inverse). One W is enough for all products a . W b.

The energy budget of a motion consists of compensated sums of these integrals over its flights, and of the losses at its impacts.
"""

import math
from typing import NamedTuple

import numpy as np

from bvp.kernels import contact_mode as entry
from bvp.kernels.compiled import allocating, chosen, inlined, kernel, shared
from bvp.kernels.contact_mode import add, advance_clock, flight_of, log_event, renew_loads, sums_of
from bvp.kernels.extrema import peak_flight
from bvp.kernels.flight import Flight, block_product, copy_1, fastest_rate, flow_matrix, flow_state, inner, row_dot, set_1, times_matrix
from bvp.kernels.flights import path_state

TERMS = 19
"""Taylor terms on a part of a flight with a rate times time of 1 at most: truncation below 1e-17."""

MOST_PARTS = 24
"""Parts of a flight above which the doubled matrix is cheaper."""

SMALL = 0.1
"""|x t| below which (exp(x t) - 1)/(x t) is a series."""

SERIES = 9
RECIPROCAL = tuple(1.0 / k for k in range(2, 64))
"""1/2, 1/3, ..."""

LOST = 4.0
"""The two exponentials of a pair are integrated separately up to this size, relative to the largest value of their sum over the flight.
A product can lose a factor of its square in accuracy."""

ROWS = 8


class Products(NamedTuple):
    """R products of two linear functionals."""

    first: np.ndarray  # (R, N) rows
    second: np.ndarray  # (R, N) rows
    weight: np.ndarray  # (R,)


def integral_work(size, products):
    """Scratch array of `integrals` for N = `size` states."""
    return np.zeros((ROWS + 2 * products, max(2 * size, TERMS + 1)))


@kernel
def mean_exponential(real, imaginary, end_real, end_imaginary, t):
    """Integral of exp((real + i imaginary) s) over 0 <= s <= t, given its value at the end."""
    # Equation (29) for a complex rate; a series where the quotient would cancel.
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
def mode_rates(flight, t, work):
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
    """Complex weights of the exponentials in rows[c] . z(s), into rows `at` and `at` + 1 of work. False if the weights do not exist or
    would cancel."""
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
    """Integral of the product of two sums of exponentials. Rows `first`, `first` + 1 and `second`, `second` + 1 contain their weights."""
    total = 0.0
    for k in range(slots):
        if work[first, k] == 0.0 and work[first + 1, k] == 0.0:
            continue
        for q in range(k if first == second else 0, slots):
            if work[second, q] == 0.0 and work[second + 1, q] == 0.0:
                continue
            part = 0.0
            # The real part of a product of two complex exponentials: half of those of the sum and the difference of the rates.
            for sign in (1.0, -1.0):
                weight = work[first, k] * work[second, q] - sign * work[first + 1, k] * work[second + 1, q]
                shifted = sign * work[first, k] * work[second + 1, q] + work[first + 1, k] * work[second, q]
                end = work[2, k] * work[2, q] - sign * work[3, k] * work[3, q]
                end_turned = sign * work[2, k] * work[3, q] + work[3, k] * work[2, q]
                real, imaginary = mean_exponential(
                    work[0, k] + work[0, q], work[1, k] + sign * work[1, q], end, end_turned, t
                )
                part += weight * real - shifted * imaginary
            total += part if first == second and q > k else 0.5 * part
    return total


@kernel
def terms_of(x):
    """Number of Taylor terms that leaves a remainder below 1e-17 of the first term, for x = rate times time <= 1: x^k/k! falls below it."""
    size = 1.0
    terms = 1
    while size > 1e-17 and terms < TERMS:
        size *= x * RECIPROCAL[terms - 1]
        terms += 1
    return terms


@kernel
def series_integrals(flight, products, z, t, fastest, parts, work, out):
    """out += the integrals, over equal parts of the flight, by Taylor series."""
    first, second, weight = products
    pairs, _, _, matrix = flight
    size = z.shape[0]
    h = t / parts
    state = work[4, :size]
    term = work[5, :size]
    other = work[6, :size]
    terms = terms_of(fastest * h)
    copy_1(z, state)
    for index in range(parts):
        copy_1(state, term)
        for k in range(terms + 1):
            for c in range(first.shape[0]):
                work[ROWS + 2 * c, k] = row_dot(first, c, term)
                work[ROWS + 2 * c + 1, k] = row_dot(second, c, term)
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
        if index + 1 < parts:
            flow_state(flight, state, h, other)
            copy_1(other, state)


@allocating
def doubled_integrals(flight, products, z, t, fastest, out):
    """out += the integrals, by doubling."""
    first, second, weight = products
    pairs, _, _, matrix = flight
    size = z.shape[0]
    doublings = 0
    h = t
    while fastest * h > 1.0 and doublings < 1100:
        h *= 0.5
        doublings += 1
    flow = np.empty((size, size))
    half = np.zeros((size, size))
    grown = np.zeros((size, size))  # 0 outside the blocks
    terms = np.zeros((TERMS + 1, size))
    # The Taylor terms of exp(B s) z, and the integral of each times the series.
    copy_1(z, terms[0])
    for k in range(TERMS):
        block_product(pairs, matrix, terms[k], terms[k + 1])
        for r in range(size):
            terms[k + 1, r] *= h / (k + 1)
    for j in range(TERMS, -1, -1):
        for r in range(size):
            entry = 0.0
            for k in range(TERMS, -1, -1):
                entry += terms[k, r] / (k + j + 1)
            for q in range(size):
                half[r, q] += entry * h * terms[j, q]
    # W(2 t) = W(t) + exp(B t) W(t) exp(B't).
    span = h
    for _ in range(doublings):
        flow_matrix(flight, span, flow)
        for r in range(size):
            block_product(pairs, flow, half[r], grown[r])
        for q in range(size):
            block_product(pairs, flow, grown[:, q], terms[0])
            for r in range(size):
                half[r, q] += terms[0, r]
        span *= 2.0
    for c in range(first.shape[0]):
        times_matrix(half, second[c], terms[0])
        out[c] += weight[c] * inner(first[c], terms[0])


@chosen
def integrals(flight, products, z, t, work, out):
    """out (R,) = weight times the integral of (first . z(s)) (second . z(s)) over 0 <= s <= t. `work` comes from `integral_work`."""


@integrals.of(Flight)
@shared("none")
def exact_integrals(flight, products, z, t, work, out):
    """See `integrals`."""
    first, second, weight = products
    pairs = flight.pairs
    count = first.shape[0]
    set_1(out[:count], 0.0)
    if count == 0 or t == 0.0:
        return
    apart = True
    for c in range(count):
        at = ROWS
        apart = weights(flight, second, c, z, t, work, 4)
        if apart:
            apart = weights(flight, first, c, z, t, work, at)
        if not apart:
            break
        if c == 0:
            mode_rates(flight, t, work)
        same = True
        for k in range(2 * pairs.shape[0]):
            same = same and work[4, k] == work[at, k] and work[5, k] == work[at + 1, k]
        out[c] = weight[c] * product_integral(2 * pairs.shape[0], work, 4, 4 if same else at, t)
    if apart:
        return
    set_1(out[:count], 0.0)
    fastest = fastest_rate(flight)
    if fastest * t <= MOST_PARTS:
        series_integrals(flight, products, z, t, fastest, int(fastest * t) + 1, work, out)
    else:
        doubled_integrals(flight, products, z, t, fastest, out)


MARK_LEVEL = 4e-16
"""Tolerance of the energy dissipated at a mark, relative to the initial energy."""


@kernel
def dissipated(sums, parts):
    """Total of the first `parts` sums: the energy dissipated."""
    total = 0.0
    for i in range(parts):
        total += sums[i, 0] + sums[i, 1]
    return total


@kernel
def note_mark(motion, time):
    """Write the time and the sums at the next mark."""
    row = motion.counts[entry.MARK]
    motion.marks[row, 1] = time
    sums_of(motion.sums, motion.marks[row, 2:])
    motion.counts[entry.MARK] = row + 1


@kernel
def dissipated_energy(modes, f, z, t, work, out):
    """Energy dissipated by the dampers over a flight of t from z; out (R,): the integrals."""
    integrals(flight_of(modes, f), Products(modes.first[f], modes.second[f], modes.weight), z, t, work, out)
    total = 0.0
    for k in range(modes.part.shape[0]):
        if modes.part[k] < modes.shape[1]:
            total += out[k]
    return total


@inlined
def passes_mark(modes, total, motion):
    """True if the motion passes the next mark while it dissipates a further `total`."""
    wanted = motion.marks[motion.counts[entry.MARK], 0] * motion.clock[entry.INITIAL]
    return dissipated(motion.sums, modes.shape[1] + modes.shape[2]) + total >= wanted


@kernel
def mark_flight(modes, f, flight, total, motion, work, out):
    """Record the marks that a flight passes. The flight dissipates `total`."""
    z, counts, clock, sums, marks = motion.z, motion.counts, motion.clock, motion.sums, motion.marks
    parts = modes.shape[1] + modes.shape[2]
    start = dissipated(sums, parts)
    while counts[entry.MARK] < marks.shape[0] and start + total >= marks[counts[entry.MARK], 0] * clock[entry.INITIAL]:
        wanted = marks[counts[entry.MARK], 0] * clock[entry.INITIAL] - start
        low = 0.0
        high = flight
        residual_low = -wanted
        residual_high = total - wanted
        at = high
        last = 0
        # The Illinois variant of regula falsi: the dissipation grows with time.
        for _ in range(200):
            if residual_high <= 0.0 or residual_low >= 0.0 or high - low <= 4e-16 * high:
                break
            at = high - residual_high * (high - low) / (residual_high - residual_low)
            if not low < at < high:
                at = 0.5 * (low + high)
            residual = dissipated_energy(modes, f, z, at, work, out) - wanted
            if abs(residual) <= MARK_LEVEL * clock[entry.INITIAL]:
                break
            if residual > 0.0:
                high = at
                residual_high = residual
                if last == 1:
                    residual_low *= 0.5
                last = 1
            else:
                low = at
                residual_low = residual
                if last == -1:
                    residual_high *= 0.5
                last = -1
        dissipated_energy(modes, f, z, at, work, out)
        row = counts[entry.MARK]
        note_mark(motion, clock[entry.TIME] + at)
        for k in range(modes.part.shape[0]):
            marks[row, 2 + modes.part[k]] += out[k]


@kernel
def fly(modes, f, flight, motion, scratch):
    """Advance a motion by a flight. Returns False if the search for the peaks gave up, or if a block with very different rates
    overflows. Then only the peaks have changed."""
    z, counts, clock, peaks = motion.z, motion.counts, motion.clock, motion.peaks
    if flight == 0.0:
        return True
    work = scratch.work
    out = scratch.out
    integral_work = scratch.integral
    if peaks.shape[0]:
        if not peak_flight(flight_of(modes, f), modes.leave[f], z, flight, peaks, work[0, :0], scratch.peak, scratch.edge, work):
            return False
    path_state(flight_of(modes, f), z, flight, work[0])
    for r in range(z.shape[0]):
        if not abs(work[0, r]) < math.inf:
            return False
    # Equation (29): what the dampers take over the flight.
    total = dissipated_energy(modes, f, z, flight, integral_work, out) if modes.part.shape[0] else 0.0
    if total > 0.0 and counts[entry.MARK] < motion.marks.shape[0] and passes_mark(modes, total, motion):
        mark_flight(modes, f, flight, total, motion, integral_work, out)
        dissipated_energy(modes, f, z, flight, integral_work, out)
    for k in range(modes.part.shape[0]):
        add(motion.sums, modes.part[k], out[k])
    copy_1(work[0], z)
    advance_clock(modes, clock, motion.angles, flight)
    renew_loads(modes, motion, z)
    if modes.sticking[f] != 0:
        clock[entry.STICKING_TIME] += flight
    return True


@inlined
def lose(modes, c, loss, motion):
    """Add the loss of an impact at contact c."""
    counts, clock, sums, marks = motion.counts, motion.clock, motion.sums, motion.marks
    add(sums, modes.shape[1] + modes.contact_stop[c], loss)
    if counts[entry.MARK] < marks.shape[0]:
        total = dissipated(sums, modes.shape[1] + modes.shape[2])
        while counts[entry.MARK] < marks.shape[0] and total >= marks[counts[entry.MARK], 0] * clock[entry.INITIAL]:
            note_mark(motion, clock[entry.TIME])


@inlined
def stop_contact(modes, c, motion, work):
    """Set the remaining velocity across contact c to zero. Its energy is a loss at the stop."""
    clock = motion.clock
    times_matrix(modes.from_modes[0], motion.x, work[0])
    speed = row_dot(modes.rate[0], c, work[0, : modes.matrix.shape[1]])
    loss = 0.5 * modes.contact_mass[c] * speed * speed
    lose(modes, c, loss, motion)
    clock[entry.SPEED] = abs(speed)
    clock[entry.LOSS] = loss


@kernel
def log_chatter(modes, f, log, motion, before, scratch):
    """Log the interval of bounces that are summed as a series. It is one flight of the contact mode in which they end, up to the present
    state."""
    z, counts, clock = motion.z, motion.counts, motion.clock
    span = clock[entry.SPAN]
    clock[entry.SPAN] = 0.0
    row = counts[entry.EVENTS]
    if row >= log.numbers.shape[0]:
        return
    back = scratch.peak[5, 0]
    path_state(flight_of(modes, f), z, -span, back)
    log_event(log, entry.CHATTER, counts[entry.CONTACT], motion, before, back)
    log.values[row, 0] = clock[entry.TIME] - span
    dissipated_energy(modes, f, back, span, scratch.integral, scratch.out)
    for k in range(modes.part.shape[0]):
        log.sums[row, modes.part[k]] -= scratch.out[k]
