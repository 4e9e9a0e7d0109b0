"""The saddle-point matrix of a closed orbit, reduced by orthogonal transformations to a product pencil.

Linearised about an orbit with impacts i = 0 .. P-1 (states z_i after each, free times t_i), the problem reads

    dz_{i+1} = J_i dz_i + F_i dt_i,     g_{i+1} . dz_{i+1} = 0,     J_i = R exp(B t_i),  F_i = R B z(t_i)

closed by dz_P = lambda dz_0. The flight times are the multipliers of the gap constraints. Orthogonal bases N_i of the
admissible perturbations (tangent to the stop; for a conserved energy also to its level) and Q_i of the rows that annihilate F_i
turn it into

    E_i y_{i+1} = A_i y_i,     A_i = Q_i J_i N_i,     E_i = Q_i N_{i+1}

whose cyclic product has the nontrivial Floquet multipliers as eigenvalues: `bvp.kernels.sweep` finds them. E_i is singular only where an
impact grazes; no inverse is formed.

A node may also be a plain cut of a flight (no contact): it constrains nothing and its duration is fixed. The pencil is then
rectangular there; `cuts` marks such nodes.
"""

import math

from bvp.kernels.compiled import inlined, kernel, part, sized
from bvp.kernels.flight import block_product, flow_matrix
from bvp.kernels.restitution import strike, strike_columns

__all__ = ["complement", "landing_map", "landings", "pencil", "planar_landings", "planar_pencil"]


@part
def _complement(vectors, count, out, factor):
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


@kernel
def complement(vectors, count, out, factor):
    """See `_complement`."""
    _complement(vectors, count, out, factor)


@inlined
def planar_complement(vectors, count, out, factor):
    """See `_complement`; N = 4."""
    _complement(sized(vectors, 4), count, sized(out, 4), factor)


@part
def landing_map(pairs, mean, delta, matrix, gap_rate, push, contact, jump, duration, before, scale, landing, along):
    """landing = R exp(B t), along = R B z(t), in states divided by `scale`; jump = 0 leaves the impact out."""
    size = along.shape[0]
    flow_matrix(pairs, mean, delta, matrix, duration, landing)
    block_product(pairs, matrix, before, along)
    if jump != 0.0:
        strike(gap_rate, push, contact, jump, along, along)
        strike_columns(gap_rate, push, contact, jump, landing)
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


@part
def _landings(pairs, mean, delta, matrix, gap_rate, push, jump, before, duration, row, scale, maps, along):
    """maps (P, N, N) and along (P, N): J_i and F_i of the flight after each node, which lands on the next."""
    nodes = duration.shape[0]
    for i in range(nodes):
        j = i + 1 if i + 1 < nodes else 0
        contact = max(row[j], 0)
        landing_map(
            pairs, mean, delta, matrix, gap_rate, push, contact, 0.0 if row[j] < 0 else jump[contact], duration[i],
            before[j], scale, maps[i], along[i],
        )  # fmt: skip


@kernel
def landings(pairs, mean, delta, matrix, gap_rate, push, jump, before, duration, row, scale, maps, along):
    """See `_landings`."""
    _landings(pairs, mean, delta, matrix, gap_rate, push, jump, before, duration, row, scale, maps, along)


@inlined
def planar_landings(pairs, mean, delta, matrix, gap_rate, push, jump, before, duration, row, scale, maps, along):
    """See `_landings`; N = 4."""
    _landings(
        pairs, mean, delta, sized(matrix, 4), sized(gap_rate, 4), sized(push, 4), jump, sized(before, 4), duration, row, sized(scale, 4),
        sized(maps, 4), sized(along, 4),
    )  # fmt: skip


@part
def _pencil(complement, weights, gap, conservative, after, row, scale, maps, along, left, right, scratch, factor):
    """Factors of the product pencil: left[i] = E_i, right[i] = A_i. The arrays are (P, N, N); factor i uses the first rows and
    columns: E_i is (m_i, d_{i+1}) and A_i is (m_i, d_i), where d = N less the constraints of a node and m_i = d_{i+1}, or for a cut
    m_i = d_{i+1} of an unconstrained node. row[i] < 0 marks a cut. maps, along: of `landings`.
    complement: of `complement` and its like; scratch (5, max(N, 2), N), factor (2,)."""
    nodes, size = after.shape
    basis = scratch[0]
    following = scratch[1]
    rows = scratch[2]
    vectors = scratch[3]
    turned = scratch[4, 0]
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
def pencil(weights, gap, conservative, after, row, scale, maps, along, left, right, scratch, factor):
    """See `_pencil`."""
    _pencil(complement, weights, gap, conservative, after, row, scale, maps, along, left, right, scratch, factor)


@inlined
def planar_pencil(weights, gap, after, row, scale, maps, along, left, right, scratch, factor):
    """See `_pencil`; N = 4 and an energy is conserved."""
    _pencil(
        planar_complement, sized(weights, 4), sized(gap, 4), True, sized(after, 4), row, sized(scale, 4), sized(maps, 4), sized(along, 4),
        sized(left, 4), sized(right, 4), sized(scratch, 4), factor,
    )  # fmt: skip
