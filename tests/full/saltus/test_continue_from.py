"""Long cases of tests/saltus/test_continue_from.py."""

import pytest

from tests.saltus.test_continue_from import MODES, require_families_of_modes_are_the_closed_form


@pytest.mark.parametrize(("n", "lower", "number"), MODES)
def test_families_of_modes_are_the_closed_form(tmp_path, capsys, n, lower, number):
    """Oracle: see `require_families_of_modes_are_the_closed_form`."""
    require_families_of_modes_are_the_closed_form(tmp_path, capsys, n, lower, number)
