"""Curves of orbits whose period is free, of a self-excited oscillator with an absorber, against forty digits of their closed form."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from branches.curves.record import BifurcationCurve
from branches.curves.starting import NoCurve, curve_at
from branches.curves.switching import curve_through
from branches.curves.tracing import extend_curve, follow_curve
from branches.forced.branch import ForcedBranch
from tests.branches.self_excited import exact_point, family, neutral_damping

FAMILIES = {
    "symmetric": (True, {"lam": 0.015}, 3.35),
    "doubling": (False, {"lam": 0.1, "c": 0.02}, 7.13),
    "torus": (False, {"lam": 0.05}, 13.9),
}
"""Whether two stops act, the parameters of an orbit, and the duration of its segment."""

WINDOW = ((0.0, 0.5), (0.05, 0.95))


@cache
def branch(name: str) -> ForcedBranch:
    return family(*FAMILIES[name], (0.001, 0.3))


@cache
def curve(name: str, code: str) -> BifurcationCurve:
    return follow_curve(curve_at(branch(name), f"{code}1", ("lam", "rho")), WINDOW)


def exact(name: str, found: BifurcationCurve, i: int) -> tuple[float, float]:
    """lam and the duration of the segment at the second parameter of a point of a curve."""
    problem, y = found.plane.problem, found.unknowns[i, : found.plane.size]
    code = {"SB": "PD"}.get(found.code, found.code)
    sign = -1 if FAMILIES[name][0] else 1
    return exact_point(code, problem.parameters(y), float(problem.flight_times(y).sum()), sign, "lam")


@pytest.mark.parametrize(("name", "codes"), [("torus", ["GR", "SN", "NS", "GR"])])
def test_events_of_the_families(name, codes):
    """Oracle: see `require_events_of_the_families`."""
    require_events_of_the_families(name, codes)


def require_events_of_the_families(name, codes):
    """Oracle: forty digits. At a fold the critical multiplier meets the one that is 1 for all orbits: that is no Neimark-Sacker
    bifurcation."""
    found = branch(name)
    assert sorted(event.type for event in found.events) == sorted(codes)
    for event in found.events:
        if event.type == "GR":
            continue
        y = found.unknowns[event.point]
        code = {"SB": "PD"}.get(event.type, event.type)
        time = float(found.problem.flight_times(y).sum())
        value, _ = exact_point(code, found.problem.parameters(y), time, -1 if found.problem.half else 1, "lam")
        assert event.values["lam"] == pytest.approx(value, rel=1e-11)


def test_a_family_ends_where_its_only_impact_vanishes():
    """Oracle: without impacts a linear mode would repeat itself at one value of the parameter alone, so no family is on the other side.
    The orbits with one more impact turn back there."""
    vanishing = next(event for event in branch("symmetric").events if "vanishes" in (event.note or ""))
    assert vanishing.neighbours == (("+", False),)


@pytest.mark.parametrize(("name", "code", "events"), [("doubling", "PD", []), ("torus", "SN", ["R1"])])
def test_curves_of_a_free_period(name, code, events):
    """Oracle: see `require_curves_of_a_free_period`."""
    require_curves_of_a_free_period(name, code, events)


def require_curves_of_a_free_period(name, code, events):
    """Oracle: forty digits, at the second parameter of the point. Multipliers that are 1 for all orbits make no event."""
    found = curve(name, code)
    assert found.residual.max() < 1e-12
    assert [event.type for event in found.events if event.type != "EP"] == events
    for i in (len(found) // 3,) if code == "SN" else (len(found) // 3, len(found) - 2):
        lam, time = exact(name, found, i)
        assert found.parameters[i, 0] == pytest.approx(lam, rel=1e-12)
        assert found.plane.problem.flight_times(found.unknowns[i]).sum() == pytest.approx(time, rel=1e-9)


@pytest.mark.parametrize(("name", "first", "second", "event"), [("torus", "SN", "NS", "R1")])
def test_curves_of_a_free_period_meet(name, first, second, event):
    """Oracle: see `require_curves_of_a_free_period_meet`."""
    require_curves_of_a_free_period_meet(name, first, second, event)


def require_curves_of_a_free_period_meet(name, first, second, event):
    """Each curve locates the point with its own equations, to 1e-9. The other curve is reached from it."""
    places = []
    for code in (first, second):
        (point,) = (one.point for one in curve(name, code).events if one.type == event)
        places.append(curve(name, code).parameters[point])
    assert places[0] == pytest.approx(places[1], abs=1e-9)
    start = curve(name, first)
    (point,) = (one.point for one in start.events if one.type == event)
    other = follow_curve(curve_through(start, point, second), WINDOW)
    ends = [sorted(one.parameters[[0, -1]].tolist()) for one in (other, curve(name, second))]
    assert np.array(ends[0]) == pytest.approx(np.array(ends[1]), abs=1e-9)


def test_a_curve_of_a_free_period_goes_on():
    """Oracle: the run in the wide range."""
    narrow = follow_curve(curve_at(branch("doubling"), "PD1", ("lam", "rho")), ((0.0, 0.5), (0.6, 0.8)))
    found = extend_curve(narrow, WINDOW)
    assert np.array(found.span) == pytest.approx(np.array(curve("doubling", "PD").span), abs=1e-9)
    assert len(found) > len(narrow) and found.residual.max() < 1e-12


@pytest.mark.parametrize(("name", "names"), [("doubling", ("lam", "c"))])
def test_touches_of_a_free_period(name, names):
    """Oracle: see `require_touches_of_a_free_period`."""
    require_touches_of_a_free_period(name, names)


def require_touches_of_a_free_period(name, names):
    """Oracle: forty digits: the gap is 1 and its rate 0 at the touch. A multiplier that the section at an impact has not makes no event."""
    event = next(event for event in branch(name).events if "touches" in (event.note or ""))
    window = (0.0, 0.5), (0.6, 0.8) if names[1] == "rho" else (0.015, 0.025)
    found = follow_curve(curve_at(branch(name), event, names), window)
    assert found.residual.max() < 1e-12 and len(found) > 8
    assert {event.type for event in found.events} <= {"EP", "SN-GR"}
    problem = found.plane.problem
    for i in (1, len(found) - 2):
        y = found.unknowns[i]
        times = problem.flight_times(y)
        sign = -1 if problem.half else 1
        lam, _ = exact_point("GR", problem.parameters(y), float(times.sum()), sign, "lam", float(times[0]))
        assert found.parameters[i, 0] == pytest.approx(lam, rel=1e-12)


@pytest.mark.parametrize("name", ["symmetric"])
def test_the_only_impact_vanishes_where_a_linear_mode_is_neutral(name):
    """Oracle: see `require_the_only_impact_vanishes_where_a_linear_mode_is_neutral`."""
    require_the_only_impact_vanishes_where_a_linear_mode_is_neutral(name)


def require_the_only_impact_vanishes_where_a_linear_mode_is_neutral(name):
    """Oracle: the condition of Hurwitz, which does not know the restitution."""
    event = next(event for event in branch(name).events if "vanishes" in (event.note or ""))
    found = follow_curve(curve_at(branch(name), event, ("lam", "c")), ((0.0, 0.5), (0.005, 0.03)), points=60)
    for lam, c in found.parameters[::10]:
        assert lam == pytest.approx(neutral_damping({**found.plane.problem.values, "lam": lam, "c": c}), rel=1e-12)
    with pytest.raises(NoCurve, match="does not depend on rho"):
        follow_curve(curve_at(branch(name), event, ("lam", "rho")), WINDOW)
