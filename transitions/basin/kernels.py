"""The kernel of many starts under periodic loads: each is followed until it is caught in the neighbourhood of a known attractor.

A neighbourhood is an ellipsoid around the state x* of a stable periodic motion at phase 0, |L (x - x*)| <= r. The stroboscopic map over the
period of this motion brings states in it closer to x* by a factor (`transitions.basin.neighbourhood`). A start is caught if its state is in
the ellipsoid, the same contacts stick, and its own return is closer by this factor.
"""

from typing import NamedTuple

import numpy as np
from numpy import int64

from bvp.kernels import contact_mode as entry
from bvp.kernels.compiled import kernel
from bvp.kernels.contact_mode import begin_anew
from bvp.kernels.flight import copy_1, set_1
from bvp.kernels.motion import NEW_MODE, PAUSED, REACHED
from transitions.sweep.kernels import CLOCKS, DONE, KEPT, PLACES, follow_periods

__all__ = ["CAUGHT", "ENDED", "LEFT", "OPEN", "Known", "Starts", "follow_starts"]

OPEN, CAUGHT, LEFT, ENDED = range(4)
"""What became of a start: all its periods are over; it was caught; it left all bounds; its simulation could not go on."""

NEXT, RUNNING, PERIOD, NEAR, DUE, NUMBERS = range(6)
"""Entries of `Starts.numbers`: the start that is followed; whether it is under way; its periods that are over, -1 before the first phase 0;
the row whose neighbourhood it has entered, or -1; the period of its return; and their number."""

ROUNDED = 1e-6
"""Part of the size of a neighbourhood within which a return counts in any case: closer to x* rounding decides."""


class Known(NamedTuple):
    """K rows, one for each state at phase 0 of the known stable periodic motions."""

    states: np.ndarray  # (K, 2 n) x*
    metric: np.ndarray  # (K, 2 n, 2 n) L, upper triangular
    sizes: np.ndarray  # (K,) r
    factors: np.ndarray  # (K,) by which a return is closer
    numbers: np.ndarray  # (K, 2) int64: period; bits of the contacts that stick


class Starts(NamedTuple):
    """B starts, and what became of them."""

    states: np.ndarray  # (B, 2 n) (u, v); become the last states at phase 0
    sticking: np.ndarray  # (B,) int64 bits of the contacts that stick; become those of the last states
    energies: np.ndarray  # (B,) of the starts
    angles: np.ndarray  # (G,) of the loads at the start
    outcome: np.ndarray  # (B, 5) int64: OPEN .. ENDED; row of `Known` or reason of `move`; periods; impacts; 1 if stops stuck
    numbers: np.ndarray  # (NUMBERS,) int64
    nearness: np.ndarray  # (1,) distance from x* at which the neighbourhood was entered


@kernel
def begin_start(starts, forced):
    """Begin the motion of the next start."""
    b = starts.numbers[NEXT]
    motion = forced.motion
    begin_anew(motion)
    motion.counts[entry.PENDING] = starts.sticking[b]
    motion.clock[entry.INITIAL] = starts.energies[b]
    width = starts.states.shape[1]
    copy_1(starts.states[b], motion.x[:width])
    for g in range(starts.angles.shape[0]):
        motion.angles[g, 0] = starts.angles[g]
    set_1(forced.begin, 0.0)
    set_1(forced.tangent, 1.0)
    for k in range(PLACES):
        forced.places[k] = 0
    for k in range(CLOCKS):
        forced.clocks[k] = 0.0
    forced.places[KEPT] = starts.sticking[b]
    starts.numbers[RUNNING] = 1
    starts.numbers[NEAR] = -1


@kernel
def distance_from(known, row, state):
    """|L (x - x*)|^2 of a row of `known`."""
    total = 0.0
    for i in range(state.shape[0]):
        part = 0.0
        for j in range(i, state.shape[0]):
            part += known.metric[row, i, j] * (state[j] - known.states[row, j])
        total += part * part
    return total


@kernel
def caught_by(known, starts, state, sticking):
    """The row of `known` that catches a start in this state after a period, or -1."""
    numbers = starts.numbers
    if numbers[NEAR] >= 0:
        row = numbers[NEAR]
        if numbers[PERIOD] < numbers[DUE]:
            return -1
        numbers[NEAR] = -1
        bound = max(known.factors[row] * known.factors[row] * starts.nearness[0], (ROUNDED * known.sizes[row]) ** 2)
        if known.numbers[row, 1] == sticking and distance_from(known, row, state) <= bound:
            return row
    for row in range(known.sizes.shape[0]):
        if known.numbers[row, 1] == sticking:
            found = distance_from(known, row, state)
            if found <= known.sizes[row] * known.sizes[row]:
                numbers[NEAR] = row
                numbers[DUE] = numbers[PERIOD] + known.numbers[row, 0]
                starts.nearness[0] = found
                return -1
    return -1


@kernel
def follow_starts(modes, carry, period, first, most, bound, starts, known, forced, strobes, impacts, work):
    """Follow starts until each is caught, has left the bounds, or has had its periods.

    first: time from the start to phase 0. most: periods. bound: of each |u| and |v|. strobes: with one row. impacts: without rows. The
    other arguments are those of `follow_periods`.

    Returns REACHED when all are done. NEW_MODE, PAUSED: as `move` does, to be called again."""
    numbers, motion = starts.numbers, forced.motion
    while numbers[NEXT] < starts.states.shape[0]:
        b = numbers[NEXT]
        if numbers[RUNNING] == 0:
            begin_start(starts, forced)
            numbers[PERIOD] = -1 if first > 0.0 else 0
        outcome = starts.outcome[b]
        state = strobes.states[0]
        while numbers[PERIOD] < most:
            code = follow_periods(modes, carry, first if numbers[PERIOD] < 0 else period, forced, strobes, impacts, work)
            if code == NEW_MODE or code == PAUSED:
                return int64(code)
            if code != REACHED:
                outcome[0] = ENDED
                outcome[1] = code
                break
            forced.places[DONE] = 0
            numbers[PERIOD] += 1
            copy_1(state, starts.states[b])
            starts.sticking[b] = modes.sticking[motion.counts[entry.MODE]]
            largest = 0.0
            for i in range(state.shape[0]):
                # The comparison is false for what is not a number.
                largest = largest if abs(state[i]) <= largest else abs(state[i])
            if not largest <= bound:
                outcome[0] = LEFT
                break
            row = caught_by(known, starts, state, starts.sticking[b])
            if row >= 0:
                outcome[0] = CAUGHT
                outcome[1] = row
                break
        outcome[2] = max(int64(0), numbers[PERIOD])
        outcome[3] = motion.counts[entry.IMPACTS]
        outcome[4] = 1 if motion.clock[entry.STICKING_TIME] > 0.0 else 0
        numbers[RUNNING] = 0
        numbers[NEXT] += 1
    return int64(REACHED)
