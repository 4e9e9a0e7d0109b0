"""Curves on which a stop that sticks for the whole period is left for an instant: its contact force touches zero.

Oracles: closed forms of the contact force, a sum of harmonics; the end of the family that begins at a point of a curve.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import saltus
from branches.curves.held import HeldSurface
from branches.forced.tracing import follow_response
from transitions.response.path import ParameterPath
from transitions.response.starting import settled_orbit
from transitions.sweep.settle import settle


def ball(restitution):
    """A ball on a vibrating table, in the coordinate of the table."""
    return {
        "parameters": {"A": 1.2, "w": 1.0},
        "system": {"mass": [[1.0]], "stiffness": [[0.0]], "stops": [{"c": [1.0], "lower": 0.0, "restitution": restitution}]},
        "forces": [{"load": [1.0], "amplitude": "A*w**2", "harmonic": 1}, {"load": [1.0], "constant": -1.0}],
    }


def pair(restitution):
    """A mass that is pressed on its stop by the load 1, beside a driven one."""
    return {
        "parameters": {"F": 1.6, "w": 0.9, "k": 1.0},
        "system": {
            "mass": [[1.0, 0.0], [0.0, 1.0]], "damping": [[0.1, 0.0], [0.0, 0.2]], "stiffness": [["k", "-k"], ["-k", "k + 1.0"]],
            "stops": [{"c": [1.0, 0.0], "lower": 0.0, "restitution": restitution}],
        },
        "forces": [{"load": [-1.0, 0.0], "constant": 1.0}, {"load": [0.0, 1.0], "amplitude": "F", "harmonic": 1}],
    }  # fmt: skip


@cache
def family(make, restitution, interval):
    """The family of the motion that a simulation settles on, in the first parameter, and the event at which its stop opens no more."""
    parametric = saltus.ParametricSystem.from_description(make(restitution))
    path = ParameterPath(parametric, parametric.names[:1])
    found = settled_orbit(path, settle(parametric.system(), parametric.forces()))
    branch = follow_response(found.problem, found.y, interval)
    return branch, next(event for event in branch.events if "sticks for the whole period" in event.note)


@pytest.mark.parametrize("restitution", [0.5])
def test_the_ball_leaves_its_table_where_the_acceleration_is_that_of_gravity(restitution):
    require_the_ball_leaves_its_table_where_the_acceleration_is_that_of_gravity(restitution)


def require_the_ball_leaves_its_table_where_the_acceleration_is_that_of_gravity(restitution):
    branch, event = family(ball, restitution, (0.5, 1.3))
    curve = saltus.follow_curve(saltus.curve_at(branch, event, ("A", "w")), ((0.01, 5.0), (0.3, 5.0)))
    assert curve.parameters[:, 0] * curve.parameters[:, 1] ** 2 == pytest.approx(1.0, abs=1e-14)
    assert [end.reason for end in curve.ended] == ["EVENT", "EVENT"] and [event.type for event in curve.events] == ["EP", "EP"]
    assert np.ptp(curve.parameters, axis=0) == pytest.approx([4.96, 5.0 - 5.0**-0.5], rel=1e-9)


def force_lost(values):
    """The contact force of `pair` without load, 1, over what the second mass takes at most: 1 where the force touches zero."""
    motion = values["F"] / abs(complex(values["k"] + 1.0 - values["w"] ** 2, 0.2 * values["w"]))
    return values["k"] * motion


@cache
def pair_curve(restitution):
    branch, event = family(pair, restitution, (0.3, 1.7))
    return saltus.follow_curve(saltus.curve_at(branch, event, ("F", "w")), ((0.3, 3.0), (0.3, 2.5)))


@pytest.mark.parametrize("restitution", [0.0])
def test_a_pressed_mass_leaves_its_stop(restitution):
    """Oracle: see `require_a_pressed_mass_leaves_its_stop`."""
    require_a_pressed_mass_leaves_its_stop(restitution)


def require_a_pressed_mass_leaves_its_stop(restitution):
    """The curve does not depend on the restitution."""
    curve = pair_curve(restitution)
    assert len(curve) > 50 and curve.residual.max() < 1e-12
    assert [event.type for event in curve.events] == ["EP", "EP"]
    assert [force_lost(curve.plane.values(y)) for y in curve.unknowns] == pytest.approx([1.0] * len(curve), abs=1e-13)


def test_the_derivatives_of_its_equations():
    """Of the rate of the contact force by differences, near the orbits."""
    curve = pair_curve(0.0)
    y = curve.unknowns[40].copy()
    surface = HeldSurface(curve.plane, y)
    y += 1e-3 * np.cos(np.arange(y.size)) * surface.scales(y)
    jacobian = surface.linearised(y).jacobian.copy()
    for k in range(y.size):
        step = np.zeros(y.size)
        step[k] = 1e-5
        change = surface.linearised(y + step).residual - surface.linearised(y - step).residual
        assert change / 2e-5 == pytest.approx(jacobian[:, k], abs=1e-7), k


def test_files_keep_it_and_it_goes_on(tmp_path):
    """Oracle: see `require_files_keep_it_and_it_goes_on`."""
    require_files_keep_it_and_it_goes_on(0.0, tmp_path)


def require_files_keep_it_and_it_goes_on(restitution, tmp_path):
    """Oracle: the force that is lost."""
    curve = pair_curve(restitution)
    saltus.save_curves([curve], tmp_path / "curve.json")
    (read,) = saltus.read_curves(tmp_path / "curve.json")
    assert read.grazing == curve.grazing and np.array_equal(read.unknowns, curve.unknowns)
    longer = saltus.extend_curve(read, ((0.2, 3.0), (0.25, 2.5)))
    assert len(longer) > len(curve) and longer.parameters[:, 1].min() == pytest.approx(0.25, abs=1e-9)
    assert [force_lost(longer.plane.values(y)) for y in longer.unknowns] == pytest.approx([1.0] * len(longer), abs=1e-13)
