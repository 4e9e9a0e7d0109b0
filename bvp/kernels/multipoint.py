"""The multipoint problem of an impacting orbit: its residual and its Jacobian.

Unknowns   y = (s, t_0, z_1, t_1, ..., z_k, t_k [, xi]):  start parameters, flight times, node states after each inner impact
Equations  R exp(B t_i) z_i - z_{i+1} = 0,  g . z_{i+1} - bound = 0   for each inner impact, then the closing equations:
           two ends   L exp(B t_k) z_k = L0                      (n equations; z_0 = Z s + c)
           periodic   R exp(B t_k) z_k + xi grad H(z_0) - z_0 = 0,  g . z_0 - bound = 0

The start of a periodic orbit is an impact, which is its phase condition; xi is the unfolding parameter of the conserved energy
(Munoz-Almaraz et al., Physica D 181 (2003) 1), given as a kick along grad H at the closure: H(z_0) = H(z_0 - xi grad H) forces
xi = 0 on every solution (the other root is of order one, far from any start). There is one unknown more than equations: a family.
"""

from typing import NamedTuple

import numpy as np

from bvp.kernels.arrays import set_2
from bvp.kernels.compiled import inlined, kernel, part, sized
from bvp.kernels.flight import block_product, flow_matrix, flow_state
from bvp.kernels.restitution import land, strike
from bvp.kernels.segment import start_state


class Factor(NamedTuple):
    """Work space and the last factorisation (see `bvp.kernels.elimination`)."""

    window: np.ndarray
    closing: np.ndarray
    diagonal: np.ndarray
    factor: np.ndarray
    scale: np.ndarray  # (u,) scale of each unknown
    before: np.ndarray  # (k + 1, N) state at the end of each flight, where the problem was last evaluated
    flights: np.ndarray  # (k + 1, N, N) exp(B t) of each flight there
    work: np.ndarray  # (7, max(u, N) + 2) scratch
    square: np.ndarray  # (N, N) scratch


def make_factor(segment):
    """Work space for `segment`."""
    size = segment.flight.matrix.shape[1]
    k = int(segment.shape[0])
    start = segment.start_map.shape[1] + 1
    closers = size + 1 if segment.shape[1] else segment.end_map.shape[0]
    unknowns = start + k * (size + 1) + int(segment.shape[1])
    return Factor(
        np.zeros((k * (size + 1), start + 2 * (size + 1))),
        np.zeros((closers, unknowns)),
        np.zeros(unknowns - 1),
        np.zeros(unknowns - 1),
        np.ones(unknowns),
        np.zeros((k + 1, size)),
        np.zeros((k + 1, size, size)),
        np.zeros((7, max(unknowns, size) + 2)),
        np.zeros((size, size)),
    )


@part
def sized_factor(factor):
    """The same work space, known to be for states of four entries."""
    return Factor(
        factor.window, factor.closing, factor.diagonal, factor.factor, factor.scale, sized(factor.before, 4), sized(factor.flights, 4),
        factor.work, sized(factor.square, 4),
    )  # fmt: skip


@inlined
def evaluate(segment, y, before, flights, z, residual):
    """Residual of the problem at y, and for each flight the state at its end and exp(B t)."""
    size = segment.flight.matrix.shape[1]
    k = segment.shape[0]
    s = segment.start_map.shape[1]
    start_state(segment.start_map, segment.start_offset, y, z)
    at = s
    for i in range(k + 1):
        if i > 0:
            z = y[at : at + size]
            at += size
        flow_matrix(segment.flight, y[at], flights[i])
        block_product(segment.flight.pairs, flights[i], z, before[i])
        at += 1
        row = i * (size + 1)
        if i < k or segment.shape[1] == 1:
            strike(segment.gap_rate, segment.push, i, segment.jump[i], before[i], residual[row : row + size])
            gap = -segment.bound[i]
            for r in range(size):
                if i < k:
                    target = y[at + r]
                else:
                    target = y[r]
                residual[row + r] -= target
                gap += segment.gap[i, r] * target
            if i == k:
                for r in range(size):
                    residual[row + r] += y[at] * segment.weights[r] * y[r]
            residual[row + size] = gap
        else:
            for c in range(segment.end_map.shape[0]):
                total = -segment.end_offset[c]
                for r in range(size):
                    total += segment.end_map[c, r] * before[i, r]
                residual[row + c] = total


