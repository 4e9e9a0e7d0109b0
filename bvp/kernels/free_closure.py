"""The closing equations of free orbits in released parameters, equation (41): reversing ends, the unfolding of a conserved energy, and
equations of the user that name the energy and the quarter period.

Between two ends, for a node z_0 = (u, v, s, parameters) and the state z after the last flight:

    origin  u = 0        rest  v = 0        stop  c . u = bound, and v along M^-1 c
    s_0 = 0

The last condition at a stop holds for the velocity that a plastic impact would leave, v - push (c . v): it is zero. The rows of an end are
n, so there are as many equations as unknowns with the user's m, but one.
"""

from numpy import int64

from bvp.kernels.compiled import inlined
from bvp.kernels.contact_mode import apply_impact
from bvp.kernels.expressions import run
from bvp.kernels.flight import inner, row_dot
from bvp.kernels.multipoint import PERIODIC, STOP, UNFOLDED, total_time
from bvp.kernels.smooth_loads import evaluate_stored, first_kicked, stored_energy, stored_slope


@inlined
def energy_gradient(entries, node, n, r):
    """The derivative of H = (v . M v + u . K u)/2 by entry r of (u, v). The matrices are entries from 0, and from 2 n^2."""
    first = 2 * n * n + r * n if r < n else (r - n) * n
    part = node[:n] if r < n else node[n : 2 * n]
    return inner(entries[first : first + n], part)


@inlined
def energy_by(entries, node, n):
    """H of a node for masses and springs that are `entries`; for their derivatives by a parameter, its derivative."""
    total = 0.0
    for r in range(2 * n):
        total += 0.5 * node[r] * energy_gradient(entries, node, n, r)
    return total


@inlined
def first_kept(segment):
    """The first closing equation that is one of the user's."""
    return segment.flight.enter.shape[0] + (2 if segment.shape[3] == PERIODIC else 1)


@inlined
def knows_energy(segment):
    """Whether the user's equations can name the energy and the quarter period."""
    return segment.kept_values.shape[0] > segment.released.values.shape[0]


@inlined
def kept_count(segment):
    """How many equations of the user there are, and by how many quantities each one has derivatives."""
    derivatives = segment.released.columns.shape[0] + (2 if knows_energy(segment) else 0)
    return segment.kept_out.shape[0] // (1 + derivatives), derivatives


@inlined
def whole_time(segment, y):
    """The sum of the flight times in the unknowns y, or in a change of them."""
    return total_time(segment.start_map, segment.start_map, segment.shape, y)


@inlined
def kept_residuals(segment, y, residual):
    """The user's equations at y, into the closing ones (from the first of them on)."""
    n = segment.flight.enter.shape[0] // 2
    first = first_kept(segment)
    count, _ = kept_count(segment)
    if count == 0:
        return
    if knows_energy(segment):
        place = segment.released.values.shape[0]
        evaluate_stored(segment.flight, y)
        segment.kept_values[place] = energy_by(segment.released.entries, y, n) + stored_energy(segment.flight, 0)
        segment.kept_values[place + 1] = whole_time(segment, y) / segment.shape[2]
    run(segment.kept, segment.kept_values, segment.released.scratch, segment.kept_out)
    for e in range(count):
        residual[first + e] = segment.kept_out[e]


@inlined
def fill_kept(segment, y, closing, scale):
    """The columns of the user's equations in the scaled transpose of the Jacobian."""
    width = segment.gap.shape[1]
    size = segment.flight.enter.shape[0]
    n = size // 2
    released = segment.released
    parameters = width - size - 1
    count, derivatives = kept_count(segment)
    first = first_kept(segment)
    if derivatives > parameters:
        evaluate_stored(segment.flight, y)
    for e in range(count):
        column = closing[first + e]
        slopes = segment.kept_out[count + e * derivatives : count + (e + 1) * derivatives]
        for j in range(parameters):
            column[size + 1 + j] += slopes[j] * scale[size + 1 + j]
        if derivatives == parameters:
            continue
        for r in range(size):
            slope = energy_gradient(released.entries, y, n, r) + stored_slope(segment.flight, r)
            column[r] += slopes[parameters] * slope * scale[r]
        for j in range(parameters):
            slope = energy_by(released.slopes[j], y, n) + stored_energy(segment.flight, 1 + j)
            column[size + 1 + j] += slopes[parameters] * slope * scale[size + 1 + j]
        for i in range(segment.shape[0] + 1):
            at = i * (width + 1) + width
            column[at] += slopes[parameters + 1] / segment.shape[2] * scale[at]


