"""Switching between forced families against closed forms and simulation."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from branches.family import SETTINGS
from branches.forced.family import ForcedFamily
from branches.forced.primitive import full_period, twice
from branches.forced.switching import beside_grazing, emanating_orbits
from branches.forced.tracing import follow_response, switch_response
from bvp.forced import ForcedProblem
from bvp.parameters import ParametricSystem
from continuation.run import follow_both_ways
from tests.branches.forced_systems import oscillator, settled
from tests.branches.test_forced_chains import require_motion
from tests.branches.test_forced_family import events_of, followed

FEW = replace(SETTINGS, maximum_points=60)


def two_sided(damping=0.05, **parameters):
    """x'' + damping x' + x = A cos(w t), |x| <= 1, restitution 0.7."""
    return ParametricSystem.from_description(
        {
            "parameters": {"A": 1.0, "w": 1.2} | parameters,
            "system": {
                "mass": [[1.0]],
                "damping": [[damping]],
                "stiffness": [[1.0]],
                "stops": [{"c": [1.0], "lower": -1.0, "upper": 1.0, "restitution": 0.7}],
            },
            "forces": [{"load": [1.0], "amplitude": "A", "harmonic": 1}],
        }
    )


def test_a_doubled_family_leaves_at_a_period_doubling():
    """Oracle: the doubled orbits are no double covers, they are stable where the single ones are not, and the simulation repeats them."""
    problem, y = settled(oscillator(), ["s"], values={"s": -0.2}, start=([-1.0], [0.0]))
    run = followed(problem, y, (-0.3, 0.0))
    (doubling,) = events_of(run, "PD")
    ((wide, step),) = emanating_orbits(problem, doubling.point.y, doubling.point.tangent[: problem.unknowns], "PD")
    assert wide.load_periods == 2 and wide.sequence == ("+", "+")
    doubled = follow_both_ways(ForcedFamily(wide, (-0.3, 0.0)), step, FEW, both=False, direction=0)
    for point in doubled.points:
        require_motion(wide, point.step.y)
    speeds = -wide.nodes(doubled.points[-1].step.y)[:, 1]
    assert abs(speeds[0] - speeds[1]) > 1e-2
    first = doubled.points[0].step
    assert np.abs(wide.multipliers(first.y)).max() < 1.0
    assert first.parameter > doubling.point.parameter  # where the single orbit is unstable


