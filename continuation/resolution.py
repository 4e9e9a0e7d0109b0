"""Sampling of a test function inside one step, fine enough that no pair of zeros can hide between two samples.

The functions are arithmetic on sequences or arrays. Kernels compile them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from continuation.bracketing import StepRefused
from continuation.control import NEAR_BRANCH_POINT, may_hide
from continuation.location import Locator
from continuation.problem import Step, TestFunction

__all__ = ["Resolution", "Sampled", "Zone", "longest_division", "nodes_around", "scan", "second_differences"]

_MOST = 256  # corrected points inside a step; a step that needs more is refused and halved
_CORES = 2.0  # samples approach a place where a test function is undefined to within this many times its width
_APART = 0.05  # least distance of a neighbouring sample, as a part of the interval: a second difference over less is rounding
_NEAR_END = 0.05  # least distance of a new sample from the ends of its interval, as a part of the interval
_SETTLED = 64  # intervals that need no division are remembered, at most, for each test function
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


class Sampled(NamedTuple):
    """The P samples of T test functions in one step, as sequences or as arrays."""

    places: Any  # (P,) in order
    rows: Any  # (P, T) the values of all test functions there
    zones: Any  # (Z, 2) ends of the zones
    hidden: Any  # (Z, T) 1 where a test function has no certain sign in a zone
    settled: Any  # (T, S, 4) intervals of each test function that need no division, each between the places next to it
    counts: Any  # (T,) int: how many of these there are
    kept: Any  # (P,) scratch: the places where one test function is to be trusted,
    values: Any  # (P,) its values there,
    gaps: Any  # (P,) and the other places
    chosen: Any  # (4,) int, scratch


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
    _samples: int = 0
    _places: Any = ()
    _rows: Any = ()  # the values of all test functions at each place
    _scratch: Any = ()

    def __post_init__(self) -> None:
        self._compiled: Callable[..., tuple[int, float, float, float]] | None = getattr(self.locator.problem, "scan", None)
        settled = np.empty((len(self.tests), _SETTLED, 4)), np.zeros(len(self.tests), dtype=np.int64)
        self._settled: Any = settled if self._compiled is not None else [part.tolist() for part in settled]

    def unsettled(self, tests: Sequence[int], limit: float) -> Iterator[int]:
        """Those of some test functions, in order, that can have a change of sign, seen when it is their turn."""
        place = 0
        while True:
            place, *_ = self._scan(tests, place, limit, False)
            if place == len(tests):
                return
            yield tests[place]
            place += 1

    def changes(self, index: int, limit: float, *, guard: bool = False) -> Sequence[tuple[float, float]]:
        """Neighbouring samples between which a test function changes sign, after dividing all intervals where it could do so twice.

        `limit`: the search covers steps of length 0 to this. `guard`: only intervals with two positive ends are divided, and only changes
        from positive to not positive are given.

        Raises
        ------
        StepRefused
            A sample cannot be taken, or too many are needed.
        """
        while True:
            _, low, high, part = self._scan([index], 0, limit, guard)
            if not high > low:
                break
            if len(self.locator.taken) > _MOST:
                raise StepRefused(f"the test functions need more than {_MOST} samples")
            for shift in _ELSEWHERE:
                try:
                    self.locator.step(low + min(max(part + shift, _NEAR_END), 1.0 - _NEAR_END) * (high - low))
                    break
                except StepRefused as refused:
                    cause = refused
            else:
                raise cause
        sure = [(s, value) for s, value in self.sure(index) if s <= limit]
        return [(low, high) for (low, a), (high, b) in pairwise(sure) if (a > 0.0) is not (b > 0.0) and (a > 0.0 or not guard)]

    def sure(self, index: int) -> list[tuple[float, float]]:
        """The samples of a test function, as (length of the step, value), where it is defined and no branch point is too near."""
        zones = [zone for zone in self.zones if zone.hides(self.tests[index])]
        samples = ((s, float(step.tests[index])) for s, step in self.locator.taken)
        return [(s, value) for s, value in samples if value == value and not any(zone.low < s < zone.high for zone in zones)]

    def _scan(self, tests: Sequence[int], begin: int, limit: float, guard: bool) -> tuple[int, float, float, float]:
        """See `scan`."""
        taken, history = self.locator.taken, self.locator.history
        if self._samples != len(taken):
            self._samples = len(taken)
            self._places = [s for s, _ in history] + [s for s, _ in taken]
            # Lists have floats already; items of arrays are slower.
            rows = [*(values for _, values in history), *(step.tests for _, step in taken)]
            self._rows = [row if type(row) is list else list(map(float, row)) for row in rows]
            size = len(self._places)
            self._scratch = [0.0] * size, [0.0] * size, [0.0] * size, [0] * 4
            if self._compiled is not None:
                self._places, self._rows = np.array(self._places), np.array(self._rows)
                self._scratch = *np.empty((3, size)), np.empty(4, dtype=np.int64)
        zones: Any = [(zone.low, zone.high) for zone in self.zones]
        hidden: Any = [[float(zone.hides(test)) for test in self.tests] for zone in self.zones]
        if self._compiled is not None:
            zones, hidden = np.array(zones).reshape(-1, 2), np.array(hidden).reshape(-1, len(self.tests))
        sampled = Sampled(self._places, self._rows, zones, hidden, *self._settled, *self._scratch)
        if self._compiled is not None:
            return self._compiled(sampled, tests, begin, limit, guard, self.floor)
        found: tuple[int, float, float, float] = scan(
            longest_division, may_hide, nodes_around, second_differences, sampled, tests, begin, limit, guard, self.floor
        )
        return found

    def absorbing(self, index: int, low: float, high: float, undecided: Step | None = None, factor: float = 0.0) -> Zone | None:
        """The zone of a branch point between two samples to which a change of sign between them may belong.

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
                return zone
        return None

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


