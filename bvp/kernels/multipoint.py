"""The multipoint problem of an impacting orbit: residual, Jacobian, Newton's correction, the pseudo-arclength step.

Unknowns   y = (s, t_0, z_1, t_1, ..., z_k, t_k [, xi]):  start parameters, flight times, node states after each inner impact
Equations  R exp(B t_i) z_i - z_{i+1} = 0,  g . z_{i+1} - bound = 0   for each inner impact, then the closing equations:
           two ends   L exp(B t_k) z_k = L0                      (n equations; z_0 = Z s + c)
           periodic   R exp(B t_k) z_k + xi grad H(z_0) - z_0 = 0,  g . z_0 - bound = 0

The start of a periodic orbit is an impact, which is its phase condition; xi is the unfolding parameter of the conserved energy
(Munoz-Almaraz et al., Physica D 181 (2003) 1), given as a kick along grad H at the closure: H(z_0) = H(z_0 - xi grad H) forces
xi = 0 on every solution (the other root is of order one, far from any start). There is one unknown more than equations: a family.
"""

import math
from typing import NamedTuple

import numpy as np

from bvp.kernels.arrays import set_1, set_2
from bvp.kernels.compiled import kernel, part
from bvp.kernels.elimination import apply_reflectors, eliminate, forward
from bvp.kernels.flight import flow_matrix, flow_state, rate

ORIGIN, REST, STOP, PERIODIC = 0, 1, 2, 3
"""Kinds of an end."""

__all__ = [
    "Factor",
    "Metric",
    "ORIGIN",
    "PERIODIC",
    "REST",
    "STOP",
    "Segment",
    "correct",
    "evaluate",
    "factorise",
    "make_factor",
    "null_vector",
]


class Segment(NamedTuple):
    """What the kernels know of a problem. N = 2 n entries a state, k inner impacts. Row k of the node arrays is the
    impact at the far end or, for a periodic orbit, the closing one; row k + 1 is the impact at the start (zero where there is none)."""

    pairs: np.ndarray
    mean: np.ndarray
    delta: np.ndarray
    matrix: np.ndarray
    gap: np.ndarray  # (k + 2, N) rows g of the contacts hit
    gap_rate: np.ndarray  # (k + 2, N) rows g B
    push: np.ndarray  # (k + 2, N) directions of the impulses
    jump: np.ndarray  # (k + 2,) 1 + restitution
    bound: np.ndarray  # (k + 2,)
    side: np.ndarray  # (k + 2,) +1 upper, -1 lower
    start_map: np.ndarray  # (N, s) Z
    start_offset: np.ndarray  # (N,) c
    end_map: np.ndarray  # (c, N) L
    end_offset: np.ndarray  # (c,) l
    weights: np.ndarray  # (N,) H = sum(weights z^2)/2
    shape: np.ndarray  # (5,) int64: inner impacts k; periodic 0/1; quarter periods solved 1, 2 or 4; kind of start; kind of end


class Factor(NamedTuple):
    """Work space and the last factorisation (see `bvp.kernels.elimination`)."""

    window: np.ndarray
    closing: np.ndarray
    diagonal: np.ndarray
    factor: np.ndarray
    scale: np.ndarray  # (u,) scale of each unknown
    before: np.ndarray  # (k + 1, N) state at the end of each flight
    work: np.ndarray  # (7, max(u, N) + 2) scratch
    square: np.ndarray  # (N, N) scratch


class Metric(NamedTuple):
    """Where the family is, and how it moves, in (start state / sqrt(2 h), log h, log alpha)."""

    position: np.ndarray  # (N + 2,)
    direction: np.ndarray  # (N + 2,)


def make_factor(segment):
    """Work space for `segment`."""
    size = segment.matrix.shape[0]
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
        np.zeros((7, max(unknowns, size) + 2)),
        np.zeros((size, size)),
    )


@kernel
def start_state(segment, y, out):
    """out = Z s + c."""
    for r in range(out.shape[0]):
        total = segment.start_offset[r]
        for j in range(segment.start_map.shape[1]):
            total += segment.start_map[r, j] * y[j]
        out[r] = total


