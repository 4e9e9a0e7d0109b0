"""Compiled steps along curves of bifurcations and grazings: Newton's iteration of `continuation.curves.Curve`.

Second derivatives of an orbit take longer than all the rest: where updates shrink fast, every other iteration but the last keeps the
gradient of the condition.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from bvp.kernels.bent_orbit import Bending
from bvp.kernels.compiled import call_at, inlined, kernel
from bvp.kernels.flight import copy_1, inner, set_1, set_2
from bvp.kernels.forced import LoadedSegment
from bvp.kernels.forced_sticking import orbit_flight
from bvp.kernels.linear import factorise, substitute, substitute_transposed
from bvp.kernels.loads import loaded_rate
from bvp.kernels.multipoint import Factor
from bvp.kernels.newton import LINEARISED, set_scale
from bvp.kernels.step import Landing, Request, constraint_row, locate, metric_direction

__all__ = [
    "CONSTANT", "CONTRACTION", "CONVERGED", "DURATION", "ITERATIONS", "OTHER", "OWN", "RESIDUAL", "SINGULAR", "SPEED", "TURN",
    "CurveArrays", "CurveData", "free_energy", "take_curve_step",
]  # fmt: skip

SINGULAR, SPEED, DURATION = range(3)
"""Conditions: a singular matrix, an impact without speed, a flight without duration."""

OWN, OTHER, CONSTANT = range(3)
"""Where a row of a singular matrix is from: the derivatives of the equations of the orbit, those of the other conditions, a constant."""

CONVERGED, ITERATIONS, CONTRACTION, TURN, RESIDUAL = range(5)
"""Entries of the result of a step."""


_NEAR, _FAST = 0.01, 0.1
"""Largest update, in units of the unknowns, and as a part of the one before, after which an iteration keeps the gradient."""


class CurveData(NamedTuple):
    """A curve, whose u + e unknowns are those of its orbits and those of its condition. d = 1 + e."""

    step: int  # address of `bvp.kernels.forced.forced_step`
    bend: int  # address of `bvp.kernels.curvature.second_along`
    segment: LoadedSegment
    factor: Factor
    bending: Bending
    other: LoadedSegment  # the same orbit with other conditions at its ends
    other_factor: Factor
    other_bending: Bending
    source: np.ndarray  # (u, 2) int64 where each row of the matrix is from: OWN, OTHER or CONSTANT, and which row there
    constant: np.ndarray  # (u, u)
    freed: np.ndarray  # (4, 2) int64: see `free_energy`
    landing: Landing  # scratch of the step
    metric: np.ndarray  # (4, N + 1) scratch of the step
    zero: np.ndarray  # (2 u,)
    kind: int  # of the condition
    shifted: np.ndarray  # (u, u) B1
    multiplier: float  # lambda; nan for a pair
    flight: int  # that ends with the impact, or has no duration
    place: int  # of the first parameter of the plane
    least: float  # least size of a state, in units of arclength
    settled: float  # update, in units of the unknowns' sizes, from which on the next one is rounding
    rounding: float  # largest update that can be rounding
    iterations: int  # most of them


class CurveArrays(NamedTuple):
    """The new point of a step, and scratch: s = d u."""

    y: np.ndarray  # (u + e,)
    tangent: np.ndarray  # (u + e,)
    scale: np.ndarray  # (u + e,) sizes of the unknowns
    result: np.ndarray  # (5,)
    residual: np.ndarray  # (u - 1,)
    rows: np.ndarray  # (u, u) derivatives of the equations, and of the two parameters
    values: np.ndarray  # (d,) of the condition
    gradient: np.ndarray  # (d, u + e)
    right: np.ndarray  # (d, s + d) solutions of the bordered systems, and their last entries
    left: np.ndarray  # (d, s + d)
    borders: np.ndarray  # (2 d s,) the first s entries of left and right, made orthonormal
    slopes: np.ndarray  # (s, u) derivatives of the matrix times the first null vector
    fixed: np.ndarray  # (u, u) the matrix with the multiplier 1
    other: np.ndarray  # (2, u, u) what its rows are taken from
    bordered: np.ndarray  # (s + d, s + d)
    matrix: np.ndarray  # (u + e, u + e)
    pivots: np.ndarray  # (s + d,) int64
    update: np.ndarray  # (u + e,)
    row: np.ndarray  # (u + e,)
    direction: np.ndarray  # (N + 1,)
    held: np.ndarray  # (u,) the orbit where the condition was computed last
    orbit: np.ndarray  # (u,)
    along: np.ndarray  # (u,)


@kernel
def _spread(factor, width, rows):
    """The blocks of a Jacobian as rows (.., u)."""
    u, flights = rows.shape[1], factor.window.shape[0]
    set_2(rows, 0.0)
    for r in range(flights):
        base = max(0, (r // width - 1) * width)
        for c in range(min(factor.window.shape[1], u - base)):
            rows[r, base + c] = factor.window[r, c]
    for r in range(factor.closing.shape[0]):
        copy_1(factor.closing[r], rows[flights + r])


@inlined
def _linearise(curve, arrays):
    """The residual and the derivatives of all rows at the unknowns of arrays.y."""
    factor, rows, orbit = curve.factor, arrays.rows, arrays.orbit
    u, width = orbit.shape[0], curve.segment.gap.shape[1] + 1
    for r in range(u):
        orbit[r] = arrays.y[r]
    set_1(factor.scale, 1.0)
    request = Request(0.0, math.nan, LINEARISED)
    call_at(curve.step, (curve.segment, factor, orbit, curve.zero, request, curve.metric, curve.landing))
    for r in range(u - 1):
        arrays.residual[r] = factor.work[6, r]
    _spread(factor, width, rows)
    # The last equation keeps the second parameter.
    copy_1(rows[u - 2], rows[u - 1])
    set_1(rows[u - 2], 0.0)
    rows[u - 2, curve.place] = 1.0


@inlined
def _needs_other(curve):
    """Whether the singular matrix has rows of the other conditions."""
    found = False
    for r in range(curve.source.shape[0]):
        found = found or curve.source[r, 0] == OTHER
    return found


@inlined
def _choose(curve, own, other, constant, out):
    """out (u, u): each row from where it is taken. constant: what the constant ones are multiplied by."""
    for r in range(out.shape[0]):
        place = curve.source[r, 1]
        if curve.source[r, 0] == OWN:
            copy_1(own[place], out[r])
        elif curve.source[r, 0] == OTHER:
            copy_1(other[place], out[r])
        else:
            for c in range(out.shape[1]):
                out[r, c] = constant * curve.constant[r, c]


@inlined
def _fix(curve, arrays):
    """Write the singular matrix, the multiplier of its closing block being 1."""
    orbit, other = arrays.orbit, arrays.other[0]
    if _needs_other(curve):
        set_1(curve.other_factor.scale, 1.0)
        request = Request(0.0, math.nan, LINEARISED)
        call_at(curve.step, (curve.other, curve.other_factor, orbit, curve.zero, request, curve.metric, curve.landing))
        _spread(curve.other_factor, curve.segment.gap.shape[1] + 1, other[: orbit.shape[0] - 1])
    _choose(curve, arrays.rows, other, 1.0, arrays.fixed)
    free_energy(curve.freed, curve.segment, orbit, curve.other_factor.before, arrays.fixed)


@kernel
def free_energy(freed, segment, orbit, before, matrix):
    """Write into a matrix (u, u) what changes the energy of a perturbation that is antisymmetric about both ends, and what excludes a shift
    in time. before (k + 1, N): the states after the flights.

    freed (4, 2): of each end its first row and the part of the state that is not zero there, or the row of a stop and -1; the row of the
    shift and that part of the start; the part that is zero there, and where the mass begins among the entries. -1: there is none."""
    n, k = segment.flight.enter.shape[0] // 2, before.shape[0] - 1
    for end in range(2):
        state = orbit if end == 0 else before[k]
        row, part = freed[end, 0], freed[end, 1]
        if row >= 0 and part >= 0:
            for r in range(n):
                matrix[row + r, 2 * n] = state[part + r]
        elif row >= 0:  # a stop
            matrix[row, 2 * n] = (1.0 if end == 0 else -1.0) * inner(segment.gap[k + 1 - end, :n], state[n : 2 * n])
    row, part, turned = freed[2, 0], freed[2, 1], freed[3, 0]
    if row >= 0:
        set_1(matrix[row], 0.0)
        for r in range(n):
            at = freed[3, 1] + r * n
            matrix[row, turned + r] = inner(segment.released.entries[at : at + n], orbit[part : part + n])


@inlined
def _set_sizes(curve, arrays):
    """The sizes of the unknowns, of the orbit that was evaluated last."""
    segment, scale = curve.segment, arrays.scale
    set_scale(segment, arrays.orbit, curve.factor)
    width = segment.gap.shape[1]
    size = segment.flight.enter.shape[0]
    for r in range(arrays.orbit.shape[0]):
        scale[r] = curve.factor.scale[r]
        part = r % (width + 1)
        if part < size and r < (segment.shape[0] + 1) * (width + 1):
            scale[r] = max(scale[r], curve.least * segment.scale[part])
        if scale[r] == 0.0:
            scale[r] = 1.0
    for r in range(arrays.orbit.shape[0], scale.shape[0]):
        scale[r] = 1.0


@inlined
def _border(curve, arrays, borders):
    """Write the bordered matrix that is singular without its borders."""
    whole, shifted, scale, matrix = arrays.fixed, curve.shifted, arrays.scale, arrays.bordered
    u = whole.shape[0]
    d = arrays.values.shape[0]
    s = d * u
    set_2(matrix, 0.0)
    for r in range(u):
        for c in range(u):
            moved = shifted[r, c] * scale[c]
            fixed = whole[r, c] * scale[c] - moved
            if d == 1:
                matrix[r, c] = fixed + curve.multiplier * moved
            else:
                matrix[r, c] = fixed
                matrix[r, u + c] = moved
                matrix[u + r, c] = -moved
                matrix[u + r, u + c] = fixed + 2.0 * arrays.y[u] * moved
    for j in range(d):
        for r in range(s):
            matrix[r, s + j] = borders[j * s + r]
            matrix[s + j, r] = borders[(d + j) * s + r]


@inlined
def _hold(curve, arrays, borders, bends):
    """The condition that a matrix is singular, and its derivatives; where not `bends`, these stay as they are."""
    u = arrays.rows.shape[0]
    d = arrays.values.shape[0]
    s = d * u
    right, left, slopes, gradient, along = arrays.right, arrays.left, arrays.slopes, arrays.gradient, arrays.along
    _fix(curve, arrays)
    _border(curve, arrays, borders)
    factorise(arrays.bordered, arrays.pivots)
    for j in range(d):
        set_1(right[j], 0.0)
        right[j, s + j] = 1.0
        copy_1(right[j], left[j])
        substitute(arrays.bordered, arrays.pivots, right[j])
        substitute_transposed(arrays.bordered, arrays.pivots, left[j])
        arrays.values[j] = right[0, s + j]
    if not bends:
        return
    for k in range(d):
        for r in range(u):
            along[r] = right[0, k * u + r] * arrays.scale[r]
        own, other = arrays.other[0], arrays.other[1]
        call_at(curve.bend, (curve.bending, arrays.orbit, along, own[: u - 1]))
        copy_1(own[u - 2], own[u - 1])
        set_1(own[u - 2], 0.0)
        if _needs_other(curve):
            call_at(curve.bend, (curve.other_bending, arrays.orbit, along, other[: u - 1]))
        _choose(curve, own, other, 0.0, slopes[k * u : (k + 1) * u])
    set_2(gradient, 0.0)
    for j in range(d):
        for r in range(s):
            for c in range(u):
                gradient[j, c] -= left[j, r] * slopes[r, c]
        if d == 2:
            for r in range(u):
                total = 0.0
                for c in range(u):
                    total += curve.shifted[r, c] * arrays.scale[c] * right[0, u + c]
                gradient[j, u] -= 2.0 * left[j, u + r] * total


@inlined
def _graze(curve, arrays):
    """The condition of a grazing, and its derivatives."""
    segment, factor, gradient, rate = curve.segment, curve.factor, arrays.gradient, arrays.along
    i, width = curve.flight, segment.gap.shape[1]
    at = i * (width + 1)
    set_2(gradient, 0.0)
    if curve.kind == DURATION:
        arrays.values[0] = arrays.orbit[at + width]
        gradient[0, at + width] = 1.0
        return
    n = segment.flight.enter.shape[0] // 2
    loaded_rate(orbit_flight(segment, i), factor.before[i], rate[:width])
    arrays.values[0] = 0.0
    for r in range(n):
        weight = segment.side[i] * segment.gap[i, r]
        arrays.values[0] += weight * factor.before[i, n + r]
        gradient[0, at + width] += weight * rate[n + r]
        for c in range(width):
            gradient[0, at + c] += weight * factor.flights[i, n + r, c]


@inlined
def _renew(arrays):
    """Write the borders of the next step."""
    d, s, borders = arrays.values.shape[0], arrays.slopes.shape[0], arrays.borders
    for part in range(2):
        vectors = arrays.left if part == 0 else arrays.right
        for j in range(d):
            line = borders[(part * d + j) * s : (part * d + j + 1) * s]
            copy_1(vectors[j, :s], line)
            for before in range(j):
                known = borders[(part * d + before) * s : (part * d + before + 1) * s]
                along = inner(known, line)
                for r in range(s):
                    line[r] -= along * known[r]
            length = math.sqrt(inner(line, line))
            for r in range(s):
                line[r] /= length


@inlined
def _set_matrix(arrays):
    """Write the matrix of Newton's equations, with scaled columns."""
    rows, matrix, scale = arrays.rows, arrays.matrix, arrays.scale
    u, m, d = rows.shape[0], matrix.shape[0], arrays.values.shape[0]
    for c in range(m):
        for r in range(u - 2):
            matrix[r, c] = rows[r, c] * scale[c] if c < u else 0.0
        for j in range(d):
            matrix[u - 2 + j, c] = arrays.gradient[j, c] * scale[c]
        matrix[m - 1, c] = arrays.row[c] * scale[c]


