"""The reference paper's own method as one of the bench: shooting in nonsmooth time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bvp.nonsmooth_time import NonsmoothTimeOrbit, solve_nonsmooth_time
from saltus.bench.answers import Answer, OrbitAnswer
from saltus.bench.methods import Work
from saltus.bench.tasks import OrbitTask, Task

__all__ = ["NONSMOOTH", "NonsmoothTime"]

AWAY = 0.01
"""An impact that is off by this part of a quarter period is one of another orbit."""


@dataclass(frozen=True)
class NonsmoothTime:
    """Shooting in nonsmooth time; it gives orbits and their energies, and nothing of their stability."""

    name = "nonsmooth time (the paper's)"
    setting = "matched to"

    def missing(self) -> str | None:
        """See `saltus.bench.methods.Method`."""
        return None

    def does(self, task: Task) -> bool:
        """See `saltus.bench.methods.Method`."""
        return isinstance(task, OrbitTask)

    def ladder(self, tolerances: tuple[float, ...]) -> tuple[float | None, ...]:
        """See `saltus.bench.methods.Method`."""
        return tolerances

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


NONSMOOTH = (NonsmoothTime(),)
