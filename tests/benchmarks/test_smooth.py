"""The benchmark of smooth families: what it compares is the same orbit."""

import pytest

from benchmarks import smooth
from benchmarks.peers import auto


def test_shooting_and_the_family_have_one_orbit():
    """Oracle: two integrators, from a start that is a thousandth away."""
    orbit = smooth._orbit("cubic_nes", {}, "mode:2", 0.1)
    velocities, time = smooth.shot_quarter(orbit.system, orbit.velocities * 1.001, orbit.alpha * 1.001, orbit.h)
    assert abs(time / orbit.alpha - 1.0) < 1e-12 and velocities == pytest.approx(orbit.velocities, rel=1e-12)


@pytest.mark.skipif(auto.missing() is not None, reason="AUTO-07p is not installed")
@pytest.mark.parametrize("closed", [False])
def test_auto_follows_the_same_orbits(closed):
    """Oracle: see `require_auto_follows_the_same_orbits`."""
    require_auto_follows_the_same_orbits(closed)


def require_auto_follows_the_same_orbits(closed):
    """Oracle: AUTO-07p's quarter period or period, to the digits of its table; of a closed orbit 20 intervals give seven."""
    orbit = smooth._orbit("cubic_nes", {}, "mode:2", 0.1)
    error = float(smooth._beside_auto(orbit, 20, True, closed=closed)[1])
    assert error < (1e-6 if closed else 1e-9)
