"""Many motions in one call, and what a recorded motion was at any time."""

import math

from bvp.kernels import contact_mode as entry
from bvp.kernels.compiled import kernel
from bvp.kernels.contact_mode import begin_anew, flight_of, times_matrix
from bvp.kernels.energy_budget import damped
from bvp.kernels.extrema import peak_flight
from bvp.kernels.flight import flight_at, flow_state
from bvp.kernels.motion import NEW_MODE, PAUSED, REACHED, move


@kernel
def many(modes, starts, duration, most, first, fractions, z, x, counts, clock, turns, sums, marks, peaks, log, scratch, summary, modal):
    """Motions from starts (B, 2 n), the `first`-th and on, without a record of events; starts become final states, modal (B, 2 n) their
    modal coordinates.

    Row of summary (B, 9 + (D + S + 1) + Q (D + S + 2) + n): reason, time reached, impacts, touches, last impact (NaN: none), clear
    from (NaN: not proven), time held, initial energy (given), 0, sums, each mark's time (NaN: not reached) and
    sums, peaks where they are wanted.

    Returns (reason, start): NEW_MODE at the start that wants one more contact mode - add it and call again from there; PAUSED where
    counts[PASSES] are used up, of which counts[RUNNING] tells the next call to go on; or REACHED and B.
    """
    width = 2 * modes.shape[0]
    parts = sums.shape[0]
    for b in range(first, starts.shape[0]):
        if counts[entry.RUNNING] == 0:
            begin_anew(counts, clock, turns, sums)
            for k in range(width):
                x[k] = starts[b, k]
            clock[entry.INITIAL] = summary[b, 7]
            for q in range(fractions.shape[0]):
                marks[q, 0] = fractions[q]
            if not clock[entry.INITIAL] > 0.0:
                counts[entry.MARK] = fractions.shape[0]
            for k in range(peaks.shape[0]):
                peaks[k] = 0.0
        counts[entry.RUNNING] = 0
        status = move(
            modes, duration, most, z, x, counts, clock, turns, sums, marks, peaks, log, scratch
        )
        if status == PAUSED:
            counts[entry.RUNNING] = 1
        if status == NEW_MODE or status == PAUSED:
            return status, b
        row = summary[b]
        row[0] = status
        row[1] = duration if status == REACHED else clock[entry.TIME]
        row[2] = counts[entry.IMPACTS]
        row[3] = counts[entry.TOUCHES]
        row[4] = clock[entry.LAST_IMPACT] if counts[entry.IMPACTS] > 0 else math.nan
        row[5] = clock[entry.CLEAR_TIME] if counts[entry.CLEAR] > 0 else math.nan
        row[6] = clock[entry.HELD_TIME]
        times_matrix(modes.leave[counts[entry.MODE]], z, x)
        for k in range(width):
            starts[b, k] = x[k]
        times_matrix(modes.to_modes[counts[entry.MODE]], z, modal[b])
        for k in range(parts):
            row[9 + k] = sums[k, 0] + sums[k, 1]
        at = 9 + parts
        reached = counts[entry.MARK] if clock[entry.INITIAL] > 0.0 else 0
        for q in range(fractions.shape[0]):
            for k in range(1 + parts):
                row[at + k] = marks[q, 1 + k] if q < reached else math.nan
            at += 1 + parts
        for k in range(peaks.shape[0]):
            row[at + k] = peaks[k]
    return REACHED, starts.shape[0]


@kernel
def states_after(modes, numbers, states, out):
    """out[k] = (u, v) with which the k-th flight begins, of flights as in `sample`."""
    for k in range(states.shape[0]):
        times_matrix(modes.leave[numbers[k, 2]], states[k], out[k])


@kernel
def sample(modes, begins, numbers, states, times, z, out):
    """out[i] = (u, v) at times[i] of flights that begin at begins (ascending) in the modes numbers[:, 2] with the given states; the last
    begin counts. z (N,) is scratch."""
    for i in range(times.shape[0]):
        k = flight_at(begins, times[i])
        f = numbers[k, 2]
        flow_state(flight_of(modes, f), states[k], times[i] - begins[k], z)
        times_matrix(modes.leave[f], z, out[i])


@kernel
def spent(modes, begins, numbers, states, sums, times, work, integral, out):
    """out[i] = the sums at times[i], of flights as in `sample` that begin with the given sums."""
    for i in range(times.shape[0]):
        k = flight_at(begins, times[i])
        f = numbers[k, 2]
        damped(modes, f, states[k], times[i] - begins[k], work, integral)
        for p in range(out.shape[1]):
            out[i, p] = sums[k, p]
        for r in range(modes.part.shape[0]):
            out[i, modes.part[r]] += integral[r]


@kernel
def raise_peaks(modes, begins, numbers, states, end, scratch, edge, work, peaks):
    """peaks (n,): the larger of themselves and |u| over flights as in `sample`, the last of which ends at `end`; scratch, edge, work and
    what is returned are those of `peak_flight`."""
    for k in range(begins.shape[0]):
        f = numbers[k, 2]
        flight = (begins[k + 1] if k + 1 < begins.shape[0] else end) - begins[k]
        if not peak_flight(flight_of(modes, f), modes.leave[f], states[k], flight, peaks, scratch, edge, work):
            return False
    return True
