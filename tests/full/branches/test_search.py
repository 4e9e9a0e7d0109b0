"""Long cases of tests/branches/test_search.py."""

import pytest

from tests.branches.test_search import require_a_uniform_scan_adds_nothing, require_newton_from_random_motions_adds_nothing


@pytest.mark.parametrize(("energy", "mu", "sigma"), [(0.6, 0.1, 0.1), (9.0, 0.1, 0.1), (2.0, 0.37, 0.81)])
def test_a_uniform_scan_adds_nothing(energy, mu, sigma):
    """Oracle: see `require_a_uniform_scan_adds_nothing`."""
    require_a_uniform_scan_adds_nothing(energy, mu, sigma)


@pytest.mark.parametrize(("energy", "mu", "sigma"), [(0.4, 0.1, 0.1), (3.0, 0.1, 0.1), (2.0, 0.37, 0.81)])
def test_newton_from_random_motions_adds_nothing(energy, mu, sigma):
    """Oracle: see `require_newton_from_random_motions_adds_nothing`."""
    require_newton_from_random_motions_adds_nothing(energy, mu, sigma)
