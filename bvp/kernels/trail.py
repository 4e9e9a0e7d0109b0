"""The trail of a motion: its impacts, the zeros and the turning points of its gap coordinate, and how all of them move with a parameter.

The start depends on a parameter; its derivative is carried along by the variational equation. The time of an event that row . z = 0
tells moves by -(row . dz)/(row . z'), and the state there by what the flow and this shift make of it.
"""


import numpy as np
from numba import int64

from bvp.kernels.compiled import allocating, kernel
from bvp.kernels.extrema import dot
from bvp.kernels.flight import block_product, flow_state
from bvp.kernels.impact import HIT, NONE, TOUCH, next_impact
from bvp.kernels.restitution import restitute
from bvp.kernels.scan import crossings

__all__ = ["FAILED", "FULL", "TURN", "ZERO", "event", "trail"]

ZERO, TURN = -1, -2
"""Kinds of event besides impacts, whose kind is the contact hit: the gap coordinate passes zero; its velocity does."""

FAILED, FULL = -1, -2
"""Counts of a motion that could not be followed (it sticks, or a search gave up), and of one with more events than there is room."""

PASSAGE_ROOM = 256


@kernel
def event(pairs, mean, delta, matrix, row, z, change, time, state, state_change, velocity):
    """The state (N,) after `time` from z, and its derivative along row . state = constant where `change` is that of z. Returns the
    derivative of the time."""
    flow_state(pairs, mean, delta, matrix, z, time, state)
    flow_state(pairs, mean, delta, matrix, change, time, state_change)
    block_product(pairs, matrix, state, velocity)
    shift = -dot(row, state_change) / dot(row, velocity)
    for r in range(z.shape[0]):
        state_change[r] += shift * velocity[r]
    return shift


@allocating
def trail(
    pairs, mean, delta, matrix, gap, gap_rate, acceleration, side, bound, push, restitution, functional, starts, changes, longest,
    kinds, times, shifts, states, state_changes, counts, work,
):  # fmt: skip
    """Follow each row of `starts` (M, N), whose derivative is that of `changes`, for the time `longest`.

    functional (4, N): the rows of the gap coordinate and of its first three derivatives.
    kinds, times, shifts (M, E): kind of each event in order of time, its time and the derivative of that. states, state_changes
    (M, E, N): the state there, before the impact where there is one, and its derivative.
    counts (M,): events, or FAILED or FULL. work: of `impact.work_array`."""
    size = starts.shape[1]
    room = kinds.shape[1]
    z, change, begin = np.empty(size), np.empty(size), np.empty(size)
    state, state_change, velocity = np.empty(size), np.empty(size), np.empty(size)
    zeros, turns = np.empty(PASSAGE_ROOM), np.empty(PASSAGE_ROOM)
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
            duration = 0.0
            while True:
                found, contact, time = next_impact(
                    pairs, mean, delta, matrix, gap, gap_rate, acceleration, side, bound, leaving, z, longest - elapsed - duration, work
                )
                duration += time
                if found != TOUCH:
                    break
                flow_state(pairs, mean, delta, matrix, z, time, state)
                for r in range(size):
                    z[r] = state[r]
                leaving = contact
            if found != HIT and found != NONE:
                count = FAILED
                break
            first = crossings(pairs, mean, delta, matrix, functional[0], functional[1], functional[2], begin, duration, zeros, state)
            second = crossings(pairs, mean, delta, matrix, functional[1], functional[2], functional[3], begin, duration, turns, state)
            if first < 0 or second < 0 or first > PASSAGE_ROOM or second > PASSAGE_ROOM:
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
                row = functional[0] if kind == ZERO else functional[1]
                shift = event(pairs, mean, delta, matrix, row, begin, change, time, state, state_change, velocity)
                kinds[m, count] = kind
                times[m, count] = elapsed + time
                shifts[m, count] = lag + shift
                for r in range(size):
                    states[m, count, r] = state[r]
                    state_changes[m, count, r] = state_change[r]
                count += 1
            if found == NONE:
                break
            shift = event(pairs, mean, delta, matrix, gap[contact], begin, change, duration, state, state_change, velocity)
            elapsed += duration
            lag += shift
            kinds[m, count] = contact
            times[m, count] = elapsed
            shifts[m, count] = lag
            for r in range(size):
                states[m, count, r] = state[r]
                state_changes[m, count, r] = state_change[r]
            count += 1
            restitute(gap_rate, push, restitution, contact, state, z)
            # Restitution is linear, so it maps the derivative as it maps the state. The next flight begins at the impact.
            restitute(gap_rate, push, restitution, contact, state_change, change)
            leaving = contact
        counts[m] = count
