"""Sweeps of one parameter of a system: up and down, from several starts, in parallel, and their data as a table."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bvp.motion import MotionStatus
from transitions.sweep.forced import Carried, harmonics_of, require_inside
from transitions.sweep.sweep import Sweep, SweepSettings, join_sweeps, sweep

if TYPE_CHECKING:
    from branches.tables import Table
    from bvp.forcing import Force
    from bvp.parameters import ParametricSystem
    from bvp.system import ImpactSystem

__all__ = ["AlongParameter", "SweepPlan", "SweepRun", "check_plan", "failures", "run_sweeps", "sweeps_table"]

PIECES = 16
"""Least number of pieces of a sweep, each one task of a process. After each of them progress is reported, and an interrupt can end it."""

LONGEST = 64
"""Most values of a piece: what an interrupt can lose."""


@dataclass(frozen=True, eq=False)
class AlongParameter:
    """A system and its loads as a function of one parameter; the other ones keep their values."""

    parametric: ParametricSystem
    name: str

    def __call__(self, value: float) -> tuple[ImpactSystem, tuple[Force, ...]]:
        values = {self.name: value}
        return self.parametric.system(values), self.parametric.forces(values)


@dataclass(frozen=True, eq=False)
class SweepPlan:
    """Sweeps over the same values of a parameter.

    Attributes
    ----------
    at : AlongParameter
    low, high : float
    points : int
        Values from low to high.
    directions : tuple of str
        "up", "down" or both.
    starts : tuple of (2n,) ndarray
        (u, v) at the first value of each sweep; empty: rest.
    settings : SweepSettings
    """

    at: AlongParameter
    low: float
    high: float
    points: int
    directions: tuple[str, ...] = ("up", "down")
    starts: tuple[np.ndarray, ...] = ()
    settings: SweepSettings = SweepSettings()

    def values(self, direction: str) -> np.ndarray:
        """The values in the order of a sweep."""
        values = np.linspace(self.low, self.high, self.points)
        return values if direction == "up" else values[::-1].copy()


@dataclass(frozen=True, eq=False)
class SweepRun:
    """One sweep of a plan: its direction, "up" or "down", and the number of its start, from 1."""

    sweep: Sweep
    direction: str
    start: int


def check_plan(plan: SweepPlan) -> None:
    """Raise a ValueError for what would stop a sweep later: loads without a period, a value that the parameter cannot have (1000 values at
    most are tried), a start beyond a stop."""
    harmonics_of(plan.at.parametric.forces())
    values = plan.values("up")
    for value in values[np.linspace(0, len(values) - 1, min(len(values), 1000)).astype(int)].tolist():
        why = plan.at.parametric.violation({plan.at.name: value})
        if why is not None:
            raise ValueError(why)
    for direction in plan.directions:
        system, _ = plan.at(float(plan.values(direction)[0]))
        n = system.degrees_of_freedom
        for start in plan.starts:
            require_inside(system, start[:n], start[n:])


def run_sweeps(
    plan: SweepPlan, executor: Executor | None = None, on_progress: Callable[[int], object] | None = None
) -> tuple[list[SweepRun], bool]:
    """All sweeps of a plan, here or beside each other in an executor's processes.

    Returns them, and whether Ctrl-C came: they then end with the last piece that was finished."""
    jobs = [_Job(plan, direction, k) for k in range(max(1, len(plan.starts))) for direction in plan.directions]
    interrupted = False
    done = 0
    try:
        for count in _pieces(jobs, executor):
            done += count
            if on_progress is not None:
                on_progress(done)
    except KeyboardInterrupt:
        interrupted = True
    found = [SweepRun(join_sweeps(job.parts), job.direction, job.number + 1) for job in jobs if job.parts]
    if interrupted and not found:
        raise KeyboardInterrupt
    return found, interrupted


class _Job:
    """One sweep: the pieces that are finished, and what the next one starts from."""

    def __init__(self, plan: SweepPlan, direction: str, number: int) -> None:
        self.direction, self.number = direction, number
        self.waiting = np.array_split(plan.values(direction), min(max(PIECES, plan.points // LONGEST), plan.points))
        self.carried = Carried(plan.starts[number]) if plan.starts else None
        self.at, self.settings = plan.at, plan.settings
        self.parts: list[Sweep] = []

    @property
    def task(self) -> tuple[AlongParameter, np.ndarray, Carried | None, SweepSettings]:
        return self.at, self.waiting[0], self.carried, self.settings

    def take(self, result: tuple[Sweep, Carried]) -> int:
        """Take the next piece; the number of its values."""
        part, self.carried = result
        self.parts.append(part)
        return len(self.waiting.pop(0))


def _pieces(jobs: Sequence[_Job], executor: Executor | None) -> Iterator[int]:
    """Carry out the pieces of jobs: the number of values of each."""
    if executor is None:
        for job in jobs:
            while job.waiting:
                yield job.take(_piece(*job.task))
        return
    futures: dict[Future[tuple[Sweep, Carried]], _Job] = {executor.submit(_piece, *job.task): job for job in jobs}
    while futures:
        for future in wait(futures, return_when=FIRST_COMPLETED).done:
            job = futures.pop(future)
            count = job.take(future.result())
            if job.waiting:
                futures[executor.submit(_piece, *job.task)] = job
            yield count


def _piece(at: AlongParameter, values: np.ndarray, start: Carried | None, settings: SweepSettings) -> tuple[Sweep, Carried]:
    """A piece of a sweep, in a process."""
    return sweep(at, values, start=start, settings=settings)


def sweeps_table(runs: Sequence[SweepRun]) -> Table:
    """The data as one table, a row for each value of each sweep.

    direction, start: of the sweep; value: of the parameter; frequency: base frequency of the loads; period: in periods of the loads, 0 for
    none; exponent: largest Lyapunov exponent, NaN also for -inf, where vanishing is 1; impacts, work: in a period; sticking: part of the
    time; moved: distance by which a gap was moved to its stop; ended: how the simulation ended; max.NAME: largest displacements;
    dissipated.NAME: in a period; strobe_u.NAME, strobe_v.NAME: states at phase 0; impact_contacts, impact_periods, impact_phases,
    impact_speeds: of each impact.
    """
    first = runs[0].sweep
    n = len(first.coordinates)
    sweeps = [run.sweep for run in runs]

    def joined(name: str) -> np.ndarray:
        return np.concatenate([getattr(found, name) for found in sweeps])

    exponents = joined("exponents")
    table: Table = {
        "direction": np.array([run.direction for run in runs for _ in range(len(run.sweep))]),
        "start": np.array([run.start for run in runs for _ in range(len(run.sweep))], dtype=np.int64),
        "value": joined("values"),
        "frequency": joined("loads"),
        "period": joined("periods"),
        "exponent": np.where(np.isfinite(exponents), exponents, math.nan),
        "vanishing": np.isneginf(exponents).astype(np.int64),
        "impacts": joined("impact_rates"),
        "sticking": joined("sticking"),
        "work": joined("work"),
        "moved": joined("moved"),
        "released": np.array([" ".join(letters) for found in sweeps for letters in found.released]),
        "ended": np.array([status.name.lower() for found in sweeps for status in found.statuses]),
    }
    peaks, dissipated = joined("peaks"), joined("dissipated")
    for k, name in enumerate(first.coordinates):
        table[f"max.{name}"] = peaks[:, k]
    for k, name in enumerate(first.parts):
        table[f"dissipated.{name.replace(' ', '_')}"] = dissipated[:, k]
    for k, name in enumerate(first.coordinates):
        table[f"strobe_u.{name}"] = [_present(states[:, k]) for found in sweeps for states in found.states]
        table[f"strobe_v.{name}"] = [_present(states[:, n + k]) for found in sweeps for states in found.states]
    for name in ("contacts", "periods", "phases", "speeds"):
        table[f"impact_{name}"] = [
            part for found in sweeps for part in np.split(getattr(found, f"impact_{name}"), found.offsets[1:-1])
        ]  # fmt: skip
    return table


def _present(values: np.ndarray) -> np.ndarray:
    """Without the NaN after the end of a simulation."""
    return values[np.isfinite(values)]


def failures(runs: Sequence[SweepRun]) -> dict[MotionStatus, int]:
    """How many simulations did not reach their end, by their status."""
    ended = [status for run in runs for status in run.sweep.statuses if status is not MotionStatus.DURATION_REACHED]
    return {status: ended.count(status) for status in dict.fromkeys(ended)}
