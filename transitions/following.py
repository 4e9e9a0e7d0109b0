"""Which family a ridge follows, and for how long: the least dear way to cut it into stretches of one family, or of none."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from transitions.families import NEAR, Meeting
from transitions.ridges import HOLDS

__all__ = ["EQUAL_OCTAVES", "EQUAL_SHARE", "Line", "Stretch", "best_of", "stretches", "unlike"]

EQUAL_OCTAVES = 0.2 * NEAR
"""Mean deviations that differ by less than this are equal: a fifth of what a ridge may be off."""

EQUAL_SHARE = 0.1
"""Amplitudes that differ by less than this, in parts of the orbit's, are equal."""


class Line(NamedTuple):
    """A ridge of a motion: its frequency in that of the ridge that is followed, and its amplitude."""

    ratio: float
    amplitude: float


@dataclass(frozen=True, eq=False)
class Stretch:
    """Places `first` to `last`, both included, of a ridge, that one family has, or none."""

    first: int
    last: int
    meeting: Meeting | None


def stretches(meetings: Sequence[Meeting], turns: np.ndarray) -> list[Stretch]:
    """Cut a ridge into stretches.

    Parameters
    ----------
    meetings : sequence of Meeting
        At the same places (j,) of the ridge.
    turns : (j,) float
        Periods of the ridge since its first place, rising.

    Returns
    -------
    list of Stretch
        In order, without gaps; one of a family lasts three periods or more. Following a family costs its squared deviation, in units of
        what is allowed, and following none costs 1, for each period; taking up a family and leaving it cost half of three periods each.
        Of all ways to cut the ridge, the one that costs least in all is taken (Viterbi, IEEE Trans. Inf. Theory 13 (1967) 260).
    """
    count = len(turns)
    fits = [np.isfinite(meeting.deviation) for meeting in meetings]
    chosen = [meeting for meeting, fit in zip(meetings, fits, strict=True) if _longest(fit, turns) >= HOLDS]
    costs = np.ones((count, len(chosen) + 1))  # state 0 follows none
    for i, meeting in enumerate(chosen):
        away = np.nan_to_num(meeting.deviation, nan=np.inf)
        costs[:, i + 1] = (away / NEAR) ** 2
    path = _cheapest(costs * np.gradient(turns)[:, None], 0.5 * HOLDS)
    bounds = np.concatenate([[0], np.flatnonzero(np.diff(path)) + 1, [count]])
    out: list[Stretch] = []
    for first, stop in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
        lasts = turns[stop - 1] - turns[first]
        followed = chosen[path[first] - 1] if path[first] and lasts >= HOLDS * (1.0 - 1e-9) else None
        if followed is None and out and out[-1].meeting is None:
            first = out.pop().first
        out.append(Stretch(first, stop - 1, followed))
    return out


def _cheapest(costs: np.ndarray, switch: float) -> np.ndarray:
    """The states (j,) of least cost: `costs` (j, states), and `switch` for each step between state 0 and another; from one of the others to
    another the way leads through state 0."""
    count, states = costs.shape
    total = costs[0].copy()
    before = np.zeros((count, states), dtype=np.int32)
    own = np.arange(states)
    for j in range(1, count):
        best = int(np.argmin(total[1:])) + 1 if states > 1 else 0
        source = best if best and total[best] + switch < total[0] else 0
        left = total[source] + (switch if source else 0.0)
        change = np.where(own == 0, left, left + switch)
        stays = (total <= change) & (own > 0)
        before[j] = np.where(stays, own, source)
        total = np.where(stays, total, change) + costs[j]
    path = np.empty(count, dtype=int)
    path[-1] = int(np.argmin(total))
    for j in range(count - 1, 0, -1):
        path[j - 1] = before[j, path[j]]
    return path


def _longest(fits: np.ndarray, turns: np.ndarray) -> float:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], fits, [False]]).astype(int)))
    return max((float(turns[b - 1] - turns[a]) for a, b in zip(edges[::2], edges[1::2], strict=True)), default=0.0)


def best_of(
    stretch: Stretch,
    meetings: Sequence[Meeting],
    gap: tuple[float, ...],
    lines: Sequence[Line],
    size: Callable[[int], float],
    impacts: float,
    turns: float,
) -> list[Meeting]:
    """The family that fits a stretch best, and the others that fit it as well.

    Parameters
    ----------
    stretch : Stretch
        With a meeting.
    meetings : sequence of Meeting
        All that there are: those that fit all of the stretch are compared.
    gap : (n,) float
        Gap coordinate.
    lines : sequence of Line
        The ridges of the motion in the stretch, that which is followed first.
    size : callable
        Amplitude of the motion, as it shows within so many periods of the followed ridge.
    impacts, turns : float
        In the stretch: impacts, and periods of the followed ridge.

    Returns
    -------
    list of Meeting
        Of each family one, the best first: those of least mean deviation; of those that are equal in this, those with the most like line
        spectrum (least of the largest difference that a line of the motion or of the orbit has from its partner in the other, as part of
        the amplitude, a line without a partner counting whole); of these, those with the number of impacts that is nearest to the
        motion's, to one impact. All of these are equal, and stand in the order of their impacts in a period, then of the harmonic, then
        of the deviation: the first is the simplest, not the truest.
    """
    part = slice(stretch.first, stretch.last + 1)
    fit = [meeting for meeting in meetings if np.isfinite(meeting.deviation[part]).all()]
    away = np.array([np.mean(np.abs(meeting.deviation[part])) for meeting in fit])
    fit = [meeting for meeting, value in zip(fit, away, strict=True) if value <= away.min() + EQUAL_OCTAVES]
    middle = (stretch.first + stretch.last) // 2
    off = np.array(
        [unlike(meeting.family.shares_at(meeting.point[middle], gap), meeting.harmonic, lines, size(meeting.harmonic)) for meeting in fit]
    )
    fit = [meeting for meeting, value in zip(fit, off, strict=True) if value <= off.min() + EQUAL_SHARE]
    more = np.array([abs(turns * meeting.family.impacts / meeting.harmonic - impacts) for meeting in fit])
    fit = [meeting for meeting, value in zip(fit, more, strict=True) if value <= more.min() + 1.0]
    fit.sort(key=lambda item: (item.family.impacts, item.harmonic, float(np.mean(np.abs(item.deviation[part])))))
    return list({meeting.family.id: meeting for meeting in reversed(fit)}.values())[::-1]


def unlike(shares: np.ndarray, harmonic: int, lines: Sequence[Line], amplitude: float) -> float:
    """Largest difference between the lines of a motion and the harmonics of an orbit, as part of the amplitude.

    Parameters
    ----------
    shares : (k,) float
        Parts of the orbit's amplitude that its harmonics 1 to k carry.
    harmonic : int
        The one that the first line is at.
    lines : sequence of Line
    amplitude : float
        Of the motion.

    Examples
    --------
    >>> round(float(unlike(np.array([0.8, 0.0, 0.1]), 1, [Line(1.0, 0.7), Line(3.02, 0.15)], 1.0)), 6)
    0.1
    """
    left = shares.copy()
    worst = 0.0
    for line in lines:
        turn = line.ratio * harmonic
        k = max(1, round(turn))
        part = line.amplitude / amplitude
        if k <= len(left) and abs(np.log2(turn / k)) <= NEAR:
            worst = max(worst, abs(part - left[k - 1]))
            left[k - 1] = 0.0
        else:
            worst = max(worst, part)
    return max(worst, float(left.max()))
