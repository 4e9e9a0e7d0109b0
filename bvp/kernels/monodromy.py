"""The monodromy of a closed orbit as the product of its flights and saltation matrices, and its multipliers without the trivial ones.

A flight acts on rows of all perturbations at once, and an impact adds a matrix of rank two,

    S = 1 - (1 + r) push rate + (f+ - R f-) g / (g . f-),     R = 1 - (1 + r) push rate

(Mueller, Chaos, Solitons & Fractals 5 (1995) 1671). Directions whose multipliers are known to be 1 are split off by reflections. The
product is known to rounding times its norm, so small multipliers beside large ones are lost: see `bvp.multipliers` for where it is used.
"""

import math
from typing import NamedTuple

import numpy as np

from bvp.kernels.compiled import chosen, inlined, kernel, long_loops
from bvp.kernels.dense import eigenvalues
from bvp.kernels.flight import Flight, block_matrix, copy_1, flow_pair, inner, set_1, set_2
from bvp.kernels.flights import energy_slope, flight_map, rate, slope_times, squared_speed
from bvp.kernels.newton import reflector
from bvp.kernels.smooth import SmoothFlight

_EQUAL = 1e9
"""Two moduli are equal whose logarithms agree, in units of 1/_EQUAL, rounded."""


GRADE = 30.0
"""Ratio of the sizes of eigenvalues up to which they are taken from a formed matrix."""

FORMED_LIMIT = 1e7
"""Norm of a formed matrix up to which its eigenvalues are taken, for eigenvalues of size 1."""

LOST, FOUND, EXACT = range(3)
"""What `formed_multipliers` found: nothing, eigenvalues of the product, or multipliers to the last digit."""


class Reduction(NamedTuple):
    """Scratch of `formed_multipliers`: N states, t trivial directions."""

    free: np.ndarray  # (f, n) orthonormal motions that no spring and no stop resists
    map: np.ndarray  # (N, N)
    square: np.ndarray  # (N, N)
    lines: np.ndarray  # (6, N)
    vectors: np.ndarray  # (t, N)
    scale: np.ndarray  # (N,) sizes of the states' entries
    weights: np.ndarray  # (N,) H = sum(weights z^2)/2


def make_reduction(free, weights, conservative):
    """Scratch for the orbits of a system."""
    size = len(weights)
    trivial = 2 + 2 * len(free) if conservative else 1
    return Reduction(
        free, np.zeros((size, size)), np.zeros((size, size)), np.zeros((6, size)), np.zeros((trivial, size)), np.ones(size), weights
    )


class EigenvalueWork(NamedTuple):
    """What `formed_multipliers` finds: m nontrivial multipliers."""

    matrix: np.ndarray  # (m, m) the map of the perturbations without the trivial ones
    work: np.ndarray  # (m, m) scratch
    values: np.ndarray  # (2, m) real and imaginary parts, by modulus descending, then by angle
    sums: np.ndarray  # (2, m) of a conservative system, lambda + 1/lambda of each pair: real and imaginary parts, m/2 columns


def make_eigenvalue_work(count):
    """Arrays for the given number of nontrivial multipliers."""
    square, row = (count, count), (2, count)
    return EigenvalueWork(np.empty(square), np.empty(square), np.empty(row), np.empty(row))


class ClosedOrbit(NamedTuple):
    """The nodes of a closed orbit: its impacts, and cuts of flights."""

    before: np.ndarray  # (P, N) states before each
    after: np.ndarray  # (P, N) and after it
    duration: np.ndarray  # (P,) of the flight after each
    contact: np.ndarray  # (P,) int64; -1 for a cut


class LinearisedOrbit(NamedTuple):
    """Flights and impacts of a closed orbit in numbers that each walk round it uses: P nodes, B blocks."""

    flight: np.ndarray  # (P, 4, B) the entries of exp(B t) of each pair, row by row; of smooth flights (P, N, N) their maps
    late: np.ndarray  # (P, N) of `arrival_sensitivity`, for the impact at its end


def make_linearised_orbit(nodes, size, flight):
    """Arrays for the orbits with this number of nodes, and flights of this kind."""
    shape = (4, len(flight.pairs)) if isinstance(flight, Flight) else (size, size)
    return LinearisedOrbit(np.zeros((nodes, *shape)), np.zeros((nodes, size)))


