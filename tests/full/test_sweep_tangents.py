"""Tangent vectors of many random forced chains. Oracle: central differences of `simulate`."""

from __future__ import annotations

import numpy as np

from tests.transitions.test_sweep_tangents import check_chains


def test_a_hundred_and_sixty_chains():
    """Oracle: differences, where two steps agree."""
    compared, sticking = check_chains(np.random.default_rng(7), 160)
    assert compared > 140 and sticking > 30
