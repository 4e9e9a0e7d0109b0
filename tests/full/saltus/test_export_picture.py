"""Long cases of tests/saltus/test_export_picture.py."""

import pytest

from tests.saltus.test_export_picture import require_pictures_take_the_filters_of_list


@pytest.mark.parametrize("what", ["fep", "velocities"])
@pytest.mark.parametrize(
    "filters", ["--label S*", "--energy 0.5", "--stable", "--ends origin-stop", "--impacts 1", "--energy 0.5 --stable --label S13+", ""]
)
def test_pictures_take_the_filters_of_list(catalogue, tmp_path, what, filters):
    """Oracle: see `require_pictures_take_the_filters_of_list`."""
    require_pictures_take_the_filters_of_list(catalogue, tmp_path, what, filters)
