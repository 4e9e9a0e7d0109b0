"""Starts, measures and files of forced responses against closed forms, the energy balance, and a second way to each."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from branches.forced.record import named_events
from branches.forced.tracing import follow_response, point_inside, switch_response
from branches.reading import RecordError
from bvp.parameters import ParametricSystem
from bvp.simulate import simulate
from saltus.outputs import json_text
from tests.branches.forced_systems import impact_speed, oscillator
from tests.branches.forced_systems import settled as simulated
from tests.branches.test_forced_parameters import chain
from tests.branches.test_forced_switching import two_sided
from transitions.record import extents
from transitions.response.figure import curves_over, response_figure
from transitions.response.files import read_responses, responses_record
from transitions.response.measures import _OrbitMeasures, _state_at, column_names, column_of, measures_along, response_table
from transitions.response.path import ParameterPath
from transitions.response.starting import NoOrbit, Unbounded, linear_response, settled_orbit
from transitions.response.tracing import trace_response
from transitions.sweep.settle import settle


def settled(parametric, name, u=None, v=None, **options):
    return settled_orbit(ParameterPath(parametric, [name]), settle(parametric.system(), parametric.forces(), u, v, **options))


@pytest.fixture(scope="module")
def one_impact():
    """x'' + x = cos(2.8 t), r = 0.8, one impact a period, in the place of the stop."""
    found = settled(oscillator(s=-0.2), "s", [-0.66], [0.0])
    return follow_response(found.problem, found.y, (-3.0, 1.0))


@pytest.fixture(scope="module")
def symmetric():
    """A damped oscillator between two stops, half of whose period is solved."""
    found = settled(two_sided(A=0.7), "w")
    assert found.problem.half
    return follow_response(found.problem, found.y, (1.0, 1.5))


def test_the_columns_of_one_impact_are_those_of_the_formula(one_impact):
    """Oracle: the closed form of the impact speed, the product r^2 of the multipliers, the period of the load, the loss of an impact."""
    branch = one_impact
    (fold,) = [event for event in branch.events if event.type == "SN"]
    away = np.abs(branch.parameter - fold.values["s"]) > 1e-6
    signs = np.where(np.arange(len(branch)) < fold.point, -1.0, 1.0)
    wanted = [impact_speed(2.8, 0.8, 1, s, sign) for s, sign in zip(branch.parameter, signs, strict=True)]
    assert np.abs(branch.speeds[:, 0] - wanted)[away].max() < 1e-11
    assert branch.periods == pytest.approx(2.0 * math.pi / 2.8, rel=1e-15)
    grazing = [event.point for event in branch.events if event.type == "GR"]
    finite = np.setdiff1d(np.arange(len(branch)), grazing)
    assert np.prod(branch.multipliers[finite], axis=1) == pytest.approx(0.64, abs=1e-9)
    measures = measures_along(branch)
    assert measures.dissipated[:, -1] == pytest.approx(0.18 * branch.speeds[:, 0] ** 2, abs=1e-10)
    assert measures.work == pytest.approx(measures.dissipated.sum(axis=1), abs=1e-10)


def test_stability_changes_where_the_formula_says(one_impact):
    """Oracle: design section 9: stable between the fold and the period doubling."""
    branch = one_impact
    fold, doubling = (next(event for event in branch.events if event.type == kind) for kind in ("SN", "PD"))
    low, high = sorted((fold.point, doubling.point))
    assert np.all(branch.stable[low + 1 : high] == 1)
    assert branch.stable[low] == branch.stable[high] == -1
    outside = np.concatenate([branch.stable[1:low], branch.stable[high + 1 : -1]])
    assert np.all(outside == 0)


def test_a_response_without_impacts_has_the_measures_of_a_harmonic():
    """Oracle: the amplitude a of the closed form; rms a/sqrt(2); the damper takes c w^2 a^2 T/2."""
    problem, y, why = linear_response(ParameterPath(oscillator(0.1, w=1.3, s=5.0), ["w"]))
    assert why is None and problem.sequence == ()
    branch = follow_response(problem, y, (1.1, 1.5))
    w = branch.parameter
    amplitude = 1.0 / np.hypot(1.0 - w * w, 0.1 * w)
    measures = measures_along(branch)
    assert measures.peaks[:, 0] == pytest.approx(amplitude, rel=1e-11)
    assert measures.rms[:, 0] == pytest.approx(amplitude / math.sqrt(2.0), rel=1e-11)
    assert measures.dissipated[:, 0] == pytest.approx(0.1 * w * math.pi * amplitude**2, rel=1e-11)
    assert measures.shares[:, 0] == pytest.approx(1.0, abs=1e-15)
    assert branch.phases.shape == branch.speeds.shape == (len(branch), 0)
    assert np.all(branch.stable[1:-1] == 1)


def test_half_a_period_gives_the_measures_of_the_full_one(symmetric):
    """Oracle: the full period solved; work equals dissipation; the mean square over both halves is one."""
    branch = symmetric
    full = settled(two_sided(A=0.7), "w")
    measures = measures_along(branch)
    assert measures.work == pytest.approx(measures.dissipated.sum(axis=1), rel=1e-9)
    assert measures.peaks.min() >= 1.0 - 1e-12  # it reaches the stops
    at = int(branch.start)
    states = measures.states[at, 0]
    motion = settle(two_sided(A=0.7).system(), two_sided(A=0.7).forces())
    close = min(np.abs(states - motion.states[0]).max(), np.abs(states + motion.states[0]).max())
    assert close < 1e-8 and full.distance < 1e-6
    # all multipliers, of the full period: two impacts, and the damping
    system, finite = branch.problem.parametric.system(), np.isfinite(branch.multipliers).all(axis=1)
    loss = np.exp(-np.trace(np.linalg.solve(system.mass, system.damping)) * branch.periods[finite])
    assert np.prod(branch.multipliers[finite], axis=1) == pytest.approx(0.7**4 * loss, rel=1e-10)
    assert response_table([branch])["multipliers"][finite] == pytest.approx(branch.multipliers[finite])
    for event in branch.events:
        assert event.multiplier is None or event.multiplier == pytest.approx(branch.largest_multiplier[event.point], rel=1e-9)
    assert measures.dissipated[at, -1] == pytest.approx(float(np.sum(0.5 * (1.0 - 0.49) * motion.impacts.speeds**2)), rel=1e-8)


def test_the_first_impact_has_the_smallest_phase(symmetric):
    branch = symmetric
    phases = branch.phases[branch.start]
    assert np.all(np.diff(phases) > 0.0) and len(branch.sequence) == len(phases) == 1
    assert phases[0] < math.pi  # of both impacts of the full period the first


def measured_in_a_simulation(problem, y, period):
    """The measures of one orbit from a simulation of its period, from phase 0."""
    at = problem.parameters(y)
    n, p = problem.degrees_of_freedom, problem.load_periods
    state = _state_at(problem, y, 0.0, period)
    system, forces = problem.parametric.system(at), problem.parametric.forces(at)
    motion = simulate(system, state[:n], state[n:], period, forces=forces)
    found = extents(motion)
    u, v = motion.sample(np.arange(p) * (period / p))
    return found.peaks, found.rms, motion.totals[:-1] / p, motion.totals[-1] / p, np.concatenate([u, v], axis=1)


def one_point(problem, y):
    """A branch of the one orbit."""
    return follow_response(problem, problem.solve(y).y, points=1)


def require_simulated(branch):
    """The measures are those of a simulation of one period."""
    y, period = branch.unknowns[0], branch.periods[0]
    wanted, found = measured_in_a_simulation(branch.problem, y, period), _OrbitMeasures(branch.problem)(y, period)
    for one, other in zip(found, wanted, strict=True):
        size = max(1.0, np.abs(other).max())
        assert np.abs(np.asarray(one) - other).max() < 1e-9 * size
    return found


@pytest.mark.parametrize("mass", [1.0, 2.0])
def test_measures_of_an_orbit_that_sticks(mass):
    """Oracle: a ball on a table, without rebound: all energy of its impact is lost, and is the work of the loads. While it rests on the
    table it does not move; its height in between is that of the simulation."""
    ball = ParametricSystem.from_description(
        {
            "parameters": {"G": 1.2, "w": 1.0},
            "system": {"mass": [[mass]], "stiffness": [[0.0]], "stops": [{"c": [1.0], "lower": 0.0, "restitution": 0.0}]},
            "forces": [{"load": [mass], "constant": -1.0}, {"load": [mass], "amplitude": "G", "harmonic": 1}],
        }
    )
    found = settled(ball, "G")
    branch = follow_response(found.problem, found.y, (1.1, 1.3))
    measures = measures_along(branch)
    assert measures.dissipated[:, -1] == pytest.approx(0.5 * mass * branch.speeds[:, 0] ** 2, rel=1e-12)
    assert measures.work == pytest.approx(measures.dissipated.sum(axis=1), rel=1e-12)
    before, motion = (simulate(ball.system(), [0.0], [0.0], 2.0 * math.pi * count, forces=ball.forces()) for count in (2, 3))
    at = measures_along(one_point(found.problem, found.y))
    assert at.peaks[0] == pytest.approx(extents(motion).peaks, rel=1e-9)
    assert at.dissipated[0, -1] == pytest.approx(motion.totals[-2] - before.totals[-2], rel=1e-9)
    assert np.all(measures.peaks[:, 0] > 0.0) and np.all(np.diff(measures.peaks[:, 0]) > 0.0)


@pytest.mark.parametrize("case", ["half", "doubled", "several", "resonant", "springs"])
def test_measures_are_those_of_a_simulation(case, symmetric, one_impact):
    """Oracle: the event-driven simulation of one period, its energy budget and the peaks of its flights."""
    if case == "half":
        require_simulated(one_point(symmetric.problem, symmetric.unknowns[len(symmetric) // 2]))
    elif case == "doubled":
        ((problem, step),) = switch_response(one_impact, next(event for event in one_impact.events if event.type == "PD"))
        doubled = follow_response(problem, step, (-0.3, 0.2), direction="along", points=20)
        peaks, *_, states = require_simulated(one_point(problem, doubled.unknowns[-1]))
        assert states.shape == (2, 2) and np.abs(states[0] - states[1]).max() > 1e-3
    elif case == "resonant":  # the load joins the block of its mode
        require_simulated(one_point(*simulated(oscillator(0.1, A=0.3, w=1.0, s=0.5), ["s"])))
    else:  # three harmonics and a constant load
        require_simulated(one_point(*simulated(chain(), ["k" if case == "springs" else "F"], periods=600)))


@pytest.mark.parametrize(("c", "name", "part"), [(2e3, "m", 0.1), (1e6, "m", 0.1), (1e8, "m", 0.01), (1e6, "c", 0.9)])
def test_a_response_beside_a_strong_damper_between_masses_is_followed(c, name, part):
    """Oracle: the linear response. It rounds by the slow rate, which is near 1/c."""
    matrices = {"mass": [["m", 0], [0, 1]], "damping": [["c", "-c"], ["-c", "c + 0.1"]], "stiffness": [[1, 0], [0, 2]]}
    loads = [{"load": [1, 0], "amplitude": 0.1, "harmonic": 1}]
    content = {"parameters": {"m": 1.0, "c": c, "w": 1.0}, "system": {**matrices, "stops": [{"c": [1, 0], "upper": 50.0}]}, "forces": loads}
    interval = tuple(content["parameters"][name] * np.array([1.0 - part, 1.0 + part]))
    (branch,) = trace_response(ParametricSystem.from_description(content), name, interval, start="rest")
    assert (branch.parameter.min(), branch.parameter.max()) == pytest.approx(interval, rel=1e-9)
    for state, at in ((branch.problem.nodes(y)[0], branch.problem.parameters(y)) for y in branch.unknowns):
        first, second, damper = 1.0 - at["m"], 1.0 + 0.1j, 1j * at["c"]
        exact = 0.1 * np.array([second + damper, damper]) / (first * second + damper * (first + second))
        assert np.abs(state[:2] - exact.real).max() < 1e-13 + 1e-16 * at["c"]


def test_an_undamped_resonance_is_unbounded():
    """Oracle: w = 1 is the frequency of the mode; near it the response grows without bound, at the pace 1/|1 - w^2|."""
    with pytest.raises(Unbounded, match="unbounded at w = 1: the load has the frequency of an undamped mode"):
        linear_response(ParameterPath(oscillator(s=5.0, w=1.0), ["w"]))
    far = ParametricSystem.from_description(
        {
            "parameters": {"w": 0.8},
            "system": {
                "mass": [[1.0, 0.0], [0.0, 1.0]], "stiffness": [[1.0, 0.0], [0.0, 9.0]], "damping": [[0.0, 0.0], [0.0, 0.1]],
                "stops": [{"c": [0.0, 1.0], "upper": 1.0}],
            },
            "forces": [{"load": [1.0, 0.1], "amplitude": 1.0, "harmonic": 1}],
        }
    )  # fmt: skip
    problem, y, _ = linear_response(ParameterPath(far, ["w"]))
    branch = follow_response(problem, y, (0.5, 1.5))
    assert "grows without bound" in branch.ended[1].text
    assert 0.98 < branch.parameter.max() < 1.0


def test_what_is_no_orbit_is_reported():
    """Oracle: the kinds of motion that `settle` finds."""
    with pytest.raises(NoOrbit, match="chaotic"):
        settled(oscillator(s=0.0), "s")
    ball = ParametricSystem.from_description(
        {
            "parameters": {"G": 0.5, "w": 1.0},
            "system": {"mass": [[1.0]], "stiffness": [[0.0]], "stops": [{"c": [1.0], "lower": 0.0, "restitution": 0.5}]},
            "forces": [{"load": [1.0], "constant": -1.0}, {"load": [1.0], "amplitude": "G", "harmonic": 1}],
        }
    )
    with pytest.raises(NoOrbit, match="rest: it sticks to its stops for ever"):
        settled(ball, "G")


def test_a_file_holds_all_of_a_branch(one_impact, tmp_path):
    """Oracle: the branch itself, bit for bit."""
    path = tmp_path / "a.json"
    path.write_text(json_text(responses_record([one_impact])), encoding="utf-8")
    (again,) = read_responses(path)
    for name in ("unknowns", "tangents", "arclength", "residual", "phases", "speeds", "stable"):
        assert np.array_equal(getattr(again, name), getattr(one_impact, name)), name
    assert again.events == one_impact.events and again.ended == one_impact.ended and again.sequence == one_impact.sequence
    assert list(named_events([again, again])) == [*named_events([again]), *(f"2.{event.id}" for event in again.events)]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"schema": 2', '"schema": 7', "schema 7 is not known"),
        ('"kind": "response"', '"kind": "x"', "holds no response"),
        ('"load_periods": 1', '"load_periods": 2', "do not solve the equations"),
        ('"start": ', '"start": 100000', "no point"),
        ('"solved": ["+"]', '"solved": ["+", "+"]', "unknowns of its sequence"),
        ('"half": false', '"half": 3', "expected a boolean"),
    ],
)
def test_a_damaged_file_is_refused(one_impact, tmp_path, old, new, message):
    path = tmp_path / "a.json"
    text = json_text(responses_record([one_impact]))
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(RecordError, match=message):
        read_responses(path)


def test_every_column_can_be_drawn(one_impact):
    table = response_table([one_impact])
    assert {"s", "period", "phase", "speed", "max.u1", "rms.u1", "share.stop_a", "multipliers", "test.SN", "test.PD"} <= set(table)
    for name in column_names(one_impact.problem.parametric, 1):
        column = column_of(one_impact, name)
        assert column.shape[0] == len(one_impact) and column.shape[1] >= 1
    assert np.array_equal(table["max.u1"], column_of(one_impact, "max:u1")[:, 0])


def test_the_table_has_the_events_and_the_file_has_them_once(one_impact):
    """Oracle: the events of the branch, at their points and nowhere else."""
    table = response_table([one_impact, one_impact])
    for part in (slice(len(one_impact)), slice(len(one_impact), None)):
        ids, coefficients = table["event"][part], table["coefficient"][part]
        assert {i: id for i, id in enumerate(ids.tolist()) if id} == {event.point: event.id for event in one_impact.events}
        known = {event.point: event.coefficient for event in one_impact.events if event.coefficient is not None}
        assert known and {i: coefficients[i] for i in np.flatnonzero(np.isfinite(coefficients)).tolist()} == known
    twice = dataclasses.replace(one_impact, events=(*one_impact.events, one_impact.events[0]._replace(id="X1", coefficient=7.0)))
    first = one_impact.events[0]
    assert response_table([twice])["event"][first.point] == f"{first.id} X1"
    point = responses_record([one_impact])["branches"][0]["points"][first.point]
    assert "event" not in point and "coefficient" not in point


def test_curves_over_a_sweep_are_the_columns(one_impact, symmetric):
    """Oracle: the columns; a half-period orbit has the other half's impacts half a period later."""
    (curve,) = curves_over([one_impact], "speed")
    assert np.array_equal(curve.y, one_impact.speeds[:, 0]) and np.array_equal(curve.x, one_impact.parameter)
    known = one_impact.stable >= 0
    assert np.array_equal(curve.stable[known], one_impact.stable[known] == 1)
    first, second = curves_over([symmetric], "phase")
    both = np.isfinite(first.y) & np.isfinite(second.y)
    assert np.abs(np.abs(first.y - second.y)[both] - math.pi).max() < 1e-12
    with pytest.raises(ValueError, match="a response has no period as a sweep has it"):
        curves_over([one_impact], "period")


