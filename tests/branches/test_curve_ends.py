"""Ends of curves: at the domain of either parameter, and at 1:1 resonances without events that are none."""

import math

import pytest

import saltus


@pytest.fixture(scope="module")
def damper():
    parametric = saltus.load_scene("forced_impact_damper").parametric
    (response,) = saltus.trace_response(parametric, "w", (0.9, 1.4))
    return response


@pytest.mark.parametrize("names", [("e", "w")])
def test_a_curve_ends_at_the_domain_of_either_parameter(damper, names):
    require_a_curve_ends_at_the_domain_of_either_parameter(damper, names)


def require_a_curve_ends_at_the_domain_of_either_parameter(damper, names):
    window = {"w": (0.5, 2.0), "e": (-1.0, 2.0)}
    curve = saltus.follow_curve(saltus.curve_at(damper, "SB1", names), tuple(window[name] for name in names))
    assert [end.reason for end in curve.ended] == ["EVENT", "EVENT"]
    place = names.index("e")
    assert curve.parameters[0, place] == pytest.approx(1.0, abs=1e-9)
    assert curve.parameters[-1, place] == pytest.approx(1.0, abs=1e-9)
    assert all("e leaves its domain here" in end.text for end in curve.ended)


@pytest.mark.parametrize("id", ["NS2"])
def test_no_bautin_point_lies_beside_a_resonance(damper, id):
    require_no_bautin_point_lies_beside_a_resonance(damper, id)


def require_no_bautin_point_lies_beside_a_resonance(damper, id):
    start, window = saltus.curve_at(damper, id, ("w", "F")), ((0.5, 2.0), (0.01, 1.0))
    curve = saltus.follow_curve(start, window)
    for index in (len(curve) // 3, 3 * len(curve) // 4):
        again = saltus.follow_curve(start._replace(y=curve.unknowns[index]), window)
        (resonance,) = (event for event in again.events if event.type == "R1")
        for event in again.events:
            if event.type == "GH":
                assert math.dist(again.parameters[event.point], again.parameters[resonance.point]) > 1e-3
        assert sum(event.type == "GH" for event in again.events) == {"NS1": 2, "NS2": 0}[id]


def test_the_period_doubling_of_the_bouncing_ball_is_that_of_its_closed_form():
    parametric = saltus.load_scene("bouncing_ball", Gamma=0.4, e=0.8).parametric
    (response,) = saltus.trace_response(parametric, "Gamma", (0.3, 1.5), u=[0.001], v=[2.79], phase=0.51)
    curve = saltus.follow_curve(saltus.curve_at(response, "PD1", ("Gamma", "e")), ((0.1, 8.0), (0.0, 1.0)))
    for gamma, e in curve.parameters:
        assert gamma == pytest.approx(math.hypot(math.pi * (1 - e) / (1 + e), 2 * (1 + e * e) / (1 + e) ** 2), rel=1e-9)
    assert sorted(curve.parameters[[0, -1], 1].tolist()) == pytest.approx([0.0, 1.0], abs=1e-9)