def scan(divide: Any, hides: Any, nodes: Any, bend: Any, sampled: Any, tests: Any, begin: Any, limit: Any, guard: Any, floor: Any) -> Any:
    """The first of some test functions, from number `begin` on, that changes its sign or has an interval to be divided.

    Parameters
    ----------
    divide, hides, nodes, bend : functions
        `longest_division`, `continuation.control.may_hide`, `nodes_around` and `second_differences`.
    sampled : Sampled
        Settled intervals are added to it.
    tests : (K,) int
    limit, guard
        Of `Resolution.changes`.
    floor : float

    Returns
    -------
    int, float, float, float
        Its number among `tests`, or K; and the interval that is to be divided and where. Without one, its ends are in the wrong order.
    """
    places, rows, zones, hidden, _, _, kept, values, gaps, _ = sampled
    for k in range(begin, len(tests)):
        index = tests[k]
        count = 0
        between = 0
        changes = False
        for i in range(len(places)):
            s = places[i]
            if s > limit:
                break
            value = rows[i][index]
            sure = value == value
            for z in range(len(zones)):
                if hidden[z][index] > 0.0 and zones[z][0] < s < zones[z][1]:
                    sure = False
            if not sure:
                gaps[between] = s
                between += 1
                continue
            if count > 0 and kept[count - 1] >= 0.0 and (values[count - 1] > 0.0) != (value > 0.0):
                changes = changes or not guard or values[count - 1] > 0.0
            kept[count] = s
            values[count] = value
            count += 1
        low, high, part = divide(hides, nodes, bend, sampled, index, count, between, floor, guard)
        if changes or high > low:
            return k, low, high, part
    return len(tests), 0.0, -1.0, 0.5


