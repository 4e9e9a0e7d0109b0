"""The scan of a curve of starts (`bvp.kernels.intervals`): every crossing of a far end, and what could not be decided.

An interval of starts can be too narrow to be split again and still be undecided at one of its flights: there floating-point numbers do not
tell the starts apart. The flights before that one are decided, so that the states after its impacts are a short smooth curve. `resumed`
gives this curve, which is scanned in place of the interval. Its states have the rounding errors that each followed state has. Along the
curve such an error only exchanges starts. Across the curve it shrinks as fast as motions part. So an orbit through the true curve has a
neighbour through this one, and Newton's method, which holds all states at once, goes from one to the other.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from branches.search.starts import INSET, QUADRATIC, Curve, Path
from bvp.interrupts import Pace
from bvp.kernels.intervals import CANDIDATES, COUNTS, OPENINGS, STATE, begin_interval, scan_interval
from bvp.kernels.multipoint import ORIGIN, REST, STOP
from bvp.kernels.shooting import COLUMNS, CONTACT, DERIVATIVE, DURATION, TIME, follow_impacts
from bvp.kernels.verdict import ENDLESS

__all__ = ["Opening", "EndCrossing", "follow_start", "resumed", "scan"]

PIECES, PIECES_RESUMED = 32, 2
"""Intervals that each curve is cut into at first; and one that is resumed."""

DEPTH = 100
"""Halvings of one interval, most of them in the square root of the distance to a grazing."""

MOST_IMPACTS = 200
"""Impacts that one start is followed through where no bound is given."""

KINDS = {"origin": ORIGIN, "rest": REST, "stop": STOP}


class EndCrossing(NamedTuple):
    """A start of a curve whose motion crosses a far end.

    kind: "origin", "rest" or "stop". impacts: inside the segment. parameter: of the start. flight: time in the last flight. residual: of
    the end's condition. converged: whether Newton's method converged; if not, the crossing lies between `low` and `high` if it exists.
    """

    kind: str
    impacts: int
    parameter: float
    flight: float
    residual: float
    converged: bool
    low: float
    high: float


class Opening(NamedTuple):
    """An interval of starts that could not be closed: where, its width, the flight (impacts before it), the kernel's reason."""

    parameter: float
    width: float
    flight: int
    reason: int


def scan(
    curve: Curve, limits: Mapping[str, tuple[float, int | None]], budget: int
) -> tuple[list[EndCrossing], list[Opening], dict[str, int]]:
    """Scan one curve.

    Parameters
    ----------
    curve : Curve
    limits : mapping of "origin", "rest", "stop" to (time, impacts)
        The far ends looked for: the longest segment, and the most impacts inside it (None: as many as come).
    budget : int
        Starts followed at most; intervals left then stay open.

    Returns
    -------
    crossings, openings, counts
        Counts by the names of `bvp.kernels.intervals.COUNTS`.
    """
    gone = 0 if curve.before is None else len(curve.before.contacts)
    since = 0.0 if curve.before is None else float(curve.before.instants[-1])
    most = max((MOST_IMPACTS if impacts is None else impacts for _, impacts in limits.values()), default=0) - gone
    times = np.full(3, -1.0)
    impacts = np.zeros(3, dtype=np.int64)
    for end, (time, count) in limits.items():
        # Without a bound there is always one impact more to follow, so that a start with too many of them is left open, not dropped.
        left_of_them = (MOST_IMPACTS + 1 if count is None else count) - gone
        times[KINDS[end]] = time - since if left_of_them >= 0 else -1.0
        impacts[KINDS[end]] = left_of_them
    longest = float(times.max())
    records = np.zeros((3 * DEPTH + 3, most + 2, COLUMNS))
    levels = np.zeros(3 * DEPTH + 3, dtype=np.int64)
    stack = np.zeros((2 * DEPTH, 10))
    work = np.zeros((16, 16))
    candidates = np.zeros((4096, 8))
    openings = np.zeros((256, 4))
    total = np.zeros(len(COUNTS), dtype=np.int64)
    crossings: list[EndCrossing] = []
    open_ones: list[Opening] = []
    state = np.zeros(STATE, dtype=np.int64)
    pace = Pace()
    pieces = PIECES if curve.before is None else PIECES_RESUMED
    edges = np.linspace(curve.low, curve.high, pieces + 1)
    for i in range(pieces):
        low, high = float(edges[i]), float(edges[i + 1])
        root_low = curve.singular[0] and i == 0
        root_high = curve.singular[1] and i == pieces - 1
        kind = (1.0 if root_low else 0.0) + (2.0 if root_high else 0.0)
        ends = np.array([low, high, kind])
        low += INSET if root_low else 0.0
        high -= INSET if root_high else 0.0
        while True:
            counts = np.zeros(len(COUNTS), dtype=np.int64)
            left = max(1, budget - int(total[0]))
            begin_interval(curve.flow, low, high, ends, longest, most, records, levels, stack, counts, state, work)
            done = False
            while not done:
                with pace:
                    done = scan_interval(
                        curve.flow, times, impacts, longest, most, records, levels, stack, candidates, openings, left, counts, pace.passes,
                        state, work,
                    )  # fmt: skip
            found, opened = int(state[CANDIDATES]), int(state[OPENINGS])
            if found <= len(candidates) and opened <= len(openings):
                break
            candidates = np.zeros((max(2 * found, len(candidates)), 8))
            openings = np.zeros((max(2 * opened, len(openings)), 4))
        total += counts
        for row in candidates[:found]:
            name = next(end for end, number in KINDS.items() if number == row[0])
            place, flight, residual, converged, low, high = row[2:8].tolist()
            crossings.append(EndCrossing(name, gone + int(row[1]), place, flight, residual, converged == 1.0, low, high))
        open_ones += [Opening(float(row[0]), float(row[1]), gone + int(row[2]), int(row[3])) for row in openings[:opened]]
    return crossings, open_ones, dict(zip(COUNTS, total.tolist(), strict=True))


