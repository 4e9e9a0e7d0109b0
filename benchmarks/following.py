"""Time for each point that saltus accepts: in a complete run, for the orbit alone, and layer by layer.

A point's layers are compiled arithmetic, the call into compiled code, and the Python around it. They are measured from the blocks of steps
of a run: the blocks are repeated with the same arguments, one layer at a time. The differences are what each layer costs.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.measure import Difference, Spread, difference, processor_time, spread
from branches.family import Family
from branches.steps import CoreSteps
from branches.tracing import SETTINGS
from bvp.multipoint import RESULT_INDEX, MultipointProblem, Solution
from continuation.control import Settings
from continuation.engine import Allowance, first_step, follow_in_blocks
from continuation.location import Location
from continuation.problem import Advance, End, EndReason, Event, EventDetails, PlainPoints, Point, Problem, Step, TestFunction

__all__ = ["BareFamily", "Layers", "RecordedFamily", "Run", "compiled_calls", "layers_of", "least_time", "timed_run", "timed_runs"]

Call = tuple[Callable[..., Any], tuple[Any, ...]]
"""A compiled function and its arguments."""

TOGETHER = 8
"""One measurement is the mean of this many runs."""


class BareFamily(Family):
    """A family whose points are orbits only: no multipliers, no admissibility, no half-waves. Its only test function is the fold."""

    def __init__(self, problem: MultipointProblem) -> None:
        super().__init__(problem)
        self.tests = (TestFunction("SN", "crossing", False, "fold in the energy", True),)
        self._computed = 1

    def begin(self, y: np.ndarray) -> Step:
        return self._step(self.problem.step(y, np.zeros(2 * self.problem.unknowns), 0.0, full=False))

    def step(self, y: np.ndarray, tangent: np.ndarray, ds: float) -> Step:
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
        return EventDetails("SN")


_RESIDUAL, _SLOPE, _TURN, _CONTRACTION, _ITERATIONS, _ENERGY = (
    RESULT_INDEX[name] for name in ("residual", "slope", "turn", "contraction", "iterations", "energy")
)
_FAILED = Step(False, np.empty(0), np.empty(0), (), 0.0, float("inf"), 0, float("inf"), float("nan"), float("nan"), [])


class RecordedFamily(Family):
    """A family that records the arguments of each block of steps, and the steps accepted in it.

    Attributes
    ----------
    blocks : list of tuple
        Arguments of each block.
    accepted : list of Step
    tried : int
        Blocks that ended with a step that the engine has to examine.
    """

    def __init__(self, problem: MultipointProblem) -> None:
        super().__init__(problem)
        self.blocks: list[tuple[Any, ...]] = []
        self.accepted: list[Step] = []
        self.tried = 0

    def _advance(self, *arguments: Any) -> Advance:
        found = super()._advance(*arguments)
        self.blocks.append(arguments)
        self.accepted += found.steps
        self.tried += found.trial is not None
        return found


@dataclass(frozen=True, eq=False)
class Run:
    """One run of the engine.

    Parameters
    ----------
    steps : list of Step
        The accepted points after the start, without the points at events.
    seconds : (N,) float
        Processor time from one accepted point to the next, including refused steps and event location.
    clean : (N,) bool
        No event was located between the previous point and this one.
    events : int
        Events located.
    """

    steps: list[Step]
    seconds: np.ndarray
    clean: np.ndarray
    events: int

    @property
    def clean_point(self) -> float:
        """Mean seconds of an accepted point without an event before it."""
        return float(np.mean(self.seconds[self.clean]))


def timed_run(family: Problem, start: Step, points: int, settings: Settings = SETTINGS) -> Run:
    """Follow a family to higher energy, for so many accepted points after the start, and measure the processor time of each.

    Points come in blocks. The first point of a block gets the time of the whole block and of the step that ended it, so only means are
    meaningful. The points of a block stay in its arrays while the time is measured.

    Raises
    ------
    RuntimeError
        If there is an event before every point.
    """
    clock = time.process_time
    allowance = Allowance(points + 1, resume=True)
    first = first_step(family, start, 1)
    if isinstance(first, str):
        raise RuntimeError(first)
    run = follow_in_blocks(family, first, settings, None, (), allowance)
    next(run)
    found: list[Sequence[Point]] = []
    count = 0
    seconds: list[float] = []
    clean: list[bool] = []
    events = events_before = 0
    last = clock()
    for item in run:
        now = clock()
        if isinstance(item, Event):
            events_before += 1
        elif isinstance(item, End):
            if item.reason is not EndReason.POINTS:
                break
            allowance.points = points - count
        elif isinstance(item, PlainPoints) or item.event is None:
            piece: Sequence[Point] = item if isinstance(item, PlainPoints) else (item,)
            found.append(piece)
            count += len(piece)
            seconds += [now - last, *[0.0] * (len(piece) - 1)]
            clean += [events_before == 0] * len(piece)
            events += events_before
            events_before = 0
            if count == points:
                break
            last = clock()
    if not any(clean):
        raise RuntimeError("every step of the run contains an event; start elsewhere on the family")
    return Run([point.step for piece in found for point in piece], np.array(seconds), np.array(clean), events)


def timed_runs(family: Problem, y: np.ndarray, points: int, repeats: int, settings: Settings = SETTINGS) -> list[Run]:
    """Repeat a run from unknowns y, after one that is not measured."""
    start = family.begin(y)
    timed_run(family, start, points, settings)
    return [timed_run(family, start, points, settings) for _ in range(repeats)]


def least_time(family: Problem, y: np.ndarray, points: int, settings: Settings, seconds: float) -> tuple[Run, float]:
    """Return a run and the least mean time of a point without an event before it.

    The mean is over `TOGETHER` consecutive runs, repeated for some seconds. On a shared machine the least mean is the least disturbed one,
    and a clock that is read too often is not reliable.
    """
    start = family.begin(y)
    first = timed_run(family, start, points, settings)
    least = math.inf
    began = time.process_time()
    while least == math.inf or time.process_time() - began < seconds:
        runs = [timed_run(family, start, points, settings) for _ in range(TOGETHER)]
        least = min(least, float(np.mean([run.clean_point for run in runs])))
    return first, least


@dataclass(frozen=True)
class Layers:
    """Seconds a point, layer by layer. The least total is measured directly. It is the sum of the layers, differences of least times."""

    inner: int  # number of inner impacts
    steps: float  # per point, as the next two
    iterations: float
    compiled_calls: float
    compiled: Difference  # arithmetic in compiled code
    entering: Difference  # passing the same arguments to compiled code and back
    family: Difference  # Python in `Family.advance` around the compiled call
    engine: Difference  # Python in the engine, per block
    total: Spread


def layers_of(problem: MultipointProblem, y: np.ndarray, points: int, repeats: int) -> Layers:
    """Measure the time of a point layer by layer, in a run of so many points from unknowns y. `repeats`: of each layer, two or more.

    Raises
    ------
    RuntimeError
        If no point comes from a block.
    """
    recorded = RecordedFamily(problem)
    timed_run(recorded, recorded.begin(y), points)
    family = Family(problem)
    seen, idle = compiled_calls(family, recorded.blocks), compiled_calls(family, recorded.blocks, room=0)
    accepted = len(recorded.accepted)
    if not accepted:
        raise RuntimeError(f"none of {points} points came from a block of steps; ask for more points")
    totals, families, kernels, nothings = [], [], [], []
    for _ in range(repeats):
        totals += [r.clean_point for r in timed_runs(family, y, points, 1)]
        families.append(_seconds([(family._advance, arguments) for arguments in recorded.blocks]) / accepted)
        kernels.append(_seconds(seen) / accepted)
        nothings.append(_seconds(idle) / accepted)
    total = spread(totals)
    return Layers(
        problem.inner,
        1.0 + recorded.tried / accepted,
        float(np.mean([step.iterations for step in recorded.accepted])),
        len(seen) / accepted,
        difference(kernels, nothings),
        difference(nothings, [0.0, 0.0]),
        difference(families, kernels),
        difference(totals, families),
        total,
    )


def _seconds(calls: list[Call]) -> float:
    """Processor time of all the calls together."""

    def repeat() -> None:
        for function, arguments in calls:
            function(*arguments)

    return processor_time(repeat)


def compiled_calls(family: Family, blocks: Iterable[tuple[Any, ...]], room: int | None = None) -> list[Call]:
    """Return the calls of compiled code by which a family takes blocks of steps, from the arguments of `Family.advance`. With room for no
    step, the arguments alone are handed over."""
    calls: list[Call] = []
    steps = family._steps
    assert isinstance(steps, CoreSteps)
    for recent, ds, goal, most, control in blocks:
        block = family._block(1 + (most if room is None else room))
        calls.append((steps.core.advance, steps.arguments(recent, ds, goal, control, block)))
    return calls
