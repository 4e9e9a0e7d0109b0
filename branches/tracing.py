"""Tracing: from an orbit to the branch of its family."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from branches.branch import Branch, BranchEvent, Ended
from branches.family import SETTINGS, Family
from branches.finished import branch_of, event_of
from branches.grazing_notes import unphysical
from branches.orbit import Orbit
from branches.stability import describe
from bvp.checks import checked_energy_range
from bvp.interrupts import held
from bvp.multipoint import MultipointProblem
from bvp.options import takes_options_of
from bvp.shown import shown
from continuation.control import Settings
from continuation.points import PlainPoints, Points
from continuation.problem import Event, Point, Step
from continuation.run import follow_both_ways

__all__ = ["SETTINGS", "Courses", "TraceError", "check_energy", "extend", "follow_family"]

EVENT_TYPES = ("SN", "BP", "SB", "PD", "RT", "NS", "GR", "IO", "LB", "EP")
"""Types of events, see `branches.family`."""

HIGHEST = 1e12
"""Energy at which a family ends where no range is given: beyond it the elastic forces are lost beside the speeds of the impacts."""

_DEFAULTS = {"points": None, "direction": "both", "stop_at": None, "stop_when": None, "settings": SETTINGS, "rising": True}
"""Options that decide how a family is followed, and their values where they are not given."""

_SIGNS = {"up": 1, "both": 1, "down": -1, "along": 0}

Condition = Callable[[Orbit], "bool | str"]


class TraceError(ValueError):
    """Options that cannot be; the message says in one line what was received and what was expected."""


def follow_family(
    problem: MultipointProblem,
    start: np.ndarray | Step,
    *,
    energy: tuple[float, float] = (0.0, HIGHEST),
    quarter_period: float = math.inf,
    points: int | None = None,
    direction: str = "both",
    stop_at: str | None = None,
    stop_when: Condition | None = None,
    on_event: Callable[[BranchEvent], object] | None = None,
    on_end: Callable[[Ended], object] | None = None,
    on_point: Callable[[int], object] | None = None,
    settings: Settings = SETTINGS,
    rising: bool = True,
    found: list[Sequence[Point] | Event] | None = None,
) -> Branch:
    """Follow the family of a solution.

    Parameters
    ----------
    problem : MultipointProblem
    start : (u,) float, or continuation.Step
        Unknowns near an orbit of the family, or an orbit with its tangent.
    energy : (float, float)
        The family ends at these energies; by default at most at `HIGHEST`.
    quarter_period : float
        The family ends where its quarter period grows beyond this one.
    points : int, optional
        Points in total; reaching it is a reason to end.
    direction : {"up", "down", "both", "along"}
        Whether the first step raises the energy, lowers it, both ways are followed, or the start's own tangent is.
    stop_at : str, optional
        Type of the events to end at.
    stop_when : callable, optional
        Called with each `Orbit`, the start's first (its attributes are computed when asked for); the family ends where it gives
        True or words. A condition that holds at the start ends it there, with one point.
    on_event, on_end, on_point : callable, optional
        Called with each event as it is found (its `number` counts from the start), each end, and the number of points so far.
    settings : continuation.Settings
    rising : bool
        Whether a branch followed both ways is put in the order of energies rising at the start, or falling there.
    found : list, optional
        Filled with the points and events of the run in the order in which they are found.

    Returns
    -------
    Branch

    Raises
    ------
    TraceError
        For options that cannot be, and for a start that is no orbit, because it passes beyond a stop or an impact would have to pull.
    RuntimeError
        Where the family cannot be followed.
    """
    energy = check_energy(energy)
    if direction not in _SIGNS:
        raise TraceError(f"direction {shown(direction)}: expected up, down or both")
    if stop_at is not None and stop_at not in EVENT_TYPES:
        raise TraceError(f"stop_at {shown(stop_at)}: expected one of {', '.join(EVENT_TYPES)}")
    if stop_when is not None and not callable(stop_when):
        raise TraceError(f"stop_when = {shown(stop_when)}: expected a function of an orbit")
    if points is not None:
        if isinstance(points, bool) or not isinstance(points, int | np.integer):
            raise TraceError(f"points = {shown(points)}: expected a whole number, at least 1")
        if not 1 <= points < 1 << 63:
            raise TraceError(f"points = {shown(points)}: expected at least 1")
        settings = Settings(**{**_fields(settings), "maximum_points": points})
    problem.refuse_drift()
    family = Family(problem, energy, quarter_period)
    if not isinstance(start, Step):
        start = np.array(start, dtype=float)
    begin = start if isinstance(start, Step) else family.begin(start)
    beyond = unphysical(problem, begin.extra) if begin.converged else None
    if beyond is not None:
        raise TraceError(f"the start solves the equations but is no orbit: {beyond}; expected motion between the stops")
    sign = _SIGNS[direction] * (1 if rising or direction != "both" else -1)
    collector = _Collector(problem, energy, on_event, on_point, sign, found)
    condition = None
    if stop_when is not None:
        asked = stop_when

        def condition(point: Point) -> bool | str:
            return asked(Orbit(problem, point.step.extra))

    with collector.keeping():
        run = follow_both_ways(
            family,
            start,
            settings,
            both=direction == "both",
            direction=sign,
            stop_when=condition,
            stop_at=frozenset() if stop_at is None else frozenset({stop_at}),
            on_points=collector.points,
            on_event=collector.event,
        )
    if not run.points:
        raise RuntimeError(f"the family could not be followed: {run.ends[0].text}")
    return _ended(lambda: branch_of(problem, run, energy), on_end)


def _ended(finish: Callable[[], Branch], on_end: Callable[[Ended], object] | None) -> Branch:
    """The finished branch, after its ends were reported. An interruption has to wait until then, and carries the branch."""
    with held() as interrupt:
        branch = finish()
        if on_end is not None:
            for ended in dict.fromkeys(branch.ended):
                on_end(ended)
    if interrupt.came:
        raise _with_branch(KeyboardInterrupt(), branch)
    return branch


class Courses:
    """Families that were followed from a start: none is followed twice from it, but its course is reported again.

    A search follows families to tell them apart, and the one that it finds is then traced.
    """

    def __init__(self) -> None:
        self._known: dict[tuple[MultipointProblem, bytes, tuple[float, float]], tuple[Branch, list[Sequence[Point] | Event]]] = {}

    def follow(
        self,
        problem: MultipointProblem,
        y: np.ndarray,
        *,
        energy: tuple[float, float],
        on_event: Callable[[BranchEvent], object] | None = None,
        on_end: Callable[[Ended], object] | None = None,
        on_point: Callable[[int], object] | None = None,
        **options: Any,
    ) -> Branch:
        """The same as `follow_family`; with further options the family is followed anew."""
        key = (problem, y.tobytes(), energy)
        if any(options[name] != default for name, default in _DEFAULTS.items() if name in options):
            branch = follow_family(problem, y, energy=energy, on_event=on_event, on_end=on_end, on_point=on_point, **options)
            return self._with_wider(branch, y)
        if key not in self._known:
            found: list[Sequence[Point] | Event] = []
            self._known[key] = self._with_wider(follow_family(problem, y, energy=energy, found=found), y), found
        branch, found = self._known[key]
        collector = _Collector(problem, energy, on_event, on_point, 1)
        with collector.keeping():
            for item in found:
                if isinstance(item, Event):
                    collector.event(item)
                else:
                    collector.points(item)
        return _ended(lambda: branch, on_end)

    def _with_wider(self, branch: Branch, y: np.ndarray) -> Branch:
        """The branch, with one of a wider range of energies from the same orbit, from which its id follows."""
        for (problem, start, energy), (other, _) in self._known.items():
            if problem is branch.problem and start == y.tobytes() and energy[0] <= branch.energy[0] and branch.energy[1] <= energy[1]:
                return branch.known_within(other)
        return branch


@takes_options_of(follow_family)
def extend(branch: Branch, i: int, **options: Any) -> Branch:
    """Trace a branch on from its point i.

    Parameters
    ----------
    branch : Branch
    i : int
        Index of a point; -1 is the last.
    **options
        As for `follow_family`.

    Raises
    ------
    IndexError, TypeError
        If the branch has no point i.
    """
    return follow_family(branch.problem, branch.unknowns(i), **options)


def _with_branch(error: BaseException, branch: Branch | None) -> BaseException:
    """The error with what was computed before it as its attribute `branch`."""
    if branch is not None:
        error.branch = branch  # type: ignore[attr-defined]
    return error


def check_energy(energy: tuple[float, float]) -> tuple[float, float]:
    """The range of energies; `TraceError` for what is none."""
    try:
        return checked_energy_range(energy)
    except ValueError as error:
        raise TraceError(str(error)) from None


def _fields(settings: Settings) -> dict[str, Any]:
    return {name: getattr(settings, name) for name in settings.__dataclass_fields__}


class _Collector:
    """Reports events with their number from the start as they are found, and keeps what an interrupted run has computed."""

    def __init__(
        self,
        problem: MultipointProblem,
        energy: tuple[float, float],
        on_event: Callable[[BranchEvent], object] | None,
        on_point: Callable[[int], object] | None,
        direction: int,
        found: list[Sequence[Point] | Event] | None = None,
    ) -> None:
        self.found = found
        self.problem = problem
        self.energy = energy
        self.on_event = on_event
        self.on_point = on_point
        self.direction = direction
        self.halves: dict[int, Points] = {1: Points(), -1: Points()}
        self.sign = 1
        self.begin: Point | None = None
        self.count = 0
        self.types: dict[str, int] = {}

    @contextmanager
    def keeping(self) -> Iterator[None]:
        """Let an error within the block carry what was computed before it."""
        try:
            yield
        except (KeyboardInterrupt, RuntimeError) as error:
            with held():
                raise _with_branch(error, self.partial("INTERRUPTED", "the run was interrupted here; trace on from this point")) from None

    def points(self, points: Sequence[Point]) -> None:
        if self.found is not None:
            self.found.append(points)
        if self.on_point is None and isinstance(points, PlainPoints):
            self.count += len(points)
            self.face(points[0])
            self.halves[self.sign].extend(points)
            return
        for point in points:
            self.count += 1
            if self.begin is None:
                self.begin = point
            else:
                self.face(point)
                self.halves[self.sign].append(point)
            if self.on_point is not None:
                self.on_point(self.count)

    def face(self, point: Point) -> None:
        """Know the half that a point goes on with."""
        assert self.begin is not None
        if point.index == 1:
            rises = self.direction == 0 or (point.parameter - self.begin.parameter) * self.direction >= 0.0
            self.sign = 1 if rises and not self.halves[1] else -1
        elif not self.halves[self.sign] or self.halves[self.sign][-1].index + 1 != point.index:
            self.sign = -self.sign

    def event(self, event: Event) -> None:
        if self.found is not None:
            self.found.append(event)
        if self.on_event is None:
            return
        orbit = Orbit(self.problem, event.point.extra)
        self.types[event.code] = self.types.get(event.code, 0) + 1
        number = self.sign * event.index
        columns = orbit.described.columns
        self.on_event(event_of(event, f"{event.code}{self.types[event.code]}", 0, number, columns, 0, backward=self.sign < 0))

    def partial(self, reason: str, text: str) -> Branch | None:
        if self.begin is None:
            return None
        first = [*reversed(self.halves[-1]), self.begin]
        points = [*first, *self.halves[1]]
        lead = self.halves[-1][-1].arclength if self.halves[-1] else 0.0
        arclength = np.array([lead - p.arclength for p in first] + [lead + p.arclength for p in self.halves[1]])
        ended = Ended(reason, text)
        columns = describe(self.problem, [p.step.extra for p in points], arclength).columns
        return Branch(self.problem, columns, (), (ended, ended), len(first) - 1, self.energy)
