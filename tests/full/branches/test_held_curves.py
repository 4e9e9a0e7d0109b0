"""Long cases of tests/branches/test_held_curves.py."""

from __future__ import annotations

import numpy as np
import pytest

import saltus
from branches.forced.closing import largest_residual
from branches.forced.tracing import follow_response
from tests.branches.test_held_curves import (
    family,
    pair,
    pair_curve,
    require_a_pressed_mass_leaves_its_stop,
    require_files_keep_it_and_it_goes_on,
    require_the_ball_leaves_its_table_where_the_acceleration_is_that_of_gravity,
)
from transitions.response.curve_points import starts_on_curve
from transitions.response.path import ParameterPath


@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_the_ball_leaves_its_table_where_the_acceleration_is_that_of_gravity(restitution):
    require_the_ball_leaves_its_table_where_the_acceleration_is_that_of_gravity(restitution)


def test_files_keep_the_family_that_ends_there(tmp_path):
    """Its last orbit has impacts of no speed, and rounding must begin no chatter in it."""
    branch, event = family(pair, 0.5, (0.3, 1.7))
    assert "sticks for the whole period" in event.note and largest_residual(branch.problem, branch.unknowns[event.point]) < 1e-12
    saltus.save_responses([branch], tmp_path / "response.json")
    (read,) = saltus.read_responses(tmp_path / "response.json")
    assert np.array_equal(read.unknowns, branch.unknowns)


@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_a_pressed_mass_leaves_its_stop(restitution):
    """Oracle: see `require_a_pressed_mass_leaves_its_stop`."""
    require_a_pressed_mass_leaves_its_stop(restitution)


def test_a_family_begins_at_a_point():
    """It ends there again, to 1e-9."""
    curve = pair_curve(0.5)
    index = 60
    path = ParameterPath(curve.plane.problem.parametric, ["F"], values=curve.plane.problem.parameters(curve.unknowns[index]))
    (start,) = starts_on_curve(curve, index, path)
    branch = follow_response(start.problem, start.orbit, (0.1, 1.02 * curve.parameters[index, 0]))
    end = next(event for event in branch.events if "sticks for the whole period" in event.note)
    assert end.values["F"] == pytest.approx(curve.parameters[index, 0], rel=1e-9)
    with pytest.raises(ValueError, match="on its other side; expected another direction than down"):
        starts_on_curve(curve, index, path, "down")


def test_a_family_begins_at_a_point_beside_values_that_cannot_be(monkeypatch):
    """The first distance leads to a negative frequency on one side, and far above the resonance on the other one. Oracle: without it."""
    curve = pair_curve(0.5)
    values = curve.plane.problem.parameters(curve.unknowns[60])
    path = ParameterPath(curve.plane.problem.parametric, ["w"], values=values)
    expected = starts_on_curve(curve, 60, path)
    monkeypatch.setattr("transitions.response.curve_points._AWAY", (5.0, 1e-2, 1e-3))
    found = starts_on_curve(curve, 60, path)
    assert [start.orbit.tolist() for start in found] == [start.orbit.tolist() for start in expected]


def test_files_keep_it_and_it_goes_on(tmp_path):
    """Oracle: see `require_files_keep_it_and_it_goes_on`."""
    require_files_keep_it_and_it_goes_on(0.5, tmp_path)
