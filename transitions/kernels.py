"""Kernels of the analysis of motions: section crossings, extents, and links between spectral maxima.

The section is f = row . z = 0 with f' > 0. The bounds of `bvp.kernels.extrema` give instants between which f has one zero at most: either
it changes its sign, or it has none. The sign is carried from flight to flight, so that a crossing at an impact counts once.

A perturbation is kept along the gap's zero at an impact, and along the section at a crossing (`event`). This makes it
the derivative of the section's map. A stop that sticks takes a degree of freedom away, so that the plane maps to a curve: the crossings go
on, and the perturbation ends there (NaN).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy import int64

from bvp.kernels import contact_mode as entry
from bvp.kernels.compiled import kernel
from bvp.kernels.contact_mode import Log, MotionState, Scratch, arrive, begin_anew, contacts_of, flight_of, restitute_state
from bvp.kernels.energy_budget import Products, integrals
from bvp.kernels.extrema import peak_flight, rises
from bvp.kernels.flight import inner, row_dot, set_1, times_matrix
from bvp.kernels.flights import carry_change, path_state, potential_energy, rate
from bvp.kernels.motion import FULL, GAVE_UP, NEW_MODE, PAUSED, REACHED, move

__all__ = [
    "COMPLETE",
    "Crossings",
    "EVENTS_AT_ONCE",
    "ExtentsScratch",
    "Following",
    "Maxima",
    "Rows",
    "SectionLimits",
    "SectionStarts",
    "TIME_OVER",
    "Work",
    "extents_of_motion",
    "follow_section",
    "link",
    "renew_clock",
]

COMPLETE, TIME_OVER = -1, -2
"""How an orbit ended, in addition to the endings of `bvp.kernels.motion`: it has all its crossings; it reached the longest time."""

ROOM = 64
"""Most crossings in one flight. A block of eight periods of the fastest mode has some sixteen zeros."""
EVENTS_AT_ONCE = 256
"""Most events in one block. A block with more ends there, and the next one continues."""
MOST = 1 << 62
"""Limit of the number of impacts: none."""

MODE, SIGN, PLACES = range(3)
"""Entries of `Following.places`: contact mode of the next flight, last sign of f; and their number."""

ELAPSED, SPAN, CLOCKS = range(3)
"""Entries of `Following.clocks`: time at the beginning of the block, and its length; and their number."""


class Rows(NamedTuple):
    """What the section measures of the states z (N,) of each of F contact modes."""

    functional: np.ndarray  # (F, 3, N) rows of f, f', f''
    plane: np.ndarray  # (F, 2, N) rows of the two coordinates on the section
    energy: np.ndarray  # (F, N, N) energy is z . energy z/2, and that of the smooth forces


class SectionStarts(NamedTuple):
    """The starts of M orbits."""

    states: np.ndarray  # (M, 2 n) (u, v)
    changes: np.ndarray  # (M, N) a perturbation of each along the section


class SectionLimits(NamedTuple):
    """Time limits."""

    block_time: float  # length of the simulation in one call; a full log ends it, too
    longest: float  # of an orbit


class Crossings(NamedTuple):
    """The crossings of M orbits, up to P of each."""

    times: np.ndarray  # (M, P)
    points: np.ndarray  # (M, P, 2)
    energies: np.ndarray  # (M, P)
    growths: np.ndarray  # (M, P) logarithm of the perturbation's size in the plane, over that at the start
    tangents: np.ndarray  # (M, P, 2) its direction
    counts: np.ndarray  # (M,) int64 crossings, the start included
    impacts: np.ndarray  # (M,) int64 up to the last crossing or the end
    sticking_times: np.ndarray  # (M,) time with a sticking stop, up to the last crossing or the end
    statuses: np.ndarray  # (M,) int64 how the orbit ended


class Following(NamedTuple):
    """The orbit that is followed, from one call to the next."""

    motion: MotionState  # at the end of the block
    begin: np.ndarray  # (N,) state at the beginning of the next flight
    change: np.ndarray  # (N,) perturbation there
    places: np.ndarray  # (PLACES,) int64
    clocks: np.ndarray  # (CLOCKS,)


class Work(NamedTuple):
    """Arrays to write into, which need not be kept."""

    state: np.ndarray  # (N,)
    image: np.ndarray  # (N,)
    velocity: np.ndarray  # (N,)
    row: np.ndarray  # (N,)
    times: np.ndarray  # (ROOM,)
    log: Log
    scratch: Scratch


@kernel
def follow_section(modes, rows, starts, limits, first, orbit, out, work):
    """Follow each of `starts`, from number `first` on, to its P-th crossing. The starts lie on the section.

    modes: the contact modes. rows, starts, limits, orbit, out, work: `Rows`, `SectionStarts`, `SectionLimits`, `Following`, `Crossings`,
    `Work`.

    Returns (M, 0) when all orbits are done. Returns (orbit, contacts) if the orbit needs one more contact mode, with these stops sticking:
    add it and call again; the orbit is then followed from its start. Returns (orbit, -1) if motion.counts[PASSES] are used up: set them and
    call again."""
    motion = orbit.motion
    numbers, clock = motion.counts, motion.clock
    wanted = out.times.shape[1]
    for m in range(first, starts.states.shape[0]):
        if numbers[entry.RUNNING] == 0:
            begin_anew(motion)
            for r in range(starts.states.shape[1]):
                motion.x[r] = starts.states[m, r]
            times_matrix(modes.enter[0], motion.x, orbit.begin)
            for r in range(starts.changes.shape[1]):
                orbit.change[r] = starts.changes[m, r]
            orbit.places[MODE] = 0
            orbit.places[SIGN] = 1
            orbit.clocks[ELAPSED] = 0.0
            out.counts[m] = 0
            out.impacts[m] = 0
            out.sticking_times[m] = 0.0
            record_crossing(modes, rows, 0, orbit.begin, orbit.change, orbit.change, 0.0, out, m)
        status = COMPLETE
        while out.counts[m] < wanted:
            if numbers[entry.RUNNING] == 0:
                if orbit.clocks[ELAPSED] >= limits.longest:
                    status = TIME_OVER
                    break
                numbers[entry.EVENTS] = 0
                orbit.clocks[SPAN] = min(limits.block_time, limits.longest - orbit.clocks[ELAPSED])
            numbers[entry.RUNNING] = 0
            code = move(modes, orbit.clocks[SPAN], MOST, motion, work.log, work.scratch)
            if code == NEW_MODE:
                return m, numbers[entry.PENDING]
            if code == PAUSED:
                numbers[entry.RUNNING] = 1
                return m, int64(-1)
            if not cross(modes, rows, orbit, out, m, work):
                status = GAVE_UP
                break
            if out.counts[m] == wanted:
                break
            if code != REACHED and code != FULL:
                status = code
                break
            # The motion does not depend on time itself. Each block has its own clock, which rounds less.
            orbit.clocks[ELAPSED] += clock[entry.TIME]
            renew_clock(clock)
        out.statuses[m] = status
    return starts.states.shape[0], int64(0)


@kernel
def renew_clock(clock):
    """Begin a new block of a motion at time 0. Instants before it that are still needed become negative."""
    clock[entry.REFERENCE] -= clock[entry.TIME]
    clock[entry.REFERENCE_LOW] -= clock[entry.TIME_LOW]
    clock[entry.PROGRESS] -= clock[entry.TIME]
    clock[entry.TIME] = 0.0
    clock[entry.TIME_LOW] = 0.0


@kernel
def event(flight, rows, c, z, change, time, state, state_change, velocity):
    """The state (N,) after `time` from z, and its derivative along rows[c] . state = constant where `change` is that of z. Returns the
    derivative of the time."""
    # Equation (19), for an event that is a zero of rows[c] . z.
    path_state(flight, z, time, state)
    carry_change(flight, z, change, time, state_change)
    rate(flight, state, velocity)
    return arrive(rows, c, velocity, state_change)


@kernel
def cross(modes, rows, orbit, out, m, work):
    """Record the crossings of orbit m in the flights of a block, and carry the perturbation to its end. Returns False if a search gave up.

    The flights stand in work.log; the last of them ends at the motion's state."""
    motion = orbit.motion
    log = work.log
    wanted = out.times.shape[1]
    events = motion.counts[entry.EVENTS]
    started = 0.0
    bouncing = False  # no stop sticks while bounces are summed, although the log names the contact mode in which they end
    for k in range(events + 1):
        last = k == events
        impact = not last and log.numbers[k, 0] == entry.IMPACT
        f = orbit.places[MODE]
        flight, functional = flight_of(modes, f), rows.functional[f]
        end = motion.clock[entry.TIME] if last else log.values[k, 0]
        duration = max(0.0, end - started)
        found = int64(0)
        if duration > 0.0:
            found, sign = rises(
                flight, functional[0], functional[1], functional[2], orbit.begin, duration, orbit.places[SIGN], work.times, work.row
            )
            orbit.places[SIGN] = sign
        if found < 0:
            return False
        for i in range(found):
            event(flight, functional, 0, orbit.begin, orbit.change, work.times[i], work.state, work.image, work.velocity)
            time = orbit.clocks[ELAPSED] + started + work.times[i]
            record_crossing(modes, rows, f, work.state, work.image, orbit.change, time, out, m)
            if out.counts[m] == wanted:
                duration = work.times[i]
                break
        if f != 0 and not bouncing:
            out.sticking_times[m] += duration
        if out.counts[m] == wanted:
            return True
        after = motion.counts[entry.MODE] if last else log.numbers[k, 2]
        if f != 0 or after != 0:
            for r in range(orbit.change.shape[0]):
                orbit.change[r] = math.nan
        elif impact:
            contact = log.numbers[k, 1]
            event(flight, modes.gap[0], contact, orbit.begin, orbit.change, duration, work.state, work.image, work.velocity)
            restitute_state(contacts_of(modes, 0), contact, work.image, orbit.change)
        else:
            carry_change(flight, orbit.begin, orbit.change, duration, work.image)
            for r in range(orbit.change.shape[0]):
                orbit.change[r] = work.image[r]
        out.impacts[m] += 1 if impact else 0
        for r in range(orbit.begin.shape[0]):
            orbit.begin[r] = motion.z[r] if last else log.states[k, r]
        started = end
        bouncing = not last and log.numbers[k, 0] == entry.CHATTER and f == 0
        orbit.places[MODE] = after
    return True


