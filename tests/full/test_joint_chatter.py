"""Bounces at several contacts that act on each other: more systems than in tests/bvp."""

from __future__ import annotations

import pytest

from tests.bvp.test_joint_chatter import check_chains, check_two_contacts, coupled


@pytest.mark.parametrize("share", [0.02, 0.5, 0.9])
def test_two_contacts_come_to_rest_as_event_by_event_in_fifty_digits(share):
    """Oracle: fifty digits."""
    for seed in range(6):
        check_two_contacts(coupled(seed, share))


def test_chains_with_many_stops_run_to_the_end():
    """Oracles: the balance of energies, the bounds of the gaps."""
    check_chains(range(160))
