"""The multipoint problem of an impacting orbit, equation (30): its data, its residual and its Jacobian.

Unknowns   y = (s, t_0, z_1, t_1, ..., z_k, t_k [, xi]):  start parameters, flight times, node states after each inner impact
Equations  R exp(B t_i) z_i - z_{i+1} = 0,  g . z_{i+1} - bound = 0   for each inner impact, then the closing equations:
           two ends   L exp(B t_k) z_k = L0                      (n equations; z_0 = Z s + c)
           periodic   R exp(B t_k) z_k + xi grad H(z_0) - z_0 = 0,  g . z_0 - bound = 0

The start of a periodic orbit is an impact, which is its phase condition. Without impacts it is where the sum of the modal displacements is
largest, g being the row of its rate. At a cut (`bvp.kernels.cuts`) t_i - t_{i+1} = 0 takes the place of the gap.

xi is the unfolding parameter of the conserved energy
(Munoz-Almaraz et al., Physica D 181 (2003) 1), given as a kick along grad H at the closure: H(z_0) = H(z_0 - xi grad H) forces
xi = 0 on every solution (the other root is of order one, far from any start). There is one unknown more than equations: a family.
"""

from typing import NamedTuple

import numpy as np
from numpy import int64

from bvp.kernels.compiled import chosen, inlined, kernel
from bvp.kernels.contact_mode import apply_impact, land
from bvp.kernels.cuts import is_cut
from bvp.kernels.flight import Flight, copy_1, inner, row_dot, set_2
from bvp.kernels.flights import add_bend, energy_slope, flight_end, path_state, slope_times
from bvp.kernels.smooth import SmoothFlight

ORIGIN, REST, STOP, PERIODIC = 0, 1, 2, 3
"""Kinds of an end."""

OPEN, UNFOLDED, CLOSED = 0, 1, 2
"""Whether a segment runs between two ends, or closes on itself: with an unfolding parameter, or without."""


class Segment(NamedTuple):
    """What the kernels know of a problem. N = 2 n entries a state, k inner nodes: impacts, and cuts (of side 0).

    Row k of the node arrays is the impact at the far end or, for a periodic orbit, the closing node. Row k + 1 is the impact at the start
    (zero where there is none)."""

    flight: Flight | SmoothFlight
    gap: np.ndarray  # (k + 2, N) rows g of the contacts hit
    gap_rate: np.ndarray  # (k + 2, N) rows g B
    push: np.ndarray  # (k + 2, N) directions of the impulses
    jump: np.ndarray  # (k + 2,) 1 + restitution
    bound: np.ndarray  # (k + 2,)
    side: np.ndarray  # (k + 2,) +1 upper, -1 lower, 0 a cut
    start_map: np.ndarray  # (N, s) Z
    start_offset: np.ndarray  # (N,) c
    end_map: np.ndarray  # (c, N) L
    end_offset: np.ndarray  # (c,) l
    weights: np.ndarray  # (N,) H = sum(weights z^2)/2
    shape: np.ndarray  # (5,) int64: inner nodes k; OPEN, UNFOLDED or CLOSED; quarter periods solved 1, 2 or 4; kind of start; kind of end


@inlined
def start_state(start_map, start_offset, y, out):
    """out = Z s + c."""
    for r in range(out.shape[0]):
        total = start_offset[r]
        for j in range(start_map.shape[1]):
            total += start_map[r, j] * y[j]
        out[r] = total


@inlined
def total_time(matrix, start_map, shape, y):
    """Sum of the flight times in the unknowns y, or in a change of them."""
    total = 0.0
    at = start_map.shape[1]
    for _ in range(shape[0] + 1):
        total += y[at]
        at += matrix.shape[1] + 1
    return total


@chosen
def unpack(packed):
    """The segment of a problem as kernels use it, from the form in which Python gives it to them."""


@unpack.of(Segment)
@inlined
def unpacked(segment):
    """A segment that is given to kernels as it is."""
    return segment


RESULT = tuple(
    """
    converged iterations contraction residual energy quarter_period slope turn branching clearance clearance_flight clearance_stop
    clearance_side clearance_time speed speed_node flight flight_index absorber_start absorber_end waves_absorber waves_primary
    first_quarter second_quarter in_phase gave_up a b c d magnified trace determinant larger_real larger_imaginary smaller_real
    smaller_imaginary trivial singular speeds steepness conditioning
    """.split()
)
(
    CONVERGED, ITERATIONS, CONTRACTION, RESIDUAL, ENERGY, QUARTER_PERIOD, SLOPE, TURN, BRANCHING, CLEARANCE, CLEARANCE_FLIGHT,
    CLEARANCE_STOP, CLEARANCE_SIDE, CLEARANCE_TIME, SPEED, SPEED_NODE, FLIGHT, FLIGHT_INDEX, ABSORBER_START, ABSORBER_END,
    WAVES_ABSORBER, WAVES_PRIMARY, FIRST_QUARTER, SECOND_QUARTER, IN_PHASE, GAVE_UP, HALF_A, HALF_B, HALF_C, HALF_D, MAGNIFIED, TRACE,
    DETERMINANT, LARGER_REAL, LARGER_IMAGINARY, SMALLER_REAL, SMALLER_IMAGINARY, TRIVIAL, SINGULAR,
    SPEEDS, STEEPNESS, CONDITIONING,
) = range(42)  # fmt: skip
"""Entries of the result of a step. Under loads ENERGY is the first released parameter, and QUARTER_PERIOD the period."""


