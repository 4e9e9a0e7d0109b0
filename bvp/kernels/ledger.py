"""Where the energy of a motion goes: compensated sums of the integrals over its flights and of the losses of its impacts."""

import math

from bvp.kernels.bounds import dot
from bvp.kernels.compiled import kernel, part
from bvp.kernels.flight import flow_state
from bvp.kernels.integral import integrals
from bvp.kernels.peaks import peak_flight
from bvp.kernels.phase import (
    CHATTER,
    CONTACT,
    EVENTS,
    HELD_TIME,
    INITIAL,
    LOSS,
    MARK,
    PHASE,
    SPAN,
    SPEED,
    TIME,
    TIME_LOW,
    times_matrix,
)  # fmt: skip

__all__ = ["add", "advance_clock", "damped", "dissipated", "fly", "hold", "lose", "record", "record_chatter"]

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
def advance_clock(phases, clock, turns, flight):
    """Add a flight to the time, kept in two parts, and to the angles of the loads."""
    for g in range(phases.frequency.shape[0]):
        add(turns, g, phases.frequency[g] * flight)
    total = clock[TIME] + flight
    clock[TIME_LOW] += (clock[TIME] - total) + flight if clock[TIME] >= flight else (flight - total) + clock[TIME]
    clock[TIME] = total + clock[TIME_LOW]
    clock[TIME_LOW] = (total - clock[TIME]) + clock[TIME_LOW]


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
    row = counts[MARK]
    marks[row, 1] = time
    for i in range(sums.shape[0]):
        marks[row, 2 + i] = sums[i, 0] + sums[i, 1]
    counts[MARK] = row + 1


@part
def damped(phases, f, z, t, work, out):
    """What the dampers take over a flight of t from z; out (R,) the integrals."""
    integrals(
        phases.pairs[f], phases.mean[f], phases.delta[f], phases.matrix[f], phases.first[f], phases.second[f],
        phases.weight, z, t, work, out,
    )  # fmt: skip
    total = 0.0
    for k in range(phases.part.shape[0]):
        if phases.part[k] < phases.shape[1]:
            total += out[k]
    return total


@part
def passes_mark(phases, total, counts, clock, sums, marks):
    """True where the next mark is passed while `total` more is dissipated."""
    return dissipated(sums, phases.shape[1] + phases.shape[2]) + total >= marks[counts[MARK], 0] * clock[INITIAL]


@kernel
def mark_flight(phases, f, z, flight, total, counts, clock, sums, marks, work, out):
    """Write the marks that are passed within a flight on which `total` is dissipated."""
    parts = phases.shape[1] + phases.shape[2]
    start = dissipated(sums, parts)
    while counts[MARK] < marks.shape[0] and start + total >= marks[counts[MARK], 0] * clock[INITIAL]:
        wanted = marks[counts[MARK], 0] * clock[INITIAL] - start
        low = 0.0
        high = flight
        miss_low = -wanted
        miss_high = total - wanted
        at = high
        last = 0
        for _ in range(200):
            if miss_high <= 0.0 or miss_low >= 0.0 or high - low <= 4e-16 * high:
                break
            at = high - miss_high * (high - low) / (miss_high - miss_low)
            if not low < at < high:
                at = 0.5 * (low + high)
            miss = damped(phases, f, z, at, work, out) - wanted
            if abs(miss) <= MARK_LEVEL * clock[INITIAL]:
                break
            if miss > 0.0:
                high = at
                miss_high = miss
                if last == 1:
                    miss_low *= 0.5
                last = 1
            else:
                low = at
                miss_low = miss
                if last == -1:
                    miss_high *= 0.5
                last = -1
        damped(phases, f, z, at, work, out)
        row = counts[MARK]
        note_mark(marks, counts, clock[TIME] + at, sums)
        for k in range(phases.part.shape[0]):
            marks[row, 2 + phases.part[k]] += out[k]


