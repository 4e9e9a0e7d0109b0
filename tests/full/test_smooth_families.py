"""Smooth families that take long by a second method: steep walls, high energies, a beam. Oracles: DOP853, with variations; many digits."""

import math

import numpy as np
import pytest

from branches.naming.at_modes import orbit_at_mode
from saltus.scene import load_scene
from tests.branches.test_smooth_agreement import family, second
from tests.branches.test_smooth_events import FAMILIES, require_events


@pytest.mark.parametrize(("scene", "values", "mode", "energy", "types"), FAMILIES)
def test_events_agree_with_many_digits(scene, values, mode, energy, types):
    """Oracle: see `require_events`."""
    require_events(family(scene, mode, *energy, **values), types, 1 if scene == "beam_on_cubic_spring" else 2)


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


@pytest.mark.parametrize("mode", ["mode:1", "mode:2"])
@pytest.mark.parametrize("h", [0.002, 0.01, 0.05, 0.1, 0.19])
def test_ten_degrees_of_freedom_by_a_second_integrator(mode, h):
    """Oracle: DOP853. The error of a velocity is that of the flow, 1e-13, times its condition of some hundred."""
    orbit = orbit_at_mode(mode, load_scene("beam_on_cubic_spring").system, (h, 2.0 * h))
    other = second(orbit.system)
    velocities, time, _ = other.quarter(np.array(orbit.velocities), orbit.alpha, orbit.h)
    assert abs(time / orbit.alpha - 1.0) < 1e-12
    assert np.abs(velocities - orbit.velocities).max() < 1e-10 * np.abs(velocities).max()
    _, columns = other.flown(np.concatenate([np.zeros(10), velocities]), 4.0 * time)
    assert abs((np.trace(columns) - 2.0) / np.sum(orbit.multipliers).real - 1.0) < 1e-9
