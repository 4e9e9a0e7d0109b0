"""The half map (13) of a symmetric orbit between its two reversals, and the multipliers of an orbit with two degrees of freedom.

At an end the reduced perturbations (tangent to the energy level, modulo the flow) split into those kept by the end's reversal (+) and
those turned round by it (-), m of each. In these coordinates the linearised flow from one end to the other is phi = [[a, b], [c, d]],
symplectic, and the orbit's return map, R phi^-1 R phi, is [[d'a + b'c, 2 d'b], [2 a'c, a'd + c'b]] (blocks; ' is transposition), whose
trace is 2 m + 4 tr(b'c). A zero of det c is a fold or branch point within the class of orbits between such ends, of det b the loss of
the reversal, of det a or det d a doubling. Motions that no spring and no stop resists are left out.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from bvp.kernels import multipoint as entry
from bvp.kernels.compiled import chosen, inlined, short_loops, sized
from bvp.kernels.contact_mode import apply_impact, arrive
from bvp.kernels.cuts import is_cut
from bvp.kernels.flight import Flight, copy_1, row_dot, set_1, set_2, times_matrix
from bvp.kernels.flights import energy_slope, flight_map, flow_product, rate, slope_times, squared_speed, twice_energy
from bvp.kernels.multipoint import ORIGIN, REST, STOP, ImpactList, count_impacts, start_state, unfold_impacts, unpack
from bvp.kernels.newton import reflector
from bvp.kernels.pencil import ContactRows, Factors, Linearised, Nodes, departure, landings, orthogonal_sweep, pencil, trivial_directions
from bvp.kernels.smooth import SmoothFlight


@inlined
def section_basis(segment, node, kind, z, held, vectors, out):
    """The first rows of `out` (>= m, n): orthonormal, perpendicular to the velocity (origin), the force (rest) or the stop's normal (stop),
    and for n > 2 within the rows of `held` (m + 1, n). They are oriented with that vector, so that determinants taken with them change sign
    only through zero. vectors (>= 2, n): scratch."""
    half = z.shape[0] // 2
    slope = energy_slope(segment.flight, segment.weights, z, 1.0)
    for r in range(half):
        if kind == ORIGIN:
            vectors[0, r] = z[half + r]
        elif kind == REST:
            vectors[0, r] = slope_times(slope, r, 1.0)
        else:
            vectors[0, r] = segment.gap[node, r]
    if half == 2:
        norm = math.hypot(vectors[0, 0], vectors[0, 1])
        out[0, 0] = -vectors[0, 1] / norm
        out[0, 1] = vectors[0, 0] / norm
        return
    axes = held.shape[0]
    v = vectors[1]
    for a in range(axes):
        v[a] = row_dot(held, a, vectors[0])
    head = v[0]
    # Householder's reflection of v; its complement is the image of the other axes.
    _, factor = reflector(v, 0, axes)
    for b in range(1, axes):
        turn = head < 0.0 and b == axes - 1
        for r in range(half):
            total = 0.0
            for a in range(axes):
                total += ((1.0 if a == b else 0.0) - factor * v[b] * v[a]) * held[a, r]
            out[b - 1, r] = -total if turn else total


@inlined
def magnification(segment, node, z, reach):
    """Factor by which an impact at the state z magnifies rounding errors, sqrt(2 h) |g| / |g . v|; 1 for the fastest head-on impact."""
    normal = 0.0
    speed = 0.0
    for r in range(z.shape[0]):
        normal += segment.gap[node, r] ** 2
        speed += segment.gap_rate[node, r] * z[r]
    return reach * math.sqrt(normal) / abs(speed) if speed != 0.0 else math.inf


class HalfMap(NamedTuple):
    """A half map, and scratch for it and for what follows from it. m pairs of multipliers."""

    held: np.ndarray  # (m + 1, n) orthonormal: the modal displacements without those that no spring and no stop resists
    rows: np.ndarray  # (N + 3, N)
    square: np.ndarray  # (1, N, N)
    small: np.ndarray  # (3, max(n, 2), n)
    phi: np.ndarray  # (2 m, 2 m)
    block: np.ndarray  # (4 m^2,)
    inverse: np.ndarray  # (4 m^2,)
    product: np.ndarray  # (m, m)
    factors: np.ndarray  # (2, m, m)
    corner: np.ndarray  # (3, 3)
    values: np.ndarray  # (2, m)
    forward: np.ndarray  # (2,) int64 zeros


def make_half_map(held):
    """Scratch for the half maps of a problem."""
    m, half = held.shape[0] - 1, held.shape[1]
    size = 2 * half
    return HalfMap(
        held, np.zeros((size + 3, size)), np.zeros((1, size, size)), np.zeros((3, max(2, half), half)), np.zeros((2 * m, 2 * m)),
        np.zeros(4 * m * m), np.zeros(4 * m * m), np.zeros((m, m)), np.zeros((2, m, m)), np.zeros((3, 3)), np.zeros((2, m)),
        np.zeros(2, np.int64),
    )  # fmt: skip


@inlined
def half_map(segment, y, ends, held, work, square, small, phi):
    """phi (2 m, 2 m) from the start to the far end. `ends` (k + 1, N): states at the end of each flight; `held`: see `HalfMap`, not looked
    at for n = 2; scratch: `work` (>= N + 3, N), `square` (>= 1, N, N), `small` (3, max(n, 2), n). Returns the largest factor by which an
    impact magnifies rounding (1: none)."""
    size = work.shape[1]
    half = size // 2
    k = segment.shape[0]
    s = segment.start_map.shape[1]
    kind = segment.shape[3]
    z = work[0]
    field = work[1]
    columns = phi.shape[1]
    pairs = columns // 2
    flow = square[0]
    x = work[4]
    vectors = small[0]
    first = small[1]
    last = small[2]
    start_state(segment.start_map, segment.start_offset, y, z)
    section_basis(segment, k + 1, kind, z, held, vectors, first)
    final_kind = segment.shape[4]
    section_basis(segment, k, final_kind, ends[k], held, vectors, last)
    magnified = 1.0
    reach = math.sqrt(twice_energy(segment.flight, segment.weights, z))
    if kind == STOP:
        magnified = max(magnified, magnification(segment, k + 1, z, reach))
    if final_kind == STOP:
        magnified = max(magnified, magnification(segment, k, ends[k], reach))
    for column in range(columns):
        v = work[5 + column]
        set_1(v, 0.0)
        kept = column < pairs
        b = column if kept else column - pairs
        at = half if kept == (kind == ORIGIN) else 0
        for r in range(half):
            v[at + r] = -first[b, r] if kind == ORIGIN and not kept else first[b, r]
        if kind == STOP and kept:
            normal = 0.0
            work_done = 0.0
            slope = energy_slope(segment.flight, segment.weights, z, 1.0)
            for r in range(half):
                normal += segment.gap[k + 1, r] * z[half + r]
                work_done += slope_times(slope, r, 1.0) * v[r]
            for r in range(half):
                v[half + r] = -work_done / normal * segment.gap[k + 1, r]
    at = s
    for i in range(k + 1):
        # Equation (27): each perturbation over the flight and the impact.
        flight_map(segment.flight, z if i == 0 else y[at - size : at], y[at], flow)
        at += size + 1
        hit = (i < k and not is_cut(segment.flight, segment.side, i)) or (i == k and final_kind == STOP)
        jump = segment.jump[i] if i < k else 0.0  # at the far end the orbit is cut, not reflected
        if hit:
            rate(segment.flight, ends[i], field)
            apply_impact(segment.gap_rate, segment.push, i, jump, field, field)
        if i < k and hit:
            magnified = max(magnified, magnification(segment, i, ends[i], reach))
        for column in range(columns):
            v = work[5 + column]
            flow_product(segment.flight, flow, v, x)
            if hit:
                apply_impact(segment.gap_rate, segment.push, i, jump, x, x)
                arrive(segment.gap, i, field, x)
            copy_1(x, v)
    for column in range(columns):
        x = work[5 + column]
        # Equation (13): the entries in the coordinates of the far end.
        for b in range(pairs):
            displacement = row_dot(last, b, x[:half])
            velocity = row_dot(last, b, x[half:])
            if final_kind == ORIGIN:
                phi[b, column] = velocity
                phi[pairs + b, column] = -displacement
            else:
                phi[b, column] = displacement
                phi[pairs + b, column] = velocity
    return magnified


def make_impacts(count, size):
    """Space for the given number of impacts with states of `size` entries."""
    return ImpactList(np.zeros((count, size)), np.zeros((count, size)), np.zeros(count), np.zeros(count, np.int64))


@chosen
def without_impacts(flight, segment, y, ends, result, rows):
    """The entries of RESULT from `trace` on, for an orbit without impacts, n = 2; those of the half map are known. rows (>= 3, N):
    scratch."""


@without_impacts.of(Flight)
@inlined
def linear_without_impacts(flight, segment, y, ends, result, rows):
    """See `without_impacts`: each mode moves alone, and its family is no family of impacting orbits."""
    set_1(result[entry.TRACE : entry.SINGULAR + 1], math.nan)


@without_impacts.of(SmoothFlight)
@inlined
def smooth_without_impacts(flight, segment, y, ends, result, rows):
    """See `without_impacts`: from the half map, equation (13)."""
    below = result[entry.HALF_B] * result[entry.HALF_C]
    above = result[entry.HALF_A] * result[entry.HALF_D]
    # trace / 2, and (trace / 2)^2 - 1 as a product of small numbers
    half, square, power = 1.0 + 2.0 * below, 4.0 * below * above, 2
    if segment.shape[2] == 1:
        square *= 4.0 * half * half
        half, power = 2.0 * half * half - 1.0, 4
    determinant = (above - below) ** power
    result[entry.TRACE] = 2.0 * half
    result[entry.DETERMINANT] = determinant
    larger = half + math.copysign(math.sqrt(square), half) if square >= 0.0 else half
    imaginary = math.sqrt(-square) if square < 0.0 else 0.0
    result[entry.LARGER_REAL] = larger
    result[entry.LARGER_IMAGINARY] = -imaginary
    result[entry.SMALLER_REAL] = determinant / larger if square >= 0.0 else larger
    result[entry.SMALLER_IMAGINARY] = imaginary
    start, first, last = rows[0], rows[1], rows[2]
    flow = rows[3 : 3 + start.shape[0]]
    start_state(segment.start_map, segment.start_offset, y, start)
    rate(flight, start, first)
    flight_map(flight, start, y[segment.start_map.shape[1]], flow)
    times_matrix(flow, first, last)
    rate(flight, ends[0], first)
    result[entry.TRIVIAL] = departure(first, last)
    result[entry.SINGULAR] = 0.0


@chosen
def sections(flight, segment, impacts, nodes, scale, rows):
    """The contacts that the first nodes of a period count in `impacts.row`, with a section across the flow at each cut.

    scale (N,): sizes of the states' entries. rows: `ContactRows`, a row for each node of smooth flights."""


