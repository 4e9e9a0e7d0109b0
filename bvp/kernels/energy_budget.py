"""Where the energy of a motion goes: compensated sums of the integrals over its flights and of the losses of its impacts."""

import math

from bvp.kernels import contact_mode as entry
from bvp.kernels.arrays import dot
from bvp.kernels.compiled import kernel, part
from bvp.kernels.contact_mode import flight_of, times_matrix
from bvp.kernels.extrema import peak_flight
from bvp.kernels.flight import flow_state
from bvp.kernels.integral import integrals

MARK_LEVEL = 4e-16
"""Part of the initial energy to which the energy gone at a mark is met."""


@kernel
def add(sums, i, value):
    """Add to a compensated sum: sums[i, 0] + sums[i, 1] (Neumaier)."""
    total = sums[i, 0] + value
    if abs(sums[i, 0]) >= abs(value):
        sums[i, 1] += (sums[i, 0] - total) + value
    else:
        sums[i, 1] += (value - total) + sums[i, 0]
    sums[i, 0] = total


@part
def advance_clock(modes, clock, turns, flight):
    """Add a flight to the time, kept in two parts, and to the angles of the loads."""
    for g in range(modes.frequency.shape[0]):
        add(turns, g, modes.frequency[g] * flight)
    total = clock[entry.TIME] + flight
    clock[entry.TIME_LOW] += (clock[entry.TIME] - total) + flight if clock[entry.TIME] >= flight else (flight - total) + clock[entry.TIME]
    clock[entry.TIME] = total + clock[entry.TIME_LOW]
    clock[entry.TIME_LOW] = (total - clock[entry.TIME]) + clock[entry.TIME_LOW]


@kernel
def dissipated(sums, parts):
    """Sum of what the first `parts` sums hold."""
    total = 0.0
    for i in range(parts):
        total += sums[i, 0] + sums[i, 1]
    return total


@kernel
def note_mark(marks, counts, time, sums):
    """Write the time and the sums at the next mark."""
    row = counts[entry.MARK]
    marks[row, 1] = time
    for i in range(sums.shape[0]):
        marks[row, 2 + i] = sums[i, 0] + sums[i, 1]
    counts[entry.MARK] = row + 1


@part
def damped(modes, f, z, t, work, out):
    """What the dampers take over a flight of t from z; out (R,) the integrals."""
    integrals(flight_of(modes, f), modes.first[f], modes.second[f], modes.weight, z, t, work, out)
    total = 0.0
    for k in range(modes.part.shape[0]):
        if modes.part[k] < modes.shape[1]:
            total += out[k]
    return total


@part
def passes_mark(modes, total, counts, clock, sums, marks):
    """True where the next mark is passed while `total` more is dissipated."""
    return dissipated(sums, modes.shape[1] + modes.shape[2]) + total >= marks[counts[entry.MARK], 0] * clock[entry.INITIAL]


@kernel
def mark_flight(modes, f, z, flight, total, counts, clock, sums, marks, work, out):
    """Write the marks that are passed within a flight on which `total` is dissipated."""
    parts = modes.shape[1] + modes.shape[2]
    start = dissipated(sums, parts)
    while counts[entry.MARK] < marks.shape[0] and start + total >= marks[counts[entry.MARK], 0] * clock[entry.INITIAL]:
        wanted = marks[counts[entry.MARK], 0] * clock[entry.INITIAL] - start
        low = 0.0
        high = flight
        residual_low = -wanted
        residual_high = total - wanted
        at = high
        last = 0
        for _ in range(200):
            if residual_high <= 0.0 or residual_low >= 0.0 or high - low <= 4e-16 * high:
                break
            at = high - residual_high * (high - low) / (residual_high - residual_low)
            if not low < at < high:
                at = 0.5 * (low + high)
            residual = damped(modes, f, z, at, work, out) - wanted
            if abs(residual) <= MARK_LEVEL * clock[entry.INITIAL]:
                break
            if residual > 0.0:
                high = at
                residual_high = residual
                if last == 1:
                    residual_low *= 0.5
                last = 1
            else:
                low = at
                residual_low = residual
                if last == -1:
                    residual_high *= 0.5
                last = -1
        damped(modes, f, z, at, work, out)
        row = counts[entry.MARK]
        note_mark(marks, counts, clock[entry.TIME] + at, sums)
        for k in range(modes.part.shape[0]):
            marks[row, 2 + modes.part[k]] += out[k]


