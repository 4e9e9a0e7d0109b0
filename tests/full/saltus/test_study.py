"""Long cases of tests/saltus/test_study.py."""

import pytest

from tests.saltus import test_study as origin
from tests.saltus.running import run
from tests.saltus.test_study import assert_same, require_pictures_are_drawn_from_the_data

finished = origin.finished
one_worker_is_this_process = origin.one_worker_is_this_process


@pytest.mark.parametrize(("view", "kind"), [("map", "png"), ("lines", "pdf"), ("best", "svg")])
def test_pictures_are_drawn_from_the_data(finished, tmp_path, capsys, view, kind):
    """Oracle: see `require_pictures_are_drawn_from_the_data`."""
    require_pictures_are_drawn_from_the_data(finished, tmp_path, capsys, view, kind)


def test_parquet_has_the_same_numbers(finished, tmp_path, capsys):
    """Oracle: the NPZ."""
    pytest.importorskip("pyarrow")
    out = tmp_path / "other"
    assert run(capsys, "study", finished[0], "--out", out, "--format", "parquet", "--workers", 1)[0] == 0
    assert len(list(out.glob("block-*.parquet"))) == 6
    assert_same(out, finished[1])
    code, text, err = run(capsys, "study", finished[0], "--out", out)
    assert code == 2 and not text and "--format parquet" in err
