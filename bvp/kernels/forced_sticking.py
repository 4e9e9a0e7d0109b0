"""Sticking in orbits under periodic loads: contact modes of flights, releases, and contact forces, equations (42) and (43).

While the stops S stick, c_S . u is constant. With P = 1 - U c_S and U = M^-1 c_S' (c_S M^-1 c_S')^-1 a node flies by

    u' = P v,   v' = P M^-1 (f(t) - K u - C v),                                                                (42)

which is a flight as any other one, with other matrices: the modes of c_S u = 0, and the gaps that rest. The contact forces, positive
where the stops press,

    g = side (c_S M^-1 c_S')^-1 c_S M^-1 (f(t) - K u - C v)                                                    (43)

are linear in the state, and in the states of the loads. A stop opens where its force vanishes: this equation takes the place of that of
its gap. In place of the distance from the stop the force is bounded.

All of this comes in two kinds. Orbits without sticking have `Unstuck`, for which nothing of it is compiled.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from bvp.kernels.compiled import chosen, inlined, kernel
from bvp.kernels.flight import Flight, amplitudes, inner, set_1, times_matrix
from bvp.kernels.loads import LoadedFlight, Loads
from bvp.kernels.smooth_loads import SmoothLoadedFlight

AnyFlight = LoadedFlight | SmoothLoadedFlight
"""The kinds of flights of an orbit under loads. Stops stick in those of the first kind only."""

SHORTEST = 1e-7
"""Part of a flight in which a stop that opens without speed is not searched for another touch."""

AT_ONCE = 1.0
"""1 + restitution of an impact that leaves no speed."""


class Unstuck(NamedTuple):
    """Every contact opens at once after its impact."""

    modes: int  # contact modes besides free flight: 0


class Sticking(NamedTuple):
    """Contact modes of an orbit with k + 2 rows of nodes: F of them, of which the first is free flight. S stops, H harmonics, m parameters,
    m' of these change masses, dampers or springs. Of free flight, the rows of forces behind those of the S stops are the accelerations of
    the gaps of the k + 2 nodes, for chatter."""

    mode: np.ndarray  # (k + 2,) int64 contact mode of each flight
    release: np.ndarray  # (k + 2,) int64 stop that opens at a node; -1: it is an impact
    opens: np.ndarray  # (k + 2,) int64 contact mode if the stop of an impact without rebound stayed closed; -1: no such impact
    closed: np.ndarray  # (F, S) int64 1: the stop sticks
    pairs: np.ndarray  # (F, P, 2) int64
    mean: np.ndarray  # (F, P)
    delta: np.ndarray  # (F, P)
    matrix: np.ndarray  # (F, 2 n, 2 n)
    enter: np.ndarray  # (F, 2 n, 2 n)
    leave: np.ndarray  # (F, 2 n, 2 n)
    drive: np.ndarray  # (F, 2 n, n) modal rates of unit forces
    drive_slope: np.ndarray  # (F, m', 2 n, n)
    change: np.ndarray  # (F, m', 2 n, 2 n) of `LoadedFlight`
    modal: np.ndarray  # (F, 1 + m, H, 2, 2 n) of `Loads`
    pull: np.ndarray  # (F, S + k + 2, 2 n) contact forces of a unit state, with the other sign
    reach: np.ndarray  # (F, S + k + 2, n) contact forces of unit loads
    pull_slope: np.ndarray  # (m', F, S + k + 2, 2 n)
    reach_slope: np.ndarray  # (m', F, S + k + 2, n)
    level: np.ndarray  # (F, S + k + 2, 1 + m, H, 2) contact forces of the loads, by cos and sin; then their derivatives
    row: np.ndarray  # (N,) scratch
    chatter: Any  # `bvp.kernels.summed_chatter.Chatter`


@chosen
def flight_mode(sticking, i):
    """Contact mode of flight i."""


@flight_mode.of(Unstuck)
@inlined
def free_mode(sticking, i):
    """Free flight."""
    return 0


@flight_mode.of(Sticking)
@inlined
def sticking_mode(sticking, i):
    """See `flight_mode`."""
    return sticking.mode[i]


@chosen
def mode_count(sticking):
    """Number of contact modes besides free flight."""


@mode_count.of(Unstuck)
@inlined
def no_modes(sticking):
    """None."""
    return 0


@mode_count.of(Sticking)
@inlined
def sticking_modes(sticking):
    """See `mode_count`."""
    return sticking.pairs.shape[0] - 1


@chosen
def flight_in(sticking, free, mode):
    """The `LoadedFlight` in a contact mode, free being that without contact."""


@flight_in.of(Unstuck)
@inlined
def free_flight(sticking, free, mode):
    """Free flight."""
    return free


@flight_in.of(Sticking)
@inlined
def sticking_flight(sticking, free, mode):
    """See `flight_in`."""
    s = sticking
    loads = Loads(free.loads.harmonics, s.modal[mode], free.loads.clock, free.loads.load_periods)
    return LoadedFlight(
        Flight(s.pairs[mode], s.mean[mode], s.delta[mode], s.matrix[mode]), s.enter[mode], s.leave[mode], loads, s.change[mode],
        free.psi, free.lines, free.flow, free.columns,
    )  # fmt: skip


@inlined
def orbit_flight(segment, i):
    """The `LoadedFlight` of flight i of an orbit."""
    return flight_in(segment.sticking, segment.flight, flight_mode(segment.sticking, i))


@inlined
def modal_load(drive, drive_slope, force, slopes, first, h, part, modal):
    """Write what a load with the amplitude `force` (n,), part 0 its cosine and 1 its sine, is in modal coordinates, with its derivatives.
    slopes (m, E): derivatives of all entries, of which those of the load begin at `first`."""
    times_matrix(drive, force, modal[0, h, part])
    for j in range(slopes.shape[0]):
        times_matrix(drive, slopes[j, first : first + force.shape[0]], modal[1 + j, h, part])
    for j in range(drive_slope.shape[0]):
        for r in range(drive.shape[0]):
            modal[1 + j, h, part, r] += inner(drive_slope[j, r], force)


@chosen
def load_modes(sticking, segment, force, first, h, part):
    """Write the loads of the contact modes but free flight: see `modal_load`."""


@load_modes.of(Unstuck)
@inlined
def load_no_modes(sticking, segment, force, first, h, part):
    """There are none."""


@load_modes.of(Sticking)
@inlined
def load_sticking_modes(sticking, segment, force, first, h, part):
    """See `load_modes`."""
    slopes = segment.released.slopes
    n = force.shape[0]
    stops = sticking.closed.shape[1]
    for f in range(sticking.pairs.shape[0]):
        if f > 0:
            modal_load(sticking.drive[f], sticking.drive_slope[f], force, slopes, first, h, part, sticking.modal[f])
        for s in range(sticking.pull.shape[1]):
            if (s < stops and sticking.closed[f, s] == 1) or (s >= stops and f == 0 and sticking.chatter.summed[s - stops] == 1):
                # Equation (43): the part of the loads.
                sticking.level[f, s, 0, h, part] = inner(sticking.reach[f, s], force)
                for j in range(slopes.shape[0]):
                    sticking.level[f, s, 1 + j, h, part] = inner(sticking.reach[f, s], slopes[j, first : first + n])
                for j in range(sticking.reach_slope.shape[0]):
                    sticking.level[f, s, 1 + j, h, part] += inner(sticking.reach_slope[j, f, s], force)


@kernel
def contact_force(sticking, loads, f, s, z, row):
    """The force of stop s in contact mode f at a node z (N,), equation (43), in units of length; row (N,): its derivative."""
    size = sticking.pull.shape[2]
    set_1(row, 0.0)
    total = 0.0
    for r in range(size):
        row[r] = -sticking.pull[f, s, r]
        total += row[r] * z[r]
    for h in range(loads.harmonics.shape[0]):
        rate = loads.harmonics[h] * 2.0 * math.pi * loads.load_periods
        c = math.cos(rate * z[size])
        d = math.sin(rate * z[size])
        level = sticking.level[f, s]
        total += level[0, h, 0] * c + level[0, h, 1] * d
        row[size] += rate * (level[0, h, 1] * c - level[0, h, 0] * d)
        for j in range(z.shape[0] - size - 1):
            row[size + 1 + j] += level[1 + j, h, 0] * c + level[1 + j, h, 1] * d
    for j in range(sticking.pull_slope.shape[0]):
        row[size + 1 + j] -= inner(sticking.pull_slope[j, f, s], z[:size])
    return total


@chosen
def contact_gap(sticking, segment, i, z):
    """(Residual, its derivative (N,)) of the condition that node z, after flight i, is at its stop, or that the stop opens there."""


@contact_gap.of(Unstuck)
@inlined
def closed_gap(sticking, segment, i, z):
    """The node lies on its stop."""
    return inner(segment.gap[i], z) - segment.bound[i], segment.gap[i]


@contact_gap.of(Sticking)
@inlined
def closed_gap_or_release(sticking, segment, i, z):
    """See `contact_gap`."""
    if sticking.release[i] >= 0:
        value = contact_force(sticking, segment.flight.loads, sticking.mode[i], sticking.release[i], z, sticking.row)
        return value, sticking.row
    return inner(segment.gap[i], z) - segment.bound[i], segment.gap[i]


# -- observation ------------------------------------------------------------------------------------------------------------------


@chosen
def is_closed(sticking, i, stop):
    """Whether a stop sticks in flight i."""


@is_closed.of(Unstuck)
@inlined
def never_closed(sticking, i, stop):
    """It does not."""
    return False


@is_closed.of(Sticking)
@inlined
def is_sticking(sticking, i, stop):
    """See `is_closed`."""
    return sticking.closed[sticking.mode[i], stop] == 1


@inlined
def add_modal(extended, r, factor, row):
    """Add a multiple of the modal coordinate r, with its steady motion under the loads, to a row of observation."""
    last = extended.last[0]
    row[extended.place[r]] += factor * extended.unit[r]
    for h in range(extended.steady.shape[0]):
        row[last + 2 * h] += factor * extended.steady[h, 0, r]
        row[last + 2 * h + 1] += factor * extended.steady[h, 1, r]


@inlined
def set_rates(extended, s):
    """Write the rows of the derivatives of what is observed in row s."""
    rows, matrix = extended.observed.rows, extended.flight.matrix
    for order in range(3):
        for c in range(matrix.shape[0]):
            rows[s, order + 1, c] = inner(rows[s, order], matrix[:, c])


@chosen
def watch_forces(sticking, extended, mode):
    """Replace the gaps of the stops that stick by their contact forces, in the states of a flight with its loads."""


@watch_forces.of(Unstuck)
@inlined
def watch_no_forces(sticking, extended, mode):
    """None sticks."""


@watch_forces.of(Sticking)
@inlined
def watch_contact_forces(sticking, extended, mode):
    """See `watch_forces`."""
    rows, last = extended.observed.rows, extended.last[0]
    for s in range(sticking.closed.shape[1]):
        if sticking.closed[mode, s] == 0:
            continue
        row = rows[s, 0]
        set_1(row, 0.0)
        for h in range(extended.steady.shape[0]):
            row[last + 2 * h] = sticking.level[mode, s, 0, h, 0]
            row[last + 2 * h + 1] = sticking.level[mode, s, 0, h, 1]
        for r in range(sticking.pull.shape[2]):
            total = 0.0
            for c in range(sticking.pull.shape[2]):
                total -= sticking.pull[mode, s, c] * sticking.leave[mode, c, r]
            add_modal(extended, r, total, row)
        set_rates(extended, s)


@chosen
def least_force(sticking, segment, i, node, end):
    """(Least distance of a contact force from a sign that it must not have, its stop, part of the flight) at the ends of flight i: nodes.

    At the begin the stops of the flight press, and a stop that an impact without rebound leaves open pulls. At the end those press that do
    not open. The distance is infinite where no stop is near."""


@least_force.of(Unstuck)
@inlined
def no_least_force(sticking, segment, i, node, end):
    """No stop is."""
    return math.inf, 0, 0.0


@least_force.of(Sticking)
@inlined
def least_contact_force(sticking, segment, i, node, end):
    """See `least_force`."""
    best = math.inf
    best_stop = 0
    best_part = 0.0
    loads, mode = segment.flight.loads, sticking.mode[i]
    row = sticking.row
    begin = i - 1 if i > 0 else segment.shape[0]
    for s in range(sticking.closed.shape[1]):
        if sticking.closed[mode, s] == 1:
            value = contact_force(sticking, loads, mode, s, node, row)
            if value < best:
                best = value
                best_stop = s
                best_part = 0.0
            value = contact_force(sticking, loads, mode, s, end, row)
            if sticking.release[i] != s and value < best:
                best = value
                best_stop = s
                best_part = 1.0
        elif sticking.opens[begin] >= 0 and segment.jump[begin] == AT_ONCE and sticking.closed[sticking.opens[begin], s] == 1:
            value = -contact_force(sticking, loads, sticking.opens[begin], s, node, row)
            if value < best:
                best = value
                best_stop = s
                best_part = 0.0
    return best, best_stop, best_part


@chosen
def lift_off(sticking, segment, i, stop, touched, extended, horizon):
    """Time after the begin of flight i in which a stop that has opened without speed surely goes on to open; 0 for other stops.

    touched: the stop of the node where the flight begins. horizon: longest such time."""


@lift_off.of(Unstuck)
@inlined
def rebound(sticking, segment, i, stop, touched, extended, horizon):
    """A stop opens with the speed of its rebound."""
    return 0.0


@lift_off.of(Sticking)
@inlined
def lift_off_slowly(sticking, segment, i, stop, touched, extended, horizon):
    """See `lift_off`."""
    begin = i - 1 if i > 0 else segment.shape[0]
    if stop != touched or sticking.closed[sticking.mode[i], stop] == 1:
        return 0.0
    if sticking.release[begin] < 0 and segment.jump[begin] != AT_ONCE:
        return 0.0
    rows = extended.observed.rows[stop]
    _, second, third = amplitudes(extended.flight, rows[1], extended.state, horizon)
    slope = abs(inner(rows[2], extended.state))
    bend = abs(inner(rows[3], extended.state))
    # w' = w'' t + w''' t^2/2 keeps its sign up to 2 w''/max w''', and without w'' up to 3 w'''/max w''''.
    safe = 2.0 * slope / second if second > 0.0 else 0.0
    if sticking.release[begin] >= 0 and third > 0.0:
        safe = 3.0 * bend / third
    # Where the contact force vanishes with them, rounding would decide.
    return min(max(0.5 * safe, SHORTEST * horizon), horizon)
