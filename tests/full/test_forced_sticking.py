"""Forced orbits with sticking whose evaluations take long: bounces under another mass, and a ball that leaves its table without rebound."""

import pytest

from tests.branches.test_forced_closing import require_leaving
from tests.branches.test_forced_sticking import (
    require_a_family_with_sticking_is_its_closed_form,
    require_one_impact,
    require_the_simulation_comes_back_and_zeros_are_exact,
)


def test_bounces_that_end_in_sticking_are_one_impact():
    """Oracles: the simulation, differences of the residual, and the orbit with its first bounce as an impact of its own."""
    require_one_impact(2, "m")


def test_the_ball_without_rebound_leaves_its_table_above_gravity():
    """Oracle: Gamma = 1 exactly."""
    require_leaving(0.0)


@pytest.mark.parametrize(("w", "damping"), [(0.5, 0.1), (0.6, 0.0), (0.7, 0.4)])
def test_a_family_with_sticking_is_its_closed_form(w, damping):
    """Oracle: see `require_a_family_with_sticking_is_its_closed_form`."""
    require_a_family_with_sticking_is_its_closed_form(w, damping)


@pytest.mark.parametrize(("n", "stops"), [(2, 1), (3, 1), (3, 2)])
def test_the_simulation_comes_back_and_zeros_are_exact(n, stops):
    """Oracle: see `require_the_simulation_comes_back_and_zeros_are_exact`."""
    require_the_simulation_comes_back_and_zeros_are_exact(n, stops)
