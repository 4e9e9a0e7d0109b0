"""Sampling of a test function inside one step, fine enough that no pair of zeros can hide between two samples."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import compress, pairwise
from typing import NamedTuple

from continuation.bracketing import StepRefused
from continuation.control import NEAR_BRANCH_POINT, may_hide
from continuation.location import Locator
from continuation.problem import Step, TestFunction

__all__ = ["Resolution", "Zone"]

_MOST = 256  # corrected points inside a step; a step that needs more is refused and halved
_CORES = 2.0  # samples approach a place where a test function is undefined to within this many times its width
_APART = 0.05  # least distance of a neighbouring sample, as a part of the interval: a second difference over less is rounding
_NEAR_END = 0.05  # least distance of a new sample from the ends of its interval, as a part of the interval
_ELSEWHERE = (0.0, 0.1, -0.1, 0.25, -0.25)  # where a sample is tried in turn, from its best place, if the corrector fails


class Zone(NamedTuple):
    """An interval around a branch point where the equations are nearly singular, so the signs of some test functions are uncertain.

    low, high: lengths of the steps to its ends, which are samples; infinite where it reaches beyond the step. test: that of the branch
    point. found: codes of the events met that are the branch point itself.
    """

    low: float
    high: float
    test: TestFunction
    found: list[str]

    def hides(self, test: TestFunction) -> bool:
        """Whether a test function has no certain sign here."""
        return test is self.test or test.code in self.test.absorbs


class _Interval(NamedTuple):
    """An interval between two neighbouring places: the number of the first, both, these with the places next to them as a number, the
    numbers of the four places of the second differences over it, and the distances of one, and of two of them. Without so many places it
    has no nodes."""

    first: int
    low: float
    high: float
    around: int
    nodes: list[int]
    apart: tuple[float, float, float]
    wide: tuple[float, float]


@dataclass(eq=False)
class Resolution:
    """The test functions of one step.

    A test function is known at a few places. Over an interval between two of them it is replaced by a parabola, whose bend is taken from
    the neighbouring samples on either side; the difference of the two bends is the error of the interpolant. If the parabola, moved
    towards zero by this error, reaches zero inside the interval, the interval is divided (see `continuation.control.may_hide`).
    New samples are taken through the `locator`, which has the steps inside. Intervals shorter than `floor` are not divided further.
    """

    tests: Sequence[TestFunction]
    locator: Locator
    floor: float
    zones: list[Zone] = field(default_factory=list)
    _around: dict[tuple[float, ...], int] = field(default_factory=dict)  # an interval with the places next to it -> its number
    _resolved: dict[int, set[int]] = field(default_factory=lambda: defaultdict(set))
    _places: list[float] = field(default_factory=list)
    _rows: list[list[float]] = field(default_factory=list)  # the values of all test functions at each of them
    _intervals: dict[tuple[float, ...], list[_Interval]] = field(default_factory=dict)  # by the places that they are between
    _found: dict[tuple[int, float, bool], tuple[Sequence[tuple[float, float]], int, int]] = field(default_factory=dict)

    def changes(self, index: int, limit: float, *, guard: bool = False) -> Sequence[tuple[float, float]]:
        """Neighbouring samples between which a test function changes sign, after dividing all intervals where it could do so twice.

        `limit`: the search covers steps of length 0 to this. `guard`: only intervals with two positive ends are divided, and only changes
        from positive to not positive are given.

        Raises
        ------
        StepRefused
            A sample cannot be taken, or too many are needed.
        """
        taken = self.locator.taken
        found, *of = self._found.get((index, limit, guard), ((), 0, 0))
        if of == [len(taken), len(self.zones)]:
            return found
        zones = [zone for zone in self.zones if zone.hides(self.tests[index])]
        while True:
            if len(self._places) != len(self.locator.history) + len(taken):  # a step was taken since
                self._places = [s for s, _ in self.locator.history] + [s for s, _ in taken]
                rows = [*(values for _, values in self.locator.history), *(step.tests for _, step in taken)]
                # Lists have floats already; items of arrays are slower.
                self._rows = [row if type(row) is list else list(map(float, row)) for row in rows]
                self._intervals.clear()
            # Where the test function is to be trusted, its values there, and where it is not.
            places, gaps = self._places[: bisect_right(self._places, limit)], list[float]()
            values = [row[index] for row in self._rows[: len(places)]]
            if zones or not math.isfinite(sum(values)):
                trusted = [v == v for v in values]
                for zone in zones:
                    trusted = [sure and not zone.low < s < zone.high for s, sure in zip(places, trusted, strict=True)]
                gaps = [s for s, sure in zip(places, trusted, strict=True) if not sure]
                values = list(compress(values, trusted))
                places = list(compress(places, trusted))
            intervals = self._intervals.get(tuple(places))
            if intervals is None:
                intervals = self._intervals[tuple(places)] = self._intervals_between(places)
            division = self._unresolved(intervals, values, gaps, guard, self._resolved[index])
            if division is None:
                break
            if len(taken) > _MOST:
                raise StepRefused(f"the test functions need more than {_MOST} samples")
            low, high, part = division
            for shift in _ELSEWHERE:
                try:
                    self.locator.step(low + min(max(part + shift, _NEAR_END), 1.0 - _NEAR_END) * (high - low))
                    break
                except StepRefused as refused:
                    cause = refused
            else:
                raise cause
        changes: list[tuple[float, float]] = []
        if values and min(values) <= 0.0 < max(values):
            for (low, a), (high, b) in pairwise(zip(places, values, strict=True)):
                if low >= 0.0 and (a > 0.0) is not (b > 0.0) and (a > 0.0 or not guard):
                    changes.append((low, high))
        self._found[index, limit, guard] = changes, len(taken), len(self.zones)
        return changes

    def absorbed(self, index: int, low: float, high: float, undecided: Step | None = None, factor: float = 0.0) -> bool:
        """Whether a change of sign between two samples belongs to a branch point between them, which then notes its code.

        undecided: a step where the value is not known. Then only a branch point counts at which it is rounding: there the test function of
        the branch point is below `factor` times its level `TestFunction.singular`."""
        test = self.tests[index]
        for zone in self.zones:
            if not zone.hides(test):
                continue
            if undecided is None:
                belongs = low <= zone.low and zone.high <= high
            else:
                belongs = abs(undecided.tests[self.tests.index(zone.test)]) < factor * zone.test.singular
            if belongs:
                if test is not zone.test and test.code not in zone.found:
                    zone.found.append(test.code)
                return True
        return False

    def exclude(self, index: int, test: TestFunction, low: float = 0.0, high: float = 0.0) -> None:
        """Make a zone around a branch point between the steps of length low and high, which its test function marked; by default at the
        start of the step, if a branch point is so near to it.

        Raises
        ------
        StepRefused
            The steps on its two sides are of two families.
        """
        samples = [(place, abs(float(step.tests[index]))) for place, step in self.locator.taken]
        level = min(test.singular, NEAR_BRANCH_POINT * max(value for _, value in samples))
        if high == 0.0 and (samples[0][1] >= level or any(zone.low < 0.0 < zone.high for zone in self.zones)):
            return
        first = self._zone_end(index, [pair for pair in reversed(samples) if pair[0] <= low], level, high, -math.inf)
        last = self._zone_end(index, [pair for pair in samples if pair[0] >= high], level, low, math.inf)
        if level == test.singular and math.isfinite(last - first) and self.locator.between_families(first, last):
            raise StepRefused("a step goes over to another family")
        self.zones.append(Zone(first, last, test, []))

    def _zone_end(self, index: int, samples: list[tuple[float, float]], level: float, last: float, beyond: float) -> float:
        """The step at which a test function for branch points reaches a level, from samples in order away from the branch point, which is
        near the step `last`; else `beyond`."""
        for place, value in samples:
            if value < level:
                last = place
                continue
            nearer = last + (place - last) * level / value
            if value > 2.0 * level and abs(place - nearer) > self.floor:
                try:
                    if abs(float(self.locator.step(nearer).tests[index])) >= 0.5 * level:
                        return nearer
                except StepRefused:
                    pass
            return place
        return beyond

    def _intervals_between(self, places: list[float]) -> list[_Interval]:
        """The intervals of a step between places in order, the longest first, without those up to the length `floor`."""
        found = []
        for j in range(bisect_left(places, 0.0), len(places) - 1):
            if places[j + 1] - places[j] > self.floor:
                around = self._around.setdefault(tuple(places[max(j - 1, 0) : j + 3]), len(self._around))
                nodes, apart, wide = _nodes(places, j), (0.0, 0.0, 0.0), (0.0, 0.0)
                if len(nodes) == 4:
                    p, q, r, s = [places[i] for i in nodes]
                    apart, wide = (q - p, r - q, s - r), (r - p, s - q)
                found.append(_Interval(j, places[j], places[j + 1], around, nodes if len(nodes) == 4 else [], apart, wide))
        return sorted(found, key=lambda interval: interval.low - interval.high)

    def _unresolved(
        self, intervals: list[_Interval], values: Sequence[float], gaps: list[float], guard: bool, resolved: set[int]
    ) -> tuple[float, float, float] | None:
        """The longest interval that is to be divided, and where.

        The longest comes first: near a pole, the estimate for an interval much longer than its neighbour is meaningless. resolved: the
        intervals that need no division, each with the places next to it; the function adds those that it finds."""
        longest, division = self.floor, None
        for j, low, high, around, nodes, apart, wide in intervals:
            a, b, length = values[j], values[j + 1], high - low
            if length <= longest:
                break
            if guard and not a > 0.0:
                continue
            inside = [gap for gap in gaps if low < gap < high] if gaps else gaps
            if inside:
                low, high = max((low, inside[0]), (inside[-1], high), key=lambda side: side[1] - side[0])
                if high - low > max(longest, _CORES * max(inside[-1] - inside[0], self.floor)):
                    longest, division = high - low, (low, high, 0.5)
                continue
            if (a > 0.0) is not (b > 0.0) or around in resolved:
                continue
            if not nodes:
                longest, division = length, (low, high, 0.5)
                continue
            first, last = _bends([values[i] for i in nodes], apart, wide)
            if may_hide(a, b, length, first, last):
                sign = 1.0 if a > 0.0 else -1.0
                bend = max(sign * first, sign * last) * length * length
                part = 0.5 - 0.5 * sign * (b - a) / bend if bend > 0.0 else 0.5
                longest, division = length, (low, high, part if _NEAR_END < part < 1.0 - _NEAR_END else 0.5)
            else:
                resolved.add(around)
        return division


def _nodes(places: list[float], j: int) -> list[int]:
    """The ends of interval j with its neighbours on both sides; at an end of the places, with two on one side.

    A neighbour closer than a part of the interval is passed over.
    """
    least = _APART * (places[j + 1] - places[j])
    first, last = j, j + 1
    if 0 < j < len(places) - 2 and places[j] - places[j - 1] >= least and places[j + 2] - places[last] >= least:
        return [j - 1, j, j + 1, j + 2]  # as nearly always
    nodes = [first, last]
    for backward in (True, False, True, False):  # one on each side; the second round only where a side has none
        if len(nodes) == 4:
            break
        if backward:
            i = first - 1
            while i >= 0 and places[first] - places[i] < least:
                i -= 1
            if i >= 0:
                nodes.insert(0, i)
                first = i
        else:
            i = last + 1
            while i < len(places) and places[i] - places[last] < least:
                i += 1
            if i < len(places):
                nodes.append(i)
                last = i
    return nodes


def _bends(values: Sequence[float], apart: Sequence[float], wide: Sequence[float]) -> tuple[float, float]:
    """The two second divided differences of the values at four nodes, with the distances of one, and of two of these; 0 where a value is
    infinite."""
    p, q, r, s = values
    middle = (r - q) / apart[1]
    first = (middle - (q - p) / apart[0]) / wide[0]
    last = ((s - r) / apart[2] - middle) / wide[1]
    return first if math.isfinite(first) else 0.0, last if math.isfinite(last) else 0.0
