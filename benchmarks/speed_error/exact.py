"""The methods of saltus: the exact multipoint problem along its family, with multipliers by three routes or without."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.following import BareFamily, layers_of, least_time
from benchmarks.measure import timed
from benchmarks.saltation import saltation_multipliers
from benchmarks.speed_error.methods import OWN, OWN_SHORT, SHORT_STEP, Answer, Method, OrbitAnswer, Task, Work
from benchmarks.speed_error.tasks import LocateTask, OrbitTask, RunTask
from branches.family import Family
from branches.orbit import orbit_columns
from branches.tracing import SETTINGS, follow_family
from bvp.closures import cycle_of
from bvp.multipliers import saddle_point_multipliers
from bvp.multipoint import Solution
from bvp.simulate import Simulator
from continuation.control import Settings

__all__ = ["EXACT", "Saltus"]

POINTS = 32
"""Points of a run."""

SHORT_POINTS = 512
"""Points of a run with short steps: so many that its start does not count, as in the time of AUTO-07p."""

RUNS = 25
"""Runs for the layers."""

SECONDS = 0.3
"""Seconds of runs for the time of a point."""

CHECKED = 4
"""Number of points whose error is measured: the last one of each of this many parts of the run."""


@dataclass(frozen=True)
class Saltus(Method):
    """The exact multipoint problem along a family.

    Parameters
    ----------
    name : str
    route : str
        Of the multipliers: "half map" (part of every point), "saddle point" or "saltation" (computed and timed in addition), or "none".
    layers : bool
        Whether the time of a point is measured layer by layer.
    following : continuation.Settings
        How a family is followed.
    """

    name: str
    route: str
    layers: bool = False
    following: Settings = SETTINGS

    setting = ""

    def does(self, task: Task) -> bool:
        return isinstance(task, OrbitTask) or self.name == OWN

    def settings(self, tolerances: tuple[float, ...]) -> tuple[float | None, ...]:
        return (None,)

    def prepare(self, task: Task, setting: float | None) -> Work:
        if isinstance(task, OrbitTask):
            return Work(lambda: self._one(task), lambda: self._follow(task))
        if isinstance(task, RunTask):
            return Work(lambda: _simulate(task))
        assert isinstance(task, LocateTask)
        return Work(lambda: _locate(task))

    def _multipliers(self, task: OrbitTask, solutions: list[Solution]) -> list[np.ndarray | None]:
        """Multipliers of solutions, by this route."""
        if self.route == "none":
            return [None] * len(solutions)
        if self.route == "half map":
            return list(orbit_columns(task.problem, solutions)["multipliers"])
        cycles = [cycle_of(task.problem, solution.y) for solution in solutions]
        if self.route == "saltation":
            return [saltation_multipliers(cycle) for cycle in cycles]
        return [saddle_point_multipliers(cycle).values for cycle in cycles]

    def _one(self, task: OrbitTask) -> Answer:
        """The orbit alone, from a start value."""
        solution = task.problem.solve(task.guess(), quarter_period=task.alpha)
        return Answer(orbits=tuple(_answers(task, [solution], self._multipliers(task, [solution]))))

    def _follow(self, task: OrbitTask) -> Answer:
        """Points of the family from the orbit upward, with the time of one."""
        problem, y = task.problem, task.unknowns()
        family = BareFamily(problem) if self.route == "none" else Family(problem)
        points = POINTS if self.following is SETTINGS else SHORT_POINTS
        run, seconds = least_time(family, y, points, self.following, SECONDS)
        solutions: list[Solution] = [step.extra for step in run.steps]
        checked = sorted({(len(solutions) * part) // CHECKED - 1 for part in range(1, CHECKED + 1)} - {-1})
        multipliers, extra = timed(self._multipliers, task, solutions)
        if self.route in ("saddle point", "saltation"):
            # The multipliers of the half map are already part of every point.
            seconds += extra / len(solutions)
        layers = None
        if self.layers:
            parts = layers_of(problem, y, POINTS, RUNS)
            layers = {name: list(getattr(parts, name)) for name in ("compiled", "entering", "family", "engine")}
            layers["total"] = [parts.total.least, parts.total.median - parts.total.least]
        orbits = _answers(task, [solutions[i] for i in checked], [multipliers[i] for i in checked])
        return Answer(len(solutions), seconds, tuple(orbits), layers=layers)


def _answers(task: OrbitTask, solutions: list[Solution], multipliers: list[np.ndarray | None]) -> list[OrbitAnswer]:
    return [
        task.answer(solution.y, solution["energy"], values) for solution, values in zip(solutions, multipliers, strict=True)
    ]


def _simulate(task: RunTask) -> Answer:
    motion = Simulator(task.system).run([0.0, 0.0], task.velocities, 1e9, task.impacts)
    if motion.impacts != task.impacts:
        raise RuntimeError(f"the run ended after {motion.impacts} impacts: {motion.status.value}")
    return Answer(task.impacts, ran=(motion.duration, motion.final, motion.energy))


def _locate(task: LocateTask) -> Answer:
    found = {}
    for name, wanted in task.wanted:
        family = wanted.family
        branch = follow_family(family.problem, family.unknowns(), direction="down", stop_at=wanted.type)
        event = next((event for event in branch.events if event.type == wanted.type), None)
        if event is None:
            raise RuntimeError(f"the family has no {wanted.type}")
        found[name] = (event.alpha, event.h)
    return Answer(len(task.wanted), located=found)


EXACT = (
    Saltus(OWN, "half map", layers=True),
    Saltus(OWN_SHORT, "half map", following=replace(SETTINGS, initial_step=SHORT_STEP, maximum_step=SHORT_STEP)),
    Saltus("saltus, orbit only", "none"),
    Saltus("saltus, saddle-point matrix", "saddle point"),
    Saltus("saltus, saltation product", "saltation"),
)
"""The methods of saltus."""