@part
def fly(modes, f, z, flight, counts, clock, turns, sums, marks, peaks, scratch):
    """Carry z, the clock, the sums and the peaks over a flight; False where the search for the peaks gave up, and where a block of rates
    so far apart overflows, all but the peaks as they were."""
    if flight == 0.0:
        return True
    work = scratch.work
    out = scratch.out
    integral_work = scratch.integral
    if peaks.shape[0]:
        if not peak_flight(flight_of(modes, f), modes.leave[f], z, flight, peaks, scratch.peak, scratch.edge, work):
            return False
    flow_state(flight_of(modes, f), z, flight, work[0])
    for r in range(z.shape[0]):
        if not abs(work[0, r]) < math.inf:
            return False
    total = damped(modes, f, z, flight, integral_work, out) if modes.part.shape[0] else 0.0
    if total > 0.0 and counts[entry.MARK] < marks.shape[0] and passes_mark(modes, total, counts, clock, sums, marks):
        mark_flight(modes, f, z, flight, total, counts, clock, sums, marks, integral_work, out)
        damped(modes, f, z, flight, integral_work, out)
    for k in range(modes.part.shape[0]):
        add(sums, modes.part[k], out[k])
    for r in range(z.shape[0]):
        z[r] = work[0, r]
    advance_clock(modes, clock, turns, flight)
    if modes.held[f] != 0:
        clock[entry.HELD_TIME] += flight
    return True


@part
def lose(modes, c, loss, counts, clock, sums, marks):
    """Add the loss of an impact at contact c."""
    add(sums, modes.shape[1] + modes.contact_stop[c], loss)
    if counts[entry.MARK] < marks.shape[0]:
        total = dissipated(sums, modes.shape[1] + modes.shape[2])
        while counts[entry.MARK] < marks.shape[0] and total >= marks[counts[entry.MARK], 0] * clock[entry.INITIAL]:
            note_mark(marks, counts, clock[entry.TIME], sums)


@part
def hold(modes, c, x, counts, clock, sums, marks, work):
    """Stop what is left of the velocity across contact c, as a loss at its stop."""
    times_matrix(modes.from_modes[0], x, work[0])
    speed = dot(modes.rate[0], c, work[0, : modes.matrix.shape[1]])
    loss = 0.5 * modes.contact_mass[c] * speed * speed
    lose(modes, c, loss, counts, clock, sums, marks)
    clock[entry.SPEED] = abs(speed)
    clock[entry.LOSS] = loss


@kernel
def record(log, kind, contact, counts, clock, before, z, sums):
    """Write one event, where there is room."""
    row = counts[entry.EVENTS]
    if row >= log.numbers.shape[0]:
        return
    log.numbers[row, 0] = kind
    log.numbers[row, 1] = contact
    log.numbers[row, 2] = counts[entry.MODE]
    log.values[row, 0] = clock[entry.TIME]
    log.values[row, 1] = clock[entry.SPEED]
    log.values[row, 2] = clock[entry.LOSS]
    for r in range(log.before.shape[1]):
        log.before[row, r] = before[r]
    for r in range(z.shape[0]):
        log.states[row, r] = z[r]
    for i in range(sums.shape[0]):
        log.sums[row, i] = sums[i, 0] + sums[i, 1]
    counts[entry.EVENTS] = row + 1


@kernel
def record_chatter(modes, f, log, counts, clock, before, z, sums, scratch):
    """Write that bounces are summed over the time up to now: a flight of the contact mode in which they end, up to the state z there."""
    span = clock[entry.SPAN]
    clock[entry.SPAN] = 0.0
    row = counts[entry.EVENTS]
    if row >= log.numbers.shape[0]:
        return
    back = scratch.peak[5, 0]
    flow_state(flight_of(modes, f), z, -span, back)
    record(log, entry.CHATTER, counts[entry.CONTACT], counts, clock, before, back, sums)
    log.values[row, 0] = clock[entry.TIME] - span
    damped(modes, f, back, span, scratch.integral, scratch.out)
    for k in range(modes.part.shape[0]):
        log.sums[row, modes.part[k]] -= scratch.out[k]
