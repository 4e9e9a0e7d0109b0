"""Location of an event inside one step, by bracketing root finding (`continuation.bracketing`) and by bisection from the last accepted
point.

The unknown is the length s of a step from the accepted point, so every trial is a corrected point of the family and no error
is carried from trial to trial.
"""

from __future__ import annotations

import math
from bisect import bisect
from collections.abc import Callable, Iterator, Sequence
from itertools import chain, pairwise
from operator import itemgetter
from typing import Literal, NamedTuple

import numpy as np

from bvp.dense import length
from bvp.functions import cos
from continuation.between import ASIDE, cubic_between, goes_aside
from continuation.bracketing import RootBracket, StepRefused, bracketed_root
from continuation.control import Settings
from continuation.problem import Point, Problem, Status, Step

FoundKind = Literal["zero", "change", "pole", "jump", "outside", "interrupted"]

JUMP_RATIO = 0.01
"""A zero is found to the location tolerance, so a function with a larger part of its values at the bracket's ends left there jumps."""

STEEP = 4.0  # so many times steeper than on average a test function may be in the last bracket
_POLISHED = 1e-5  # a root is not improved that is as near as this part of its bracket to that of a straight line
_VALID = 1e-3  # a guard is positive at its zero by this part of its value at the valid end of the bracket
_CHANGES = 16  # of one key in a step; a longer list needs a shorter step
_AROUND = (-3.0, -2.0, -1.0, 1.0, 2.0, 3.0)  # samples around a branch point, in units of their distance
_NEARER = 0.6  # part of this distance that is tried next,
_CLOSER = 12  # so often at most
_ROUNDS = 20  # of Newton's method on an interpolant,
_SAME_PLACE = 1e-15  # until its change is smaller
_CLEARLY = 10.0  # two zeros are apart by more than this many errors of their distance

History = Sequence[tuple[float, Sequence[float]]]
"""Points before the step: the length of a step to each (a negative number, in order), and the test functions there."""


class Location(NamedTuple):
    """Where an event is, seen from the accepted point before it.

    Attributes
    ----------
    kind : str
        ``"zero"``; ``"change"`` of a key; ``"pole"``: the value grows without bound where its sign changes; ``"jump"``: it
        stays away from zero; ``"outside"``: a guard is violated at the accepted point already; ``"interrupted"``: the steps
        inside the bracket fail.
    status : str
        ``"located"`` for zero, change and outside, else ``"bracketed"``.
    s, step, residual : float, Step, float
        Length of the step to the event, the corrected point there, and |test function| there. It is 0 for a change, and where the problem
        gives nan for rounding.
    low, high, between : Step, Step, (float, float)
        The steps at the ends of the bracket, and their lengths.
    reason : str
        Why it was interrupted, else empty.
    margin : float
        How much wider the bracket is on either side, for a point that was not found by steps.
    """

    kind: FoundKind
    status: Status
    s: float
    step: Step
    residual: float
    low: Step
    high: Step
    reason: str = ""
    margin: float = 0.0
    between: tuple[float, float] = (0.0, 0.0)


