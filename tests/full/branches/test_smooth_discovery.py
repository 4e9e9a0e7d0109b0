"""Long cases of tests/branches/test_smooth_discovery.py."""

import pytest

from tests.branches.test_smooth_discovery import require_motions_of_few_half_waves_are_searched_as_all_are


@pytest.mark.parametrize("end", ["rest", "origin"])
def test_motions_of_few_half_waves_are_searched_as_all_are(end):
    """Oracle: see `require_motions_of_few_half_waves_are_searched_as_all_are`."""
    require_motions_of_few_half_waves_are_searched_as_all_are(end)
