"""Long cases of tests/branches/test_free_normal_forms.py."""

from __future__ import annotations

import math

import mpmath as mp
import numpy as np
import pytest

from branches.curves.switching import curve_through
from branches.curves.tracing import follow_curve
from tests.branches.curve_oracles import DIGITS, ReferenceBackbone
from tests.branches.test_free_criticality import many_digit_breaking
from tests.branches.test_free_normal_forms import (
    RANGES,
    changes,
    curve_of,
    require_criticality_along_a_curve,
    require_folds_end_where_the_criticality_changes,
)


def test_degenerate_pitchforks_in_many_digits():
    """Oracle: the coefficient from broken orbits in fifty digits vanishes over mu."""
    curve = curve_of("S13O00+", "SB")
    events = changes(curve)
    assert [event.type for event in events] == ["DP", "DP"] and {event.status for event in events} == {"located"}
    for event in events:
        near = mp.mpf(event.values["quarter_period"])
        with mp.workdps(DIGITS):

            def place(mu, near=near):
                line = ReferenceBackbone(mu=mu)
                return line, mp.findroot(line.breaking_condition, near)

            def coefficient(mu, place=place):
                line, alpha = place(mu)
                return mp.mpf(many_digit_breaking(alpha, (1,), line))

            mu = mp.mpf(event.values["mu"])
            mu = mp.findroot(coefficient, (mu - mp.mpf("1e-7"), mu + mp.mpf("1e-7")), solver="secant", tol=1e-24)
            line, alpha = place(mu)
            assert abs(event.values["mu"] / mu - 1) < 1e-11
            assert abs(event.values["energy"] / line.energy(alpha) - 1) < 1e-11


@pytest.mark.parametrize(("label", "code", "kind"), [("S31O11-", "SB", "DP"), ("S31O11-", "PD", "GPD")])
def test_folds_end_where_the_criticality_changes(label, code, kind):
    """Oracle: see `require_folds_end_where_the_criticality_changes`."""
    require_folds_end_where_the_criticality_changes(label, code, kind)


def test_a_curve_of_folds_ends_at_the_point():
    """The equations of the doubled orbits are singular there, and the curve has the point of the other one."""
    curve = curve_of("S31O11-", "PD")
    event = changes(curve)[0]
    folds = follow_curve(curve_through(curve, event.point, "SN"), ((-math.inf, math.inf), (-math.inf, math.inf)), points=100)
    (end,) = [one for one in folds.events if one.type == event.type]
    assert end.status == "located" and end.point in (0, len(folds) - 1)
    assert folds.parameters[end.point] == pytest.approx([event.values["mu"], event.values["energy"]], rel=1e-11)
    # It is no jump: the curve itself comes up to it, in a step as its others.
    steps = np.diff(folds.arclength)[:: 1 if end.point == 0 else -1]
    assert 0.0 < steps[0] < steps[1:].max()
    # From there it leads back to that curve.
    back = curve_through(folds, end.point, "PD")
    begin = back.curve(((-math.inf, math.inf), (-math.inf, math.inf))).begin(back.y)
    assert begin.converged and back.code == "PD"
    assert back.plane.linearised(begin.y).parameters == pytest.approx(folds.parameters[end.point], rel=1e-11)


@pytest.mark.parametrize(("label", "code"), RANGES)
def test_criticality_along_a_curve(label, code):
    """Oracle: see `require_criticality_along_a_curve`."""
    require_criticality_along_a_curve(label, code)