@kernel
def record_crossing(modes, rows, f, z, image, change, time, out, m):
    """Record the next crossing of orbit m, at the state z in contact mode f. `image` is the perturbation there. `change` is scaled so that
    the image has size 1 in the plane."""
    k = out.counts[m]
    energy = potential_energy(flight_of(modes, f), z)
    for r in range(z.shape[0]):
        energy += 0.5 * z[r] * inner(rows.energy[f, r], z)
    first = inner(rows.plane[f, 0], image)
    second = inner(rows.plane[f, 1], image)
    size = math.hypot(first, second)
    out.times[m, k] = time
    out.points[m, k, 0] = inner(rows.plane[f, 0], z)
    out.points[m, k, 1] = inner(rows.plane[f, 1], z)
    out.energies[m, k] = energy
    out.growths[m, k] = out.growths[m, k - 1] + math.log(size) if k > 0 else 0.0
    out.tangents[m, k, 0] = first / size
    out.tangents[m, k, 1] = second / size
    out.counts[m] = k + 1
    scale = 1.0 / size
    for r in range(change.shape[0]):
        change[r] *= scale


class ExtentsScratch(NamedTuple):
    """Arrays to write into, which need not be kept."""

    peak: np.ndarray  # scratch, edge and work of `bvp.kernels.extrema.peak_flight`
    edge: np.ndarray
    work: np.ndarray
    integral: np.ndarray  # of `bvp.kernels.energy_budget.integral_work`
    squares: np.ndarray  # (R,)
    when: np.ndarray  # (R,)