@part
def jacobian_blocks(segment, i, factor, landing, push_rate):
    """landing = J (dense) and push_rate = F of flight i (see `bvp.kernels.restitution`)."""
    size = segment.flight.matrix.shape[1]
    for r in range(size):
        for c in range(size):
            landing[r, c] = factor.flights[i, r, c]
    jump = segment.jump[i] if i < segment.shape[0] or segment.shape[1] == 1 else 0.0
    land(segment.flight, segment.gap_rate, segment.push, i, jump, factor.before[i], landing, push_rate)


@part
def fill(segment, y, factor):
    """Write the scaled transpose of the Jacobian at y into the factor arrays (before: `evaluate` at y)."""
    size = segment.flight.matrix.shape[1]
    rows = size + 1
    k = segment.shape[0]
    s = segment.start_map.shape[1]
    periodic = segment.shape[1] == 1
    landing = factor.square
    along = factor.work[0]
    window = factor.window
    closing = factor.closing
    scale = factor.scale
    set_2(window, 0.0)
    set_2(closing, 0.0)
    at = 0
    for i in range(k + 1):
        states = s if i == 0 else size
        jacobian_blocks(segment, i, factor, landing, along[:size])
        after = at + states + 1
        base = max(0, (i - 1) * rows)
        if i < k:
            for r in range(size):
                column = window[i * rows + r]
                if i == 0:
                    for j in range(s):
                        total = 0.0
                        for c in range(size):
                            total += landing[r, c] * segment.start_map[c, j]
                        column[j] = total * scale[j]
                else:
                    for c in range(size):
                        column[at - base + c] = landing[r, c] * scale[at + c]
                column[at - base + states] = along[r] * scale[at + states]
                column[after - base + r] = -scale[after + r]
            column = window[i * rows + size]
            for c in range(size):
                column[after - base + c] = segment.gap[i, c] * scale[after + c]
        else:
            if i == 0 and not periodic:
                # landing <- landing Z, once for all closing equations
                row = factor.work[1, :size]
                for b in range(size):
                    for c in range(states):
                        row[c] = 0.0
                        for d in range(size):
                            row[c] += landing[b, d] * segment.start_map[d, c]
                    for c in range(states):
                        landing[b, c] = row[c]
            for e in range(closing.shape[0]):
                column = closing[e]
                if periodic and e == size:
                    for c in range(size):
                        column[c] += segment.gap[i, c] * scale[c]
                    continue
                for c in range(states):
                    total = 0.0
                    if periodic:
                        total = landing[e, c]
                    else:
                        for b in range(size):
                            total += segment.end_map[e, b] * landing[b, c]
                    column[at + c] += total * scale[at + c]
                if periodic:
                    column[at + states] += along[e] * scale[at + states]
                    column[e] += (y[after] * segment.weights[e] - 1.0) * scale[e]
                    column[after] += segment.weights[e] * y[e] * scale[after]
                else:
                    total = 0.0
                    for b in range(size):
                        total += segment.end_map[e, b] * along[b]
                    column[at + states] += total * scale[at + states]
        at = after


@kernel
def nodes_by_flight(segment, start, times, before, nodes):
    """States after each inner impact into `nodes` (k, N), from the start state (N,) over flight times of which the first k count; `before`
    (N,) is scratch."""
    for r in range(start.shape[0]):
        before[r] = start[r]
    for i in range(nodes.shape[0]):
        flow_state(segment.flight, before if i == 0 else nodes[i - 1], times[i], nodes[i])
        strike(segment.gap_rate, segment.push, i, segment.jump[i], nodes[i], nodes[i])
