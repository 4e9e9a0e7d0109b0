"""Long cases of tests/branches/test_second_grazings.py."""

from __future__ import annotations

import pytest

from branches.curves.grazing import observed
from branches.forced.resequencing import without_impact
from tests.branches.test_curves import STICKING
from tests.branches.test_second_grazings import (
    grazing_below,
    require_curves_of_sticking_end_where_another_stop_is_touched,
    second,
    two_at_once,
)


def test_the_second_grazing_leads_to_a_third():
    """From the curve on which the upper stop is touched: the lower one is touched by orbits that hit the upper one."""
    _, other = second(grazing_below())
    # An impact without speed is a touch, too: either of them names the end.
    assert "two grazings at once" in other.ended[two_at_once(other).point > 0].text
    start, third = second(other)
    problem = third.plane.problem
    assert (problem.sequence, start.grazing.flight) != (other.plane.problem.sequence, other.grazing.flight)
    for y in third.unknowns[2:-2:60]:
        narrow, at = without_impact(problem, observed(problem, y))
        found = observed(narrow, at)
        assert narrow.sequence == ("+",)
        assert abs(found["clearance"]) < 1e-12 and found["clearance_side"] == -1.0 and found["speed"] > 0.0


@pytest.mark.parametrize(("family", "note"), STICKING)
def test_curves_of_sticking_end_where_another_stop_is_touched(family, note):
    """Oracle: see `require_curves_of_sticking_end_where_another_stop_is_touched`."""
    require_curves_of_sticking_end_where_another_stop_is_touched(family, note)
