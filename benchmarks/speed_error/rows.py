"""Rows of the speed-error benchmark: task by method by setting, and the growth of cost. Each is written as soon as it is finished."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain, repeat
from pathlib import Path
from typing import IO, Any

import numpy as np

from benchmarks import cases
from benchmarks.measure import repeated_times, spread
from benchmarks.report import progress, watched
from benchmarks.speed_error.methods import Errors, Method, Task
from benchmarks.speed_error.worker import Failed, Timed, Worker
from branches.files import WriteFailure, reason
from bvp.multipoint import MultipointProblem
from saltus.errors import one_line

__all__ = ["FULL", "QUICK", "Effort", "RowFile", "growth", "task_rows"]

Row = dict[str, Any]

ARCLENGTH = 1e-3
"""Step of the points whose growth of cost is measured."""

DISCOVERY_ENERGY, DISCOVERY_IMPACTS = 1.0, 10
"""Energy and most impacts of the discoveries whose growth of cost is measured."""


@dataclass(frozen=True)
class Effort:
    """How much is measured."""

    name: str
    tasks: tuple[str, ...] | None  # None for all
    methods: tuple[str, ...] | None
    tolerances: tuple[float, ...]  # for the methods that have one, loose to tight
    repeat: float  # seconds for which a work is repeated; its least time counts
    limit: float  # seconds after which a work is stopped; its method then skips the tighter settings
    start: float  # additional seconds for the first work of a fresh process, which may compile kernels
    impacts: tuple[int, ...]  # inner impacts, for the growth of the cost of a point
    degrees: tuple[int, ...]  # of freedom, for the same
    periods: tuple[float, ...]  # longest quarter periods, for the growth of the cost of a discovery


FULL = Effort(
    "full", None, None, tuple(10.0**-k for k in range(3, 14, 2)), 0.3, 30.0, 300.0,
    (1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1000), (2, 3, 5, 8, 12, 20, 32, 50), (1.8, 2.5, 3.2, 4.0, 5.1),
)  # fmt: skip
"""The figures of the page."""

QUICK = Effort(
    "quick", ("S13O00+", "U8353-", "located"),
    ("saltus", "saltus, short steps", "saltus, saddle-point matrix", "solve_ivp DOP853", "nonsmooth time (the paper's)", "solve_bvp",
     "AUTO-07p"),
    (1e-4, 1e-8, 1e-12), 0.05, 2.0, 300.0, (1, 8, 64, 1000), (2, 8, 50), (1.8, 3.2),
)  # fmt: skip
"""Less than a minute on an idle machine with compiled kernels on disk."""


class RowFile:
    """A file of JSON lines, one per row. Each row is on disk when it is added, whatever happens to the process later.

    Parameters
    ----------
    path : path-like
        An old file is replaced.

    Raises
    ------
    WriteFailure
        If it cannot be written.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self.rows: list[Row] = []
        try:
            self._file: IO[str] = self.path.open("w", encoding="utf-8")
        except OSError as error:
            raise WriteFailure(f"cannot write {path}: {reason(error)}") from error

    def add(self, row: Row) -> None:
        """Write a row; numbers that are not finite become null."""
        row = {key: finite(value) for key, value in row.items()}
        try:
            self._file.write(json.dumps(row, allow_nan=False) + "\n")
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            raise WriteFailure(f"cannot write {self.path}: {reason(error)}") from error
        self.rows.append(row)

    def close(self) -> None:
        """Close the file. If a row could not be written, `add` has already raised the error."""
        with suppress(OSError):
            self._file.close()