def longest_division(hides: Any, nodes: Any, bend: Any, sampled: Any, index: Any, count: Any, between: Any, floor: Any, guard: Any) -> Any:
    """The longest interval of a test function that is to be divided, and where; its ends are in the wrong order where there is none.

    The longest comes first: near a pole, the estimate for an interval much longer than its neighbour is meaningless. It is known at
    `count` places, and not to be trusted at `between` others, which are the gaps. The other arguments are those of `scan`."""
    _, _, _, _, settled, counts, places, values, gaps, chosen = sampled
    longest = floor
    found_low = 0.0
    found_high = -1.0
    found_part = 0.5
    for j in range(count - 1):
        low = places[j]
        high = places[j + 1]
        length = high - low
        a = values[j]
        b = values[j + 1]
        if low < 0.0 or length <= longest or (guard and not a > 0.0):
            continue
        first = high
        last = low
        for i in range(between):
            if low < gaps[i] < high:
                first = min(first, gaps[i])
                last = max(last, gaps[i])
        if last > low:
            if first - low >= high - last:
                high = first
            else:
                low = last
            if high - low > max(longest, _CORES * max(last - first, floor)):
                longest = high - low
                found_low, found_high, found_part = low, high, 0.5
            continue
        if (a > 0.0) != (b > 0.0):
            continue
        before = places[j - 1] if j > 0 else -math.inf
        after = places[j + 2] if j + 2 < count else math.inf
        is_settled = False
        for i in range(counts[index]):
            interval = settled[index][i]
            if interval[1] == low and interval[2] == high and interval[0] == before and interval[3] == after:
                is_settled = True
        if is_settled:
            continue
        part = 0.5
        if nodes(places, count, j, chosen) == 4:
            bend_first, bend_last = bend(places, values, chosen)
            if not hides(a, b, length, bend_first, bend_last):
                if counts[index] < len(settled[index]):
                    interval = settled[index][counts[index]]
                    interval[0], interval[1], interval[2], interval[3] = before, low, high, after
                    counts[index] += 1
                continue
            sign = 1.0 if a > 0.0 else -1.0
            most = max(sign * bend_first, sign * bend_last) * length * length
            if most > 0.0:
                part = 0.5 - 0.5 * sign * (b - a) / most
            if not _NEAR_END < part < 1.0 - _NEAR_END:
                part = 0.5
        longest = length
        found_low, found_high, found_part = low, high, part
    return found_low, found_high, found_part


def nodes_around(places: Any, count: Any, j: Any, chosen: Any) -> Any:
    """The ends of interval j with its neighbours on both sides; at an end of the places, with two on one side. Returns their number.

    A neighbour closer than a part of the interval is passed over.
    """
    least = _APART * (places[j + 1] - places[j])
    first = j
    last = j + 1
    chosen[0] = j
    chosen[1] = j + 1
    size = 2
    for turn in range(4):  # one on each side; the second round only where a side has none
        if size == 4:
            break
        if turn % 2 == 0:
            i = first - 1
            while i >= 0 and places[first] - places[i] < least:
                i -= 1
            if i >= 0:
                for k in range(size, 0, -1):
                    chosen[k] = chosen[k - 1]
                chosen[0] = i
                first = i
                size += 1
        else:
            i = last + 1
            while i < count and places[i] - places[last] < least:
                i += 1
            if i < count:
                chosen[size] = i
                last = i
                size += 1
    return size


def second_differences(places: Any, values: Any, chosen: Any) -> Any:
    """The two second divided differences of the values at four nodes; 0 where a value is infinite."""
    p, q, r, s = places[chosen[0]], places[chosen[1]], places[chosen[2]], places[chosen[3]]
    middle = (values[chosen[2]] - values[chosen[1]]) / (r - q)
    first = (middle - (values[chosen[1]] - values[chosen[0]]) / (q - p)) / (r - p)
    last = ((values[chosen[3]] - values[chosen[2]]) / (s - r) - middle) / (s - q)
    return first if math.isfinite(first) else 0.0, last if math.isfinite(last) else 0.0