@chosen
def set_flight(flight, orbit, i, linearised):
    """Fill the entries of the flight after node i."""


@set_flight.of(SmoothFlight)
@inlined
def set_smooth_flight(flight, orbit, i, linearised):
    """See `set_flight`."""
    flight_map(flight, orbit.after[i], orbit.duration[i], linearised[i])


@set_flight.of(Flight)
@inlined
def set_linear_flight(flight, orbit, i, linearised):
    """See `set_flight`: (4, B) those of exp(B t), for each pair and each index alone."""
    pairs, mean, delta, matrix = flight
    t = orbit.duration[i]
    entries = linearised[i]
    if i > 0 and t == orbit.duration[i - 1]:
        for k in range(4):
            copy_1(linearised[i - 1, k], entries[k])
        return
    # Equation (23) for each block.
    for k in range(pairs.shape[0]):
        i = pairs[k, 0]
        j = pairs[k, 1]
        if j >= 0:
            e11, e12, e21, e22 = flow_pair(mean[k], delta[k], matrix[i, i], matrix[i, j], matrix[j, i], matrix[j, j], t)
            entries[0, k] = e11
            entries[1, k] = e12
            entries[2, k] = e21
            entries[3, k] = e22
        elif j == -1:
            entries[0, k] = math.exp(mean[k] * t)


@chosen
def linearised_flight(flight, t, entries, x, columns, square, line):
    """The first columns of x (N, N) after a flight. entries: of `set_flight`. Scratch: square (N, N), line (N,)."""


@linearised_flight.of(SmoothFlight)
@inlined
def linearised_smooth_flight(flight, t, entries, x, columns, square, line):
    """See `linearised_flight`."""
    size = entries.shape[0]
    for c in range(columns):
        for r in range(size):
            line[r] = x[r, c]
        for r in range(size):
            x[r, c] = inner(entries[r], line[:size])


@linearised_flight.of(Flight)
@inlined
def linearised_linear_flight(flight, t, entries, x, columns, square, line):
    """See `linearised_flight`: x <- exp(B t) x."""
    pairs, mean, _, matrix = flight
    for k in range(pairs.shape[0]):
        i = pairs[k, 0]
        j = pairs[k, 1]
        if j >= 0:
            e11 = entries[0, k]
            e12 = entries[1, k]
            e21 = entries[2, k]
            e22 = entries[3, k]
            for c in range(columns):
                a = x[i, c]
                b = x[j, c]
                x[i, c] = e11 * a + e12 * b
                x[j, c] = e21 * a + e22 * b
        elif j == -1:
            factor = entries[0, k]
            for c in range(columns):
                x[i, c] *= factor
        else:
            last = i - j
            block_matrix(matrix, i, -j, t, square)
            for c in range(columns):
                for r in range(i, last):
                    line[r] = x[r, c]
                for r in range(i, last):
                    x[r, c] = inner(square[r, i:last], line[i:last])


@inlined
def arrival_sensitivity(flight, contacts, contact, before, after, coming, late):
    """late <- (f+ - R f-)/(g . f-) of an impact: its change of a perturbation that arrives late. coming (N,): scratch."""
    size = late.shape[0]
    jump = contacts.jump[contact]
    rate(flight, before, coming)
    rate(flight, after, late)
    speed = 0.0
    turned = 0.0
    for r in range(size):
        speed += contacts.gap[contact, r] * coming[r]
        turned += contacts.rate[contact, r] * coming[r]
    for r in range(size):
        late[r] = (late[r] - coming[r] + jump * turned * contacts.push[contact, r]) / speed


@inlined
def linearised_impact(contacts, contact, late, x, columns, lines):
    """x <- S x at an impact, the first columns of x (N, N) at once. late: of `arrival_sensitivity`. lines (2, N): scratch."""
    size = x.shape[0]
    jump = contacts.jump[contact]
    lateness = lines[0]
    kick = lines[1]
    set_1(lateness, 0.0)
    set_1(kick, 0.0)
    for r in range(size):
        gap = contacts.gap[contact, r]
        rate = jump * contacts.rate[contact, r]
        if gap != 0.0:
            for c in range(columns):
                lateness[c] += gap * x[r, c]
        if rate != 0.0:
            for c in range(columns):
                kick[c] += rate * x[r, c]
    for r in range(size):
        a = late[r]
        b = contacts.push[contact, r]
        for c in range(columns):
            x[r, c] += a * lateness[c] - b * kick[c]


