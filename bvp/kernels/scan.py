"""Many starts at once: follow each through its impacts, and measure how far it misses each set of ends on its way.

For two degrees of freedom an orbit between ends is a zero of one number: what is transverse to the end's condition when the rest of
it holds. At an impact that is the velocity along the stop; where the gap coordinate passes zero, the other displacement (origin);
where its velocity passes zero, the other velocity (rest).
"""

import numpy as np
from numba import int64

from bvp.kernels.arrays import inner
from bvp.kernels.compiled import allocating, kernel
from bvp.kernels.extrema import crossings
from bvp.kernels.flight import block_product, flow_state
from bvp.kernels.impact import HIT, NONE, next_hit
from bvp.kernels.restitution import arrive, restitute
from bvp.kernels.segment import STOP


@allocating
def scan(
    flight, contacts, kind, transverse, functional, starts, wanted, most_impacts, longest, word, times, values, ends, status, nodes,
    instants, work,
):
    """Follow each row of `starts` (M, N) for up to `most_impacts` inner impacts and the time `longest`.

    kind: ORIGIN, REST or STOP. transverse (2, N): the row that measures the residual, twice (after an impact at either contact).
    functional (3, N): the row whose zeros are the crossings (origin, rest), its derivative and its second one.
    wanted (K + 1,): 1 where the crossings after k inner impacts are looked for.
    word (M, K + 1): contacts hit, -1 after the last. times, values (M, K + 1, C): time and residual of the c-th crossing after k inner
    impacts, NaN where there is none (for STOP, C = 1 and the crossing is impact k + 1 itself). ends (M,): time followed.
    status (M,): 0 followed to a limit, 1 the next impact was not found (sticking, or a search that gave up).
    nodes (M, K, N), instants (M, K): states after the inner impacts and their times; of length 0 where they are not wanted.
    work: of `impact.work_array`."""
    size = starts.shape[1]
    z = np.empty(size)
    before = np.empty(size)
    scratch = np.empty(size)
    crossing_times = np.empty(times.shape[2])
    for m in range(starts.shape[0]):
        for r in range(size):
            z[r] = starts[m, r]
        leaving = int64(-1)
        elapsed = 0.0
        status[m] = 0
        for k in range(most_impacts + 1):
            for r in range(size):
                before[r] = z[r]
            found, contact, duration = next_hit(flight, contacts, leaving, z, longest - elapsed, work, scratch)
            if found != HIT and found != NONE:
                status[m] = 1
                break
            if kind != STOP and wanted[k] == 1:
                count = crossings(
                    flight, functional[0], functional[1], functional[2], before, duration, crossing_times, scratch
                )
                if count < 0:
                    status[m] = 1
                    break
                for c in range(min(count, times.shape[2])):
                    flow_state(flight, before, crossing_times[c], scratch)
                    times[m, k, c] = elapsed + crossing_times[c]
                    values[m, k, c] = inner(transverse[0], scratch)
            elapsed += duration
            if found == NONE:
                break
            flow_state(flight, before, duration, scratch)
            word[m, k] = contact
            if kind == STOP:
                times[m, k, 0] = elapsed
                values[m, k, 0] = inner(transverse[0], scratch)
            restitute(contacts, contact, scratch, z)
            if nodes.shape[0] > 0 and k < most_impacts:
                instants[m, k] = elapsed
                for r in range(size):
                    nodes[m, k, r] = z[r]
            leaving = contact
        ends[m] = elapsed


ZERO, TURN = -1, -2
"""Kinds of event besides impacts, whose kind is the contact hit: the gap coordinate passes zero; its velocity does."""

FAILED, FULL = -1, -2
"""Counts of a motion that could not be followed (it sticks, or a search gave up), and of one with more events than there is room."""

CROSSING_ROOM = 256


@kernel
def event(flight, rows, c, z, change, time, state, state_change, velocity):
    """The state (N,) after `time` from z, and its derivative along rows[c] . state = constant where `change` is that of z. Returns the
    derivative of the time."""
    flow_state(flight, z, time, state)
    flow_state(flight, change, time, state_change)
    block_product(flight.pairs, flight.matrix, state, velocity)
    return arrive(rows, c, velocity, state_change)


@allocating
def sensitivities(
    flight, contacts, functional, starts, changes, longest, kinds, times, shifts, states, state_changes, counts, work
):
    """Follow each row of `starts` (M, N), whose derivative is that of `changes`, for the time `longest`.

    functional (4, N): the rows of the gap coordinate and of its first three derivatives.
    kinds, times, shifts (M, E): kind of each event in order of time, its time and the derivative of that. states, state_changes
    (M, E, N): the state there, before the impact where there is one, and its derivative.
    counts (M,): events, or FAILED or FULL. work: of `impact.work_array`."""
    size = starts.shape[1]
    room = kinds.shape[1]
    z, change, begin = np.empty(size), np.empty(size), np.empty(size)
    state, state_change, velocity = np.empty(size), np.empty(size), np.empty(size)
    zeros, turns = np.empty(CROSSING_ROOM), np.empty(CROSSING_ROOM)
    for m in range(starts.shape[0]):
        for r in range(size):
            z[r] = starts[m, r]
            change[r] = changes[m, r]
        leaving = int64(-1)
        elapsed = 0.0
        lag = 0.0
        count = 0
        while True:
            for r in range(size):
                begin[r] = z[r]
            found, contact, duration = next_hit(flight, contacts, leaving, z, longest - elapsed, work, state)
            if found != HIT and found != NONE:
                count = FAILED
                break
            first = crossings(flight, functional[0], functional[1], functional[2], begin, duration, zeros, state)
            second = crossings(flight, functional[1], functional[2], functional[3], begin, duration, turns, state)
            if first < 0 or second < 0 or first > CROSSING_ROOM or second > CROSSING_ROOM:
                count = FAILED
                break
            last = 1 if found == HIT else 0
            if count + first + second + last > room:
                count = FULL
                break
            i = 0
            j = 0
            while i < first or j < second:
                if j == second or (i < first and zeros[i] <= turns[j]):
                    kind = ZERO
                    time = zeros[i]
                    i += 1
                else:
                    kind = TURN
                    time = turns[j]
                    j += 1
                shift = event(flight, functional, 0 if kind == ZERO else 1, begin, change, time, state, state_change, velocity)
                kinds[m, count] = kind
                times[m, count] = elapsed + time
                shifts[m, count] = lag + shift
                for r in range(size):
                    states[m, count, r] = state[r]
                    state_changes[m, count, r] = state_change[r]
                count += 1
            if found == NONE:
                break
            shift = event(flight, contacts.gap, contact, begin, change, duration, state, state_change, velocity)
            elapsed += duration
            lag += shift
            kinds[m, count] = contact
            times[m, count] = elapsed
            shifts[m, count] = lag
            for r in range(size):
                states[m, count, r] = state[r]
                state_changes[m, count, r] = state_change[r]
            count += 1
            restitute(contacts, contact, state, z)
            # Restitution is linear, so it maps the derivative as it maps the state. The next flight begins at the impact.
            restitute(contacts, contact, state_change, change)
            leaving = contact
        counts[m] = count
