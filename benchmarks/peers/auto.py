"""AUTO-07p on the multi-segment form: the same orbits by the standard program of the field, if it is installed.

Each flight of the segment is mapped to [0, 1]. All flights together are one boundary-value problem with the flight times as parameters and
the impacts as boundary conditions (`flights.f90`, with all derivatives). AUTO discretises it by collocation and follows it by
pseudo-arclength in the energy. It computes no multipliers for such a problem, and does not check whether a flight penetrates a stop.

Threads are turned off (`OMP_NUM_THREADS=1`): the problems are small, and saltus uses one thread as well.
"""

from __future__ import annotations

import math
import os
import shutil
import subprocess
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import NamedTuple

import numpy as np

from benchmarks.measure import Difference, difference, processor_of_children
from benchmarks.peers.auto_files import EQUATIONS, AutoError, AutoRun, AutoSettings, constants_text, last_lines, read_run, start_text
from benchmarks.speed_error.methods import SHORT_STEP, Answer, Method, Task, Work
from benchmarks.speed_error.tasks import LocateTask, OrbitTask
from bvp.forced import ForcedProblem
from bvp.multipoint import MultipointProblem

__all__ = ["Auto", "Auto07p", "PointTime", "missing"]

PROGRAMS = ("auto", "auto-07p")
"""Names of the program: the authors', and that of Debian's package auto-07p."""

COMPILER = "gfortran"

SECONDS = 600.0
"""Longest run of AUTO."""

INTERVALS = (1.0, 2.0, 4.0)
"""Numbers of mesh intervals."""

LONG, SHORT = 1800, 90
"""Points of a long and a short run of one flight; runs of k flights have a k-th of them. The time of a point is the difference of the times
divided by the difference of the numbers of points."""

REPEATS = 8
"""Runs of either length; the fastest counts. Starting AUTO takes longer than the points, and varies."""


class PointTime(NamedTuple):
    """Time of a point: by the clock, and of the processor, which other work on the machine does not affect."""

    seconds: Difference
    processor: Difference


def missing() -> str | None:
    """Return why AUTO-07p cannot be used here, or None."""
    if _program() is None:
        return f"no program {' or '.join(PROGRAMS)} is on the path (Debian package auto-07p)"
    if shutil.which(COMPILER) is None:
        return f"AUTO compiles its equations with {COMPILER}, which is not on the path"
    return None


def _program() -> str | None:
    return next((found for found in map(shutil.which, PROGRAMS) if found is not None), None)


