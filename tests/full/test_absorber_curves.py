"""All points of the curves of the absorber in the plane of frequency and amplitude: the branch through each has the event there."""

import pytest

from tests.branches.test_absorber_curves import CURVES, named
from tests.branches.through_curves import regular_points, require_event


@pytest.mark.parametrize("name", CURVES)
def test_a_branch_through_each_point_of_a_curve_has_the_event(name):
    """Oracle: matrix exponentials before and behind, and the event that is located on the branch, to 1e-9."""
    found = named(name)
    for i in regular_points(found):
        require_event(found, i)
