"""Meetings of arcs with mirror images of arcs, which are segments between two ends.

If the arc A of one curve of starts meets the mirror image of the arc B of another one, a motion leads from a start of the first curve to
one of the second one. It is an orbit between both ends. With odd symmetry both are seen at the same stop.

A pair of arcs is decided if their boxes or their Bezier points are apart, or if no direction of the one is a direction of the other
(`bvp.kernels.arc_pairs`): then they meet once at most, and Newton's method finds the meeting or leaves the pair. Else the arc whose
direction changes more is halved.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy import int64

from bvp.kernels import arcs as at
from bvp.kernels import shooting as column
from bvp.kernels.arc_pairs import (
    are_apart,
    bend_of,
    boxes_apart,
    choose_chart,
    copy_sample,
    cross_product,
    hull,
    mirrored,
    model,
    side_of,
    turn_between,
)  # fmt: skip
from bvp.kernels.arcs import bound_arc, box_arc, set_sample
from bvp.kernels.compiled import allocating, kernel
from bvp.kernels.flight import copy_1
from bvp.kernels.intervals import StartMap, place
from bvp.kernels.shooting import Flow, follow_impacts, start_at

SPLITS, DEPTH = 4000, 200
"""Halvings of one pair of arcs: all, and one after the other."""

CELLS = 64
"""Cells along each axis of the section, to find arcs that are near each other."""

COUNTS = ("met", "pairs", "halved", "undecided", "tried")
(FOUND, PAIRS, HALVED, UNDECIDED_PAIRS, TRIED) = range(5)
"""Meetings; pairs whose boxes meet; halvings; pairs that are not decided; pairs that meet once at most."""

MODEL = 3.0
"""An arc is halved by its samples alone if its derivative changes this many times more than its error."""

ROUNDING = 1e-13
"""Rounding errors of a followed state, relative to it."""

SETTLED = 1e-6
"""Newton's method has converged if its step is smaller, in u: the next one would be as small as its square."""

CLOSE = 1e-7
"""A start beyond an end of its arc by less than this, in u, is not followed: a grazing may be between them. Its point is taken from the end
and the derivative there, and is wrong by the square of this."""

COORDINATE = 1e-6
"""Largest difference at a meeting of the coordinate that Newton's method leaves out. A larger one has the other sign on the other arc."""

MET_A, MET_B, IMPACTS_A, IMPACTS_B, CURVE_A, CURVE_B, MET = range(7)
"""Columns of a meeting: parameters of both starts, impacts from each to the meeting, number of each curve; then for each impact from A to
the meeting, and from B to the meeting, the flight time before it and its contact, as far as they are not gone before the starts."""


APART, ONE, UNDECIDED = 0, 1, 2
"""Verdicts on a pair of arcs whose directions differ: they do not meet, they meet once, or that is not known."""


class MeetingSearch(NamedTuple):
    """C curves of starts, with the limits of the segments between them."""

    flow: Flow  # of the system
    starts: np.ndarray  # (C, 3, 4) start of the flow of each curve
    shapes: np.ndarray  # (C, 2) int64 and its shape
    gone: np.ndarray  # (C,) int64 impacts before its starts
    times: np.ndarray  # (C, C) longest time of a segment
    impacts: np.ndarray  # (C, C) int64, most inner impacts; negative where no segment is looked for
    fold: bool  # whether a mirror image stands for the states at the lower stop
    records: np.ndarray  # (2, K + 2, COLUMNS) scratch
    samples: np.ndarray  # (ARC,) scratch
    work: np.ndarray  # (16, 16) scratch


