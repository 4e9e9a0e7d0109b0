"""A run in both directions from its start, put together in order of arclength."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from continuation.control import Settings
from continuation.engine import Allowance, StopWhen, first_step, follow_in_blocks
from continuation.events import EventFinder, make_event
from continuation.points import Piece, PlainPoints, Points
from continuation.problem import End, EndReason, Event, Point, Problem, Step, Tally


@dataclass(frozen=True, eq=False)
class Run:
    """A family as far as it was followed.

    Attributes
    ----------
    points : Points
        In order of arclength, which is 0 at the first; those of a block of steps are made when asked for. Tangents, slopes and oriented
        test functions point along growing arclength.
    events : tuple of Event
        In order of arclength; ``events[k].index`` is the index of its point.
    ends : tuple of End
        Why it ended at the first point and at the last. A direction that was not followed ends with reason NOT_ASKED or, for a
        closed family, CLOSED.
    start : int
        Index of the point that the run was started from.
    """

    points: Points
    events: tuple[Event, ...]
    ends: tuple[End, End]
    start: int

    @property
    def closed(self) -> bool:
        """Whether the family closes on itself."""
        return self.ends[1].reason is EndReason.CLOSED

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
    """
    settings = Settings() if settings is None else settings
    first = first_step(problem, start, direction)
    if isinstance(first, str):
        none = End(EndReason.NO_START, first)
        return Run(Points(), (), (none, none), 0)
    if stop_when is not None:
        point = Point(0, 0.0, first)
        verdict = stop_when(point)
        if verdict:
            if on_points is not None:
                on_points([point])
            held = End(EndReason.STOP_WHEN, (f"{verdict}, " if isinstance(verdict, str) else "") + "at the start already")
            return Run(Points([[point]]), (), (held, held), 0)
    total = settings.maximum_points
    allowance = Allowance(min(total // 2 + 1, total) if both else total, resume=both)
    forward = _Half(problem, first, settings, stop_when, stop_at, allowance, on_points, on_event)
    forward.go()
    if not both or forward.closed:
        return _one_way(problem, settings, forward)
    allowance.points = total - len(forward.points) + 1  # the start is one point, though each half has it
    opposite = problem.step(first.y, -first.tangent, 0.0)
    if not opposite.converged:
        lost = End(EndReason.NO_START, "the corrector did not converge at the start with its tangent reversed")
        return Run(forward.points, tuple(forward.events), (lost, forward.end), 0)
    backward = _Half(
        problem, opposite, settings, stop_when, stop_at, allowance, on_points, on_event, forward.last_place(problem)
    )
    backward.go()
    if forward.end.reason is EndReason.POINTS and not backward.closed and allowance.points > 0:
        forward.go()
        if forward.closed:
            return _one_way(problem, settings, forward)
    return _both_ways(problem, settings, backward, forward)


class _Half:
    """One direction of a trace, which can be gone on with when its points were used up."""

    def __init__(
        self,
        problem: Problem,
        first: Step,
        settings: Settings,
        stop_when: StopWhen | None,
        stop_at: Collection[str],
        allowance: Allowance,
        on_points: Callable[[Sequence[Point]], object] | None,
        on_event: Callable[[Event], object] | None,
        goal: tuple[Step, np.ndarray] | None = None,
    ) -> None:
        self.points = Points()
        self.events: list[Event] = []
        self.end = End(EndReason.POINTS)
        self.closed = False
        self._allowance = allowance
        self._items = follow_in_blocks(problem, first, settings, stop_when, stop_at, allowance, goal)
        self._first = not allowance.started
        allowance.started = True
        self._near = settings.coincidence_tolerance
        self._exact = settings.location_tolerance
        self._on_points = on_points
        self._on_event = on_event

    def go(self) -> None:
        """Follow until the next end."""
        for item in self._items:
            if isinstance(item, Point):
                if item.index == 1 and item.event is not None and item.arclength <= self._exact:
                    self._start_is(item.event)
                    continue
                self.points.append(item)
                if self._on_points is not None and (item.index or self._first):
                    self._on_points([item])
            elif isinstance(item, PlainPoints):
                self.points.extend(item)
                if self._on_points is not None:
                    self._on_points(item)
            elif isinstance(item, Event):
                item = self.events[0] if self.events and self.events[0].index == 0 else item
                if item.index:
                    self.events.append(item)
                if self._on_event is not None:
                    self._on_event(item)
            else:
                self.end, self.closed = item, item.reason is EndReason.CLOSED
                return

    def _start_is(self, event: Event) -> None:
        """The family ends at the start itself, to the accuracy of locations: one point, which has the event."""
        low, high = event.bracket
        first = replace(event, arclength=0.0, bracket=(min(low, 0.0), max(high, 0.0)), index=0)
        self.points = Points([[Point(0, 0.0, first.point, 0.0, first)]])
        self.events = [first]
        self._allowance.points += 1

    def last_place(self, problem: Problem) -> tuple[Step, np.ndarray] | None:
        """The last point seen from the other direction, and the way along the curve there; None if it is the start."""
        last = np.asarray(self.points[-1].position, dtype=float)
        for k in range(len(self.points) - 2, -1, -1):
            point = self.points[k]
            way = np.asarray(point.position, dtype=float) - last
            if float(np.linalg.norm(way)) > self._near:
                return _turned_round(problem, self.points[-1].step), way
        return None

    def moved(self, index: int, arclength: float) -> tuple[Points, list[Event]]:
        """Points and events with indices and arclengths that start later."""
        events: dict[int, Event] = {}
        for event in self.events:
            low, high = event.bracket
            events[event.index] = replace(
                event, arclength=event.arclength + arclength, bracket=(low + arclength, high + arclength), index=event.index + index
            )
        pieces: list[Piece] = []
        for piece in self.points.pieces:
            if isinstance(piece, PlainPoints):
                pieces.append(piece.moved(index, arclength))
            else:
                pieces.append(
                    [replace(p, index=p.index + index, arclength=p.arclength + arclength, event=events.get(p.index)) for p in piece]
                )
        return Points(pieces), list(events.values())

    def reversed(self, problem: Problem) -> tuple[Points, list[Event]]:
        """Points and events seen the other way: the last comes first, tangents are turned round."""
        last, total = self.points[-1].index, self.points[-1].arclength
        pieces: list[Piece] = []
        events: list[Event] = []
        for piece in reversed(self.points.pieces):
            if isinstance(piece, PlainPoints):
                pieces.append(piece.reversed(last, total, partial(_turned_round, problem)))
                continue
            points = []
            for p in reversed(piece):
                step, index, event = _turned_round(problem, p.step), last - p.index, None
                if p.event is not None:
                    low, high = p.event.bracket
                    event = replace(
                        p.event, arclength=total - p.event.arclength, bracket=(total - high, total - low), index=index, point=step
                    )
                    events.append(event)
                points.append(Point(index, total - p.arclength, step, p.step_size, event))
            pieces.append(points)
        return Points(pieces), events


def _turned_round(problem: Problem, step: Step) -> Step:
    """The same point seen along the opposite tangent."""
    tests = [-float(v) if test.oriented else float(v) for test, v in zip(problem.tests, step.tests, strict=True)]
    return step._replace(tangent=-step.tangent, slope=-step.slope, tests=tests)


def _one_way(problem: Problem, settings: Settings, half: _Half) -> Run:
    """A run in one direction, which may be closed."""
    points, events = half.points, half.events
    if not half.closed:
        return Run(points, tuple(events), (End(EndReason.NOT_ASKED), half.end), 0)
    events = _with_events_at(0, problem, settings, points, events)
    return Run(points, tuple(events), (half.end, half.end), 0)


def _both_ways(problem: Problem, settings: Settings, backward: _Half, forward: _Half) -> Run:
    """Both halves as one run, oriented by the forward one; closed where the backward half has met the forward one."""
    points, events = backward.reversed(problem)
    start = len(points) - 1
    later, later_events = forward.moved(start, points[-1].arclength)
    if later[0].event is not None:
        points[-1] = later[0]
    points.extend(later[1:])
    events += later_events
    if 0 < start < len(points) - 1:
        events = _with_events_at(start, problem, settings, points, events)
    if not backward.closed:
        return Run(points, tuple(events), (backward.end, forward.end), start)
    events = _with_events_at(0, problem, settings, points, events)
    tally = Tally(*(a + b for a, b in zip(backward.end.tally, forward.end.tally, strict=True)))
    end = End(EndReason.CLOSED, f"length {points[-1].arclength:.9g}", tally)
    return Run(points, tuple(events), (end, end), start)


def _with_events_at(place: int, problem: Problem, settings: Settings, points: Points, events: list[Event]) -> list[Event]:
    """The events, with those that lie on the start of a half, which neither half reports; they share its point, which gets one.

    Place 0 is where a closed family begins and ends.
    """
    last = len(points) - 1
    before = _regular(points, range(last - 1, 0, -1) if place == 0 else range(place - 1, -1, -1))
    after = _regular(points, range(1, last) if place == 0 else range(place + 1, last + 1))
    if before is None or after is None:
        return events
    if place == 0:
        known = [event for event in events if event.index > before.index or event.index < after.index]
    else:
        known = [event for event in events if before.index < event.index < after.index]
    at = points[place]
    for found in EventFinder(problem, settings).at_start(before, at, after, known):
        event = make_event(found, at.position, at.arclength, at.index)
        events = [*events, event]
        if points[place].event is None:
            points[place] = replace(at, event=event)
    return sorted(events, key=lambda event: (event.arclength, event.index))


def _regular(points: Points, places: range) -> Point | None:
    """The first point at these places that no event was met at, or the first at all; None where there is none."""
    first = points[places[0]] if places else None
    return next((point for point in map(points.__getitem__, places) if point.event is None), first)
