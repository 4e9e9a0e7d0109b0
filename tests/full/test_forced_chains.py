"""Two hundred settled motions of random forced chains, and those that stick: each is solved, continued both ways, and simulated again."""

from __future__ import annotations

import pytest

from tests.branches.test_forced_chains import check, require_settled_motions_are_orbits
from tests.branches.test_sticking_chains import check_sticking, require_neighbours


def test_two_hundred_settled_motions():
    """Oracle: the simulation, and the product of the multipliers."""
    assert sum(check(seed) for seed in range(260)) >= 200


def test_motions_that_stick():
    """Oracle: the simulation, and the number of multipliers that are zero."""
    assert sum(check_sticking(seed) for seed in range(500)) >= 75


@pytest.mark.parametrize("seed", [274, 397])
def test_each_grazing_of_a_chain_that_sticks_has_a_neighbour(seed):
    """Oracle: the other family ends at the same frequency."""
    require_neighbours(seed)


@pytest.mark.parametrize("seed", range(12))
def test_settled_motions_are_orbits(seed):
    """Oracle: see `require_settled_motions_are_orbits`."""
    require_settled_motions_are_orbits(seed)
