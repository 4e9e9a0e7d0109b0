"""The saddles between basins: unstable periodic orbits, of followed families or from the boundary of the basins.

A start exactly on the boundary between two basins stays on it, and goes to a saddle there. Two starts on both sides are brought together by
bisection, and followed until they have parted a little; then they are brought together again. So the pair stays beside the boundary
and approaches the saddle (edge tracking). Where its motion nearly returns, Newton's method solves the orbit.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bvp.motion import MotionStatus
from transitions.basin.following import CAUGHT, StartFollower
from transitions.basin.identity import is_unstable, mirrored_orbit, saddle_of, same_states, strobe_states
from transitions.response.starting import NoOrbit, settled_orbit
from transitions.sweep.forced import Carried, ForcedMotion, ImpactRecord
from transitions.sweep.settle import Settled, SettledKind

if TYPE_CHECKING:
    from transitions.basin.following import Known
    from transitions.basin.plan import BasinPlan
    from transitions.basin.record import Basin, Saddle

__all__ = ["saddles_between", "saddles_of"]

EDGES = 3
"""Places of the boundary between two basins from which a saddle is sought."""

MOST_EDGES = 24
"""The same of all basins together."""

ROUNDS = 12
"""Times that a pair is brought together."""

BISECTIONS = 26
"""Bisections each time."""

APART = 1e-3
"""Distance, beside the size of the motion, at which the pair is brought together again."""

WATCHED = 40
"""Periods in which a return is sought."""

LONGEST = 12
"""Longest period of a saddle from the boundary, in periods of the loads."""

NEAR = 0.1
"""Distance of a return, beside the size of the motion, up to which Newton's method begins there."""

PATIENCE = 600
"""Periods after which a motion that is not caught counts as on the other side."""

BUDGET = 100_000
"""Periods that are followed in all."""


def saddles_of(plan: BasinPlan) -> list[Saddle]:
    """The unstable orbits of followed families at the parameters of a basin, with their mirror images."""
    found: list[Saddle] = []
    for orbit in plan.orbits:
        if is_unstable(orbit.multipliers):
            _add(found, saddle_of(orbit.problem, orbit.unknowns, plan.grid.phase, orbit.family, orbit.branch), plan.grid.phase)
    return found


def saddles_between(plan: BasinPlan, basin: Basin, known: tuple[Known, np.ndarray], follower: StartFollower) -> tuple[list[Saddle], bool]:
    """The saddles that are found from the boundaries between the basins, and whether all places were tried that are chosen there."""
    found: list[Saddle] = []
    sides = _Sides(follower, *known)
    for one, other in _edges(basin):
        if sides.periods > BUDGET:
            return found, False
        pair = np.stack([basin.grid.states[one], basin.grid.states[other]])
        begun = follower.follow(pair, 0, phase=basin.grid.phase)
        saddle = _tracked(plan, begun.states, begun.sticking, sides)
        if saddle is not None:
            _add(found, saddle, basin.grid.phase)
    return found, True


def _add(found: list[Saddle], saddle: Saddle, phase: float) -> None:
    """Add a saddle and its mirror image, those of them that are not known."""
    image = mirrored_orbit(saddle.problem, saddle.unknowns)
    for one in (saddle, saddle_of(*image, phase, saddle.family, saddle.branch)) if image is not None else (saddle,):
        if not any(same_states(other.states, one.states) for other in found):
            found.append(one)


def _edges(basin: Basin) -> Iterator[tuple[int, int]]:
    """Neighbours on the grid with different attractors: a few of each pair of attractors, spread over their boundary."""
    image = basin.grid.image(basin.attractor)
    numbers = basin.grid.image(np.arange(len(basin)))
    pairs: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for first, second in (((slice(None), slice(-1)), (slice(None), slice(1, None))), ((slice(-1),), (slice(1, None),))):
        a, b, left, right = image[first], image[second], numbers[first], numbers[second]
        for i, j, p, q in zip(*(part[(a != b) & (a >= 0) & (b >= 0)].tolist() for part in (a, b, left, right)), strict=True):
            pairs.setdefault((min(i, j), max(i, j)), []).append((p, q))
    count = 0
    # Beside chaos each bisection takes long: other boundaries come first.
    for edges in (pairs[key] for key in sorted(pairs, key=lambda key: sum(not basin.attractors[k].period for k in key))):
        for k in np.unique(np.linspace(0, len(edges) - 1, 2 * EDGES + 1)[1::2].astype(int)).tolist():
            if count < MOST_EDGES:
                count += 1
                yield edges[k]


