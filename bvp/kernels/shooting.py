"""Motions of many starts through their impacts, for two degrees of freedom without damping.

`follow_impacts` follows one start, with the derivative of everything by the start's parameter. The states z_k after the impacts and their
derivatives along the curve of starts, taken on the section of the impact: with the flight's variation y' = Phi(d) z', the duration changes
by d' = -(g . y')/(g B . y), the arrival by y' + B y d', and restitution acts on both alike. Between z_k and the next impact the motion of
neighbouring starts is compared at equal times since impact k, where it is linear.

`scan_starts` follows many starts, and measures the residual of each end set on their way. For two degrees of freedom an orbit between ends
is a zero of one number: what is transverse to the end's condition when the rest of it holds. At an impact that is the velocity along the
stop; where the gap coordinate passes zero, the other displacement (origin); where its velocity passes zero, the other velocity (rest).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy import int64

from bvp.kernels.compiled import allocating, kernel, shared, sized
from bvp.kernels.contact_mode import arrive, restitute_state
from bvp.kernels.extrema import crossing_times, next_sign_change, refine, track_of
from bvp.kernels.flight import Contacts, Flight, circular, copy_1, flow_state, inner, row_dot
from bvp.kernels.flights import carry_change, path_state, rate
from bvp.kernels.impact import HIT, NONE, next_hit
from bvp.kernels.multipoint import STOP
from bvp.kernels.two_mode_hit import DECLINED, turn_mode, turn_states, two_mode_hit

STATE, DERIVATIVE, TIME, DURATION, CONTACT, SPEED, RESIDUAL, ACCELERATION, CLEARANCE, SECOND, TURNING_POINTS, THIRD, COLUMNS = (
    0, 4, 8, 10, 12, 13, 15, 17, 18, 20, 21, 22, 24,
)  # fmt: skip
"""Columns of a record, one row a flight: state and its derivative after impact k (4 each); time of impact k; duration of the flight;
contact hit at its end; speed of approach there; velocity along the stop there; acceleration towards the stop there; least distance to a
stop at a turning point inside the flight; the second least; number of turning points; time of the one with the least. Where a column
has two entries, the second one is the derivative by the parameter."""

FREE, STUCK, AHEAD = -1.0, -2.0, -3.0
"""In the column of the contact: no impact within the time searched; pressed against a stop, or a search that gave up; a flight that is not
followed, because it begins later than any that is asked for."""


class Flow(NamedTuple):
    """A system of two degrees of freedom and one stop, and a curve of starts, as data of the kernels."""

    flight: Flight
    contacts: Contacts
    squares: np.ndarray  # (2,) squares of the frequencies
    across: np.ndarray  # (2,) unit vector along the stop, in modal coordinates
    limits: np.ndarray  # (2,) bounds of the gap coordinate, infinite where there is none
    start: np.ndarray  # (3, 4): z = start[0] + first(theta) start[1] + second(theta) start[2]
    # (2,) int64: 0 cosine and sine, 1 constant and linear, 2 hyperbolic, 3 linear and quadratic; contact that the start leaves, -1 for none
    shape: np.ndarray
    table: np.ndarray  # of `bvp.kernels.two_mode_hit.step_table`


@kernel
def start_at(flow, theta, z, dz):
    """Start state and its derivative by the parameter."""
    if flow.shape[0] == 0:
        first = math.cos(theta)
        second = math.sin(theta)
        first_rate = -second
        second_rate = first
    elif flow.shape[0] == 1:
        first = 0.0
        second = theta
        first_rate = 0.0
        second_rate = 1.0
    elif flow.shape[0] == 3:
        first = theta
        second = theta * theta
        first_rate = 1.0
        second_rate = 2.0 * theta
    else:
        first = math.cosh(theta)
        second = math.sinh(theta)
        first_rate = second
        second_rate = first
    # The curve of starts is a combination of two functions of the parameter.
    for r in range(4):
        z[r] = flow.start[0, r] + first * flow.start[1, r] + second * flow.start[2, r]
        dz[r] = first_rate * flow.start[1, r] + second_rate * flow.start[2, r]


@kernel
def fly_both(squares, t, a, b, out_a, out_b):
    """Free flight of two states over one time."""
    for k in range(2):
        c, s = circular(-squares[k], t)
        turn_mode(squares[k], c, s, k, a, out_a)
        turn_mode(squares[k], c, s, k, b, out_b)


@kernel
def amplitude(square, q, p, horizon, order):
    """Bound of |q(t)| (order 0), |q'(t)| (1), |q''(t)| (2) of one mode over a flight of at most `horizon`."""
    # Equation (24) for one mode.
    if square > 0.0:
        w = math.sqrt(square)
        size = math.sqrt(q * q + p * p / square)
        if order == 0:
            return min(size, abs(q) + abs(p) * horizon)
        return w * size if order == 1 else square * size
    c, s = circular(-square, horizon)
    size = abs(q) * c + abs(p) * s
    if order == 0:
        return size
    return abs(p) * c - square * abs(q) * s if order == 1 else -square * size


