"""Long cases of tests/continuation/test_engine.py."""

import pytest

from tests.continuation.test_engine import require_does_not_jump_to_the_other_branch_of_a_hyperbola


@pytest.mark.parametrize("gap", [1e-1, 1e-2, 1e-3, 1e-5])
def test_does_not_jump_to_the_other_branch_of_a_hyperbola(gap):
    """Oracle: see `require_does_not_jump_to_the_other_branch_of_a_hyperbola`."""
    require_does_not_jump_to_the_other_branch_of_a_hyperbola(gap)
