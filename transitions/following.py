"""The families that a ridge follows, and for how long. Dynamic programming cuts the ridge into intervals of one family or none.

A family fits by the frequency of the ridge, by the lines of the motion (the ridge and those beside it) and by the number of impacts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from transitions.families import NEAR, Meeting
from transitions.frequencies import LEAST_PERIODS, SHARE, Ridge, RidgeInterval, beside, runs

__all__ = [
    "EQUAL_OCTAVES", "EQUAL_SHARE", "Around", "FamilyInterval", "Lines", "Match", "best_of", "family_intervals", "lasting", "lines_of",
    "partner", "steady", "unlike",
]  # fmt: skip

EQUAL_OCTAVES = 0.2 * NEAR
"""Mean deviations that differ by less than this are equal."""

EQUAL_SHARE = 0.1
"""Amplitudes that differ by less than this, in shares of the orbit's, are equal."""


@dataclass(frozen=True, eq=False)
class Around:
    """Means over three periods around the columns `places` of a ridge, or over the part of them that the ridge has. `cycles` (m,) counts
    its periods from the first column to each column."""

    cycles: np.ndarray
    places: np.ndarray

    def window(self, length: float = LEAST_PERIODS) -> tuple[np.ndarray, np.ndarray]:
        """Cycles (j,) at which windows of `length` periods around the places begin and end, within the ridge."""
        at = self.cycles[self.places]
        return np.clip(at - 0.5 * length, 0.0, self.cycles[-1]), np.clip(at + 0.5 * length, 0.0, self.cycles[-1])

    @cached_property
    def _three(self) -> tuple[np.ndarray, np.ndarray]:
        return self.window()

    def reached(self, first: int, stop: int) -> slice:
        """The places whose means use the columns `first` to `stop` - 1."""
        low, high = self._three
        return slice(int(np.searchsorted(high, self.cycles[first], "right")), int(np.searchsorted(low, self.cycles[stop - 1], "left")))

    def mean(self, values: np.ndarray, first: int = 0, at: slice = slice(None)) -> np.ndarray:
        """Means, at some of the places, of values at the columns from `first` on and zero elsewhere."""
        cycles = self.cycles[first : first + len(values)]
        area = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(cycles))])
        low, high = (edge[at] for edge in self._three)
        return (np.interp(high, cycles, area) - np.interp(low, cycles, area)) / (high - low)


class Lines(NamedTuple):
    """Spectral lines of a motion along a ridge, which is the first line: frequencies relative to the ridge, and amplitudes, (s, j) each.

    They are means over three periods, and 0 if the line does not exist there.
    """

    ratios: np.ndarray
    amplitudes: np.ndarray


def lines_of(found: Sequence[Ridge], interval: RidgeInterval, around: Around) -> Lines:
    """The lines of a motion in an interval of the first line, from all ridges in the order in which they begin."""
    count = len(around.places)
    rows = [(np.ones(count), around.mean(interval.amplitudes))]
    free = [count]  # the place from which each row is free for another ridge
    for ridge in beside(found, interval):
        first, stop = max(interval.first, ridge.first), min(interval.last + 1, ridge.first + len(ridge))
        if stop - first < 2:
            continue
        here = slice(first - interval.first, stop - interval.first)
        at = around.reached(here.start, here.stop)
        if at.start >= at.stop:
            continue
        own = RidgeInterval(ridge, first, stop - 1)
        size = around.mean(own.amplitudes, here.start, at)
        pitch = around.mean(own.amplitudes * np.log(own.frequencies / interval.frequencies[here]), here.start, at)
        k = next((k for k, place in enumerate(free) if place <= at.start), len(rows))
        if k == len(rows):
            rows.append((np.zeros(count), np.zeros(count)))
            free.append(0)
        with np.errstate(divide="ignore", invalid="ignore"):
            rows[k][0][at] = np.where(size > 0.0, np.exp(pitch / size), 0.0)
        rows[k][1][at] = size
        free[k] = at.stop
    return Lines(np.array([row[0] for row in rows]), np.array([row[1] for row in rows]))


