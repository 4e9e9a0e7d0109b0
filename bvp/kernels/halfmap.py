"""The reversible half map of a symmetric orbit, between the fixed sets of its two reversals.

At an end the reduced perturbations (tangent to the energy level, modulo the flow) split into those kept by the end's reversal (+) and
those turned round by it (-). In these coordinates the linearised flow from one end to the other is phi = [[a, b], [c, d]], symplectic, and
the orbit's return map, R phi^-1 R phi, is [[d'a + b'c, 2 d'b], [2 a'c, a'd + c'b]] (blocks; ' is transposition), whose trace is
2 (n - 1) + 4 tr(b'c). A zero of det c is a fold or branch point within the class of orbits between such ends, of det b the loss of
the reversal, of det a or det d a doubling.
"""

import math

import numpy as np
from numba import int64

from bvp.kernels.compiled import inlined, part
from bvp.kernels.flight import block_product, flow_matrix
from bvp.kernels.pencil import complement
from bvp.kernels.restitution import arrive, strike
from bvp.kernels.segment import ORIGIN, REST, STOP, start_state


@inlined
def section_basis(segment, node, kind, z, vectors, out):
    """Rows of `out` (n - 1, n): orthonormal, perpendicular to the velocity (origin), the force (rest) or the stop's normal (stop),
    oriented with it, so that determinants taken with it change sign only through zero."""
    half = z.shape[0] // 2
    for r in range(half):
        if kind == ORIGIN:
            vectors[0, r] = z[half + r]
        elif kind == REST:
            vectors[0, r] = segment.weights[r] * z[r]
        else:
            vectors[0, r] = segment.gap[node, r]
    if half == 2:
        norm = math.hypot(vectors[0, 0], vectors[0, 1])
        out[0, 0] = -vectors[0, 1] / norm
        out[0, 1] = vectors[0, 0] / norm
        return
    head = vectors[0, 0]
    complement(vectors, int64(1), out, vectors[1])
    if head < 0.0:
        for r in range(half):
            out[half - 2, r] = -out[half - 2, r]


@part
def magnification(segment, node, z, reach):
    """sqrt(2 h) |g| / |g . v|: what an impact at the state z makes of rounding errors (1 where it is head-on and fastest)."""
    normal = 0.0
    speed = 0.0
    for r in range(z.shape[0]):
        normal += segment.gap[node, r] ** 2
        speed += segment.gap_rate[node, r] * z[r]
    return reach * math.sqrt(normal) / abs(speed) if speed != 0.0 else math.inf


def half_map_scratch(size):
    """Scratch of `half_map` for states of so many entries."""
    half = size // 2
    return np.empty((size + 3, size)), np.empty((1, size, size)), np.empty((3, max(2, half), half))


@inlined
def half_map(segment, y, ends, work, square, small, phi):
    """phi (2 (n-1), 2 (n-1)) from the start to the far end. `ends` (k + 1, N): states at the end of each flight; scratch: `work`
    (>= N + 3, N), `square` (>= 1, N, N), `small` (3, max(n, 2), n). Returns the largest factor by which an
    impact magnifies rounding (1: none)."""
    size = work.shape[1]
    half = size // 2
    k = segment.shape[0]
    s = segment.start_map.shape[1]
    kind = segment.shape[3]
    z = work[0]
    field = work[1]
    columns = 2 * (half - 1)
    flow = square[0]
    x = work[4]
    vectors = small[0]
    first = small[1]
    last = small[2]
    start_state(segment.start_map, segment.start_offset, y, z)
    section_basis(segment, k + 1, kind, z, vectors, first)
    final_kind = segment.shape[4]
    section_basis(segment, k, final_kind, ends[k], vectors, last)
    magnified = 1.0
    reach = 0.0
    for r in range(size):
        reach += segment.weights[r] * z[r] * z[r]
    reach = math.sqrt(reach)
    if kind == STOP:
        magnified = max(magnified, magnification(segment, k + 1, z, reach))
    if final_kind == STOP:
        magnified = max(magnified, magnification(segment, k, ends[k], reach))
    for column in range(columns):
        v = work[5 + column]
        for r in range(size):
            v[r] = 0.0
        kept = column < half - 1
        b = column if kept else column - (half - 1)
        for r in range(half):
            if kind == ORIGIN:
                if kept:
                    v[half + r] = first[b, r]
                else:
                    v[r] = -first[b, r]
            elif kept:
                v[r] = first[b, r]
            else:
                v[half + r] = first[b, r]
        if kind == STOP and kept:
            start_state(segment.start_map, segment.start_offset, y, z)
            normal = 0.0
            work_done = 0.0
            for r in range(half):
                normal += segment.gap[k + 1, r] * z[half + r]
                work_done += segment.weights[r] * z[r] * v[r]
            for r in range(half):
                v[half + r] = -work_done / normal * segment.gap[k + 1, r]
    at = s
    for i in range(k + 1):
        flow_matrix(segment.flight, y[at], flow)
        at += size + 1
        hit = i < k or final_kind == STOP
        jump = segment.jump[i] if i < k else 0.0  # at the far end the orbit is cut, not reflected
        if hit:
            block_product(segment.flight.pairs, segment.flight.matrix, ends[i], field)
            strike(segment.gap_rate, segment.push, i, jump, field, field)
        if i < k:
            magnified = max(magnified, magnification(segment, i, ends[i], reach))
        for column in range(columns):
            v = work[5 + column]
            block_product(segment.flight.pairs, flow, v, x)
            if hit:
                strike(segment.gap_rate, segment.push, i, jump, x, x)
                arrive(segment.gap, i, field, x)
            for r in range(size):
                v[r] = x[r]
    for column in range(columns):
        x = work[5 + column]
        for b in range(half - 1):
            displacement = 0.0
            velocity = 0.0
            for r in range(half):
                displacement += last[b, r] * x[r]
                velocity += last[b, r] * x[half + r]
            if final_kind == ORIGIN:
                phi[b, column] = velocity
                phi[half - 1 + b, column] = -displacement
            else:
                phi[b, column] = displacement
                phi[half - 1 + b, column] = velocity
    return magnified
