"""Long cases of tests/branches/test_self_excited_curves.py."""

from __future__ import annotations

import pytest

from tests.branches.test_self_excited_curves import (
    require_curves_of_a_free_period,
    require_curves_of_a_free_period_meet,
    require_events_of_the_families,
    require_the_only_impact_vanishes_where_a_linear_mode_is_neutral,
    require_touches_of_a_free_period,
)


@pytest.mark.parametrize(
    ("name", "codes"),
    [("symmetric", ["GR", "SB", "SN", "GR"]), ("doubling", ["GR", "SN", "PD", "GR"]), ("torus", ["GR", "SN", "NS", "GR"])],
)
def test_events_of_the_families(name, codes):
    """Oracle: see `require_events_of_the_families`."""
    require_events_of_the_families(name, codes)


@pytest.mark.parametrize(
    ("name", "code", "events"),
    [
        ("symmetric", "SN", ["FF"]),
        ("symmetric", "SB", ["FF"]),
        ("doubling", "SN", []),
        ("doubling", "PD", []),
        ("torus", "SN", ["R1"]),
        ("torus", "NS", ["R1"]),
    ],
)
def test_curves_of_a_free_period(name, code, events):
    """Oracle: see `require_curves_of_a_free_period`."""
    require_curves_of_a_free_period(name, code, events)


@pytest.mark.parametrize(("name", "first", "second", "event"), [("symmetric", "SN", "SB", "FF"), ("torus", "SN", "NS", "R1")])
def test_curves_of_a_free_period_meet(name, first, second, event):
    """Oracle: see `require_curves_of_a_free_period_meet`."""
    require_curves_of_a_free_period_meet(name, first, second, event)


@pytest.mark.parametrize(("name", "names"), [("symmetric", ("lam", "rho")), ("doubling", ("lam", "rho")), ("doubling", ("lam", "c"))])
def test_touches_of_a_free_period(name, names):
    """Oracle: see `require_touches_of_a_free_period`."""
    require_touches_of_a_free_period(name, names)


@pytest.mark.parametrize("name", ["symmetric", "doubling"])
def test_the_only_impact_vanishes_where_a_linear_mode_is_neutral(name):
    """Oracle: see `require_the_only_impact_vanishes_where_a_linear_mode_is_neutral`."""
    require_the_only_impact_vanishes_where_a_linear_mode_is_neutral(name)
