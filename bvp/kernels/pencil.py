"""The saddle-point matrix of a closed orbit, reduced by orthogonal transformations to a product pencil, and its multipliers.

Linearised about an orbit with impacts i = 0 .. P-1 (states z_i after each, free times t_i), the problem reads

    dz_{i+1} = J_i dz_i + F_i dt_i,     g_{i+1} . dz_{i+1} = 0,     J_i = R exp(B t_i),  F_i = R B z(t_i)

closed by dz_P = lambda dz_0. The flight times are the multipliers of the gap constraints. Orthogonal bases N_i of the
admissible perturbations (tangent to the stop; for a conserved energy also to its level) and Q_i of the rows that annihilate F_i
turn it into

    E_i y_{i+1} = A_i y_i,     A_i = Q_i J_i N_i,     E_i = Q_i N_{i+1}

whose cyclic product has the nontrivial Floquet multipliers as eigenvalues. E_i is singular only where an impact grazes; no
inverse is formed: an orthogonal sweep (periodic QR without shifts; Fairgrieve & Jepson, SIAM J. Numer. Anal. 28 (1991) 1446; Lust, Int. J.
Bifurcation Chaos 11 (2001) 2389) keeps every factor triangular, so that small multipliers survive beside large ones.

A node may also be a plain cut of a flight (no contact): it constrains nothing and its duration is fixed. The pencil is then
rectangular there; `cuts` marks such nodes.
"""

import math

import numpy as np

from bvp.kernels.arrays import set_2
from bvp.kernels.compiled import allocating, kernel, part
from bvp.kernels.flight import flow_matrix, rate

__all__ = ["complement", "landing_map", "landings", "pencil", "sweep", "trivial_directions"]


@kernel
def complement(vectors, count, out, factor):
    """Rows of `out` (N - count, N): orthonormal basis of the complement of the first `count` rows of `vectors` (overwritten).
    `factor` (>= count,): scratch."""
    size = vectors.shape[1]
    for c in range(count):
        column = vectors[c]
        total = 0.0
        for r in range(c + 1, size):
            total += column[r] * column[r]
        head = column[c]
        if total == 0.0:
            factor[c] = 0.0
            continue
        norm = math.sqrt(head * head + total)
        head = head + norm if head > 0.0 else head - norm
        column[c] = head
        factor[c] = 2.0 / (head * head + total)
        for other in range(c + 1, count):
            inner = 0.0
            for r in range(c, size):
                inner += column[r] * vectors[other, r]
            inner *= factor[c]
            for r in range(c, size):
                vectors[other, r] -= inner * column[r]
    for b in range(size - count):
        x = out[b]
        for r in range(size):
            x[r] = 0.0
        x[count + b] = 1.0
        for c in range(count - 1, -1, -1):
            if factor[c] != 0.0:
                inner = 0.0
                for r in range(c, size):
                    inner += vectors[c, r] * x[r]
                inner *= factor[c]
                for r in range(c, size):
                    x[r] -= inner * vectors[c, r]


@part
def landing_map(pairs, mean, delta, matrix, gap_rate, push, jump, duration, before, scale, landing, along):
    """landing = R exp(B t), along = R B z(t), in states divided by `scale`; jump = 0 leaves the impact out."""
    size = matrix.shape[0]
    flow_matrix(pairs, mean, delta, matrix, duration, landing)
    rate(pairs, matrix, before, along)
    if jump != 0.0:
        speed = 0.0
        for r in range(size):
            speed += gap_rate[r] * along[r]
        for r in range(size):
            along[r] -= jump * speed * push[r]
        for c in range(size):
            total = 0.0
            for r in range(size):
                total += gap_rate[r] * landing[r, c]
            for r in range(size):
                landing[r, c] -= jump * total * push[r]
    for r in range(size):
        along[r] /= scale[r]
        for c in range(size):
            landing[r, c] *= scale[c] / scale[r]


@part
def _constraints(gap, weights, after, scale, conservative, free, vectors):
    """Rows that a perturbation of a node is orthogonal to; returns how many."""
    size = after.shape[0]
    count = 0
    if not free:
        for r in range(size):
            vectors[count, r] = gap[r] * scale[r]
        count += 1
    if conservative:
        for r in range(size):
            vectors[count, r] = weights[r] * after[r] * scale[r]
        count += 1
    return count


