"""The saddle-point matrix (12) of a closed orbit, reduced to the product pencil (31), and the sweeps that find its eigenvalues.

Linearised about an orbit with impacts i = 0 .. P-1 (states z_i after each, free times t_i), the problem reads

    dz_{i+1} = J_i dz_i + F_i dt_i,     g_{i+1} . dz_{i+1} = 0,     J_i = R exp(B t_i),  F_i = R B z(t_i)

closed by dz_P = lambda dz_0. The flight times are the multipliers of the gap constraints. Orthogonal bases N_i of the
admissible perturbations (tangent to the stop; for a conserved energy also to its level) and Q_i of the rows that annihilate F_i
turn it into

    E_i y_{i+1} = A_i y_i,     A_i = Q_i J_i N_i,     E_i = Q_i N_{i+1}

whose cyclic product has the nontrivial Floquet multipliers as eigenvalues. E_i is singular only where an
impact grazes; no inverse is formed.

`orthogonal_sweep` is periodic QR without shifts (Fairgrieve & Jepson, SIAM J. Numer. Anal. 28 (1991) 1446; Lust, Int. J. Bifurcation
Chaos 11 (2001) 2389): every factor is kept triangular, so that small multipliers survive beside large ones.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy import int64

from bvp.kernels import smooth  # noqa: F401  a kind of flight
from bvp.kernels.compiled import inlined
from bvp.kernels.contact_mode import land
from bvp.kernels.flight import copy_1, inner, set_1, set_2, times_matrix
from bvp.kernels.flights import energy_slope, flight_map, rate, slope_times
from bvp.kernels.newton import reflect, reflector


@inlined
def complement(vectors, count, out, factor):
    """Rows of `out` (N - count, N): orthonormal basis of the complement of the first `count` rows of `vectors` (overwritten).
    `factor` (>= count,): scratch."""
    size = vectors.shape[1]
    # Householder's reflections of the vectors; their complement is the image of the other axes.
    for c in range(count):
        _, factor[c] = reflector(vectors[c], c, size)
        if factor[c] != 0.0:
            for other in range(c + 1, count):
                reflect(vectors[c], c, size, factor[c], vectors[other], int64(0))
    for b in range(size - count):
        x = out[b]
        set_1(x, 0.0)
        x[count + b] = 1.0
        for c in range(count - 1, -1, -1):
            if factor[c] != 0.0:
                reflect(vectors[c], c, size, factor[c], x, int64(0))


@inlined
def _constraints(flight, gap, weights, after, scale, conservative, vectors):
    """Rows that a perturbation of a node is orthogonal to; returns how many."""
    size = after.shape[0]
    for r in range(size):
        vectors[0, r] = gap[r] * scale[r]
    count = 1
    if conservative:
        slope = energy_slope(flight, weights, after, 1.0)
        for r in range(size):
            vectors[count, r] = slope_times(slope, r, 1.0) * scale[r]
        count += 1
    return count


@inlined
def _leave_out(free, count, vectors):
    """Append the displacements and velocities of the motions `free` (f, n) to the first `count` rows; returns how many there are then."""
    half = vectors.shape[1] // 2
    for f in range(free.shape[0]):
        for first in range(0, 2 * half, half):
            set_1(vectors[count], 0.0)
            for r in range(half):
                vectors[count, first + r] = free[f, r]
            count += 1
    return count


class ContactRows(NamedTuple):
    """The contacts that the rows of a cycle's nodes count."""

    gap: np.ndarray  # (m, N) g
    rate: np.ndarray  # (m, N) g B
    push: np.ndarray  # (m, N)
    jump: np.ndarray  # (m,) 1 + restitution


class Nodes(NamedTuple):
    """The nodes of a closed orbit: its impacts."""

    before: np.ndarray  # (P, N) states before each
    after: np.ndarray  # (P, N) and after it
    duration: np.ndarray  # (P,) of the flight after each
    row: np.ndarray  # (P,) int64 contact
    scale: np.ndarray  # (N,) sizes of the states' entries
    weights: np.ndarray  # (N,) H = sum(weights z^2)/2


class Linearised(NamedTuple):
    """J_i and F_i of the flight after each node, which lands on the next, in states divided by their scale."""

    maps: np.ndarray  # (P, N, N)
    along: np.ndarray  # (P, N)


class Factors(NamedTuple):
    """A product pencil: each factor (d, d) is the first rows and columns of its array."""

    left: np.ndarray  # (P, N, N) E_i
    right: np.ndarray  # (P, N, N) A_i