@shared("integer")
def follow_impacts(flow, theta, longest, latest, most, record, work):
    """Follow one start up to `most` impacts and a little past the time `longest`, filling rows of `record`. Returns the rows filled.

    A flight that begins more than a little past `latest` is not followed: its row has the state at its start and the contact `AHEAD`."""
    z = sized(work[5, :4], 4)
    dz = sized(work[6, :4], 4)
    y = sized(work[7, :4], 4)
    dy = sized(work[8, :4], 4)
    begin = sized(work[9, :4], 4)
    velocity = sized(work[10, :4], 4)
    rotations = work[11, :4]
    gap, rate, acceleration, side, bound, push, restitution = flow.contacts
    contacts = Contacts(sized(gap, 4), sized(rate, 4), sized(acceleration, 4), side, bound, sized(push, 4), restitution)
    slack = 0.05 * longest
    start_at(flow, theta, z, dz)
    time = 0.0
    time_rate = 0.0
    leaving = flow.shape[1]
    left = contacts.side[leaving] if leaving >= 0 else 0.0
    oscillates = flow.table.shape[0] > 0
    for k in range(most + 1):
        copy_1(z, record[k, :4])
        copy_1(dz, record[k, 4:8])
        copy_1(z, begin)
        record[k, TIME] = time
        record[k, TIME + 1] = time_rate
        record[k, CLEARANCE] = math.nan
        if time > latest + slack:
            record[k, CONTACT] = AHEAD
            return k + 1
        horizon = longest - time + 2.0 * slack
        found = int64(DECLINED)
        contact = int64(-1)
        duration = 0.0
        if oscillates:
            found, hit, duration = two_mode_hit(flow.table, flow.squares, contacts.gap, flow.limits, z, left, horizon, rotations)
            for c in range(contacts.side.shape[0]):
                if contacts.side[c] == hit:
                    contact = int64(c)
        turned = found == HIT
        if found == DECLINED:
            found, contact, duration = next_hit(flow.flight, contacts, leaving, z, horizon, work, y)
        if found != HIT:
            record[k, DURATION] = math.inf
            record[k, CONTACT] = FREE if found == NONE else STUCK
            return k + 1
        if turned:
            turn_states(flow.squares, rotations, begin, dz, y, dy)
        else:
            fly_both(flow.squares, duration, begin, dz, y, dy)
        for r in range(2):
            velocity[r] = y[r + 2]
            velocity[r + 2] = -flow.squares[r] * y[r]
        # Equation (19): the change of the duration, and the derivative on the section of the impact.
        later = arrive(contacts.gap, contact, velocity, dy)
        record[k, DURATION] = duration
        record[k, DURATION + 1] = later
        record[k, CONTACT] = contact
        record[k, SPEED] = contacts.side[contact] * row_dot(contacts.rate, contact, y)
        record[k, SPEED + 1] = contacts.side[contact] * row_dot(contacts.rate, contact, dy)
        record[k, ACCELERATION] = contacts.side[contact] * row_dot(contacts.acceleration, contact, y)
        record[k, RESIDUAL] = flow.across[0] * y[2] + flow.across[1] * y[3]
        record[k, RESIDUAL + 1] = flow.across[0] * dy[2] + flow.across[1] * dy[3]
        time += duration
        time_rate += later
        if time > longest + slack:
            return k + 1
        restitute_state(contacts, contact, y, z)
        restitute_state(contacts, contact, dy, dz)
        leaving = int64(contact)
        left = contacts.side[contact]
    return most + 1


