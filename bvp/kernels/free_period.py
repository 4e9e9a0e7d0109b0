"""The impacts of the full period of a free orbit in changed parameters, in the modes there: what its multipliers are computed from."""

import math
from typing import NamedTuple

import numpy as np
from numpy import int64

from bvp.kernels.compiled import inlined, kernel
from bvp.kernels.flight import Flight, inner
from bvp.kernels.multipoint import ORIGIN, STOP
from bvp.kernels.undamped import EPSILON

GRAZES = -1
"""In place of the number of impacts: one of them has no speed."""


class ImpactList(NamedTuple):
    """The P nodes of an orbit over its period, impacts and cuts, in order of time."""

    before: np.ndarray  # (P, N) states
    after: np.ndarray  # (P, N)
    duration: np.ndarray  # (P,) of the flight after each impact
    row: np.ndarray  # (P,) int64 row of the node arrays that describes its contact


@kernel
def _append_impact(impacts, count, ahead, first, source_before, source_after, node, sign_q, sign_p):
    """Append an impact: the image of the given states, their displacements times sign_q and velocities times sign_p. `ahead` is the time
    of flight since the last one. Returns the number of impacts and the time from the start to the first one."""
    half = impacts.before.shape[1] // 2
    for r in range(half):
        impacts.before[count, r] = sign_q * source_before[r]
        impacts.before[count, half + r] = sign_p * source_before[half + r]
        impacts.after[count, r] = sign_q * source_after[r]
        impacts.after[count, half + r] = sign_p * source_after[half + r]
    impacts.row[count] = node
    if count == 0:
        first = ahead
    else:
        impacts.duration[count - 1] = ahead
    return count + 1, first


@inlined
def unfold_impacts(shape, y, ends, impacts, mirror):
    """Fill `impacts` with those of the full period, by the reversals at the ends of the segment. shape: see `FreePeriod`.

    y ((k + 1) (N + 1),) has the nodes, each with the time of its flight; `ends` (k + 1, N) the states at their ends. mirror (N,): scratch.
    Returns (number of impacts, time from the start to the first one)."""
    size = mirror.shape[0]
    half = size // 2
    k = shape[0]
    start = y[:size]
    count = int64(0)
    first = 0.0
    if shape[1] == 1:
        for i in range(k + 1):
            at = size + i * (size + 1)
            impacts.duration[i] = y[at]
            source = start if i == 0 else y[at - size : at]
            node = k if i == 0 else i - 1
            impacts.row[i] = node
            for r in range(size):
                impacts.after[i, r] = source[r]
                impacts.before[i, r] = ends[k if i == 0 else i - 1, r]
        return k + 1, 0.0
    # Each reversal maps the segment to the part of the period that follows it: forwards, backwards, and so again with the other sign.
    reflect = -1.0 if shape[4] == ORIGIN else 1.0
    sign = 1.0
    ahead = 0.0
    for leg in range(4 if shape[2] == 1 else 2):
        forwards = leg % 2 == 0
        for step in range(k + 1):
            i = step if forwards else k - step
            at = size + i * (size + 1)
            ahead += y[at]
            if step == k:
                break
            if forwards:
                count, first = _append_impact(impacts, count, ahead, first, ends[i], y[at + 1 : at + 1 + size], i, sign, sign)
            else:
                back = sign * reflect
                count, first = _append_impact(impacts, count, ahead, first, y[at - size : at], ends[i - 1], i - 1, back, -back)
            ahead = 0.0
        if not forwards and shape[2] == 1:
            sign = -sign
        if shape[4 if forwards else 3] == STOP:
            source = ends[k] if forwards else start
            for r in range(half):
                mirror[r] = source[r]
                mirror[half + r] = -source[half + r]
            if forwards:
                count, first = _append_impact(impacts, count, ahead, first, ends[k], mirror, k, sign, sign)
            else:
                count, first = _append_impact(impacts, count, ahead, first, mirror, start, k + 1, sign, sign)
            ahead = 0.0
    if count > 0:
        impacts.duration[count - 1] = ahead + first
    return count, first


class ContactRows(NamedTuple):
    """The m contacts of modal states of N entries."""

    gap: np.ndarray  # (m, N) g
    rate: np.ndarray  # (m, N) g B
    push: np.ndarray  # (m, N)
    jump: np.ndarray  # (m,) 1 + restitution


