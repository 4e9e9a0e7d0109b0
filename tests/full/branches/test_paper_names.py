"""Long cases of tests/branches/test_paper_names.py."""

import pytest

from tests.branches.test_paper_names import UNSIGNED, require_names_without_a_sign_are_the_same


@pytest.mark.parametrize("name", [*UNSIGNED, "U8335-"])
def test_names_without_a_sign_are_the_same(name):
    """Oracle: see `require_names_without_a_sign_are_the_same`."""
    require_names_without_a_sign_are_the_same(name)
