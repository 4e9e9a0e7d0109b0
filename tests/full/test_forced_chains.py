"""Two hundred settled motions of random forced chains: each is solved, continued in both directions, and simulated again."""

from __future__ import annotations

from tests.branches.test_forced_chains import check


def test_two_hundred_settled_motions():
    """Oracle: the simulation, and the product of the multipliers."""
    assert sum(check(seed) for seed in range(260)) >= 200
