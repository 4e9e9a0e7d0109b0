"""Memory of a branch: bytes that Python and numpy hold for it, counted by tracemalloc."""

from __future__ import annotations

import gc
import tracemalloc
from dataclasses import dataclass, replace

import numpy as np

from branches.branch import Branch
from branches.tracing import SETTINGS, follow_family
from bvp.multipoint import MultipointProblem

__all__ = ["Held", "held"]


SHORT_STEPS = replace(SETTINGS, initial_step=2e-3, maximum_step=2e-3)
"""Many points on a short piece of a family: few events are met, so that points are counted and not these."""


@dataclass(frozen=True)
class Held:
    """Bytes of a branch: kept when it is done, most while it was traced, and of the arrays in `Branch.points` alone."""

    points: int
    kept: int
    most: int
    arrays: int


def held(problem: MultipointProblem, y: np.ndarray, points: int) -> Held:
    """Trace a branch upward and count what it holds.

    Parameters
    ----------
    problem : MultipointProblem
    y : (u,) float
        Unknowns at the start.
    points : int
        Points in total, events counted.
    """

    def traced() -> Branch:
        return follow_family(problem, y, points=points, direction="up", settings=SHORT_STEPS)

    traced()  # what is made once is made before counting
    gc.collect()
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        branch = traced()
        gc.collect()
        after, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    arrays = sum(column.nbytes for column in branch.points.values())
    return Held(len(branch), after - before, most - before, arrays)
