"""Which family a ridge follows, and for how long: the least dear way to cut it into stretches of one family, or of none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from transitions.families import NEAR, Meeting
from transitions.ridges import HOLDS, SHARE, runs

__all__ = ["EQUAL_OCTAVES", "EQUAL_SHARE", "Match", "Stretch", "best_of", "lasting", "steady", "stretches"]

EQUAL_OCTAVES = 0.2 * NEAR
"""Mean deviations that differ by less than this are equal: a fifth of what a ridge may be off."""

EQUAL_SHARE = 0.1
"""Amplitudes that differ by less than this, in parts of the orbit's, are equal."""


class Match(NamedTuple):
    """What a motion and a family that its ridge is at have in common, at the places (j,) of the ridge.

    Parameters
    ----------
    meeting : Meeting
    unlike : (j,) float
        Largest difference of their lines, as part of the amplitude.
    miscount : (j,) float
        Impacts that the motion has more than the orbit, in three periods of the ridge, or as many as the orbit has whole ones of its own.
    """

    meeting: Meeting
    unlike: np.ndarray
    miscount: np.ndarray

    @property
    def cost(self) -> np.ndarray:
        """Squares of the deviation in units of what is allowed, and, 1 at most, of the difference of the lines in units of a fifth and of
        the impacts: (j,), infinite where the ridge is not at the family."""
        away = np.nan_to_num(self.meeting.deviation, nan=np.inf)
        return (away / NEAR) ** 2 + np.minimum(1.0, (self.unlike / SHARE) ** 2 + self.miscount**2)


@dataclass(frozen=True, eq=False)
class Stretch:
    """Places `first` to `last`, both included, of a ridge, that one family has, or none."""

    first: int
    last: int
    match: Match | None


def lasting(meeting: Meeting, turns: np.ndarray) -> bool:
    """Whether a ridge is at a family for three of its periods or more: `turns` (j,) are those since its first place."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], np.isfinite(meeting.deviation), [False]]).astype(int)))
    return any(turns[b - 1] - turns[a] >= HOLDS for a, b in zip(edges[::2], edges[1::2], strict=True))


def stretches(matches: Sequence[Match], turns: np.ndarray) -> list[Stretch]:
    """Cut a ridge into stretches.

    Parameters
    ----------
    matches : sequence of Match
        At the same places (j,) of the ridge.
    turns : (j,) float
        Periods of the ridge since its first place, rising.

    Returns
    -------
    list of Stretch
        In order, without gaps; one of a family lasts three periods or more. For each period, following a family costs what `Match.cost`
        says, 2 at most, and following none costs 2; taking up a family and leaving it cost half of three periods each. So a motion
        that changes to a family with other lines or impacts, though its ridge goes on, has to stay there for three periods to count. Of
        all ways to cut the ridge, the one that costs least in all is taken (Viterbi, IEEE Trans. Inf. Theory 13 (1967) 260).
    """
    count = len(turns)
    costs = np.stack([np.full(count, 2.0), *(match.cost for match in matches)], axis=1)  # state 0 follows none
    path = _cheapest(costs * np.gradient(turns)[:, None], 0.5 * HOLDS)
    out: list[Stretch] = []
    for first, stop in runs(path):
        lasts = turns[stop - 1] - turns[first]
        followed = matches[path[first] - 1] if path[first] and lasts >= HOLDS * (1.0 - 1e-9) else None
        if followed is None and out and out[-1].match is None:
            first = out.pop().first
        out.append(Stretch(first, stop - 1, followed))
    return out


def steady(shown: np.ndarray, turns: np.ndarray) -> list[tuple[int, int, tuple[int, ...]]]:
    """Cut places where the set of harmonics that are shown changes for three periods or more.

    Parameters
    ----------
    shown : (k, j) bool
        Whether a harmonic is shown at a place.
    turns : (j,) float
        Periods since the first place, rising.

    Returns
    -------
    list of (int, int, tuple of int)
        First and last place, and the indices of the harmonics. Each period in which one is taken for shown and is not, or the other way
        round, costs 1, and each change half of three periods.
    """
    length = np.gradient(turns)[:, None]
    kept = np.array([_cheapest(np.stack([row, ~row], axis=1) * length, 0.5 * HOLDS) > 0 for row in shown])
    changed = np.concatenate([[0], np.cumsum((kept[:, 1:] != kept[:, :-1]).any(axis=0))])
    out: list[tuple[int, int, tuple[int, ...]]] = []
    for first, stop in runs(changed):
        own = tuple(np.flatnonzero(kept[:, first]).tolist())
        if out and turns[out[-1][1]] - turns[out[-1][0]] < HOLDS:
            first = out.pop()[0]
        elif out and turns[stop - 1] - turns[first] < HOLDS:
            first, _, own = out.pop()
        out.append((first, stop - 1, own))
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


def best_of(stretch: Stretch, matches: Sequence[Match], impacts: float, turns: float) -> list[Meeting]:
    """The family that fits a stretch best, and the others that fit it as well.

    Parameters
    ----------
    stretch : Stretch
        With a match.
    matches : sequence of Match
        All that there are: those that fit all of the stretch are compared.
    impacts, turns : float
        In the stretch: impacts, and periods of the followed ridge.

    Returns
    -------
    list of Meeting
        Of each family one, the best first: that of least mean cost, and those that are equal to it in mean deviation, in the mean
        difference of the lines, and in the number of impacts to one. They stand in the order of their impacts in a period, then of the
        harmonic, then of the deviation: the first is the simplest, not the truest.
    """
    part = slice(stretch.first, stretch.last + 1)
    fit = [match for match in matches if np.isfinite(match.meeting.deviation[part]).all()]
    best = int(np.argmin([np.mean(match.cost[part]) for match in fit]))

    def equal(values: list[float], much: float) -> np.ndarray:
        return np.array(values) <= values[best] + much

    same = equal([float(np.mean(np.abs(match.meeting.deviation[part]))) for match in fit], EQUAL_OCTAVES)
    same &= equal([float(np.mean(match.unlike[part])) for match in fit], EQUAL_SHARE)
    same &= equal([abs(turns * match.meeting.family.impacts / match.meeting.harmonic - impacts) for match in fit], 1.0)
    kept = [fit[i].meeting for i in np.flatnonzero(same)]
    kept.sort(key=lambda item: (item.family.impacts, item.harmonic, float(np.mean(np.abs(item.deviation[part])))))
    return list({meeting.family.id: meeting for meeting in reversed(kept)}.values())[::-1]