@kernel
def follow_arc(search, arc, u, record, out, slot):
    """Fill sample `slot` of `out` with the point of an arc at u by following its start. Returns whether it arrives in the arc's box,
    the parameter, and its derivative by u."""
    half = 0.5 * (arc[at.LAST] - arc[at.FIRST])
    theta, jacobian = place(StartMap(arc[at.LOW], arc[at.HIGH], int64(arc[at.KIND])), 0.5 * (arc[at.FIRST] + arc[at.LAST]) + half * u)
    jacobian *= half
    flow = search.flow
    curve = int64(arc[at.CURVE])
    count = int64(arc[at.IMPACTS]) - search.gone[curve]
    flow = Flow(flow.flight, flow.contacts, flow.squares, flow.across, flow.limits, search.starts[curve], search.shapes[curve], flow.table)
    z = search.work[5, :4]
    dz = search.work[6, :4]
    if count == 0:
        start_at(flow, theta, z, dz)
        contact = flow.shape[1]
    else:
        # The state after the last impact, and its derivative, are left in the scratch.
        rows = follow_impacts(flow, theta, 2.0 * arc[at.ARRIVED + 1], math.inf, count - 1, record, search.work)
        if rows < count or record[count - 1, column.CONTACT] < 0.0:
            return False, theta, jacobian
        contact = int64(record[count - 1, column.CONTACT])
    set_sample(flow, flow.contacts.side[contact], search.fold, z, dz, jacobian, out, slot)
    # A start beyond a grazing arrives elsewhere.
    for c in range(3):
        if not arc[at.BOX + 2 * c] <= out[at.VALUE + 3 * c + slot] <= arc[at.BOX + 2 * c + 1]:
            return False, theta, jacobian
    return True, theta, jacobian


@kernel
def followed_place(u):
    """The place on an arc whose start is followed instead of that at u."""
    end = min(max(u, -1.0), 1.0)
    return end if abs(u - end) <= CLOSE else u


@kernel
def halve(search, arc, one, two):
    """The halves of an arc. Returns whether the starts in their middles arrive. `arc` is overwritten."""
    copy_1(arc, one)
    copy_1(arc, two)
    middle = 0.5 * (arc[at.FIRST] + arc[at.LAST])
    one[at.LAST] = middle
    two[at.FIRST] = middle
    one[at.GRAIN] *= 2.0
    two[at.GRAIN] *= 2.0
    one[at.BEFORE] = min(2.0 * arc[at.BEFORE], 0.5)
    one[at.AFTER] = at.NEAREST
    two[at.BEFORE] = at.NEAREST
    two[at.AFTER] = min(2.0 * arc[at.AFTER], 0.5)
    change = 0.0
    error = 0.0
    for c in range(3):
        change += abs(arc[at.RATE + 3 * c + 2] - arc[at.RATE + 3 * c])
        error += arc[at.ERROR + c]
    # If their error is small beside the turn of the arc, its samples give those of its halves.
    modelled = change > MODEL * error
    new = search.samples
    for i in range(2):
        if modelled:
            model(arc, i - 0.5, new, i)
        else:
            arrives, _, _ = follow_arc(search, arc, i - 0.5, search.records[0], new, i)
            if not arrives:
                return False
    if not modelled and arc[at.MODELLED] != 0.0:
        for i in range(3):
            arrives, _, _ = follow_arc(search, arc, i - 1.0, search.records[0], arc, i)
            if not arrives:
                return False
    copy_sample(arc, 0, one, 0)
    copy_sample(new, 0, one, 1)
    copy_sample(arc, 1, one, 2)
    copy_sample(arc, 1, two, 0)
    copy_sample(new, 1, two, 1)
    copy_sample(arc, 2, two, 2)
    for half in (one, two):
        if modelled:
            half[at.MODELLED] = 1.0
            for c in range(3):
                half[at.ERROR + c] *= 0.5
            box_arc(half)
        else:
            half[at.MODELLED] = 0.0
            bound_arc(half)
    return True


@kernel
def rounding_of(a, b, points, c):
    """Rounding of the difference of a coordinate at two points that are followed, with that of their starts."""
    at_c = at.RATE + 3 * c
    return ROUNDING * (1.0 + abs(points[at.VALUE + 3 * c])) + a[at.GRAIN] * abs(points[at_c]) + b[at.GRAIN] * abs(points[at_c + 1])


