"""Refining an interval of energies until every zero of every miss of the impulsive motion is alone in an interval.

At one energy the impulsive motion is one trajectory. Between the energies at which its events change - a new impact by grazing, a new
pair of passages of the gap coordinate through zero - each event's miss is a smooth function of log h, whose derivative is known
exactly. An interval is closed where, for each event, twice the largest derivative at its ends is too small to bring the miss
to zero in between, or the miss is monotone there: the derivatives at both ends and the secant agree within a factor. The same is
asked of the distance of each turning point from the stops and from zero, and of the speeds of impacts, so that no change of the events
hides inside. What is not closed is halved, at a change of events down to rounding.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from branches.impulsive.trails import Traces, Trails
from bvp.kernels.trail import TURN, ZERO

__all__ = ["Bracket", "Scan", "scan_energies"]

PANEL = 0.05
"""Width in log h of the intervals that a scan starts from."""

FLOOR = 2e-14
"""Width in log h that is not halved any more."""

SAFETY = 2.0
"""How many times steeper than at both ends a miss may be inside an interval that is closed."""

BATCH = 256
MOST_MOTIONS = 400_000


@dataclass(frozen=True)
class Bracket:
    """A zero of the miss at one event: log h below and above, index and kind of the event."""

    low: float
    high: float
    event: int
    kind: int


@dataclass(eq=False)
class Scan:
    """What a scan found: brackets of zeros; counts; `open`, the intervals of log h that could not be closed."""

    brackets: list[Bracket] = field(default_factory=list)
    open: list[tuple[float, float]] = field(default_factory=list)
    motions: int = 0
    changes: int = 0
    """Energies at which the events change, each an interval of width `FLOOR`."""


def scan_energies(trails: Trails, energy: tuple[float, float], quarter_period: float) -> Scan:
    """Bracket each energy at which the impulsive motion meets an end set.

    Parameters
    ----------
    trails : Trails
        That follows for two quarter periods at least.
    energy : (float, float)
    quarter_period : float
        Longest; an origin is met after two quarter periods, rest and stop after one.

    Returns
    -------
    Scan
    """
    scan = Scan()
    low, high = math.log(energy[0]), math.log(energy[1])
    edges = np.linspace(low, high, max(2, math.ceil((high - low) / PANEL) + 1))
    at = trails.at(edges)
    scan.motions += len(edges)
    # Last in, first out: only the intervals next to be halved are kept in memory.
    pending = [(edges[:-1], edges[1:], at.rows(np.arange(len(edges) - 1)), at.rows(np.arange(1, len(edges))))]
    while pending:
        a, b, first, last = pending.pop()
        if len(a) > BATCH:
            half = len(a) // 2
            pending.append((a[half:], b[half:], first.rows(slice(half, None)), last.rows(slice(half, None))))
            pending.append((a[:half], b[:half], first.rows(slice(half)), last.rows(slice(half))))
            continue
        width = first.kind.shape[1]
        changed, closed, clear, zero = judge(first, last, b - a, trails, quarter_period)
        narrow = b - a <= FLOOR
        done = narrow | (closed.all(axis=1) & clear.all(axis=1) & ~changed)
        for i, j in np.argwhere(zero & done[:, None]):
            scan.brackets.append(Bracket(float(a[i]), float(b[i]), int(j), int(first.kind[i, j])))
        scan.changes += int(np.sum(narrow & changed))
        for i in np.flatnonzero(narrow & ~(closed | zero).all(axis=1)):
            scan.open.append((float(a[i]), float(b[i])))
        split = np.flatnonzero(~done)
        if not len(split):
            continue
        if scan.motions > MOST_MOTIONS:
            scan.open += [(float(a[i]), float(b[i])) for i in split]
            continue
        middle = 0.5 * (a[split] + b[split])
        between = trails.at(middle)
        scan.motions += len(split)
        if between.kind.shape[1] != width:
            first, last = padded(first, between.kind.shape[1]), padded(last, between.kind.shape[1])
        pending.append(
            (
                np.concatenate([a[split], middle]),
                np.concatenate([middle, b[split]]),
                joined(first.rows(split), between),
                joined(between, last.rows(split)),
            )
        )
    scan.brackets.sort(key=lambda bracket: (bracket.low, bracket.event))
    return scan


def judge(
    first: Traces, last: Traces, width: np.ndarray, trails: Trails, quarter_period: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Compare the motions at both ends of I intervals.

    Returns
    -------
    changed : (I,) bool
        The events differ, other than by one that leaves the time followed.
    closed, clear, zero : (I, E) bool
        Whether the miss of each event hides no zero but one; whether a turning point hides no change of events; whether the miss changes
        sign. Events after the first that differs are left out.
    """
    size = min(first.kind.shape[1], last.kind.shape[1])
    index = np.arange(size)
    both = index < np.minimum(first.count, last.count)[:, None]
    same = np.logical_and.accumulate(both & (first.kind[:, :size] == last.kind[:, :size]), axis=1)
    prefix = same.sum(axis=1)
    changed = (first.count > prefix) & (last.count > prefix)
    for one, other in ((first, last), (last, first)):
        more = (one.count > prefix) & (other.count <= prefix)
        row = np.flatnonzero(more)
        here = prefix[row]
        # Only the next event may leave at the end of the time, as far as its time moves over the interval.
        moves = SAFETY * np.abs(one.time_slope[row, here]) * width[row]
        leaves = one.time[row, here] + moves + 1e-12 * trails.longest >= trails.longest
        changed[row] = ~leaves
    changed |= (first.count < 0) | (last.count < 0)
    kind = first.kind[:, :size]
    late = np.minimum(first.time[:, :size], last.time[:, :size])
    within = same & (late <= np.where(kind == ZERO, 2.0, 1.0) * quarter_period)
    w = width[:, None]
    sure, sign = certain(first.miss[:, :size], last.miss[:, :size], first.miss_slope[:, :size], last.miss_slope[:, :size], w)
    steady = kind != TURN
    alone, _ = certain(first.passing[:, :size], last.passing[:, :size], first.passing_slope[:, :size], last.passing_slope[:, :size], w)
    clear = ~same | alone
    for bound in (0.0, *trails.modes.contact_bound):
        alone, _ = certain(
            first.gap[:, :size] - bound, last.gap[:, :size] - bound, first.gap_slope[:, :size], last.gap_slope[:, :size], w
        )
        clear &= ~same | steady | alone
    return changed, ~within | sure, clear, within & sign


