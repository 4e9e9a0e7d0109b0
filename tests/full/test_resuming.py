"""Scans of starts that floating-point numbers do not tell apart: more intervals, with more starts in forty digits."""

import pytest

from tests.branches.test_resuming import require_nothing_new


@pytest.mark.parametrize("energy", [14.0, 14.2])
def test_a_scan_in_forty_digits_adds_nothing(energy):
    """Oracle: changes of sign between starts in forty digits."""
    require_nothing_new(energy, 3, 100)
