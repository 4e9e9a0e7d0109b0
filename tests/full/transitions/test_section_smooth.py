"""Long cases of tests/transitions/test_section_smooth.py."""

import pytest

from tests.transitions.test_section_smooth import PLANES, require_crossings_are_those_of_a_second_integrator


@pytest.mark.parametrize(("name", "values", "energy"), PLANES)
def test_crossings_are_those_of_a_second_integrator(name, values, energy):
    """Oracle: see `require_crossings_are_those_of_a_second_integrator`."""
    require_crossings_are_those_of_a_second_integrator(name, values, energy)
