"""A run in both directions from its start, ordered by arclength."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from bvp.dense import length
from continuation.control import Settings
from continuation.engine import Allowance, StopWhen, first_step, follow_in_blocks
from continuation.events import EventFinder, make_event
from continuation.problem import End, EndReason, Event, Goal, PlainPoints, Point, Points, Problem, Step, Tally


@dataclass(frozen=True, eq=False)
class Run:
    """A family as far as it was followed.

    Attributes
    ----------
    points : Points
        In order of arclength, which is 0 at the first. Points of a block of steps are created on access. Tangents, slopes and oriented
        test functions point along growing arclength.
    events : tuple of Event
        In order of arclength; ``events[k].index`` is the index of its point.
    ends : tuple of End
        Why it ended at the first point and at the last. A direction that was not followed ends with reason NOT_ASKED or, for a
        closed family, CLOSED.
    start : int
        Index of the point that the run was started from.
    closed : bool
        Whether the family closes on itself.
    """

    points: Points
    events: tuple[Event, ...]
    ends: tuple[End, End]
    start: int
    closed: bool = False

    @property
    def tally(self) -> Tally:
        """Steps accepted and refused in both directions."""
        first, last = (end.tally for end in self.ends)
        return last if self.closed else Tally(*(a + b for a, b in zip(first, last, strict=True)))


def follow_both_ways(
    problem: Problem,
    start: np.ndarray | Step,
    settings: Settings | None = None,
    *,
    both: bool = True,
    direction: int = 1,
    stop_when: StopWhen | None = None,
    stop_at: Collection[str] = frozenset(),
    on_points: Callable[[Sequence[Point]], object] | None = None,
    on_event: Callable[[Event], object] | None = None,
) -> Run:
    """Follow a family from a start in both directions.

    Parameters
    ----------
    problem, start, settings, stop_when, stop_at
        As for `continuation.follow`, but `stop_when` is called with the start too, and the run is that one point where it
        holds there. The number of points is for both directions together: each may have half, and takes what the other leaves.
    both : bool
        False: the direction alone.
    direction : int
        Sign of the slope in the direction that is followed first, and that the run is oriented by; 0: the tangent of the start.
    on_points, on_event : callable, optional
        Called with the points, one or many at a time, and with each event as they are found, that is, with arclength and index counted
        from the start in its direction.

    Returns
    -------
    Run
        With an `End` of reason NO_START at both ends and no points if there is no first point.

    Raises
    ------
    ValueError
        A direction or a test function that is not known.
    KeyboardInterrupt, RuntimeError
        With a function `computed` as its attribute, which returns the `Run` up to there, or None if it has no point.
    """
    settings = Settings() if settings is None else settings
    first = first_step(problem, start, direction)
    if isinstance(first, str):
        none = End(EndReason.NO_START, first)
        return Run(Points(), (), (none, none), 0)
    if stop_when is not None and (words := stop_when(Point(0, 0.0, first))):
        point = Point(0, 0.0, first)
        if on_points is not None:
            on_points([point])
        held = End(EndReason.STOP_WHEN, (f"{words}, " if isinstance(words, str) else "") + "at the start already")
        return Run(Points([[point]], [0]), (), (held, held), 0)
    total = settings.maximum_points
    allowance = Allowance(min(total // 2 + 1, total) if both else total, resume=both)
    items = follow_in_blocks(problem, first, settings, stop_when, stop_at, allowance, once=direction == 0 and not both)
    forward = _Half(items, allowance, settings, True, on_points, on_event)
    halves = [forward]
    try:
        return _both_halves(problem, first, settings, both, stop_when, stop_at, halves)
    except (KeyboardInterrupt, RuntimeError) as error:
        error.computed = partial(_computed, problem, settings, both, halves)  # type: ignore[union-attr]
        raise


def _both_halves(
    problem: Problem,
    first: Step,
    settings: Settings,
    both: bool,
    stop_when: StopWhen | None,
    stop_at: Collection[str],
    halves: list[_Half],
) -> Run:
    """The run from its first point. `halves` has its first half, and gets the other one."""
    forward, total = halves[0], settings.maximum_points
    allowance, on_points, on_event = forward.allowance, forward.on_points, forward.on_event
    forward.go()
    if not both or forward.closed or forward.end.reason is EndReason.IMAGE:
        run = _joined(problem, settings, None, forward)
        return replace(run, ends=(forward.end, forward.end)) if both and not run.closed else run
    allowance.points = total - len(forward.points) + 1  # the start is one point, though each half has it
    opposite = problem.step(first.y, -first.tangent, 0.0)
    if not opposite.converged:
        lost = End(EndReason.NO_START, "the corrector did not converge at the start with its tangent reversed")
        return Run(forward.points, tuple(forward.events), (lost, forward.end), 0)
    # The family closes where the second half meets the last point of the first, or else the start.
    goal = None
    last = np.asarray(forward.points[-1].step.position, dtype=float)
    for k in range(len(forward.points) - 2, -1, -1):
        way = np.asarray(forward.points[k].step.position, dtype=float) - last
        if length(way) > settings.coincidence_tolerance:
            goal = Goal(_turned_round(problem, forward.points[-1].step), way)
            break
    items = follow_in_blocks(problem, opposite, settings, stop_when, stop_at, allowance, goal)
    backward = _Half(items, allowance, settings, False, on_points, on_event)
    halves.append(backward)
    backward.go()
    if forward.end.reason is EndReason.POINTS and not backward.closed and allowance.points > 0:
        forward.go()
    return _joined(problem, settings, None if forward.closed else backward, forward)


def _computed(problem: Problem, settings: Settings, both: bool, halves: list[_Half]) -> Run | None:
    """What an interrupted run has computed."""
    forward, backward = halves[0], halves[1] if len(halves) > 1 and len(halves[1].points) else None
    if not len(forward.points):
        return None
    run = _joined(problem, settings, backward, forward)
    return replace(run, ends=(End(EndReason.INTERRUPTED), run.ends[1])) if both and backward is None else run


@dataclass(eq=False)
class _Half:
    """One direction of a run, which can be continued when its points were used up. `reports_start`: whether `on_points` gets its start."""

    items: Iterator[Point | PlainPoints | Event | End]
    allowance: Allowance
    settings: Settings
    reports_start: bool
    on_points: Callable[[Sequence[Point]], object] | None
    on_event: Callable[[Event], object] | None
    points: Points = field(default_factory=Points)
    events: list[Event] = field(default_factory=list)
    end: End = End(EndReason.POINTS)
    closed: bool = False

    def go(self) -> None:
        """Collect points and events until the run ends; a run that ended because its points were used up can be continued."""
        self.end = End(EndReason.INTERRUPTED)
        for item in self.items:
            if isinstance(item, End):
                self.end, self.closed = item, item.reason is EndReason.CLOSED
                return
            if isinstance(item, Event):
                # An event at the start is stored already: report that one, with its index 0.
                item = self.events[0] if self.events and self.events[0].index == 0 else item
                if item.index:
                    self.events.append(item)
                if self.on_event is not None:
                    self.on_event(item)
                continue
            event = item.event if isinstance(item, Point) and item.index == 1 else None
            if isinstance(item, Point) and event is not None and item.arclength <= self.settings.location_tolerance:
                # The family ends at the start itself, to the accuracy of locations: one point, which has the event.
                low, high = event.bracket
                first = replace(event, arclength=0.0, bracket=(min(low, 0.0), max(high, 0.0)), index=0)
                self.points = Points([[Point(0, 0.0, first.point, 0.0, first)]], [0])
                self.events = [first]
                self.allowance.points += 1
                continue
            piece = item if isinstance(item, PlainPoints) else [item]
            self.points.add(piece)
            if self.on_points is not None and (piece[0].index or self.reports_start):
                self.on_points(piece)


def _placed(problem: Problem, half: _Half, sign: int, index: int, arclength: float) -> tuple[Points, list[Event]]:
    """Points and events of a half in a run where its start has this index and arclength; they grow (sign 1) or fall (-1) along the half.

    In a half that is seen backwards the last point comes first, and tangents are turned round.
    """
    placed = Points()
    events: list[Event] = []
    for piece in half.points.pieces[::sign]:
        if isinstance(piece, PlainPoints):
            first = index + piece.begin if sign > 0 else index - (piece.begin + len(piece) - 1)
            seen = None if sign > 0 else partial(_turned_round, problem)
            arclengths = arclength + sign * piece.arclengths[::sign]
            placed.add(PlainPoints(first, arclengths, piece.strides[::sign], piece.steps[::sign], seen))
            continue
        points = []
        for p in piece[::sign]:
            step = p.step if sign > 0 else _turned_round(problem, p.step)
            place, event = index + sign * p.index, p.event
            if event is not None:
                low, high = sorted(arclength + sign * s for s in event.bracket)
                at = event.point if sign > 0 else step
                event = replace(event, arclength=arclength + sign * event.arclength, bracket=(low, high), index=place, point=at)
                events.append(event)
            points.append(Point(place, arclength + sign * p.arclength, step, p.step_size, event))
        placed.add(points)
    return placed, events


def _turned_round(problem: Problem, step: Step) -> Step:
    """The same point seen along the opposite tangent."""
    tests = [-float(v) if test.oriented else float(v) for test, v in zip(problem.tests, step.tests, strict=True)]
    return step._replace(tangent=-step.tangent, slope=-step.slope, tests=tests)


def _joined(problem: Problem, settings: Settings, backward: _Half | None, forward: _Half) -> Run:
    """The halves as one run, oriented by the forward one. Without a backward half the run may be closed in itself; with one, it is closed
    where this has met the forward half."""
    points, events, start, ends = forward.points, forward.events, 0, (End(EndReason.NOT_ASKED), forward.end)
    closed = forward.closed if backward is None else backward.closed
    if backward is not None:
        end = backward.points[-1]
        points, events = _placed(problem, backward, -1, end.index, end.arclength)
        start, ends = len(points) - 1, (backward.end, forward.end)
        later, later_events = _placed(problem, forward, 1, start, end.arclength)
        if later[0].event is not None:
            points.mark(later[0])
        head, *rest = later.pieces
        for piece in [list(head)[1:], *rest]:  # the start is there already
            points.add(piece)
        events += later_events
        if 0 < start < len(points) - 1:
            events = _with_events_at(start, problem, settings, points, events)
    if closed:
        events = _with_events_at(0, problem, settings, points, events)
        tally, detail = forward.end.tally, forward.end.detail
        if backward is not None:
            tally = Tally(*(a + b for a, b in zip(backward.end.tally, tally, strict=True)))
            detail = f"length {points[-1].arclength:.9g}"
        ends = (End(EndReason.CLOSED, detail, tally, forward.end.unlocated),) * 2
    return Run(points, tuple(events), ends, start, closed)


def _halfway(problem: Problem, start: Point, event: Point) -> Point:
    """A point between the start and an event next to it. At the event itself test functions may be rounding: where a family ends, the
    multipliers grow without bound. It is the event's point if the step there fails."""
    ds = 0.5 * (event.arclength - start.arclength)
    step = problem.step(start.step.y, start.step.tangent, ds)
    return Point(start.index, start.arclength + ds, step) if step.converged else event


def _with_events_at(place: int, problem: Problem, settings: Settings, points: Points, events: list[Event]) -> list[Event]:
    """The events, with those that lie on the start of a half, which neither half reports; they share its point, which gets one.

    Place 0 is where a closed family begins and ends.
    """
    last = len(points) - 1
    sides = []
    around = (range(last - 1, 0, -1), range(1, last)) if place == 0 else (range(place - 1, -1, -1), range(place + 1, last + 1))
    for start, places in zip((points[place or last], points[place]), around, strict=True):
        if not places:
            return events
        regular = (point for point in map(points.__getitem__, places) if point.event is None)
        sides.append(next(regular, None) or _halfway(problem, start, points[places[0]]))
    before, after = sides
    if place == 0:
        known = [event for event in events if event.index > before.index or event.index < after.index]
    else:
        known = [event for event in events if before.index < event.index < after.index]
    at = points[place]
    for found in EventFinder(problem, settings).at_start(before, at, after, known):
        event = make_event(found, at.step.position, at.arclength, at.index)
        events = [*events, event]
        if points[place].event is None:
            points.mark(replace(at, event=event))
    return sorted(events, key=lambda event: (event.arclength, event.index))