@inlined
def kept_size(segment, e):
    """What the terms of the user's equation e are at most, beside 1."""
    if not knows_energy(segment):
        return 1.0
    count, derivatives = kept_count(segment)
    place = segment.released.values.shape[0]
    total = 1.0
    for j in range(2):
        slope = segment.kept_out[count + (e + 1) * derivatives - 2 + j]
        total = max(total, abs(slope * segment.kept_values[place + j]))
    return total


@inlined
def unfold(segment, y, residual):
    """Add the kick along grad H at the closure, xi grad H (z_0), to the first closing equations.

    With smooth forces it is along the momentum alone: it changes the kinetic energy, so xi is zero for the same reason."""
    n = segment.flight.enter.shape[0] // 2
    if segment.shape[1] == UNFOLDED:
        for r in range(first_kicked(segment.flight), 2 * n):
            residual[r] += y[y.shape[0] - 1] * energy_gradient(segment.released.entries, y, n, r)


@inlined
def fill_unfolding(segment, y, closing, scale):
    """Its columns."""
    size = segment.flight.enter.shape[0]
    n = size // 2
    if segment.shape[1] != UNFOLDED:
        return
    last = y.shape[0] - 1
    released = segment.released
    for r in range(first_kicked(segment.flight), size):
        column = closing[r]
        column[last] += energy_gradient(released.entries, y, n, r) * scale[last]
        for c in range(n):
            at = 2 * n * n + r * n + c if r < n else (r - n) * n + c
            place = c if r < n else n + c
            column[place] += y[last] * released.entries[at] * scale[place]
        for j in range(released.columns.shape[0]):
            column[size + 1 + j] += y[last] * energy_gradient(released.slopes[j], y, n, r) * scale[size + 1 + j]


@inlined
def ends_residuals(segment, y, z, residual):
    """The end conditions at y. z (N,): the node after the last flight, with its velocity after a plastic impact where the end is a stop; it
    is overwritten."""
    width = segment.gap.shape[1]
    size = segment.flight.enter.shape[0]
    n = size // 2
    k = segment.shape[0]
    for end in range(2):
        # The far end first: z is that of the start afterwards.
        first = n if end == 0 else int64(0)
        node = k if end == 0 else k + 1
        if end == 1:
            apply_impact(segment.gap_rate, segment.push, node, segment.jump[node], y[:width], z)
        for e in range(n):
            residual[first + e] = inner(segment.end_map[first + e], z[:size])
        if segment.shape[4 - end] == STOP:
            residual[first] = inner(segment.gap[node], z) - segment.bound[node]
    residual[size] = y[size]


@inlined
def fill_ends(segment, y, landing, along, closing, scale):
    """Their columns. landing (N, N), along (N,): derivatives of z by the node before the last flight, and by its time."""
    width = segment.gap.shape[1]
    size = segment.flight.enter.shape[0]
    n = size // 2
    k = segment.shape[0]
    at = k * (width + 1)
    for e in range(n):
        column = closing[n + e]
        stop = e == 0 and segment.shape[4] == STOP
        for c in range(width):
            total = inner(segment.gap[k], landing[:, c]) if stop else inner(segment.end_map[n + e], landing[:size, c])
            column[at + c] += total * scale[at + c]
        total = row_dot(segment.gap, k, along) if stop else inner(segment.end_map[n + e], along[:size])
        column[at + width] += total * scale[at + width]
        column = closing[e]
        if e == 0 and segment.shape[3] == STOP:
            for c in range(width):
                column[c] += segment.gap[k + 1, c] * scale[c]
            continue
        row = segment.end_map[e]
        kick = segment.jump[k + 1] * inner(row, segment.push[k + 1, :size])
        for c in range(size):
            column[c] += (row[c] - kick * segment.gap_rate[k + 1, c]) * scale[c]
        speed = segment.jump[k + 1] * row_dot(segment.gap_rate, k + 1, y[:width])
        for j in range(segment.push_slope.shape[0]):
            column[size + 1 + j] -= speed * inner(row, segment.push_slope[j, k + 1, :size]) * scale[size + 1 + j]
    closing[size, size] += scale[size]
