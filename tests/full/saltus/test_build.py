"""Long cases of tests/saltus/test_build.py."""

import pytest

from tests.saltus.test_build import FAR, require_what_is_beside_changes_no_family


@pytest.mark.parametrize(
    ("oscillators", "more"), [((0.15,), ""), ((), FAR.format(gap=[0.0, 1.0])), ((0.15, 0.11), FAR.format(gap=[0.0, 0.0, 1.0, 0.0]))]
)
def test_what_is_beside_changes_no_family(tmp_path, oscillators, more):
    """Oracle: see `require_what_is_beside_changes_no_family`."""
    require_what_is_beside_changes_no_family(tmp_path, oscillators, more)