def test_a_branch_goes_on_in_another_range_and_at_its_events(one_impact):
    """Oracle: the same family, followed in one piece; the doubled one has twice the period."""
    k = point_inside(one_impact, (-0.3, 0.2))
    again = follow_response(one_impact.problem, one_impact.unknowns[k], (-0.3, 0.2))
    (doubling,) = [event for event in again.events if event.type == "PD"]
    (known,) = [event for event in one_impact.events if event.type == "PD"]
    assert doubling.values["s"] == pytest.approx(known.values["s"], abs=1e-12)
    ((problem, step),) = switch_response(one_impact, known)
    doubled = follow_response(problem, step, (-0.3, 0.2), direction="along", points=30)
    assert doubled.periods == pytest.approx(2.0 * one_impact.periods[0]) and len(doubled.sequence) == 2
    with pytest.raises(ValueError, match="no other family begins at SN1"):
        switch_response(one_impact, next(event for event in one_impact.events if event.type == "SN"))
    with pytest.raises(ValueError, match="has no point of the branch"):
        point_inside(one_impact, (5.0, 6.0))


def test_test_functions_vanish_at_their_events(one_impact, symmetric):
    """Oracle: the located events; the clearance and the speed of a grazing; det(M + 1) = (1 + mu_1)(1 + mu_2) of one impact."""
    table = response_table([one_impact])
    for event in one_impact.events:
        if event.type in ("SN", "PD"):
            values, k = table[f"test.{event.type}"], event.point
            assert abs(values[k]) < 1e-9 and values[k - 1] * values[k + 1] < 0.0
        elif event.type == "GR":
            assert min(abs(table[name][event.point]) for name in ("test.touch", "test.speed")) < 1e-9
    away = one_impact.speeds[:, 0] > 0.1
    determinant = np.prod(1.0 + one_impact.multipliers, axis=1).real
    ratio = (table["test.PD"] / determinant)[away]
    assert np.all(ratio > 0.0)
    assert np.array_equal(column_of(symmetric, "test:NS")[:, 0], response_table([symmetric])["test.NS"], equal_nan=True)


def test_every_column_is_an_axis(one_impact):
    """Oracle: the drawn lines, of one column of each kind."""
    import matplotlib.pyplot as plt

    kinds = {name.partition(":")[0]: name for name in column_names(one_impact.problem.parametric, 1)}
    for name in kinds.values():
        column = column_of(one_impact, name)
        figure = response_figure([one_impact], y=name, x="speed:1" if column.shape[1] > 1 else name)
        drawn = np.concatenate([line.get_ydata() for line in figure.axes[0].lines if line.get_gid().startswith("response")])
        finite = column[np.isfinite(column)]
        assert np.isin(drawn[np.isfinite(drawn)], finite).all(), name
        plt.close(figure)
    with pytest.raises(ValueError, match="unknown column 'maxx:u1'; nearest: max:u1"):
        response_figure([one_impact], y="speed", x="maxx:u1")
