"""Long cases of tests/branches/test_smooth.py."""

import pytest

from tests.branches.test_smooth import require_no_corner_is_seen


@pytest.mark.parametrize("name", ["U8353-", "S11O00-"])
def test_no_corner_is_seen(name):
    """Oracle: see `require_no_corner_is_seen`."""
    require_no_corner_is_seen(name)
