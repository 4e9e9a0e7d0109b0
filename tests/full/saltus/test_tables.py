"""Long cases of tests/saltus/test_tables.py."""

import pytest

from tests.saltus.test_tables import require_a_discovery_fits_the_terminal, require_the_commands_fit_the_terminal


@pytest.mark.parametrize("columns", [60, 80, 100])
def test_the_commands_fit_the_terminal(catalogue, columns):
    """Oracle: see `require_the_commands_fit_the_terminal`."""
    require_the_commands_fit_the_terminal(catalogue, columns)


@pytest.mark.parametrize("columns", [60, 80, 100])
def test_a_discovery_fits_the_terminal(catalogue, columns):
    """Oracle: see `require_a_discovery_fits_the_terminal`."""
    require_a_discovery_fits_the_terminal(catalogue, columns)