@kernel
def extents_of_motion(modes, flights, rows, weight, scratch, best, where, total):
    """Largest values best (R,), the times where (R,) of those that are raised, and the integrals total (R,) of the squares, over flights.

    rows (F, 2 R, N): the functionals and their rates, in each contact mode; weight (R,): ones. Returns False if the search for a peak
    gave up."""
    begins, numbers, states, end = flights
    when = scratch.when
    count = best.shape[0]
    # The starts of all flights first: a flight that begins at rest is long searched, unless it is known to stay below these.
    for k in range(begins.shape[0]):
        for c in range(count):
            value = abs(row_dot(rows[numbers[k, 2]], c, states[k]))
            if value > best[c]:
                best[c] = value
                where[c] = begins[k]
    for k in range(begins.shape[0]):
        f = numbers[k, 2]
        flight = (begins[k + 1] if k + 1 < begins.shape[0] else end) - begins[k]
        own = flight_of(modes, f)
        set_1(when, -1.0)
        if not peak_flight(own, rows[f], states[k], flight, best, when, scratch.peak, scratch.edge, scratch.work):
            return False
        values = rows[f, :count]
        integrals(own, Products(values, values, weight), states[k], flight, scratch.integral, scratch.squares)
        for c in range(count):
            if when[c] >= 0.0:
                where[c] = begins[k] + when[c]
            total[c] += scratch.squares[c]
    return True


