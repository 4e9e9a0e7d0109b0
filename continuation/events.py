"""The events of one step: which test functions change sign, where, and which zeros belong to the same event."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from bvp.dense import inner
from continuation.bracketing import StepRefused
from continuation.control import NEAR_BRANCH_POINT, Settings, arclength_of, distance, kinds_of
from continuation.location import JUMP_RATIO, STEEP, History, Location, Locator
from continuation.problem import Event, EventDetails, Point, Problem, Step, TestFunction
from continuation.resolution import Resolution, Zone

_ROUNDING = 1e-12  # part of its largest value in a step up to which a test function is rounding
_LEFT = 10.0  # a test for branch points may have so many times its `singular` value left where the corrector gets no nearer
_BETWEEN = (0.5, 0.25, 0.75, 0.1, 0.9)  # where a point between two events is tried, as parts of the distance
_FLOOR = 10.0  # an interval inside a step that is shorter than this many location tolerances is not divided further
_BESIDE = 3  # so many points on either side of a zero show the noise of its test function
_SURE = 8.0  # so many times the noise that is seen there a value is at least where it is not noise


def arclength_between(start: Any, step: Step) -> float:
    """Arclength from the position that a step was taken from to the corrected point (see `continuation.control.arclength_of`)."""
    length: float = arclength_of(distance(start, step.position), step.turn)
    return length


@dataclass(frozen=True, slots=True, eq=False)
class FoundEvent:
    """An event found in a step.

    index: of its test function. location, details: where it is, and the problem's classification. absorbed: codes of other events at
    the same point. between: a point between it and the previous event of the same step, as (length of the step, step).
    """

    index: int
    location: Location
    details: EventDetails
    absorbed: tuple[str, ...] = ()
    between: tuple[float, Step] | None = None


class EventFinder:
    """Finds the events of each step of a run.

    Each test function is sampled inside the step until no pair of its zeros can hide (see `continuation.resolution`). The points taken to
    locate one event are samples of all test functions: their signs are compared again. The events do not depend on how the
    family is divided into steps.
    """

    def __init__(self, problem: Problem, settings: Settings) -> None:
        self._problem = problem
        self._settings = settings
        self._tests: tuple[TestFunction, ...] = tuple(problem.tests)
        self.kinds = kinds_of(self._tests)
        self.singular = [test.singular for test in self._tests]
        self.unlocated: dict[str, str] = {}
        """Words for the events whose place was not found, by the label of their test function."""
        self.undefined = [math.nan] * len(self._tests)
        """Test functions of the point before the first: not known."""
        self._shares_fold: Callable[[np.ndarray], bool] = getattr(problem, "shares_fold", lambda y: False)
        self._refine: Callable[[int, Step], Step | None] | None = getattr(problem, "refined", None)
        fine, coarse = settings.location_tolerance, settings.coincidence_tolerance
        self._tolerances = [(coarse, fine) if test.singular and self._refine else (fine,) for test in self._tests]
        absorbed = {code for test in self._tests if test.singular for code in test.absorbs}
        folds = [(i, j) for j in range(len(self._tests)) for i, test in enumerate(self._tests) if test.code in self._tests[j].absorbs]
        self._shared = {i: j for pair in folds[:1] for i, j in (pair, pair[::-1])}  # the fold and the branch point, of each the other one
        self._at_branch_points = [bool(test.singular) or test.code in absorbed for test in self._tests]

    def find(self, history: History, before: Point, after: Point, ds: float) -> list[FoundEvent]:
        """The events of a step from `before` to `after` of length ds, in order, as the problem classifies them.

        `history`: minus the arclength back to each of the earlier points, in order, and the test functions there.

        Raises
        ------
        StepRefused
            The family is not followed inside the step: the step is not to be accepted.
        """
        # The length s of a step and the arclength a to its point differ in the second order: s = a + c a^2.
        length = after.arclength - before.arclength
        bend = (ds - length) / length**2
        earlier = [(a + bend * a * a, tests) for a, tests in history]
        locator = Locator(self._problem, before, ds, after.step, self._settings, earlier)
        resolution = Resolution(self._tests, locator, _FLOOR * self._settings.location_tolerance)
        # The smooth ones first. Where several coincide (at a grazing an impact's speed has a plain zero, a clearance jumps and the
        # multipliers have a pole), the steps taken for one bracket the others.
        order: dict[str, list[int]] = {"guard": [], "crossing": [], "change": []}
        efforts = []
        for index, (a, b) in enumerate(zip(before.step.tests, after.step.tests, strict=True)):
            small, large = sorted((abs(float(a)), abs(float(b))))
            kind = self._tests[index].kind
            effort = -small / large if large > 0.0 else 0.0
            # Of guards that fall to zero together, as a grazing at the end of the range, the last one counts: rounding does not decide.
            rank = (round(effort, 6), -index) if kind == "guard" else (effort, index)
            efforts.append((kind == "change", kind != "guard", *rank, index))
        for *_, index in sorted(efforts):
            order[self._tests[index].kind].append(index)
        located, limit = self._guards(order["guard"], locator, resolution, ds)
        singular = [i for i in order["crossing"] if self._tests[i].singular]
        located += self._zeros(singular, locator, resolution, limit, before, ds)
        for index in singular:
            resolution.exclude(index, self._tests[index])
        located += self._zeros([i for i in order["crossing"] if i not in singular], locator, resolution, limit, before, ds)
        for index in order["change"]:
            located += [(index, change) for change in locator.changes(index, limit)]

        # By arclength: near a branch point the corrector can take a shorter step to a point that is further along.
        position = before.step.position
        located.sort(key=lambda pair: (arclength_between(position, pair[1].step), pair[1].s, pair[0]))
        classified = self._classified(located, before, after)
        near = self._settings.coincidence_tolerance
        for zone in resolution.zones:
            for i, event in enumerate(classified):
                if zone.found and self._tests[event.index] is zone.test and zone.low - near <= event.location.s <= zone.high + near:
                    classified[i] = replace(event, absorbed=(*event.absorbed, *zone.found))
        classified = self._with_shared_folds(classified, before, after)

        # A point between each two events: a record of the branch needs the stability between them, which only points have.
        parted = classified[:1]
        for first, last in pairwise(classified):
            low, high = first.location.s, last.location.s
            if high - low > near:
                for part in _BETWEEN:
                    s = low + part * (high - low)
                    try:
                        last = replace(last, between=(s, locator.step(s)))
                        break
                    except StepRefused:
                        continue
            parted.append(last)
        return parted

    def distance_to_branch_point(self, older: Sequence[float], old: Sequence[float], before: float) -> float:
        """Arclength from the last point to where a branch point may be; inf if none is ahead: the line through the last two values of a
        test function that marks branch points, or is zero at them, is zero there."""
        ahead = math.inf
        for a, b, is_zero in zip(older, old, self._at_branch_points, strict=True):
            if is_zero and a == a and b == b and (b > 0.0) is (a > b) and a != b and b != 0.0:
                ahead = min(ahead, before * b / (a - b))
        return ahead

    def passed(self, before: Point) -> tuple[FoundEvent, Step] | None:
        """The branch point just ahead and the point behind it. None if the problem cannot compute them, or if there is another event
        between."""
        beyond = getattr(self._problem, "beyond", None)
        pair = None if beyond is None else beyond(before.step)
        if pair is None:
            return None
        at, after = pair
        codes = []
        for test, is_zero, *values in zip(self._tests, self._at_branch_points, before.step.tests, at.tests, after.tests, strict=True):
            known = [value for value in values if value == value]
            same = len(set(known)) < 2 if test.kind == "change" else all((value > 0.0) is (known[0] > 0.0) for value in known)
            if not is_zero and not same:
                return None
            if is_zero and not test.singular and not same:
                codes.append(test.code)
        index = next(index for index, level in enumerate(self.singular) if level)
        s = arclength_between(before.step.position, at)
        margin = self._settings.location_tolerance
        location = Location("zero", "located", s, at, abs(float(at.tests[index])), at, at, margin=margin, between=(s, s))
        found = self._classified([(index, location)], before, Point(before.index + 1, before.arclength + 2.0 * s, after, 2.0 * s))
        return (replace(found[0], absorbed=(*found[0].absorbed, *codes)), after) if found else None

    def _zeros(
        self, tests: list[int], locator: Locator, resolution: Resolution, limit: float, before: Point, ds: float
    ) -> list[tuple[int, Location]]:
        """The zeros of some test functions where they change sign, and where they touch zero if that is an event of theirs.

        The points taken to locate one can show two of another. Signs are compared until none is new."""
        located: list[tuple[int, Location]] = []
        crossed: list[tuple[int, Location]] = []
        done: dict[int, list[tuple[float, float]]] = {i: [] for i in tests}
        decided: set[tuple[int, float, float]] = set()

        def belongs(index: int, low: float, high: float, *undecided: Any) -> bool:
            """Whether a change of sign is that at a branch point, or beside it, and thereby dealt with."""
            zone = resolution.absorbing(index, low, high, *undecided)
            if zone is None:
                return False
            if (index, zone.low, zone.high) not in decided:
                decided.add((index, zone.low, zone.high))
                beside = None if index == self._tests.index(zone.test) else self._beside(index, zone, locator)
                if beside is not None:
                    crossed.append((index, beside))
                elif self._tests[index] is not zone.test and self._tests[index].code not in zone.found:
                    zone.found.append(self._tests[index].code)
            return True

        searching = True
        while searching:
            searching = False
            for index in resolution.unsettled(tests, limit):
                test = self._tests[index]
                for low, high in resolution.changes(index, limit):
                    if any(first <= low and high <= last for first, last in done[index]) or belongs(index, low, high):
                        continue
                    searching = True
                    # What the problem's own equations locate needs no bracket as narrow as the location.
                    for tolerance in self._tolerances[index]:
                        given = locator.crossing(index, low, high, tolerance, size=_LEFT * test.singular)
                        found = self._refined(index, given, before, ds)
                        if found is not given:
                            break
                    done[index].append(found.between)
                    if locator.is_at_an_end(found):
                        continue
                    if math.isnan(found.step.tests[index]) and belongs(index, low, high, found.step, _LEFT):
                        continue
                    if found.kind == "interrupted" and found.between[1] - found.between[0] > self._settings.coincidence_tolerance:
                        raise StepRefused(found.reason)
                    located.append((index, found))
                    if test.singular:
                        resolution.exclude(index, test, *done[index][-1])
                        break
        # Neighbouring zeros between which a test function is rounding are one, and a touch if the sign around them is the same.
        # A function that is zero at branch points has large rounding beside them. Its zero is part of the branch point if that lies between
        # the nearest certain signs.
        for index in tests:
            apart: list[Location] = []
            zeros = (found for i, found in located if i == index)
            for found in sorted(zeros, key=lambda found: found.s):
                if apart and found.s - apart[-1].s <= self._settings.coincidence_tolerance:
                    both, noise = self._around(index, apart[-1], found, resolution)
                    between = (step for s, step in locator.taken if apart[-1].s < s < found.s)
                    if not any(abs(float(step.tests[index])) > noise for step in between):
                        apart[-1] = both
                        continue
                apart.append(found)
            for found in apart:
                if self._at_branch_points[index] and not self.singular[index]:
                    found, _ = self._around(index, found, found, resolution)
                    if belongs(index, *found.between):
                        continue
                low, high = found.between
                if (locator.value(index, low) > 0.0) is not (locator.value(index, high) > 0.0):
                    crossed.append((index, found))
            if self._tests[index].touches:
                touches = _touches(index, [at for at in resolution.sure(index) if at[0] <= limit], locator)
                near = self._settings.coincidence_tolerance  # beside a crossing rounding can look like a touch
                known = [found.s for i, found in crossed if i == index]
                crossed += [(index, touch) for touch in touches if all(abs(touch.s - s) > near for s in known)]
        return crossed

    def _beside(self, index: int, zone: Zone, locator: Locator) -> Location | None:
        """The zero of a test function in the zone of a branch point, if it is another event than this one."""
        if not math.isfinite(zone.high - zone.low):
            return None
        beside = locator.zero_beside(index, self._tests.index(zone.test), 0.5 * (zone.low + zone.high))
        if beside is None:
            return None
        s, margin = beside[0], max(beside[1], self._settings.location_tolerance)
        try:
            step, low, high = (locator.step(place) for place in (s, s - margin, s + margin))
        except StepRefused:
            return None
        return Location("zero", "located", s, step, _residual(index, step), low, high, between=(s - margin, s + margin))

    def _around(self, index: int, first: Location, last: Location, resolution: Resolution) -> tuple[Location, float]:
        """Two zeros, or one, as one, with the bracket up to the next steps at which the test function is more than rounding; and the size
        up to which it is rounding there.

        This size is the distance from a straight line over a few bracket widths. Where the test function is undefined for being rounding,
        all its values are more than that. Steps are taken where the straight line leaves the noise."""
        locator = resolution.locator
        values = [float(step.tests[index]) for _, step in locator.taken]
        noise = _ROUNDING * max((abs(value) for value in values if value == value), default=0.0)
        width = self._settings.location_tolerance
        end = locator.taken[-1][0]
        near = []
        for k in range(-_BESIDE, _BESIDE + 1):
            place = last.s + k * width
            if 0.0 <= place <= end and not math.isnan(value := float(locator.step(place).tests[index])):
                near.append((float(k), value))
        if len(near) > _BESIDE:
            places, around = (column - column.mean() for column in np.array(near).T)
            slope = inner(places, around) / inner(places, places)  # of the straight line of least squares
            noise = max(noise, _SURE * float(np.max(np.abs(around - slope * places))))
            reach = 2.0 * width * noise / abs(slope) if slope else 0.0
            for place in (last.s - reach, last.s + reach):
                if reach > _BESIDE * width and 0.0 < place < end:
                    try:
                        locator.step(place)
                    except StepRefused:
                        continue
        known = resolution.sure(index)
        certain = [s for s, value in known if abs(value) > noise]
        # The sign is that of the brackets' ends: the problem's own equations can put a zero outside, and one where steps fail is an end.
        low = max((s for s in certain if s < first.s and s <= min(first.between[0], last.between[0])), default=known[0][0])
        high = min((s for s in certain if s > last.s and s >= max(first.between[1], last.between[1])), default=known[-1][0])
        best = min(first, last, key=lambda zero: zero.residual)
        return best._replace(kind="zero", status="located", low=locator.step(low), high=locator.step(high), between=(low, high)), noise

    def _guards(
        self, guards: list[int], locator: Locator, resolution: Resolution, ds: float
    ) -> tuple[list[tuple[int, Location]], float]:
        """Where guards fall to zero, and the length of the step up to which the family is valid."""
        located: list[tuple[int, Location]] = []
        limit = ds
        for index in guards:
            test = self._tests[index]
            if any(locator.value(index, low) > 0.0 >= locator.value(index, high) for low, high in locator.ends):
                continue  # the family ends where another guard has its zero
            values = [float(step.tests[index]) for s, step in locator.taken if s <= limit]
            if test.terminal and values[0] <= 0.0 and values[-1] <= 0.0:
                step = locator.step(0.0)
                located.append((index, Location("outside", "located", 0.0, step, -values[0], step, step)))
                limit = 0.0
                continue
            for low, high in resolution.changes(index, limit, guard=True):
                found = locator.crossing(index, low, high, self._settings.location_tolerance, guard=True)
                jumps = found.residual > JUMP_RATIO * max(abs(locator.value(index, low)), abs(locator.value(index, high)))
                first, last = found.between
                shared = (locator.value(i, first) > 0.0 >= locator.value(i, last) for i in guards if i != index)
                if jumps and (locator.is_at_an_end(found) or any(shared)):
                    continue  # another one has its zero there
                located.append((index, found))
                if test.terminal:
                    limit = found.s
                    break
        return located, limit

    def at_start(self, before: Point, start: Point, after: Point, known: Collection[Event]) -> list[FoundEvent]:
        """The events on the very start of a run, which neither of its halves reports.

        `before`, `after`: the accepted points on either side of the start, all three oriented alike.
        `known`: the events reported between these.
        """
        step = start.step
        located: list[tuple[int, Location]] = []
        for index, test in enumerate(self._tests):
            a, b = float(before.step.tests[index]), float(after.step.tests[index])
            count = sum(event.test == index for event in known)
            # a branch point next to the start is a zero of this function too
            absorbed = self._at_branch_points[index] and not self.singular[index] and any(self.singular[event.test] for event in known)
            own = any(point.event is not None and point.event.test == index for point in (before, after))
            if test.kind == "guard" or a != a or b != b or absorbed or own:
                continue
            if test.kind == "change" and a != b and not count:
                located.append((index, Location("change", "located", 0.0, step, 0.0, step, step)))
            elif test.kind == "crossing" and ((a > 0) is not (b > 0)) is not (count % 2 == 1):
                residual = _residual(index, step)
                if residual <= NEAR_BRANCH_POINT * max(abs(a), abs(b)):
                    located.append((index, Location("zero", "located", 0.0, step, residual, step, step)))
        return self._classified(located, before, after)

    def _classified(self, located: list[tuple[int, Location]], before: Point, after: Point) -> list[FoundEvent]:
        """The events that the problem makes of zeros and changes, without those that belong to another event at the same place."""
        found = []
        for index, location in located:
            test = self._tests[index]
            details = self._problem.classify(index, before, location.step, after, location)
            if details is not None and test.kind == "crossing" and not self._is_small(index, location, before, after):
                words = f"{test.code} near {location.step.parameter:.10g} could not be located: its test function does not vanish there"
                self.unlocated[test.label], details = words, None
            if details is not None:
                if test.terminal and not details.terminal:
                    details = details._replace(terminal=True)
                found.append(FoundEvent(index, location, details))
        dropped: set[int] = set()
        absorbed: dict[int, tuple[str, ...]] = {}
        for i, strong in enumerate(found):
            for j, weak in enumerate(found):
                near = abs(weak.location.s - strong.location.s) <= self._settings.coincidence_tolerance
                if i != j and i not in dropped and near and weak.details.code in self._tests[strong.index].absorbs:
                    dropped.add(j)
                    absorbed[i] = absorbed.get(i, ()) + (weak.details.code,)
        return [replace(event, absorbed=absorbed.get(i, ())) for i, event in enumerate(found) if i not in dropped]

    def _with_shared_folds(self, found: list[FoundEvent], before: Point, after: Point) -> list[FoundEvent]:
        """The events, with both the fold and the branch point where all families through one orbit have their fold there.

        The determinant changes its sign there if the dimension of the null space is even, and the branch point has absorbed the fold. Else
        the fold was found alone."""
        apart = list[FoundEvent]()
        for event in found:
            other = self._shared.get(event.index)
            if other is not None and not any(one.index == other for one in found) and self._shares_fold(event.location.step.y):
                test, location = self._tests[other], event.location._replace(residual=_residual(other, event.location.step))
                details = self._problem.classify(other, before, location.step, after, location) or EventDetails(test.code)
                apart.append(FoundEvent(other, location, details))
                event = replace(event, absorbed=tuple(code for code in event.absorbed if code != test.code))
            apart.append(event)
        return apart

    def _is_small(self, index: int, location: Location, before: Point, after: Point) -> bool:
        """Whether an event is a zero: its residual is small against the values of its test function on both sides, or its level."""
        if location.kind in ("pole", "jump") or (location.kind == "zero" and location.low is not location.high):
            return location.kind == "zero"  # whose bracket has shown that it is no jump
        values = (abs(float(point.step.tests[index])) for point in (before, after))
        part = max(JUMP_RATIO, STEEP * self._settings.location_tolerance / (abs(after.arclength - before.arclength) or math.inf))
        return location.residual <= max(part * max(value for value in (*values, 0.0) if value == value), _LEFT * self.singular[index])

    def _refined(self, index: int, location: Location, before: Point, ds: float) -> Location:
        """The event located by the problem's own equations for it, if it has such; else the location as given.

        A jump is included: if steps fail near a zero, the zero looks like a jump."""
        if self._refine is None or location.kind not in ("interrupted", "zero", "jump"):
            return location
        step = self._refine(index, location.step)
        if step is None:
            return location
        apart = arclength_between(before.step.position, step) - arclength_between(before.step.position, location.step)
        s = location.s + apart
        low, high = location.between
        near = self._settings.coincidence_tolerance
        # The equations may have led to another event: outside this step, or outside the bracket of the jump.
        if not 0.0 < s < ds or (location.kind == "jump" and not low - near < s < high + near):
            return location
        margin = self._settings.location_tolerance
        return Location("zero", "located", s, step, abs(float(step.tests[index])), step, step, margin=margin, between=location.between)


def _touches(index: int, known: list[tuple[float, float]], locator: Locator) -> list[Location]:
    """Where a test function, known at some lengths of the step, reaches zero to rounding and turns back."""
    noise = _ROUNDING * max((abs(value) for _, value in known), default=0.0)
    clear = [i for i, (_, value) in enumerate(known) if abs(value) > noise]
    found = []
    for i, j in pairwise(clear):
        if j - i > 1 and (known[i][1] > 0.0) is (known[j][1] > 0.0):
            low, s, high = known[i][0], min(known[i + 1 : j], key=lambda at: abs(at[1]))[0], known[j][0]
            first, step, last = map(locator.step, (low, s, high))
            found.append(Location("zero", "located", s, step, _residual(index, step), first, last, between=(low, high)))
    return found


def _residual(index: int, step: Step) -> float:
    """Size of a test function at its zero; 0 where it is nan for being rounding."""
    value = abs(float(step.tests[index]))
    return 0.0 if math.isnan(value) else value


def make_event(found: FoundEvent, position: Any, arclength: float, index: int) -> Event:
    """The event that a run reports, from what was found in a step from a point with this position and arclength.

    `index` is the place of the event's point in the run.
    """
    location = found.location
    data = dict(found.details.data)
    if found.absorbed:
        data["absorbed"] = found.absorbed
    if location.kind not in ("zero", "change"):
        data["kind"] = location.kind
        if location.reason:
            data["reason"] = location.reason
    place, *ends = (arclength + arclength_between(position, step) for step in (location.step, location.low, location.high))
    return Event(
        code=found.details.code,
        test=found.index,
        status=location.status,
        arclength=place,
        # Three lengths that are equal to rounding can be in any order.
        bracket=(min(place, *ends) - location.margin, max(place, *ends) + location.margin),
        residual=location.residual,
        point=location.step,
        index=index,
        terminal=found.details.terminal,
        details=data,
    )