class Locator:
    """Steps from one accepted point, and the events that they enclose.

    Parameters
    ----------
    problem : Problem
    before : Point
        The accepted point.
    ds : float
        Length of a step from it that is known,
    after : Step
        and this step.
    settings : Settings
    history : History

    Attributes
    ----------
    problem : Problem
    history : History
    taken : list of (float, Step)
        The steps known so far and their lengths, in order.
    ends : list of (float, float)
        Lengths of the steps around each zero of a guard that was located.
    """

    def __init__(self, problem: Problem, before: Point, ds: float, after: Step, settings: Settings, history: History = ()) -> None:
        self.history = history
        self.problem = problem
        self._settings = settings
        self._least_turn = float(cos(settings.maximum_turn))
        compiled = getattr(problem, "advance", None) is not None
        self._between: Callable[..., tuple[Step, bool]] | None = getattr(problem, "step_between", None) if compiled else None
        self._narrow: Callable[..., list[tuple[float, Step]]] | None = getattr(problem, "narrow", None) if compiled else None
        self._before = before.step
        start = before.step._replace(turn=1.0)  # the rotation up to it does not count here
        self._known: dict[float, Step] = {0.0: start, ds: after}
        self._slopes: dict[float, np.ndarray] = {}
        self.taken: list[tuple[float, Step]] = [(0.0, start), (ds, after)]
        self.ends: list[tuple[float, float]] = []

    def step(self, s: float) -> Step:
        """The step of length s from the accepted point.

        Between two known steps it is corrected from the cubic through these if the problem allows it: near a branch point a prediction from
        afar can be nearer to the other family.

        Raises
        ------
        StepRefused
            It does not converge, its tangent rotates too far, or it is on another family than the known steps on both sides: near a branch
            point two families are so near to each other that the corrector can go over. They differ in the direction of the unknowns, even
            where they do not in the metric.
        """
        known = self._known.get(s)
        if known is not None:
            return known
        before = self._before
        at = bisect(self.taken, s, key=itemgetter(0))
        aside = False
        if not 0 < at < len(self.taken):
            step = self.problem.step(before.y, before.tangent, s)
        elif self._between is not None:
            step, aside = self._between(before, s, *self.taken[at - 1 : at + 1], self._least_turn)
        else:
            step, aside = self._step_inside(s, *self.taken[at - 1 : at + 1])
        if not step.converged:
            raise StepRefused("a shorter step does not converge")
        if not step.turn >= self._least_turn:
            raise StepRefused(f"the tangent of a shorter step rotates too far (cosine {step.turn:.3g})")
        if aside:
            raise StepRefused("a shorter step goes over to another family")
        self._add(at, s, step)
        return step

    def _add(self, at: int, s: float, step: Step) -> None:
        self._known[s] = step
        self.taken.insert(at, (s, step))

    def _step_inside(self, s: float, low: tuple[float, Step], high: tuple[float, Step]) -> tuple[Step, bool]:
        """The step of length s between two others, and whether it is on another family."""
        before, near = self._before, getattr(self.problem, "step_near", None)
        slope, other = self._slope(*low), self._slope(*high)
        if near is None:
            step = self.problem.step(before.y, before.tangent, s)
        else:
            guess = np.empty_like(before.y)
            cubic_between(low[1].y, slope, high[1].y, other, low[0], high[0], s, guess)
            step = near(before.y, before.tangent, s, guess)
        if not step.converged:
            return step, False
        return step, goes_aside(slope, other, (s - low[0]) / (high[0] - low[0]), step.tangent[: step.y.size] / step.turn)

    def _slope(self, s: float, step: Step) -> np.ndarray:
        """Derivative of the unknowns at a known step by its length."""
        slope = self._slopes.get(s)
        if slope is None:
            slope = self._slopes[s] = step.tangent[: step.y.size] / step.turn
        return slope

    def between_families(self, low: float, high: float) -> bool:
        """Whether the unknowns change in another direction at one of two known steps than at the other: they are of two families."""
        slope, other = (self._slope(s, self._known[s]) for s in (low, high))
        change = other - slope
        return length(change) > ASIDE * (length(slope) + length(other))

    def value(self, index: int, s: float) -> float:
        """Value of a test function at the step of length s; `StepRefused` where it is not defined."""
        value = float(self.step(s).tests[index])
        if math.isnan(value):
            raise StepRefused("the test function is not defined inside the step")
        return value

    def _values(self, index: int) -> Iterator[tuple[float, float]]:
        """The known values of a test function, with their places, in order."""
        for s, tests in chain(self.history, ((s, step.tests) for s, step in self.taken)):
            if not math.isnan(value := float(tests[index])):
                yield s, value

    def crossing(self, index: int, low: float, high: float, tolerance: float, *, guard: bool = False, size: float = 0.0) -> Location:
        """The change of sign of a test function between steps of length low and high, in a bracket as wide as the tolerance.

        A value at the root above `size` that has not gone down with the bracket is a jump or a pole.
        Of a `guard` the point is the last with a value of 0 or more, to rounding: beyond it the family is not valid.

        Raises
        ------
        StepRefused
            The steps between fail, in a bracket wider than the coincidence tolerance: then the long step is not to be trusted. With a
            `size`, as at a branch point, the wide bracket is given.
        """
        value_low, value_high = self.value(index, low), self.value(index, high)
        scale = max(abs(value_low), abs(value_high))
        coincidence = self._settings.coincidence_tolerance
        bracket = low, value_low, high, value_high
        known = [(s, value) for s, value in self._values(index) if not low <= s <= high]
        if value_low and value_high:
            bracket, known = self._narrowed(index, bracket, known, tolerance)
        found = bracketed_root(lambda s: self.value(index, s), *bracket, tolerance, coincidence, known)
        if found.interrupted and not guard:
            line = self._polished(index, found)
            if line.root != found.root and math.isnan(float(self.step(line.root).tests[index])):
                # undefined for being rounding: a zero, and the bracket is its error bar
                found = self._bent(index, line)._replace(interrupted="")
        if found.interrupted and found.high - found.low > coincidence and not size:
            raise StepRefused(found.interrupted)
        if guard and found.value < 0.0:
            found = self._polished(index, found, _VALID)
            if found.value < 0.0:
                found = self._within(index, found)
        residual = abs(found.value)
        kind: FoundKind = "interrupted" if found.interrupted else "zero"
        if residual > max(size, JUMP_RATIO * scale, STEEP * (found.high - found.low) / (high - low) * scale):
            kind = "pole" if residual > scale else "jump"
        if kind == "zero":
            found = self._polished(index, found, _VALID if guard else 0.0)
            residual = abs(found.value)
        status: Status = "located" if kind == "zero" else "bracketed"
        ends = self.step(found.low), self.step(found.high)
        between = found.low, found.high
        if found.low == found.high:  # an exact zero: the signs are known only on both sides of it
            between = max(low, found.root - 0.5 * tolerance), min(high, found.root + 0.5 * tolerance)
            for s in between:
                self.step(s)
        if guard and kind == "zero":
            self.ends.append(between)
        return Location(kind, status, found.root, self.step(found.root), residual, *ends, found.interrupted, between=between)

    def _narrowed(
        self, index: int, bracket: tuple[float, float, float, float], known: list[tuple[float, float]], tolerance: float
    ) -> tuple[tuple[float, float, float, float], list[tuple[float, float]]]:
        """The bracket of a zero, as narrow as the problem itself makes it, and the values outside it."""
        low, value_low, high, value_high = bracket
        at = bisect(self.taken, low, key=itemgetter(0))
        if self._narrow is None or self.taken[at][0] != high:
            return bracket, known
        samples = sorted([*known, (low, value_low), (high, value_high)])
        for s, step in self._narrow(self._before, *self.taken[at - 1 : at + 1], index, tolerance, self._least_turn, samples):
            self._add(bisect(self.taken, s, key=itemgetter(0)), s, step)
            value = float(step.tests[index])
            if math.isnan(value):
                continue
            is_beyond = (value > 0.0) == (value_high > 0.0)
            known.append((high, value_high) if is_beyond else (low, value_low))
            low, value_low, high, value_high = (low, value_low, s, value) if is_beyond else (s, value, high, value_high)
        return (low, value_low, high, value_high), known

    def zero_beside(self, index: int, singular: int, middle: float) -> tuple[float, float] | None:
        """The zero of a test function that is rounding near a branch point, and its error; None where it is the branch point's own.

        Both test functions are interpolated from samples on both sides, far enough away to be certain. The zeros of the interpolants
        are compared. Fewer samples give the error, and so do samples at another distance.
        `middle`: where the branch point is. `singular`: its test function.
        """
        found: list[tuple[float, float, float]] = []
        near = self._settings.coincidence_tolerance
        distance = (self.taken[-1][0] - middle) / _AROUND[-2]
        for _ in range(_CLOSER):
            steps = [self.problem.step(self._before.y, self._before.tangent, middle + part * distance) for part in _AROUND]
            if all(step.converged for step in steps):
                own, other = ([float(step.tests[i]) for step in steps] for i in (index, singular))
                zeros = [interpolated_zero(_AROUND[k : 6 - k], values[k : 6 - k]) for values in (own, other) for k in (0, 1)]
                place, coarse, at, roughly = (distance * zero for zero in zeros)
                error = abs(place - coarse) + abs(at - roughly)
                if error == error:
                    found = sorted([*found, (error, place - at, middle + place)])[:2]
            if len(found) == 2:
                error = max(found[0][0], abs(found[0][1] - found[1][1]))
                if abs(found[0][1]) > max(_CLEARLY * error, near):
                    return found[0][2], error
                if _CLEARLY * error < near:
                    break
            distance *= _NEARER
        return None

    def is_at_an_end(self, location: Location) -> bool:
        """Whether an event is as near to the zero of a guard that was located as brackets are wide: the steps on either side of it then lie
        in rounding, where a pole looks like a zero."""
        near = self._settings.location_tolerance
        return any(first - near <= location.s <= last + near for first, last in self.ends)

    def _polished(self, index: int, found: RootBracket, valid: float = 0.0) -> RootBracket:
        """The root of the straight line through the ends of its bracket: over so short a piece a test function bends by less than rounding.

        A problem may give nan for a value that is rounding; between two values of different sign, so near to each other, that is a zero.
        `valid`: the function is to be positive there by this part of the value at that end."""
        a, b = self.value(index, found.low), self.value(index, found.high)
        if a == b:
            return found
        wanted = valid * max(a, b)
        s = found.low + (a - wanted) / (a - b) * (found.high - found.low)
        near = abs(s - found.root) < _POLISHED * (found.high - found.low) and (not valid or found.value > 0.0)
        if near or not found.low < s < found.high:
            return found
        try:
            value = float(self.step(s).tests[index])
        except StepRefused:
            return found
        if math.isnan(value):
            value = 0.0
        most = 2.0 * wanted if valid and found.value < 0.0 else abs(found.value)
        better = abs(value) < most and (not valid or value > 0.0)
        return found._replace(root=s, value=value) if better else found

    def _bent(self, index: int, found: RootBracket) -> RootBracket:
        """The root by inverse interpolation through the ends of a bracket inside which the function is undefined, and through values as far
        outside on both sides: such a bracket can be wide, and the function bends."""
        width = found.high - found.low
        try:
            steps = [found.low - width, found.low, found.high, found.high + width]
            values = [self.value(index, s) for s in steps]
        except StepRefused:
            return found
        if sorted(values) not in (values, values[::-1]) or len(set(values)) < len(values):
            return found
        root = sum(s * math.prod(b / (b - a) for b in values if b != a) for s, a in zip(steps, values, strict=True))
        return found._replace(root=root) if found.low < root < found.high else found

    def _within(self, index: int, found: RootBracket) -> RootBracket:
        """The root of a guard moved to the nearest step tried where its value is not negative, inside the same bracket."""
        valid = found.low if found.root == found.high else found.high
        away = 2 * math.ulp(found.root)
        while away < abs(valid - found.root):
            s = found.root + math.copysign(away, valid - found.root)
            try:
                value = self.value(index, s)
            except StepRefused:
                break
            if value >= 0.0:
                return found._replace(root=s, value=value)
            away *= 2
        return found._replace(root=valid, value=self.value(index, valid))

    def changes(self, index: int, limit: float) -> list[Location]:
        """The changes of a key inside a step, up to the length `limit`, each located by bisection.

        An event's point is the first with the new key, or the last with the old key where the family ends.
        """
        test = self.problem.tests[index]
        changes: list[Location] = []
        samples = [(s, key) for s, key in ((s, float(step.tests[index])) for s, step in self.taken if s <= limit) if key == key]
        for (low, key), (last, other) in pairwise(samples):
            while key != other:
                high, interrupted = last, ""
                while high - low > self._settings.location_tolerance:
                    middle = 0.5 * (low + high)
                    if not low < middle < high:
                        break
                    try:
                        same = self.value(index, middle) == key
                    except StepRefused as refused:
                        if high - low > self._settings.coincidence_tolerance:
                            raise
                        interrupted = str(refused)
                        break
                    low, high = (middle, high) if same else (low, middle)
                ends = self.step(low), self.step(high)
                if interrupted:
                    location = Location("interrupted", "bracketed", low, ends[0], 0.0, *ends, interrupted)
                else:
                    s = low if test.terminal else high
                    location = Location("change", "located", s, self.step(s), 0.0, *ends)
                low, key = high, self.value(index, high)
                if not self.is_at_an_end(location):
                    changes.append(location)
                if len(changes) > _CHANGES:
                    raise StepRefused(f"the key of {test.code} changes more than {_CHANGES} times")
        return changes


def interpolated_zero(places: Sequence[float], values: Sequence[float]) -> float:
    """The zero nearest to 0 of the polynomial through some samples, found by Newton's method from that of the straight line; nan where
    there is none between the samples."""
    if not np.isfinite(values).all():
        return math.nan
    polynomial = np.polynomial.Polynomial.fit(places, values, len(places) - 1)
    slope, place = polynomial.deriv(), 0.0
    for _ in range(_ROUNDS):
        steep = float(slope(place))
        change = -float(polynomial(place)) / steep if steep else math.nan
        place += change
        if not places[0] < place < places[-1]:
            return math.nan
        if abs(change) < _SAME_PLACE:
            break
    return place
