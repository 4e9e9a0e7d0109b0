"""Long cases of tests/branches/test_atlas.py."""

import pytest

from branches.figures.atlas import atlas_figure, velocities_figure
from tests.branches.test_atlas import (
    require_a_picture_drawn_from_its_exported_data_is_the_same,
    require_cited_names_are_written_as_the_scene_writes_them,
    require_families_frame_the_frequencies_and_an_impulsive_motion_far_below_is_counted,
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


@pytest.mark.parametrize("figure", [atlas_figure, velocities_figure])
def test_cited_names_are_written_as_the_scene_writes_them(figure):
    """Oracle: see `require_cited_names_are_written_as_the_scene_writes_them`."""
    require_cited_names_are_written_as_the_scene_writes_them(figure)


@pytest.mark.parametrize("families", [True, False])
def test_families_frame_the_frequencies_and_an_impulsive_motion_far_below_is_counted(families):
    """Oracle: see `require_families_frame_the_frequencies_and_an_impulsive_motion_far_below_is_counted`."""
    require_families_frame_the_frequencies_and_an_impulsive_motion_far_below_is_counted(families)
