"""Ids of families of forced orbits from all starts and ranges. Oracle: the id of the family that is followed to both of its ends."""

import pytest

from tests.branches.forced_systems import absorber_families
from tests.branches.test_forced_identity import require_id


@pytest.mark.parametrize("direction", ["both", "along"])
@pytest.mark.parametrize("interval", ["whole", "near", "beyond"])
@pytest.mark.parametrize("part", [0.1, 0.35, 0.6, 0.9])
def test_an_id_depends_neither_on_the_start_nor_on_the_range(part, interval, direction):
    """Oracle: the id of that family."""
    for branch in absorber_families():
        require_id(branch, part, interval, direction)
