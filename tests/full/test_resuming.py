"""Scans of starts that floating-point numbers do not tell apart: more intervals, with more starts in forty digits."""

import pytest

from tests.branches.test_resuming import require_energies_below_the_last_grazing_of_the_backbone_are_complete, require_nothing_new


@pytest.mark.parametrize("energy", [14.0, 14.2])
def test_a_scan_in_forty_digits_adds_nothing(energy):
    """Oracle: changes of sign between starts in forty digits."""
    require_nothing_new(energy, 3, 100)


@pytest.mark.parametrize("energy", [14.0, 14.3, 14.35, 14.5, 14.55])
def test_energies_below_the_last_grazing_of_the_backbone_are_complete(energy):
    """Oracle: see `require_energies_below_the_last_grazing_of_the_backbone_are_complete`."""
    require_energies_below_the_last_grazing_of_the_backbone_are_complete(energy)
