"""A wide chart of the absorber over the frequency and the amplitude of its load.

Oracles: multipliers and flights by matrix exponentials (`tests.branches.curve_oracles.AbsorberOrbit`); invariants of a chart.
"""

import numpy as np
import pytest

import saltus
from branches.curves.starting import CurveStart
from branches.curves.switching import single_orbit
from saltus.scene import load_scene
from tests.branches.curve_oracles import AbsorberOrbit
from transitions.chart.chart import find_chart
from transitions.chart.known import KnownCurves
from transitions.chart.plan import ChartPlan

WINDOW = ((0.8, 2.5), (0.05, 2.0))


@pytest.fixture(scope="module")
def chart():
    branches = saltus.trace_response(load_scene("absorber").parametric, "w", (0.9, 2.2))
    found, interrupted = find_chart(ChartPlan(branches, ("w", "F"), WINDOW, levels=2, grid=(12, 8)))
    assert not interrupted
    return found


def test_its_size(chart):
    """Invariant: the curves of the first stage, and those behind them."""
    assert chart.stages[0].curves == 5 and chart.stages[1].curves >= 4
    assert {"SN", "SB", "NS", "GR"} <= {curve.code for curve in chart.curves}
    assert {"FN", "PN", "FF", "R4", "NS-GR", "SN-GR", "SB-GR"} <= {type for point in chart.points for type in point.types}


def test_curves_are_those_of_matrix_exponentials(chart):
    """Oracle: the orbits close, and have the multiplier of their curve, at points along it."""
    checked = 0
    for curve in chart.curves:
        problem = curve.plane.problem
        if any(len(symbol) > 1 for symbol in problem.sequence) or curve.code == "GR":
            continue
        for k in np.linspace(1, len(curve) - 2, 5).astype(int):
            orbit = AbsorberOrbit.of(problem, curve.unknowns[k, : curve.plane.size])
            assert orbit.residual() < 1e-9
            # Near a double multiplier its error is the root of that of the orbit.
            assert orbit.distance(curve.code) < 1e-5, (curve.code, curve.parameters[k])
            checked += 1
    assert checked > 50


def test_ends_at_single_orbits_have_their_name(chart):
    """Oracle: the curves of the single orbits, which have the same points."""
    checked = 0
    for curve in chart.curves:
        for event in curve.events:
            single = single_orbit(curve, event.point)
            if single is None:
                continue
            assert event.status == "located" and event.type != "GR-GR"
            others = [
                other for other in chart.curves if other.code == single.code and other.plane.problem.sequence == single.problem.sequence
            ]
            places = [np.abs(other.parameters[one.point] - curve.parameters[event.point]).max() for other in others for one in other.events]
            assert min(places) < 1e-9
            checked += 1
    assert checked >= 2


def test_grazings_touch_a_stop(chart):
    """Oracle: the impact that grazes has no speed, by matrix exponentials."""
    checked = 0
    for curve in chart.curves:
        if curve.code != "GR" or curve.grazing.kind != "speed":
            continue
        for k in np.linspace(0, len(curve) - 1, 5).astype(int):
            y = curve.unknowns[k, : curve.plane.size]
            assert AbsorberOrbit.of(curve.plane.problem, y).residual() < 1e-9
            assert np.abs(curve.plane.problem.impact_speeds(y)).min() < 1e-9
            checked += 1
    assert checked > 20


def test_each_curve_is_there_once(chart):
    """Invariant: the middle of a curve is on no other one."""
    known = KnownCurves()
    for curve in chart.curves:
        known.add(curve)
    for number, curve in enumerate(chart.curves):
        y = curve.unknowns[len(curve) // 2]
        assert known.number_at(CurveStart(curve.plane, curve.code, curve.grazing, y), y) == number


def test_points_are_on_all_their_curves(chart):
    """Invariant: a point of codimension two is at no distance from each curve that is said to pass."""
    size = np.ptp(np.array(WINDOW), axis=1)
    for point in chart.points:
        for number in point.curves:
            places = chart.curves[number - 1].parameters
            assert np.abs((places - point.place) / size).max(axis=1).min() < 0.02
    places = np.array([point.place for point in chart.points]) / size
    apart = np.abs(places[:, None] - places[None]).max(axis=2) + np.eye(len(places))
    assert apart.min() > 1e-6
