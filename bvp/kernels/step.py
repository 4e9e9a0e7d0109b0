"""One step along a family of impacting orbits: predict, correct, tangent."""

from bvp.kernels.arrays import set_1
from bvp.kernels.compiled import kernel, part, sized
from bvp.kernels.flight import flow_state
from bvp.kernels.metric import Metric, constraint_row, locate, metric_direction
from bvp.kernels.multipoint import sized_factor
from bvp.kernels.newton import conditioning, correct
from bvp.kernels.result import (
    BRANCHING,
    CONDITIONING,
    CONTRACTION,
    CONVERGED,
    ENERGY,
    ITERATIONS,
    QUARTER_PERIOD,
    RESIDUAL,
    SLOPE,
    STEEPNESS,
    TURN,
)
from bvp.kernels.segment import sized_rows, start_state, unpack

__all__ = ["end_states", "orbit_step", "planar_orbit_step"]


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
    result[ENERGY] = energy
    result[QUARTER_PERIOD] = alpha
    result[SLOPE] = change * flip
    result[TURN] = 1.0 if first else turn
    result[BRANCHING] = sign * smallest
    result[STEEPNESS] = 1.0 / length


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
    result[CONVERGED] = 1.0 if good else 0.0
    result[ITERATIONS] = iterations
    result[CONTRACTION] = contraction
    result[RESIDUAL] = worst
    if not good:
        return
    result[CONDITIONING] = conditioning(segment, factor, residual)
    tangent_at(segment, out, factor, sign, smallest, old.direction, new, out_tangent[:unknowns], result)
    for j in range(unknowns):
        out_tangent[unknowns + j] = (out_tangent[j] - along[j]) / ds if ds != 0.0 else 0.0


@kernel
def orbit_step(pairs, rows, scalars, start_map, shape, factor, y, tangent, ds, target, most, metric, out, out_tangent, result):
    """See `_orbit_step`."""
    _orbit_step(unpack(pairs, rows, scalars, start_map, shape), factor, y, tangent, ds, target, most, metric, out, out_tangent, result)


@kernel
def planar_orbit_step(pairs, rows, scalars, start_map, shape, factor, y, tangent, ds, target, most, metric, out, out_tangent, result):
    """See `_orbit_step`; N = 4."""
    _orbit_step(
        sized_rows(unpack(pairs, rows, scalars, start_map, shape)), sized_factor(factor), y, tangent, ds, target, most, sized(metric, 6),
        out, out_tangent, result,
    )  # fmt: skip


@kernel
def end_states(segment, y, work, out):
    """States at the end of each flight, (k + 1, N)."""
    size = segment.matrix.shape[0]
    z = work[0, :size]
    start_state(segment.start_map, segment.start_offset, y, z)
    at = segment.start_map.shape[1]
    for i in range(segment.shape[0] + 1):
        if i > 0:
            z = y[at - size : at]
        flow_state(segment.pairs, segment.mean, segment.delta, segment.matrix, z, y[at], out[i])
        at += size + 1
