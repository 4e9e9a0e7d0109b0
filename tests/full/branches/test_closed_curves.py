"""Long cases of tests/branches/test_closed_curves.py."""

from __future__ import annotations

import pytest

from tests.branches.test_closed_curves import (
    require_a_closed_curve_is_that_of_its_closed_form,
    require_a_closed_curve_stays_closed,
    require_an_open_piece_closes,
)


@pytest.mark.parametrize("code", ["SN", "PD", "GR"])
def test_a_closed_curve_is_that_of_its_closed_form(code):
    """Oracle: see `require_a_closed_curve_is_that_of_its_closed_form`."""
    require_a_closed_curve_is_that_of_its_closed_form(code)


@pytest.mark.parametrize("code", ["SN", "PD", "GR"])
def test_a_closed_curve_stays_closed(code, tmp_path):
    """Oracle: see `require_a_closed_curve_stays_closed`."""
    require_a_closed_curve_stays_closed(code, tmp_path)


@pytest.mark.parametrize("code", ["SN", "GR"])
def test_an_open_piece_closes(code):
    """Oracle: see `require_an_open_piece_closes`."""
    require_an_open_piece_closes(code)
