"""Curves of grazings that meet another grazing: they end there, and the other one is followed on from there.

Oracles: the closed form of the motion without impacts, where it touches two stops; orbits without the impact that grazes, of which the gap
vanishes; the path of a stop that sticks, sampled.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

import saltus
from branches.curves.free_start import released_of
from branches.curves.grazing import observed
from branches.curves.starting import NoCurve, curve_start
from branches.curves.switching import curve_through
from branches.forced.resequencing import without_impact
from branches.linear_modes import families_at
from bvp.closures import cycle_of
from bvp.forced import ForcedProblem
from tests.branches.test_curves import STICKING, started, sticking_event

WINDOW = ((0.05, 3.0), (0.2, 2.0))
AMPLIFIED = math.hypot(1.0 - 1.1**2, 0.1 * 1.1)


@cache
def grazing_below():
    """x'' + 0.1 x' + x = A cos(1.1 t) between stops at -(1.5 - d/2) and d: from d = 1.2, at which the lower one is touched."""
    parametric = saltus.ParametricSystem.from_description(
        {
            "parameters": {"A": 0.05, "w": 1.1, "d": 1.2},
            "system": {
                "mass": [[1.0]],
                "damping": [[0.1]],
                "stiffness": [[1.0]],
                "stops": [{"c": [1.0], "lower": "-(1.5 - 0.5*d)", "upper": "d", "restitution": 0.8}],
            },
            "forces": [{"load": [1.0], "amplitude": "A", "harmonic": 1}],
        }
    )
    (response,) = saltus.trace_response(parametric, "A", (0.05, 0.5))
    return saltus.follow_curve(saltus.curve_at(response, "GR1", ("A", "d")), WINDOW)


def two_at_once(curve):
    """The point of a curve where it ends at two grazings."""
    (event,) = (event for event in curve.events if event.type == "GR-GR")
    return event


def second_of(curve, event):
    return curve_through(curve, event.point, "GR")


def second(curve):
    start = second_of(curve, two_at_once(curve))
    return start, saltus.follow_curve(start, WINDOW)


def test_a_touch_of_both_stops_is_located():
    curve = grazing_below()
    assert curve.parameters[two_at_once(curve).point] == pytest.approx([AMPLIFIED, 1.0], abs=1e-12)
    assert curve.parameters[:, 0] == pytest.approx(AMPLIFIED * (1.5 - 0.5 * curve.parameters[:, 1]), rel=1e-11)
    assert sum("a flight touches a stop" in end.text for end in curve.ended) == 1


def test_the_other_grazing_is_followed():
    """The upper stop is touched by orbits that hit the lower one."""
    curve = grazing_below()
    start, other = second(curve)
    assert (start.plane.problem.sequence, start.grazing.kind) == (("-", "+"), "speed")
    problem = other.plane.problem
    for y, (amplitude, d) in zip(other.unknowns[2:-2:60], other.parameters[2:-2:60], strict=True):
        narrow, at = without_impact(problem, observed(problem, y))
        assert narrow.sequence == ("-",)
        plain = ForcedProblem(problem.parametric, ("-",), ("A",), values={**problem.parameters(y), "d": d})
        node = narrow.nodes(at)
        start_at = plain.pack(node[:, :2], node[:, 2], [amplitude], narrow.flight_times(at))
        found = observed(plain, start_at)
        assert np.abs(plain.residual(start_at)).max() < 1e-12 * np.abs(start_at).max()
        assert abs(found["clearance"]) < 1e-12 and found["clearance_side"] == 1.0 and found["speed"] > 0.0


def test_no_other_grazing_is_found_where_there_is_none():
    with pytest.raises(NoCurve, match="this curve is the only one of grazings there; expected GR-GR"):
        curve_through(grazing_below(), 5, "GR")


