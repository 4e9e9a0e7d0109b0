"""Long cases of tests/transitions/test_transition_picture.py."""

from __future__ import annotations

import pytest

from tests.transitions import test_transition_picture as origin
from tests.transitions.test_transition_picture import (
    require_formats,
    require_no_two_texts_of_a_panel_overlap_and_all_lie_in_the_figure,
    require_the_picture_is_drawn_again_from_its_files,
)

drawn = origin.drawn


@pytest.mark.parametrize("suffix", ["csv", "json", "npz", "mat"])
def test_the_picture_is_drawn_again_from_its_files(drawn, suffix, tmp_path):
    """Oracle: see `require_the_picture_is_drawn_again_from_its_files`."""
    require_the_picture_is_drawn_again_from_its_files(drawn, suffix, tmp_path)


@pytest.mark.parametrize(("kind", "magic"), [("pdf", b"%PDF"), ("svg", b"<?xml")])
def test_formats(drawn, kind, magic, tmp_path):
    """Oracle: see `require_formats`."""
    require_formats(drawn, kind, magic, tmp_path)


@pytest.mark.parametrize("long", [False, True])
def test_no_two_texts_of_a_panel_overlap_and_all_lie_in_the_figure(drawn, long):
    """Oracle: see `require_no_two_texts_of_a_panel_overlap_and_all_lie_in_the_figure`."""
    require_no_two_texts_of_a_panel_overlap_and_all_lie_in_the_figure(drawn, long)
