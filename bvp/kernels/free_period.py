"""The impacts of the full period of a free orbit in changed parameters, in the modes there: what its multipliers are computed from."""

import math
from typing import NamedTuple

import numpy as np

from bvp.kernels.compiled import kernel
from bvp.kernels.flight import Flight, inner
from bvp.kernels.multipoint import ImpactList, Segment, unfold_impacts
from bvp.kernels.pencil import ContactRows
from bvp.kernels.undamped import EPSILON

GRAZES = -1
"""In place of the number of impacts: one of them has no speed."""


class FreePeriod(NamedTuple):
    """The full period of orbits of one sequence with k inner impacts, n coordinates, S stops and C contacts, and scratch."""

    stops: np.ndarray  # (S, n) gaps
    contact: np.ndarray  # (k + 2,) int64 the contact of each node, -1: none
    stop: np.ndarray  # (C,) int64 the stop of each contact
    opposite: np.ndarray  # (C,) int64 the contact on the other side of its stop
    weights: np.ndarray  # (2 n,) squared frequencies, then ones
    flight: Flight  # of modal states; its matrix is that of the problem
    rows: ContactRows  # of modal states
    segment: Segment  # that begins with a modal state
    unknowns: np.ndarray  # ((k + 1) (2 n + 1),) modal nodes, each with the time of its flight
    ends: np.ndarray  # (k + 1, 2 n) modal states after the flights
    impacts: ImpactList
    scratch: np.ndarray  # (2, 2 n)


def make_free_period(stops, contact, stop, opposite, flight, segment):
    """The arrays. flight: of the modes, with blocks of its own for each. segment: of the problem of the system."""
    n, count = stops.shape[1], len(contact) - 1
    contacts, most = len(stop), 4 * count
    gap, rate, push = np.zeros((3, contacts, 2 * n))
    rows = ContactRows(gap, rate, push, np.full(contacts, 2.0))
    own = flight._replace(pairs=flight.pairs[:n].copy(), mean=flight.mean[:n].copy(), delta=flight.delta[:n].copy())
    begun = segment._replace(start_map=np.eye(2 * n), start_offset=np.zeros(2 * n), gap=np.zeros((count + 1, 2 * n)))
    impacts = ImpactList(np.empty((most, 2 * n)), np.empty((most, 2 * n)), np.empty(most), np.empty(most, dtype=np.int64))
    return FreePeriod(
        stops, contact, stop, opposite, np.ones(2 * n), own, rows, begun, np.empty(count * (2 * n + 1)), np.empty((count, 2 * n)), impacts,
        np.empty((2, 2 * n)),
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
    stops, rows, segment, impacts, unknowns = period.stops, period.rows, period.segment, period.impacts, period.unknowns
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
                segment.gap[i, k] = rows.gap[period.contact[i], k]
    for i in range(count):
        at, place = i * width, i * (2 * n + 1)
        to_modes(flight.enter, y[at:], unknowns[place : place + 2 * n])
        unknowns[place + 2 * n] = y[at + width - 1]
        to_modes(flight.enter, before[i], period.ends[i])
    found, _ = unfold_impacts(segment, unknowns, period.ends, impacts, period.scratch)
    if found == 0:
        return 0
    total = 0.0
    for r in range(2 * n):
        total += abs(period.weights[r]) * impacts.after[0, r] ** 2
    limit = slow * math.sqrt(total)
    for i in range(found):
        row = impacts.row[i]
        contact = period.contact[row]
        if segment.bound[row] * inner(segment.gap[row], impacts.before[i]) < 0.0:
            contact = period.opposite[contact]
        impacts.row[i] = contact
        if not abs(inner(rows.rate[contact], impacts.before[i])) >= limit:
            return GRAZES
    return found