def test_a_doubled_family_ends_where_its_period_doubles():
    """Oracle: the closed form of the period doubling; the id of the family that is followed away from there. Behind it all orbits are
    repeated, begun a period later."""
    problem, y = settled(oscillator(), ["s"], values={"s": -0.2}, start=([-1.0], [0.0]))
    single = follow_response(problem, y, (-0.3, 0.0))
    (doubling,) = (event for event in single.events if event.type == "PD")
    ((wide, step),) = switch_response(single, doubling)
    away = follow_response(wide, step, (-0.3, 0.0), direction="along")
    for begun in (away.unknowns[len(away) // 2], step):
        whole = follow_response(wide, begun, (-0.3, 0.0))
        first = whole.events[0]
        assert (first.type, first.point) == ("BP", 0) and first.values["s"] == pytest.approx(-0.0685756522788391, abs=1e-12)
        assert "its period doubles here" in whole.ended[0].text and whole.ended[1].text.startswith("EP at s")
        assert [event.type for event in whole.events] == ["BP", "PD", "EP"] and whole.id == away.id
    repeated = follow_response(*twice(problem, single.unknowns[doubling.point - 3]), (-0.3, 0.0))
    assert repeated.ended[1].text.startswith("EP at s") and any(event.type == "BP" for event in repeated.events)


def test_twice_an_orbit_is_a_solution_of_twice_the_period():
    """Oracle: the residual, and the squares of the multipliers."""
    problem, y = settled(oscillator(), ["s"], values={"s": -0.2}, start=([-1.0], [0.0]))
    y = problem.solve(y).y
    wide, repeated = twice(problem, y)
    assert np.abs(wide.residual(repeated)).max() < 1e-13
    assert np.sort(wide.multipliers(repeated)) == pytest.approx(np.sort(problem.multipliers(y) ** 2), abs=1e-12)


def test_half_a_period_is_solved_of_a_symmetric_orbit():
    """Oracle: the simulation; the multipliers of the full period are the squares of those of the half."""
    problem, y = settled(two_sided(), ["w"], half=True)
    solution = problem.solve(y)
    assert np.abs(solution.y - y).max() < 1e-8
    wide, repeated = full_period(problem, solution.y)
    assert len(wide.sequence) == 2 * len(problem.sequence) and wide.period(repeated) == problem.period(solution.y)
    assert np.abs(wide.residual(repeated)).max() < 1e-12
    assert np.sort(wide.multipliers(repeated)) == pytest.approx(np.sort(problem.multipliers(solution.y) ** 2), abs=1e-11)
    require_motion(wide, repeated)


def test_both_mirror_images_leave_where_the_symmetry_breaks():
    """Oracle: the images of one side are the other side's orbits, and the simulation repeats them."""
    problem, y = settled(two_sided(A=0.3), ["w"], half=True)
    run = followed(problem, y, (0.3, 3.0))
    broken = events_of(run, "SB")
    assert broken
    event = broken[0]
    sides = emanating_orbits(problem, event.point.y, event.point.tangent[: problem.unknowns], "SB")
    assert len(sides) == 2
    (wide, one), (_, other) = sides
    states = [wide.nodes(step.y)[:, :2] for step in (one, other)]
    half = len(problem.sequence)
    assert states[0] == pytest.approx(-np.roll(states[1], half, axis=0), abs=1e-9)
    for step in (one, other):
        require_motion(wide, step.y)


def test_the_response_without_impacts_meets_an_impacting_family_at_its_grazing():
    """Oracle: COCO's oscillator. At A = 0.1 both families are on the lower side: a nonsmooth fold. From either one the other is found."""
    parametric = oscillator(0.1, w=1.0, s=1.0, A=0.05)
    problem = ForcedProblem(parametric, [], ["A"])
    run = followed(problem, problem.pack([[0.0, 0.0]], [0.0], [0.05]), (0.01, 2.0))
    (grazing,) = events_of(run, "GR")
    (found,) = beside_grazing(problem, grazing.point.extra, run.points[0].step.y - grazing.point.y)
    assert found.problem.sequence == ("+",) and not found.persists
    impacting = follow_both_ways(ForcedFamily(found.problem, (0.09, 0.2)), found.step, SETTINGS, both=False, direction=0)
    assert events_of(impacting, "SN")[0].point.parameter == pytest.approx(0.0999707536283133, abs=1e-13)
    back, y = settled(oscillator(0.1, w=1.0, s=1.0, A=0.12), ["A"])
    run = followed(back, y, (0.09, 0.2))
    (grazing,) = events_of(run, "GR")
    inside = min(run.points, key=lambda point: abs(point.index - grazing.index) if point.index != grazing.index else math.inf)
    (found,) = beside_grazing(back, grazing.point.extra, inside.step.y - grazing.point.y)
    assert found.problem.sequence == () and not found.persists


def test_an_impact_is_inserted_where_a_flight_touches():
    """Oracle: the simulation repeats the orbits of the neighbour."""
    problem, y = settled(oscillator(), ["s"], values={"s": -0.2}, start=([-1.0], [0.0]))
    run = followed(problem, y, (-3.0, 0.0))
    (touch,) = events_of(run, "GR")
    (found,) = beside_grazing(problem, touch.point.extra, run.points[1].step.y - touch.point.y)
    assert found.problem.sequence == ("+", "+")
    require_motion(found.problem, found.step.y)
