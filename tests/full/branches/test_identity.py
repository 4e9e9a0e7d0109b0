"""Long cases of tests/branches/test_identity.py."""

import pytest

from tests.branches.test_identity import FAMILIES, require_all_presentations_of_an_orbit_are_one, require_the_id_does_not_depend_on_the_cut


@pytest.mark.parametrize("name", FAMILIES)
def test_all_presentations_of_an_orbit_are_one(name):
    """Oracle: see `require_all_presentations_of_an_orbit_are_one`."""
    require_all_presentations_of_an_orbit_are_one(name)


@pytest.mark.parametrize("name", FAMILIES)
def test_the_id_does_not_depend_on_the_cut(name):
    """Oracle: see `require_the_id_does_not_depend_on_the_cut`."""
    require_the_id_does_not_depend_on_the_cut(name)
