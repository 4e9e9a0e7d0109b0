"""Long cases of tests/branches/test_grazing.py."""

import pytest

from tests.branches.test_grazing import (
    GRAZINGS,
    IDS,
    S73,
    U8353,
    require_orbits_beside_the_grazing_are_those_of_the_neighbours,
    require_the_grazing_orbit_solves_both_problems,
)


@pytest.mark.parametrize(("name", "h"), GRAZINGS, ids=IDS)
def test_the_grazing_orbit_solves_both_problems(name, h):
    """Oracle: see `require_the_grazing_orbit_solves_both_problems`."""
    require_the_grazing_orbit_solves_both_problems(name, h)


@pytest.mark.parametrize(("name", "h", "most"), [("S13O00+", 14.5537, 3), (S73, 72.737, 4), (U8353, 2.58769, 8)])
def test_orbits_beside_the_grazing_are_those_of_the_neighbours(name, h, most):
    """Oracle: see `require_orbits_beside_the_grazing_are_those_of_the_neighbours`."""
    require_orbits_beside_the_grazing_are_those_of_the_neighbours(name, h, most)
