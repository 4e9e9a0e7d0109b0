"""One step along a family of impacting orbits, equation (33): predict, correct, tangent.

Then the flights of the orbit are looked at: admissibility, speeds of the impacts, half-waves.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from bvp.kernels import multipoint as entry
from bvp.kernels.compiled import chosen, inlined
from bvp.kernels.cuts import is_smooth
from bvp.kernels.flight import set_1
from bvp.kernels.multipoint import (
    Factor,
)
from bvp.kernels.newton import conditioning, correct

_LONG_ENOUGH = 1e-4
"""Length of a step whose third derivative has digits: its rounding eps/length^3, over a step of the longest length 0.025, is 1e-9."""

UNPACED = 1 << 20
"""In place of the power of two in the arclength of a system without a frequency: the unit of time is the quarter period."""

_SHIFT = 0.1
"""Part of a step by which a prediction may be longer than its projection on the tangent."""


@inlined
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
    for j in range(unknowns):
        tangent[j] = null[j] * flip
    result[entry.ENERGY] = energy
    result[entry.QUARTER_PERIOD] = alpha
    result[entry.SLOPE] = change * flip
    result[entry.TURN] = 1.0 if first else turn
    result[entry.BRANCHING] = sign * smallest
    result[entry.STEEPNESS] = 1.0 / length


class Request(NamedTuple):
    """The input of a step."""

    ds: float  # length; 0: correct the given point itself
    target: float  # nan; a number: hold y on row . y = target in place of the length, the row being in factor.work[5]
    most: int  # most iterations; `bvp.kernels.newton.LINEARISED`


class Landing(NamedTuple):
    """The output of a step."""

    y: np.ndarray  # (u,)
    tangent: np.ndarray  # (2 u,) tangent, then curvature; (3 u,) with the third derivative behind them
    result: np.ndarray  # (len(RESULT),)


@inlined
def take_step(segment, factor, y, tangent, request, metric, landing):
    """Take a step from y along its `tangent`: tangent, curvature, and the third derivative where there is one (see `Landing`).

    metric (4, N + 2): scratch, whose first row receives the position of the new point. The entries of the landing's result up to
    `branching` are filled."""
    ds, target, most = request
    out, out_tangent, result = landing
    unknowns = y.shape[0]
    old = Metric(metric[2], metric[3])
    new = Metric(metric[0], metric[1])
    row = factor.work[5, :unknowns]
    residual = factor.work[6, : unknowns - 1]
    along = tangent[:unknowns]
    curvature = tangent[unknowns : 2 * unknowns]
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
        if is_smooth(segment.flight) and tangent.shape[0] > 2 * unknowns:
            _predict_cubic(y, tangent, ds, row, out)
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
    if is_smooth(segment.flight) and out_tangent.shape[0] > 2 * unknowns:
        _derivatives_of_cubic(y, along, out, ds, old.position, new.position, result[entry.TURN], out_tangent)


@inlined
def _predict_cubic(y, tangent, ds, row, out):
    """out = y + s t + s^2/2 y'' + s^3/6 y''' at the s at which it is on the plane row . (out - y) = ds."""
    unknowns = y.shape[0]
    first = 0.0
    second = 0.0
    third = 0.0
    for j in range(unknowns):
        first += row[j] * tangent[j]
        second += 0.5 * row[j] * tangent[unknowns + j]
        third += row[j] * tangent[2 * unknowns + j] / 6.0
    s = ds
    for _ in range(3):
        s -= (s * (first + s * (second + s * third)) - ds) / (first + s * (2.0 * second + 3.0 * s * third))
    if abs(s - ds) < _SHIFT * abs(ds):
        for j in range(unknowns):
            out[j] = y[j] + s * (tangent[j] + s * (0.5 * tangent[unknowns + j] + s * tangent[2 * unknowns + j] / 6.0))


@inlined
def _derivatives_of_cubic(y, along, out, ds, position, new_position, turn, tangent):
    """Second and third derivative at the end of a step, behind the `tangent` there: of the cubic with the values and tangents at both
    ends of the step, over the arclength between them. After a short step rounding decides the third: it is zero."""
    unknowns = y.shape[0]
    if abs(ds) < _LONG_ENOUGH:
        set_1(tangent[2 * unknowns :], 0.0)
        return
    chord = 0.0
    for r in range(position.shape[0]):
        chord += (new_position[r] - position[r]) ** 2
    half = 0.5 * (1.0 - turn)  # sin(theta/2)^2
    length = math.copysign(math.sqrt(chord) * (1.0 + half * (1.0 / 6.0 + 0.075 * half)), ds)  # chord (theta/2)/sin(theta/2)
    for j in range(unknowns):
        mean = (out[j] - y[j]) / length
        late = (tangent[j] - mean) / length
        third = (late - (mean - along[j]) / length) / length
        tangent[unknowns + j] = 2.0 * (late + length * third)
        tangent[2 * unknowns + j] = 6.0 * third


class Metric(NamedTuple):
    """Position and direction of the family in the coordinates (start state / sqrt(2 h), log h, log alpha)."""

    position: np.ndarray  # (N + 2,)
    direction: np.ndarray  # (N + 2,)


@chosen
def locate(segment, y, out):
    """(start displacements times the unit of `shape`, and velocities, / sqrt(2 h); log h, log alpha) and (h, alpha)."""


@chosen
def metric_direction(segment, y, position, energy, alpha, tangent, out):
    """Change of `locate` along `tangent`; returns (d h, length)."""


@chosen
def constraint_row(segment, y, energy, alpha, position, direction, row):
    """Row r with r . dy = <direction, change of `locate` along dy>: the pseudo-arclength condition in the unknowns."""


class CompiledProblem(NamedTuple):
    """The data of a problem for a kernel that takes several steps (`bvp.kernels.compiled.call_at`)."""

    addresses: np.ndarray  # (2,) int64 of the kernels that take a step, and that observe; 0: not wanted
    packed: Any  # a segment as these kernels take it
    factor: Factor
    observed: Any
    work: np.ndarray  # scratch
