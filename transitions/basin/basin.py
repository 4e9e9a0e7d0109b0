"""Basins of attraction: each start of a grid is followed until it is caught by an attractor.

The starts are followed in rounds. In a round the attractors that are known catch what enters their neighbourhoods
(`transitions.basin.neighbourhood`). Some of the starts that are left after it are simulated until they have settled, one by one, and what
they settle to is known in the next round. So the result depends neither on the number of processes nor on their order.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, wait
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from bvp.description import BASE
from bvp.motion import STATUS
from bvp.texts import shown
from transitions.basin.attractors import KnownAttractors
from transitions.basin.cloud import Cloud, on_clouds
from transitions.basin.following import CAUGHT, ENDED, LEFT, Followed, StartFollower
from transitions.basin.grid import BasinAxis, StartGrid
from transitions.basin.identity import mirrored, named_by, same_states
from transitions.basin.record import IMPOSSIBLE, UNDECIDED, Attractor, Basin
from transitions.response.path import ParameterPath
from transitions.sweep.forced import harmonics_of

if TYPE_CHECKING:
    from branches.forced.branch import ForcedBranch
    from bvp.forcing import Force
    from bvp.parameters import ParametricSystem
    from bvp.system import ImpactSystem
    from transitions.basin.following import Known

__all__ = ["PERIODS", "BasinPlan", "basin", "find_basin", "path_of"]

PERIODS = 4000
"""Most periods of the loads that a start is followed, unless something else is asked for."""

MOST = 10**9
"""Largest number of periods."""

BLOCK = 256
"""Starts of a task of a process."""

FIRST = 128
"""Periods of the first round; each later one is twice as long."""

SETTLED_EACH = 6
"""Starts that are settled one by one after each round."""

SETTLED_LAST = 40
"""The same after the last round."""

LONG = 4096
"""Least number of periods for a start that is settled by itself: chaos and tori need a thousand."""

PILOT = 5
"""Starts along each axis that are settled first."""

FAR = 1e6
"""A motion is unbounded if it comes so many times as far as the largest start, the stops and the attractors."""


@dataclass(frozen=True, eq=False)
class BasinPlan:
    """A basin to compute.

    Attributes
    ----------
    path : ParameterPath
        The system at the values of its parameters.
    grid : StartGrid
    most : int
        Most periods of the loads for each start.
    branches : sequence of ForcedBranch
        Followed responses by which attractors are named, and of which the unstable orbits are the saddles.
    """

    path: ParameterPath
    grid: StartGrid
    most: int = PERIODS
    branches: Sequence[ForcedBranch] = ()

    def __post_init__(self) -> None:
        if isinstance(self.most, bool) or not isinstance(self.most, (int, np.integer)) or not 1 <= self.most <= MOST:
            raise ValueError(f"most is an integer from 1 to {MOST}; received {shown(self.most)}")


@dataclass(eq=False)
class _Search:
    """The starts on the way."""

    plan: BasinPlan
    follower: StartFollower
    known: KnownAttractors
    bound: float
    assigned: np.ndarray
    periods: np.ndarray
    impacts: np.ndarray
    reasons: dict[int, str] = field(default_factory=dict)


def path_of(parametric: ParametricSystem, values: Mapping[str, float] | None = None) -> ParameterPath:
    """The system at the values of its parameters, as a path along the frequency of its loads: none of its orbits is followed.

    A system without a parameter gets the base frequency of its loads as one."""
    if not parametric.names:
        base, multiples = harmonics_of(parametric.forces())
        given = parametric.describe()
        loads = [
            {key: value for key, value in load.items() if key != "frequency"} | ({"harmonic": k} if k else {})
            for load, k in zip(given["forces"], multiples, strict=True)
        ]
        parametric = type(parametric).from_description(given | {"parameters": {BASE: base}, "forces": loads})
    name = BASE if BASE in parametric.names else parametric.names[0]
    return ParameterPath(parametric, [name], (), dict(values or {}))


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
        If no start of the grid is between the stops; for loads without a base frequency.
    """
    from transitions.basin.saddles import saddles_between, saddles_of

    grid, path = plan.grid, plan.path
    system, forces = path.parametric.system(path.values), path.parametric.forces(path.values)
    inside = grid.possible(system)
    if not inside.any():
        raise ValueError(f"every start of the grid over {grid.x.name} and {grid.y.name} is beyond a stop; expected another range")
    follower = StartFollower(system, forces)
    states = grid.states
    ends = [bound for stop in system.stops for bound in (stop.lower, stop.upper) if math.isfinite(bound) and abs(bound) < FAR]
    bound = FAR * float(max(np.abs(states).max(), np.abs([1.0, *ends]).max()))
    assigned = np.where(inside, UNDECIDED, IMPOSSIBLE).astype(np.int64)
    zeros = np.zeros(len(grid), dtype=np.int64)
    attractors = KnownAttractors(path, follower, max(plan.most, LONG))
    search = _Search(plan, follower, attractors, bound, assigned, zeros, zeros.copy())
    interrupted = False
    try:
        _carry_out(search, states, np.flatnonzero(inside), executor, on_progress)
    except KeyboardInterrupt:
        interrupted = True
        for b in np.flatnonzero(assigned == UNDECIDED).tolist():
            search.reasons.setdefault(b, "interrupted")
    found = _basin(search)
    if saddles and not interrupted:
        try:
            source, between, complete = "file", [], True
            if plan.branches:
                between = saddles_of(plan, found)
            else:
                between, complete = saddles_between(plan, found, search.known.rows(), follower)
                source = "boundary" if complete else "part of the boundary"
            found = replace(found, saddles=tuple(between), saddles_from=source)
        except KeyboardInterrupt:
            interrupted = True
    return found, interrupted


