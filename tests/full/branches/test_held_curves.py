"""Long cases of tests/branches/test_held_curves.py."""

from __future__ import annotations

import numpy as np
import pytest

import saltus
from branches.forced.closing import largest_residual
from tests.branches.test_held_curves import family, pair, require_the_ball_leaves_its_table_where_the_acceleration_is_that_of_gravity


@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_the_ball_leaves_its_table_where_the_acceleration_is_that_of_gravity(restitution):
    require_the_ball_leaves_its_table_where_the_acceleration_is_that_of_gravity(restitution)


def test_files_keep_the_family_that_ends_there(tmp_path):
    """Its last orbit has impacts of no speed, and rounding must begin no chatter in it."""
    branch, event = family(pair, 0.5, (0.3, 1.7))
    assert "sticks for the whole period" in event.note and largest_residual(branch.problem, branch.unknowns[event.point]) < 1e-12
    saltus.save_responses([branch], tmp_path / "response.json")
    (read,) = saltus.read_responses(tmp_path / "response.json")
    assert np.array_equal(read.unknowns, branch.unknowns)
