"""Long cases of tests/bvp/test_lossy_multipliers.py."""

import pytest

from tests.bvp.test_lossy_multipliers import CASES, require_each_multiplier_keeps_its_digits


@pytest.mark.parametrize("n, coupled, restitution, side", CASES)
def test_each_multiplier_keeps_its_digits(n, coupled, restitution, side):
    """Oracle: see `require_each_multiplier_keeps_its_digits`."""
    require_each_multiplier_keeps_its_digits(n, coupled, restitution, side)
