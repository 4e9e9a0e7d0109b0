"""Long cases of tests/transitions/test_section.py."""

import pytest

from tests.transitions.test_section import require_crossings_have_the_times_of_fifty_digits


@pytest.mark.parametrize(("mu", "sigma", "energy", "start"), [(0.1, 0.1, 0.06, 1), (0.1, 0.1, 0.3, 6), (0.37, 0.81, 2.0, 4)])
def test_crossings_have_the_times_of_fifty_digits(mu, sigma, energy, start):
    """Oracle: see `require_crossings_have_the_times_of_fifty_digits`."""
    require_crossings_have_the_times_of_fifty_digits(mu, sigma, energy, start)
