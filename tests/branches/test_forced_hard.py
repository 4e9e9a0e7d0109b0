"""Forced families where units, places of stops and values of parameters are unusual."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from branches.family import SETTINGS
from branches.forced_family import ForcedFamily
from bvp.forced import ForcedProblem
from bvp.parameters import ParametricSystem
from continuation.problem import EndReason
from continuation.run import follow_both_ways
from tests.branches.forced_systems import oscillator, settled
from tests.branches.test_forced_family import events_of, followed
from tests.branches.test_forced_parameters import oscillator as with_all_parameters


@pytest.mark.parametrize("start", [0.1, 0.0, -0.1])
def test_a_stop_moves_through_zero(start):
    """The touch at a negative place of the stop is found from a positive one, from zero and from a negative one."""
    problem, y = settled(oscillator(0.05), ["s"], values={"s": start, "w": 1.7}, start=([-1.0], [0.0]))
    run = followed(problem, y, (-1.0, 1.0), replace(SETTINGS, maximum_points=2000))
    assert [event.code for event in run.events] == ["GR", "EP"]
    assert run.events[0].point.parameter == pytest.approx(-0.29699159684656, abs=1e-12)
    assert run.events[1].point.parameter == pytest.approx(1.0, abs=1e-12)


def test_the_events_do_not_depend_on_the_unit_of_length():
    """Oracle: at s = 0 the oscillator is linear in its amplitude. A stop that is nearly at 0 changes little."""
    found = {}
    for name, values in {
        "one": {"A": 1.0}, "small": {"A": 1e-6}, "large": {"A": 1e6}, "near": {"s": 1e-6}, "beyond": {"s": -1e-6},
    }.items():  # fmt: skip
        at = {"w": 1.7} | values
        problem, y = settled(oscillator(0.05), ["w"], values=at, start=([-at.get("A", 1.0)], [0.0]))
        run = followed(problem, y, (1.2, 2.2), replace(SETTINGS, maximum_points=1000))
        assert [end.reason for end in run.ends] == [EndReason.EVENT] * 2
        found[name] = [event.point.parameter for event in events_of(run, "PD")]
        assert len(found[name]) == 1
    assert found["small"] == pytest.approx(found["one"], abs=1e-12)
    assert found["large"] == pytest.approx(found["one"], abs=1e-12)
    assert found["near"] == pytest.approx(found["one"], abs=1e-5)
    assert found["beyond"] == pytest.approx(found["one"], abs=1e-5)


@pytest.mark.parametrize("rate", [1e-4, 1e4])
def test_the_events_do_not_depend_on_the_unit_of_time(rate):
    """Oracle: the oscillator in another unit of time."""
    plain, y = settled(oscillator(0.05), ["w"], values={"w": 1.7}, start=([-1.0], [0.0]))
    (doubling,) = events_of(followed(plain, y, (1.2, 2.2)), "PD")
    scaled = with_all_parameters(k=rate**2, c=0.05 * rate, A=rate**2, w=1.7 * rate)
    scaled._system["stops"][0]["upper"] = 0.0
    problem = ForcedProblem(scaled, plain.sequence, ["w"])
    nodes = plain.nodes(y)
    begun = problem.pack(nodes[:, :2] * [1.0, rate], nodes[:, 2], [1.7 * rate])
    assert problem.system.stops[0].upper == 0.0
    run = followed(problem, begun, (1.2 * rate, 2.2 * rate), replace(SETTINGS, maximum_points=1000))
    assert [event.point.parameter / rate for event in events_of(run, "PD")] == pytest.approx([doubling.point.parameter], abs=1e-12)


def test_the_restitution_can_reach_zero():
    """A family in the restitution goes on to its end at 0, where the impact is plastic and the multipliers' product vanishes."""
    problem, y = settled(oscillator(0.05), ["r"], values={"s": 0.3, "w": 1.7}, start=([-1.0], [0.0]))
    run = followed(problem, y, (0.0, 1.0), replace(SETTINGS, maximum_points=1000))
    assert min(point.step.parameter for point in run.points) == pytest.approx(0.0, abs=1e-9)


def test_parameters_that_the_system_cannot_have_leave_no_trace():
    """Oracle: the residual before."""
    problem, y = settled(with_all_parameters(A=2.0), ["m"])
    before, wrong = problem.residual(y), y.copy()
    problem.nodes(wrong)[:, -1] = -1.0
    assert np.isnan(problem.residual(wrong)).any()
    assert np.array_equal(problem.residual(y), before)


@pytest.mark.parametrize("step", [0.1, 0.025, 0.005])
@pytest.mark.parametrize("direction", [1, -1])
def test_a_closed_family_is_followed_once(step, direction):
    """Oracle: the stop's place and the load's amplitude are kept on a circle: the family closes, with folds at its two ends."""
    system = {"mass": [[1.0]], "damping": [[0.05]], "stiffness": [[1.0]], "stops": [{"c": [1.0], "upper": "s", "restitution": 0.8}]}
    load = {"load": [1.0], "amplitude": "A", "harmonic": 1}
    parametric = ParametricSystem.from_description({"parameters": {"A": 1.0, "w": 1.7, "s": 0.1}, "system": system, "forces": [load]})
    free, y = settled(parametric, ["s"], start=([-1.0], [0.0]))
    y = free.solve(y).y
    problem = ForcedProblem(parametric, free.sequence, ["s", "A"], keep=["(s - 0.1)**2 + (A - 1.2)**2 = 0.04"])
    begun = problem.solve(problem.pack(free.nodes(y)[:, :2], free.nodes(y)[:, 2], [0.1, 1.0])).y
    settings = replace(SETTINGS, maximum_step=step, initial_step=0.2 * step, maximum_points=4000)
    run = follow_both_ways(ForcedFamily(problem), begun, settings, direction=direction)
    assert run.closed and EndReason.CLOSED in [end.reason for end in run.ends]
    assert sorted(event.point.parameter for event in run.events) == pytest.approx([-0.1, 0.3], abs=1e-12)
    assert [event.code for event in run.events] == ["SN", "SN"]
    assert run.points[-1].arclength == pytest.approx(10.8187217, rel=1e-6)  # with all steps
