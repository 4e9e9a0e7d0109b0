"""Stability against many digits at more points of the families of tests/branches/test_stability_digits.py, and next to more events."""

import pytest

from tests.branches.test_stability_digits import SAMPLED, require_none_contradicts


@pytest.mark.parametrize("name", SAMPLED)
def test_none_contradicts(name):
    """Oracle: the sign of |tau| - 2 in fifty digits."""
    require_none_contradicts(name, 5, 2)