@kernel
def find_clearance(flow, row, longest, work):
    """Fill the clearance columns of a flight's record, if not yet done: the turning points of w nearest to the stops inside it."""
    if row[CLEARANCE] == row[CLEARANCE]:
        return
    horizon = 1.05 * longest - row[TIME]
    z = row[:4]
    dz = row[4:8]
    y = work[7, :4]
    dy = work[8, :4]
    rows = work[9:13]
    for r in range(2):
        # w, w', w'', w''' as rows: each derivative maps (a, b) to (-w^2 b, a).
        rows[0, r] = flow.contacts.gap[0, r]
        rows[0, r + 2] = 0.0
    for order in range(1, 4):
        for r in range(2):
            rows[order, r] = -flow.squares[r] * rows[order - 1, r + 2]
            rows[order, r + 2] = rows[order - 1, r]
    duration = min(row[DURATION], horizon)
    track = track_of(flow.flight, rows[1, :4], rows[2, :4], rows[3, :4], z, duration, work[13, :4])
    best = math.inf
    second = math.inf
    best_time = 0.0
    best_side = 0.0
    count = 0
    sign = 0
    here, f, t, steps = 0.0, 0.0, 0.0, 0
    while True:
        found, before, f_before, here, f, t, steps = next_sign_change(track, 1e-13 * duration, 0.0, 0.0, 0.0, sign, here, f, t, steps)
        if not found:
            break
        if sign != 0:
            turn = refine(track, before, f_before, here, f, 1e-10 * duration)
            fly_both(flow.squares, turn, z, dz, y, dy)
            w = inner(rows[0, :4], y)
            distance = flow.limits[1] - w if sign > 0 else w - flow.limits[0]
            count += 1
            if distance < best:
                second = best
                best = distance
                best_time = turn
                best_side = 1.0 if sign > 0 else -1.0
            elif distance < second:
                second = distance
        sign = 1 if f > 0.0 else -1
    if t < math.inf:  # there are more than were looked for: nothing is known of the rest
        best = -math.inf
        second = -math.inf
        count = 0
    row[CLEARANCE] = best
    row[CLEARANCE + 1] = 0.0
    row[SECOND] = second
    row[TURNING_POINTS] = count
    row[THIRD] = best_time
    if count > 0:
        fly_both(flow.squares, best_time, z, dz, y, dy)
        row[CLEARANCE + 1] = -best_side * inner(rows[0, :4], dy)


class EndSet(NamedTuple):
    """The far ends that a scan looks for."""

    kind: int  # ORIGIN, REST or STOP
    transverse: np.ndarray  # (2, N) the row that measures the residual, twice (after an impact at either contact)
    functional: np.ndarray  # (3, N) the row whose zeros are the crossings (origin, rest), and those of its two derivatives


class ScanLimits(NamedTuple):
    """Limits of time and impacts for each start."""

    wanted: np.ndarray  # (K + 1,) 1 where the crossings after k inner impacts are looked for
    most: int  # inner impacts K
    longest: float  # time


class Scanned(NamedTuple):
    """Results of a scan of M starts: their impacts, and their crossings of the end set."""

    sequence: np.ndarray  # (M, K + 1) contacts hit, -1 after the last
    times: np.ndarray  # (M, K + 1, C) time of the c-th crossing after k inner impacts, NaN where there is none; for STOP impact k + 1
    values: np.ndarray  # (M, K + 1, C) residual there
    ends: np.ndarray  # (M,) time followed
    status: np.ndarray  # (M,) 0 followed to a limit, 1 the next impact was not found (sticking, or a search that gave up)
    nodes: np.ndarray  # (M, K, N) states after the inner impacts; of length 0 where they are not wanted
    instants: np.ndarray  # (M, K) their times


@allocating
def scan_starts(flight, contacts, end, starts, limits, found, work):
    """Follow each row of `starts` (M, N) and record its crossings of the end set. work: of `impact.work_array`."""
    kind, transverse, functional = end
    wanted, most_impacts, longest = limits
    sequence, times, values, ends, status, nodes, instants = found
    size = starts.shape[1]
    z = np.empty(size)
    before = np.empty(size)
    scratch = np.empty(size)
    zeros = np.empty(times.shape[2])
    for m in range(starts.shape[0]):
        copy_1(starts[m], z)
        leaving = int64(-1)
        elapsed = 0.0
        status[m] = 0
        for k in range(most_impacts + 1):
            copy_1(z, before)
            outcome, contact, duration = next_hit(flight, contacts, leaving, z, longest - elapsed, work, scratch)
            if outcome != HIT and outcome != NONE:
                status[m] = 1
                break
            if kind != STOP and wanted[k] == 1:
                count = crossing_times(
                    flight, functional[0], functional[1], functional[2], before, duration, zeros, scratch
                )
                if count < 0:
                    status[m] = 1
                    break
                for c in range(min(count, times.shape[2])):
                    flow_state(flight, before, zeros[c], scratch)
                    times[m, k, c] = elapsed + zeros[c]
                    values[m, k, c] = inner(transverse[0], scratch)
            elapsed += duration
            if outcome == NONE:
                break
            flow_state(flight, before, duration, scratch)
            sequence[m, k] = contact
            if kind == STOP:
                times[m, k, 0] = elapsed
                values[m, k, 0] = inner(transverse[0], scratch)
            restitute_state(contacts, contact, scratch, z)
            if nodes.shape[0] > 0 and k < most_impacts:
                instants[m, k] = elapsed
                copy_1(z, nodes[m, k])
            leaving = contact
        ends[m] = elapsed


@kernel
def event(flight, rows, c, z, change, time, state, state_change, velocity):
    """The state (N,) after `time` from z, and its derivative along rows[c] . state = constant where `change` is that of z. Returns the
    derivative of the time."""
    # Equation (19), for an event that is a zero of rows[c] . z.
    path_state(flight, z, time, state)
    carry_change(flight, z, change, time, state_change)
    rate(flight, state, velocity)
    return arrive(rows, c, velocity, state_change)
