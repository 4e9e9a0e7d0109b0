"""How well the linearised motion round an orbit keeps what it must keep: the direction of the flow, and the energy."""

import math

from bvp.kernels.compiled import inlined, kernel, part, sized
from bvp.kernels.flight import block_product

__all__ = ["planar_trivial_directions", "trivial_directions"]


@part
def departure(first, last):
    """|last - first|/|first|."""
    length = 0.0
    defect = 0.0
    for r in range(first.shape[0]):
        length += first[r] ** 2
        defect += (last[r] - first[r]) ** 2
    return math.sqrt(defect / length)


@part
def _trivial_directions(pairs, matrix, weights, gap, after, row, turns, scale, maps, along, scratch):
    """How well the product of saltation matrices, `turns` times round the given nodes, keeps the flow and the energy:
    (|(M - I) f|/|f|, |grad H (M - I)|/|grad H|). scratch (4, N)."""
    nodes, size = after.shape
    first = scratch[0]
    flow = scratch[1]
    work = scratch[2]
    field = scratch[3]
    block_product(pairs, matrix, after[0], first)
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
            block_product(pairs, matrix, after[j], field)
            hit = 0.0
            speed = 0.0
            for r in range(size):
                hit += gap[contact, r] * scale[r] * work[r]
                speed += gap[contact, r] * scale[r] * along[i, r]
            for r in range(size):
                work[r] += (field[r] / scale[r] - along[i, r]) * hit / speed
        for r in range(size):
            flow[r] = work[r]
    kept_flow = departure(first, flow)
    for r in range(size):
        first[r] = weights[r] * after[0, r] * scale[r]
        flow[r] = first[r]
    for count in range(turns * nodes - 1, -1, -1):
        i = count % nodes
        j = i + 1 if i + 1 < nodes else 0
        contact = max(row[j], 0)
        cut = row[j] < 0
        if not cut:
            block_product(pairs, matrix, after[j], field)
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
    return kept_flow, departure(first, flow)


@kernel
def trivial_directions(pairs, matrix, weights, gap, after, row, turns, scale, maps, along, scratch):
    """See `_trivial_directions`."""
    return _trivial_directions(pairs, matrix, weights, gap, after, row, turns, scale, maps, along, scratch)


@inlined
def planar_trivial_directions(pairs, matrix, weights, gap, after, row, turns, scale, maps, along, scratch):
    """See `_trivial_directions`; N = 4."""
    return _trivial_directions(
        pairs, sized(matrix, 4), sized(weights, 4), sized(gap, 4), sized(after, 4), row, turns, sized(scale, 4), sized(maps, 4),
        sized(along, 4), sized(scratch, 4),
    )  # fmt: skip
