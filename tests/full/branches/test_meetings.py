"""Long cases of tests/branches/test_meetings.py."""

import pytest

from tests.branches.test_meetings import (
    MET,
    SYSTEM,
    UNEQUAL,
    require_arcs_that_are_apart_do_not_cross_and_those_that_turn_apart_cross_once_at_most,
    require_each_orbit_is_met_from_both_its_ends_and_no_other_motion,
)


@pytest.mark.parametrize("chart", [(0, 1), (0, 2), (1, 2)])
def test_arcs_that_are_apart_do_not_cross_and_those_that_turn_apart_cross_once_at_most(chart):
    """Oracle: see `require_arcs_that_are_apart_do_not_cross_and_those_that_turn_apart_cross_once_at_most`."""
    require_arcs_that_are_apart_do_not_cross_and_those_that_turn_apart_cross_once_at_most(chart)


@pytest.mark.parametrize(
    ("system", "energy", "quarter_period", "impacts"),
    [*MET, (SYSTEM, 3.0, 5.1, 10), (SYSTEM, 10.0, 5.1, 10), (UNEQUAL, 8.0, 3.0, 6)],
)
def test_each_orbit_is_met_from_both_its_ends_and_no_other_motion(system, energy, quarter_period, impacts):
    """Oracle: see `require_each_orbit_is_met_from_both_its_ends_and_no_other_motion`."""
    require_each_orbit_is_met_from_both_its_ends_and_no_other_motion(system, energy, quarter_period, impacts)
