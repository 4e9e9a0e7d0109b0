"""The multipoint problem of an orbit under periodic loads, equation (39): its data, its residual, its Jacobian and its metric.

Unknowns   y = (z_0, t_0, z_1, t_1, ..., z_k, t_k):  nodes z = (u, v, s, parameters) after each impact, and flight times
Equations  R flight(z_i, t_i) - z_{i+1} = 0,  c . u_{i+1} - bound = 0   for each flight but the last, then the closing equations

           period p     R flight(z_k, t_k) - (u_0, v_0, s_0 + 1) = 0,          c . u_0 - bound = 0
           half period  R flight(z_k, t_k) - (-u_0, -v_0, s_0 + 1/2) = 0,      c . u_0 - bound = 0

and an equation of the user for each released parameter but one. Without impacts s_0 = 0 takes the place of the last one; with them the
first node is after an impact. Without harmonic loads there is no clock: s_0 = 0 takes the place of the equation of the time.

The time s is a fraction of the period, so a node knows the phase of its loads, and the equations have the pattern of conservative ones.
Each node carries the released parameters; they are equal on every iterate of Newton's method, since these equations are linear.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy import int64

from bvp.kernels.compiled import call_at, inlined, kernel
from bvp.kernels.expressions import Program, run
from bvp.kernels.flight import copy_1, inner, set_1, set_2
from bvp.kernels.flights import velocity_unit
from bvp.kernels.forced_sticking import AnyFlight, contact_gap, load_modes, modal_load, mode_count, orbit_flight
from bvp.kernels.free_closure import (
    ends_residuals,
    energy_gradient,
    fill_ends,
    fill_kept,
    fill_unfolding,
    first_kept,
    kept_residuals,
    kept_size,
    unfold,
    whole_time,
)
from bvp.kernels.loads import loaded_flight, loaded_rate
from bvp.kernels.multipoint import PERIODIC, UNFOLDED, evaluate, fill, unpack
from bvp.kernels.newton import CONVERGED_RESIDUAL, residual_level, scaled_residual, set_scale
from bvp.kernels.smooth_loads import first_kicked, renew_forces
from bvp.kernels.step import constraint_row, locate, metric_direction, take_step
from bvp.kernels.summed_chatter import take_impact, take_impact_blocks


class ReleasedEntries(NamedTuple):
    """How entries of the system depend on the m released parameters; `bvp.parameters.Released` gives the program."""

    program: Program
    values: np.ndarray  # (N,) of all parameters; the released ones are those of the node
    columns: np.ndarray  # (m,) int64 the released ones among them
    rows: np.ndarray  # (D,) int64 entries that depend on them
    scratch: np.ndarray  # of the program
    out: np.ndarray  # (D + D m,) what the program writes
    entries: np.ndarray  # (E,) as `bvp.entries.EntryLayout` places them
    slopes: np.ndarray  # (m, E) their derivatives
    places: np.ndarray  # (4,) int64: where restitutions, the constant load, those with cosines and with sines begin
    frequency: int  # and the base frequency
    renew: int  # address of a function that computes modes and impulses anew, where they depend on the parameters; 0: they do not


class LoadedSegment(NamedTuple):
    """What the kernels know of a forced problem. Rows as in `bvp.kernels.multipoint.Segment`, for nodes of N = 2 n + 1 + m entries."""

    flight: AnyFlight
    drive: np.ndarray  # (2 n, n) modal rates of unit forces
    drive_slope: np.ndarray  # (m, 2 n, n) their derivatives; (0, ..) where they do not depend on the parameters
    gap: np.ndarray  # (k + 2, N) rows c, and minus the derivatives of the bounds
    gap_rate: np.ndarray  # (k + 2, N) rows c on velocities
    push: np.ndarray  # (k + 2, N) directions of the impulses
    push_slope: np.ndarray  # (m, k + 2, N) their derivatives; (0, ..) where they do not depend on the parameters
    jump: np.ndarray  # (k + 2,) 1 + restitution
    bound: np.ndarray  # (k + 2,) bound less its derivatives times the parameters
    side: np.ndarray  # (k + 2,) +1 upper, -1 lower
    start_map: np.ndarray  # (N, N) identity
    start_offset: np.ndarray  # (N,) zero
    end_map: np.ndarray  # (2 n, 2 n) rows of the conditions at the start, then of those at the far end; without ends (0, 2 n)
    contact: np.ndarray  # (k + 2, 2) int64: the entries of bound and restitution (-1: plastic, at an end); -1: no impact
    closing: np.ndarray  # (2,) 1 or -1, what the state is multiplied by over the segment; the part of the period that it lasts, 0: no clock
    scale: np.ndarray  # (N,) what a unit of arclength is for each entry of the first node; 0: a unit of its logarithm
    released: ReleasedEntries
    kept: Program  # left less right sides of the user's equations, then their derivatives by all that varies
    kept_values: np.ndarray  # (N,) of all parameters; of free orbits (N + 2,), with the energy and the quarter period behind them
    kept_out: np.ndarray  # what that program writes
    rate: np.ndarray  # (N,) scratch
    shape: np.ndarray  # (5,) int64: inner impacts k; CLOSED or UNFOLDED; quarter periods solved; kind of start; kind of end
    sticking: Any  # `Unstuck` or `Sticking` of `bvp.kernels.forced_sticking`


@unpack.of(LoadedSegment)
@inlined
def unpack_loaded(segment):
    """A forced problem is given to kernels as it is."""
    return segment


@inlined
def is_loaded_cut(segment, i):
    """Whether node i is a cut (`bvp.kernels.cuts`), where no side of a stop is hit: without sticking no stop opens there."""
    return mode_count(segment.sticking) == 0 and segment.side[i] == 0.0


@inlined
def refresh(segment, node):
    """Compute all that depends on the released parameters, at their values in a node."""
    released, loads = segment.released, segment.flight.loads
    size = segment.flight.enter.shape[0]
    n = size // 2
    entries, slopes, places = released.entries, released.slopes, released.places
    count = released.columns.shape[0]
    for j in range(count):
        released.values[released.columns[j]] = node[size + 1 + j]
    run(released.program, released.values, released.scratch, released.out)
    depending = released.rows.shape[0]
    for d in range(depending):
        row = released.rows[d]
        entries[row] = released.out[d]
        for j in range(count):
            slopes[j, row] = released.out[depending + d * count + j]
    if released.renew != 0:
        call_at(released.renew, (int64(0),))
    renew_forces(segment.flight, node)
    loads.clock[0] = entries[released.frequency]
    for j in range(count):
        loads.clock[1 + j] = slopes[j, released.frequency]
    constants = 1 if loads.harmonics.shape[0] > 0 and loads.harmonics[0] == 0.0 else 0
    for h in range(loads.harmonics.shape[0]):
        for part in range(1 if h < constants else 2):
            first = places[1] if h < constants else places[2 + part] + (h - constants) * n
            force = entries[first : first + n]
            modal_load(segment.drive, segment.drive_slope, force, slopes, first, h, part, loads.modal)
            load_modes(segment.sticking, segment, force, first, h, part)
    for i in range(segment.contact.shape[0]):
        row = segment.contact[i, 0]
        if row >= 0:
            total = entries[row]
            for j in range(count):
                segment.gap[i, size + 1 + j] = -slopes[j, row]
                total -= slopes[j, row] * node[size + 1 + j]
            segment.bound[i] = total
            segment.jump[i] = 1.0 + (entries[segment.contact[i, 1]] if segment.contact[i, 1] >= 0 else 0.0)


@evaluate.of(LoadedSegment)
@inlined
def evaluate_loaded(segment, y, before, flights, z, residual):
    """See `evaluate`."""
    width = segment.gap.shape[1]
    size = segment.flight.enter.shape[0]
    k = segment.shape[0]
    refresh(segment, y[:width])
    at = 0
    for i in range(k + 1):
        loaded_flight(orbit_flight(segment, i), y[at : at + width], y[at + width], before[i], flights[i])
        at += width + 1
        row = i * (width + 1)
        take_impact(segment.sticking, segment, i, before[i], residual[row : row + width])
        if i < k:
            # Equation (39): the flight lands on the next node, which lies on its stop, or opens it.
            for r in range(width):
                residual[row + r] -= y[at + r]
            residual[row + width], _ = contact_gap(segment.sticking, segment, i, y[at : at + width])
            if is_loaded_cut(segment, i):
                residual[row + width] = y[at - 1] - y[at + width]  # equation (45)
        elif segment.shape[3] != PERIODIC:
            copy_1(residual[row : row + width], z[:width])
            ends_residuals(segment, y, z[:width], residual[row:])
            kept_residuals(segment, y, residual[row:])
        else:
            # Equation (39): the orbit closes.
            for r in range(size):
                residual[row + r] -= segment.closing[0] * y[r]
            residual[row + size] -= y[size] + segment.closing[1]
            if segment.closing[1] == 0.0:
                residual[row + size] = y[size]
            residual[row + size + 1] = y[size]
            if segment.contact[k, 0] >= 0:
                # Of half a period, the last impact is at the mirror image of the first one's stop.
                gap = segment.closing[0] * inner(segment.gap[k, :size], y[:size])
                residual[row + size + 1] = gap + inner(segment.gap[k, size:], y[size:width]) - segment.bound[k]
            unfold(segment, y, residual[row:])
            kept_residuals(segment, y, residual[row:])


@inlined
def loaded_blocks(segment, i, factor, landing, push_rate):
    """landing (N, N) and push_rate (N,): derivatives of the node after impact i by the one before its flight, and by the flight time."""
    for r in range(landing.shape[0]):
        copy_1(factor.flights[i, r], landing[r])
    before = factor.before[i]
    loaded_rate(orbit_flight(segment, i), before, push_rate)
    if segment.contact[i, 0] >= 0:
        take_impact_blocks(segment.sticking, segment, i, before, landing, push_rate)


@fill.of(LoadedSegment)
@inlined
def fill_loaded(segment, y, factor):
    """See `fill`."""
    width = segment.gap.shape[1]
    size = segment.flight.enter.shape[0]
    rows = width + 1
    k = segment.shape[0]
    landing = factor.square
    along = factor.work[0, :width]
    window, closing, scale = factor.window, factor.closing, factor.scale
    set_2(window, 0.0)
    set_2(closing, 0.0)
    at = 0
    for i in range(k + 1):
        loaded_blocks(segment, i, factor, landing, along)
        after = at + rows
        base = max(0, (i - 1) * rows)
        if i < k:
            for r in range(width):
                column = window[i * rows + r]
                for c in range(width):
                    column[at - base + c] = landing[r, c] * scale[at + c]
                column[at - base + width] = along[r] * scale[at + width]
                column[after - base + r] = -scale[after + r]
            column = window[i * rows + width]
            _, gradient = contact_gap(segment.sticking, segment, i, y[after : after + width])
            for c in range(width):
                column[after - base + c] = gradient[c] * scale[after + c]
            if is_loaded_cut(segment, i):
                column[at - base + width] = scale[at + width]
                column[after - base + width] = -scale[after + width]
        elif segment.shape[3] != PERIODIC:
            fill_ends(segment, y, landing, along, closing, scale)
            fill_kept(segment, y, closing, scale)
        else:
            for e in range(size + 1):
                column = closing[e]
                if e == size and segment.closing[1] == 0.0:
                    column[e] += scale[e]
                    continue
                for c in range(width):
                    column[at + c] += landing[e, c] * scale[at + c]
                column[at + width] += along[e] * scale[at + width]
                column[e] -= (segment.closing[0] if e < size else 1.0) * scale[e]
            column = closing[size + 1]
            if segment.contact[k, 0] >= 0:
                for c in range(width):
                    column[c] += (segment.closing[0] if c < size else 1.0) * segment.gap[k, c] * scale[c]
            else:
                column[size] += scale[size]
            fill_unfolding(segment, y, closing, scale)
            fill_kept(segment, y, closing, scale)
        at = after


@inlined
def motion_size(segment, y, ends):
    """Sizes of displacements, velocities and flight times of the orbit y. ends (k + 1, N): the nodes at the ends of its flights.

    All impacts can be at one place, at rest there, as where the only one grazes at the origin. There the acceleration gives the size."""
    width = segment.gap.shape[1]
    size = segment.flight.enter.shape[0]
    n = size // 2
    displacement = 0.0
    velocity = 0.0
    longest = 0.0
    bend = 0.0
    at = 0
    for i in range(segment.shape[0] + 1):
        for r in range(n):
            displacement = max(displacement, max(abs(y[at + r]), abs(ends[i, r])))
            velocity = max(velocity, max(abs(y[at + n + r]), abs(ends[i, n + r])))
        longest = max(longest, abs(y[at + width]))
        at += width + 1
        if segment.contact[i, 0] >= 0:
            loaded_rate(orbit_flight(segment, i), ends[i], segment.rate)
            for r in range(n):
                bend = max(bend, abs(segment.rate[n + r]))
    fastest = segment.scale[n] / segment.scale[0]
    velocity = max(velocity, bend / fastest)
    w = segment.flight.loads.clock[0]
    if w == 0.0:
        w = 1.0 / longest if longest > 0.0 else fastest
    displacement = max(displacement, velocity / w)
    velocity = max(velocity, displacement * w)
    if displacement == 0.0:
        displacement = segment.scale[0]
        velocity = segment.scale[n]
    return displacement, velocity, longest if longest > 0.0 else 1.0 / w


@set_scale.of(LoadedSegment)
@inlined
def set_loaded_scale(segment, y, factor):
    """See `set_scale`: the time of a node has the scale 1, a parameter its own."""
    width = segment.gap.shape[1]
    size = segment.flight.enter.shape[0]
    n = size // 2
    displacement, velocity, longest = motion_size(segment, y, factor.before)
    scale = factor.scale
    at = 0
    for _ in range(segment.shape[0] + 1):
        for r in range(n):
            scale[at + r] = displacement
            scale[at + n + r] = velocity
        scale[at + size] = 1.0
        for j in range(width - size - 1):
            scale[at + size + 1 + j] = math.hypot(segment.scale[size + 1 + j], y[size + 1 + j])
        scale[at + width] = longest
        at += width + 1
    if segment.shape[1] == UNFOLDED:
        kick = 0.0
        for r in range(first_kicked(segment.flight), size):
            kick = max(kick, abs(energy_gradient(segment.released.entries, y, n, r)) / (displacement if r < n else velocity))
        scale[at] = 1.0 / kick if kick > 0.0 else 1.0
    return displacement, velocity, longest


@residual_level.of(LoadedSegment)
@inlined
def loaded_residual_level(segment):
    """See `residual_level`: each state is a sum over the modes, whose rounding adds up."""
    return CONVERGED_RESIDUAL * segment.flight.enter.shape[0]


@scaled_residual.of(LoadedSegment)
@inlined
def scaled_loaded_residual(segment, residual, before, displacement, velocity, longest):
    """See `scaled_residual`."""
    width = segment.gap.shape[1]
    n = segment.flight.enter.shape[0] // 2
    closing = segment.shape[0] * (width + 1)
    worst = 0.0
    unit = velocity
    for row in range(residual.shape[0]):
        r = row % (width + 1)
        if r == 0 and row <= closing:
            i = row // (width + 1)
            unit = velocity_unit(orbit_flight(segment, i), before[i], velocity, longest)
        value = abs(residual[row])
        if row >= closing + first_kept(segment):
            value /= kept_size(segment, row - closing - first_kept(segment))
        elif row >= closing and segment.shape[3] != PERIODIC and r < 2 * n:
            total = 0.0
            for c in range(n):
                total += abs(segment.end_map[r, c])
            value /= displacement if total > 0.0 else unit
        elif r == width and row < closing and is_loaded_cut(segment, row // (width + 1)):
            value = 0.0  # each update fulfils equation (45), which is linear
        elif r < n or r == width:
            value /= displacement
        elif r < 2 * n:
            value /= unit
        elif r > 2 * n and row < closing:
            value /= math.hypot(segment.scale[r], before[i, r])
        elif r == 2 * n + 1 and segment.contact[segment.shape[0], 0] >= 0:
            value /= displacement
        if not value <= worst:
            worst = value
    return worst


@inlined
def metric_reach(segment, y):
    """R = sqrt(1 + |x|^2), x being the first state in its units."""
    total = 1.0
    for r in range(segment.flight.enter.shape[0]):
        total += (y[r] / segment.scale[r]) ** 2
    return math.sqrt(total)


@locate.of(LoadedSegment)
@inlined
def locate_loaded(segment, y, out):
    """The coordinates of `bvp.forced_metric`, and (the parameter, the period)."""
    width = segment.gap.shape[1]
    size = segment.flight.enter.shape[0]
    reach = metric_reach(segment, y)
    for r in range(size):
        out[r] = y[r] / segment.scale[r] / reach
    for r in range(size, width):
        unit = segment.scale[r]
        out[r] = math.asinh(y[r] / unit) if unit > 0.0 else math.log(y[r]) if y[r] > 0.0 else -math.inf
    out[width] = math.log(reach)
    loads = segment.flight.loads
    period = whole_time(segment, y)
    out[size] = y[size] if segment.scale[size] > 0.0 else math.log(period) if period > 0.0 else -math.inf
    if loads.clock[0] > 0.0:
        period = 2.0 * math.pi * loads.load_periods / loads.clock[0]
    return y[size + 1], period


@metric_direction.of(LoadedSegment)
@inlined
def metric_direction_loaded(segment, y, position, energy, alpha, tangent, out):
    """See `metric_direction`: (derivative of the parameter, length)."""
    width = segment.gap.shape[1]
    size = segment.flight.enter.shape[0]
    reach = math.exp(position[width])
    radial = 0.0
    for r in range(size):
        out[r] = tangent[r] / segment.scale[r] / reach
        radial += position[r] * out[r]
    for r in range(size):
        out[r] -= position[r] * radial
    out[size] = tangent[size] if segment.scale[size] > 0.0 else whole_time(segment, tangent) / whole_time(segment, y)
    for r in range(size + 1, width):
        out[r] = tangent[r] / math.hypot(segment.scale[r], y[r])
    out[width] = radial
    return tangent[size + 1], math.sqrt(inner(out, out))


@constraint_row.of(LoadedSegment)
@inlined
def constraint_row_loaded(segment, y, energy, alpha, position, direction, row):
    """See `constraint_row`."""
    width = segment.gap.shape[1]
    size = segment.flight.enter.shape[0]
    reach = math.exp(position[width])
    set_1(row, 0.0)
    along = direction[width]
    for r in range(size):
        along -= direction[r] * position[r]
    for r in range(size):
        row[r] = (direction[r] + position[r] * along) / (segment.scale[r] * reach)
    for r in range(size + 1, width):
        row[r] = direction[r] / math.hypot(segment.scale[r], y[r])
    if segment.scale[size] > 0.0:
        row[size] = direction[size]
        return
    whole = whole_time(segment, y)
    for i in range(segment.shape[0] + 1):
        row[i * (width + 1) + width] = direction[size] / whole


@kernel
def forced_step(segment, factor, y, tangent, request, metric, landing):
    """See `bvp.kernels.step.orbit_step`."""
    take_step(segment, factor, y, tangent, request, metric, landing)


@kernel
def set_parameters(segment, node):
    """See `refresh`."""
    refresh(segment, node)


@kernel
def fly_loaded(flight, z, t, out, jacobian, rate):
    """`loaded_flight`, and `loaded_rate` at its end."""
    loaded_flight(flight, z, t, out, jacobian)
    loaded_rate(flight, out, rate)
