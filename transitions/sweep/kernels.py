"""The kernel of forced motion: from one period of the loads to the next, with a tangent vector.

The stroboscopic map takes the state at phase 0 of the loads to the state a period later. A tangent vector d = (du, dv) is carried by the
derivative of this map. In flight it moves as the state does, without loads; with smooth forces, by their derivative. A perturbed motion
arrives at a stop later by

    dt = -(c . du)/(c . v)

and the impact R takes d to R (d + f- dt) - f+ dt, equation (37), where f- and f+ are (v, v') before and after the impact, with the loads.
This is the saltation matrix: R f- - f+ has the term of the loads. No force jumps at a release, so d passes it unchanged. A contact that
begins to stick takes the parts of d across its gap away: two dimensions for each such stop. Coordinates along the stop take no impulse
there, so this also holds at the end of bounces that are summed. Motion across the gap acts on them during these bounces by springs and
dampers; the little of it that is left when the sum begins is neglected.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy import int64

from bvp.kernels import contact_mode as entry
from bvp.kernels.compiled import kernel
from bvp.kernels.contact_mode import Log, MotionState, Scratch, apply_impact, flight_of, settle, write_loads
from bvp.kernels.energy_budget import dissipated
from bvp.kernels.flight import copy_1, row_dot, set_2, times_matrix
from bvp.kernels.flights import carry_change, path_state, rate
from bvp.kernels.motion import FULL, REACHED, move
from bvp.kernels.sticking import impulses_of, push_off
from transitions.kernels import renew_clock

__all__ = ["EVENTS_AT_ONCE", "Forced", "Impacts", "Strobes", "PeriodWork", "follow_periods"]

EVENTS_AT_ONCE = 256
"""Most events in one call of `move`."""
MOST = 1 << 62
"""Limit of the number of impacts: none."""

DONE, MODE, KEPT, FOUND, PLACES = range(5)
"""Entries of `Forced.places`: periods done; contact mode of the next flight; contacts that stick since the period began; impacts
recorded; and their number."""

STARTED, SPENT, SHIFT, CLOCKS = range(4)
"""Entries of `Forced.clocks`: time in the period at which the next flight begins; energy dissipated when the period began; dt of the impact
with which the next flight begins, 0 if it begins otherwise; and their number."""


class Forced(NamedTuple):
    """A forced motion, from one call to the next."""

    motion: MotionState
    begin: np.ndarray  # (N,) state at the beginning of the next flight
    tangent: np.ndarray  # (2 n,) tangent vector there, (du, dv)
    places: np.ndarray  # (PLACES,) int64
    clocks: np.ndarray  # (CLOCKS,)


class Strobes(NamedTuple):
    """What is recorded at the end of each of P periods."""

    states: np.ndarray  # (P, 2 n) (u, v)
    growths: np.ndarray  # (P,) logarithm of the growth of the tangent vector in the period
    kept: np.ndarray  # (P,) int64 bits of the contacts that stick throughout the period


class Impacts(NamedTuple):
    """Record of the impacts; without rows if they are not recorded."""

    numbers: np.ndarray  # (Q, 2) int64: contact, period
    values: np.ndarray  # (Q, 2) time since the period began, speed of approach
    states: np.ndarray  # (Q, 4 n) (u, v) before and after


class PeriodWork(NamedTuple):
    """Arrays to write into, which need not be kept."""

    state: np.ndarray  # (N,)
    image: np.ndarray  # (N,)
    velocity: np.ndarray  # (N,)
    rate: np.ndarray  # (2 n,)
    log: Log
    scratch: Scratch


@kernel
def follow_periods(modes, carry, period, forced, strobes, impacts, work):
    """Follow a forced motion until all rows of `strobes` are filled. Its clock begins anew in each period.

    modes: the contact modes. carry (F, N, 2 n): state of a contact mode without loads from (u, v), where what a sticking stop takes away is
    dropped. forced, strobes, impacts, work: `Forced`, `Strobes`, `Impacts`, `PeriodWork`.

    Returns REACHED when all is filled. FULL: give room for EVENTS_AT_ONCE more impacts, set places[FOUND] to 0, and call again. Else the
    reason that `move` returned."""
    motion = forced.motion
    recording = impacts.numbers.shape[0] > 0
    while forced.places[DONE] < strobes.states.shape[0]:
        if recording and impacts.numbers.shape[0] - forced.places[FOUND] < EVENTS_AT_ONCE:
            return int64(FULL)
        motion.counts[entry.EVENTS] = 0
        code = move(modes, period, MOST, motion, work.log, work.scratch)
        for k in range(motion.counts[entry.EVENTS]):
            pass_event(modes, carry, k, forced, work)
            if recording and work.log.numbers[k, 0] == entry.IMPACT:
                record_impact(modes, k, forced, impacts, work)
            forced.clocks[STARTED] = work.log.values[k, 0]
            forced.places[MODE] = work.log.numbers[k, 2]
            copy_1(work.log.states[k], forced.begin)
        if code == REACHED:
            end_period(modes, carry, period, forced, strobes, work)
        elif code != FULL:
            return int64(code)
    return int64(REACHED)


@kernel
def fly_tangent(modes, carry, duration, forced, work):
    """Carry the tangent vector over a flight, from the beginning of the next flight of `forced`."""
    f = forced.places[MODE]
    if duration > 0.0:
        forced.places[KEPT] &= modes.sticking[f]
    times_matrix(carry[f], forced.tangent, work.state)
    carry_change(flight_of(modes, f), forced.begin, work.state, duration, work.image)
    times_matrix(modes.leave[f], work.image, forced.tangent)


@kernel
def add_rate(modes, f, z, factor, forced, work):
    """tangent += factor (v, v'), the rate of the state z of contact mode f."""
    settle(modes, f, z)
    rate(flight_of(modes, f), z, work.velocity)
    times_matrix(modes.leave[f], work.velocity, work.rate)
    for r in range(forced.tangent.shape[0]):
        forced.tangent[r] += factor * work.rate[r]


@kernel
def pass_event(modes, carry, k, forced, work):
    """Carry the tangent vector over the flight that ends with event k of the log, and over this event."""
    tangent, log = forced.tangent, work.log
    f = forced.places[MODE]
    after = log.numbers[k, 2]
    c = log.numbers[k, 1]
    duration = max(0.0, log.values[k, 0] - forced.clocks[STARTED])
    fly_tangent(modes, carry, duration, forced, work)
    if duration > 0.0:
        forced.clocks[SHIFT] = 0.0
    if log.numbers[k, 0] != entry.IMPACT or (modes.sticking[f] >> c) & 1 != 0:
        # An impact can change the force of a sticking contact so that it opens at once: then f+ is that of the open contact.
        if f != after and forced.clocks[SHIFT] != 0.0:
            add_rate(modes, f, forced.begin, forced.clocks[SHIFT], forced, work)
            add_rate(modes, after, log.states[k], -forced.clocks[SHIFT], forced, work)
        return
    # Of a slow impact the difference of flown state and stop is rounding, and the logged speed is not.
    speed = modes.side[0, c] * log.values[k, 1]
    if speed == 0.0:
        return
    times_matrix(carry[f], tangent, work.image)
    shift = -row_dot(modes.gap[f], c, work.image) / speed
    # Equation (37): d + f- dt.
    path_state(flight_of(modes, f), forced.begin, duration, work.state)
    add_rate(modes, f, work.state, shift, forced, work)
    # R of it: equation (4) within the contact mode, or equation (8) if the impact opens a sticking contact.
    jump = 1.0 + modes.restitution[c]
    if f == after:
        times_matrix(carry[f], tangent, work.image)
        apply_impact(modes.rate[f], modes.push[f], c, jump, work.image, work.image)
        times_matrix(modes.leave[f], work.image, tangent)
    else:
        times_matrix(carry[0], tangent, work.image)
        active = (modes.sticking[f] & modes.sticking[after]) | (int64(1) << c)
        table = work.scratch.impulses
        if impulses_of(modes, active, modes.rate[0], c, jump, work.image, table):
            push_off(modes, work.image, table)
        times_matrix(modes.leave[0], work.image, tangent)
    # Equation (37): - f+ dt.
    add_rate(modes, after, log.states[k], -shift, forced, work)
    forced.clocks[SHIFT] = shift


@kernel
def record_impact(modes, k, forced, impacts, work):
    """Record event k of the log, an impact."""
    log = work.log
    row = forced.places[FOUND]
    width = forced.tangent.shape[0]
    impacts.numbers[row, 0] = log.numbers[k, 1]
    impacts.numbers[row, 1] = forced.places[DONE]
    impacts.values[row, 0] = log.values[k, 0]
    impacts.values[row, 1] = log.values[k, 1]
    copy_1(log.before[k], impacts.states[row, :width])
    times_matrix(modes.leave[log.numbers[k, 2]], log.states[k], impacts.states[row, width:])
    forced.places[FOUND] = row + 1


@kernel
def end_period(modes, carry, period, forced, strobes, work):
    """Record the end of a period, scale the tangent vector to size 1, and begin the next period."""
    motion, tangent = forced.motion, forced.tangent
    counts, clock = motion.counts, motion.clock
    row = forced.places[DONE]
    f = counts[entry.MODE]
    n = modes.shape[0]
    fly_tangent(modes, carry, max(0.0, period - forced.clocks[STARTED]), forced, work)
    times_matrix(modes.leave[f], motion.z, strobes.states[row])
    strobes.kept[row] = forced.places[KEPT]
    size = 0.0
    frequency = 2.0 * math.pi / period
    for r in range(n):
        size = math.hypot(size, math.hypot(frequency * tangent[r], tangent[n + r]))
    if size > 0.0:
        strobes.growths[row] = math.log(size)
        for r in range(2 * n):
            tangent[r] /= size
    elif size == 0.0:
        strobes.growths[row] = -math.inf
    else:
        strobes.growths[row] = math.nan  # the tangent vector could not be carried
    # The loads begin again at phase 0, exactly.
    set_2(motion.angles, 0.0)
    renew_clock(clock)
    times_matrix(modes.to_modes[f], motion.z, motion.x)
    write_loads(modes, counts[entry.BREAK_INDEX], clock, motion.angles, motion.x)
    times_matrix(modes.from_modes[f], motion.x, motion.z)
    copy_1(motion.z, forced.begin)
    # The energy that the end of summed bounces is compared with (`bvp.kernels.sticking`): the largest loss of a period.
    lost = dissipated(motion.sums, modes.shape[1] + modes.shape[2])
    clock[entry.INITIAL] = max(clock[entry.INITIAL], lost - forced.clocks[SPENT])
    forced.clocks[SPENT] = lost
    forced.clocks[STARTED] = 0.0
    forced.clocks[SHIFT] = 0.0
    forced.places[MODE] = f
    forced.places[KEPT] = modes.sticking[f]
    forced.places[DONE] = row + 1