@inlined
def landings(flight, contacts, cycle, linear):
    """Fill `linear` for the nodes of a cycle."""
    maps, along = linear
    before, duration, row, scale = cycle.before, cycle.duration, cycle.row, cycle.scale
    nodes, size = along.shape
    # Equation (27): J_i and F_i, in scaled states.
    for i in range(nodes):
        j = i + 1 if i + 1 < nodes else 0
        flight_map(flight, cycle.after[i], duration[i], maps[i])
        land(flight, contacts.rate, contacts.push, row[j], contacts.jump[row[j]], before[j], maps[i], along[i])
        for r in range(size):
            along[i, r] /= scale[r]
            for c in range(size):
                maps[i, r, c] *= scale[c] / scale[r]


@inlined
def pencil(flight, contacts, cycle, conservative, free, linear, factors, scratch, factor):
    """Fill the left and right `factors` of the product pencil, without the f motions `free` (f, n) that no spring and no stop resists;
    None: there are none.

    E_i and A_i are (d, d), where d = N - 2 f less the constraints of a node.
    linear: of `landings`. scratch (5, max(N, 2), N), factor (2 + 2 f,)."""
    gap, weights = contacts.gap, cycle.weights
    after, row, scale = cycle.after, cycle.row, cycle.scale
    maps, along = linear
    left, right = factors.left, factors.right
    nodes, size = after.shape
    basis = scratch[0]
    following = scratch[1]
    rows = scratch[2]
    vectors = scratch[3]
    image = scratch[4, 0]
    count = _constraints(flight, gap[row[0]], weights, after[0], scale, conservative, vectors)
    if free is not None:
        count = _leave_out(free, count, vectors)
    complement(vectors, count, basis, factor)
    dimension = size - count
    for i in range(nodes):
        j = i + 1 if i + 1 < nodes else 0
        count = _constraints(flight, gap[row[j]], weights, after[j], scale, conservative, vectors)
        if free is not None:
            count = _leave_out(free, count, vectors)
        complement(vectors, count, following, factor)
        # Q_i of equation (31): the rows that annihilate F_i, and the energy's gradient.
        copy_1(along[i], vectors[0])
        count = 1
        if conservative:
            slope = energy_slope(flight, weights, after[j], 1.0)
            for r in range(size):
                vectors[count, r] = slope_times(slope, r, 1.0) * scale[r]
            count += 1
        if free is not None:
            count = _leave_out(free, count, vectors)
        complement(vectors, count, rows, factor)
        # E_i and A_i of equation (31).
        for a in range(dimension):
            for b in range(dimension):
                left[i, a, b] = inner(rows[a], following[b])
            for c in range(size):
                image[c] = inner(rows[a], maps[i, :, c])
            for b in range(dimension):
                right[i, a, b] = inner(image, basis[b])
        basis, following = following, basis


@inlined
def departure(first, last):
    """|last - first|/|first|."""
    length = 0.0
    defect = 0.0
    for r in range(first.shape[0]):
        length += first[r] ** 2
        defect += (last[r] - first[r]) ** 2
    return math.sqrt(defect / length)


@inlined
def trivial_directions(flight, contacts, cycle, repeats, linear, scratch):
    """How well the product of saltation matrices, `repeats` times round the given nodes, keeps the flow and the energy:
    (|(M - I) f|/|f|, |grad H (M - I)|/|grad H|). scratch (4, N)."""
    gap, weights = contacts.gap, cycle.weights
    after, row, scale = cycle.after, cycle.row, cycle.scale
    maps, along = linear
    nodes, size = after.shape
    first = scratch[0]
    flow = scratch[1]
    work = scratch[2]
    field = scratch[3]
    rate(flight, after[0], first)
    for r in range(size):
        first[r] /= scale[r]
        flow[r] = first[r]
    # The flow from node to node, by the saltation matrices.
    for count in range(repeats * nodes):
        i = count % nodes
        j = i + 1 if i + 1 < nodes else 0
        contact = row[j]
        times_matrix(maps[i], flow, work)
        rate(flight, after[j], field)
        hit = 0.0
        speed = 0.0
        for r in range(size):
            hit += gap[contact, r] * scale[r] * work[r]
            speed += gap[contact, r] * scale[r] * along[i, r]
        for r in range(size):
            work[r] += (field[r] / scale[r] - along[i, r]) * hit / speed
        copy_1(work, flow)
    kept_flow = departure(first, flow)
    slope = energy_slope(flight, weights, after[0], 1.0)
    for r in range(size):
        first[r] = slope_times(slope, r, 1.0) * scale[r]
        flow[r] = first[r]
    # The energy's gradient, backwards.
    for count in range(repeats * nodes - 1, -1, -1):
        i = count % nodes
        j = i + 1 if i + 1 < nodes else 0
        contact = row[j]
        rate(flight, after[j], field)
        along_flow = 0.0
        speed = 0.0
        for r in range(size):
            along_flow += flow[r] * (field[r] / scale[r] - along[i, r])
            speed += gap[contact, r] * scale[r] * along[i, r]
        for r in range(size):
            flow[r] += along_flow / speed * gap[contact, r] * scale[r]
        for c in range(size):
            work[c] = inner(flow, maps[i, :, c])
        copy_1(work, flow)
    return kept_flow, departure(first, flow)


