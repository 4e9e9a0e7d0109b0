"""Families through the points of curves."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from branches.curves.starting import curve_at
from branches.curves.switching import curve_through
from branches.curves.tracing import extend_curve, follow_curve
from branches.forced.onwards import trace_start
from tests.branches.forced_systems import absorber_families
from tests.branches.test_curves_extended import WIDE, curve
from transitions.response.curve_points import starts_on_curve
from transitions.response.path import ParameterPath


@cache
def touching():
    """The curve of grazings through the point at which the curve of period doublings ends."""
    whole = extend_curve(curve(), WIDE)
    (event,) = (event for event in whole.events if event.type == "PD-GR")
    return follow_curve(curve_through(whole, event.point, "GR"), ((1.9, 2.4), (-1.0, 1.0)))


def families(one, index, name, beside=0.02, direction="both"):
    """The families through a point of a curve in a parameter, near its value."""
    problem, y = one.plane.problem, one.unknowns[index, : one.plane.size]
    values = problem.parameters(y)
    path = ParameterPath(problem.parametric, [name], (), values)
    starts = starts_on_curve(one, index, path, direction)
    return [trace_start(start, (values[name] - beside, values[name] + beside))[0] for start in starts]


@pytest.mark.parametrize("name", ["w", "s"])
def test_a_family_through_a_point_has_the_event_there(name):
    """Oracle: the parameter of the point, to 1e-9; both sides of it."""
    one = curve()
    for i in (0, 7, len(one) - 1):
        (branch,) = families(one, i, name)
        value = one.plane.values(one.unknowns[i, : one.plane.size])[name]
        assert min(abs(event.values[name] - value) for event in branch.events if event.type == "PD") < 1e-9
        assert branch.parameter.min() < value - 0.019 and branch.parameter.max() > value + 0.019


@pytest.mark.parametrize("name", ["w", "s"])
def test_two_families_meet_at_a_grazing(name):
    """Oracle: the response without impacts, and the other one, which ends there; the grazing at s = 1/(w^2 - 1)."""
    one = touching()
    for i in (3, len(one) // 2):
        value = dict(zip(one.names, one.parameters[i].tolist(), strict=True))
        assert value["s"] == pytest.approx(1.0 / (value["w"] ** 2 - 1.0), rel=1e-9)
        found = families(one, i, name)
        assert sorted(branch.problem.sequence for branch in found) == [(), ("+",)]
        for branch in found:
            ends = [event for event in branch.events if event.type == "GR" and event.point in (0, len(branch) - 1)]
            assert min(abs(event.values[name] - value[name]) for event in ends) < 1e-9
            ended = branch.parameter[[0, -1]]
            assert np.abs(ended - value[name]).min() < 1e-9 and np.abs(ended - value[name]).max() == pytest.approx(0.02, rel=1e-6)
        # Below w = 2 both are on one side, a nonsmooth fold.
        sides = {float(np.sign(branch.parameter.mean() - value[name])) for branch in found}
        assert len(sides) == (1 if value["w"] < 2.0 else 2)


def test_a_direction_chooses_between_the_families_at_a_grazing():
    """Oracle: the response without impacts is where the stop is farther away. Below w = 2 the other one is there, too."""
    one = touching()
    high, low = int(np.argmax(one.parameters[:, 0])), int(np.argmin(one.parameters[:, 0]))
    assert [branch.problem.sequence for branch in families(one, high, "s", direction="up")] == [()]
    assert [branch.problem.sequence for branch in families(one, high, "s", direction="down")] == [("+",)]
    assert len(families(one, low, "s", direction="up")) == 2
    with pytest.raises(ValueError, match="on its other side"):
        families(one, low, "s", direction="down")


def test_a_family_folds_at_a_point_of_a_curve_of_folds():
    """Oracle: the event SN of the family, to 1e-9. In both other parameters both sides of the fold are followed."""
    first = absorber_families()[0]
    (event,) = (event for event in first.events if event.type == "SN")
    fold = follow_curve(curve_at(first, event, ("w", "F")), ((2.0, 2.2), (0.25, 0.35)), points=12)
    i = len(fold) - 2
    for name in ("w", "F"):
        (branch,) = families(fold, i, name, beside=0.01)
        value = fold.parameters[i][fold.names.index(name)]
        assert min(abs(event.values[name] - value) for event in branch.events if event.type == "SN") < 1e-9
        away = np.abs(branch.parameter - value)
        assert away[0] > 1e-3 and away[-1] > 1e-3