def _carry_out(
    search: _Search, states: np.ndarray, active: np.ndarray, executor: Executor | None, on_progress: Callable[[int], object] | None
) -> None:
    """Assign the starts with the numbers `active`, in rounds."""
    most, done = search.plan.most, 0
    current, sticking = states.copy(), np.zeros(len(states), dtype=np.int64)
    _pilot(search, states, active)
    phase, length = search.plan.grid.phase, FIRST
    total = len(active)
    while len(active):
        length = min(length, most - done)
        known, owners = search.known.rows()
        for part, found in _blocks(search, active, current, sticking, length, known, phase, executor):
            current[part], sticking[part] = found.states, found.sticking
            search.periods[part] += found.periods
            search.impacts[part] += found.impacts
            caught, left, ended = (part[found.outcome == code] for code in (CAUGHT, LEFT, ENDED))
            search.assigned[caught] = owners[found.row[found.outcome == CAUGHT]]
            if len(left):
                search.assigned[left] = search.known.unbounded()
            for b, code in zip(ended.tolist(), found.reason[found.outcome == ENDED].tolist(), strict=True):
                search.reasons[b] = f"the simulation ended: {STATUS[code].value}"
            if on_progress is not None:
                on_progress(int(np.sum(search.assigned >= 0)) + len(search.reasons))
        phase, done, length = 0.0, done + length, 2 * length
        for b in active[sticking[active] != 0].tolist():
            if search.assigned[b] == UNDECIDED and b not in search.reasons:
                current[b] = search.follower.carried_state(current[b], int(sticking[b])).state
        active = _left(search, active)
        active = _on_clouds(search, active, current, sticking, executor)
        last = done >= most
        nothing = not search.known.entries
        active = _settle_some(search, active, current, sticking, SETTLED_LAST if last else SETTLED_EACH)
        if last:
            active = _on_clouds(search, active, current, sticking, executor)
        if last or (nothing and not search.known.entries):
            text = (
                f"not settled in {most} periods"
                if last
                else f"no attractor was found: what was followed for {search.known.longest} periods did not settle"
            )
            for b in active.tolist():
                search.reasons.setdefault(b, text)
            break
    if on_progress is not None:
        on_progress(total)


def _pilot(search: _Search, states: np.ndarray, active: np.ndarray) -> None:
    """Settle a few starts that are spread over the grid, so that most attractors are known at once."""
    grid = search.plan.grid
    rows, columns = ((np.arange(PILOT) + 0.5) / PILOT * count for count in (grid.y.count, grid.x.count))
    chosen = np.unique((rows.astype(int)[:, None] * grid.x.count + columns.astype(int)).ravel())
    for b in np.intersect1d(chosen, active).tolist():
        known, _ = search.known.rows()
        found = search.follower.follow(states[b : b + 1], FIRST, known, phase=grid.phase, bound=search.bound)
        last, bits = found.states[0], int(found.sticking[0])
        if found.outcome[0] not in (CAUGHT, LEFT, ENDED) and search.known.on_cloud(last, bits) < 0:
            search.known.settled(last, bits)


def _left(search: _Search, active: np.ndarray) -> np.ndarray:
    """Those of the starts that are neither assigned nor given up."""
    return active[[search.assigned[b] == UNDECIDED and b not in search.reasons for b in active.tolist()]] if len(active) else active


