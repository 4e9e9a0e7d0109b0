"""AUTO-07p on the multi-segment form: the same orbits, followed by the program that the field knows, where it is installed.

Each flight of the segment is mapped to [0, 1] and the flights stand side by side as one boundary-value problem, with the flight times as
parameters and the impacts as boundary conditions (`flights.f90`, with all derivatives given); AUTO discretises it by collocation and
follows it by pseudo-arclength in the energy. For such a problem it computes no multipliers, and it does not look whether a flight pierces
a stop.

Parallel threads are turned off (`OMP_NUM_THREADS=1`): the problems are small, and saltus uses one as well.
"""

from __future__ import annotations

import math
import os
import shutil
import subprocess
import tempfile
from dataclasses import replace
from importlib import resources
from pathlib import Path
from types import TracebackType
from typing import NamedTuple

import numpy as np

from bvp.multipoint import MultipointProblem
from saltus.bench.auto_files import EQUATIONS, AutoError, AutoPoint, AutoRun, AutoSettings, constants_text, last_words, read_run, start_text

__all__ = ["Auto", "AutoError", "AutoPoint", "AutoRun", "AutoSettings", "PointTime", "missing"]

PROGRAMS = ("auto", "auto-07p")
"""What the program may be called: by its authors, and in Debian's package auto-07p."""

COMPILER = "gfortran"

_SECONDS = 600.0


class PointTime(NamedTuple):
    """Time of a point: by the clock, and of the processor, which other work on the machine does not make longer."""

    seconds: float
    processor: float


def missing() -> str | None:
    """Why AUTO-07p cannot be used here, None where it can."""
    if _program() is None:
        return f"no program {' or '.join(PROGRAMS)} is on the path (Debian package auto-07p)"
    if shutil.which(COMPILER) is None:
        return f"AUTO compiles its equations with {COMPILER}, which is not on the path"
    return None


def _program() -> str | None:
    return next((found for found in map(shutil.which, PROGRAMS) if found is not None), None)


class Auto:
    """A folder where AUTO works, with the equations; they are compiled by the first run. A context, at whose end it is removed.

    Raises
    ------
    AutoError
        Where the program is missing.
    """

    def __init__(self) -> None:
        reason = missing()
        if reason is not None:
            raise AutoError(reason)
        self._program = str(_program())
        self._holder = tempfile.TemporaryDirectory(prefix="saltus-auto-")
        self._folder = Path(self._holder.name)
        equations = resources.files("saltus.bench").joinpath(f"{EQUATIONS}.f90").read_text(encoding="utf-8")
        (self._folder / f"{EQUATIONS}.f90").write_text(equations, encoding="utf-8")

    def __enter__(self) -> Auto:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._holder.cleanup()

    def follow(self, problem: MultipointProblem, y: np.ndarray, settings: AutoSettings, *, keep: bool = True) -> AutoRun:
        """Follow a family from an orbit.

        Parameters
        ----------
        problem : MultipointProblem
            Of the linear oscillator with a vibro-impact sink, from the origin to another end.
        y : (u,) float
            The first orbit.
        settings : AutoSettings
        keep : bool
            Whether the points are wanted: then AUTO writes each with all its digits, which takes time.

        Raises
        ------
        ValueError
            For another system, and for a segment that does not begin at the origin.
        AutoError
            Where AUTO fails, or does not converge.
        """
        for name in ("points", "out"):
            (self._folder / f"{EQUATIONS}.{name}").unlink(missing_ok=True)
        (self._folder / f"{EQUATIONS}.start").write_text(start_text(problem, y, keep), encoding="ascii")
        (self._folder / f"c.{EQUATIONS}").write_text(constants_text(problem, settings), encoding="ascii")
        script = self._folder / "follow.auto"
        script.write_text(f"run(e='{EQUATIONS}', c='{EQUATIONS}', sv='{EQUATIONS}')\n", encoding="ascii")
        before = _processor_of_children()
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        try:
            done = subprocess.run(
                [self._program, script.name], cwd=self._folder, env=environment, capture_output=True, text=True, errors="replace",
                timeout=_SECONDS, stdin=subprocess.DEVNULL, check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            raise AutoError(f"AUTO was not done in {_SECONDS:g} s") from None
        table = self._folder / f"b.{EQUATIONS}"
        if done.returncode != 0 or not table.exists():
            raise AutoError(f"AUTO failed: {last_words(done.stdout, done.stderr)}")
        points = (self._folder / f"{EQUATIONS}.points").read_text(encoding="utf-8") if keep else ""
        run = read_run(done.stdout, table.read_text(encoding="utf-8"), points, problem.inner + 1)
        return replace(run, processor=_processor_of_children() - before)

    def time_a_point(
        self, problem: MultipointProblem, y: np.ndarray, settings: AutoSettings, *, short: int = 100, long: int = 2100, repeats: int = 3
    ) -> PointTime:
        """Time of a point: the difference of two run lengths by that of their points, each the least of some runs; nothing is kept.

        The equations are compiled before, and processor time is sure to some 20 ms by the difference in points.
        """
        self.follow(problem, y, replace(settings, points=2), keep=False)
        least = []
        for length in (short, long):
            runs = [self.follow(problem, y, replace(settings, points=length), keep=False) for _ in range(repeats)]
            least.append((min(run.seconds for run in runs), min(run.processor for run in runs), runs[0].count))
        (first, first_processor, few), (last, last_processor, many) = least
        if many <= few:
            raise AutoError(f"AUTO ended after {many} points: expected a shorter run or a smaller step")
        return PointTime((last - first) / (many - few), (last_processor - first_processor) / (many - few))

    def seconds_a_point(
        self, problem: MultipointProblem, y: np.ndarray, settings: AutoSettings, *, short: int = 100, long: int = 2100, repeats: int = 3
    ) -> float:
        """The same by the clock alone; on a busy machine too long."""
        return self.time_a_point(problem, y, settings, short=short, long=long, repeats=repeats).seconds


def _processor_of_children() -> float:
    """Seconds of processor of all processes that were started and are done; NaN where the system does not count them."""
    try:
        import resource
    except ImportError:
        return math.nan
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
