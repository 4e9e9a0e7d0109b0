"""Long cases of tests/branches/test_diagram.py."""

from __future__ import annotations

import pytest

from branches.figures.single import branch_figure, orbit_figure
from tests.branches import test_diagram as origin
from tests.branches.test_diagram import (
    make_orbit,
    require_files_are_of_their_format_and_the_same_with_any_settings_of_the_user,
    require_no_two_texts_overlap_and_all_lie_in_the_figure,
    single,
)

drawn = origin.drawn


@pytest.mark.parametrize(
    ("name", "magic", "draw", "data"),
    [
        ("picture.png", b"\x89PNG\r\n\x1a\n", branch_figure, single()),
        ("picture.PDF", b"%PDF-", orbit_figure, make_orbit()),
        ("picture.svg", b"<?xml", orbit_figure, make_orbit()),
    ],
)
def test_files_are_of_their_format_and_the_same_with_any_settings_of_the_user(tmp_path, name, magic, draw, data):
    """Oracle: see `require_files_are_of_their_format_and_the_same_with_any_settings_of_the_user`."""
    require_files_are_of_their_format_and_the_same_with_any_settings_of_the_user(tmp_path, name, magic, draw, data)


@pytest.mark.parametrize("kind", ["png", "svg"])
def test_no_two_texts_overlap_and_all_lie_in_the_figure(drawn, kind):
    """Oracle: see `require_no_two_texts_overlap_and_all_lie_in_the_figure`."""
    require_no_two_texts_overlap_and_all_lie_in_the_figure(drawn, kind)
