"""Forced motion with smooth forces, from period to period of the loads.

Oracles: central differences of `simulate`, DOP853 of scipy, Liouville's formula, a published exponent.
"""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bvp.forcing import Harmonic
from bvp.springs import Damper, Spring
from bvp.system import ImpactSystem
from saltus import load_scene
from tests.transitions.test_sweep_tangents import compared_period, random_chain
from transitions.sweep.forced import Carried, ForcedMotion
from transitions.sweep.settle import SettledKind, settle
from transitions.sweep.sweep import SweepSettings, sweep


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
    records = [record for _ in range(16) if (record := compared_period(rng, *smooth_chain(rng), 5))]
    assert len(records) > 10
    assert sum(record.sticking_time > 0.0 for record in records) > 2 and sum(record.count > 0 for record in records) > 4


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


@pytest.mark.parametrize("w", [0.05, 0.005])
def test_a_slow_load_has_the_exponent_of_its_damper(w):
    """Oracle: half the damping, as the multipliers of an oscillation in one of two wells are complex. A period takes many Taylor steps."""
    well = ImpactSystem([[1.0]], [[0.1]], [[-1.0]], (), springs=[Spring((1.0,), stiffness=1.0, power=3)])
    found, _ = sweep(lambda rate: (well, [Harmonic(rate, [0.1])]), [w], u=[1.0], settings=SweepSettings(4, 8))
    assert found.exponents[0] == pytest.approx(-0.05, rel=1e-9)


def test_a_tangent_vector_that_is_lost_has_no_growth():
    """Oracle: contract. It did not vanish, which would be a growth of -inf."""
    well = ImpactSystem([[1.0]], [[0.1]], [[-1.0]], (), springs=[Spring((1.0,), stiffness=1.0, power=3)])
    motion = ForcedMotion(well, [Harmonic(1.0, [0.1])], Carried(np.array([1.0, 0.0])))
    motion._forced.tangent[:] = math.nan
    assert math.isnan(motion.advance(1).growths[0])
