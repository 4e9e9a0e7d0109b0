"""Long cases of tests/bvp/test_smooth_pieces.py."""

from __future__ import annotations

import pytest

from tests.bvp.test_smooth_pieces import require_pieces_keep_the_digits_of_strongly_unstable_orbits


@pytest.mark.parametrize("rate", [4.0, 8.0])
def test_pieces_keep_the_digits_of_strongly_unstable_orbits(rate):
    """Oracle: see `require_pieces_keep_the_digits_of_strongly_unstable_orbits`."""
    require_pieces_keep_the_digits_of_strongly_unstable_orbits(rate)
