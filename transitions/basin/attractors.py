"""The attractors that are known while basins are computed: their neighbourhoods and clouds, and what a start settles to."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from transitions.basin.cloud import Cloud, attracts, cloud_of, on_clouds
from transitions.basin.following import Followed, StartFollower
from transitions.basin.identity import attractor_of, is_stable, same_states
from transitions.basin.neighbourhood import joined_rows, neighbourhoods
from transitions.basin.record import UNDECIDED, Attractor, AttractorKind
from transitions.sweep.settle import Settled, settle

if TYPE_CHECKING:
    from transitions.basin.following import Known
    from transitions.response.path import ParameterPath

__all__ = ["KnownAttractors", "KnownAttractor"]


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