def follow_start(curve: Curve, parameter: float, impacts: int, longest: float) -> Path:
    """One start of a curve, followed through so many impacts, or fewer where the time ends before.

    Of a curve with motion `before` it, that is part of the path and of its impacts and its time."""
    before = curve.before
    if before is not None:
        impacts -= len(before.contacts)
        longest -= float(before.instants[-1])
    record = np.zeros((impacts + 2, COLUMNS))
    work = np.zeros((16, 16))
    rows = follow_impacts(curve.flow, parameter, longest, impacts, record, work)
    hit = int(np.argmax(np.append(record[:rows, CONTACT] < 0.0, True)))
    hit = min(hit, impacts + 1)
    inner = min(hit, impacts, rows - 1)
    start, contacts = record[0, :4].copy(), record[:hit, CONTACT].astype(np.int64)
    nodes, durations, instants = record[1 : inner + 1, :4].copy(), record[:inner, DURATION].copy(), record[1 : inner + 1, TIME].copy()
    if before is None:
        return Path(start, contacts, nodes, durations, instants)
    return Path(
        before.start,
        np.append(before.contacts, contacts),
        np.vstack([before.nodes[:-1], start[None], nodes]),
        np.append(before.durations, durations),
        np.append(before.instants, before.instants[-1] + instants),
    )


NARROW = 1e-12
"""Intervals wider than this, as a part of the curve or of 1, are open for another reason than rounding."""

OVERLAP = 5e-15
"""How far the image goes on beyond the interval on either side, in the parameter of either: that much rounding can move it."""

STRETCHED = 10.0
"""Images that are not this much longer than their interval, as a part of their states, are as narrow as it."""


def resumed(curve: Curve, opening: Opening, longest: float) -> Curve | None:
    """The states after the last decided impact of an open interval, as a curve of starts.

    Parameters
    ----------
    curve : Curve
        What was scanned.
    opening : Opening
        What stayed open of it.
    longest : float
        Time from the first start of all that is searched.

    Returns
    -------
    Curve or None
        None where the interval is open for another reason than rounding, so that its image would be so as well.
    """
    gone = 0 if curve.before is None else len(curve.before.contacts)
    since = 0.0 if curve.before is None else float(curve.before.instants[-1])
    flight = opening.flight - gone
    if flight < 1 or opening.reason == ENDLESS or opening.width > NARROW * max(1.0, abs(opening.parameter)):
        return None
    half = 0.5 * opening.width
    middle = opening.parameter + half
    work = np.zeros((16, 16))
    samples = []
    for parameter in (opening.parameter, middle, opening.parameter + opening.width):
        record = np.zeros((flight + 2, COLUMNS))
        if follow_impacts(curve.flow, parameter, longest - since, flight, record, work) <= flight:
            return None
        samples.append(record)
    low, here, high = samples
    if any(np.any(record[:flight, CONTACT] != here[:flight, CONTACT]) for record in samples):
        return None
    state, rate = here[flight, :4], here[flight, DERIVATIVE : DERIVATIVE + 4]
    bend = (high[flight, DERIVATIVE : DERIVATIVE + 4] - low[flight, DERIVATIVE : DERIVATIVE + 4]) / opening.width
    # By this parameter the state moves as fast as it is large, as the kernels expect of starts: their rounding is the parameter's.
    scale = float(np.max(np.abs(state)) / np.max(np.abs(rate)))
    if STRETCHED * scale > 1.0:
        return None
    reach = (half + OVERLAP * max(1.0, abs(middle))) / scale + OVERLAP
    flow = curve.flow._replace(
        start=np.array([state, scale * rate, 0.5 * scale * scale * bend]),
        shape=np.array([QUADRATIC, int(here[flight - 1, CONTACT])], dtype=np.int64),
    )
    path = follow_start(curve, middle, opening.flight, longest)
    if not path.instants[-1] < longest:
        return None
    before = path._replace(contacts=path.contacts[: opening.flight])
    piece = (curve.angle(middle), curve.piece[1] * scale)
    return replace(curve, flow=flow, low=-reach, high=reach, singular=(False, False), before=before, piece=piece)
