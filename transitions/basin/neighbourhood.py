"""Neighbourhoods of stable periodic motions from which no motion returns farther away.

Let M be the derivative of the stroboscopic map over the period at a state x* of the motion, and rho < 1 the largest modulus of its
multipliers. In the norm |x|^2 = x' Q x with Q = M' Q M/k^2 + 1, rho < k < 1, M brings states closer to x* by the factor k (the discrete
Lyapunov equation). The map itself does so in an ellipsoid that is small enough. Its size is found by trial: states on three shells, in many
directions, must come back closer by (1 + k)/2, with the same number of impacts. The largest such ellipsoid, halved again, is taken.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from transitions.basin.following import OPEN, Known, StartFollower, nothing_known
from transitions.basin.grid import inside
from transitions.sweep.forced import Carried, ForcedMotion

__all__ = ["joined_rows", "neighbourhoods"]

SHELLS = (1.0, 0.5, 0.1)
"""Sizes of the shells, beside that of the ellipsoid on trial."""

DIRECTIONS = 48
"""Directions of each shell, besides those of the axes."""

HALVINGS = 40
"""Trials: each ellipsoid has half the size of the one before."""

SLACK = 1e-7
"""Part of a shell's size by which rounding can keep a motion away."""


def neighbourhoods(follower: StartFollower, states: np.ndarray, sticking: tuple[int, ...], rests: bool) -> Known | None:
    """The neighbourhoods of a periodic motion.

    Parameters
    ----------
    follower : StartFollower
    states : (p, 2n) ndarray
        At phase 0, in the p periods of the motion.
    sticking : tuple of p int
        Bits of the contacts that stick there.
    rests : bool
        Whether stops stick in the period: then the number of impacts, which bounces precede, can differ.

    Returns
    -------
    Known or None
        A row for each state; None where the motion is not certainly stable.
    """
    p, width = states.shape
    scale = follower.scale
    rows: list[Known] = []
    for k in range(p):
        start = follower.carried_state(states[k], sticking[k])
        motion = ForcedMotion(follower.system, follower.forces, start)
        matrix = scale[:, None] * motion.monodromy(p) / scale
        radius = float(np.abs(np.linalg.eigvals(matrix)).max())
        if not radius < 1.0 - 1e-6:
            return None
        factor = 0.5 * (1.0 + radius)
        lyapunov = solve_discrete_lyapunov((matrix / factor).T, np.eye(width))
        metric = np.linalg.cholesky(0.5 * (lyapunov + lyapunov.T)).T * scale
        found = _tried(follower, start, sticking[k], p, metric, 0.5 * (1.0 + factor), rests)
        if found is None:
            return None
        numbers = np.array([[p, sticking[k]]], dtype=np.int64)
        rows.append(Known(start.state[None], metric[None], np.array([found]), np.array([0.5 * (1.0 + factor)]), numbers))
    return joined_rows(rows, width)


def joined_rows(parts: list[Known], width: int) -> Known:
    """The rows of several attractors, one after the other, for states (width,)."""
    return Known(*(np.ascontiguousarray(np.concatenate(arrays)) for arrays in zip(nothing_known(width), *parts, strict=True)))


def _tried(follower: StartFollower, centre: Carried, sticking: int, p: int, metric: np.ndarray, factor: float, rests: bool) -> float | None:
    """The size of the ellipsoid around a state in which trials come closer; None where there is none."""
    width = len(centre.state)
    random = np.random.default_rng(0).standard_normal((DIRECTIONS, width))
    random /= np.linalg.norm(random, axis=1)[:, None]
    steps = np.linalg.solve(metric, np.concatenate([np.eye(width), -np.eye(width), random]).T).T
    own = follower.follow(centre.state[None], p, sticking=np.array([sticking], dtype=np.int64))
    wanted = None if rests else int(own.impacts[0])

    def contracts(tried: np.ndarray) -> bool:
        if sticking:
            tried = np.array([follower.carried_state(state, sticking).state for state in tried])
        tried = tried[inside(follower.system, tried)]
        before = np.linalg.norm((tried - centre.state) @ metric.T, axis=1)
        found = follower.follow(tried, p, sticking=np.full(len(tried), sticking, dtype=np.int64))
        after = np.linalg.norm((found.states - centre.state) @ metric.T, axis=1)
        same = np.all(found.outcome == OPEN) and np.all(found.sticking == sticking) and (wanted is None or np.all(found.impacts == wanted))
        return bool(len(tried) and same and np.all(after <= factor * before + SLACK * size))

    size = float(np.linalg.norm(metric @ centre.state)) or float(np.linalg.norm(metric, 2))
    for _ in range(HALVINGS):
        # Most ellipsoids that are too large fail on the axes of the largest shell.
        if contracts(centre.state + size * steps[: 2 * width]):
            if contracts(np.concatenate([centre.state + shell * size * steps for shell in SHELLS])):
                return 0.5 * size
        size *= 0.5
    return None