class Maxima(NamedTuple):
    """The maxima of a spectrum over frequency, column by column."""

    columns: np.ndarray  # (M,) int64, sorted
    level: np.ndarray  # (M,) frequencies in octaves, rising in each column
    bounds: np.ndarray  # (n + 1,) int64 first maximum of each column
    reach: np.ndarray  # (M,) largest change in octaves to the next column


@kernel
def link(maxima, spacing, drift, step, following, followed, opened):
    """Link each maximum to the one that follows it: following (M,) gets the index, -1 for none.

    step: time between columns. Across a gap the largest change is `spacing`
    octaves, or `drift` octaves for each period of it, if that is more. followed (M,), opened (M,): arrays to write into.

    The first pass links maxima of neighbouring columns that are each other's nearest. The second one links across gaps of less than a
    period, to maxima without a predecessor: to the first in time, and of these to the nearest."""
    columns, level, bounds, reach = maxima
    count = bounds.shape[0] - 1
    for i in range(columns.shape[0]):
        following[i] = -1
        followed[i] = False
    for column in range(count - 1):
        j = bounds[column + 1]
        stop = bounds[column + 2]
        back = -1  # the maximum of this column that is nearest to j
        for i in range(bounds[column], bounds[column + 1]):
            while j + 1 < stop and abs(level[j + 1] - level[i]) < abs(level[j] - level[i]):
                j += 1
            if j >= stop:
                break
            # The nearest of this column to j: levels rise, so the distances fall and rise once.
            back = i
            while back + 1 < bounds[column + 1] and abs(level[back + 1] - level[j]) < abs(level[back] - level[j]):
                back += 1
            if back == i and (i == bounds[column] or abs(level[i] - level[j]) < abs(level[i - 1] - level[j])):
                if abs(level[i] - level[j]) <= reach[i]:
                    following[i] = j
                    followed[j] = True
    # Maxima without a predecessor, in order of time. Only these can be linked across a gap.
    free = 0
    for i in range(columns.shape[0]):
        if not followed[i]:
            opened[free] = i
            free += 1
    begin = 0
    for end in range(columns.shape[0]):
        if following[end] >= 0:
            continue
        while begin < free and columns[opened[begin]] <= columns[end]:
            begin += 1
        period = 2.0 * math.pi / 2.0 ** level[end]
        chosen = -1
        apart = 0.0
        for k in range(begin, free):
            i = opened[k]
            gap = (columns[i] - columns[end]) * step
            if columns[i] > columns[end] + int(period / step) or (chosen >= 0 and columns[i] > columns[chosen]):
                break
            away = abs(level[i] - level[end])
            if not followed[i] and away <= max(spacing, drift * gap / period) and (chosen < 0 or away < apart):
                chosen = i
                apart = away
        if chosen >= 0:
            following[end] = chosen
            followed[chosen] = True
