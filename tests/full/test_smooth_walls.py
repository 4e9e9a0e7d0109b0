"""Families of steep smooth walls at high energies: many short Taylor steps. Oracle: DOP853 with the equation of variations."""

import math

import numpy as np

from tests.branches.test_smooth_agreement import family, second


def test_walls_of_power_201_are_nearly_reached():
    """Oracle: DOP853 beyond h = 14; the walls open by no more than all energy in their spring, w^202/202, allows."""
    branch = family("smooth_wall", "mode:1", 0.02, 15.0, n=100)
    other = second(branch.system)
    (orbit,) = branch.orbits_at(energy=14.5)
    velocities, time, _ = other.quarter(np.array(orbit.velocities), orbit.alpha, 14.5)
    assert abs(time / orbit.alpha - 1.0) < 1e-10 and np.abs(velocities / orbit.velocities - 1.0).max() < 1e-10
    _, columns = other.flown(np.concatenate([np.zeros(2), velocities]), 4.0 * time)
    assert abs((np.trace(columns) - 2.0) / orbit.tau - 1.0) < 1e-8
    u, _ = orbit.sample(np.linspace(0.0, orbit.period, 400))
    assert 1.0 < np.abs(u @ np.array([1.0, -1.0])).max() <= math.exp(math.log(202.0 * 14.5) / 202.0)
