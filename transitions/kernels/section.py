"""Crossings of a section by many motions: times by bounds, states by exact flight, growth of a perturbation by its variational flow.

The section is f = row . z = 0 with f' > 0. Between two instants at which the bounds of `bvp.kernels.extrema` allow one zero at most, f
either changes its sign or has none; the sign is carried from flight to flight, so that a crossing at an impact counts once. A
perturbation is kept along the gap's zero at an impact and along the section at a crossing (`bvp.kernels.trail.event`), which makes it
the derivative of the section's map. A stop that is held takes a degree of freedom away, so that the plane maps to a curve: the points go
on, and the perturbation ends there.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import int64

from bvp.kernels.compiled import allocating, kernel, whole_at
from bvp.kernels.extrema import dot, look, refine, safe_step, separate
from bvp.kernels.flight import flow_state
from bvp.kernels.motion import FULL, GAVE_UP, NEW_PHASE, PAUSED, REACHED
from bvp.kernels.phase import (
    CHATTER,
    EVENTS,
    IMPACT,
    PENDING,
    PHASE,
    REFERENCE,
    REFERENCE_LOW,
    RUNNING,
    TIME,
    TIME_LOW,
    begin_anew,
    times_matrix,
)  # fmt: skip
from bvp.kernels.restitution import restitute
from bvp.kernels.trail import event

__all__ = ["COMPLETE", "EVENTS_AT_ONCE", "TIME_OVER", "Following", "follow_section", "rises"]

COMPLETE, TIME_OVER = -1, -2
"""How following an orbit ended, besides the endings of `bvp.kernels.motion`: with all points asked for; at the longest time."""

STEP_LIMIT = 100_000
ROOM = 64
"""Crossings in one flight; a stretch of eight periods of the fastest mode has some sixteen zeros."""
EVENTS_AT_ONCE = 256
"""Events of one stretch that are kept; one with more is gone on with from there."""
MOST = 1 << 62
"""Impacts: as many as there are."""

FLIGHT_PHASE, CROSSED, HITS, SIGN, WHOLE = range(5)
"""Entries of `Following.whole`: phase of the flight that is looked at next, crossings, impacts, the sign of f; and their number."""

GROWTH, HELD, ELAPSED, SPAN, SUMS = range(5)
"""Entries of `Following.sums`: logarithm of the perturbation's growth, time with a contact held, time, that which is run at once; and their
number."""


class Following(NamedTuple):
    """The orbit that is followed, from one call to the next."""

    z: np.ndarray  # (N,) state at the end of what was run
    x: np.ndarray  # (2 n,) modal coordinates there
    begin: np.ndarray  # (N,) state where the next flight begins
    change: np.ndarray  # (N,) perturbation there
    numbers: np.ndarray  # (COUNTS,) of `bvp.kernels.motion.move`
    clock: np.ndarray  # (CLOCK,)
    dissipated: np.ndarray  # (D + S + 1, 2)
    whole: np.ndarray  # (WHOLE,) int64
    sums: np.ndarray  # (SUMS,)


@kernel
def rises(pairs, mean, delta, matrix, value, rate, second, z, duration, sign, times, work):
    """Times in [0, duration) at which f = value . z(t) passes zero upwards, into `times`, after an earlier `sign` of f (0: none yet).

    Values within rounding of zero have no sign. A passage at the beginning, where the flight before ended below zero, is at time 0.
    Returns (count, last sign); count is -1 where the search gave up or there is no room."""
    pure, level, curvature, jerk = separate(pairs, mean, delta, matrix, value, second, z, duration, work)
    level = 1e-13 * (level + 1e-300)
    floor = 1e-13 * duration
    count = 0
    before = 0.0
    f_before = 0.0
    t = 0.0
    for _ in range(STEP_LIMIT):
        f, slope, bend = look(pairs, mean, delta, matrix, pure, work, value, rate, second, z, t)
        if abs(f) > level:
            if f > 0.0 and sign < 0:
                if count == times.shape[0]:
                    return -1, sign
                times[count] = 0.0
                if t > 0.0:
                    guess = before + f_before / (f_before - f) * (t - before)
                    times[count] = refine(
                        pairs, mean, delta, matrix, pure, value, rate, second, z, before, t, guess, False, 1e-16 * duration, work
                    )
                count += 1
            sign = int64(1) if f > 0.0 else int64(-1)
        if t >= duration:
            return count, sign
        before = t
        f_before = f
        t = min(duration, t + max(safe_step(f, slope, bend, curvature, jerk), floor))
    return -1, sign


@allocating
def follow_section(
    mover, phases, functional, plane, quadratic, starts, changes, stretch_time, longest, first, following,
    times, points, energies, growths, tangents, counts, impacts, held_times, statuses, log, scratch, marks,
):  # fmt: skip
    """Follow each row (u, v) of `starts` (M, 2 n), from the `first`-th on, which lies on the section, to its P-th crossing.

    mover: where `bvp.kernels.motion.move` stands (`bvp.kernels.compiled.address_of`).
    For each of F phases: functional (F, 3, N): rows of f, f', f''. plane (F, 2, N): rows of the two coordinates on the section. quadratic
    (F, N, N): energy is z . quadratic z/2. changes (M, N): a perturbation along the section of each start. stretch_time: length of what is
    run at once.
    times (M, P), points (M, P, 2), energies (M, P): of each crossing, the start being the first. growths (M, P): logarithm of the
    perturbation's size, in the plane, over that at the start; tangents (M, P, 2): its direction; NaN after a contact was held.
    counts, impacts, held_times, statuses (M,): crossings, impacts up to the end, time with a contact held up to the last crossing or the
    end, how it ended. log, scratch, marks: as of `bvp.kernels.motion.move`; as many events as the log has room for are run at once, too.

    Returns (M, 0); (the orbit that wants one more phase, the contacts that are held in it): add it and call again from there; or
    (the orbit that is followed, -1) where following.numbers[PASSES] are used up: set them and call again."""
    size = changes.shape[1]
    wanted = times.shape[1]
    z, x, begin, change, numbers, clock, sums = (
        following.z, following.x, following.begin, following.change, following.numbers, following.clock, following.dissipated
    )  # fmt: skip
    no_peaks, turns = np.empty(0), np.empty((0, 2))
    state, state_change, velocity = np.empty(size), np.empty(size), np.empty(size)
    passages, work = np.empty(ROOM), np.empty(size)
    for m in range(first, starts.shape[0]):
        if numbers[RUNNING] == 0:
            begin_anew(numbers, clock, turns, sums)
            for r in range(starts.shape[1]):
                x[r] = starts[m, r]
            times_matrix(phases.enter[0], x, begin)
            for r in range(size):
                change[r] = changes[m, r]
            growth = 0.0 - math.log(math.hypot(dot(plane[0, 0], change), dot(plane[0, 1], change)))
            f = int64(0)
            held = 0.0
            growth = record(
                plane[0], quadratic[0], begin, change, change, 0.0, growth, times[m], points[m], energies[m], growths[m], tangents[m], 0
            )
            count = int64(1)
            hits = int64(0)
            sign = int64(1)
            elapsed = 0.0
        else:
            f = following.whole[FLIGHT_PHASE]
            count = following.whole[CROSSED]
            hits = following.whole[HITS]
            sign = following.whole[SIGN]
            growth = following.sums[GROWTH]
            held = following.sums[HELD]
            elapsed = following.sums[ELAPSED]
        status = COMPLETE
        while count < wanted:
            if numbers[RUNNING] == 0:
                if elapsed >= longest:
                    status = TIME_OVER
                    break
                numbers[EVENTS] = 0
                following.sums[SPAN] = min(stretch_time, longest - elapsed)
            numbers[RUNNING] = 0
            span = following.sums[SPAN]
            code = whole_at(mover, (phases, span, MOST, z, x, numbers, clock, turns, sums, marks, no_peaks, log, scratch))
            if code == NEW_PHASE:
                return m, numbers[PENDING]
            if code == PAUSED:
                following.whole[FLIGHT_PHASE] = f
                following.whole[CROSSED] = count
                following.whole[HITS] = hits
                following.whole[SIGN] = sign
                following.sums[GROWTH] = growth
                following.sums[HELD] = held
                following.sums[ELAPSED] = elapsed
                numbers[RUNNING] = 1
                return m, int64(-1)
            events = numbers[EVENTS]
            started = 0.0
            bouncing = False  # up to where bounces are summed to, in the phase that they end in, no contact is held by them yet
            for k in range(events + 1):
                pairs, mean, delta, matrix = phases.pairs[f], phases.mean[f], phases.delta[f], phases.matrix[f]
                rows = functional[f]
                duration = max(0.0, (log.values[k, 0] if k < events else clock[TIME]) - started)
                found, sign = rises(pairs, mean, delta, matrix, rows[0], rows[1], rows[2], begin, duration, sign, passages, work)
                if found < 0:
                    status = GAVE_UP
                    break
                for i in range(found):
                    event(pairs, mean, delta, matrix, rows[0], begin, change, passages[i], state, state_change, velocity)
                    growth = record(
                        plane[f], quadratic[f], state, state_change, change, elapsed + started + passages[i], growth,
                        times[m], points[m], energies[m], growths[m], tangents[m], count
                    )  # fmt: skip
                    count += 1
                    if count == wanted:
                        duration = passages[i]
                        break
                if f != 0 and not bouncing:
                    held += duration
                if count == wanted:
                    break
                hits += 1 if k < events and log.numbers[k, 0] == IMPACT else 0
                after = log.numbers[k, 2] if k < events else numbers[PHASE]
                if f != 0 or after != 0:
                    for r in range(size):
                        change[r] = math.nan
                elif k < events and log.numbers[k, 0] == IMPACT:
                    contact = log.numbers[k, 1]
                    event(pairs, mean, delta, matrix, phases.gap[0, contact], begin, change, duration, state, state_change, velocity)
                    restitute(phases.rate[0], phases.push[0], phases.restitution, contact, state_change, change)
                else:
                    flow_state(pairs, mean, delta, matrix, change, duration, state_change)
                    for r in range(size):
                        change[r] = state_change[r]
                for r in range(size):
                    begin[r] = log.states[k, r] if k < events else z[r]
                started = log.values[k, 0] if k < events else clock[TIME]
                bouncing = k < events and log.numbers[k, 0] == CHATTER and f == 0
                f = after
            if status == GAVE_UP or count == wanted:
                break
            if code != REACHED and code != FULL:
                status = code
                break
            elapsed += clock[TIME]
            # Nothing depends on the time itself; each stretch has its own, which rounds less.
            clock[REFERENCE] -= clock[TIME]
            clock[REFERENCE_LOW] -= clock[TIME_LOW]
            clock[TIME] = 0.0
            clock[TIME_LOW] = 0.0
        counts[m] = count
        impacts[m] = hits
        held_times[m] = held
        statuses[m] = status
    return starts.shape[0], int64(0)


@kernel
def record(plane, quadratic, z, z_change, change, time, growth, times, points, energies, growths, tangents, count):
    """Note crossing number `count` at the state z, and scale `change` so that its image z_change there has size 1 in the plane. Returns the
    logarithm of its size without scaling, over that at the start."""
    size = z.shape[0]
    energy = 0.0
    for r in range(size):
        energy += 0.5 * z[r] * dot(quadratic[r], z)
    first = dot(plane[0], z_change)
    second = dot(plane[1], z_change)
    norm = math.hypot(first, second)
    times[count] = time
    points[count, 0] = dot(plane[0], z)
    points[count, 1] = dot(plane[1], z)
    energies[count] = energy
    growths[count] = growth + math.log(norm)
    tangents[count, 0] = first / norm
    tangents[count, 1] = second / norm
    scale = 1.0 / norm
    for r in range(size):
        change[r] *= scale
    return growths[count]
