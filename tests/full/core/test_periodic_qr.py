"""Long cases of tests.core.test_periodic_qr.py."""

import pytest

from tests.core.test_periodic_qr import CASES, require_each_eigenvalue_keeps_its_digits


@pytest.mark.parametrize("name", CASES)
def test_each_eigenvalue_keeps_its_digits(name):
    """Oracle: see `require_each_eigenvalue_keeps_its_digits`."""
    require_each_eigenvalue_keeps_its_digits(name)