class FreePeriod(NamedTuple):
    """The full period of orbits of one sequence with k inner impacts, n coordinates, S stops and C contacts, and scratch."""

    stops: np.ndarray  # (S, n) gaps
    contact: np.ndarray  # (k + 2,) int64 the contact of each node, -1: none
    stop: np.ndarray  # (C,) int64 the stop of each contact
    opposite: np.ndarray  # (C,) int64 the contact on the other side of its stop
    weights: np.ndarray  # (2 n,) squared frequencies, then ones
    flight: Flight  # of modal states; its matrix is that of the problem
    rows: ContactRows  # of modal states
    gap: np.ndarray  # (k + 2, 2 n) rows of the contacts hit, of modal states
    bound: np.ndarray  # (k + 2,)
    shape: np.ndarray  # (5,) int64: inner nodes k; 1 for a closed orbit; quarter periods 1, 2 or 4; kind of start; kind of end
    unknowns: np.ndarray  # ((k + 1) (2 n + 1),) modal nodes, each with the time of its flight
    ends: np.ndarray  # (k + 1, 2 n) modal states after the flights
    impacts: ImpactList
    scratch: np.ndarray  # (2 n,)


def make_free_period(stops, contact, stop, opposite, flight, bound, shape):
    """The arrays. flight: of the modes, with blocks of its own for each."""
    n, count = stops.shape[1], len(contact) - 1
    contacts, most = len(stop), 4 * count
    gap, rate, push = np.zeros((3, contacts, 2 * n))
    rows = ContactRows(gap, rate, push, np.full(contacts, 2.0))
    own = flight._replace(pairs=flight.pairs[:n].copy(), mean=flight.mean[:n].copy(), delta=flight.delta[:n].copy())
    impacts = ImpactList(np.empty((most, 2 * n)), np.empty((most, 2 * n)), np.empty(most), np.empty(most, dtype=np.int64))
    return FreePeriod(
        stops, contact, stop, opposite, np.ones(2 * n), own, rows, np.zeros((count + 1, 2 * n)), bound, shape,
        np.empty(count * (2 * n + 1)), np.empty((count, 2 * n)), impacts, np.empty(2 * n),
    )  # fmt: skip


@kernel
def to_modes(enter, state, out):
    """The modal state of a physical one (2 n,)."""
    for r in range(len(out)):
        out[r] = inner(enter[r], state[: len(out)])


@kernel
def unfold_free(flight, y, before, slow, period):
    """Write the impacts of the full period into period.impacts, with their contacts as rows, and the modal contacts and frequencies.

    flight: `bvp.kernels.loads.LoadedFlight` of an undamped system. y (u,): an orbit; before (k + 1, N): the nodes after its flights. slow:
    the speed, as a part of the orbit's, of an impact that grazes. Returns the number of impacts, or `GRAZES`."""
    stops, rows, impacts, unknowns = period.stops, period.rows, period.impacts, period.unknowns
    n, count = stops.shape[1], before.shape[0]
    shapes = flight.leave
    width = before.shape[1] + 1
    for k in range(n):
        period.flight.delta[k] = flight.free.delta[k]
        period.weights[k] = -flight.free.delta[k]
    for c in range(len(period.stop)):
        gap = stops[period.stop[c]]
        length = 0.0
        for k in range(n):
            total, size = 0.0, 0.0
            for r in range(n):
                term = gap[r] * shapes[r, k]
                total += term
                size += abs(term)
            # What cancels exactly takes nothing from a translation of any size.
            if abs(total) <= 8.0 * n * EPSILON * size:
                total = 0.0
            rows.gap[c, k] = rows.rate[c, n + k] = total
            length += total * total
        for k in range(n):
            rows.push[c, n + k] = rows.gap[c, k] / length if length > 0.0 else 0.0
    for i in range(len(period.contact)):
        if period.contact[i] >= 0:
            for k in range(n):
                period.gap[i, k] = rows.gap[period.contact[i], k]
    for i in range(count):
        at, place = i * width, i * (2 * n + 1)
        to_modes(flight.enter, y[at:], unknowns[place : place + 2 * n])
        unknowns[place + 2 * n] = y[at + width - 1]
        to_modes(flight.enter, before[i], period.ends[i])
    found, _ = unfold_impacts(period.shape, unknowns, period.ends, impacts, period.scratch)
    if found == 0:
        return 0
    total = 0.0
    for r in range(2 * n):
        total += abs(period.weights[r]) * impacts.after[0, r] ** 2
    limit = slow * math.sqrt(total)
    for i in range(found):
        row = impacts.row[i]
        contact = period.contact[row]
        if period.bound[row] * inner(period.gap[row], impacts.before[i]) < 0.0:
            contact = period.opposite[contact]
        impacts.row[i] = contact
        if not abs(inner(rows.rate[contact], impacts.before[i])) >= limit:
            return GRAZES
    return found
