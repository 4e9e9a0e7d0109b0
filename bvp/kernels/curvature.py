"""The second derivative of the multipoint problem along a direction, F''(y)[a, .], equations (38) to (43)."""

from bvp.kernels.compiled import inlined, kernel
from bvp.kernels.expressions import run
from bvp.kernels.flight import inner, set_1, set_2
from bvp.kernels.flight_curvature import bend_bound, bend_flight, bend_impact, bend_release, set_direction, set_motion, set_push
from bvp.kernels.multipoint import PERIODIC, STOP, UNFOLDED


@kernel
def second_along(b, y, a, out):
    """out (u - 1, u) = F''(y)[a, .] for the direction a (u,)."""
    width = b.gap.shape[1]
    n, count = b.drive.shape[1], b.by_parameter.shape[0]
    k = b.shape[0]
    set_2(out, 0.0)
    for j in range(count):
        b.values[b.columns[j]] = y[2 * n + 1 + j]
    run(b.program, b.values, b.scratch, b.out)
    for d in range(b.rows.shape[0]):
        b.entries[0, b.rows[d]] = b.out[d]
    at = 0
    for i in range(k + 1):
        node, direction = y[at : at + width], a[at : at + width]
        t, t_along = y[at + width], a[at + width]
        set_direction(b, direction[2 * n + 1 :])
        bend_flight(b, i, node, t, direction, t_along)
        bend_impact(b, i)
        closes = i == k
        for r in range(2 * n if not closes or b.shape[3] == PERIODIC else 0):
            for c in range(width + 1):
                out[at + r, at + c] = b.second[r, c]
        if closes and b.shape[3] != PERIODIC:
            _bend_end(b, at, out[at:])
        elif not closes or b.closing[1] != 0.0:
            # s + t w/(2 pi p)
            cycle = 2.0 * 3.141592653589793 * b.load_periods
            out[at + 2 * n, at + width] = b.entries[1, b.frequency] / cycle
            for j in range(count):
                by_time = t_along * b.entries[2 + j, b.frequency] + t * b.entries[2 + count + j, b.frequency]
                out[at + 2 * n, at + 2 * n + 1 + j] = by_time / cycle
        after = at + width + 1
        if not closes:
            line = out[at + width, after : after + width]
            set_direction(b, a[after + 2 * n + 1 : after + width])
            if b.release[i] >= 0:
                bend_release(b, i, y[after : after + width], a[after : after + width], line)
            else:
                bend_bound(b, i, 2 * n + 1, line)
        at = after
    _bend_closure(b, y, a, out[k * (width + 1) :])


@inlined
def _bend_end(b, at, closing):
    """The conditions at the end of the segment, into the closing equations; at: where the unknowns of its last flight begin."""
    n, width, k = b.drive.shape[1], b.gap.shape[1], b.shape[0]
    for e in range(n):
        line = closing[n + e]
        stop = e == 0 and b.shape[4] == STOP
        for c in range(width + 1):
            total = 0.0
            for r in range(n if stop else 2 * n):
                total += (b.gap[k, r] if stop else b.end_map[n + e, r]) * b.second[r, c]
            line[at + c] += total
        if stop:
            bend_bound(b, k, at + 2 * n + 1, line)


@inlined
def _bend_closure(b, y, a, closing):
    """What the closing equations have of the first node, and of the unfolding."""
    n, count, k = b.drive.shape[1], b.by_parameter.shape[0], b.shape[0]
    size, last = 2 * n, y.shape[0] - 1
    set_direction(b, a[size + 1 : size + 1 + count])
    if b.shape[3] != PERIODIC:
        _bend_start(b, y, a, closing)
    elif b.contact[k, 0] >= 0:
        bend_bound(b, k, size + 1, closing[size + 1])
    if b.shape[1] == UNFOLDED:
        for r in range(size):
            line = closing[r]
            line[last] += _gradient_along(b, y, a, r)
            for c in range(n):
                line[c if r < n else n + c] += a[last] * _energy_entry(b, 0, r, c) + y[last] * _energy_entry(b, 1, r, c)
            for j in range(count):
                bend = _gradient(b, 2 + j, a, r) * y[last] + _gradient(b, 2 + count + j, y, r) * y[last]
                line[size + 1 + j] += bend + a[last] * _gradient(b, 2 + j, y, r)
    if b.kept_out.shape[0] > 0:
        _bend_kept(b, y, a, closing[size + (2 if b.shape[3] == PERIODIC else 1) :])