@dataclass(eq=False)
class _Sides:
    """To which attractor a state at phase 0 leads, by the neighbourhoods that are known; periods: that were followed for it."""

    follower: StartFollower
    known: Known
    owners: np.ndarray
    periods: int = 0

    def __call__(self, state: np.ndarray) -> int:
        caught = self.follower.follow(state[None], PATIENCE, self.known)
        self.periods += int(caught.periods[0])
        return int(self.owners[caught.row[0]]) if caught.outcome[0] == CAUGHT else -1


def _tracked(plan: BasinPlan, pair: np.ndarray, sticking: np.ndarray, side: _Sides) -> Saddle | None:
    """The saddle to which a pair (2, 2n) of states at phase 0 on both sides of a boundary leads; None where none is found."""
    follower = side.follower
    if np.any(sticking):
        return None
    own = side(pair[0])
    if own == side(pair[1]):
        return None
    for _ in range(ROUNDS):
        if side.periods > BUDGET:
            return None
        for _ in range(BISECTIONS):
            middle = 0.5 * (pair[0] + pair[1])
            pair[0 if side(middle) == own else 1] = middle
        motions = [ForcedMotion(follower.system, follower.forces, Carried(state)) for state in pair]
        records = [motion.advance(WATCHED, impacts=True) for motion in motions]
        if any(record.status is not MotionStatus.DURATION_REACHED for record in records):
            return None
        scaled = [record.states * follower.scale for record in records]
        size = float(np.linalg.norm(scaled[0], axis=1).max())
        parted = np.linalg.norm(scaled[0] - scaled[1], axis=1) > APART * size
        kept = int(np.argmax(parted)) if parted.any() else WATCHED
        saddle = _solved(plan, follower, records[0].states[:kept], scaled[0][:kept] / size, records[0].impacts)
        if saddle is not None:
            return saddle
        if kept < 1:
            return None
        advanced = follower.follow(pair, kept)
        pair = advanced.states
        if np.any(advanced.sticking):
            return None
    return None


def _solved(plan: BasinPlan, follower: StartFollower, states: np.ndarray, scaled: np.ndarray, impacts: ImpactRecord) -> Saddle | None:
    """The unstable orbit beside the closest return of a motion; None where there is none.

    states: (u, v) after each period. scaled: the same as distances, beside the size of the motion."""
    tries = []
    for p in range(1, min(LONGEST, len(states) - 1) + 1):
        distances = np.linalg.norm(scaled[p:] - scaled[:-p], axis=1)
        k = int(np.argmin(distances))
        tries.append((float(distances[k]) * (1.0 + 0.1 * p), p, k, float(distances[k])))
    letters = follower.system.modes.contact_letters
    for _, p, k, distance in sorted(tries)[:3]:
        if distance > NEAR:
            continue
        # states[k] is that after k + 1 periods.
        inside = (impacts.periods > k) & (impacts.periods <= k + p)
        part = ImpactRecord(
            impacts.contacts[inside], impacts.periods[inside] - k - 1, impacts.times[inside], impacts.speeds[inside],
            impacts.before[inside], impacts.after[inside],
        )  # fmt: skip
        stops = tuple(letters[c] for c in part.contacts)
        near = Settled(SettledKind.PERIODIC, p, states[k : k + p], part, stops, follower.period, distance)
        try:
            orbit = settled_orbit(plan.path, near)
        except NoOrbit:
            continue
        if not is_unstable(orbit.problem.period_multipliers(orbit.y)):
            continue
        found = strobe_states(orbit.problem, orbit.y)
        if any(same_states(found[:q], np.roll(found, q, axis=0)[:q]) for q in range(1, p) if p % q == 0):
            continue  # a shorter orbit, repeated: its own period is tried, too
        return saddle_of(orbit.problem, orbit.y, plan.grid.phase)
    return None