@part
def fly(phases, f, z, flight, counts, clock, turns, sums, marks, peaks, scratch):
    """Carry z, the clock, the sums and the peaks over a flight; False where the search for the peaks gave up, and where a block of rates
    so far apart overflows, all but the peaks as they were."""
    if flight == 0.0:
        return True
    work = scratch.work
    out = scratch.out
    integral_work = scratch.integral
    if peaks.shape[0]:
        blocks = phases.pairs[f], phases.mean[f], phases.delta[f], phases.matrix[f]
        if not peak_flight(*blocks, phases.leave[f], z, flight, peaks, scratch.peak, scratch.edge, work):
            return False
    flow_state(phases.pairs[f], phases.mean[f], phases.delta[f], phases.matrix[f], z, flight, work[0])
    for r in range(z.shape[0]):
        if not abs(work[0, r]) < math.inf:
            return False
    total = damped(phases, f, z, flight, integral_work, out) if phases.part.shape[0] else 0.0
    if total > 0.0 and counts[MARK] < marks.shape[0] and passes_mark(phases, total, counts, clock, sums, marks):
        mark_flight(phases, f, z, flight, total, counts, clock, sums, marks, integral_work, out)
        damped(phases, f, z, flight, integral_work, out)
    for k in range(phases.part.shape[0]):
        add(sums, phases.part[k], out[k])
    for r in range(z.shape[0]):
        z[r] = work[0, r]
    advance_clock(phases, clock, turns, flight)
    if phases.held[f] != 0:
        clock[HELD_TIME] += flight
    return True


@part
def lose(phases, c, loss, counts, clock, sums, marks):
    """Add the loss of an impact at contact c."""
    add(sums, phases.shape[1] + phases.contact_stop[c], loss)
    if counts[MARK] < marks.shape[0]:
        total = dissipated(sums, phases.shape[1] + phases.shape[2])
        while counts[MARK] < marks.shape[0] and total >= marks[counts[MARK], 0] * clock[INITIAL]:
            note_mark(marks, counts, clock[TIME], sums)


@part
def hold(phases, c, x, counts, clock, sums, marks, work):
    """Stop what is left of the velocity across contact c, as a loss at its stop."""
    times_matrix(phases.from_modes[0], x, work[0])
    speed = dot(phases.rate[0], c, work[0, : phases.matrix.shape[1]])
    loss = 0.5 * phases.contact_mass[c] * speed * speed
    lose(phases, c, loss, counts, clock, sums, marks)
    clock[SPEED] = abs(speed)
    clock[LOSS] = loss


@kernel
def record(log, kind, contact, counts, clock, before, z, sums):
    """Write one event, where there is room."""
    row = counts[EVENTS]
    if row >= log.numbers.shape[0]:
        return
    log.numbers[row, 0] = kind
    log.numbers[row, 1] = contact
    log.numbers[row, 2] = counts[PHASE]
    log.values[row, 0] = clock[TIME]
    log.values[row, 1] = clock[SPEED]
    log.values[row, 2] = clock[LOSS]
    for r in range(log.before.shape[1]):
        log.before[row, r] = before[r]
    for r in range(z.shape[0]):
        log.states[row, r] = z[r]
    for i in range(sums.shape[0]):
        log.sums[row, i] = sums[i, 0] + sums[i, 1]
    counts[EVENTS] = row + 1


@kernel
def record_chatter(phases, f, log, counts, clock, before, z, sums, scratch):
    """Write that bounces are summed over the time up to now: a flight of the phase in which they end, up to the state z there."""
    span = clock[SPAN]
    clock[SPAN] = 0.0
    row = counts[EVENTS]
    if row >= log.numbers.shape[0]:
        return
    back = scratch.peak[5, 0]
    flow_state(phases.pairs[f], phases.mean[f], phases.delta[f], phases.matrix[f], z, -span, back)
    record(log, CHATTER, counts[CONTACT], counts, clock, before, back, sums)
    log.values[row, 0] = clock[TIME] - span
    damped(phases, f, back, span, scratch.integral, scratch.out)
    for k in range(phases.part.shape[0]):
        log.sums[row, phases.part[k]] -= scratch.out[k]
