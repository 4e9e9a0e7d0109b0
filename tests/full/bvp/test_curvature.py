"""Long cases of tests/bvp/test_curvature.py."""

from __future__ import annotations

import pytest

from tests.bvp.test_curvature import KINDS, require_derivatives_are_those_of_a_residual_in_many_digits


@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_are_those_of_a_residual_in_many_digits(kind):
    """Oracle: see `require_derivatives_are_those_of_a_residual_in_many_digits`."""
    require_derivatives_are_those_of_a_residual_in_many_digits(kind)
