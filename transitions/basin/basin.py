"""Basins of attraction: each start of a grid is followed until it is caught by an attractor; and the saddles between them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace

import numpy as np

from branches.forced.branch import ForcedBranch
from bvp.parameters import ParametricSystem
from transitions.basin.grid import BasinAxis, StartGrid
from transitions.basin.identity import mirrored, named_by, same_states, states_later
from transitions.basin.plan import PERIODS, BasinPlan, path_of
from transitions.basin.record import IMPOSSIBLE, UNDECIDED, Attractor, Basin
from transitions.basin.rounds import BasinSearch, assign_starts, begin_search
from transitions.basin.saddles import saddles_between, saddles_of
from transitions.response.path import ParameterPath

__all__ = ["basin", "find_basin"]


def basin(
    system: ParametricSystem,
    x: tuple[str, float, float],
    y: tuple[str, float, float],
    *,
    grid: tuple[int, int] = (200, 200),
    fixed: Mapping[str, float] | None = None,
    phase: float = 0.0,
    values: Mapping[str, float] | None = None,
    most: int = PERIODS,
    branches: Sequence[ForcedBranch] = (),
    executor: Executor | None = None,
) -> Basin:
    """Compute basins of attraction over two coordinates of the state.

    Parameters
    ----------
    system : ParametricSystem
        Such as the `parametric` of a scene; with periodic loads.
    x, y : (str, float, float)
        The coordinates that vary, with their ranges: displacements "u1", or velocities "u1'".
    grid : (int, int)
        Starts along x and y.
    fixed : mapping of str to float, optional
        Values of other coordinates; 0 where none is given.
    phase : float
        Phase w t of the starts, in [0, 2 pi).
    values : mapping, optional
        Values of parameters that replace the defaults.
    most : int
        Most periods of the loads for each start.
    branches : sequence of ForcedBranch
        Followed responses that name the attractors, and whose unstable orbits are the saddles. Without them saddles are sought from the
        boundaries.
    executor : Executor, optional
        Of processes that follow the starts.

    Returns
    -------
    Basin

    Raises
    ------
    ValueError
        For coordinates that the state lacks, fewer than two that vary, a grid that is beyond the stops, loads without a period.
    KeyboardInterrupt
        With the basin up to there as its attribute `basin`.

    Examples
    --------
    >>> from bvp.parameters import ParametricSystem
    >>> stop = {"c": [1.0], "upper": 1.0, "restitution": 0.8}
    >>> oscillator = ParametricSystem.from_description({
    ...     "parameters": {"A": 1.0, "w": 2.2}, "system": {"mass": [[1.0]], "damping": [[0.02]], "stiffness": [[1.0]], "stops": [stop]},
    ...     "forces": [{"load": [1.0], "amplitude": "A", "harmonic": 1}]})
    >>> found = basin(oscillator, ("u1", -2.0, 1.0), ("u1'", -4.0, 4.0), grid=(8, 8))
    >>> [(one.family, one.period) for one in found.attractors], found.counts.tolist(), len(found.saddles)
    ([('period-2:+', 2), ('period-1:', 1)], [41, 23], 1)
    """
    path = path_of(system, values)
    axes = [BasinAxis(*axis, count) for axis, count in zip((x, y), grid, strict=True)]
    starts = StartGrid(path.parametric.system(path.values).coordinates, axes[0], axes[1], dict(fixed or {}), phase)
    found, interrupted = find_basin(BasinPlan(path, starts, most, branches), executor)
    if interrupted:
        error = KeyboardInterrupt()
        error.basin = found  # type: ignore[attr-defined]
        raise error
    return found


def find_basin(
    plan: BasinPlan,
    executor: Executor | None = None,
    on_progress: Callable[[int], object] | None = None,
    *,
    saddles: bool = True,
) -> tuple[Basin, bool]:
    """The basins of a grid of starts.

    Parameters
    ----------
    plan : BasinPlan
    executor : Executor, optional
        Of processes that follow the starts; by default they are followed here.
    on_progress : callable, optional
        Called with the number of starts that are done.
    saddles : bool
        Whether saddles are looked for.

    Returns
    -------
    Basin, bool
        And whether Ctrl-C came: the starts that were not done are undecided then.

    Raises
    ------
    ValueError
        If no start of the grid is between the stops; for loads without a base frequency; if a branch has other values of the parameters.
    """
    search = begin_search(plan, executor)
    _ = plan.orbits  # refused here if the branches have other parameters
    interrupted = False
    try:
        assign_starts(search, on_progress)
    except KeyboardInterrupt:
        interrupted = True
        for b in np.flatnonzero(search.assigned == UNDECIDED).tolist():
            search.reasons.setdefault(b, "interrupted")
    found = _basin(search)
    if saddles and not interrupted:
        try:
            if plan.branches:
                between, source = saddles_of(plan), "file"
            else:
                between, complete = saddles_between(plan, found, search.known.rows(), search.follower)
                source = "boundary" if complete else "part of the boundary"
            found = replace(found, saddles=tuple(between), saddles_from=source)
        except KeyboardInterrupt:
            interrupted = True
    return found, interrupted


def _basin(search: BasinSearch) -> Basin:
    """The result: attractors with starts, by descending number of these."""
    plan, period = search.plan, search.follower.period
    counts = np.bincount(search.assigned[search.assigned >= 0], minlength=len(search.known.entries))
    order = [k for k in np.argsort(-counts, kind="stable").tolist() if counts[k]]
    number = np.full(len(search.known.entries) + 2, UNDECIDED)
    number[-2:] = IMPOSSIBLE, UNDECIDED  # of the entries -2 and -1
    number[order] = np.arange(len(order))
    attractors = _with_mirrors(plan.path, [search.known.entries[k].attractor for k in order], period)
    attractors = [named_by(plan.path, found, plan.orbits, period) for found in attractors]
    undecided = Counter(search.reasons[b] for b in np.flatnonzero(search.assigned == UNDECIDED).tolist())
    return Basin(
        grid=plan.grid,
        attractors=tuple(attractors),
        attractor=number[search.assigned].astype(np.int64),
        periods=search.periods,
        impacts=search.impacts,
        saddles=(),
        positions=tuple(_at_phase(search, found) for found in attractors),
        undecided=dict(sorted(undecided.items())),
        frequency=2.0 * math.pi / period,
    )


def _with_mirrors(path: ParameterPath, attractors: list[Attractor], period: float) -> list[Attractor]:
    """The attractors, each with the index of its mirror image."""
    found = []
    for one in attractors:
        image = mirrored(path, one.states, period) if one.period else None
        same = (k for k, other in enumerate(attractors) if image is not None and same_states(other.states, image))
        found.append(replace(one, mirror=next(same, -1)))
    return found


def _at_phase(search: BasinSearch, attractor: Attractor) -> np.ndarray:
    """The states (p, 2n) of an attractor at the phase of the starts; NaN where a simulation ends before."""
    phase = search.plan.grid.phase
    if phase == 0.0 or not attractor.period:
        return attractor.states
    return states_later(search.plan.path, attractor.states, phase / (2.0 * math.pi) * search.follower.period)