@kernel
def evaluate(segment, y, before, z, residual):
    """Residual of the problem at y, and the state at the end of each flight."""
    size = segment.matrix.shape[0]
    k = segment.shape[0]
    s = segment.start_map.shape[1]
    start_state(segment, y, z)
    at = s
    for i in range(k + 1):
        if i > 0:
            z = y[at : at + size]
            at += size
        flow_state(segment.pairs, segment.mean, segment.delta, segment.matrix, z, y[at], before[i])
        at += 1
        row = i * (size + 1)
        if i < k or segment.shape[1] == 1:
            speed = 0.0
            for r in range(size):
                speed += segment.gap_rate[i, r] * before[i, r]
            speed *= segment.jump[i]
            gap = -segment.bound[i]
            for r in range(size):
                if i < k:
                    target = y[at + r]
                else:
                    target = y[r]
                residual[row + r] = before[i, r] - speed * segment.push[i, r] - target
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


@kernel
def set_scale(segment, y, factor):
    """Scale of the unknowns: largest displacement, largest velocity (both in modal units) and longest flight."""
    size = segment.matrix.shape[0]
    half = size // 2
    k = segment.shape[0]
    s = segment.start_map.shape[1]
    z = factor.work[0]
    start_state(segment, y, z[:size])
    displacement = 0.0
    velocity = 0.0
    longest = 0.0
    for r in range(size):  # 2h: near the grazing of a mode the velocities at all nodes are small
        velocity += segment.weights[r] * z[r] * z[r]
    velocity = math.sqrt(velocity)
    at = s
    for i in range(k + 1):
        if i > 0:
            for r in range(size):
                z[r] = y[at + r]
            at += size
        for r in range(half):
            displacement = max(displacement, abs(z[r]))
            velocity = max(velocity, abs(z[half + r]))
            displacement = max(displacement, abs(factor.before[i, r]))
            velocity = max(velocity, abs(factor.before[i, half + r]))
        longest = max(longest, abs(y[at]))
        at += 1
    if displacement == 0.0:
        displacement = 1.0
    if velocity == 0.0:
        velocity = displacement
    if longest == 0.0:
        longest = 1.0
    scale = factor.scale
    for j in range(s):
        total = 0.0
        for r in range(half):
            total += abs(segment.start_map[r, j])
        scale[j] = displacement if total > 0.0 else velocity
    scale[s] = longest
    at = s + 1
    for _ in range(k):
        for r in range(half):
            scale[at + r] = displacement
            scale[at + half + r] = velocity
        scale[at + size] = longest
        at += size + 1
    if segment.shape[1] == 1:
        scale[at] = 1.0
    return displacement, velocity, longest


@part
def jacobian_blocks(segment, i, time, factor, landing, push_rate):
    """landing = R exp(B t_i) (dense), push_rate = R B z(t_i): what an impact makes of a node's and a flight time's change."""
    size = segment.matrix.shape[0]
    flow_matrix(segment.pairs, segment.mean, segment.delta, segment.matrix, time, landing)
    rate(segment.pairs, segment.matrix, factor.before[i], push_rate)
    if i < segment.shape[0] or segment.shape[1] == 1:
        speed = 0.0
        for r in range(size):
            speed += segment.gap_rate[i, r] * push_rate[r]
        speed *= segment.jump[i]
        for r in range(size):
            push_rate[r] -= speed * segment.push[i, r]
        for c in range(size):
            total = 0.0
            for r in range(size):
                total += segment.gap_rate[i, r] * landing[r, c]
            total *= segment.jump[i]
            if total != 0.0:
                for r in range(size):
                    landing[r, c] -= total * segment.push[i, r]


