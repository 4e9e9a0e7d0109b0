"""Long cases of tests/bvp/test_hostile_chains.py."""

import pytest

from tests.bvp.test_hostile_chains import require_rates_far_apart_do_not_overflow


@pytest.mark.parametrize("damper", [1e4, 1e7])
def test_rates_far_apart_do_not_overflow(damper):
    """Oracle: see `require_rates_far_apart_do_not_overflow`."""
    require_rates_far_apart_do_not_overflow(damper)
