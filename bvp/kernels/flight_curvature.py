"""Second derivatives along a direction of the flights, impacts and releases of an orbit that `bvp.kernels.bent_orbit` keeps."""

from bvp.kernels.compiled import inlined, kernel
from bvp.kernels.flight import inner
from bvp.kernels.nilpotent import place_of


@kernel
def bend_flight(b, i, a, t_along):
    """work.second, after the impact, for flight i and the direction a (N,), t_along."""
    work, orbit, count, n = b.work, b.orbit, b.columns.shape[0], b.stops.shape[1]
    size, width = work.units.shape[0], 2 * n + 1 + count
    first, second = work.first, work.second
    flow, turn, phase = orbit.flow[i], orbit.turn[i, 0], orbit.phase[i]
    along, end_along = work.lines[0], work.lines[1]
    for r in range(size):
        along[r] = a[r] if r < 2 * n else phase[1, r] * a[2 * n]
    for r in range(2 * n):
        # The end along the direction.
        total = orbit.rate[i, 0, r] * t_along
        by_time = orbit.rate[i, 1, r] * t_along
        for c in range(size):
            total += flow[0, r, c] * along[c]
            by_time += turn[r, c] * along[c]
        for j in range(count):
            total += orbit.by_parameter[i, 1 + j, r] * a[2 * n + 1 + j]
            by_time += orbit.rate[i, 2 + j, r] * a[2 * n + 1 + j]
        end_along[r] = total
        first[r, width] = orbit.rate[i, 0, r]
        second[r, width] = by_time
        by_phase = 0.0
        by_phase_along = 0.0
        for c in range(size):
            change = turn[r, c] * t_along
            for j in range(count):
                change += flow[1 + j, r, c] * a[2 * n + 1 + j]
            if c < 2 * n:
                first[r, c] = flow[0, r, c]
                second[r, c] = change
            else:
                by_phase += flow[0, r, c] * phase[1, c]
                by_phase_along += change * phase[1, c] + flow[0, r, c] * phase[2, c] * a[2 * n]
        first[r, 2 * n] = by_phase
        second[r, 2 * n] = by_phase_along
        for j in range(count):
            total = t_along * orbit.rate[i, 2 + j, r]
            for c in range(size):
                total += flow[1 + j, r, c] * along[c]
            for other in range(count):
                total += orbit.by_parameter[i, place_of(count, j, other), r] * a[2 * n + 1 + other]
            first[r, 2 * n + 1 + j] = orbit.by_parameter[i, 1 + j, r]
            second[r, 2 * n + 1 + j] = total
    if b.contact[i, 0] >= 0:
        _bend_impact(b, i, a, end_along)


@inlined
def _bend_impact(b, i, a, end_along):
    """work.second after the impact at the end of flight i."""
    work, count, n = b.work, b.columns.shape[0], b.stops.shape[1]
    first, second = work.first, work.second
    gap, push = b.gap[i, :n], b.orbit.push[i]
    push_along = work.lines[2]
    speed = inner(gap, b.orbit.end[i, n : 2 * n])
    speed_along = inner(gap, end_along[n : 2 * n])
    bend_push(b, push, a, push_along)
    for c in range(2 * n + 2 + count):
        change = 0.0
        change_along = 0.0
        for r in range(n):
            change += gap[r] * first[n + r, c]
            change_along += gap[r] * second[n + r, c]
        for r in range(n):
            second[n + r, c] -= push[0, r] * change_along + push_along[r] * change
    for j in range(count):
        for r in range(n):
            bend = push_bend(b, push, a, j, r)
            second[n + r, 2 * n + 1 + j] -= push[1 + j, r] * speed_along + bend * speed


@inlined
def bend_push(b, push, a, out):
    """out (n,): a push (G, n) along the parameters of a direction."""
    n = push.shape[1]
    for r in range(n):
        total = 0.0
        for j in range(b.columns.shape[0]):
            total += push[1 + j, r] * a[2 * n + 1 + j]
        out[r] = total


@inlined
def push_bend(b, push, a, j, r):
    """Entry r of the second derivative of a push along a direction and by parameter j."""
    total = 0.0
    for other in range(b.columns.shape[0]):
        total += push[place_of(b.columns.shape[0], j, other), r] * a[2 * push.shape[1] + 1 + other]
    return total


@inlined
def entry_slope(b, a, row):
    """The derivative of an entry along a direction a (N,)."""
    total = 0.0
    for j in range(b.columns.shape[0]):
        total += b.orbit.entries[1 + j, row] * a[2 * b.stops.shape[1] + 1 + j]
    return total


@inlined
def entry_bend(b, a, j, row):
    """The second derivative of an entry along a direction a (N,) and by parameter j."""
    count = b.columns.shape[0]
    total = 0.0
    for other in range(count):
        total += b.orbit.entries[place_of(count, j, other), row] * a[2 * b.stops.shape[1] + 1 + other]
    return total


@inlined
def bend_bound(b, row, a, first, line):
    """Add the bound of a row of nodes to its equation; first: where the node's parameters begin. a (N,): the node's direction."""
    for j in range(b.columns.shape[0]):
        line[first + j] -= entry_bend(b, a, j, b.contact[row, 0])


@inlined
def bend_release(b, i, a, line):
    """line (N,): the equation of the contact force that vanishes after flight i, for the direction a (N,) of the node there."""
    orbit, count, n = b.orbit, b.columns.shape[0], b.stops.shape[1]
    phase, force = orbit.phase[i + 1], orbit.force[i]
    for c in range(force.shape[1]):
        slope = 0.0
        for j in range(count):
            slope += force[1 + j, c] * a[2 * n + 1 + j]
        if c < 2 * n:
            line[c] = slope
        else:
            line[2 * n] += slope * phase[1, c] + force[0, c] * phase[2, c] * a[2 * n]
    for j in range(count):
        total = 0.0
        for c in range(force.shape[1]):
            total += force[1 + j, c] * (a[c] if c < 2 * n else phase[1, c] * a[2 * n])
        for other in range(count):
            total += orbit.force_bend[i, place_of(count, j, other)] * a[2 * n + 1 + other]
        line[2 * n + 1 + j] = total
