"""Long cases of tests/bvp/test_hostile_chains.py."""

import pytest

from tests.bvp.test_hostile_chains import require_a_flight_that_overflows_is_reported


@pytest.mark.parametrize("damper", [1e4, 1e7])
def test_a_flight_that_overflows_is_reported(damper):
    """Oracle: see `require_a_flight_that_overflows_is_reported`."""
    require_a_flight_that_overflows_is_reported(damper)
