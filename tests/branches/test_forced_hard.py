"""Forced families where units, places of stops and values of parameters are unusual."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from branches.curves.files import read_curves, save_curves
from branches.curves.starting import curve_at
from branches.curves.tracing import follow_curve
from branches.family import SETTINGS
from branches.forced.family import ForcedFamily
from branches.forced.primitive import full_period
from branches.forced.switching import beside_grazing
from branches.forced.tracing import follow_response, switch_response
from bvp.forced import ForcedProblem
from bvp.parameters import ParametricSystem
from bvp.simulate import simulate
from continuation.problem import EndReason
from continuation.run import follow_both_ways
from saltus import load_scene
from tests.branches.forced_systems import oscillator, settled
from tests.branches.test_forced_chains import require_motion
from tests.branches.test_forced_family import events_of, followed
from tests.branches.test_forced_parameters import oscillator as with_all_parameters
from tests.branches.test_forced_switching import two_sided
from transitions.response.tracing import trace_response


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
    wrong[problem.place] = -1.0
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
    assert run.points[-1].arclength == pytest.approx(3.2271348, rel=1e-6)  # with all steps


@pytest.mark.parametrize("s", [0.0, 1e-6, 0.1])
def test_steps_do_not_follow_a_value_of_the_scene(s):
    """The stop's place runs from -0.1 to its grazing, wherever the scene has it. Oracles: equality of paths, and the response without
    impacts, whose amplitude is 1/3."""
    system = {"mass": [[1.0]], "stiffness": [[1.0]], "stops": [{"c": [1.0], "upper": "s", "restitution": 0.4}]}
    load = {"load": [1.0], "amplitude": 1.0, "harmonic": 1}
    parametric = ParametricSystem.from_description({"parameters": {"w": 2.0, "s": s}, "system": system, "forces": [load]})
    (branch,) = trace_response(parametric, "s", (-0.1, 1.0))
    assert 100 <= len(branch) <= 120
    assert [(event.type, event.values["s"]) for event in branch.events if event.type == "GR"] == [("GR", pytest.approx(1 / 3, abs=1e-12))]


def test_a_grazing_at_a_stop_at_zero(tmp_path):
    """Oracle: c = 0.2, d = 1, w = 0.8: the response touches the wall at A = d sqrt((1 - w^2)^2 + c^2 w^2), from both sides; all along the
    curve of grazings in w, too, also read from its file."""

    def grazing(w):
        return np.sqrt((1.0 - w * w) ** 2 + 0.04 * w * w)

    parametric = load_scene("oscillator_at_wall").parametric
    (impacting,) = trace_response(parametric, "A", (0.1, 2.0))
    (free,) = trace_response(parametric, "A", (0.1, 2.0), start="rest", values={"A": 0.3})
    for branch, neighbour in ((impacting, ""), (free, "+")):
        (event,) = [event for event in branch.events if event.type == "GR"]
        assert event.values["A"] == pytest.approx(grazing(0.8), abs=1e-12)
        assert [sequence for sequence, _ in event.neighbours] == [neighbour]
        save_curves([follow_curve(curve_at(branch, event, ("A", "w")), ((0.1, 2.0), (0.6, 1.2)))], tmp_path / "curve.json")
        (curve,) = read_curves(tmp_path / "curve.json")
        a, w = curve.parameters.T
        assert w.min() == pytest.approx(0.6) and w.max() == pytest.approx(1.2)
        np.testing.assert_allclose(a, grazing(w), rtol=1e-10)


def test_a_start_outside_the_range_is_refused():
    """Oracle: the place of the event. At the end of a range the family runs into it."""
    (branch,) = trace_response(load_scene("oscillator_at_wall").parametric, "A", (0.1, 2.0))
    (event,) = [event for event in branch.events if event.type == "PD"]
    (problem, step), *_ = switch_response(branch, event)
    with pytest.raises(ValueError, match=r"the range 1:2 does not contain A = 0\.517.*, where the family begins at PD1"):
        follow_response(problem, step, (1.0, 2.0), direction="along", origin="PD1")
    assert len(follow_response(problem, step, (0.4, step.parameter), direction="along")) > 5


def test_a_neimark_sacker_bifurcation_leads_to_a_torus():
    """Oracle: the multipliers, the full period, with twice the angle, and the simulation: beside the orbit the motion comes
    back to it on one side of the bifurcation; on the other side it settles on a closed curve of stroboscopic states."""
    parametric = ParametricSystem.from_description(
        {
            "parameters": {"A": 0.4245, "w": 1.0568},
            "system": {
                "mass": [[1.0, 0.0], [0.0, 0.0732]],
                "damping": [[0.0304, -0.0104], [-0.0104, 0.0104]],
                "stiffness": [[1.1322, -0.1322], [-0.1322, 0.1322]],
                "stops": [{"c": [-1.0, 1.0], "upper": 0.495, "lower": -0.495, "restitution": 0.5134}],
            },
            "forces": [{"load": [1.0, 0.0], "amplitude": "A", "harmonic": 1}],
        }
    )
    problem, y = settled(parametric, ["w"], half=True)
    run = followed(problem, y, (0.9, 1.3))
    event, *_ = events_of(run, "NS")
    found = problem.multipliers(event.point.y)
    assert np.abs(found[:2]) == pytest.approx(1.0, abs=1e-9)
    assert abs(np.angle(found[0])) == pytest.approx(event.details["angle"], abs=1e-9)
    wide, repeated = full_period(problem, event.point.y)
    (same,) = (
        other for other in events_of(followed(wide, repeated, (0.9, 1.3)), "NS")
        if abs(other.point.parameter - event.point.parameter) < 1e-9
    )  # fmt: skip
    assert same.details["angle"] == pytest.approx(2.0 * event.details["angle"], abs=1e-7)
    distances = {}
    for side in (-1.0, 1.0):
        w = event.point.parameter + side * 0.001
        points = list(run.points)[: events_of(run, "SN")[0].index]
        y = min((point.step for point in points), key=lambda step: abs(step.parameter - w)).y
        wide, repeated = full_period(problem, y)
        last = wide.nodes(repeated)[-1]
        assert 0.0 < last[4] < 1.0
        state = wide.fly(last, (1.0 - last[4]) * wide.period(repeated))[0]  # at phase 0
        at = wide.parameters(repeated)
        forces, duration = parametric.forces(at), 3000 * wide.period(repeated)
        motion = simulate(parametric.system(at), state[:2], 1.001 * state[2:], duration, forces=forces)
        distances[np.abs(problem.multipliers(y)).max() > 1.0] = np.abs(motion.final - state).max()
    assert distances[False] < 1e-8 and 1e-3 < distances[True] < 1.0


def neighbours(problem, run, event):
    inside = min((point for point in run.points if point.index != event.index), key=lambda point: abs(point.index - event.index))
    return beside_grazing(problem, event.point.extra, inside.step.y - event.point.y)


@pytest.mark.parametrize("half", [True, False])
def test_symmetric_pairs_vanish_and_appear_at_a_grazing(half):
    """Oracle: with one impact at each stop that vanish together, the neighbour is the response without impacts; from there, the grazing
    leads back to the pair. One of the two impacts can remain, too, without the symmetry. Simulation repeats all of them."""
    problem, y = settled(two_sided(A=0.3, w=1.0), ["w"], half=half)
    run = followed(problem, y, (0.3, 3.0))
    events = events_of(run, "GR")
    assert len(events) == 2
    for event in events:
        assert "vanishes" in event.details["note"]
        beside = neighbours(problem, run, event)
        (found,) = (one for one in beside if one.problem.half)
        assert found.problem.sequence == ()
        for other in beside:  # of two impacts one can remain
            if not other.problem.half:
                assert len(other.problem.sequence) == 1
                require_motion(other.problem, other.step.y)
        smooth = followed(found.problem, found.step.y, (0.3, 3.0))
        grazing = min(events_of(smooth, "GR"), key=lambda other: abs(other.point.parameter - event.point.parameter))
        assert grazing.point.parameter == pytest.approx(event.point.parameter, abs=1e-9)
        back, *singles = neighbours(found.problem, smooth, grazing)
        require_motion(*full_period(back.problem, back.step.y))
        for single in singles:
            assert not single.problem.half and len(single.problem.sequence) == 1
            require_motion(single.problem, single.step.y)
