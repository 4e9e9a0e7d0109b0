"""The events of the absorber's responses with many impacts, against forty digits; those with few are in tests/branches/test_absorber.py."""

import pytest

from tests.branches.test_absorber import EVENTS, FAST, require_event


@pytest.mark.parametrize("cells", [cells for cells in EVENTS if cells not in FAST], ids=lambda cells: f"{cells[0]} {cells[3]}")
def test_events_with_many_impacts(cells):
    """Oracle: `require_event`."""
    require_event(cells)