@inlined
def _set_scale(flight, orbit, conservative, weights, scale):
    """Sizes of displacements and velocities, the latter of a conservative system by sqrt(2 h): an impact may be its only slow part."""
    size = scale.shape[0]
    half = size // 2
    for first in range(0, size, half):
        largest = 0.0
        for i in range(orbit.before.shape[0]):
            for r in range(first, first + half):
                largest = max(largest, abs(orbit.before[i, r]))
        if first > 0 and conservative:
            largest = math.sqrt(squared_speed(flight, weights, orbit.after[0]))
        for r in range(first, first + half):
            scale[r] = largest if largest > 0.0 else 1.0


@inlined
def trivial_rows(flight, orbit, conservative, work):
    """Fill work.vectors, in states divided by their scale: the flow at node 0; of a conservative system also the gradient of the energy and
    the displacements and velocities of the free motions."""
    free, vectors, scale, weights = work.free, work.vectors, work.scale, work.weights
    size = scale.shape[0]
    half = size // 2
    rate(flight, orbit.after[0], vectors[0])
    for r in range(size):
        vectors[0, r] /= scale[r]
    if conservative:
        slope = energy_slope(flight, weights, orbit.after[0], 1.0)
        for r in range(size):
            vectors[1, r] = slope_times(slope, r, 1.0) * scale[r]
        for f in range(free.shape[0]):
            for part_of_state in range(2):
                row = vectors[2 + 2 * f + part_of_state]
                set_1(row, 0.0)
                for r in range(half):
                    row[part_of_state * half + r] = free[f, r]


@inlined
def _reduce(vectors, x, line):
    """x <- H x H with the reflections H of the rows of `vectors` (t, N), which are overwritten, one after the other: the first t rows and
    columns belong to them."""
    size = x.shape[0]
    for k in range(vectors.shape[0]):
        v = vectors[k]
        _, factor = reflector(v, k, size)
        if factor == 0.0:
            continue
        for other in range(k + 1, vectors.shape[0]):
            total = 0.0
            for r in range(k, size):
                total += v[r] * vectors[other, r]
            for r in range(k, size):
                vectors[other, r] -= factor * total * v[r]
        set_1(line, 0.0)
        for r in range(k, size):
            for c in range(size):
                line[c] += v[r] * x[r, c]
        for r in range(k, size):
            total = factor * v[r]
            for c in range(size):
                x[r, c] -= total * line[c]
        for r in range(size):
            total = 0.0
            for c in range(k, size):
                total += x[r, c] * v[c]
            total *= factor
            for c in range(k, size):
                x[r, c] -= total * v[c]


@inlined
def sort_by_modulus(values, keys):
    """Sort by modulus descending, then by angle ascending from -pi."""
    for i in range(values.shape[1]):
        x = values[0, i]
        y = values[1, i]
        modulus = math.hypot(x, y)
        size = float(math.floor(_EQUAL * math.log(modulus) + 0.5)) if 0.0 < modulus < math.inf else -math.inf
        angle = math.atan2(y, x)
        at = i
        while at > 0 and (keys[0, at - 1] < size or (keys[0, at - 1] == size and keys[1, at - 1] > angle)):
            for k in range(2):
                values[k, at] = values[k, at - 1]
                keys[k, at] = keys[k, at - 1]
            at -= 1
        values[0, at] = x
        values[1, at] = y
        keys[0, at] = size
        keys[1, at] = angle


