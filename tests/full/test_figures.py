"""Pictures of many families with all insets on both axes of frequency."""

import pytest

from tests.branches.test_atlas import require_insets


@pytest.mark.parametrize("frequency", ["index", "fundamental"])
@pytest.mark.parametrize("texts", ["0.2:0.4,0.7:1.2", "0.04:29", "0.5:2 0.09:0.16 5:20,0.8:1.4"])
def test_insets_show_their_part_larger_beside_the_axes(texts, frequency):
    """Oracles: see `require_insets`."""
    require_insets(texts, frequency)