def _partners(ratios: np.ndarray, harmonic: int, most: int) -> tuple[np.ndarray, np.ndarray]:
    """The nearest harmonic to each line, and whether it is within 0.05 octave: both (s, j)."""
    order = ratios * harmonic
    k = np.clip(np.round(order), 1, most)
    with np.errstate(divide="ignore"):
        return k.astype(int), np.abs(np.log2(order / k)) <= NEAR


def unlike(shares: np.ndarray, harmonic: int, ratios: np.ndarray, parts: np.ndarray) -> np.ndarray:
    """Largest difference (j,) between the lines of a motion and the harmonics of an orbit, in shares of the amplitude.

    `shares` (j, k) are those of the orbit's amplitude that its harmonics 1 to k have. The first line is at `harmonic`. `ratios` and `parts`
    (s, j) are frequencies of the lines relative to the first one, and their shares of the motion's amplitude. A line or a harmonic without
    a partner counts with its full share.
    """
    left = shares.copy()
    rows = np.arange(len(left))
    worst = np.zeros(len(left))
    for k, near, part in zip(*_partners(ratios, harmonic, left.shape[1]), parts, strict=True):
        own = left[rows, k - 1]
        worst = np.maximum(worst, np.where(near, np.abs(part - own), part))
        left[rows, k - 1] = np.where(near, 0.0, own)
    return np.maximum(worst, left.max(axis=1))


def partner(count: int, harmonic: int, ratios: np.ndarray, parts: np.ndarray) -> np.ndarray:
    """Shares (count, j) of a motion's amplitude of its lines at the harmonics 1 to `count`, 0 for a harmonic without a line. The other
    arguments are those of `unlike`."""
    out = np.zeros((count, ratios.shape[1]))
    columns = np.arange(ratios.shape[1])
    for k, near, part in zip(*_partners(ratios, harmonic, count), parts, strict=True):
        out[k - 1, columns] = np.maximum(out[k - 1, columns], np.where(near, part, 0.0))
    return out


class Match(NamedTuple):
    """A comparison of a motion with a family, at the places (j,) of a ridge that is at a harmonic of the family.

    `unlike` (j,) is the largest difference of their lines, in shares of the amplitude. `miscount` (j,) is the number of impacts of the
    motion minus that of the orbit, in three periods of the ridge, rounded up to complete periods of the orbit.
    """

    meeting: Meeting
    unlike: np.ndarray
    miscount: np.ndarray

    @property
    def cost(self) -> np.ndarray:
        """Cost (j,) of following the family, infinite where the ridge is not at it.

        It is the square of the deviation over the largest allowed one, plus at most 1: the square of the difference of the lines over a
        fifth, and the square of the miscount."""
        away = np.nan_to_num(self.meeting.deviation, nan=np.inf)
        return (away / NEAR) ** 2 + np.minimum(1.0, (self.unlike / SHARE) ** 2 + self.miscount**2)


class FamilyInterval(NamedTuple):
    """Places `first` to `last` of a ridge, both included, at which it follows one family, or none (None)."""

    first: int
    last: int
    match: Match | None


def lasting(meeting: Meeting, cycles: np.ndarray) -> bool:
    """Whether a ridge is at a family for three of its periods or more; `cycles` (j,) as for `family_intervals`."""
    there = np.isfinite(meeting.deviation)
    return any(there[first] and cycles[stop - 1] - cycles[first] >= LEAST_PERIODS for first, stop in runs(there))


def family_intervals(matches: Sequence[Match], cycles: np.ndarray) -> list[FamilyInterval]:
    """Cut a ridge into intervals of one family, or of none, in order and without gaps. An interval of a family lasts three periods or more.

    The matches are at the same places (j,) of the ridge; `cycles` (j,) are its periods from the first place to each. In each period,
    following a family costs `Match.cost`, which is at most 2, and following none costs 2. Taking up a family and leaving it costs 3/2 each.
    So a change to a family with other lines or impacts counts if it lasts three periods, although the ridge goes on. Of all ways to cut the
    ridge the cheapest is taken (Viterbi, IEEE Trans. Inf. Theory 13 (1967) 260).
    """
    count = len(cycles)
    costs = np.stack([np.full(count, 2.0), *(match.cost for match in matches)], axis=1)  # state 0 follows none
    path = _cheapest(costs * np.gradient(cycles)[:, None], 0.5 * LEAST_PERIODS)
    out: list[FamilyInterval] = []
    for first, stop in runs(path):
        lasts = cycles[stop - 1] - cycles[first]
        followed = matches[path[first] - 1] if path[first] and lasts >= LEAST_PERIODS * (1.0 - 1e-9) else None
        if followed is None and out and out[-1].match is None:
            first = out.pop().first
        out.append(FamilyInterval(first, stop - 1, followed))
    return out