def finite(value: Any) -> Any:
    """A value for JSON: numbers that are not finite become None."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    return value


def task_rows(task: Task, method: Method, effort: Effort) -> Iterator[Row]:
    """Do a task by a method at all its settings.

    Yields
    ------
    dict
        `task`; `method`; `setting` (None for a method without); `seconds` (of the processor, a point); `first` (seconds from the start of a
        fresh process to its first answer, in the first row); `memory` (bytes); `points`; `repeats`; `errors` (orbit, energy, multipliers,
        located; None if not computed); `layers`; `failed` (None, or why there is no answer).
    """
    with Worker(method.prepare, task, effort.repeat) as worker:
        for fresh, setting in zip(chain((True,), repeat(False)), method.settings(effort.tolerances), strict=False):
            progress(f"{task.name}, {method.name}" + ("" if setting is None else f", {method.setting} {setting:.0e}"))
            head: Row = {"task": task.name, "method": method.name, "setting": setting}
            try:
                timed = worker.do(setting, effort.limit + (effort.start if fresh else 0.0))
            except Failed as failure:
                nothing = dict.fromkeys(("seconds", "first", "memory", "points", "repeats", "layers"))
                yield {**head, **nothing, "errors": Errors()._asdict(), "failed": str(failure)}
                if failure.final:
                    return
                continue
            yield {**head, **_measured(task, timed)}


def _measured(task: Task, timed: Timed) -> Row:
    failed = None
    try:
        errors = task.errors(timed.answer)
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        # The answer is so wrong that there is no reference near it.
        errors, failed = Errors(), f"its error is unknown: {one_line(error)}"
    return {
        "seconds": timed.seconds, "first": timed.first, "memory": timed.memory, "points": timed.answer.points, "repeats": timed.repeats,
        "layers": timed.answer.layers, "errors": errors._asdict(), "failed": failed,
    }  # fmt: skip


def growth(effort: Effort) -> Iterator[Row]:
    """Rows of the growth of cost: `growth` (the cost against what), `value`, `seconds`, and more of each kind."""
    from branches.search.discovery import discover_orbits

    for inner in watched(effort.impacts, "growth, {} inner impacts".format):
        yield _growth_of_a_point("impacts", inner, *cases.segment(cases.system(), inner), effort.repeat)
    for degrees in watched(effort.degrees, "growth, {} degrees of freedom".format):
        system = cases.chain(degrees)
        yield _growth_of_a_point("degrees of freedom", degrees, *cases.segment(system, 0, cases.physical_period(system)), effort.repeat)
    for period in watched(effort.periods, "growth, discovery to quarter period {:g}".format):

        def search(period: float = period) -> Any:
            return discover_orbits(cases.system(), DISCOVERY_ENERGY, quarter_period=period, impacts=DISCOVERY_IMPACTS)

        found = search()
        times = _times({"seconds": search}, effort.repeat)
        yield {"growth": "quarter period", "value": period, **times, "orbits": len(found.orbits), "complete": found.complete}


def _times(works: dict[str, Callable[[], object]], repeat: float) -> dict[str, float]:
    """Least seconds of each work, and the scatter of that named "seconds"."""
    times = {name: spread(found) for name, found in repeated_times(works, repeat).items()}
    return {**{name: found.least for name, found in times.items()}, "scatter": times["seconds"].median - times["seconds"].least}


def _growth_of_a_point(against: str, value: int, problem: MultipointProblem, y: np.ndarray, repeat: float) -> Row:
    """Seconds of a step with all test functions, of the orbit alone, and of the multipliers by the saddle-point matrix.

    Steps are taken one at a time, not in blocks.
    """
    from branches.family import Family
    from bvp.closures import cycle_of
    from bvp.multipliers import saddle_point_multipliers

    here = problem.step(y, np.zeros(2 * problem.unknowns), 0.0)
    if here is None:
        raise RuntimeError(f"the start at {value} {against} was not found")
    there = problem.step(here.y, here.tangent, ARCLENGTH)
    if there is None:
        raise RuntimeError(f"the step at {value} {against} failed")
    family, cycle = Family(problem), cycle_of(problem, there.y)
    works: dict[str, Callable[[], object]] = {
        "seconds": lambda: family.step(here.y, here.tangent, ARCLENGTH),
        "orbit_only": lambda: problem.step(here.y, here.tangent, ARCLENGTH, full=False),
        "saddle_point": lambda: saddle_point_multipliers(cycle),
    }
    return {"growth": against, "value": value, **_times(works, repeat), "residual": there["residual"]}
