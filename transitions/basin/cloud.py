"""Attractors without a period as clouds of states at phase 0: whether a motion is on the same one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from transitions.basin.following import OPEN, StartFollower
from transitions.basin.grid import inside
from transitions.sweep.forced import ForcedMotion

__all__ = ["POINTS", "Cloud", "attracts", "cloud_of", "on_clouds"]

POINTS = 4000
"""States of a cloud."""

TRAIL = 48
"""Consecutive states of a motion that are compared with clouds."""

BESIDE = 0.01
"""Distance of motions that begin beside a torus, relative to its size."""

RETURN = 3000
"""Periods after which they have come to it."""

FACTOR = 3.0
"""A motion is on a cloud if the distances of its states from the nearest of the cloud are at most so many times those inside the cloud:
their median, and the largest."""


@dataclass(frozen=True, eq=False)
class Cloud:
    """States of a motion at phase 0.

    Attributes
    ----------
    states : (P, 2n) ndarray
    scale : (2n,) ndarray
        As of `StartFollower`.
    median, largest : float
        Of the distances of each state from the nearest other one.
    """

    states: np.ndarray
    scale: np.ndarray
    median: float
    largest: float

    def contains(self, trails: np.ndarray) -> np.ndarray:
        """Whether motions with states (B, K, 2n) are on the cloud, bool (B,)."""
        found = np.isfinite(trails).all(axis=(1, 2))
        distances = KDTree(self.states * self.scale).query(trails[found] * self.scale)[0]
        found[found] = (np.median(distances, axis=1) <= FACTOR * self.median) & (distances.max(axis=1) <= FACTOR * self.largest)
        return found


def cloud_of(follower: StartFollower, state: np.ndarray, sticking: int) -> Cloud | None:
    """The cloud of the motion from a state at phase 0; None where its simulation ends."""
    motion = ForcedMotion(follower.system, follower.forces, follower.carried_state(state, sticking))
    states = motion.advance(POINTS).states
    if len(states) < POINTS or not np.all(np.isfinite(states)):
        return None
    points = states * follower.scale
    inner = KDTree(points).query(points, k=2)[0][:, 1]
    return Cloud(states, follower.scale, float(np.median(inner)), float(inner.max()))


def on_clouds(follower: StartFollower, states: np.ndarray, sticking: np.ndarray, clouds: Sequence[Cloud]) -> np.ndarray:
    """The index of the cloud that motions from states (B, 2n) at phase 0 are on, or -1, (B,)."""
    found = np.full(len(states), -1)
    if clouds and len(states):
        trail = _trails(follower, states, sticking)
        for k, cloud in enumerate(clouds):
            found[(found < 0) & cloud.contains(trail)] = k
    return found


def attracts(follower: StartFollower, cloud: Cloud) -> bool:
    """Whether motions that begin beside a torus come to it: without losses each motion has a torus of its own, and none attracts."""
    size = float(np.linalg.norm(cloud.states * cloud.scale, axis=1).max())
    steps = np.concatenate([np.eye(len(cloud.scale)), -np.eye(len(cloud.scale))]) * (BESIDE * size / cloud.scale)
    states = cloud.states[-1] + steps
    found = follower.follow(states[inside(follower.system, states)], RETURN)
    return bool(np.all(found.outcome == OPEN)) and bool(np.all(cloud.contains(_trails(follower, found.states, found.sticking))))


def _trails(follower: StartFollower, states: np.ndarray, sticking: np.ndarray) -> np.ndarray:
    """The next states at phase 0 of motions from states (B, 2n): (B, TRAIL, 2n); NaN after the end of a simulation."""
    found = np.full((len(states), TRAIL, states.shape[1]), np.nan)
    going = np.arange(len(states))
    for k in range(TRAIL):
        done = follower.follow(states, 1, sticking=sticking)
        kept = done.outcome == OPEN
        going, states, sticking = going[kept], done.states[kept], done.sticking[kept]
        for b in np.flatnonzero(sticking).tolist():
            states[b] = follower.carried_state(states[b], int(sticking[b])).state
        found[going, k] = states
    return found
