"""An adaptive scan of a curve of starts. An interval is split until the scan knows every orbit that it can contain.

For two degrees of freedom an orbit between ends is a zero of two numbers in the plane of start and time: the displacements (origin),
the velocities (rest), or the velocity along the stop at an impact (stop). An interval of starts is closed for one flight when

    all its starts have the same impacts. The sensitivity z' at both ends and in the middle agrees, so all flights stay in a tube about
        the middle one, with |z'| times the half width of the interval as its radius;
    no turning point inside the tube reaches a stop, or only one does, monotonically and at an end of the interval;
    no impact's speed reaches zero, or it does so monotonically at an end;
    at each crossing of the tube by zero, the Jacobian of (start, time) varies by less than its size. There is then at most one orbit, and
        Newton's method finds it.

An interval that cannot be closed is split. Its halves start with the flight that was open. If the impact sequence changes inside, the
grazing is located to rounding and becomes an end of both sides. On the side with the slow impact, everything depends on the square root
of the distance to the grazing, so this root is the parameter there.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy import int64

from bvp.kernels.arcs import ArcRange, fill_arc, has_arc
from bvp.kernels.compiled import allocating, inlined, kernel
from bvp.kernels.shooting import ACCELERATION, CLEARANCE, CONTACT, DURATION, SPEED, find_clearance, follow_impacts
from bvp.kernels.verdict import (
    CLOSED,
    DONE,
    ENDLESS,
    GRAZED,
    JUMP,
    MIDDLE,
    SPLIT,
    Sample,
    StartBracket,
    flight_verdict,
    refine_zero,
    touch_distance,
)

COUNTS = ("starts", "split", "closed", "grazings", "open", "at_grazing", "budget")
(STARTS, SPLITS, CLOSURES, GRAZINGS, OPEN, AT_GRAZING, BUDGET) = range(7)

STATE = 5
"""Length of the state of a scan between two calls: intervals on the stack, starts used, candidates, openings, and whether the uppermost
interval is closed for some of its flights."""
(TOP, USED, CANDIDATES, OPENINGS, WITHIN) = range(STATE)

FIRST_SPARE = 2
"""The first record that is not of one of the ends."""

COARSE = 10.0
"""An interval at a grazing stays open if rounding of the starts hides this many times more of it than the contact tolerance does."""
SLIVER = 4e-12
"""How far outside its interval Newton's method may end at a grazing: about what is left out between its two sides."""


@inlined
def leave_open(openings, opening, theta, width, flight, reason, counts):
    """Add an interval to those that stay open, where there is room. Returns their number.

    The reason GRAZED means that it is as narrow as rounding about a grazing."""
    counts[AT_GRAZING if reason == GRAZED else OPEN] += 1
    if opening < openings.shape[0]:
        openings[opening, 0] = theta
        openings[opening, 1] = width
        openings[opening, 2] = flight
        openings[opening, 3] = reason
    return opening + 1


class StartMap(NamedTuple):
    """The map of x in [0, 1] to the parameter of starts, see `place`."""

    low: float
    high: float
    kind: np.int64  # 0 linear, 1 quadratic at the low end, 2 at the high end, 3 both


class Ends(NamedTuple):
    """The ends of an interval, and their records."""

    a: float
    b: float
    i_a: np.int64
    i_b: np.int64


@kernel
def push(stack, top, coordinate, ends, k, depth, verdict):
    """Put an interval on the stack: the map of its parameter, its ends in x, the flight that is open. Returns the height of the stack."""
    row = stack[top]
    row[0] = coordinate.low
    row[1] = coordinate.high
    row[2] = coordinate.kind
    row[3] = ends.a
    row[4] = ends.b
    row[5] = ends.i_a
    row[6] = ends.i_b
    row[7] = k
    row[8] = depth
    row[9] = verdict
    return top + 1


@kernel
def push_between(stack, top, coordinate, ends, k, depth, verdict):
    """`push` an interval with the parameters of its ends."""
    ends = Ends(unplace(coordinate, ends.a), unplace(coordinate, ends.b), ends.i_a, ends.i_b)
    return push(stack, top, coordinate, ends, k, depth, verdict)


@kernel
def third(one, two, first):
    """The first of three records from `first` on that is neither of two."""
    for slot in range(first, first + 3):
        if slot != one and slot != two:
            return slot
    return first


