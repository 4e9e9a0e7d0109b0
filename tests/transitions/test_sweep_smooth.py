"""Forced motion with smooth forces, from period to period of the loads.

Oracles: central differences of `simulate`, DOP853 of scipy, Liouville's formula, a published exponent.
"""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bvp.motion import MotionStatus
from bvp.simulate import simulate
from bvp.springs import Damper, Spring
from bvp.system import ImpactSystem
from saltus import load_scene
from tests.transitions.test_sweep_tangents import AGREE, differences, random_chain, within_the_stops
from transitions.sweep.forced import Carried, ForcedMotion
from transitions.sweep.settle import SettledKind, settle


def smooth_chain(rng):
    """A random chain with a cubic spring on each mass, and a cubic damper on the first one."""
    system, forces = random_chain(rng)
    rows = np.eye(system.degrees_of_freedom)
    springs = [Spring(tuple(row), stiffness=rng.uniform(0.2, 2.0), power=3) for row in rows]
    dampers = [Damper(tuple(rows[0]), damping=rng.uniform(0.0, 0.1), power=3)]
    return ImpactSystem(system.mass, system.damping, system.stiffness, system.stops, springs=springs, dampers=dampers), forces


def test_the_tangent_vector_of_a_period_is_that_of_differences():
    """Oracle: central differences of `simulate`, through impacts, sticking and release."""
    rng = np.random.default_rng(3)
    compared = stuck = hit = 0
    for _ in range(40):
        system, forces = smooth_chain(rng)
        n = system.degrees_of_freedom
        motion = ForcedMotion(system, forces, Carried(np.concatenate([np.zeros(n), rng.normal(size=n)])))
        change = rng.normal(size=2 * n)
        if motion.advance(5).status is not MotionStatus.DURATION_REACHED:
            continue
        begin = motion.carried
        change = within_the_stops(system, begin.sticking, change)
        motion._forced.tangent[:] = change
        record = motion.advance(1)
        with np.errstate(invalid="ignore"):
            tangent = motion._forced.tangent * math.exp(record.growths[0])
        other = simulate(system, begin.state[:n], begin.state[n:], motion.period, forces=forces)
        assert np.abs(other.final - record.states[0]).max() < 1e-9
        found = differences(system, forces, begin.state, change, motion.period)
        if found is None:
            continue
        size = max(float(np.abs(found[1]).max()), 1e-3)
        if np.abs(found[0] - found[1]).max() > AGREE * size:
            continue
        # The error of the difference over the step of 1e-6, as in the test of linear chains.
        assert np.abs(tangent - found[1]).max() < 2e-5 * size
        compared += 1
        stuck += record.sticking_time > 0.0
        hit += record.count > 0
    assert compared > 25 and stuck > 5 and hit > 10


@pytest.mark.parametrize(("load", "period"), [(0.3, 1), (3.0, 1)])
def test_a_settled_motion_closes_in_a_second_integrator(load, period):
    """Oracles: DOP853 over the period; the product of the multipliers is exp(-k T) (Liouville)."""
    scene = load_scene("ueda_oscillator", B=load, k=0.2)
    found = settle(scene.system, scene.forces)
    assert found.kind is SettledKind.PERIODIC and found.period == period
    end = 2.0 * math.pi * period
    other = solve_ivp(
        lambda t, x: [x[1], load * math.cos(t) - 0.2 * x[1] - x[0] ** 3], (0.0, end), found.states[0], "DOP853", rtol=1e-13, atol=1e-15
    )
    assert np.abs(other.y[:, -1] - found.states[0]).max() < 1e-9 * np.abs(found.states).max()
    assert np.prod(found.multipliers) == pytest.approx(math.exp(-0.2 * end), rel=1e-9)


def test_the_exponent_of_ueda_attractor():
    """Oracle: the largest exponent 0.103 given for this attractor by Sprott, Chaos and Time-Series Analysis (2003)."""
    scene = load_scene("ueda_oscillator")
    found = settle(scene.system, scene.forces, most=4096)
    assert found.kind is SettledKind.CHAOS
    assert abs(found.exponent - 0.103) < 4.0 * found.growth_error / found.period_of_loads
    assert found.growth_error / found.period_of_loads < 0.005