@sections.of(Flight)
@inlined
def contacts_alone(flight, segment, impacts, nodes, scale, rows):
    """See `sections`: there are no cuts."""
    return ContactRows(segment.gap, segment.gap_rate, segment.push, segment.jump)


@sections.of(SmoothFlight)
@inlined
def contacts_and_sections(flight, segment, impacts, nodes, scale, rows):
    """See `sections`: each node has a row of its own."""
    for i in range(nodes):
        node = impacts.row[i]
        copy_1(segment.gap[node], rows.gap[i])
        copy_1(segment.gap_rate[node], rows.rate[i])
        copy_1(segment.push[node], rows.push[i])
        rows.jump[i] = segment.jump[node]
        if is_cut(flight, segment.side, node):
            rate(flight, impacts.after[i], rows.gap[i])
            for r in range(scale.shape[0]):
                rows.gap[i, r] /= scale[r] * scale[r]
        impacts.row[i] = i
    return rows


class Period(NamedTuple):
    """Scratch for the P nodes of a full period, n = 2, N = 4."""

    impacts: ImpactList
    maps: np.ndarray  # (P, N, N)
    left: np.ndarray  # (P, N, N)
    right: np.ndarray  # (P, N, N)
    along: np.ndarray  # (P, N)
    rows: np.ndarray  # (N + 3, N)
    square: np.ndarray  # (5, N, N)
    plane: np.ndarray  # (4, 2, 2)
    rows_of_nodes: Any  # `ContactRows` with P rows for smooth flights, else empty