@inlined
def _bend_start(b, y, a, closing):
    """The conditions at the start of the segment."""
    n, count, row = b.drive.shape[1], b.by_parameter.shape[0], b.shape[0] + 1
    if b.contact[row, 0] < 0:
        return
    set_motion(b, b.mode[row], -1)
    set_push(b, row)
    push = b.column[0]
    speed = inner(b.gap[row, :n], y[n : 2 * n])
    speed_along = inner(b.gap[row, :n], a[n : 2 * n])
    for e in range(n):
        line = closing[e]
        if e == 0:
            bend_bound(b, row, 2 * n + 1, line)
            continue
        for r in range(n):
            weight = b.end_map[e, n + r]
            for c in range(n):
                line[n + c] -= weight * push[1, r, 0] * b.gap[row, c]
            for j in range(count):
                line[2 * n + 1 + j] -= weight * (push[2 + j, r, 0] * speed_along + push[2 + count + j, r, 0] * speed)


@inlined
def _energy_entry(b, g, r, c):
    """The matrix of the energy: entry c of its row r in K, and of row r - n in M."""
    n = b.drive.shape[1]
    return b.entries[g, 2 * n * n + r * n + c if r < n else (r - n) * n + c]


@inlined
def _gradient(b, g, x, r):
    """Entry r of the derivative of the energy by the state x."""
    n = b.drive.shape[1]
    total = 0.0
    for c in range(n):
        total += _energy_entry(b, g, r, c) * x[c if r < n else n + c]
    return total


@inlined
def _gradient_along(b, y, a, r):
    """Its derivative along the direction."""
    return _gradient(b, 0, a, r) + _gradient(b, 1, y, r)


@inlined
def _bend_kept(b, y, a, closing):
    """The user's equations."""
    width, k = b.gap.shape[1], b.shape[0]
    count, size = b.by_parameter.shape[0], 2 * b.drive.shape[1]
    names = b.values.shape[0]
    for i in range(names):
        b.kept_values[i] = b.values[i]
    variables = count + b.kept_values.shape[0] - names
    slope_along = b.lines[8]  # of all that they can name, along the direction
    for j in range(count):
        slope_along[j] = a[size + 1 + j]
    knows_energy = variables > count
    quarter = 1.0 / b.shape[2]
    if knows_energy:
        energy = 0.0
        energy_along = 0.0
        for r in range(size):
            energy += 0.5 * y[r] * _gradient(b, 0, y, r)
            energy_along += a[r] * _gradient(b, 0, y, r) + 0.5 * y[r] * _gradient(b, 1, y, r)
        total = 0.0
        total_along = 0.0
        for i in range(k + 1):
            total += y[i * (width + 1) + width]
            total_along += a[i * (width + 1) + width]
        b.kept_values[names] = energy
        b.kept_values[names + 1] = total * quarter
        slope_along[count] = energy_along
        slope_along[count + 1] = total_along * quarter
    run(b.kept, b.kept_values, b.scratch, b.kept_out)
    equations = b.kept_out.shape[0] // (1 + variables + variables * variables)
    bend = b.lines[9]  # the derivatives of an equation's derivatives along the direction
    for e in range(equations):
        line = closing[e]
        set_1(bend, 0.0)
        first = equations * (1 + variables) + e * variables * variables
        for j in range(variables):
            bend[j] = inner(b.kept_out[first + j * variables : first + (j + 1) * variables], slope_along)
        for j in range(count):
            line[size + 1 + j] += bend[j]
        if not knows_energy:
            continue
        slope = b.kept_out[equations + e * variables + count]
        for r in range(size):
            line[r] += bend[count] * _gradient(b, 0, y, r) + slope * _gradient_along(b, y, a, r)
        for j in range(count):
            total = 0.0
            for r in range(size):
                total += 0.5 * bend[count] * y[r] * _gradient(b, 2 + j, y, r)
                total += slope * (a[r] * _gradient(b, 2 + j, y, r) + 0.5 * y[r] * _gradient(b, 2 + count + j, y, r))
            line[size + 1 + j] += total
        for i in range(k + 1):
            line[i * (width + 1) + width] += bend[count + 1] * quarter
