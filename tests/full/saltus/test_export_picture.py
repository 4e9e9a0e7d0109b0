"""Long cases of tests/saltus/test_export_picture.py."""

import pytest

from tests.saltus import test_export_picture as origin
from tests.saltus.test_export_picture import require_a_picture_and_the_same_from_its_data, require_pictures_take_the_filters_of_list

folder = origin.folder


@pytest.mark.parametrize("what", ["fep", "velocities"])
@pytest.mark.parametrize(
    "filters", ["--label S*", "--energy 0.5", "--stable", "--ends origin-stop", "--impacts 1", "--energy 0.5 --stable --label S13+", ""]
)
def test_pictures_take_the_filters_of_list(catalogue, tmp_path, what, filters):
    """Oracle: see `require_pictures_take_the_filters_of_list`."""
    require_pictures_take_the_filters_of_list(catalogue, tmp_path, what, filters)


@pytest.mark.parametrize(("what", "options"), [("fep", "--frequency fundamental --inset 0.1:0.2"), ("velocities", "--names 3")])
def test_a_picture_and_the_same_from_its_data(folder, what, options):
    """Oracle: see `require_a_picture_and_the_same_from_its_data`."""
    require_a_picture_and_the_same_from_its_data(folder, what, options)
