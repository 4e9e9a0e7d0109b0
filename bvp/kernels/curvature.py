"""The second derivative of the multipoint problem along a direction, F''(y)[a, .], equations (38) to (43)."""

import math

from bvp.kernels.bent_orbit import bend_orbit
from bvp.kernels.compiled import inlined, kernel
from bvp.kernels.expressions import run
from bvp.kernels.flight import inner, set_1, set_2
from bvp.kernels.flight_curvature import (
    bend_bound,
    bend_flight,
    bend_push,
    bend_release,
    entry_bend,
    entry_slope,
    push_bend,
)
from bvp.kernels.multipoint import PERIODIC, STOP, UNFOLDED


@kernel
def second_along(b, y, a, out):
    """out (u - 1, u) = F''(y)[a, .] for the direction a (u,)."""
    width, k = b.gap.shape[1], b.shape[0]
    n, count = b.stops.shape[1], b.columns.shape[0]
    second = b.work.second
    set_2(out, 0.0)
    bend_orbit(b, y)
    at = 0
    for i in range(k + 1):
        direction = a[at : at + width]
        t, t_along = y[at + width], a[at + width]
        bend_flight(b, i, direction, t_along)
        closes = i == k
        for r in range(2 * n if not closes or b.shape[3] == PERIODIC else 0):
            for c in range(width + 1):
                out[at + r, at + c] = second[r, c]
        if closes and b.shape[3] != PERIODIC:
            _bend_end(b, a, out[at:])
        elif not closes or b.closing[1] != 0.0:
            # s + t w/(2 pi p)
            cycle = 2.0 * math.pi * b.load_periods
            out[at + 2 * n, at + width] = entry_slope(b, direction, b.frequency) / cycle
            for j in range(count):
                by_time = t_along * b.orbit.entries[1 + j, b.frequency] + t * entry_bend(b, direction, j, b.frequency)
                out[at + 2 * n, at + 2 * n + 1 + j] = by_time / cycle
        after = at + width + 1
        if not closes:
            line = out[at + width, after : after + width]
            if b.release[i] >= 0:
                bend_release(b, i, a[after : after + width], line)
            else:
                bend_bound(b, i, a[after : after + width], 2 * n + 1, line)
        at = after
    _bend_closure(b, y, a, out[k * (width + 1) :])


@inlined
def _bend_end(b, a, closing):
    """The conditions at the end of the segment, into the closing equations."""
    n, width, k = b.stops.shape[1], b.gap.shape[1], b.shape[0]
    at = k * (width + 1)
    for e in range(n):
        line = closing[n + e]
        stop = e == 0 and b.shape[4] == STOP
        for c in range(width + 1):
            total = 0.0
            for r in range(n if stop else 2 * n):
                total += (b.gap[k, r] if stop else b.end_map[n + e, r]) * b.work.second[r, c]
            line[at + c] += total
        if stop:
            bend_bound(b, k, a[at : at + width], at + 2 * n + 1, line)


@inlined
def _bend_closure(b, y, a, closing):
    """What the closing equations have of the first node, and of the unfolding."""
    n, count, k = b.stops.shape[1], b.columns.shape[0], b.shape[0]
    size, last = 2 * n, y.shape[0] - 1
    if b.shape[3] != PERIODIC:
        _bend_start(b, y, a, closing)
    elif b.contact[k, 0] >= 0:
        bend_bound(b, k, a, size + 1, closing[size + 1])
    if b.shape[1] == UNFOLDED:
        for r in range(size):
            line = closing[r]
            line[last] += _gradient_along(b, y, a, r)
            for c in range(n):
                entry = _energy_entry(b, r, c)
                line[c if r < n else n + c] += a[last] * b.orbit.entries[0, entry] + y[last] * entry_slope(b, a, entry)
            for j in range(count):
                bend = _gradient(b, 1 + j, a, r) + _gradient_bend(b, y, a, j, r)
                line[size + 1 + j] += y[last] * bend + a[last] * _gradient(b, 1 + j, y, r)
    if b.kept_out.shape[0] > 0:
        _bend_kept(b, y, a, closing[size + (2 if b.shape[3] == PERIODIC else 1) :])


