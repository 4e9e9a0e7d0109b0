"""Curves of bifurcations and of grazings of free orbits with smooth forces.

Oracles: the events of families at other parameters, and the slope of a family from differences."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import fsolve

import saltus
from branches.curves.free_start import released_of
from branches.curves.starting import curve_start
from branches.curves.tracing import follow_curve
from branches.released.criticality import free_criticality
from bvp.multipoint import MultipointProblem

FREE = (0.0, math.inf)
WALL = saltus.load_scene("smooth_wall").parametric
SINK = saltus.load_scene("cubic_and_stops").parametric


def curve_of(parametric, label, code, name, window, energy=(0.05, 1.0)):
    """The curve over a parameter and the energy through the first event of a type of a family, and that family."""
    branch = saltus.trace(label, parametric.system(), energy=energy)
    event = next(event for event in branch.events if event.type == code)
    problem, y = released_of(branch.orbit(event.point), (name, "energy"), parametric)
    return follow_curve(curve_start(problem, y, code, (name, "energy")), (window, FREE)), branch


def events_at(parametric, label, name, value, code, energy):
    """The events of a type of a family at another value of a parameter."""
    branch = saltus.trace(label, parametric.replaced({name: value}).system(), energy=energy)
    return [(event, branch) for event in branch.events if event.type == code]


@pytest.fixture(scope="module")
def folds():
    return curve_of(WALL.replaced({"n": 15.0}), "S11-", "SN", "n", (10.0, 16.0))[0]


def test_folds_of_a_steep_spring(folds):
    """Oracle: the folds of the family at n = 16."""
    wanted = [event.h for event, _ in events_at(WALL, "S11-", "n", 16.0, "SN", (0.06, 0.08))]
    ends = [values[1] for values in folds.parameters[[0, -1]]]
    assert [end.reason for end in folds.ended] == ["EVENT", "EVENT"]
    assert sorted(ends) == pytest.approx(sorted(wanted), rel=1e-11)


def test_coefficients_of_the_folds(folds):
    """They vanish at the cusp, and change little from point to point, also at the start of the curve."""
    (cusp,) = [event for event in folds.events if event.type == "CP"]
    assert folds.coefficient[cusp.point] == pytest.approx(0.0, abs=1e-9)
    assert np.all(np.delete(folds.coefficient, cusp.point) > 0.0)
    for part in (folds.coefficient[: cusp.point - 2], folds.coefficient[cusp.point + 3 :]):
        assert np.all(np.abs(np.diff(np.log(part))) < 0.7)


def test_cusp_of_the_folds(folds):
    """Oracle: the first and second derivatives of the energy by the quarter period, from differences of order 8 along the family, vanish.
    Their rounding is 1e-10 of the third derivative."""
    (cusp,) = [event for event in folds.events if event.type == "CP"]
    assert cusp.status == "located"
    first = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
    second = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560])
    problem, at = folds.plane.problem.orbit_problem(folds.unknowns[cusp.point, : folds.plane.size])
    start = [at]

    def slopes(place):
        quarter, n = place
        made = MultipointProblem(WALL.replaced({"n": float(n)}).system(), problem.ends, ())
        energies = []
        for k in np.arange(-4, 5):
            start[0] = made.solve(start[0], quarter_period=quarter + 0.002 * k).y
            energies.append(made.energy(start[0]))
        return first @ energies / 0.002, second @ energies / 0.002**2

    found = fsolve(slopes, [problem.quarter_period(at), cusp.values["n"] + 1e-4], xtol=1e-10)
    assert cusp.values["n"] == pytest.approx(found[1], rel=5e-8)
    assert cusp.values["quarter_period"] == pytest.approx(found[0], rel=1e-8)


@pytest.mark.parametrize(
    ("parametric", "label", "code", "name", "window", "value"),
    [
        (WALL, "S11-", "PD", "mu", (0.1, 0.102), 0.102),
        (SINK, "S11O00-", "SN", "k3", (0.5, 0.6), 0.6),
        (SINK, "S11O00-", "GR", "k3", (0.5, 0.6), 0.6),
    ],
)
def test_curves_end_at_events_of_families(parametric, label, code, name, window, value):
    """Oracle: see `require_end_at_an_event`. All codes: tests/full."""
    require_end_at_an_event(parametric, label, code, name, window, value)


def require_end_at_an_event(parametric, label, code, name, window, value):
    """Oracle: the event of the family at the end of the range, with its coefficient."""
    curve, _ = curve_of(parametric, label, code, name, window)
    end = int(np.argmax(curve.parameters[:, 0]))
    assert curve.parameters[end, 0] == pytest.approx(value, rel=1e-12)
    found = events_at(parametric, label, name, value, code, (0.05, 1.0))
    energy = float(curve.parameters[end, 1])
    event, branch = min(found, key=lambda one: abs(one[0].h - energy))
    assert event.h == pytest.approx(energy, rel=1e-10)
    if code == "PD":
        known = free_criticality(branch.orbit(event.point), code)
        assert curve.criticality[end] == known.kind and math.isfinite(curve.coefficient[end])
