"""Long cases of tests/branches/test_sticking_chains.py."""

from __future__ import annotations

import pytest

from tests.branches.test_sticking_chains import require_settled_motions_that_stick_are_orbits


@pytest.mark.parametrize("seed", [8, 14, 16, 26, 31, 41, 60, 100, 107, 143, 180, 352])
def test_settled_motions_that_stick_are_orbits(seed):
    """Oracle: see `require_settled_motions_that_stick_are_orbits`."""
    require_settled_motions_that_stick_are_orbits(seed)