@kernel
def meeting(search, a, b, chart, hulls, sign, found):
    """The meeting of two arcs that meet once at most. sign: of the cross products of their directions. Returns APART, ONE, or UNDECIDED."""
    u = 0.0
    w = 0.0
    low_u, high_u, low_w, high_w = -1.0 - a[at.BEFORE], 1.0 + a[at.AFTER], -1.0 - b[at.BEFORE], 1.0 + b[at.AFTER]
    points = search.samples
    first = 3 * chart[0]
    second = 3 * chart[1]
    sign0 = mirrored(chart[0])
    sign1 = mirrored(chart[1])
    # By the samples first, which decides most; then by following both starts.
    for stage in range(2):
        settled = False
        for _ in range(12):
            theta_a = theta_b = jac_a = jac_b = beyond_u = beyond_w = 0.0
            if stage == 0:
                model(a, u, points, 0)
                model(b, w, points, 1)
                noise0 = a[at.MISS + chart[0]] + b[at.MISS + chart[0]]
                noise1 = a[at.MISS + chart[1]] + b[at.MISS + chart[1]]
            else:
                beyond_u = u - followed_place(u)
                beyond_w = w - followed_place(w)
                arrives, theta_a, jac_a = follow_arc(search, a, u - beyond_u, search.records[0], points, 0)
                if not arrives:
                    return UNDECIDED
                arrives, theta_b, jac_b = follow_arc(search, b, w - beyond_w, search.records[1], points, 1)
                if not arrives:
                    return UNDECIDED
                noise0 = rounding_of(a, b, points, chart[0])
                noise1 = rounding_of(a, b, points, chart[1])
            a0 = points[at.RATE + first]
            a1 = points[at.RATE + second]
            b0 = sign0 * points[at.RATE + first + 1]
            b1 = sign1 * points[at.RATE + second + 1]
            f0 = points[at.VALUE + first] - sign0 * points[at.VALUE + first + 1] + beyond_u * a0 - beyond_w * b0
            f1 = points[at.VALUE + second] - sign1 * points[at.VALUE + second + 1] + beyond_u * a1 - beyond_w * b1
            # A difference f that a du - b dw shall cancel: du is -(f x b)/(a x b), dw is -(f x a)/(a x b).
            if u <= low_u or u >= high_u:
                way = -sign * side_of(f0, f1, noise0, noise1, hulls[1])
                if (u <= low_u and way < 0.0) or (u >= high_u and way > 0.0):
                    return APART
            if w <= low_w or w >= high_w:
                way = -sign * side_of(f0, f1, noise0, noise1, hulls[0])
                if (w <= low_w and way < 0.0) or (w >= high_w and way > 0.0):
                    return APART
            determinant = cross_product(a0, a1, b0, b1)
            if determinant == 0.0:
                break
            du = min(max(u - cross_product(f0, f1, b0, b1) / determinant, low_u), high_u) - u
            dw = min(max(w - cross_product(f0, f1, a0, a1) / determinant, low_w), high_w) - w
            if abs(du) < max(SETTLED, a[at.GRAIN]) and abs(dw) < max(SETTLED, b[at.GRAIN]):
                settled = True
                if stage == 1:
                    c = 3 * (3 - chart[0] - chart[1])
                    here = points[at.VALUE + c] - mirrored(c // 3) * points[at.VALUE + c + 1]
                    if abs(here) > COORDINATE * (1.0 + abs(points[at.VALUE + c])):
                        return APART
                    change_a = jac_a * (beyond_u + du)
                    change_b = jac_b * (beyond_w + dw)
                    found[MET_A] = theta_a + change_a
                    found[MET_B] = theta_b + change_b
                    collect(search, a, b, change_a, change_b, found)
                    return ONE
                break
            u += du
            w += dw
        if stage == 1 and not settled:
            return UNDECIDED
    return UNDECIDED


@kernel
def collect(search, a, b, change_a, change_b, found):
    """Fill a meeting with what the records say."""
    count_a = int64(a[at.IMPACTS])
    count_b = int64(b[at.IMPACTS])
    found[IMPACTS_A] = count_a
    found[IMPACTS_B] = count_b
    found[CURVE_A] = a[at.CURVE]
    found[CURVE_B] = b[at.CURVE]
    n = MET
    for side in range(2):
        count = count_a - search.gone[int64(a[at.CURVE])] if side == 0 else count_b - search.gone[int64(b[at.CURVE])]
        change = change_a if side == 0 else change_b
        for i in range(count):
            row = search.records[side, i]
            found[n] = row[column.DURATION] + change * row[column.DURATION + 1]
            found[n + 1] = row[column.CONTACT]
            n += 2


@kernel
def may_meet(search, a, b):
    """Whether the numbers of impacts, the stops and the times of two arcs are those of a segment within bounds, and the impact is the last
    one before the middle of its time, seen from A."""
    ca = int64(a[at.CURVE])
    cb = int64(b[at.CURVE])
    if b[at.IMPACTS] == 0.0 or a[at.IMPACTS] + b[at.IMPACTS] - 1.0 > search.impacts[ca, cb] or a[at.SIDE] != b[at.SIDE]:
        return False
    if a[at.ARRIVED] > b[at.ARRIVED + 1] or a[at.ARRIVED + 1] + b[at.ARRIVED + 1] < 2.0 * b[at.LEFT]:
        return False
    return a[at.ARRIVED] + b[at.ARRIVED] <= search.times[ca, cb]


class Grid(NamedTuple):
    """Square cells of (s, v), as many along each axis."""

    low_s: float
    size_s: float
    low_v: float
    size_v: float


@kernel
def grid_over(arcs):
    """The grid over some arcs and their mirror images."""
    low = math.inf
    high = -math.inf
    reach = 0.0
    for arc in arcs:
        low = min(low, arc[at.BOX])
        high = max(high, arc[at.BOX + 1])
        reach = max(reach, -arc[at.BOX + 2], arc[at.BOX + 3])
    wider = (1.0 + 1e-9) / CELLS
    return Grid(low, (high - low) * wider, -reach, 2.0 * reach * wider)


@kernel
def find_cells(arcs, grid, is_mirrored, spans, first):
    """The cells that each arc lies in, or its mirror image: spans (N, 4): first and last ones along s and v; first (CELLS^2 + 1,): how many
    arcs are in all cells before each."""
    for i in range(arcs.shape[0]):
        low_v, high_v = arcs[i, at.BOX + 2], arcs[i, at.BOX + 3]
        if is_mirrored:
            low_v, high_v = -high_v, -low_v
        spans[i, 0] = int64((arcs[i, at.BOX] - grid.low_s) / grid.size_s)
        spans[i, 1] = int64((arcs[i, at.BOX + 1] - grid.low_s) / grid.size_s)
        spans[i, 2] = int64((low_v - grid.low_v) / grid.size_v)
        spans[i, 3] = int64((high_v - grid.low_v) / grid.size_v)
        for x in range(spans[i, 0], spans[i, 1] + 1):
            for y in range(spans[i, 2], spans[i, 3] + 1):
                first[x * CELLS + y + 1] += 1
    for cell in range(CELLS * CELLS):
        first[cell + 1] += first[cell]


@kernel
def fill_cells(arcs, order, is_mirrored, spans, first, items, boxes):
    """The arcs of each cell in an order, one cell after the other, with their boxes, or those of their mirror images. `first` is moved on
    by one cell."""
    for i in order:
        for x in range(spans[i, 0], spans[i, 1] + 1):
            for y in range(spans[i, 2], spans[i, 3] + 1):
                cell = x * CELLS + y
                box = boxes[first[cell]]
                copy_1(arcs[i, at.BOX : at.BOX + 6], box)
                if is_mirrored:
                    box[2], box[3] = -arcs[i, at.BOX + 3], -arcs[i, at.BOX + 2]
                items[first[cell]] = i
                first[cell] += 1


@kernel
def meet_pair(search, stack, hulls, found, counts):
    """Add the meetings of one pair of arcs, the first of the stack (`DEPTH`, 2, ARC), to `found`."""
    top = 1
    splits = 0
    while top > 0:
        top -= 1
        a = stack[top, 0]
        b = stack[top, 1]
        if boxes_apart(a, b):
            continue
        chart = choose_chart(a, b)
        if are_apart(a, b, chart):
            continue
        hull(a, chart, False, hulls[0])
        hull(b, chart, True, hulls[1])
        sign = turn_between(hulls[0], hulls[1])
        if sign != 0.0 and counts[FOUND] < found.shape[0]:
            counts[TRIED] += 1
            verdict = meeting(search, a, b, chart, hulls, sign, found[counts[FOUND]])
            if verdict == ONE:
                counts[FOUND] += 1
            if verdict != UNDECIDED:
                continue
        if splits == SPLITS or top + 3 > DEPTH or counts[FOUND] == found.shape[0]:
            counts[UNDECIDED_PAIRS] += 1
            return
        splits += 1
        counts[HALVED] += 1
        which = 0 if bend_of(hulls[0]) >= bend_of(hulls[1]) else 1
        copy_1(stack[top, 1 - which], stack[top + 1, 1 - which])
        copy_1(stack[top, which], stack[top + 2, which])
        if not halve(search, stack[top + 2, which], stack[top, which], stack[top + 1, which]):
            counts[UNDECIDED_PAIRS] += 1
            return
        top += 2


@allocating
def meet_arcs(search, arcs, order, found, counts):
    """All meetings of arcs (N, ARC) with mirror images of arcs.

    order (N,): the arcs in the order of their smallest n (column BOX + 4). found (M, 2 K + 10): filled with meetings. counts (5,): see
    `COUNTS`, added to. A pair is undecided, too, if there is no room for its meeting."""
    grid = grid_over(arcs)
    spans = np.empty((2, arcs.shape[0], 4), np.int64)
    first = np.zeros((2, CELLS * CELLS + 1), np.int64)
    for m in range(2):
        find_cells(arcs, grid, m == 1, spans[m], first[m])
    room = max(first[0, CELLS * CELLS], first[1, CELLS * CELLS])
    items = np.empty((2, room), np.int64)
    # Most pairs are apart: their boxes are read in the order of the cells, without the arcs.
    boxes = np.empty((2, room, 6))
    for m in range(2):
        fill_cells(arcs, order, m == 1, spans[m], first[m], items[m], boxes[m])
    stack = np.empty((DEPTH, 2, at.ARC))
    hulls = np.empty((2, 4, 2))
    for cell in range(CELLS * CELLS):
        for ia in range(first[0, cell - 1] if cell > 0 else 0, first[0, cell]):
            i = items[0, ia]
            low_s, high_s, low_v, high_v = boxes[0, ia, 0], boxes[0, ia, 1], boxes[0, ia, 2], boxes[0, ia, 3]
            low_n, high_n = boxes[0, ia, 4], boxes[0, ia, 5]
            for ib in range(first[1, cell - 1] if cell > 0 else 0, first[1, cell]):
                # Arcs crowd where they graze: there n excludes most pairs, and with one of them all that follow in its order.
                if boxes[1, ib, 4] > high_n:
                    break
                if low_n > boxes[1, ib, 5] or low_s > boxes[1, ib, 1] or high_s < boxes[1, ib, 0]:
                    continue
                if low_v > boxes[1, ib, 3] or high_v < boxes[1, ib, 2]:
                    continue
                j = items[1, ib]
                # Of the cells that both are in, the first has the pair.
                if cell != max(spans[0, i, 0], spans[1, j, 0]) * CELLS + max(spans[0, i, 2], spans[1, j, 2]):
                    continue
                if not may_meet(search, arcs[i], arcs[j]):
                    continue
                counts[PAIRS] += 1
                copy_1(arcs[i], stack[0, 0])
                copy_1(arcs[j], stack[0, 1])
                meet_pair(search, stack, hulls, found, counts)
