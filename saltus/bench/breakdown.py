"""Where the time of an accepted point goes: compiled arithmetic, entering compiled code, the Python between.

The blocks of steps that a run asks for are kept with their arguments and asked for again one layer at a time: the family's march, the
compiled call in it, and a compiled function that takes the same arguments and does nothing. The differences are what each layer costs.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numba.core.dispatcher import Dispatcher

import branches.family
from branches.family import Family
from bvp.multipoint import MultipointProblem
from saltus.bench.following import RecordedFamily, Spread, spread, timed_run, timed_runs

__all__ = ["Breakdown", "breakdown", "compiled_calls"]

Call = tuple[Callable[..., Any], tuple[Any, ...]]


@numba.njit
def _nothing(*arguments):
    return 0


@dataclass(frozen=True)
class Breakdown:
    """Seconds a point, layer by layer.

    Parameters
    ----------
    inner : int
        Number of inner impacts.
    steps, iterations, compiled_calls : float
        Asked for a point: steps, corrector iterations, compiled calls.
    compiled : float
        Arithmetic in compiled code.
    entering : float
        Taking the same arguments into compiled code and back.
    family : float
        Python in `Family.march` around the compiled call: arrays of the block, and a `Step` where the last one is not plain.
    engine : float
        Python in the engine: the block, its turn in the run.
    total : Spread
        Measured as a whole; its least is the sum of the layers, which are differences of least times.
    """

    inner: int
    steps: float
    iterations: float
    compiled_calls: float
    compiled: float
    entering: float
    family: float
    engine: float
    total: Spread

    @property
    def python(self) -> float:
        """Least seconds that are not compiled arithmetic."""
        return self.total.least - self.compiled


def breakdown(problem: MultipointProblem, y: np.ndarray, points: int, repeats: int) -> Breakdown:
    """Take the time of a point apart.

    Parameters
    ----------
    problem : MultipointProblem
    y : (u,) float
        Unknowns at the start of the run.
    points : int
        Accepted points of the run.
    repeats : int
        How often each layer is measured.

    Raises
    ------
    RuntimeError
        When no compiled call is seen, or no point comes from a march.
    """
    recorded = RecordedFamily(problem)
    timed_run(recorded, recorded.begin(y), points)
    family = Family(problem)
    with compiled_calls() as calls:
        for arguments in recorded.marches:
            family._march(*arguments)
        seen = list(calls)
    if not seen:
        raise RuntimeError("no compiled call was seen in Family.march: the breakdown does not know where it is made")
    accepted = len(recorded.marched)
    if not accepted:
        raise RuntimeError(f"no point of {points} was marched to: nothing to measure; ask for more points")
    _loop([(_nothing, arguments) for _, arguments in seen])  # compiles it
    totals, families, kernels, nothings = [], [], [], []
    for _ in range(repeats):
        totals += [r.clean_point for r in timed_runs(family, y, points, 1)]
        families.append(_loop([(family._march, arguments) for arguments in recorded.marches]) / accepted)
        kernels.append(_loop(seen) / accepted)
        nothings.append(_loop([(_nothing, arguments) for _, arguments in seen]) / accepted)
    total = spread(totals)
    in_family, in_kernel, nothing = (min(x) for x in (families, kernels, nothings))
    return Breakdown(
        problem.inner,
        1.0 + recorded.tried / accepted,
        float(np.mean([step.iterations for step in recorded.marched])),
        len(seen) / accepted,
        in_kernel - nothing,
        nothing,
        in_family - in_kernel,
        total.least - in_family,
        total,
    )


def _loop(calls: list[Call]) -> float:
    """Seconds of the processor to make all the calls."""
    began = time.process_time()
    for function, arguments in calls:
        function(*arguments)
    return time.process_time() - began


@contextmanager
def compiled_calls() -> Iterator[list[Call]]:
    """While it holds, compiled functions that `branches.family` calls by name are kept with their arguments, in order."""
    calls: list[Call] = []
    module = branches.family
    compiled = {name: value for name, value in vars(module).items() if isinstance(value, Dispatcher)}

    def keeping(function: Callable[..., Any]) -> Callable[..., Any]:
        def kept(*arguments: Any) -> Any:
            calls.append((function, arguments))
            return function(*arguments)

        return kept

    for name, value in compiled.items():
        setattr(module, name, keeping(value))
    try:
        yield calls
    finally:
        for name, value in compiled.items():
            setattr(module, name, value)
