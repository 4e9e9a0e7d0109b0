"""Long cases of tests/branches/test_smooth_agreement.py."""

from __future__ import annotations

import pytest

from tests.branches.test_smooth_agreement import (
    FAMILIES,
    require_a_second_integrator_agrees,
    require_harmonic_balance_agrees_in_ten_degrees_of_freedom,
)


@pytest.mark.parametrize(("scene", "values", "mode", "energy", "energies"), FAMILIES)
def test_a_second_integrator_agrees(scene, values, mode, energy, energies):
    """Oracle: see `require_a_second_integrator_agrees`."""
    require_a_second_integrator_agrees(scene, values, mode, energy, energies)


@pytest.mark.parametrize("h", [0.01, 0.1])
def test_harmonic_balance_agrees_in_ten_degrees_of_freedom(h):
    """Oracle: see `require_harmonic_balance_agrees_in_ten_degrees_of_freedom`."""
    require_harmonic_balance_agrees_in_ten_degrees_of_freedom(h)
