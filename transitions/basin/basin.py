"""Basins of attraction: each start of a grid is followed until it is caught by an attractor.

The starts are followed in rounds. In a round the attractors that are known catch what enters their neighbourhoods
(`transitions.basin.neighbourhood`). Some of the starts that are left after it are simulated until they have settled, one by one, and what
they settle to is known in the next round. So the result depends neither on the number of processes nor on their order.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, wait
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from bvp.motion import STATUS
from transitions.basin.cloud import Cloud, attracts, cloud_of, on_clouds
from transitions.basin.following import CAUGHT, ENDED, LEFT, Followed, StartFollower
from transitions.basin.grid import StartGrid
from transitions.basin.identity import attractor_of, is_stable, mirrored, named_by, same_states
from transitions.basin.neighbourhood import joined_rows, neighbourhoods
from transitions.basin.record import IMPOSSIBLE, UNDECIDED, Attractor, AttractorKind, Basin
from transitions.sweep.settle import Settled, settle

if TYPE_CHECKING:
    from branches.forced.branch import ForcedBranch
    from bvp.forcing import Force
    from bvp.system import ImpactSystem
    from transitions.basin.following import Known
    from transitions.response.path import ParameterPath

__all__ = ["PERIODS", "BasinPlan", "find_basin", "path_of"]

PERIODS = 4000
"""Most periods of the loads that a start is followed, unless something else is asked for."""

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


@dataclass(eq=False)
class _Entry:
    """A known attractor: its neighbourhoods, or its cloud."""

    attractor: Attractor
    rows: Known | None = None
    cloud: Cloud | None = None


@dataclass(eq=False)
class _Search:
    """The starts on the way."""

    plan: BasinPlan
    system: ImpactSystem
    forces: tuple[Force, ...]
    follower: StartFollower
    bound: float
    assigned: np.ndarray
    periods: np.ndarray
    impacts: np.ndarray
    reasons: dict[int, str] = field(default_factory=dict)
    entries: list[_Entry] = field(default_factory=list)
    """In the order in which they were found."""

    @property
    def longest(self) -> int:
        """Periods after which a start that is settled by itself must have settled."""
        return max(self.plan.most, LONG)

    def known(self) -> tuple[Known, np.ndarray]:
        """The rows of all attractors, and the attractor of each row."""
        parts = [(k, entry.rows) for k, entry in enumerate(self.entries) if entry.rows is not None]
        width = 2 * self.system.degrees_of_freedom
        owners = np.repeat([k for k, _ in parts], [len(rows.sizes) for _, rows in parts]).astype(np.int64)
        return joined_rows([rows for _, rows in parts], width), owners

    def settled(self, state: np.ndarray, sticking: int) -> int:
        """The attractor to which a state at phase 0 leads by a long simulation: its number, which can be new; -1 if it has not settled."""
        start = self.follower.carried_state(state, sticking).state
        n = self.system.degrees_of_freedom
        found = settle(self.system, self.forces, start[:n], start[n:], most=self.longest)
        made = attractor_of(self.plan.path, found)
        if made is None:
            return UNDECIDED
        last = found.states[-1] if not found.period else found.states[0]
        bits = self.follower.bits(found.sticking)
        if made.kind in (AttractorKind.TORUS, AttractorKind.CHAOS):
            return self._cloud_at(made, last, bits)
        for k, entry in enumerate(self.entries):
            if entry.attractor.sticking == made.sticking and same_states(entry.attractor.states, made.states):
                return k
        if not is_stable(made.multipliers):
            return UNDECIDED  # without losses each motion can be periodic, and none attracts
        rows = self._rows(made, found)
        self.entries.append(_Entry(made, rows))
        return len(self.entries) - 1

    def _rows(self, made: Attractor, found: Settled) -> Known | None:
        """The neighbourhoods of a periodic attractor; the contacts that stick at phase 0 are those of the motion there."""
        start = self.follower.carried_state(made.states[0], self.follower.bits(found.sticking))
        bits = []
        states, sticking = start.state[None], np.array([self.follower.bits(start.sticking)])
        # One period before phase 0 the contacts that stick are not known: a period of the motion is followed once more.
        states, sticking = _last(self.follower.follow(states, made.period, sticking=sticking))
        for _ in range(made.period):
            bits.append(int(sticking[0]))
            states, sticking = _last(self.follower.follow(states, 1, sticking=sticking))
        return neighbourhoods(self.follower, made.states, tuple(bits), found.sticking_time > 0.0 or bool(found.sticking))

    def _cloud_at(self, made: Attractor, state: np.ndarray, bits: int) -> int:
        """The number of a torus or of chaos: one whose cloud has the states from here on, or a new one."""
        known = self.on_cloud(state, bits)
        if known >= 0:
            return known
        cloud = cloud_of(self.follower, state, bits)
        if cloud is None or not (made.kind is AttractorKind.CHAOS or attracts(self.follower, cloud)):
            return UNDECIDED
        self.entries.append(_Entry(replace(made, states=cloud.states), cloud=cloud))
        return len(self.entries) - 1

    def clouds(self) -> list[tuple[int, Cloud]]:
        """The clouds that are known, with the numbers of their attractors."""
        return [(k, entry.cloud) for k, entry in enumerate(self.entries) if entry.cloud is not None]

    def on_cloud(self, state: np.ndarray, sticking: int) -> int:
        """The number of the torus or chaos that the motion from a state at phase 0 is on, or -1."""
        clouds = self.clouds()
        found = on_clouds(self.follower, [cloud for _, cloud in clouds], state[None], np.array([sticking], dtype=np.int64))
        return clouds[found[0]][0] if found[0] >= 0 else UNDECIDED

    def unbounded(self) -> int:
        """The number of the attractor at infinity."""
        for k, entry in enumerate(self.entries):
            if entry.attractor.kind is AttractorKind.UNBOUNDED:
                return k
        kind, width = AttractorKind.UNBOUNDED, 2 * self.system.degrees_of_freedom
        empty = np.zeros((0, width))
        self.entries.append(_Entry(Attractor(kind, kind.value, 0, "", empty, (), np.zeros(0, dtype=complex), math.nan)))
        return len(self.entries) - 1


def _last(found: Followed) -> tuple[np.ndarray, np.ndarray]:
    return found.states, found.sticking


def path_of(parametric: object) -> ParameterPath:
    """The system at the values of its parameters, as a path along the frequency of its loads: none of its orbits is followed."""
    from bvp.description import BASE
    from bvp.parameters import ParametricSystem
    from transitions.response.path import ParameterPath

    assert isinstance(parametric, ParametricSystem)
    return ParameterPath(parametric, [BASE if BASE in parametric.names else parametric.names[0]])


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
    search = _Search(plan, system, forces, follower, bound, assigned, zeros, zeros.copy())
    interrupted = False
    try:
        _carry_out(search, states, np.flatnonzero(inside), executor, on_progress)
    except KeyboardInterrupt:
        interrupted = True
        for b in np.flatnonzero(assigned == UNDECIDED).tolist():
            search.reasons.setdefault(b, "interrupted")
    basin = _basin(search)
    if saddles and not interrupted:
        try:
            found = saddles_of(plan, basin) if plan.branches else saddles_between(plan, basin, search.known(), follower)
            basin = replace(basin, saddles=tuple(found), saddles_from="file" if plan.branches else "boundary")
        except KeyboardInterrupt:
            interrupted = True
    return basin, interrupted


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
        known, owners = search.known()
        for part, found in _blocks(search, active, current, sticking, length, known, phase, executor):
            current[part], sticking[part] = found.states, found.sticking
            search.periods[part] += found.periods
            search.impacts[part] += found.impacts
            caught, left, ended = (part[found.outcome == code] for code in (CAUGHT, LEFT, ENDED))
            search.assigned[caught] = owners[found.row[found.outcome == CAUGHT]]
            if len(left):
                search.assigned[left] = search.unbounded()
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
        nothing = not search.entries
        active = _settle_some(search, active, current, sticking, SETTLED_LAST if last else SETTLED_EACH)
        if last:
            active = _on_clouds(search, active, current, sticking, executor)
        if last or (nothing and not search.entries):
            text = (
                f"not settled in {most} periods"
                if last
                else f"no attractor was found: what was followed for {search.longest} periods did not settle"
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
        known, _ = search.known()
        found = search.follower.follow(states[b : b + 1], FIRST, known, phase=grid.phase, bound=search.bound)
        last, bits = found.states[0], int(found.sticking[0])
        if found.outcome[0] not in (CAUGHT, LEFT, ENDED) and search.on_cloud(last, bits) < 0:
            search.settled(last, bits)


def _left(search: _Search, active: np.ndarray) -> np.ndarray:
    """Those of the starts that are neither assigned nor given up."""
    return active[[search.assigned[b] == UNDECIDED and b not in search.reasons for b in active.tolist()]] if len(active) else active


def _settle_some(search: _Search, active: np.ndarray, current: np.ndarray, sticking: np.ndarray, most: int) -> np.ndarray:
    """Settle some starts, spread evenly over those that are left; return the others."""
    if not len(active):
        return active
    for b in active[np.unique(np.linspace(0, len(active) - 1, min(most, len(active))).astype(int))].tolist():
        search.assigned[b] = search.settled(current[b], int(sticking[b]))
    return _left(search, active)


def _on_clouds(search: _Search, active: np.ndarray, current: np.ndarray, sticking: np.ndarray, executor: Executor | None) -> np.ndarray:
    """Assign the starts whose motion is on a known torus, or in known chaos, here or in processes; return the others."""
    clouds = search.clouds()
    if not clouds or not len(active):
        return active
    parts = np.array_split(active, math.ceil(len(active) / BLOCK))
    common = search.system, search.forces, [cloud for _, cloud in clouds]
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
    common = search.system, search.forces
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
    counts = np.bincount(search.assigned[search.assigned >= 0], minlength=len(search.entries))
    order = [k for k in np.argsort(-counts, kind="stable").tolist() if counts[k]]
    number = np.full(len(search.entries) + 2, UNDECIDED)
    number[-2:] = IMPOSSIBLE, UNDECIDED  # of the entries -2 and -1
    number[order] = np.arange(len(order))
    orbits = orbits_at(plan.branches, dict(plan.path.values)) if plan.branches else []
    attractors = _with_mirrors(plan.path, [search.entries[k].attractor for k in order], period)
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
    n = search.system.degrees_of_freedom
    simulator = Simulator(search.system, list(search.forces))
    time = phase / (2.0 * math.pi) * search.follower.period
    return np.array([simulator.run(state[:n], state[n:], time).final for state in attractor.states])
