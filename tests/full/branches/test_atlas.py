"""Long cases of tests/branches/test_atlas.py."""

import pytest

from tests.branches.test_atlas import (
    require_a_picture_drawn_from_its_exported_data_is_the_same,
    require_the_impulsive_motions_among_start_velocities,
)


@pytest.mark.parametrize("scale", [(1.0, 1.0), (0.013, 7.7)])
def test_the_impulsive_motions_among_start_velocities(scale):
    """Oracle: see `require_the_impulsive_motions_among_start_velocities`."""
    require_the_impulsive_motions_among_start_velocities(scale)


@pytest.mark.parametrize(("case", "kind"), [(0, "csv"), (1, "json"), (2, "mat")])
def test_a_picture_drawn_from_its_exported_data_is_the_same(case, kind, tmp_path):
    """Oracle: see `require_a_picture_drawn_from_its_exported_data_is_the_same`."""
    require_a_picture_drawn_from_its_exported_data_is_the_same(case, kind, tmp_path)