def certain(
    low: np.ndarray, high: np.ndarray, low_slope: np.ndarray, high_slope: np.ndarray, width: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Whether a function with these values and derivatives at both ends of an interval has no zero or just one in it, and whether it
    changes sign."""
    secant = (high - low) / width
    steepest = SAFETY * np.maximum(np.maximum(np.abs(low_slope), np.abs(high_slope)), np.abs(secant))
    sign = (low > 0.0) != (high > 0.0)
    away = ~sign & (np.abs(low) + np.abs(high) > steepest * width)
    least = np.minimum(np.minimum(np.abs(low_slope), np.abs(high_slope)), np.abs(secant))
    monotone = (low_slope * high_slope > 0.0) & (low_slope * secant > 0.0) & (SAFETY * least >= steepest / SAFETY)
    return away | monotone, sign


def padded(traces: Traces, size: int) -> Traces:
    """With room for `size` events."""
    more = size - traces.kind.shape[1]
    if more <= 0:
        return traces
    return Traces(
        *(
            np.pad(getattr(traces, name), ((0, 0), (0, more))) if name != "count" else traces.count
            for name in traces.__dataclass_fields__
        )
    )


def joined(first: Traces, second: Traces) -> Traces:
    """All of both."""
    size = max(first.kind.shape[1], second.kind.shape[1])
    first, second = padded(first, size), padded(second, size)
    return Traces(*(np.concatenate([getattr(first, name), getattr(second, name)]) for name in first.__dataclass_fields__))
