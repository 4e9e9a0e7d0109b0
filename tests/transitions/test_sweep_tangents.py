"""Tangent vectors of random forced chains, with impacts, chattering, sticking and release.

Oracle: central differences of `simulate`, which has no tangent vectors. A difference whose two sides pass through other events is left out:
steps of 1e-5 and 1e-6 then disagree.
"""

import math

import numpy as np

from bvp.forcing import Constant, Harmonic
from bvp.motion import MotionStatus
from bvp.simulate import simulate
from bvp.system import ImpactSystem, Stop
from transitions.sweep.forced import Carried, ForcedMotion

AGREE = 1e-3
"""Relative difference of two steps that is no change of events."""


def random_chain(rng):
    """One to four masses between walls, with springs and dampers; one or two stops, which do not act on each other."""
    n = int(rng.integers(1, 5))
    spring, damper = rng.uniform(0.5, 2.0, n + 1), rng.uniform(0.02, 0.3, n + 1)
    stiffness, damping = (np.diag(k[:-1] + k[1:]) - np.diag(k[1:-1], 1) - np.diag(k[1:-1], -1) for k in (spring, damper))
    count = int(rng.integers(1, min(n, 2) + 1))
    stops = []
    for j in rng.choice(n, count, replace=False):
        row = np.eye(n)[j]
        if count == 1 and j + 1 < n and rng.random() < 0.5:
            row[j + 1] = -1.0
        lower = -rng.uniform(0.05, 0.5) if rng.random() < 0.5 else -math.inf
        upper = rng.uniform(0.02, 0.5) if lower == -math.inf or rng.random() < 0.5 else math.inf
        stops.append(Stop(tuple(row), lower, upper, float(rng.choice([0.0, *rng.uniform(0.05, 0.95, 3)]))))
    constant = Constant(rng.normal(size=n) * rng.choice([0.0, 1.0]))
    forces = [Harmonic(rng.uniform(0.4, 3.0), rng.normal(size=n), rng.normal(size=n)), constant]
    return ImpactSystem(np.diag(rng.uniform(0.5, 2.0, n)), damping, stiffness, stops), forces


def within_the_stops(system, sticking, change):
    """A perturbation that keeps the gaps of the sticking contacts."""
    letters, n = list(system.modes.contact_letters), system.degrees_of_freedom
    rows = np.array([system.stops[system.modes.contact_stop[letters.index(letter)]].gap for letter in sticking]).reshape(-1, n)
    kept = np.eye(n) - np.linalg.pinv(rows) @ rows if len(rows) else np.eye(n)
    return np.concatenate([kept @ change[:n], kept @ change[n:]])


def differences(system, forces, state, change, period):
    """Central differences of the stroboscopic map along a perturbation, for two steps; None next to a stop."""
    found, n = [], system.degrees_of_freedom
    for step in (1e-5, 1e-6):
        ends = []
        for sign in (1.0, -1.0):
            x = state + sign * step * change
            try:
                ends.append(simulate(system, x[:n], x[n:], period, forces=forces).final)
            except ValueError:
                return None
        found.append((ends[0] - ends[1]) / (2.0 * step))
    return found


def compared_period(rng, system, forces, after):
    """The record of a period, after some others from a random start, whose tangent vector is that of differences; None where these do not
    decide."""
    n = system.degrees_of_freedom
    motion = ForcedMotion(system, forces, Carried(np.concatenate([np.zeros(n), rng.normal(size=n)])))
    change = rng.normal(size=2 * n)
    if motion.advance(after).status is not MotionStatus.DURATION_REACHED:
        return None
    begin = motion.carried
    change = within_the_stops(system, begin.sticking, change)
    if not np.any(change):
        return None
    motion._forced.tangent[:] = change
    record = motion.advance(1)
    with np.errstate(invalid="ignore"):
        tangent = motion._forced.tangent * math.exp(record.growths[0])
    other = simulate(system, begin.state[:n], begin.state[n:], motion.period, forces=forces)
    assert np.abs(other.final - record.states[0]).max() < 1e-9
    found = differences(system, forces, begin.state, change, motion.period)
    if found is None:
        return None
    size = max(float(np.abs(found[1]).max()), 1e-3)
    if np.abs(found[0] - found[1]).max() > AGREE * size:
        return None
    # Rounding of `simulate` over the step of 1e-6.
    assert np.abs(tangent - found[1]).max() < 2e-5 * size
    return record


def check_chains(rng, chains, periods=20):
    """Chains whose differences decide, and those of them that stick."""
    records = [record for _ in range(chains) if (record := compared_period(rng, *random_chain(rng), periods))]
    return len(records), sum(record.sticking_time > 0.0 for record in records)


def test_the_tangent_vector_of_a_period_is_that_of_differences():
    compared, sticking = check_chains(np.random.default_rng(7), 30)
    assert compared > 20 and sticking > 4