@part
def fill(segment, y, factor):
    """Write the scaled transpose of the Jacobian at y into the factor arrays (before: `evaluate` at y)."""
    size = segment.matrix.shape[0]
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
        jacobian_blocks(segment, i, y[at + states], factor, landing, along[:size])
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
                    elif i == 0:
                        for b in range(size):
                            inner = 0.0
                            for d in range(size):
                                inner += landing[b, d] * segment.start_map[d, c]
                            total += segment.end_map[e, b] * inner
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
def factorise(segment, y, factor):
    """Factorise the Jacobian at y. Returns the sign of the determinant of R Q-wise (parity of reflections) for the test of
    branch points, and the smallest diagonal entry of R relative to its column."""
    fill(segment, y, factor)
    size = segment.matrix.shape[0]
    rows = size + 1
    k = segment.shape[0]
    start = segment.start_map.shape[1] + 1
    closing_first = 0 if segment.shape[1] == 1 else max(0, k - 1)
    norms = factor.work[1]
    for i in range(k):
        for e in range(rows):
            total = 0.0
            for r in range(factor.window.shape[1]):
                total += factor.window[i * rows + e, r] ** 2
            norms[i * rows + e] = total
    for e in range(factor.closing.shape[0]):
        total = 0.0
        for r in range(factor.closing.shape[1]):
            total += factor.closing[e, r] ** 2
        norms[k * rows + e] = total
    reflections = eliminate(k, rows, start, closing_first, factor.window, factor.closing, factor.diagonal, factor.factor)
    sign = -1.0 if reflections % 2 else 1.0
    smallest = 1.0
    for j in range(factor.diagonal.shape[0]):
        d = factor.diagonal[j]
        if d < 0.0:
            sign = -sign
        smallest = min(smallest, abs(d) / math.sqrt(norms[j]) if norms[j] > 0.0 else 0.0)
    return sign, smallest


@kernel
def solve(segment, factor, right, out):
    """Least-norm solution (in scaled unknowns) of J out = right; `right` is overwritten."""
    rows = segment.matrix.shape[0] + 1
    k = segment.shape[0]
    unknowns = factor.scale.shape[0]
    forward(k, rows, factor.window, factor.closing, factor.diagonal, right)
    for j in range(unknowns - 1):
        out[j] = right[j]
    out[unknowns - 1] = 0.0
    apply_reflectors(k, rows, segment.start_map.shape[1] + 1, factor.window, factor.closing, factor.factor, out)
    for j in range(unknowns):
        out[j] *= factor.scale[j]


@kernel
def null_vector(segment, factor, out):
    """Null vector of the last factorised Jacobian, unit length in the scaled unknowns; returned: its entry before unscaling
    is +1 along the last reflected axis, so its orientation is the one that the determinant's sign refers to."""
    rows = segment.matrix.shape[0] + 1
    unknowns = factor.scale.shape[0]
    out[:unknowns] = 0.0
    out[unknowns - 1] = 1.0
    apply_reflectors(
        segment.shape[0], rows, segment.start_map.shape[1] + 1, factor.window, factor.closing, factor.factor, out
    )
    for j in range(unknowns):
        out[j] *= factor.scale[j]


@kernel
def locate(segment, y, out):
    """(start state / sqrt(2 h), log h, log alpha) and (h, alpha)."""
    size = segment.matrix.shape[0]
    start_state(segment, y, out[:size])
    energy = 0.0
    for r in range(size):
        energy += 0.5 * segment.weights[r] * out[r] * out[r]
    total = 0.0
    at = segment.start_map.shape[1]
    for _ in range(segment.shape[0] + 1):
        total += y[at]
        at += size + 1
    alpha = total / segment.shape[2]
    speed = math.sqrt(2.0 * energy)
    for r in range(size):
        out[r] /= speed
    out[size] = math.log(energy)
    out[size + 1] = math.log(alpha) if alpha > 0.0 else -math.inf
    return energy, alpha


@kernel
def metric_direction(segment, y, position, energy, alpha, tangent, out):
    """Change of `locate` along `tangent`; returns (d h, length)."""
    size = segment.matrix.shape[0]
    s = segment.start_map.shape[1]
    speed = math.sqrt(2.0 * energy)
    change = 0.0
    for r in range(size):
        total = 0.0
        for j in range(s):
            total += segment.start_map[r, j] * tangent[j]
        out[r] = total / speed
        change += segment.weights[r] * position[r] * speed * total
    for r in range(size):
        out[r] -= position[r] * change / (2.0 * energy)
    total = 0.0
    at = s
    for _ in range(segment.shape[0] + 1):
        total += tangent[at]
        at += size + 1
    out[size] = change / energy
    out[size + 1] = total / segment.shape[2] / alpha
    length = 0.0
    for r in range(size + 2):
        length += out[r] * out[r]
    return change, math.sqrt(length)


