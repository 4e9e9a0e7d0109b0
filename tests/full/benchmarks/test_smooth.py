"""Long cases of tests/benchmarks/test_smooth.py."""

import pytest

from benchmarks.peers import auto
from tests.benchmarks.test_smooth import require_auto_follows_the_same_orbits


@pytest.mark.skipif(auto.missing() is not None, reason="AUTO-07p is not installed")
@pytest.mark.parametrize("closed", [False, True])
def test_auto_follows_the_same_orbits(closed):
    """Oracle: see `require_auto_follows_the_same_orbits`."""
    require_auto_follows_the_same_orbits(closed)