class Auto:
    """A temporary folder in which AUTO works, as a context. The first run compiles the equations.

    Raises
    ------
    AutoError
        If the program is missing.
    """

    def __init__(self) -> None:
        reason = missing()
        if reason is not None:
            raise AutoError(reason)
        self._program = str(_program())
        self._holder = tempfile.TemporaryDirectory(prefix="saltus-auto-")
        self._folder = Path(self._holder.name)
        for name in (*(f"{equations}.f90" for equations in EQUATIONS.values()), "common.inc"):
            shutil.copy(Path(__file__).with_name(name), self._folder)

    def __enter__(self) -> Auto:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._holder.cleanup()

    def follow(self, problem: MultipointProblem | ForcedProblem, y: np.ndarray, settings: AutoSettings, *, keep: bool = True) -> AutoRun:
        """Follow a family from an orbit.

        Parameters
        ----------
        problem : MultipointProblem or ForcedProblem
            Of the linear oscillator with a vibro-impact sink, from the origin to another end; or of one harmonic load, in w.
        y : (u,) float
            The first orbit.
        settings : AutoSettings
        keep : bool
            Whether AUTO writes each point with all its digits, which takes time.

        Raises
        ------
        ValueError
            For another system, and for a segment that does not begin at the origin.
        AutoError
            If AUTO fails or does not converge.
        """
        equations = EQUATIONS[type(problem)]
        for name in ("points", "out"):
            (self._folder / f"{equations}.{name}").unlink(missing_ok=True)
        (self._folder / f"{equations}.start").write_text(start_text(problem, y, keep), encoding="ascii")
        (self._folder / f"c.{equations}").write_text(constants_text(problem, settings), encoding="ascii")
        script = self._folder / "follow.auto"
        script.write_text(f"run(e='{equations}', c='{equations}', sv='{equations}')\n", encoding="ascii")
        before = processor_of_children()
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        try:
            done = subprocess.run(
                [self._program, script.name], cwd=self._folder, env=environment, capture_output=True, text=True, errors="replace",
                timeout=SECONDS, stdin=subprocess.DEVNULL, check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            raise AutoError(f"AUTO was not done in {SECONDS:g} s") from None
        table = self._folder / f"b.{equations}"
        if done.returncode != 0 or not table.exists():
            raise AutoError(f"AUTO failed: {last_lines(done.stdout, done.stderr)}")
        points = (self._folder / f"{equations}.points").read_text(encoding="utf-8") if keep else ""
        run = read_run(done.stdout, table.read_text(encoding="utf-8"), points, problem.inner + 1)
        return replace(run, processor=processor_of_children() - before)

    def time_a_point(
        self, problem: MultipointProblem | ForcedProblem, y: np.ndarray, settings: AutoSettings, *, short: int = 100, long: int = 2100,
        repeats: int = 3,
    ) -> PointTime:  # fmt: skip
        """Time of a point, from the least times of short and long runs that keep nothing; two or more of each.

        The equations are compiled before. Processor time is accurate to some 20 ms divided by the difference in points.
        """
        self.follow(problem, y, replace(settings, points=2), keep=False)
        least = []
        for length in (short, long):
            runs = [self.follow(problem, y, replace(settings, points=length), keep=False) for _ in range(repeats)]
            least.append(([run.seconds for run in runs], [run.processor for run in runs], runs[0].count))
        (first, first_processor, few), (last, last_processor, many) = least
        if many <= few:
            raise AutoError(f"AUTO ended after {many} points: expected a shorter run or a smaller step")
        pairs = (last, first), (last_processor, first_processor)
        return PointTime(*(difference(*pair).per(many - few) for pair in pairs))


@dataclass(frozen=True)
class Auto07p(Method):
    """Continuation in the energy, and folds, by AUTO-07p."""

    name = "AUTO-07p"
    setting = "NTST"

    def missing(self) -> str | None:
        return missing()

    def does(self, task: Task) -> bool:
        return isinstance(task, OrbitTask | LocateTask)

    def settings(self, tolerances: tuple[float, ...]) -> tuple[float | None, ...]:
        """Mesh intervals with seven collocation points each: they, not the tolerance, determine the error."""
        return INTERVALS if len(tolerances) > len(INTERVALS) else INTERVALS[1:2]

    def prepare(self, task: Task, setting: float | None) -> Work:
        assert setting is not None
        intervals = int(setting)
        if isinstance(task, LocateTask):
            return Work(lambda: _folds(task, intervals), lambda: _folds(task, intervals))
        assert isinstance(task, OrbitTask)
        return Work(lambda: _follow(task, intervals, timed=False), lambda: _follow(task, intervals, timed=True))


def _follow(task: OrbitTask, intervals: int, timed: bool) -> Answer:
    """A few points of a family and, if timed, the seconds of one."""
    problem, y = task.problem, task.unknowns()
    settings = AutoSettings(intervals=intervals, step=SHORT_STEP, points=4)
    with Auto() as auto:
        run = auto.follow(problem, y, settings)
        flights = problem.inner + 1
        seconds = None
        if timed:
            cost = auto.time_a_point(problem, y, settings, short=SHORT // flights, long=LONG // flights, repeats=REPEATS)
            found = cost.seconds if math.isnan(cost.processor.value) else cost.processor
            if not found.value > found.scatter:
                raise AutoError(f"the microseconds of a point are {found.per(1e-6).text}, the scatter of the runs")
            seconds = found.value
    orbits = tuple(task.answer(point.unknowns(problem), point.h) for point in run.points)
    return Answer(len(orbits), seconds, orbits)


def _folds(task: LocateTask, intervals: int) -> Answer:
    """The folds among the special points; AUTO cannot see a loss of symmetry in such problems.

    Their time is that of the whole process of the second of two runs: the first one compiles the equations.
    """
    located, seconds = {}, 0.0
    for name, wanted in task.wanted:
        if wanted.type != "SN":
            continue
        family = wanted.family
        settings = AutoSettings(intervals=intervals, step=-0.05, points=8, folds=True)
        with Auto() as auto:
            run = [auto.follow(family.problem, family.unknowns(), settings) for _ in range(2)][1]
        seconds += run.seconds if math.isnan(run.processor) else run.processor
        if len(run.folds) != 1:
            raise RuntimeError(f"AUTO found {len(run.folds)} folds instead of one")
        located[name] = (run.folds[0].quarter_period(family.problem), run.folds[0].h)
    return Answer(len(located), seconds / len(located), located=located)
