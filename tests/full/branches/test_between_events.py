"""Long cases of tests/branches/test_between_events.py."""

import pytest

from tests.branches.test_between_events import MIDDLE, require_what_is_decided_between_events_is_so_in_fifty_digits


@pytest.mark.parametrize("name", ["U8344-", "U(15)578-", "U4122-", "S73O33-", *MIDDLE])
def test_what_is_decided_between_events_is_so_in_fifty_digits(name):
    """Oracle: see `require_what_is_decided_between_events_is_so_in_fifty_digits`."""
    require_what_is_decided_between_events_is_so_in_fifty_digits(name)