@kernel
def landings(pairs, mean, delta, matrix, gap_rate, push, jump, before, duration, row, scale, maps, along):
    """maps (P, N, N) and along (P, N): J_i and F_i of the flight after each node, which lands on the next."""
    nodes = duration.shape[0]
    for i in range(nodes):
        j = i + 1 if i + 1 < nodes else 0
        contact = max(row[j], 0)
        landing_map(
            pairs, mean, delta, matrix, gap_rate[contact], push[contact], 0.0 if row[j] < 0 else jump[contact], duration[i],
            before[j], scale, maps[i], along[i],
        )


@allocating
def pencil(weights, gap, conservative, after, row, scale, maps, along, left, right):
    """Factors of the product pencil: left[i] = E_i, right[i] = A_i. The arrays are (P, N, N); factor i uses the first rows and
    columns: E_i is (m_i, d_{i+1}) and A_i is (m_i, d_i), where d = N less the constraints of a node and m_i = d_{i+1}, or for a cut
    m_i = d_{i+1} of an unconstrained node. row[i] < 0 marks a cut. maps, along: of `landings`."""
    nodes, size = after.shape
    turned = np.empty(size)
    vectors = np.empty((2, size))
    basis = np.empty((size, size))
    following = np.empty((size, size))
    rows = np.empty((size, size))
    factor = np.empty(2)
    count = _constraints(gap[max(row[0], 0)], weights, after[0], scale, conservative, row[0] < 0, vectors)
    complement(vectors, count, basis, factor)
    dimension = size - count
    for i in range(nodes):
        j = i + 1 if i + 1 < nodes else 0
        contact = max(row[j], 0)
        cut = row[j] < 0
        count = _constraints(gap[contact], weights, after[j], scale, conservative, cut, vectors)
        complement(vectors, count, following, factor)
        next_dimension = size - count
        count = 0
        if not cut:
            for r in range(size):
                vectors[0, r] = along[i, r]
            count = 1
        if conservative:
            for r in range(size):
                vectors[count, r] = weights[r] * after[j, r] * scale[r]
            count += 1
        complement(vectors, count, rows, factor)
        height = size - count
        for a in range(height):
            for b in range(next_dimension):
                total = 0.0
                for r in range(size):
                    total += rows[a, r] * following[b, r]
                left[i, a, b] = total
            for c in range(size):
                total = 0.0
                for r in range(size):
                    total += rows[a, r] * maps[i, r, c]
                turned[c] = total
            for b in range(dimension):
                total = 0.0
                for r in range(size):
                    total += turned[r] * basis[b, r]
                right[i, a, b] = total
        dimension = next_dimension
        basis, following = following, basis


@kernel
def _rotation(a, b):
    """c, s with c a + s b = r, -s a + c b = 0."""
    if b == 0.0:
        return 1.0, 0.0
    r = math.hypot(a, b)
    return a / r, b / r


