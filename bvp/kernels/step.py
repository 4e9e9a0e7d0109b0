"""One step along a family of impacting orbits: predict, correct, tangent."""

import math
from typing import NamedTuple

import numpy as np

from bvp.kernels import segment as entry
from bvp.kernels.arrays import set_1
from bvp.kernels.compiled import inlined, kernel, part, sized
from bvp.kernels.flight import flow_state
from bvp.kernels.multipoint import sized_factor
from bvp.kernels.newton import conditioning, correct
from bvp.kernels.segment import sized_rows, start_state, total_time, unpack


@part
def tangent_at(segment, y, factor, sign, smallest, old_direction, metric, tangent, result):
    """Tangent at a solution y, of unit length in the metric and turned like `old_direction` (all zero: as it comes). sign, smallest: of
    the factorisation there, whose null vector is in factor.work[4]."""
    unknowns = y.shape[0]
    null = factor.work[4]
    energy, alpha = locate(segment, y, metric.position)
    change, length = metric_direction(segment, y, metric.position, energy, alpha, null, metric.direction)
    turn = 0.0
    first = True
    for r in range(metric.direction.shape[0]):
        metric.direction[r] /= length
        turn += metric.direction[r] * old_direction[r]
        if old_direction[r] != 0.0:
            first = False
    flip = 1.0 / length
    if turn < 0.0 and not first:
        flip = -flip
        sign = -sign
        turn = -turn
        for r in range(metric.direction.shape[0]):
            metric.direction[r] = -metric.direction[r]
    for j in range(unknowns):
        tangent[j] = null[j] * flip
    result[entry.ENERGY] = energy
    result[entry.QUARTER_PERIOD] = alpha
    result[entry.SLOPE] = change * flip
    result[entry.TURN] = 1.0 if first else turn
    result[entry.BRANCHING] = sign * smallest
    result[entry.STEEPNESS] = 1.0 / length


@part
def _orbit_step(segment, factor, y, tangent, ds, target, most, metric, out, out_tangent, result):
    """Step from y by ds (ds = 0: correct y itself) and give the tangent where it lands.

    tangent, out_tangent (2 u,): tangent and curvature. `target`: nan; where it is a number, y is held on row . y = target instead of the
    distance ds, the row being in factor.work[5]. `most`: most iterations. metric (4, N + 2): position and direction there,
    then at y. out (u,). result: the entries of RESULT up to `branching`."""
    unknowns = y.shape[0]
    old = Metric(metric[2], metric[3])
    new = Metric(metric[0], metric[1])
    row = factor.work[5, :unknowns]
    residual = factor.work[6, : unknowns - 1]
    along = tangent[:unknowns]
    curvature = tangent[unknowns:]
    if target != target:
        set_1(row, 0.0)
    set_1(old.direction, 0.0)
    oriented = False
    for j in range(unknowns):
        out[j] = y[j] + ds * (along[j] + 0.5 * ds * curvature[j])
        if along[j] != 0.0:
            oriented = True
    if oriented:
        energy, alpha = locate(segment, y, old.position)
        metric_direction(segment, y, old.position, energy, alpha, along, old.direction)
    if ds != 0.0:
        constraint_row(segment, y, energy, alpha, old.position, old.direction, row)
        target = ds
        for j in range(unknowns):
            target += row[j] * y[j]
    good, iterations, contraction, worst, sign, smallest = correct(segment, out, row, target, factor, residual, most, 2e-15)
    result[entry.CONVERGED] = 1.0 if good else 0.0
    result[entry.ITERATIONS] = iterations
    result[entry.CONTRACTION] = contraction
    result[entry.RESIDUAL] = worst
    if not good:
        return
    result[entry.CONDITIONING] = conditioning(segment, factor, residual)
    tangent_at(segment, out, factor, sign, smallest, old.direction, new, out_tangent[:unknowns], result)
    for j in range(unknowns):
        out_tangent[unknowns + j] = (out_tangent[j] - along[j]) / ds if ds != 0.0 else 0.0


@kernel
def orbit_step(pairs, rows, scalars, start_map, shape, factor, y, tangent, ds, target, most, metric, out, out_tangent, result):
    """See `_orbit_step`."""
    _orbit_step(unpack(pairs, rows, scalars, start_map, shape), factor, y, tangent, ds, target, most, metric, out, out_tangent, result)


@kernel
def two_dof_orbit_step(pairs, rows, scalars, start_map, shape, factor, y, tangent, ds, target, most, metric, out, out_tangent, result):
    """See `_orbit_step`; N = 4."""
    _orbit_step(
        sized_rows(unpack(pairs, rows, scalars, start_map, shape)), sized_factor(factor), y, tangent, ds, target, most, sized(metric, 6),
        out, out_tangent, result,
    )  # fmt: skip


@kernel
def end_states(segment, y, work, out):
    """States at the end of each flight, (k + 1, N)."""
    size = segment.flight.matrix.shape[0]
    z = work[0, :size]
    start_state(segment.start_map, segment.start_offset, y, z)
    at = segment.start_map.shape[1]
    for i in range(segment.shape[0] + 1):
        if i > 0:
            z = y[at - size : at]
        flow_state(segment.flight, z, y[at], out[i])
        at += size + 1


class Metric(NamedTuple):
    """Where the family is, and how it moves, in (start state / sqrt(2 h), log h, log alpha)."""

    position: np.ndarray  # (N + 2,)
    direction: np.ndarray  # (N + 2,)


@inlined
def locate(segment, y, out):
    """(start state / sqrt(2 h), log h, log alpha) and (h, alpha)."""
    size = segment.flight.matrix.shape[1]
    start_state(segment.start_map, segment.start_offset, y, out[:size])
    energy = 0.0
    for r in range(size):
        energy += 0.5 * segment.weights[r] * out[r] * out[r]
    alpha = total_time(segment.flight.matrix, segment.start_map, segment.shape, y) / segment.shape[2]
    speed = math.sqrt(2.0 * energy)
    for r in range(size):
        out[r] /= speed
    out[size] = math.log(energy)
    out[size + 1] = math.log(alpha) if alpha > 0.0 else -math.inf
    return energy, alpha


@inlined
def metric_direction(segment, y, position, energy, alpha, tangent, out):
    """Change of `locate` along `tangent`; returns (d h, length)."""
    size = segment.flight.matrix.shape[1]
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
    out[size] = change / energy
    out[size + 1] = total_time(segment.flight.matrix, segment.start_map, segment.shape, tangent) / segment.shape[2] / alpha
    length = 0.0
    for r in range(size + 2):
        length += out[r] * out[r]
    return change, math.sqrt(length)


@part
def constraint_row(segment, y, energy, alpha, position, direction, row):
    """Row r with r . dy = <direction, change of `locate` along dy>: the pseudo-arclength condition in the unknowns."""
    size = segment.flight.matrix.shape[1]
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
