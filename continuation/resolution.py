"""Test functions inside one step: sampled until no pair of zeros can hide between neighbouring samples."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

from continuation.control import may_hide
from continuation.location import Locator, StepRefused
from continuation.problem import Test
from continuation.settings import Settings

__all__ = ["History", "Resolution", "Zone"]

History = Sequence[tuple[float, Sequence[float]]]
"""Points before the step: minus the arclength back to each (a negative number, in order), and the test functions there."""

PART = 0.1
"""Part of its size nearby that the test function for a branch point has in the zone around it, at most."""

_MOST = 256
"""Most corrected points inside a step. A step that needs more is refused and halved."""

_FLOOR = 10.0
"""Intervals shorter than this many location tolerances are not divided further."""

_CORES = 2.0
"""A test function that is undefined in an interval is sampled towards that gap until this many times its width is left on either side."""

_APART = 0.05
"""Least distance of a neighbouring sample, as a part of the interval: a second difference over less is rounding."""

_NEAR_END = 0.05
"""Least distance of a new sample from the ends of its interval, as a part of the interval."""

_ELSEWHERE = (0.0, 0.1, -0.1, 0.25, -0.25)
"""Where a sample is tried in turn, from its best place, as parts of the interval, if the corrector fails."""


class _Sample(NamedTuple):
    """Place (length of the step from the accepted point; negative before it) and value of one test function."""

    s: float
    value: float


class Zone(NamedTuple):
    """Where the equations are so nearly singular that test functions which vanish at the branch point have no certain sign.

    low, high: lengths of the steps to its ends, which are samples; infinite where it reaches beyond the step. test: that of the branch
    point. found: codes of the events met that are the branch point itself.
    """

    low: float
    high: float
    test: Test
    found: list[str]

    def hides(self, test: Test) -> bool:
        """Whether a test function has no certain sign here."""
        return test is self.test or test.code in self.test.absorbs


class Resolution:
    """The test functions of one step.

    A test function is known at a few places. Over an interval between two of them it is replaced by a parabola, whose bend is taken from
    the neighbouring samples on either side; the difference of the two bends is the error of the interpolant. If the parabola, moved
    towards zero by this error, reaches zero inside the interval, the interval is divided (see `continuation.control.may_hide`).

    Parameters
    ----------
    tests : sequence of Test
    locator : Locator
        The steps inside; new samples are taken through it.
    history : sequence of (float, sequence of float)
        See `History`.
    settings : Settings
        `location_tolerance` is used.
    """

    def __init__(self, tests: Sequence[Test], locator: Locator, history: History, settings: Settings) -> None:
        self._tests = tests
        self._locator = locator
        self._history = history
        self._floor = _FLOOR * settings.location_tolerance
        self.zones: list[Zone] = []

    def changes(self, index: int, limit: float, *, guard: bool = False) -> list[tuple[float, float]]:
        """Neighbouring samples between which a test function changes sign, after dividing all intervals where it could do so twice.

        Parameters
        ----------
        index : int
            Which test function.
        limit : float
            The search covers steps of length 0 to this.
        guard : bool
            Whether only intervals with two positive ends are divided, and only changes from positive to not positive are given.

        Raises
        ------
        StepRefused
            A sample cannot be taken, or too many are needed.
        """
        while True:
            samples, gaps = self._samples(index, limit)
            place = self._unresolved(samples, gaps, guard)
            if place is None:
                break
            self._take(*place)
        inside = [sample for sample in samples if sample.s >= 0.0]
        return [(a.s, b.s) for a, b in pairwise(inside) if (a.value > 0.0) is not (b.value > 0.0) and (a.value > 0.0 or not guard)]

    def absorbed(self, test: Test, low: float, high: float) -> bool:
        """Whether a change of sign between two samples belongs to a branch point between them, which then notes its code."""
        for zone in self.zones:
            if low <= zone.low and zone.high <= high and zone.hides(test):
                if test is not zone.test and test.code not in zone.found:
                    zone.found.append(test.code)
                return True
        return False

    def exclude(self, index: int, test: Test, low: float, high: float) -> None:
        """Make a zone around a branch point between the steps of length low and high, which its test function marked.

        Raises
        ------
        StepRefused
            The steps on its two sides are of two families.
        """
        samples = [(place, abs(float(step.tests[index]))) for place, step in self._locator.taken()]
        level = min(test.singular, PART * max(value for _, value in samples))
        before = [pair for pair in reversed(samples) if pair[0] <= low]
        after = [pair for pair in samples if pair[0] >= high]
        first, last = self._zone_end(index, before, level, high), self._zone_end(index, after, level, low)
        if level == test.singular and first is not None and last is not None and self._locator.bends(first, last):
            raise StepRefused("a step goes over to another family")
        self.zones.append(Zone(-math.inf if first is None else first, math.inf if last is None else last, test, []))

    def exclude_start(self, index: int, test: Test) -> None:
        """Make a zone at the start of the step if a branch point is so near to it."""
        samples = [(place, abs(float(step.tests[index]))) for place, step in self._locator.taken()]
        level = min(test.singular, PART * max(value for _, value in samples))
        if samples[0][1] < level and not any(zone.low < 0.0 < zone.high for zone in self.zones):
            end = self._zone_end(index, samples, level, 0.0)
            self.zones.append(Zone(-math.inf, math.inf if end is None else end, test, []))

    def _zone_end(self, index: int, samples: list[tuple[float, float]], level: float, inside: float) -> float | None:
        """The step at which a test function for branch points reaches a level, from samples in order away from the branch point."""
        last = inside
        for place, value in samples:
            if value < level:
                last = place
                continue
            nearer = last + (place - last) * level / value
            if value > 2.0 * level and abs(place - nearer) > self._floor:
                try:
                    if abs(float(self._locator.step(nearer).tests[index])) >= 0.5 * level:
                        return nearer
                except StepRefused:
                    pass
            return place
        return None

    def _samples(self, index: int, limit: float) -> tuple[list[_Sample], list[float]]:
        """The samples where a test function is to be trusted, and the places in order where it is not."""
        known = [_Sample(s, float(values[index])) for s, values in self._history]
        known += [_Sample(s, float(step.tests[index])) for s, step in self._locator.taken() if s <= limit]
        zones = [zone for zone in self.zones if zone.hides(self._tests[index])]
        if not zones:
            defined = [sample for sample in known if sample.value == sample.value]
            return defined, [sample.s for sample in known if sample.value != sample.value] if len(defined) < len(known) else []

        def is_certain(sample: _Sample) -> bool:
            return sample.value == sample.value and not any(zone.low < sample.s < zone.high for zone in zones)

        defined = [sample for sample in known if is_certain(sample)]
        gaps = [sample.s for sample in known if not is_certain(sample)]
        return defined, gaps

    def _unresolved(self, samples: list[_Sample], gaps: list[float], guard: bool) -> tuple[float, float, float] | None:
        """The first interval that is to be divided, and where."""
        for j, (a, b) in enumerate(pairwise(samples)):
            length = b.s - a.s
            if a.s < 0.0 or length <= self._floor or (guard and not a.value > 0.0):
                continue
            inside = [gap for gap in gaps if a.s < gap < b.s]
            if inside:
                core = max(inside[-1] - inside[0], self._floor)
                for low, high in ((a.s, inside[0]), (inside[-1], b.s)):
                    if high - low > _CORES * core:
                        return low, high, 0.5
                continue
            if (a.value > 0.0) is not (b.value > 0.0):
                continue
            bends = self._bends(samples, j)
            if len(bends) < 2:
                return a.s, b.s, 0.5
            if may_hide(a.value, b.value, length, *bends):
                sign = 1.0 if a.value > 0.0 else -1.0
                bend = max(bends, key=lambda bend: sign * bend) * length * length
                part = 0.5 - 0.5 * (b.value - a.value) / bend if sign * bend > 0.0 else 0.5
                return a.s, b.s, min(max(part, _NEAR_END), 1.0 - _NEAR_END)
        return None

    def _bends(self, samples: list[_Sample], j: int) -> list[float]:
        """Second divided differences of interval j with its neighbours on both sides; at an end of the samples, with two on one side."""
        a, b = samples[j], samples[j + 1]
        least = _APART * (b.s - a.s)
        left = _spaced(samples[j::-1], least)
        right = _spaced(samples[j + 1 :], least)
        bends = [_bend(far, a, b) for far in left[1:2]] + [_bend(a, b, far) for far in right[1:2]]
        if len(bends) == 1:
            bends += [_bend(*left[2::-1])] if len(left) > 2 else [_bend(*right[:3])] if len(right) > 2 else []
        return bends

    def _take(self, low: float, high: float, part: float) -> None:
        if len(self._locator) > _MOST:
            raise StepRefused(f"the test functions need more than {_MOST} samples")
        for shift in _ELSEWHERE:
            place = low + min(max(part + shift, _NEAR_END), 1.0 - _NEAR_END) * (high - low)
            try:
                self._locator.step(place)
                return
            except StepRefused as refused:
                cause = refused
        raise cause


def _spaced(samples: Sequence[_Sample], least: float) -> list[_Sample]:
    """The first samples, each at least so far from the one before."""
    chosen = list(samples[:1])
    for sample in samples:
        if abs(sample.s - chosen[-1].s) >= least:
            chosen.append(sample)
            if len(chosen) == 3:
                break
    return chosen


def _bend(a: _Sample, b: _Sample, c: _Sample) -> float:
    """Second divided difference."""
    if not (math.isfinite(a.value) and math.isfinite(b.value) and math.isfinite(c.value)):
        return 0.0
    return ((c.value - b.value) / (c.s - b.s) - (b.value - a.value) / (b.s - a.s)) / (c.s - a.s)