@kernel
def grazing_between(search, k, ends, first, grain):
    """Locate the grazing between two starts whose flights k end differently, bracketed to rounding. Also find, on each side, the start
    nearest to the grazing with a distance above rounding. Three records from `first` on are overwritten.

    On one side the flight ends with a slow impact, which would reach speed^2/(2 w'') beyond the stop. On the other side it passes the stop
    at some distance. Together these are a smooth function of the start. Its secants shrink the bracket.

    Returns (record, record, theta, theta) of both sides, the bracket (theta, theta), `coarse` and the number of starts followed. coarse:
    rounding of the starts hides much more of the grazing than the contact tolerance does (see `COARSE`)."""
    flow, _, _, _, longest, latest, most, records, levels, work = search
    theta_a, theta_b, i_a, i_b = ends
    one = i_a
    two = i_b
    theta_1 = theta_a
    theta_2 = theta_b
    followed = 0
    for step in range(300):
        width = theta_2 - theta_1
        if width <= 4.0 * grain:
            break
        early, late = (one, two) if records[one, k, DURATION] < records[two, k, DURATION] else (two, one)
        find_clearance(flow, records[late, k], longest, work)
        bend = abs(records[early, k, ACCELERATION])
        below = records[early, k, SPEED] ** 2 / (2.0 * bend) if bend > 0.0 else math.inf
        above = abs(records[late, k, CLEARANCE])
        probe = 0.5 * (theta_1 + theta_2)
        if step % 3 != 2 and below + above < math.inf:
            part = below / (below + above)
            if early == two:
                part = 1.0 - part
            guess = theta_1 + part * width
            nudge = max(2.0 * grain, 0.02 * min(guess - theta_1, theta_2 - guess))
            if (part < 0.5) == (step % 2 == 0):
                probe = guess + nudge
            else:
                probe = guess - nudge
            probe = min(max(probe, theta_1 + grain), theta_2 - grain)
        if not (theta_1 < probe < theta_2):
            break
        slot = third(one, two, first)
        levels[slot] = follow_impacts(flow, probe, longest, math.inf, k, records[slot], work)
        followed += 1
        if levels[slot] <= k:
            break
        like_one = records[slot, k, CONTACT] == records[one, k, CONTACT]
        if like_one and records[one, k, CONTACT] == records[two, k, CONTACT]:
            to_one = abs(records[slot, k, DURATION] - records[one, k, DURATION])
            to_two = abs(records[slot, k, DURATION] - records[two, k, DURATION])
            like_one = to_one < to_two
        if like_one:
            one = slot
            theta_1 = probe
        else:
            two = slot
            theta_2 = probe
    late = two if records[one, k, DURATION] < records[two, k, DURATION] else one
    find_clearance(flow, records[late, k], longest, work)
    slope = abs(records[late, k, CLEARANCE + 1])
    offset = 16.0 * grain
    if slope > 0.0:
        offset = max(offset, touch_distance(flow, records[late, k]) / slope)
    hidden = 16.0 * grain * slope
    edge_1 = theta_1
    edge_2 = theta_2
    theta_1 = min(theta_1, edge_2 - min(offset, 0.25 * (edge_2 - theta_a)))
    theta_2 = max(theta_2, edge_1 + min(offset, 0.25 * (theta_b - edge_1)))
    moved_1 = theta_a < theta_1 < edge_1
    moved_2 = edge_2 < theta_2 < theta_b
    if moved_1:
        one = third(one, two, first)
        levels[one] = follow_impacts(flow, theta_1, longest, latest, most, records[one], work)
        followed += 1
    if moved_2:
        two = third(one, two, first)
        levels[two] = follow_impacts(flow, theta_2, longest, latest, most, records[two], work)
        followed += 1
    coarse = hidden > COARSE * touch_distance(flow, records[late, k])
    # Probes were followed to the grazing only; one that becomes the end of an interval is followed to its end.
    if not moved_1 and one != i_a:
        levels[one] = follow_impacts(flow, edge_1, longest, latest, most, records[one], work)
    if not moved_2 and two != i_b:
        levels[two] = follow_impacts(flow, edge_2, longest, latest, most, records[two], work)
    return one, two, theta_1, theta_2, edge_1, edge_2, coarse, followed


@kernel
def begin_interval(search, low, high, ends, stack, counts, state):
    """Begin the scan of the starts between two parameters, which `scan_interval` goes on with.

    ends (3,): those between which `place` maps, and its kind: where the curve of starts itself ends at a stop, its end is one of them.
    state (STATE,): filled. Else as of `scan_interval`."""
    flow, _, _, _, longest, latest, most, records, levels, work = search
    levels[0] = follow_impacts(flow, low, longest, latest, most, records[0], work)
    levels[1] = follow_impacts(flow, high, longest, latest, most, records[1], work)
    counts[STARTS] += 2
    state[:] = 0
    coordinate = StartMap(ends[0], ends[1], int64(ends[2]))
    state[TOP] = push_between(stack, 0, coordinate, Ends(low, high, int64(0), int64(1)), 0, 0, SPLIT)