@inlined
def _bend_start(b, y, a, closing):
    """The conditions at the start of the segment."""
    n, count, row = b.stops.shape[1], b.columns.shape[0], b.shape[0] + 1
    if b.contact[row, 0] < 0:
        return
    push, push_along = b.orbit.push[row], b.work.lines[2]
    bend_push(b, push, a, push_along)
    speed = inner(b.gap[row, :n], y[n : 2 * n])
    speed_along = inner(b.gap[row, :n], a[n : 2 * n])
    for e in range(n):
        line = closing[e]
        if e == 0:
            bend_bound(b, row, a, 2 * n + 1, line)
            continue
        for r in range(n):
            weight = b.end_map[e, n + r]
            for c in range(n):
                line[n + c] -= weight * push_along[r] * b.gap[row, c]
            for j in range(count):
                line[2 * n + 1 + j] -= weight * (push[1 + j, r] * speed_along + push_bend(b, push, a, j, r) * speed)


@inlined
def _energy_entry(b, r, c):
    """Where the matrix of the energy is among the entries: entry c of its row r in K, and of row r - n in M."""
    n = b.stops.shape[1]
    return 2 * n * n + r * n + c if r < n else (r - n) * n + c


@inlined
def _gradient(b, g, x, r):
    """Entry r of the derivative of the energy by the state x; g > 0: its derivatives by the parameters."""
    n = b.stops.shape[1]
    total = 0.0
    for c in range(n):
        total += b.orbit.entries[g, _energy_entry(b, r, c)] * x[c if r < n else n + c]
    return total


@inlined
def _gradient_slope(b, y, a, r):
    """Its derivative along the parameters of a direction."""
    n = b.stops.shape[1]
    total = 0.0
    for c in range(n):
        total += entry_slope(b, a, _energy_entry(b, r, c)) * y[c if r < n else n + c]
    return total


@inlined
def _gradient_along(b, y, a, r):
    """Its derivative along a direction."""
    return _gradient(b, 0, a, r) + _gradient_slope(b, y, a, r)


@inlined
def _gradient_bend(b, y, a, j, r):
    """Its second derivative along the parameters of a direction, and by parameter j."""
    n = b.stops.shape[1]
    total = 0.0
    for c in range(n):
        total += entry_bend(b, a, j, _energy_entry(b, r, c)) * y[c if r < n else n + c]
    return total


@inlined
def _bend_kept(b, y, a, closing):
    """The user's equations."""
    width, k = b.gap.shape[1], b.shape[0]
    count, size = b.columns.shape[0], 2 * b.stops.shape[1]
    names = b.values.shape[0]
    for i in range(names):
        b.kept_values[i] = b.values[i]
    variables = count + b.kept_values.shape[0] - names
    slope_along = b.work.lines[0]  # of all that they can name, along the direction
    for j in range(count):
        slope_along[j] = a[size + 1 + j]
    knows_energy = variables > count
    quarter = 1.0 / b.shape[2]
    if knows_energy:
        energy = 0.0
        energy_along = 0.0
        for r in range(size):
            energy += 0.5 * y[r] * _gradient(b, 0, y, r)
            energy_along += a[r] * _gradient(b, 0, y, r) + 0.5 * y[r] * _gradient_slope(b, y, a, r)
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
    bend = b.work.lines[1]  # the derivatives of an equation's derivatives along the direction
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
                total += 0.5 * bend[count] * y[r] * _gradient(b, 1 + j, y, r)
                total += slope * (a[r] * _gradient(b, 1 + j, y, r) + 0.5 * y[r] * _gradient_bend(b, y, a, j, r))
            line[size + 1 + j] += total
        for i in range(k + 1):
            line[i * (width + 1) + width] += bend[count + 1] * quarter
