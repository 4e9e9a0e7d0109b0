"""Long cases of tests/bvp/test_curvature.py."""

from __future__ import annotations

import pytest
from hypothesis import given, settings

from tests.bvp.test_curvature import (
    KINDS,
    STATES,
    require_derivatives_are_those_of_a_residual_in_many_digits,
    require_third_derivatives_by_states,
)


@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_are_those_of_a_residual_in_many_digits(kind):
    """Oracle: see `require_derivatives_are_those_of_a_residual_in_many_digits`."""
    require_derivatives_are_those_of_a_residual_in_many_digits(kind)


@settings(max_examples=80, deadline=None, derandomize=True)
@given(STATES)
def test_third_derivatives_by_states_are_those_of_infinitesimals(case):
    """Oracle: see `require_third_derivatives_by_states`."""
    require_third_derivatives_by_states(case)