@allocating
def scan_interval(search, stack, candidates, openings, budget, counts, passes, state):
    """Scan on in an interval of starts, until about as many flights are followed as `passes` says.

    stack (2 D, 10): room for D halvings.
    candidates (C, 8): kind, inner impacts, theta, time in the last flight, residual, converged, low and high end of the interval.
    openings (O, 4): theta, width, flight and reason of what stays open, GRAZED where that is as narrow as rounding about a grazing.
    counts (7,): see COUNTS, added to. state (STATE,): see there; more candidates or openings than their room say that there was too little
    of it. Returns whether the interval is done."""
    flow, _, _, _, longest, latest, most, records, levels, work = search
    found = np.empty((3, 8))
    count = np.zeros(3, np.int64)
    out = np.empty(3)
    candidate = state[CANDIDATES]
    opening = state[OPENINGS]
    top = state[TOP]
    used = state[USED]
    flights = 0
    depth_limit = levels.shape[0] // 3 - 1
    while top > 0 and flights < passes:
        top -= 1
        coordinate = StartMap(stack[top, 0], stack[top, 1], int64(stack[top, 2]))
        kind = coordinate.kind
        x_a = stack[top, 3]
        x_b = stack[top, 4]
        i_a = int64(stack[top, 5])
        i_b = int64(stack[top, 6])
        k = int64(stack[top, 7])
        depth = int64(stack[top, 8])
        x_m = 0.5 * (x_a + x_b)
        theta_a, jac_a = place(coordinate, x_a)
        theta_b, jac_b = place(coordinate, x_b)
        theta_m, _ = place(coordinate, x_m)
        grain = 4.5e-16 * max(abs(theta_a), abs(theta_b), 1.0)
        within = state[WITHIN] == 1
        state[WITHIN] = 0
        if not within and (theta_b - theta_a <= 8.0 * grain or depth >= depth_limit or used >= budget):
            jumped = stack[top, 9] == JUMP
            if k < levels[i_a] and k < levels[i_b]:
                jumped = jumped or records[i_a, k, CONTACT] != records[i_b, k, CONTACT]
            if jumped and theta_b - theta_a <= 8.0 * grain:
                opening = leave_open(openings, opening, theta_a, theta_b - theta_a, k, GRAZED, counts)
            else:
                opening = leave_open(openings, opening, theta_a, theta_b - theta_a, k, stack[top, 9], counts)
                if used >= budget:
                    counts[BUDGET] += 1
            continue
        x_m = unplace(coordinate, theta_m)
        _, jac_m = place(coordinate, x_m)
        i_m = FIRST_SPARE + 3 * depth
        if not within:
            levels[i_m] = follow_impacts(flow, theta_m, longest, latest, most, records[i_m], work)
            counts[STARTS] += 1
            used += 1
            flights += levels[i_m]
        r = 0.5 * (x_b - x_a)
        root_a = (kind == 1 or kind == 3) and x_a <= 1e-3
        root_b = (kind == 2 or kind == 3) and x_b >= 1.0 - 1e-3
        beyond_a = SLIVER if root_a else 8.0 * grain
        beyond_b = SLIVER if root_b else 8.0 * grain
        verdict = CLOSED
        while verdict == CLOSED:
            if flights >= passes:
                break
            flights += 1
            sample_a, sample_b = Sample(records[i_a], levels[i_a], jac_a), Sample(records[i_b], levels[i_b], jac_b)
            sample_m = Sample(records[i_m], levels[i_m], jac_m)
            verdict = flight_verdict(search, k, sample_a, sample_b, sample_m, r, grain, found, count)
            if verdict != CLOSED:
                break
            first = candidate
            for end in range(3):
                for c in range(count[end]):
                    bracket = StartBracket(theta_a, theta_b, beyond_a, beyond_b)
                    converged, steps = refine_zero(
                        search, int64(end), k, theta_m, found[end, c], bracket, records[i_m + 1], records[i_m], out
                    )
                    counts[STARTS] += steps
                    used += steps
                    flights += steps * (k + 1)
                    if not converged and theta_b - theta_a > 1e6 * grain:
                        verdict = SPLIT
                        continue
                    if converged and (out[0] < theta_a or out[0] > theta_b):
                        continue
                    if converged and (out[1] < -1e-9 or out[1] > records[i_m + 1, k, DURATION] + 1e-9):
                        continue
                    if candidate < candidates.shape[0]:
                        candidates[candidate, 0] = end
                        candidates[candidate, 1] = k
                        candidates[candidate, 2] = out[0] if converged else theta_m
                        candidates[candidate, 3] = out[1] if converged else found[end, c]
                        candidates[candidate, 4] = out[2]
                        candidates[candidate, 5] = 1.0 if converged else 0.0
                        candidates[candidate, 6] = theta_a
                        candidates[candidate, 7] = theta_b
                    candidate += 1
            if verdict == SPLIT:
                candidate = first
                break
            if verdict == CLOSED and k <= search.impacts[MIDDLE] and has_arc(k, sample_a, sample_m, sample_b):
                if candidate < candidates.shape[0]:
                    rounding = 8.0 * grain / jac_m
                    before = x_a - unplace(coordinate, max(theta_a - SLIVER, coordinate.low)) if root_a else rounding
                    after = unplace(coordinate, min(theta_b + SLIVER, coordinate.high)) - x_b if root_b else rounding
                    reach = ArcRange(x_a, x_b, before, after, rounding)
                    fill_arc(flow, k, sample_a, sample_m, sample_b, coordinate, reach, search.fold, candidates[candidate])
                candidate += 1
            k += 1
        if verdict == CLOSED:
            # The next call closes it for the flights that are left.
            stack[top, 7] = k
            top += 1
            state[WITHIN] = 1
            break
        if verdict == DONE:
            counts[CLOSURES] += 1
            continue
        if verdict == ENDLESS:
            opening = leave_open(openings, opening, theta_a, theta_b - theta_a, k, ENDLESS, counts)
            continue
        counts[SPLITS] += 1
        if verdict == JUMP:
            one, two, theta_1, theta_2, edge_1, edge_2, coarse, followed = grazing_between(
                search, k, Ends(theta_a, theta_b, i_a, i_b), i_m, grain
            )
            counts[GRAZINGS] += 1
            counts[STARTS] += followed
            used += followed
            flights += followed * (k + 1)
            if edge_2 - edge_1 > 64.0 * grain:
                opening = leave_open(openings, opening, edge_1, edge_2 - edge_1, k, JUMP, counts)
            elif coarse and k > 0:
                opening = leave_open(openings, opening, theta_1, theta_2 - theta_1, k, GRAZED, counts)
            early_one = records[one, k, DURATION] < records[two, k, DURATION]
            if two != i_b and theta_b > theta_2:
                # The square root starts at grazing itself, and at an end where an earlier one did.
                new_low = theta_2 if early_one else edge_1
                new_high = coordinate.high if root_b else theta_b
                code = (0 if early_one else 1) + (2 if root_b else 0)
                part = StartMap(new_low, new_high, int64(code))
                top = push_between(stack, top, part, Ends(theta_2, theta_b, two, i_b), k, depth + 1, verdict)
            if one != i_a and theta_1 > theta_a:
                new_low = coordinate.low if root_a else theta_a
                new_high = edge_2 if early_one else theta_1
                code = (2 if early_one else 0) + (1 if root_a else 0)
                part = StartMap(new_low, new_high, int64(code))
                top = push_between(stack, top, part, Ends(theta_a, theta_1, i_a, one), k, depth + 1, verdict)
            continue
        top = push(stack, top, coordinate, Ends(x_m, x_b, i_m, i_b), k, depth + 1, verdict)
        top = push(stack, top, coordinate, Ends(x_a, x_m, i_a, i_m), k, depth + 1, verdict)
    state[TOP] = top
    state[USED] = used
    state[CANDIDATES] = candidate
    state[OPENINGS] = opening
    return top == 0


@kernel
def place(coordinate, x):
    """Parameter of the start at x in [0, 1], and its derivative."""
    low, high, kind = coordinate
    span = high - low
    if kind == 0:
        return low + span * x, span
    if kind == 1:
        return low + span * x * x, 2.0 * span * x
    if kind == 2:
        return high - span * (1.0 - x) * (1.0 - x), 2.0 * span * (1.0 - x)
    s = math.sin(0.5 * math.pi * x)
    return low + span * s * s, 0.5 * math.pi * span * math.sin(math.pi * x)


@kernel
def unplace(coordinate, theta):
    """The parameter x in [0, 1] of a start theta; the inverse of `place`."""
    low, high, kind = coordinate
    part = (theta - low) / (high - low)
    if kind == 0:
        return part
    if kind == 1:
        return math.sqrt(max(part, 0.0))
    if kind == 2:
        return 1.0 - math.sqrt(max((high - theta) / (high - low), 0.0))
    if part < 0.5:
        return 2.0 / math.pi * math.asin(math.sqrt(max(part, 0.0)))
    return 1.0 - 2.0 / math.pi * math.asin(math.sqrt(max((high - theta) / (high - low), 0.0)))
