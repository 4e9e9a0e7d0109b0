"""Forced chains of masses: what a simulation settles on is an orbit of the multipoint problem."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from branches.family import SETTINGS
from branches.forced.family import ForcedFamily
from bvp.forcing import Harmonic
from bvp.parameters import ParametricSystem
from bvp.simulate import simulate
from continuation.run import follow_both_ways
from tests.branches.forced_systems import settled


def chain(random):
    """A damped chain of up to five masses with a load on one of them and stops on one or two, one- or two-sided."""
    n = int(random.randint(1, 6))
    stiffness = np.diag(random.uniform(1.0, 2.0, n)) + (2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)) * 0.7
    damping = 0.02 * stiffness + np.diag(random.uniform(0.02, 0.2, n))
    stops = []
    for place in random.choice(n, int(random.randint(1, min(n, 2) + 1)), replace=False):
        row = np.zeros(n)
        row[place] = 1.0
        stop = {"c": row.tolist(), "restitution": round(float(random.uniform(0.3, 1.0)), 3)}
        kind = random.randint(3)
        if kind != 1:
            stop["upper"] = round(float(random.uniform(0.2, 0.8)), 3)
        if kind != 0:
            stop["lower"] = -round(float(random.uniform(0.2, 0.8)), 3)
        stops.append(stop)
    load = np.zeros(n)
    load[random.randint(n)] = 1.0
    return ParametricSystem.from_description(
        {
            "parameters": {"F": float(random.uniform(0.5, 2.0)), "w": float(random.uniform(0.6, 2.5))},
            "system": {
                "mass": np.diag(random.uniform(0.5, 1.5, n)).tolist(), "damping": damping.tolist(), "stiffness": stiffness.tolist(),
                "stops": stops,
            },
            "forces": [{"load": load.tolist(), "amplitude": "F", "harmonic": 1}],
        }
    )  # fmt: skip


def periodic_motion(parametric):
    """The problem and the unknowns of the periodic motion of up to three periods that a simulation settles on; None if it does not."""
    for load_periods in (1, 2, 3):
        problem, y = settled(parametric, ["w"], load_periods=load_periods)
        if np.abs(problem.residual(y)).max() < 1e-6:
            return problem, y
    return None


def expected_product(problem, y):
    """The product of all multipliers: prod rho^2 exp(-tr(M^-1 C) T)."""
    system = problem.system
    rates = np.trace(np.linalg.solve(system.mass, system.damping))
    impacts = [system.stops[problem.modes.contact_stop[c]].restitution ** 2 for c in problem.contacts[:-1].tolist() if c >= 0]
    return math.exp(-rates * problem.period(y)) * math.prod(impacts)


def require_motion(problem, y, periods=10):
    """The simulation of an orbit from its first node comes back to it, but for what its largest multiplier makes of rounding."""
    at = problem.parameters(y)
    n = problem.degrees_of_freedom
    system, forces = problem.parametric.system(at), problem.parametric.forces(at)
    node = problem.nodes(y)[0]
    begin = node[2 * n] * problem.load_periods
    shifted = [
        replace(force, cosine=force.cosine * math.cos(angle) + force.sine * math.sin(angle),
                sine=force.sine * math.cos(angle) - force.cosine * math.sin(angle))
        if isinstance(force, Harmonic) else force
        for force in forces
        for angle in [2.0 * math.pi * begin * getattr(force, "frequency", 0.0) / at["w"]]
    ]  # fmt: skip
    first = problem.sequence[0] if problem.sequence else None
    period = problem.period(y)
    after = []
    largest = max(1.0, float(np.abs(problem.multipliers(y)).max()))
    # Of an unstable orbit rounding grows until the motion is another one.
    periods = max(1, min(periods, int(math.log(1e5) / math.log(largest)) if largest > 1.0 else periods))
    for count in (1, periods):
        room = 0.5 * problem.flight_times(y)[0] if problem.sequence else 0.0
        motion = simulate(system, node[:n], node[n : 2 * n], count * period + room, leaving=first, forces=shifted)
        events = motion.stop_events
        impacts = events.after[~events.touches]
        after.append(impacts[count * len(problem.sequence) - 1] if problem.sequence else motion.final)
    size = max(1.0, float(np.abs(node[: 2 * n]).max()))
    speed = problem.solve(y)["speed"]
    for count, state in zip((1, periods), after, strict=True):
        assert np.abs(state - node[: 2 * n]).max() < 1e-9 * size * largest**count / min(1.0, speed)


@cache
def check(seed, stride=1):
    """A random chain: whether a periodic motion was found, which is then solved, continued and simulated again at its points, one of
    `stride`."""
    parametric = chain(np.random.RandomState(seed))
    found = periodic_motion(parametric)
    if found is None:
        return False
    problem, y = found
    solution = problem.solve(y)
    assert np.abs(solution.y - y).max() < 1e-4
    assert solution["clearance"] > -1e-9
    w = parametric.values["w"]
    run = follow_both_ways(ForcedFamily(problem, (0.2 * w, 5.0 * w)), solution.y, replace(SETTINGS, maximum_points=40))
    for point in run.points[::stride]:
        y = point.step.y
        expected = expected_product(problem, y)
        slowest = point.step.extra["speed"]
        if slowest > 1e-12:  # there they are unbounded
            assert np.prod(problem.multipliers(y)) == pytest.approx(expected, rel=1e-10 + 1e-14 / slowest)
        if point.event is None:
            require_motion(problem, y)
    return True


@pytest.mark.parametrize("seed", range(12)[::3])
def test_settled_motions_are_orbits(seed):
    """Oracle: see `require_settled_motions_are_orbits`."""
    require_settled_motions_are_orbits(seed)


def require_settled_motions_are_orbits(seed):
    """Oracle: the simulation, and the product of the multipliers."""
    check(seed, 4)


def test_some_chains_settle():
    """At least half of the chains above have a periodic motion."""
    assert sum(check(seed, 4) for seed in range(12)) >= 6