@inlined
def count_impacts(shape):
    """Nodes in the full period: impacts, and cuts."""
    k = shape[0]
    if shape[1] == 1:
        return k + 1
    turn = 2 * k + (1 if shape[4] == STOP else 0) + (1 if shape[3] == STOP else 0)
    return turn * 2 if shape[2] == 1 else turn


class ImpactList(NamedTuple):
    """The P nodes of an orbit over its period, impacts and cuts, in order of time."""

    before: np.ndarray  # (P, N) states
    after: np.ndarray  # (P, N)
    duration: np.ndarray  # (P,) of the flight after each impact
    row: np.ndarray  # (P,) int64 row of the node arrays that describes its contact


@kernel
def _append_impact(impacts, count, ahead, first, source_before, source_after, node, sign_q, sign_p):
    """Append an impact: the image of the given states, their displacements times sign_q and velocities times sign_p. `ahead` is the time
    of flight since the last one. Returns the number of impacts and the time from the start to the first one."""
    half = impacts.before.shape[1] // 2
    for r in range(half):
        impacts.before[count, r] = sign_q * source_before[r]
        impacts.before[count, half + r] = sign_p * source_before[half + r]
        impacts.after[count, r] = sign_q * source_after[r]
        impacts.after[count, half + r] = sign_p * source_after[half + r]
    impacts.row[count] = node
    if count == 0:
        first = ahead
    else:
        impacts.duration[count - 1] = ahead
    return count + 1, first


@inlined
def unfold_impacts(segment, y, ends, impacts, work):
    """Fill `impacts` with those of the full period, by the reversals at the ends of the segment.

    `ends` (k + 1, N) holds the state at the end of each flight. Returns (number of impacts, time from the start to the first one)."""
    size = segment.flight.matrix.shape[0]
    half = size // 2
    k = segment.shape[0]
    s = segment.start_map.shape[1]
    start = work[0, :size]
    mirror = work[1, :size]
    start_state(segment.start_map, segment.start_offset, y, start)
    count = int64(0)
    first = 0.0
    if segment.shape[1] == 1:
        for i in range(k + 1):
            at = s if i == 0 else s + 1 + (i - 1) * (size + 1) + size
            impacts.duration[i] = y[at]
            source = start if i == 0 else y[at - size : at]
            node = k if i == 0 else i - 1
            impacts.row[i] = node
            for r in range(size):
                impacts.after[i, r] = source[r]
                impacts.before[i, r] = ends[k if i == 0 else i - 1, r]
        return k + 1, 0.0
    # Each reversal maps the segment to the part of the period that follows it: forwards, backwards, and so again with the other sign.
    reflect = -1.0 if segment.shape[4] == ORIGIN else 1.0
    sign = 1.0
    ahead = 0.0
    for leg in range(4 if segment.shape[2] == 1 else 2):
        forwards = leg % 2 == 0
        for step in range(k + 1):
            i = step if forwards else k - step
            at = s + i * (size + 1)
            ahead += y[at]
            if step == k:
                break
            if forwards:
                count, first = _append_impact(impacts, count, ahead, first, ends[i], y[at + 1 : at + 1 + size], i, sign, sign)
            else:
                back = sign * reflect
                count, first = _append_impact(impacts, count, ahead, first, y[at - size : at], ends[i - 1], i - 1, back, -back)
            ahead = 0.0
        if not forwards and segment.shape[2] == 1:
            sign = -sign
        if segment.shape[4 if forwards else 3] == STOP:
            source = ends[k] if forwards else start
            for r in range(half):
                mirror[r] = source[r]
                mirror[half + r] = -source[half + r]
            if forwards:
                count, first = _append_impact(impacts, count, ahead, first, ends[k], mirror, k, sign, sign)
            else:
                count, first = _append_impact(impacts, count, ahead, first, mirror, start, k + 1, sign, sign)
            ahead = 0.0
    if count > 0:
        impacts.duration[count - 1] = ahead + first
    return count, first


class Factor(NamedTuple):
    """Work space and the last factorisation (see `bvp.kernels.newton`)."""

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
    size = segment.gap.shape[1]
    k = int(segment.shape[0])
    start = segment.start_map.shape[1] + 1
    unfolded = int(segment.shape[1] == UNFOLDED)
    closers = size + unfolded if segment.shape[1] else segment.end_map.shape[0]
    unknowns = start + k * (size + 1) + unfolded
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


