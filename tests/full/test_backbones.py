"""The backbones of random systems."""

import pytest

from tests.saltus.test_continue import RANDOM, check_backbone


@pytest.mark.parametrize(("mu", "sigma"), [*map(tuple, RANDOM)])
def test_random_systems(mu, sigma):
    """Oracle: closed form."""
    check_backbone(mu, sigma)
