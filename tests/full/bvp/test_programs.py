"""Long cases of tests/bvp/test_programs.py."""

import pytest

from tests.bvp.test_programs import POINTS, require_values_and_derivatives_are_those_of_sympy_in_forty_digits


@pytest.mark.parametrize("point", POINTS)
def test_values_and_derivatives_are_those_of_sympy_in_forty_digits(point):
    """Oracle: see `require_values_and_derivatives_are_those_of_sympy_in_forty_digits`."""
    require_values_and_derivatives_are_those_of_sympy_in_forty_digits(point)