@chosen
def evaluate(segment, y, before, flights, z, residual):
    """Residual of the problem at y (u,). For each flight, before (k + 1, N) receives the node at its end, and flights (k + 1, N, N) its
    derivative by the node at its begin. z (N,): scratch."""


@evaluate.of(Segment)
@inlined
def evaluate_free(segment, y, before, flights, z, residual):
    """See `evaluate`."""
    size = segment.flight.matrix.shape[1]
    k = segment.shape[0]
    s = segment.start_map.shape[1]
    start_state(segment.start_map, segment.start_offset, y, z)
    at = s
    for i in range(k + 1):
        if i > 0:
            z = y[at : at + size]
            at += size
        flight_end(segment.flight, z, y[at], before[i], flights[i])
        at += 1
        row = i * (size + 1)
        if i < k or segment.shape[1] == 1:
            # Equation (30): the flight lands on the next node, which lies on its stop.
            apply_impact(segment.gap_rate, segment.push, i, segment.jump[i], before[i], residual[row : row + size])
            gap = -segment.bound[i]
            for r in range(size):
                if i < k:
                    target = y[at + r]
                else:
                    target = y[r]
                residual[row + r] -= target
                gap += segment.gap[i, r] * target
            if i < k and is_cut(segment.flight, segment.side, i):
                gap = y[at - 1] - y[at + size]  # equation (45)
            if i == k:
                slope = energy_slope(segment.flight, segment.weights, y[:size], 1.0)
                for r in range(size):
                    residual[row + r] += slope_times(slope, r, y[at])
            residual[row + size] = gap
        else:
            # Equation (30): the end condition.
            for c in range(segment.end_map.shape[0]):
                total = -segment.end_offset[c]
                for r in range(size):
                    total += segment.end_map[c, r] * before[i, r]
                residual[row + c] = total


@inlined
def jacobian_blocks(segment, i, factor, landing, push_rate):
    """landing = J (dense) and push_rate = F of flight i (see `bvp.kernels.contact_mode`)."""
    for r in range(landing.shape[0]):
        copy_1(factor.flights[i, r], landing[r])
    jump = segment.jump[i] if i < segment.shape[0] or segment.shape[1] == 1 else 0.0
    land(segment.flight, segment.gap_rate, segment.push, i, jump, factor.before[i], landing, push_rate)


@chosen
def fill(segment, y, factor):
    """Write the scaled transpose of the Jacobian at y into the factor arrays (before: `evaluate` at y)."""


@fill.of(Segment)
@inlined
def fill_free(segment, y, factor):
    """See `fill`."""
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
        # Equation (27) gives the row of each flight: J_i, F_i and -1 for the next node; then that of the gap.
        if i < k:
            for r in range(size):
                column = window[i * rows + r]
                if i == 0:
                    for j in range(s):
                        column[j] = inner(landing[r], segment.start_map[:, j]) * scale[j]
                else:
                    for c in range(size):
                        column[at - base + c] = landing[r, c] * scale[at + c]
                column[at - base + states] = along[r] * scale[at + states]
                column[after - base + r] = -scale[after + r]
            column = window[i * rows + size]
            for c in range(size):
                column[after - base + c] = segment.gap[i, c] * scale[after + c]
            if is_cut(segment.flight, segment.side, i):
                column[at - base + states] = scale[at + states]
                column[after - base + size] = -scale[after + size]
        else:
            if i == 0 and not periodic:
                # landing <- landing Z, once for all closing equations
                row = factor.work[1, :size]
                for b in range(size):
                    for c in range(states):
                        row[c] = inner(landing[b], segment.start_map[:, c])
                    copy_1(row, landing[b, :states])
            # The closing rows of equation (30).
            for e in range(closing.shape[0]):
                column = closing[e]
                if periodic and e == size:
                    for c in range(size):
                        column[c] += segment.gap[i, c] * scale[c]
                    continue
                for c in range(states):
                    total = landing[e, c] if periodic else inner(segment.end_map[e], landing[:, c])
                    column[at + c] += total * scale[at + c]
                if periodic:
                    column[at + states] += along[e] * scale[at + states]
                    column[e] += (y[after] * segment.weights[e] - 1.0) * scale[e]
                    add_bend(segment.flight, y[:size], y[after], e, scale, column)
                    slope = energy_slope(segment.flight, segment.weights, y[:size], 1.0)
                    column[after] += slope_times(slope, e, 1.0) * scale[after]
                else:
                    column[at + states] += row_dot(segment.end_map, e, along[:size]) * scale[at + states]
        at = after


@kernel
def nodes_by_flight(segment, start, times, before, nodes):
    """States after each inner impact into `nodes` (k, N), from the start state (N,) over flight times of which the first k count; `before`
    (N,) is scratch."""
    copy_1(start, before)
    for i in range(nodes.shape[0]):
        path_state(segment.flight, before if i == 0 else nodes[i - 1], times[i], nodes[i])
        apply_impact(segment.gap_rate, segment.push, i, segment.jump[i], nodes[i], nodes[i])