@kernel
def take_curve_step(curve, y, tangent, ds, arrays):
    """See `continuation.curves.Curve.step`. tangent: as there, with its curvature and the borders of the condition behind it."""
    new, update, row, direction, result, scale = arrays.y, arrays.update, arrays.row, arrays.direction, arrays.result, arrays.scale
    u, m = arrays.rows.shape[0], arrays.matrix.shape[0]
    segment, position, way = curve.segment, curve.metric[0], curve.metric[1]
    borders = tangent[2 * m :]
    result[CONVERGED] = 0.0
    parameter, period = locate(segment, y, position)
    metric_direction(segment, y, position, parameter, period, tangent, direction)
    constraint_row(segment, y, parameter, period, position, direction, row)
    for r in range(u, m):
        row[r] = tangent[r]
    for r in range(m):
        new[r] = y[r] + ds * (tangent[r] + 0.5 * ds * tangent[m + r])
    last = math.inf
    contraction = 0.0
    iteration = 0
    bends = True
    while True:
        iteration += 1
        _linearise(curve, arrays)
        if iteration == 1:
            _set_sizes(curve, arrays)
        if curve.kind == SINGULAR:
            _hold(curve, arrays, borders, bends)
        else:
            _graze(curve, arrays)
        _set_matrix(arrays)
        factorise(arrays.matrix, arrays.pivots)
        update[m - 1] = -ds
        for r in range(m):
            if r < u - 2:
                update[r] = arrays.residual[r]
            elif r < m - 1:
                update[r] = arrays.values[r - (u - 2)]
            update[m - 1] += row[r] * (new[r] - y[r])
        substitute(arrays.matrix, arrays.pivots, update)
        length = 0.0
        for r in range(m):
            length = max(length, abs(update[r]))
            if not math.isfinite(update[r]):
                return
        settled = length <= curve.settled or (length <= curve.rounding and length > 0.25 * last)
        if settled and not bends and iteration < curve.iterations:
            # The tangent needs the gradient of this point.
            bends = True
            continue
        # Where updates are squared, the next one is the last.
        bends = not bends or curve.kind != SINGULAR or length * length <= curve.settled or not length < min(_NEAR, _FAST * last)
        if not settled and last < math.inf and length > curve.rounding:
            contraction = max(contraction, length / last)
        last = length
        if settled:
            for r in range(u):
                arrays.held[r] = new[r]
        for r in range(m):
            new[r] -= update[r] * scale[r]
        if settled:
            break
        if iteration == curve.iterations:
            return
    turned = arrays.tangent
    set_1(turned, 0.0)
    turned[m - 1] = 1.0
    substitute(arrays.matrix, arrays.pivots, turned)
    for r in range(m):
        turned[r] *= scale[r]
    parameter, period = locate(segment, new, position)
    metric_direction(segment, new, position, parameter, period, turned, way)
    total = inner(way, way)
    turn = inner(way, direction)
    for r in range(u, m):
        total += turned[r] * turned[r]
        turn += turned[r] * tangent[r]
    total = math.sqrt(total)
    for r in range(m):
        turned[r] /= total
    if curve.kind == SINGULAR:
        _renew(arrays)
    _linearise(curve, arrays)
    worst = 0.0
    for r in range(u - 2):
        worst = max(worst, abs(arrays.residual[r]) / scale[r])
    result[CONVERGED] = 1.0 if math.isfinite(turn) and total > 0.0 else 0.0
    result[ITERATIONS] = iteration
    result[CONTRACTION] = contraction
    result[TURN] = turn / total
    result[RESIDUAL] = worst
