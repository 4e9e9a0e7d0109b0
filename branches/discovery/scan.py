"""The scan of a curve of starts (`bvp.kernels.intervals`): every passage by a far end, and what could not be decided."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from branches.discovery.starts import INSET, Curve, Path
from bvp.kernels.follow import COLUMNS, CONTACT, DURATION, TIME, follow
from bvp.kernels.intervals import CANDIDATES, COUNTS, OPENINGS, STATE, begin_interval, scan_interval
from bvp.kernels.segment import ORIGIN, REST, STOP
from bvp.pace import Pace

__all__ = ["Opening", "Passage", "follow_start", "scan"]

PIECES, PIECES_RESUMED = 32, 2
"""Intervals that each curve is cut into at first; and one that is resumed."""

DEPTH = 100
"""Halvings of one interval, most of them in the square root of the distance to a grazing."""

MOST_IMPACTS = 200
"""Impacts that one start is followed through where no bound is given."""

KINDS = {"origin": ORIGIN, "rest": REST, "stop": STOP}


class Passage(NamedTuple):
    """A start of a curve whose motion passes by a far end.

    kind: "origin", "rest" or "stop". impacts: inside the segment. parameter: of the start. flight: time in the last flight. miss: what is
    left. converged: whether Newton's method settled on it; where not, it lies between `low` and `high` if it exists.
    """

    kind: str
    impacts: int
    parameter: float
    flight: float
    miss: float
    converged: bool
    low: float
    high: float


class Opening(NamedTuple):
    """An interval of starts that could not be closed: where, its width, the flight (impacts before it), the kernel's reason."""

    parameter: float
    width: float
    flight: int
    reason: int


def scan(curve: Curve, limits: Mapping[str, tuple[float, int | None]], budget: int) -> tuple[list[Passage], list[Opening], dict[str, int]]:
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
    passages, openings, counts
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
    passages: list[Passage] = []
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
            passages.append(
                Passage(name, gone + int(row[1]), float(row[2]), float(row[3]), float(row[4]), row[5] == 1.0, float(row[6]), float(row[7]))
            )
        open_ones += [Opening(float(row[0]), float(row[1]), gone + int(row[2]), int(row[3])) for row in openings[:opened]]
    return passages, open_ones, dict(zip(COUNTS, total.tolist(), strict=True))


def follow_start(curve: Curve, parameter: float, impacts: int, longest: float) -> Path:
    """One start of a curve, followed through so many impacts, or fewer where the time ends before.

    Of a curve with motion `before` it, that is part of the path and of its impacts and its time."""
    before = curve.before
    if before is not None:
        impacts -= len(before.contacts)
        longest -= float(before.instants[-1])
    record = np.zeros((impacts + 2, COLUMNS))
    work = np.zeros((16, 16))
    rows = follow(curve.flow, parameter, longest, impacts, record, work)
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
