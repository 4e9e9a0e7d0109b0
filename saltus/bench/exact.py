"""The methods of saltus: the exact multipoint problem, followed along its family, with multipliers by three routes or without."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from branches.family import Family
from branches.stability import describe
from branches.tracing import SETTINGS, follow_family
from bvp.cycle import cycle_of
from bvp.damped import Mover
from bvp.multipliers import saddle_point_multipliers
from bvp.multipoint import Solution
from bvp.saltation import saltation_multipliers
from continuation.settings import Settings
from saltus.bench.answers import Answer, OrbitAnswer
from saltus.bench.breakdown import breakdown
from saltus.bench.following import BareFamily, least_time
from saltus.bench.methods import OWN, OWN_SHORT, SHORT_STEP, Method, Work
from saltus.bench.tasks import LocateTask, OrbitTask, RunTask, Task

__all__ = ["EXACT", "Saltus"]

POINTS = 32
RUNS = 25
SECONDS = 0.3
LOOKED_AT = 4
"""Points of a run; runs for the layers, and seconds of runs for the time of a point; points whose error is measured: the last of so many
parts of the run."""


@dataclass(frozen=True)
class Saltus(Method):
    """The exact multipoint problem along a family.

    Parameters
    ----------
    name : str
    route : str
        Multipliers: "half map" (those that every point has), "saddle point", "saltation" (computed beside them, and timed with them), or
        "none".
    layers : bool
        Whether the time of a point is taken apart.
    settings : continuation.Settings
        How a family is followed.
    """

    name: str
    route: str
    layers: bool = False
    settings: Settings = SETTINGS

    setting = ""

    def does(self, task: Task) -> bool:
        """See `saltus.bench.methods.Method`."""
        return isinstance(task, OrbitTask) or self.name == OWN

    def ladder(self, tolerances: tuple[float, ...]) -> tuple[float | None, ...]:
        """See `saltus.bench.methods.Method`."""
        return (None,)

    def prepare(self, task: Task, setting: float | None) -> Work:
        """See `saltus.bench.methods.Method`."""
        if isinstance(task, OrbitTask):
            return Work(lambda: self._one(task), lambda: self._follow(task))
        return Work((lambda: _run(task)) if isinstance(task, RunTask) else (lambda: _locate(task)))

    def _multipliers(self, task: OrbitTask, solutions: list[Solution]) -> list[np.ndarray | None]:
        """Multipliers of solutions, by this route."""
        if self.route == "none":
            return [None] * len(solutions)
        if self.route == "half map":
            return list(describe(task.problem, solutions).columns["multipliers"])
        cycles = [cycle_of(task.problem, solution.y) for solution in solutions]
        if self.route == "saltation":
            return [saltation_multipliers(cycle) for cycle in cycles]
        return [saddle_point_multipliers(cycle).values for cycle in cycles]

    def _one(self, task: OrbitTask) -> Answer:
        """The orbit alone, from a start value."""
        solution = task.problem.solve(task.guess(), quarter_period=task.alpha)
        return Answer(orbits=tuple(_answers(task, [solution], self._multipliers(task, [solution]))))

    def _follow(self, task: OrbitTask) -> Answer:
        problem, y = task.problem, task.unknowns()
        family = BareFamily(problem) if self.route == "none" else Family(problem)
        run, seconds = least_time(family, y, POINTS, self.settings, SECONDS)
        solutions: list[Solution] = [step.extra for step in run.steps]
        chosen = sorted({(len(solutions) * part) // LOOKED_AT - 1 for part in range(1, LOOKED_AT + 1)} - {-1})
        began = time.process_time()
        multipliers = self._multipliers(task, solutions)
        if self.route in ("saddle point", "saltation"):
            # Those of the half map are in every point already.
            seconds += (time.process_time() - began) / len(solutions)
        layers = None
        if self.layers:
            parts = breakdown(problem, y, POINTS, RUNS)
            layers = {
                "compiled": parts.compiled, "entering": parts.entering, "family": parts.family, "engine": parts.engine,
                "total": parts.total.least,
            }  # fmt: skip
        orbits = _answers(task, [solutions[i] for i in chosen], [multipliers[i] for i in chosen])
        return Answer(len(solutions), seconds, tuple(orbits), layers=layers)


def _answers(task: OrbitTask, solutions: list[Solution], multipliers: list[np.ndarray | None]) -> list[OrbitAnswer]:
    problem = task.problem
    return [
        OrbitAnswer(
            problem.quarter_period(solution.y), solution["energy"], task.start_velocities(solution.y),
            np.cumsum(problem.flight_times(solution.y))[:-1], values, solution.y,
        )
        for solution, values in zip(solutions, multipliers, strict=True)
    ]  # fmt: skip


def _run(task: RunTask) -> Answer:
    motion = Mover(task.system).run([0.0, 0.0], task.velocities, 1e9, task.impacts)
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
            raise RuntimeError(f"no {wanted.type} was met")
        found[name] = (event.alpha, event.h)
    return Answer(len(task.wanted), located=found)


EXACT = (
    Saltus(OWN, "half map", layers=True),
    Saltus(OWN_SHORT, "half map", settings=replace(SETTINGS, initial_step=SHORT_STEP, maximum_step=SHORT_STEP)),
    Saltus("saltus, orbit only", "none"),
    Saltus("saltus, saddle-point matrix", "saddle point"),
    Saltus("saltus, saltation product", "saltation"),
)
