"""The events of one step: which test functions ask for a look, where their events are, and which of them are one."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from typing import Any

from continuation.control import arclength_of, distance, kinds_of, watch
from continuation.location import JUMP_RATIO, Location, Locator, StepRefused
from continuation.problem import Event, EventDetails, Point, Problem, Step, Test
from continuation.settings import Settings

_PROBES = 4  # looks at a predicted extremum in search of two zeros
_CHANGES = 16  # of one key in a step; a longer list asks for a shorter step


def arclength_between(start: Any, step: Step) -> float:
    """Arclength from the position that a step was taken from to the corrected point (see `continuation.control.arclength_of`)."""
    length: float = arclength_of(distance(start, step.position), step.turn)
    return length


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """An event of a step: which test, where, what the problem says it is, and the codes that it absorbed."""

    index: int
    location: Location
    details: EventDetails
    absorbed: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Suspect:
    """A test that asks for a look; `dip`: place of a predicted extremum as a part of the step, None for a certain event."""

    index: int
    dip: float | None


class EventFinder:
    """Finds the events of each step of a run.

    Two zeros of one test function inside a step leave no change of sign. They are looked for where the parabola through the
    values at the last three points has its extremum inside the last step and dips there below `Settings.dip_ratio` times the
    smaller end value: a step is taken to the predicted extremum, a few times over. This finds pairs of a function that is well
    described by a parabola over two steps; it does not find pairs in the first step, nor those of a function that varies
    faster than the steps.
    """

    def __init__(self, problem: Problem, settings: Settings) -> None:
        self._problem = problem
        self._settings = settings
        self._tests: tuple[Test, ...] = tuple(problem.tests)
        self._kinds = kinds_of(self._tests)
        self._places = [math.nan] * len(self._tests)
        self.undefined = [math.nan] * len(self._tests)
        """Test functions of the point before the first: not known."""
        self._refine: Callable[[int, Step], Step | None] | None = getattr(problem, "refined", None)
        self._absorbing = any(test.absorbs for test in self._tests)

    def scan(
        self, older: list[float] | None, old: list[float], new: list[float], length_old: float, length_new: float
    ) -> list[Suspect]:
        """The test functions that ask for a look, from their values at the last three points and the arclengths between these.

        `older` is None where there are two points only.
        """
        first = self.undefined if older is None else older
        places = self._places
        if not watch(self._kinds, first, old, new, length_old, length_new, self._settings.dip_ratio, places):
            return []
        return [Suspect(i, None if math.isinf(place) else place) for i, place in enumerate(places) if place == place]

    def find(self, suspects: list[Suspect], before: Point, after: Point, ds: float) -> list[Found]:
        """The events of a step from `before` to `after` of length ds, in order, after the problem's word on each.

        Raises
        ------
        StepRefused
            The family is not followed inside the step: the step is not to be accepted.
        """
        locator = Locator(self._problem, before, self._settings)
        locator.enter(ds, after.step)
        located: list[tuple[int, Location]] = []
        for suspect in sorted(suspects, key=lambda suspect: self._effort(suspect.index, before, after)):
            if self._tests[suspect.index].kind == "guard" and locator.ends_with_another(suspect.index):
                continue
            found = self._locate(locator, suspect.index, suspect.dip, ds)
            if not locator.has_end and any(location.kind == "jump" for location in found):
                # Steps taken for another event may lie on another family, beside a point where the two cross.
                alone = Locator(self._problem, before, self._settings)
                alone.enter(ds, after.step)
                again = self._locate(alone, suspect.index, suspect.dip, ds)
                found = again if any(location.kind == "zero" for location in again) else found
            located += [(suspect.index, self._refined(suspect.index, location, before, ds)) for location in found]

        def place(pair: tuple[int, Location]) -> tuple[float, float, int]:
            # Beside a branch point a shorter step can be corrected onto a point that is further along.
            index, location = pair
            return arclength_between(before.step.position, location.step), location.s, index

        return self._classified(sorted(located, key=place), before, after)

    def _effort(self, index: int, before: Point, after: Point) -> tuple[bool, bool, float]:
        """Order in which events of one step are located: the smooth ones first. Where several coincide (at a grazing an impact's speed has
        a plain zero, a clearance jumps and the multipliers have a pole), the steps taken for one bracket the others."""
        kind = self._tests[index].kind
        sizes = sorted((abs(float(before.tests[index])), abs(float(after.tests[index]))))
        return kind == "change", kind != "guard", -sizes[0] / sizes[1] if sizes[1] > 0.0 else 0.0

    def at_start(self, before: Point, start: Point, after: Point, known: Collection[int]) -> list[Found]:
        """The events on the very start of a run, where the sign of a test function is undecided.

        Parameters
        ----------
        before, after : Point
            The accepted points on either side of `start`, all three oriented alike.
        known : collection of int
            Tests that have an event of their own between these: they are left alone.
        """
        step = start.step
        located: list[tuple[int, Location]] = []
        for index, test in enumerate(self._tests):
            a, b = float(before.tests[index]), float(after.tests[index])
            if test.kind == "guard" or index in known or a != a or b != b:
                continue
            if test.kind == "change" and a != b:
                located.append((index, Location("change", "located", 0.0, step, 0.0, step, step)))
            elif test.kind == "crossing" and (a > 0) is not (b > 0):
                residual = abs(float(step.tests[index]))
                if residual <= JUMP_RATIO * max(abs(a), abs(b)):
                    located.append((index, Location("zero", "located", 0.0, step, residual, step, step)))
                else:
                    located.append((index, Location("jump", "bracketed", 0.0, step, residual, step, step)))
        return self._classified(located, before, after)

    def _classified(self, located: list[tuple[int, Location]], before: Point, after: Point) -> list[Found]:
        found = []
        for index, location in located:
            details = self._problem.classify(index, before, location.step, after, location)
            if details is not None:
                if self._tests[index].terminal and not details.terminal:
                    details = details._replace(terminal=True)
                found.append(Found(index, location, details))
        return self._absorb(found) if self._absorbing else found

    def _refined(self, index: int, location: Location, before: Point, ds: float) -> Location:
        """The event where the problem has it to full accuracy, if it can tell."""
        if self._refine is None or location.kind not in ("interrupted", "zero"):
            return location
        step = self._refine(index, location.step)
        if step is None:
            return location
        apart = arclength_between(before.step.position, step) - arclength_between(before.step.position, location.step)
        s = location.s + apart
        if not 0.0 < s < ds:
            return location
        margin = self._settings.location_tolerance
        return Location("zero", "located", s, step, abs(float(step.tests[index])), step, step, margin=margin)

    def _locate(self, locator: Locator, index: int, dip: float | None, ds: float) -> list[Location]:
        test = self._tests[index]
        if test.kind == "change":
            changes = []
            low = 0.0
            while locator.value(index, low) != locator.value(index, ds) and not locator.changes_at_an_end(index, low, ds, key=True):
                location, low = locator.change(index, low, ds, test.terminal)
                if not locator.is_at_an_end(location):
                    changes.append(location)
                if len(changes) > _CHANGES:
                    raise StepRefused(f"the key of {test.code} changes more than {_CHANGES} times")
            return changes
        places = [0.0, ds] if dip is None else self._probe(locator, index, dip, ds)
        crossings = []
        for low, high in zip(places, places[1:], strict=False):
            positive_low, positive_high = locator.value(index, low) > 0, locator.value(index, high) > 0
            if test.kind == "guard" and not positive_low and not positive_high:
                step = locator.step(low)
                crossings.append(Location("outside", "located", low, step, abs(locator.value(index, low)), step, step))
            elif positive_low is not positive_high and (positive_low or test.kind == "crossing"):
                if test.kind == "crossing" and locator.changes_at_an_end(index, low, high):
                    continue
                found = locator.crossing(index, low, high, guard=test.kind == "guard")
                if test.kind == "guard" or not locator.is_at_an_end(found):
                    crossings.append(found)
        return crossings

    def _probe(self, locator: Locator, index: int, dip: float, ds: float) -> list[float]:
        """Places that part the step so that a sign differs between neighbours, or the ends alone if none was found."""
        a, b = locator.value(index, 0.0), locator.value(index, ds)
        places = [0.0, ds]
        if ds <= self._settings.coincidence_tolerance:
            return places
        place = dip
        for _ in range(_PROBES):
            s = place * ds
            value = locator.value(index, s)
            if (value > 0) is not (a > 0):
                return [0.0, s, ds]
            rise_before, rise_last = (value - a) / s, (b - value) / (ds - s)
            curvature = (rise_last - rise_before) / ds
            if curvature == 0.0:
                return places
            lowest = s - 0.5 * (rise_before + s * curvature) / curvature  # of the parabola through the three
            slope = rise_before + s * curvature
            extremum = value - slope * slope / (4.0 * curvature)
            if not 0.0 < lowest < ds or not extremum / a < self._settings.dip_ratio * min(1.0, b / a):
                return places
            if abs(lowest - s) < 1e-3 * ds:
                return places
            place = lowest / ds
        return places

    def _absorb(self, found: list[Found]) -> list[Found]:
        dropped: set[int] = set()
        absorbed: dict[int, tuple[str, ...]] = {}
        for i, strong in enumerate(found):
            for j, weak in enumerate(found):
                near = abs(weak.location.s - strong.location.s) <= self._settings.coincidence_tolerance
                if i != j and i not in dropped and near and weak.details.code in self._tests[strong.index].absorbs:
                    dropped.add(j)
                    absorbed[i] = absorbed.get(i, ()) + (weak.details.code,)
        return [replace(event, absorbed=absorbed.get(i, ())) for i, event in enumerate(found) if i not in dropped]


def make_event(found: Found, position: Any, arclength: float, index: int) -> Event:
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
    ends = [arclength + arclength_between(position, end) for end in (location.low, location.high)]
    return Event(
        code=found.details.code,
        test=found.index,
        status=location.status,
        arclength=arclength + arclength_between(position, location.step),
        bracket=(min(ends) - location.margin, max(ends) + location.margin),
        residual=location.residual,
        point=location.step,
        index=index,
        terminal=found.details.terminal,
        details=data,
    )