def _settle_some(search: _Search, active: np.ndarray, current: np.ndarray, sticking: np.ndarray, most: int) -> np.ndarray:
    """Settle some starts, spread evenly over those that are left; return the others."""
    if not len(active):
        return active
    for b in active[np.unique(np.linspace(0, len(active) - 1, min(most, len(active))).astype(int))].tolist():
        search.assigned[b] = search.known.settled(current[b], int(sticking[b]))
    return _left(search, active)


def _on_clouds(search: _Search, active: np.ndarray, current: np.ndarray, sticking: np.ndarray, executor: Executor | None) -> np.ndarray:
    """Assign the starts whose motion is on a known torus, or in known chaos, here or in processes; return the others."""
    clouds = search.known.clouds()
    if not clouds or not len(active):
        return active
    parts = np.array_split(active, math.ceil(len(active) / BLOCK))
    common = search.follower.system, search.follower.forces, [cloud for _, cloud in clouds]
    if executor is None:
        places = [on_clouds(search.follower, common[2], current[part], sticking[part]) for part in parts]
    else:
        waiting = [executor.submit(_placed, *common, current[part], sticking[part]) for part in parts]
        try:
            places = [future.result() for future in waiting]
        finally:
            for future in waiting:
                future.cancel()
    numbers = np.array([*(k for k, _ in clouds), UNDECIDED])
    for part, found in zip(parts, places, strict=True):
        search.assigned[part] = numbers[found]
    return _left(search, active)


def _blocks(
    search: _Search,
    active: np.ndarray,
    current: np.ndarray,
    sticking: np.ndarray,
    length: int,
    known: Known,
    phase: float,
    executor: Executor | None,
) -> Iterator[tuple[np.ndarray, Followed]]:
    """Follow starts in blocks, here or in processes: the numbers of the starts of each block, and what became of them."""
    parts = np.array_split(active, max(1, math.ceil(len(active) / BLOCK)))
    if executor is None:
        for part in parts:
            yield part, search.follower.follow(current[part], length, known, sticking=sticking[part], phase=phase, bound=search.bound)
        return
    common = search.follower.system, search.follower.forces
    waiting = {executor.submit(_follow, *common, current[part], sticking[part], length, known, phase, search.bound): part for part in parts}
    try:
        while waiting:
            for future in wait(waiting, return_when=FIRST_COMPLETED).done:
                yield waiting.pop(future), future.result()
    finally:
        for future in waiting:
            future.cancel()


def _follow(
    system: ImpactSystem,
    forces: tuple[Force, ...],
    states: np.ndarray,
    sticking: np.ndarray,
    length: int,
    known: Known,
    phase: float,
    bound: float,
) -> Followed:
    """A block of starts, in a process."""
    return StartFollower(system, forces).follow(states, length, known, sticking=sticking, phase=phase, bound=bound)


def _placed(
    system: ImpactSystem, forces: tuple[Force, ...], clouds: Sequence[Cloud], states: np.ndarray, sticking: np.ndarray
) -> np.ndarray:
    """`on_clouds` of a block of starts, in a process."""
    return on_clouds(StartFollower(system, forces), clouds, states, sticking)


def _basin(search: _Search) -> Basin:
    """The result: attractors with starts, by descending number of these."""
    from transitions.basin.identity import orbits_at

    plan, period = search.plan, search.follower.period
    counts = np.bincount(search.assigned[search.assigned >= 0], minlength=len(search.known.entries))
    order = [k for k in np.argsort(-counts, kind="stable").tolist() if counts[k]]
    number = np.full(len(search.known.entries) + 2, UNDECIDED)
    number[-2:] = IMPOSSIBLE, UNDECIDED  # of the entries -2 and -1
    number[order] = np.arange(len(order))
    orbits = orbits_at(plan.branches, dict(plan.path.values)) if plan.branches else []
    attractors = _with_mirrors(plan.path, [search.known.entries[k].attractor for k in order], period)
    attractors = [named_by(plan.path, found, orbits, period) for found in attractors]
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


def _at_phase(search: _Search, attractor: Attractor) -> np.ndarray:
    """The states of an attractor at the phase of the starts."""
    from bvp.simulate import Simulator

    phase = search.plan.grid.phase
    if phase == 0.0 or not attractor.period:
        return attractor.states
    n = search.follower.system.degrees_of_freedom
    simulator = Simulator(search.follower.system, list(search.follower.forces))
    time = phase / (2.0 * math.pi) * search.follower.period
    return np.array([simulator.run(state[:n], state[n:], time).final for state in attractor.states])