@part
def constraint_row(segment, y, energy, alpha, position, direction, row):
    """Row r with r . dy = <direction, change of `locate` along dy>: the pseudo-arclength condition in the unknowns."""
    size = segment.matrix.shape[0]
    s = segment.start_map.shape[1]
    speed = math.sqrt(2.0 * energy)
    along = 0.0
    for r in range(size):
        along += direction[r] * position[r]
    set_1(row, 0.0)
    radial = direction[size] / energy - along / (2.0 * energy)
    for j in range(s):
        total = 0.0
        for r in range(size):
            total += segment.start_map[r, j] * (direction[r] / speed + radial * segment.weights[r] * position[r] * speed)
        row[j] = total
    at = s
    for _ in range(segment.shape[0] + 1):
        row[at] = direction[size + 1] / segment.shape[2] / alpha
        at += size + 1


@part
def scaled_residual(segment, residual, displacement, velocity):
    """Largest residual, displacements and velocities each by their own scale."""
    size = segment.matrix.shape[0]
    half = size // 2
    rows = size + 1
    k = segment.shape[0]
    worst = 0.0
    for j in range(residual.shape[0]):
        i = j // rows
        r = j - i * rows
        if i < k or segment.shape[1] == 1:
            scale = velocity if half <= r < size else displacement
        else:
            total = 0.0
            for c in range(half):
                total += abs(segment.end_map[r, c])
            scale = displacement if total > 0.0 else velocity
        value = abs(residual[j]) / scale
        if not value <= worst:
            worst = value
    return worst


@kernel
def correct(segment, y, row, target, factor, residual, maximum, rounding):
    """Newton's corrections of y, in place, held on row . y = target (row all zero: least-norm corrections).

    The factorisation is kept while a correction with it shrinks the update tenfold. Ends when the update stagnates at rounding
    level; with no iterations allowed, y is only looked at. Returns (converged, iterations, worst ratio of successive updates,
    scaled residual)."""
    unknowns = y.shape[0]
    z = factor.work[2]
    update = factor.work[3]
    null = factor.work[4]
    size = segment.matrix.shape[0]
    held = False
    for j in range(unknowns):
        if row[j] != 0.0:
            held = True
    previous = math.inf
    contraction = 0.0
    fresh = True
    worst = math.inf
    evaluate(segment, y, factor.before, z[:size], residual)
    displacement, velocity, longest = set_scale(segment, y, factor)
    if maximum == 0:
        worst = scaled_residual(segment, residual, displacement, velocity)
        return worst < 1e-12, 0, 0.0, worst
    for iteration in range(maximum):
        if fresh:
            factorise(segment, y, factor)
            if held:
                null_vector(segment, factor, null)
        for j in range(residual.shape[0]):
            residual[j] = -residual[j]
        solve(segment, factor, residual, update)
        if held:
            along = -target
            slope = 0.0
            for j in range(unknowns):
                along += row[j] * (y[j] + update[j])
                slope += row[j] * null[j]
            if slope == 0.0:
                return False, iteration, contraction, worst
            for j in range(unknowns):
                update[j] -= along / slope * null[j]
        length = 0.0
        for j in range(unknowns):
            y[j] += update[j]
            length = max(length, abs(update[j]) / factor.scale[j])
            if not math.isfinite(y[j]):
                return False, iteration, contraction, math.inf
        evaluate(segment, y, factor.before, z[:size], residual)
        worst = scaled_residual(segment, residual, displacement, velocity)
        ratio = length / previous
        if length <= rounding:
            return True, iteration + 1, contraction, worst
        if iteration > 0:
            if ratio > 0.5 and length < 1e-9:
                return worst < 1e-12, iteration + 1, contraction, worst
            if length > 1e-12:
                contraction = max(contraction, ratio)
            if ratio > 2.0 and length > 1e-3:
                return False, iteration + 1, contraction, worst
        fresh = iteration > 0 and ratio > 0.1
        previous = length
        if fresh:
            displacement, velocity, longest = set_scale(segment, y, factor)
    return worst < 1e-12 and previous < 1e-9, maximum, contraction, worst
