"""The energy of many impacts does not drift, of hundreds of systems. Oracle: initial energy = dissipated + present."""

import pytest

from tests.bvp.test_drift import check_two_masses

pytestmark = pytest.mark.rounding


def test_of_two_masses():
    """Oracle: the balance of energies."""
    assert check_two_masses(300) > 100
