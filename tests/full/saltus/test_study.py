"""Long cases of tests/saltus/test_study.py."""

import pytest

from tests.saltus import test_study as origin
from tests.saltus.test_study import require_pictures_are_drawn_from_the_data

finished = origin.finished
one_worker_is_this_process = origin.one_worker_is_this_process


@pytest.mark.parametrize(("view", "kind"), [("map", "png"), ("lines", "pdf"), ("best", "svg")])
def test_pictures_are_drawn_from_the_data(finished, tmp_path, capsys, view, kind):
    """Oracle: see `require_pictures_are_drawn_from_the_data`."""
    require_pictures_are_drawn_from_the_data(finished, tmp_path, capsys, view, kind)
