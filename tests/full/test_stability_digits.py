"""Stability against many digits at more points of the families of tests/branches/test_stability_digits.py, and next to more events."""

import pytest

from tests.branches.test_stability_digits import SAMPLED, require_next_to_a_branch_point_nothing_wrong_is_said, require_none_contradicts


@pytest.mark.parametrize("name", SAMPLED)
def test_none_contradicts(name):
    """Oracle: the sign of |tau| - 2 in fifty digits."""
    require_none_contradicts(name, 5, 2)


@pytest.mark.parametrize(("name", "mirrored"), [("U11+", True), ("S31O11-", False), ("S73O33-", True), ("U4122-", True)])
def test_next_to_a_branch_point_nothing_wrong_is_said(name, mirrored):
    """Oracle: see `require_next_to_a_branch_point_nothing_wrong_is_said`."""
    require_next_to_a_branch_point_nothing_wrong_is_said(name, mirrored)
