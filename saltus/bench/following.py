"""Time of a point that saltus accepts: the engine's run, measured from point to point, with all that is known of an orbit and without."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from branches.family import Family
from branches.tracing import SETTINGS
from bvp.multipoint import RESULT_INDEX, MultipointProblem, Solution
from continuation.control import kinds_of
from continuation.ends import End, EndReason
from continuation.engine import Allowance, first_step, walk
from continuation.location import Location
from continuation.points import PlainPoints
from continuation.problem import Event, EventDetails, Marched, Point, Problem, Step, Test
from continuation.settings import Settings

__all__ = ["BareFamily", "RecordedFamily", "Run", "Spread", "least_time", "spread", "timed_run", "timed_runs"]

TOGETHER = 8
"""Runs whose mean is one measurement."""


class Spread(NamedTuple):
    """Least and median of repeated measurements of one thing."""

    least: float
    median: float


def spread(values: list[float]) -> Spread:
    """Least and median of one or more numbers."""
    return Spread(min(values), float(np.median(values)))


class BareFamily(Family):
    """A family whose points are orbits and no more: no multipliers, no admissibility, no half-waves; the fold is its only test.

    Parameters
    ----------
    problem : MultipointProblem
    """

    def __init__(self, problem: MultipointProblem) -> None:
        super().__init__(problem)
        self._tests = (Test("SN", "crossing", False, "fold in the energy", True),)
        self._kinds = np.array(kinds_of(self._tests))
        self._full = False

    def begin(self, y: np.ndarray) -> Step:
        """See `continuation.Problem`."""
        return self._step(self.problem.step(y, np.zeros(2 * self.problem.unknowns), 0.0, full=False))

    def step(self, y: np.ndarray, tangent: np.ndarray, ds: float) -> Step:
        """See `continuation.Problem`."""
        return self._step(self.problem.step(y, tangent, ds, full=False))

    def _step(self, solution: Solution | None) -> Step:
        if solution is None:
            return _FAILED
        result = solution.result.tolist()
        residual = result[_RESIDUAL]
        slope = result[_SLOPE]
        if not residual < 1e-12:
            return _FAILED
        return Step(
            True, solution.y, solution.tangent, tuple(solution.position.tolist()), result[_TURN], result[_CONTRACTION],
            int(result[_ITERATIONS]), residual, result[_ENERGY], slope, [slope], solution,
        )  # fmt: skip

    def classify(self, index: int, before: Point, at: Step, after: Point, location: Location) -> EventDetails:
        """See `continuation.Problem`."""
        return EventDetails("SN")


_RESIDUAL, _SLOPE, _TURN, _CONTRACTION, _ITERATIONS, _ENERGY = (
    RESULT_INDEX[name] for name in ("residual", "slope", "turn", "contraction", "iterations", "energy")
)
_FAILED = Step(False, np.empty(0), np.empty(0), (), 0.0, float("inf"), 0, float("inf"), float("nan"), float("nan"), [])


class RecordedFamily(Family):
    """A family that keeps the arguments of each march that it is asked for, and the steps that it accepted in it."""

    def __init__(self, problem: MultipointProblem) -> None:
        super().__init__(problem)
        self.marches: list[tuple[Any, ...]] = []
        self.marched: list[Step] = []
        self.tried = 0

    def _march(self, *arguments: Any) -> Marched:
        found = super()._march(*arguments)
        self.marches.append(arguments)
        self.marched += found.steps
        self.tried += found.trial is not None
        return found


@dataclass(frozen=True, eq=False)
class Run:
    """One run of the engine.

    Parameters
    ----------
    steps : list of Step
        The accepted points after the start, without those at events.
    seconds : (N,) float
        Of the processor, from one accepted point to the next, refused steps and event location included.
    clean : (N,) bool
        No event was located on the way to the point.
    events : int
        Events located.
    """

    steps: list[Step]
    seconds: np.ndarray
    clean: np.ndarray
    events: int

    @property
    def clean_point(self) -> float:
        """Mean seconds of an accepted point on whose way no event lies."""
        return float(np.mean(self.seconds[self.clean]))

    @property
    def any_point(self) -> float:
        """Mean seconds of an accepted point, event location included."""
        return float(np.mean(self.seconds))


def timed_run(family: Problem, start: Step, points: int, settings: Settings = SETTINGS) -> Run:
    """Follow a family to higher energy, and take the processor time of each point.

    Points come in blocks: the first of a block has the time of all of it, and of the step that ended it. Means are right; no more points
    are computed than are counted. Those of a block stay in its arrays while time is taken, with all that is known of them.

    Parameters
    ----------
    family : continuation.Problem
    start : Step
        As `family.begin` gives it.
    points : int
        Accepted points after the start; fewer where the family ends before.
    settings : continuation.Settings

    Raises
    ------
    RuntimeError
        Where there is no point without an event on its way to measure.
    """
    clock = time.process_time
    allowance = Allowance(points + 1, resume=True)
    first = first_step(family, start, 1)
    if isinstance(first, str):
        raise RuntimeError(first)
    run = walk(family, first, settings, None, (), allowance)
    next(run)
    found: list[Sequence[Point]] = []
    count = 0
    seconds: list[float] = []
    clean: list[bool] = []
    events = on_the_way = 0
    last = clock()
    for item in run:
        now = clock()
        if isinstance(item, Event):
            on_the_way += 1
        elif isinstance(item, End):
            if item.reason is not EndReason.POINTS:
                break
            allowance.points = points - count
        elif isinstance(item, PlainPoints) or item.event is None:
            piece: Sequence[Point] = item if isinstance(item, PlainPoints) else (item,)
            found.append(piece)
            count += len(piece)
            seconds += [now - last, *[0.0] * (len(piece) - 1)]
            clean += [on_the_way == 0] * len(piece)
            events += on_the_way
            on_the_way = 0
            if count == points:
                break
            last = clock()
    if not any(clean):
        raise RuntimeError("every step of the run has an event in it: nothing to measure; start elsewhere on the family")
    return Run([point.step for piece in found for point in piece], np.array(seconds), np.array(clean), events)


def timed_runs(family: Problem, y: np.ndarray, points: int, repeats: int, settings: Settings = SETTINGS) -> list[Run]:
    """Repeat a run after one that is not measured, from unknowns y."""
    start = family.begin(y)
    timed_run(family, start, points, settings)
    return [timed_run(family, start, points, settings) for _ in range(repeats)]


def least_time(family: Problem, y: np.ndarray, points: int, settings: Settings, seconds: float) -> tuple[Run, float]:
    """A run, and the least mean time of a point without an event on its way, of `TOGETHER` runs one after another, in some seconds.

    A machine that others use, too, is slow for a while at a time, and a clock that is asked often stands still at times.
    """
    start = family.begin(y)
    first = timed_run(family, start, points, settings)
    least = math.inf
    began = time.process_time()
    while least == math.inf or time.process_time() - began < seconds:
        runs = [timed_run(family, start, points, settings) for _ in range(TOGETHER)]
        least = min(least, float(np.mean([run.clean_point for run in runs])))
    return first, least
