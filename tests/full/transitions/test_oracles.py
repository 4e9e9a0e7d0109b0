"""Long cases of tests/transitions/test_oracles.py."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.transitions.test_oracles import (
    STABLE,
    require_a_stable_orbit_stays_on_itself_for_a_hundred_periods,
    require_two_impacts_a_period_lie_on_the_slow_invariant_manifold,
    slope,
    steady,
)


@pytest.mark.parametrize("name", STABLE)
def test_a_stable_orbit_stays_on_itself_for_a_hundred_periods(name):
    """Oracle: see `require_a_stable_orbit_stays_on_itself_for_a_hundred_periods`."""
    require_a_stable_orbit_stays_on_itself_for_a_hundred_periods(name)


def test_the_smallest_amplitude_of_the_regime():
    """Oracle: the manifold's smallest A, r/sqrt(1 + r^2). A falls towards it with the force, and below it the regime is lost."""
    least = slope(0.7) / math.hypot(1.0, slope(0.7))
    found = [steady(0.004, 0.7, force) for force in (0.98, 0.95, 0.92)]
    amplitudes = np.array([amplitude for amplitude, *_ in found])
    assert all(impacts == 2.0 and spread < 1e-10 for *_, impacts, spread in found)
    assert (amplitudes > least).all() and (np.diff(amplitudes) < 0.0).all() and amplitudes[-1] < 1.01 * least
    # Lost, it is no steady one any more: the spread over a window is then as the rounding will have it, so three forces are asked.
    spreads = [steady(0.004, 0.7, force)[-1] for force in (0.9, 0.88, 0.85)]
    assert max(spreads) > 0.01 and min(spreads) > 1e-6


@pytest.mark.parametrize(("rho", "force"), [(0.6, 1.0), (0.6, 1.6), (0.8, 1.2)])
def test_two_impacts_a_period_lie_on_the_slow_invariant_manifold(rho, force):
    """Oracle: see `require_two_impacts_a_period_lie_on_the_slow_invariant_manifold`."""
    require_two_impacts_a_period_lie_on_the_slow_invariant_manifold(rho, force)