@inlined
def rotation(a, b):
    """c, s with c a + s b = r, -s a + c b = 0."""
    if b == 0.0:
        return 1.0, 0.0
    r = math.hypot(a, b)
    return a / r, b / r


@inlined
def orthogonal_sweep(factors, repeats, scratch, frame, product, exponent):
    """One orthogonal sweep round the cycle, which runs through the given factors `repeats` times. scratch (4, N, N).

    frame (w, w): orthonormal columns at node 0, replaced by those that node P is reached with.
    product (w, w): upper triangular product of the factors U_i^-1 T_i, scaled by 2^-exponent[j] in row j. Returns the number of
    singular factors met (grazing impacts)."""
    left, right = factors
    w = frame.shape[1]
    nodes = left.shape[0]
    singular = 0
    scaled = False
    top = scratch[0]
    e = scratch[1]
    y = scratch[2]
    current = scratch[3]
    set_2(product, 0.0)
    for c in range(w):
        product[c, c] = 1.0
        exponent[c] = 0.0
    for r in range(w):
        copy_1(frame[r], current[r, :w])
    for count in range(repeats * nodes):
        i = count % nodes
        for a in range(w):
            for c in range(w):
                top[a, c] = inner(right[i, a, :w], current[:w, c])
            copy_1(left[i, a], e[a, :w])
        for c in range(w):
            # Rotations of the rows make A_i times the frame triangular.
            for r in range(w - 1, c, -1):
                if top[r, c] == 0.0:
                    continue
                cs, sn = rotation(top[r - 1, c], top[r, c])
                for b in range(c, w):
                    p = top[r - 1, b]
                    q = top[r, b]
                    top[r - 1, b] = cs * p + sn * q
                    top[r, b] = cs * q - sn * p
                for b in range(w):
                    p = e[r - 1, b]
                    q = e[r, b]
                    e[r - 1, b] = cs * p + sn * q
                    e[r, b] = cs * q - sn * p
        for a in range(w):
            for b in range(w):
                y[a, b] = 1.0 if a == b else 0.0
        # Rotations of the columns make E_i triangular; they turn the next frame.
        for r in range(w - 1, -1, -1):
            for c in range(r):
                if e[r, c] == 0.0:
                    continue
                cs, sn = rotation(e[r, r], e[r, c])
                for a in range(w):
                    p = e[a, r]
                    q = e[a, c]
                    e[a, r] = cs * p + sn * q
                    e[a, c] = cs * q - sn * p
                for a in range(w):
                    p = y[a, r]
                    q = y[a, c]
                    y[a, r] = cs * p + sn * q
                    y[a, c] = cs * q - sn * p
        for a in range(w):
            copy_1(y[a], current[a, :w])
        for c in range(w):
            for b in range(c, w):
                total = 0.0
                for a in range(c, b + 1):
                    total += top[c, a] * product[a, b] * (2.0 ** (exponent[a] - exponent[c]) if scaled else 1.0)
                product[c, b] = total
        # product <- U^-1 T product, row by row, with its powers of two kept apart.
        for c in range(w - 1, -1, -1):
            if e[c, c] == 0.0:
                singular += 1
                continue
            for b in range(c, w):
                total = product[c, b]
                for a in range(c + 1, b + 1):
                    total -= e[c, a] * product[a, b] * (2.0 ** (exponent[a] - exponent[c]) if scaled else 1.0)
                product[c, b] = total / e[c, c]
            largest = 0.0
            for b in range(c, w):
                largest = max(largest, abs(product[c, b]))
            if largest > 1e100 or (0.0 < largest < 1e-100):
                shift = math.floor(math.log2(largest))
                exponent[c] += shift
                scaled = True
                for b in range(c, w):
                    product[c, b] *= 2.0**-shift
    for r in range(w):
        copy_1(current[r], frame[r])
    return singular