def make_period(nodes, smooth):
    """Scratch for the given number of nodes, of smooth flights or of linear ones."""
    square, row = (nodes, 4, 4), (nodes, 4)
    return Period(
        make_impacts(nodes, 4),
        np.zeros(square),
        np.zeros(square),
        np.zeros(square),
        np.zeros(row),
        np.zeros((7, 4)),
        np.zeros((5, 4, 4)),
        np.zeros((4, 2, 2)),
        ContactRows(np.zeros(row), np.zeros(row), np.zeros(row), np.zeros(nodes)) if smooth else (),
    )


@inlined
def sized_period(period):
    """The same scratch with a compile-time length of four entries per state."""
    impacts = period.impacts
    return Period(
        ImpactList(sized(impacts.before, 4), sized(impacts.after, 4), impacts.duration, impacts.row), sized(period.maps, 4),
        sized(period.left, 4), sized(period.right, 4), sized(period.along, 4), sized(period.rows, 4), sized(period.square, 4),
        sized(period.plane, 2), period.rows_of_nodes,
    )  # fmt: skip


@short_loops
def orbit_stability(packed, y, ends, period, result):
    """Half map and multipliers of the orbit at y, n = 2: the entries of RESULT from `a` on."""
    segment, ends, scratch = unpack(packed), sized(ends, 4), sized_period(period)
    size = scratch.impacts.before.shape[1]
    impacts = count_impacts(segment.shape)
    # the second half period of an orbit solved as a quarter has the very factors of the first one: all changes its sign
    repeats = 2 if segment.shape[2] == 1 else 1
    nodes = impacts // repeats
    if segment.shape[2] != 4:
        phi = scratch.plane[0]
        result[entry.MAGNIFIED] = half_map(segment, y, ends, phi, scratch.rows, scratch.square, scratch.plane[1:], phi)
        result[entry.HALF_A] = phi[0, 0]
        result[entry.HALF_B] = phi[0, 1]
        result[entry.HALF_C] = phi[1, 0]
        result[entry.HALF_D] = phi[1, 1]
    else:
        set_1(result[entry.HALF_A : entry.HALF_D + 1], math.nan)
        result[entry.MAGNIFIED] = 1.0
    unfold_impacts(segment, y, ends, scratch.impacts, scratch.rows)
    if nodes == 0:
        without_impacts(segment.flight, segment, y, ends, result, scratch.rows)
        return
    cycle_before = scratch.impacts.before[:nodes]
    cycle_after = scratch.impacts.after[:nodes]
    cycle_row = scratch.impacts.row[:nodes]
    cycle_time = scratch.impacts.duration[:nodes]
    maps = scratch.maps[:nodes]
    left = scratch.left[:nodes]
    right = scratch.right[:nodes]
    along = scratch.along[:nodes]
    scale = scratch.rows[0]
    # velocities by sqrt(2 h), not by those at the impacts: an impact may be the only slow part of an orbit
    displacement = 0.0
    energy = squared_speed(segment.flight, segment.weights, cycle_after[0])
    for i in range(nodes):
        for r in range(size // 2):
            displacement = max(displacement, abs(cycle_after[i, r]))
    for r in range(size // 2):
        scale[r] = displacement if displacement > 0.0 else 1.0
        scale[size // 2 + r] = math.sqrt(energy)
    contacts = sections(segment.flight, segment, scratch.impacts, nodes, scale, scratch.rows_of_nodes)
    cycle = Nodes(cycle_before, cycle_after, cycle_time, cycle_row, scale, segment.weights)
    linear = Linearised(maps, along)
    factors = Factors(left, right)
    landings(segment.flight, contacts, cycle, linear)
    pencil(segment.flight, contacts, cycle, True, None, linear, factors, scratch.square, scratch.plane[0, 0])
    dimension = 2
    frame = scratch.plane[0]
    older = scratch.plane[1]
    product = scratch.plane[2]
    exponent = scratch.plane[3, 0]
    set_2(frame, 0.0)
    for r in range(dimension):
        frame[r, r] = 1.0
    singular = 0
    # Equation (31): sweeps until the frame settles, or the factors are of like size.
    for _ in range(4):
        for r in range(dimension):
            copy_1(frame[r], older[r])
        singular = orthogonal_sweep(factors, repeats, scratch.square, frame, product, exponent)
        coupling = abs(older[0, 1] * frame[0, 0] + older[1, 1] * frame[1, 0])
        grade = abs(product[0, 1]) + abs(product[0, 0])
        if coupling < 1e-15 or grade < 30.0 * abs(product[1, 1]) * 2.0 ** (exponent[1] - exponent[0]):
            break
    # The map in the frame of the last sweep: trace, determinant and eigenvalues of a 2 x 2 matrix.
    w11 = older[0, 0] * frame[0, 0] + older[1, 0] * frame[1, 0]
    w12 = older[0, 0] * frame[0, 1] + older[1, 0] * frame[1, 1]
    w21 = older[0, 1] * frame[0, 0] + older[1, 1] * frame[1, 0]
    w22 = older[0, 1] * frame[0, 1] + older[1, 1] * frame[1, 1]
    p11 = product[0, 0] * 2.0 ** exponent[0]
    p12 = product[0, 1] * 2.0 ** exponent[0]
    p22 = product[1, 1] * 2.0 ** exponent[1]
    c11 = w11 * p11
    c12 = w11 * p12 + w12 * p22
    c21 = w21 * p11
    c22 = w21 * p12 + w22 * p22
    trace = c11 + c22
    determinant = (w11 * w22 - w12 * w21) * product[0, 0] * product[1, 1] * 2.0 ** (exponent[0] + exponent[1])
    result[entry.TRACE] = trace
    result[entry.DETERMINANT] = determinant
    difference = 0.5 * (c11 - c22)
    square = difference * difference + c12 * c21
    if square >= 0.0:
        larger = 0.5 * trace + math.copysign(math.sqrt(square), trace)
        result[entry.LARGER_REAL] = larger
        result[entry.LARGER_IMAGINARY] = 0.0
        result[entry.SMALLER_REAL] = determinant / larger if larger != 0.0 else 0.0
        result[entry.SMALLER_IMAGINARY] = 0.0
    else:
        result[entry.LARGER_REAL] = 0.5 * trace
        result[entry.LARGER_IMAGINARY] = -math.sqrt(-square)
        result[entry.SMALLER_REAL] = 0.5 * trace
        result[entry.SMALLER_IMAGINARY] = math.sqrt(-square)
    flow, level = trivial_directions(segment.flight, contacts, cycle, repeats, linear, scratch.rows[1:])
    result[entry.TRIVIAL] = max(flow, level)
    result[entry.SINGULAR] = singular
