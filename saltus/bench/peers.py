"""Other ways to the same orbits as methods of the bench: the reference paper's shooting in nonsmooth time, scipy's solve_bvp, AUTO-07p."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from bvp.nonsmooth_time import NonsmoothTimeOrbit, solve_nonsmooth_time
from saltus.bench import auto
from saltus.bench.answers import Answer, OrbitAnswer
from saltus.bench.collocation import solve_collocation
from saltus.bench.methods import SHORT_STEP, Method, Work
from saltus.bench.tasks import LocateTask, OrbitTask, Task

__all__ = ["PEERS", "Auto07p", "Collocation", "NonsmoothTime"]

AWAY = 0.01
"""An impact that is off by this part of a quarter period is one of another orbit."""


@dataclass(frozen=True)
class NonsmoothTime(Method):
    """Shooting in nonsmooth time; it gives orbits and their energies, and nothing of their stability."""

    name = "nonsmooth time (the paper's)"
    setting = "matched to"

    def prepare(self, task: Task, setting: float | None) -> Work:
        """See `saltus.bench.methods.Method`."""
        assert isinstance(task, OrbitTask) and setting is not None
        velocities = task.start_velocities(task.guess())
        times = np.cumsum(task.problem.flight_times(task.unknowns()))[:-1]
        return Work(lambda: _solve(task, velocities, times, setting))


def _solve(task: OrbitTask, velocities: np.ndarray, expected: np.ndarray, tolerance: float) -> Answer:
    """The orbit, refused where its impacts are not near the expected ones (k,)."""
    found: NonsmoothTimeOrbit = solve_nonsmooth_time(task.system, task.alpha, velocities, tolerance=tolerance)
    # Half a period has the impacts of the solved segment; of a quarter those after it too.
    times = np.array([task.alpha * (1.0 + impact.tau) for impact in found.half])
    if task.problem.quarters == 1:
        middle = [task.alpha] if task.ends[1].startswith("stop") else []
        whole = np.concatenate([expected, middle, 2.0 * task.alpha - expected[::-1]])
    else:
        whole = expected
    if len(times) != len(whole) or np.any(np.abs(times - whole) > AWAY * task.alpha):
        raise RuntimeError(f"another orbit was found, with {len(times)} impacts in half a period in place of {len(whole)}, or elsewhere")
    return Answer(orbits=(OrbitAnswer(task.alpha, found.h, found.velocities, times[: len(expected)]),))


@dataclass(frozen=True)
class Collocation(Method):
    """`scipy.integrate.solve_bvp` on the multi-segment form; it gives orbits and their energies, and nothing of their stability."""

    name = "solve_bvp"
    setting = "tol"

    def prepare(self, task: Task, setting: float | None) -> Work:
        """See `saltus.bench.methods.Method`."""
        assert isinstance(task, OrbitTask) and setting is not None
        guess = task.guess()
        # Its matrices have a place for every pair of states at every node: no more than some hundred megabytes of them.
        most = int(min(20_000, ENTRIES / (4 * (len(task.word) + 1)) ** 2))

        def solve() -> Answer:
            found = solve_collocation(task.problem, guess, quarter_period=task.alpha, tolerance=setting, most_nodes=most)
            return Answer(orbits=(_orbit(task, found.unknowns, found.energy),))

        return Work(solve)


ENTRIES = 1e7
"""Most entries of a matrix of solve_bvp."""


@dataclass(frozen=True)
class Auto07p(Method):
    """AUTO-07p on the multi-segment form: continuation in the energy, and folds. It has no multipliers for such problems."""

    name = "AUTO-07p"
    setting = "NTST"

    def missing(self) -> str | None:
        """See `saltus.bench.methods.Method`."""
        return auto.missing()

    def does(self, task: Task) -> bool:
        """See `saltus.bench.methods.Method`."""
        return isinstance(task, OrbitTask | LocateTask)

    def ladder(self, tolerances: tuple[float, ...]) -> tuple[float | None, ...]:
        """Mesh intervals, with seven collocation points each; with the mesh, not the tolerance, goes the error."""
        return INTERVALS if len(tolerances) > len(INTERVALS) else INTERVALS[1:2]

    def prepare(self, task: Task, setting: float | None) -> Work:
        """See `saltus.bench.methods.Method`."""
        assert setting is not None
        intervals = int(setting)
        if isinstance(task, LocateTask):
            return Work(lambda: _folds(task, intervals), lambda: _folds(task, intervals))
        assert isinstance(task, OrbitTask)
        return Work(lambda: _auto(task, intervals, timed=False), lambda: _auto(task, intervals, timed=True))


INTERVALS = (1.0, 2.0, 4.0)
LONG, SHORT = 1800, 90
"""Points of the runs whose difference in time is divided by that of their points, for one flight; of k flights it is a k-th part."""

REPEATS = 8
"""Runs of either length, of which the fastest counts: starting AUTO takes longer than the points do, and not always equally long."""


def _auto(task: OrbitTask, intervals: int, timed: bool) -> Answer:
    """A few points of a family by AUTO, and, where timed, the seconds of one."""
    problem, y = task.problem, task.unknowns()
    settings = auto.AutoSettings(intervals=intervals, step=SHORT_STEP, points=4)
    with auto.Auto() as there:
        run = there.follow(problem, y, settings)
        parts = len(task.word) + 1
        seconds = None
        if timed:
            cost = there.time_a_point(problem, y, settings, short=SHORT // parts, long=LONG // parts, repeats=REPEATS)
            seconds = cost.seconds if math.isnan(cost.processor) else cost.processor
    orbits = tuple(_orbit(task, point.unknowns(problem), point.h) for point in run.points)
    return Answer(len(orbits), seconds, orbits)


def _folds(task: LocateTask, intervals: int) -> Answer:
    """The folds among the special points; AUTO sees no loss of symmetry in such problems. Their time is that of its whole process, without
    that of compiling the equations, which the first of two runs does."""
    located, seconds = {}, 0.0
    for name, wanted in task.wanted:
        if wanted.type != "SN":
            continue
        family = wanted.family
        settings = auto.AutoSettings(intervals=intervals, step=-0.05, points=8, folds=True)
        with auto.Auto() as there:
            run = [there.follow(family.problem, family.unknowns(), settings) for _ in range(2)][1]
        seconds += run.seconds if math.isnan(run.processor) else run.processor
        if len(run.folds) != 1:
            raise RuntimeError(f"AUTO met {len(run.folds)} folds in place of one")
        located[name] = (run.folds[0].quarter_period(family.problem), run.folds[0].h)
    return Answer(len(located), seconds / len(located), located=located)


def _orbit(task: OrbitTask, unknowns: np.ndarray, energy: float) -> OrbitAnswer:
    """The answer that unknowns of the multipoint problem are."""
    problem = task.problem
    times = np.cumsum(problem.flight_times(unknowns))[:-1]
    return OrbitAnswer(problem.quarter_period(unknowns), energy, task.start_velocities(unknowns), times, None, unknowns)


PEERS = (NonsmoothTime(), Collocation(), Auto07p())
