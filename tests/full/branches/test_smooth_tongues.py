"""Long cases of tests/branches/test_smooth_tongues.py."""

import pytest

from tests.branches.test_smooth_tongues import CASES, require_tongues


@pytest.mark.parametrize(("scene", "values", "energy", "p_q", "which", "returns"), CASES)
def test_tongues(scene, values, energy, p_q, which, returns):
    """Oracle: see `require_tongues`."""
    require_tongues(scene, values, energy, p_q, which, returns)
