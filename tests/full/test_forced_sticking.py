"""Forced orbits with sticking whose evaluations take long: bounces under another mass, and a ball that leaves its table without rebound."""

from tests.branches.test_forced_closing import require_leaving
from tests.branches.test_forced_sticking import require_one_impact


def test_bounces_that_end_in_sticking_are_one_impact():
    """Oracles: the simulation, differences of the residual, and the orbit with its first bounce as an impact of its own."""
    require_one_impact(2, "m")


def test_the_ball_without_rebound_leaves_its_table_above_gravity():
    """Oracle: Gamma = 1 exactly."""
    require_leaving(0.0)
