"""The rounds in which the starts of a grid are assigned to attractors.

In a round the attractors that are known catch what enters their neighbourhoods (`transitions.basin.neighbourhood`). Some of the starts that
are left after it are simulated until they have settled, one by one, and what they settle to is known in the next round. So the result
depends neither on the number of processes nor on their order.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, TypeVar

import numpy as np

from bvp.forcing import Force
from bvp.motion import STATUS
from bvp.system import ImpactSystem
from transitions.basin.cloud import Cloud, attracts, cloud_of, on_clouds
from transitions.basin.following import CAUGHT, ENDED, LEFT, OPEN, Followed, Known, StartFollower
from transitions.basin.identity import attractor_of, is_stable, same_states
from transitions.basin.neighbourhood import joined_rows, neighbourhoods
from transitions.basin.plan import BasinPlan
from transitions.basin.record import IMPOSSIBLE, SIMULATION_ENDED, UNDECIDED, Attractor, AttractorKind
from transitions.response.path import ParameterPath
from transitions.sweep.settle import Settled, settle
from transitions.tasks import completed

__all__ = ["BasinSearch", "assign_starts", "begin_search"]

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

Result = TypeVar("Result")


@dataclass(eq=False)
class KnownAttractor:
    """A known attractor: its neighbourhoods, or its cloud."""

    attractor: Attractor
    rows: Known | None = None
    cloud: Cloud | None = None


@dataclass(eq=False)
class KnownAttractors:
    """The attractors that were found, in this order.

    Attributes
    ----------
    path : ParameterPath
        The system at the values of its parameters.
    follower : StartFollower
    longest : int
        Periods after which a start must have settled.
    entries : list of KnownAttractor
    """

    path: ParameterPath
    follower: StartFollower
    longest: int
    entries: list[KnownAttractor] = field(default_factory=list)

    def rows(self) -> tuple[Known, np.ndarray]:
        """The rows of all attractors, and the attractor of each row."""
        parts = [(k, entry.rows) for k, entry in enumerate(self.entries) if entry.rows is not None]
        width = 2 * self.follower.system.degrees_of_freedom
        owners = np.repeat([k for k, _ in parts], [len(rows.sizes) for _, rows in parts]).astype(np.int64)
        return joined_rows([rows for _, rows in parts], width), owners

    def settled(self, state: np.ndarray, sticking: int) -> int:
        """The attractor to which a state at phase 0 leads by a long simulation: its number, which can be new; -1 if it has not settled."""
        start = self.follower.carried_state(state, sticking).state
        n = self.follower.system.degrees_of_freedom
        found = settle(self.follower.system, self.follower.forces, start[:n], start[n:], most=self.longest)
        made = attractor_of(self.path, found)
        if made is None:
            return UNDECIDED
        if made.kind in (AttractorKind.TORUS, AttractorKind.CHAOS):
            return self._cloud_at(made, found.states[0], self.follower.bits(found.sticking))
        for k, entry in enumerate(self.entries):
            if entry.attractor.sticking == made.sticking and same_states(entry.attractor.states, made.states):
                return k
        if not is_stable(made.multipliers):
            return UNDECIDED  # without losses each motion can be periodic, and none attracts
        rows = self._rows(made, found)
        self.entries.append(KnownAttractor(made, rows))
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
        self.entries.append(KnownAttractor(replace(made, states=cloud.states), cloud=cloud))
        return len(self.entries) - 1

    def clouds(self) -> list[tuple[int, Cloud]]:
        """The clouds that are known, with the numbers of their attractors."""
        return [(k, entry.cloud) for k, entry in enumerate(self.entries) if entry.cloud is not None]

    def on_cloud(self, state: np.ndarray, sticking: int) -> int:
        """The number of the torus or chaos that the motion from a state at phase 0 is on, or -1."""
        clouds = self.clouds()
        found = on_clouds(self.follower, state[None], np.array([sticking], dtype=np.int64), [cloud for _, cloud in clouds])
        return clouds[found[0]][0] if found[0] >= 0 else UNDECIDED

    def unbounded(self) -> int:
        """The number of the attractor at infinity."""
        for k, entry in enumerate(self.entries):
            if entry.attractor.kind is AttractorKind.UNBOUNDED:
                return k
        kind, width = AttractorKind.UNBOUNDED, 2 * self.follower.system.degrees_of_freedom
        empty = np.zeros((0, width))
        self.entries.append(KnownAttractor(Attractor(kind, kind.value, 0, "", empty, (), np.zeros(0, dtype=complex), math.nan)))
        return len(self.entries) - 1


def _last(found: Followed) -> tuple[np.ndarray, np.ndarray]:
    return found.states, found.sticking


@dataclass(eq=False)
class BasinSearch:
    """The N starts of a plan on the way to their attractors, of a system with n coordinates.

    Attributes
    ----------
    plan : BasinPlan
    follower : StartFollower
    known : KnownAttractors
    bound : float
        Of each displacement and velocity: a motion beyond it is unbounded.
    executor : Executor or None
        Of processes that follow the starts; None: they are followed here.
    states : (N, 2n) ndarray
        (u, v) of the starts, later their last states at phase 0.
    sticking : (N,) int64 ndarray
        Bits of the contacts that stick there.
    assigned : (N,) int64 ndarray
        Number of the attractor of each start in `known`; UNDECIDED or IMPOSSIBLE.
    periods, impacts : (N,) int64 ndarray
        Of each start until now.
    reasons : dict of int to str
        Why a start is given up.
    """

    plan: BasinPlan
    follower: StartFollower
    known: KnownAttractors
    bound: float
    executor: Executor | None
    states: np.ndarray
    sticking: np.ndarray
    assigned: np.ndarray
    periods: np.ndarray
    impacts: np.ndarray
    reasons: dict[int, str] = field(default_factory=dict)


def begin_search(plan: BasinPlan, executor: Executor | None = None) -> BasinSearch:
    """The starts of a plan, of which none is assigned yet.

    Raises
    ------
    ValueError
        If each start is beyond a stop; for loads without a base frequency.
    """
    grid, path = plan.grid, plan.path
    system, forces = path.parametric.system(path.values), path.parametric.forces(path.values)
    inside = grid.possible(system)
    if not inside.any():
        raise ValueError(f"every start of the grid over {grid.x.name} and {grid.y.name} is beyond a stop; expected another range")
    follower, states = StartFollower(system, forces), grid.states
    ends = [bound for stop in system.stops for bound in (stop.lower, stop.upper) if math.isfinite(bound) and abs(bound) < FAR]
    sticking, periods, impacts = np.zeros((3, len(grid)), dtype=np.int64)
    return BasinSearch(
        plan=plan,
        follower=follower,
        known=KnownAttractors(path, follower, max(plan.most, LONG)),
        bound=FAR * float(max(np.abs(states).max(), np.abs([1.0, *ends]).max())),
        executor=executor,
        states=states,
        sticking=sticking,
        assigned=np.where(inside, UNDECIDED, IMPOSSIBLE).astype(np.int64),
        periods=periods,
        impacts=impacts,
    )


def assign_starts(search: BasinSearch, on_progress: Callable[[int], object] | None = None) -> None:
    """Follow the starts in rounds until each is assigned or given up. on_progress: called with the number of starts that are done."""
    most, done, length, phase = search.plan.most, 0, FIRST, search.plan.grid.phase
    active = np.flatnonzero(search.assigned == UNDECIDED)
    total = len(active)
    _settle_pilots(search)
    while len(active):
        length = min(length, most - done)
        _follow_round(search, active, length, phase, on_progress)
        phase, done, length = 0.0, done + length, 2 * length
        active = _left(search, active)
        for b in active[search.sticking[active] != 0].tolist():
            search.states[b] = search.follower.carried_state(search.states[b], int(search.sticking[b])).state
        active = _place_on_clouds(search, active)
        last = done >= most
        active = _settle_some(search, active, SETTLED_LAST if last else SETTLED_EACH)
        if last:
            active = _place_on_clouds(search, active)
        if last or not search.known.entries:
            words = f"no attractor was found: what was followed for {search.known.longest} periods did not settle"
            search.reasons |= dict.fromkeys(active.tolist(), f"not settled in {most} periods" if last else words)
            break
    if on_progress is not None:
        on_progress(total)


def _settle_pilots(search: BasinSearch) -> None:
    """Settle a few starts that are spread over the grid, so that most attractors are known at once."""
    grid = search.plan.grid
    rows, columns = ((np.arange(PILOT) + 0.5) / PILOT * count for count in (grid.y.count, grid.x.count))
    chosen = np.unique((rows.astype(int)[:, None] * grid.x.count + columns.astype(int)).ravel())
    for b in chosen[search.assigned[chosen] == UNDECIDED].tolist():
        known, _ = search.known.rows()
        found = search.follower.follow(search.states[b : b + 1], FIRST, known, phase=grid.phase, bound=search.bound)
        last, bits = found.states[0], int(found.sticking[0])
        if found.outcome[0] == OPEN and search.known.on_cloud(last, bits) < 0:
            search.known.settled(last, bits)


def _follow_round(search: BasinSearch, active: np.ndarray, length: int, phase: float, on_progress: Callable[[int], object] | None) -> None:
    """Follow starts for `length` periods from a phase, and assign those that are caught or unbounded. active: their numbers, (A,)."""
    known, owners = search.known.rows()
    for part, found in _in_blocks(search, active, _follow, length, known, phase, search.bound):
        search.states[part], search.sticking[part] = found.states, found.sticking
        search.periods[part] += found.periods
        search.impacts[part] += found.impacts
        caught, left, ended = (part[found.outcome == code] for code in (CAUGHT, LEFT, ENDED))
        search.assigned[caught] = owners[found.row[found.outcome == CAUGHT]]
        if len(left):
            search.assigned[left] = search.known.unbounded()
        for b, code in zip(ended.tolist(), found.reason[found.outcome == ENDED].tolist(), strict=True):
            search.reasons[b] = f"{SIMULATION_ENDED}: {STATUS[code].value}"
        if on_progress is not None:
            on_progress(int(np.sum(search.assigned >= 0)) + len(search.reasons))


def _settle_some(search: BasinSearch, active: np.ndarray, most: int) -> np.ndarray:
    """Settle some starts, spread evenly over those that are left; return the others."""
    if not len(active):
        return active
    for b in active[np.unique(np.linspace(0, len(active) - 1, min(most, len(active))).astype(int))].tolist():
        search.assigned[b] = search.known.settled(search.states[b], int(search.sticking[b]))
    return _left(search, active)


def _place_on_clouds(search: BasinSearch, active: np.ndarray) -> np.ndarray:
    """Assign the starts whose motion is on a known torus, or in known chaos; return the others."""
    clouds = search.known.clouds()
    if not clouds or not len(active):
        return active
    numbers = np.array([*(k for k, _ in clouds), UNDECIDED])
    for part, found in _in_blocks(search, active, on_clouds, [cloud for _, cloud in clouds]):
        search.assigned[part] = numbers[found]
    return _left(search, active)


def _left(search: BasinSearch, active: np.ndarray) -> np.ndarray:
    """The numbers (A,) of the starts that are neither assigned nor given up."""
    return active[(search.assigned[active] == UNDECIDED) & ~np.isin(active, list(search.reasons))]


def _in_blocks(search: BasinSearch, active: np.ndarray, function: Callable[..., Result], *more: Any) -> Iterator[tuple[np.ndarray, Result]]:
    """The starts of each block, and ``function(follower, states, sticking, *more)`` of their last states: here, or in processes."""
    parts = np.array_split(active, math.ceil(len(active) / BLOCK))
    follower, executor = search.follower, search.executor
    one = partial(function, follower) if executor is None else partial(_anew, function, follower.system, follower.forces)
    for k, found in completed(one, ((search.states[part], search.sticking[part], *more) for part in parts), executor):
        yield parts[k], found


def _anew(function: Callable[..., Result], system: ImpactSystem, forces: Sequence[Force], *task: Any) -> Result:
    """A task in a process, which has a follower of its own."""
    return function(StartFollower(system, forces), *task)


def _follow(
    follower: StartFollower, states: np.ndarray, sticking: np.ndarray, length: int, known: Known, phase: float, bound: float
) -> Followed:
    return follower.follow(states, length, known, sticking=sticking, phase=phase, bound=bound)