@inlined
def _pairing(values, sums):
    """Largest |product - 1| over the pairs: each multiplier, from the first on, with the one whose product with it is nearest to 1. The
    first m/2 columns of `sums` (2, m) become the traces of the pairs: real and imaginary parts."""
    count = values.shape[1]
    worst = 0.0
    found = 0
    taken = sums[1]
    set_1(taken, 0.0)
    for i in range(count):
        if taken[i] != 0.0:
            continue
        nearest = math.inf
        partner = -1
        for j in range(i + 1, count):
            if taken[j] == 0.0:
                x = values[0, i] * values[0, j] - values[1, i] * values[1, j] - 1.0
                y = values[0, i] * values[1, j] + values[1, i] * values[0, j]
                distance = math.hypot(x, y)
                if distance < nearest:
                    nearest = distance
                    partner = j
        if partner < 0:
            return math.inf
        taken[partner] = -1.0
        taken[i] = 1.0 + partner
        worst = max(worst, nearest)
    for i in range(count):
        if taken[i] > 0.0:
            partner = int(taken[i]) - 1
            sums[0, found] = values[0, i] + values[0, partner]
            sums[1, found] = values[1, i] + values[1, partner]
            found += 1
    return worst


@kernel
def order_multipliers(values, sums, paired):
    """Sort multipliers, and return the largest defect of a pair where they come in pairs. See `EigenvalueWork` for the arrays."""
    sort_by_modulus(values, sums)
    return _pairing(values, sums) if paired else 0.0


@long_loops
def formed_multipliers(flight, contacts, orbit, conservative, scaled, work, linearised, spectrum):
    """Multipliers of a closed orbit from its monodromy M, into `spectrum`.

    contacts: `bvp.kernels.pencil.ContactRows`. scaled: whether displacements and velocities are divided by their sizes. linearised: is
    filled. Returns (LOST, FOUND or EXACT; norm of the reduced map; |(M - I) f|/|f| for the flow f; |grad H (M - I)|/|grad H|; largest
    defect of a pair); the last two only for a conservative system."""
    _, x, square, lines, vectors, scale, weights = work
    size = x.shape[0]
    nodes = orbit.after.shape[0]
    if scaled:
        _set_scale(flight, orbit, conservative, weights, scale)
    set_2(x, 0.0)
    for r in range(size):
        x[r, r] = scale[r]
    for i in range(nodes):
        j = i + 1 if i + 1 < nodes else 0
        t = orbit.duration[i]
        set_flight(flight, orbit, i, linearised.flight)
        linearised_flight(flight, t, linearised.flight[i], x, size, square, lines[0])
        contact = orbit.contact[j]
        if contact >= 0:
            arrival_sensitivity(flight, contacts, contact, orbit.before[j], orbit.after[j], lines[0], linearised.late[i])
            linearised_impact(contacts, contact, linearised.late[i], x, size, lines[2:])
        else:
            set_1(linearised.late[i], 0.0)
    trivial_rows(flight, orbit, conservative, work)
    first = vectors[0]
    for r in range(size):
        for c in range(size):
            x[r, c] /= scale[r]
    flow = 0.0
    length = 0.0
    for r in range(size):
        flow += (inner(x[r], first) - first[r]) ** 2
        length += first[r] ** 2
    flow = math.sqrt(flow / length)
    level = 0.0
    if conservative:
        slope = vectors[1]
        set_1(lines[0], 0.0)
        length = 0.0
        for r in range(size):
            length += slope[r] ** 2
            for c in range(size):
                lines[0, c] += slope[r] * x[r, c]
        for c in range(size):
            level += (lines[0, c] - slope[c]) ** 2
        level = math.sqrt(level / length)
    _reduce(vectors, x, lines[0])
    matrix, again, values, sums = spectrum
    split = vectors.shape[0]
    norm = 0.0
    for r in range(matrix.shape[0]):
        copy_1(x[split + r, split:], matrix[r])
        copy_1(matrix[r], again[r])
        for c in range(matrix.shape[0]):
            norm += matrix[r, c] ** 2
    norm = math.sqrt(norm)
    if not norm < math.inf or not eigenvalues(again, values[0], values[1]):
        return LOST, norm, flow, level, math.inf
    pairing = order_multipliers(values, sums, conservative)
    last = values.shape[1] - 1
    if last < 0 or (
        norm < FORMED_LIMIT and math.hypot(values[0, 0], values[1, 0]) <= GRADE * math.hypot(values[0, last], values[1, last])
    ):
        return EXACT, norm, flow, level, pairing
    return FOUND, norm, flow, level, pairing