def lowest(problem, y):
    """The lowest point of an orbit of one degree of freedom: sampled, and where the velocity turns between two samples."""
    found = math.inf
    for flight, (node, duration) in enumerate(zip(problem.nodes(y), problem.flight_times(y), strict=True)):
        times = np.linspace(0.0, float(duration), 101)
        states = np.array([problem.fly(node, float(time), flight)[0][:2] for time in times])
        found = min(found, float(states[:, 0].min()))
        for k in np.flatnonzero((states[:-1, 1] < 0.0) & (states[1:, 1] > 0.0)):
            turn = brentq(lambda time: problem.fly(node, time, flight)[0][1], times[k], times[k + 1], xtol=1e-15)  # noqa: B023
            found = min(found, float(problem.fly(node, turn, flight)[0][0]))
    return found


@pytest.mark.parametrize(("family", "note"), STICKING[-1:])
def test_curves_of_sticking_end_where_another_stop_is_touched(family, note):
    """Oracle: see `require_curves_of_sticking_end_where_another_stop_is_touched`."""
    require_curves_of_sticking_end_where_another_stop_is_touched(family, note)


def require_curves_of_sticking_end_where_another_stop_is_touched(family, note):
    """The same system with a lower stop, in the middle of the places that the orbits of the curve reach."""
    branch, event = sticking_event(family, note)
    start, window = started(branch, event, ("A", "w")), ((0.1, 8.0), (0.2, 0.5))
    alone = saltus.follow_curve(start, window)
    problem, u = alone.plane.problem, alone.plane.size
    reached = [lowest(problem, y[:u]) for y in alone.unknowns[:: max(1, len(alone) // 20)]]
    place = 0.5 * (lowest(problem, start.y) + min(reached))
    description = problem.parametric.describe()
    description["system"]["stops"][0]["lower"] = place
    between = saltus.ParametricSystem.from_description(description)
    made, y = start.plane.of(ForcedProblem(between, problem.sequence, problem.released, values=problem.values, keep=problem.keep), start.y)
    curve = saltus.follow_curve(start._replace(plane=made, y=y), window)
    touched = [event for event in curve.events if event.type == "GR-GR"]
    assert touched and len(curve) > 20
    for event in touched:
        assert event.note == "two grazings at once: a flight touches a stop"
        assert lowest(problem, curve.unknowns[event.point, :u]) == pytest.approx(place, abs=1e-9)
    inside = [lowest(problem, y[:u]) for y in curve.unknowns[1 : -1 : max(1, len(curve) // 20)]]
    assert min(inside) > place
    beyond = second_of(curve, touched[0])
    assert beyond.plane.problem.sequence != problem.sequence and beyond.grazing.kind == "speed"
    other = saltus.follow_curve(beyond, window)
    assert len(other) > 2 and other.residual.max() < 1e-12
    for y in other.unknowns[1:-1:20]:
        assert lowest(other.plane.problem, y[: other.plane.size]) == pytest.approx(place, abs=1e-9)
    # Impacts behind which a stop sticks leave no trace: nothing but grazings happens on the curve.
    assert [event.type for event in other.events] == ["GR-GR", "GR-GR"]
    if len(touched) == 2:
        ends = curve.parameters[[event.point for event in touched]]
        assert other.parameters[[0, -1]] == pytest.approx(ends, abs=1e-9) or other.parameters[[-1, 0]] == pytest.approx(ends, abs=1e-9)


CHAIN = {
    "parameters": {"e": 0.6},
    "system": {
        "mass": np.eye(3).tolist(),
        "stiffness": [[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]],
        "stops": [{"c": [0.0, 0.0, 1.0], "upper": 1.0}, {"c": [1.0, 0.0, 0.0], "lower": "-e"}],
    },
}
"""A chain of three masses that begins at a wall. Its end has a stop at 1, and its first mass one at -e."""

CHAIN_WINDOW = ((0.3, 0.9), (0.1, 1.0))


@cache
def chain_grazing():
    """The curve in (e, energy) on which orbits that hit the end's stop touch the other one, and the family without that other one."""
    parametric = saltus.ParametricSystem.from_description(CHAIN)
    alone = saltus.ImpactSystem(CHAIN["system"]["mass"], np.zeros((3, 3)), CHAIN["system"]["stiffness"], parametric.system().stops[:1])
    families = [
        next(found for found in families_at(saltus.linear_modes(system)[0], 1, 1, energy=(0.05, 20.0)) if found.ends[1] == "rest")
        for system in (parametric.system(), alone)
    ]
    branch = families[0].branch
    event = next(event for event in branch.events if event.type == "GR" and "touches stop b-" in event.note)
    problem, y = released_of(branch.orbit(event.point), ("e", "energy"), parametric)
    curve = saltus.follow_curve(curve_start(problem, y, "GR", ("e", "energy")), CHAIN_WINDOW)
    return curve, families[1].branch


def lowest_energy_of_mode():
    """The lowest mode where the end touches 1: its first displacement, and its energy."""
    squares, shapes = np.linalg.eigh(np.array(CHAIN["system"]["stiffness"]))
    shape = shapes[:, 0] / shapes[2, 0]
    return shape[0], 0.5 * squares[0] * float(shape @ shape)


def test_a_curve_of_free_grazings_ends_at_two_at_once():
    """Where the linear mode touches both stops, and where the family without the other stop ends by a second touch."""
    curve, alone = chain_grazing()
    first, last = (event for event in curve.events if event.type == "GR-GR")
    assert curve.parameters[first.point] == pytest.approx(lowest_energy_of_mode(), rel=1e-11)
    end = next(event for event in alone.events if event.type == "GR" and "touches" in event.note)
    assert curve.parameters[last.point, 1] == pytest.approx(end.h, rel=1e-11)


def largest(orbit, gap):
    """The largest gap of a closed orbit, by matrix exponentials."""
    system, row, found = orbit.system, np.array(gap), -math.inf
    n = len(row)
    rate = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(system.mass, system.stiffness), np.zeros((n, n))]])
    for after, duration in zip(orbit.after, orbit.duration, strict=True):
        state = np.linalg.solve(system.modes.from_state, after)
        step = expm(rate * float(duration) / 200)
        states = [state]
        for _ in range(200):
            states.append(step @ states[-1])
        speeds = np.array(states)[:, n:] @ row
        found = max(found, *(np.array(states)[:, :n] @ row))
        for k in np.flatnonzero((speeds[:-1] > 0.0) & (speeds[1:] < 0.0)):
            turn = brentq(lambda time: row @ (expm(rate * time) @ states[k])[n:], 0.0, float(duration) / 200, xtol=1e-14)  # noqa: B023
            found = max(found, float(row @ (expm(rate * turn) @ states[k])[:n]))
    return found


@pytest.mark.parametrize("number", [0, 1])
def test_the_other_grazing_of_free_orbits_is_followed(number):
    """The orbits of the other curve hit both stops, one of them without speed, and pass no stop; families through them end there."""
    curve, _ = chain_grazing()
    event = [event for event in curve.events if event.type == "GR-GR"][number]
    start = curve_through(curve, event.point, "GR")
    other = saltus.follow_curve(start, CHAIN_WINDOW)
    assert len(other) > 10 and other.residual.max() < 1e-12
    assert np.abs(other.parameters - curve.parameters[event.point]).max(axis=1).min() < 1e-9
    assert np.ptp(other.parameters[:, 0]) > 0.03
    for row in other.unknowns[5:-5:10]:
        problem, y = start.plane.problem, row[: start.plane.size]
        e, orbit = problem.parameters(y)["e"], cycle_of(*problem.orbit_problem(y))
        assert largest(orbit, [0.0, 0.0, 1.0]) == pytest.approx(1.0, abs=1e-9)
        assert largest(orbit, [-1.0, 0.0, 0.0]) == pytest.approx(e, abs=1e-9)
        slow = np.abs(orbit.speeds) < 1e-9
        assert slow.sum() in (1, 2) and (~slow).sum() >= 1
