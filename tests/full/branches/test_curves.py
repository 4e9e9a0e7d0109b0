"""Long cases of tests/branches/test_curves.py."""

from __future__ import annotations

import pytest

from tests.branches.test_curves import (
    STICKING,
    require_grazings_of_a_stop_that_sticks,
    require_points_of_the_absorber_have_their_multiplier,
)


@pytest.mark.parametrize(("family", "note"), STICKING)
def test_grazings_of_a_stop_that_sticks(family, note):
    """Oracle: see `require_grazings_of_a_stop_that_sticks`."""
    require_grazings_of_a_stop_that_sticks(family, note)


@pytest.mark.parametrize(("family", "code"), [(0, "NS"), (0, "SN"), (1, "SN"), (1, "NS"), (1, "SB"), (2, "PD")])
def test_points_of_the_absorber_have_their_multiplier(family, code):
    """Oracle: see `require_points_of_the_absorber_have_their_multiplier`."""
    require_points_of_the_absorber_have_their_multiplier(family, code)