@kernel
def sweep(left, right, height, width, turns, scratch, frame, product, exponent):
    """One orthogonal sweep round the cycle, which runs through the given factors `turns` times. scratch (4, N, N).

    frame (d_0, w): orthonormal columns at node 0, replaced by those that node P is reached with. height[i], width[i] = (m_i, d_{i+1}).
    product (w, w): upper triangular product of the factors U_i^-1 T_i, scaled by 2^-exponent[j] in row j. Returns the number of
    singular factors met (grazing impacts)."""
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
    here = frame.shape[0]
    for r in range(here):
        for c in range(w):
            current[r, c] = frame[r, c]
    for count in range(turns * nodes):
        i = count % nodes
        m = height[i]
        d = width[i]
        for a in range(m):
            for c in range(w):
                total = 0.0
                for r in range(here):
                    total += right[i, a, r] * current[r, c]
                top[a, c] = total
            for b in range(d):
                e[a, b] = left[i, a, b]
        for c in range(w):
            for r in range(m - 1, c, -1):
                if top[r, c] == 0.0:
                    continue
                cs, sn = _rotation(top[r - 1, c], top[r, c])
                for b in range(c, w):
                    p = top[r - 1, b]
                    q = top[r, b]
                    top[r - 1, b] = cs * p + sn * q
                    top[r, b] = cs * q - sn * p
                for b in range(d):
                    p = e[r - 1, b]
                    q = e[r, b]
                    e[r - 1, b] = cs * p + sn * q
                    e[r, b] = cs * q - sn * p
        for a in range(d):
            for b in range(d):
                y[a, b] = 1.0 if a == b else 0.0
        for r in range(d - 1, -1, -1):
            for c in range(r):
                if e[r, c] == 0.0:
                    continue
                cs, sn = _rotation(e[r, r], e[r, c])
                for a in range(m):
                    p = e[a, r]
                    q = e[a, c]
                    e[a, r] = cs * p + sn * q
                    e[a, c] = cs * q - sn * p
                for a in range(d):
                    p = y[a, r]
                    q = y[a, c]
                    y[a, r] = cs * p + sn * q
                    y[a, c] = cs * q - sn * p
        for a in range(d):
            for c in range(w):
                current[a, c] = y[a, c]
        here = d
        for c in range(w):
            for b in range(c, w):
                total = 0.0
                for a in range(c, b + 1):
                    total += top[c, a] * product[a, b] * (2.0 ** (exponent[a] - exponent[c]) if scaled else 1.0)
                product[c, b] = total
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
    for r in range(here):
        for c in range(w):
            frame[r, c] = current[r, c]
    return singular


@allocating
def trivial_directions(pairs, matrix, weights, gap, after, row, turns, scale, maps, along):
    """How well the product of saltation matrices, `turns` times round the given nodes, keeps the flow and the energy:
    (|(M - I) f|/|f|, |grad H (M - I)|/|grad H|)."""
    nodes, size = after.shape
    first = np.empty(size)
    flow = np.empty(size)
    work = np.empty(size)
    field = np.empty(size)
    rate(pairs, matrix, after[0], first)
    for r in range(size):
        first[r] /= scale[r]
        flow[r] = first[r]
    for count in range(turns * nodes):
        i = count % nodes
        j = i + 1 if i + 1 < nodes else 0
        contact = max(row[j], 0)
        cut = row[j] < 0
        for a in range(size):
            total = 0.0
            for r in range(size):
                total += maps[i, a, r] * flow[r]
            work[a] = total
        if not cut:
            rate(pairs, matrix, after[j], field)
            hit = 0.0
            speed = 0.0
            for r in range(size):
                hit += gap[contact, r] * scale[r] * work[r]
                speed += gap[contact, r] * scale[r] * along[i, r]
            for r in range(size):
                work[r] += (field[r] / scale[r] - along[i, r]) * hit / speed
        for r in range(size):
            flow[r] = work[r]
    length = 0.0
    defect = 0.0
    for r in range(size):
        length += first[r] ** 2
        defect += (flow[r] - first[r]) ** 2
    kept_flow = math.sqrt(defect / length)
    for r in range(size):
        first[r] = weights[r] * after[0, r] * scale[r]
        flow[r] = first[r]
    for count in range(turns * nodes - 1, -1, -1):
        i = count % nodes
        j = i + 1 if i + 1 < nodes else 0
        contact = max(row[j], 0)
        cut = row[j] < 0
        if not cut:
            rate(pairs, matrix, after[j], field)
            turned = 0.0
            speed = 0.0
            for r in range(size):
                turned += flow[r] * (field[r] / scale[r] - along[i, r])
                speed += gap[contact, r] * scale[r] * along[i, r]
            for r in range(size):
                flow[r] += turned / speed * gap[contact, r] * scale[r]
        for c in range(size):
            total = 0.0
            for r in range(size):
                total += flow[r] * maps[i, r, c]
            work[c] = total
        for r in range(size):
            flow[r] = work[r]
    length = 0.0
    defect = 0.0
    for r in range(size):
        length += first[r] ** 2
        defect += (flow[r] - first[r]) ** 2
    return kept_flow, math.sqrt(defect / length)