def steady(shown: np.ndarray, cycles: np.ndarray) -> list[tuple[int, int, tuple[int, ...]]]:
    """Cut the places of a ridge at each change of its harmonics that lasts three periods or more.

    `shown` (k, j) says whether a harmonic is shown at a place. `family_intervals` describes `cycles`. The result has first and last place,
    and the indices of the harmonics. A wrong harmonic costs 1 in each period, and each change costs 3/2.
    """
    length = np.gradient(cycles)[:, None]
    kept = np.array([_cheapest(np.stack([row, ~row], axis=1) * length, 0.5 * LEAST_PERIODS) > 0 for row in shown])
    changed = np.concatenate([[0], np.cumsum((kept[:, 1:] != kept[:, :-1]).any(axis=0))])
    out: list[tuple[int, int, tuple[int, ...]]] = []
    for first, stop in runs(changed):
        own = tuple(np.flatnonzero(kept[:, first]).tolist())
        if out and cycles[out[-1][1]] - cycles[out[-1][0]] < LEAST_PERIODS:
            first = out.pop()[0]
        elif out and cycles[stop - 1] - cycles[first] < LEAST_PERIODS:
            first, _, own = out.pop()
        out.append((first, stop - 1, own))
    return out


def _cheapest(costs: np.ndarray, switch: float) -> np.ndarray:
    """The states (j,) of least total cost. `costs` (j, states): of each state at each place. `switch`: of a change between state 0 and
    another state. A change between two other states costs both changes."""
    count, states = costs.shape
    total = costs[0].copy()
    before = np.zeros((count, states), dtype=np.int32)
    own = np.arange(states)
    change = np.where(own == 0, 0.0, switch)
    for j in range(1, count):
        source = int(np.argmin(total + change))  # the state to leave, by way of state 0
        moved = total[source] + change[source] + change
        stays = (total <= moved) & (own > 0)
        before[j] = np.where(stays, own, source)
        total = np.where(stays, total, moved) + costs[j]
    path = np.empty(count, dtype=int)
    path[-1] = int(np.argmin(total))
    for j in range(count - 1, 0, -1):
        path[j - 1] = before[j, path[j]]
    return path


def best_of(interval: FamilyInterval, matches: Sequence[Match], impacts: float, cycles: float) -> list[Meeting]:
    """The family that fits an interval with a match best, and the others that fit it as well: one meeting for each.

    Matches that fit at all places of the interval, with `impacts` impacts and `cycles` periods of the ridge, are compared. The first is
    that of least mean cost. Others equal it in mean deviation, in the mean difference of the lines, and in the number of impacts within
    one. They are sorted by impacts in a period, harmonic and deviation. So the first is the simplest, which need not be the closest.
    """
    part = slice(interval.first, interval.last + 1)
    fit = [match for match in matches if np.isfinite(match.meeting.deviation[part]).all()]
    best = int(np.argmin([np.mean(match.cost[part]) for match in fit]))

    def equal(values: list[float], much: float) -> np.ndarray:
        return np.array(values) <= values[best] + much

    same = equal([float(np.mean(np.abs(match.meeting.deviation[part]))) for match in fit], EQUAL_OCTAVES)
    same &= equal([float(np.mean(match.unlike[part])) for match in fit], EQUAL_SHARE)
    same &= equal([abs(cycles * match.meeting.family.impacts / match.meeting.harmonic - impacts) for match in fit], 1.0)
    kept = [fit[i].meeting for i in np.flatnonzero(same)]
    kept.sort(key=lambda item: (item.family.impacts, item.harmonic, float(np.mean(np.abs(item.deviation[part])))))
    return list({meeting.family.id: meeting for meeting in reversed(kept)}.values())[::-1]
