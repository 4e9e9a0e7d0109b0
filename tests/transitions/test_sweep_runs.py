"""Sweeps up and down, from several starts, in processes; their table and their figure.

Oracles: a sweep in one piece; the closed form of the grazing of a linear oscillator; the numbers of points that are drawn.
"""

import math
from concurrent.futures import ThreadPoolExecutor

import matplotlib.pyplot as plt
import numpy as np
import pytest

from bvp.motion import MotionStatus
from bvp.parameters import ParametricSystem
from bvp.simulate import BeyondStop
from transitions.sweep import runs as module
from transitions.sweep.figure import Curve, measures_of, sweep_figure, sweep_points
from transitions.sweep.runs import AlongParameter, SweepPlan, check_plan, failures, run_sweeps, sweeps_table
from transitions.sweep.sweep import SweepSettings, sweep

OSCILLATOR = {
    "parameters": {"A": 0.2, "w": 1.0, "c": 0.1, "r": 0.8, "s": 1.0},
    "system": {"mass": [[1.0]], "damping": [["c"]], "stiffness": [[1.0]], "stops": [{"c": [1.0], "upper": "s", "restitution": "r"}]},
    "forces": [{"load": [1.0], "amplitude": "A", "harmonic": 1}],
}


def plan_of(name, low, high, **given):
    return SweepPlan(AlongParameter(ParametricSystem.from_description(OSCILLATOR), name), low, high, **given)


@pytest.fixture(scope="module")
def both_ways():
    plan = plan_of("A", 0.052, 0.202, points=31, settings=SweepSettings(200, 20))
    runs, interrupted = run_sweeps(plan)
    assert not interrupted
    return plan, runs


def test_both_ways_find_the_impacts_beyond_the_grazing(both_ways):
    """Oracle: the amplitude A/c of the linear response reaches the stop at A = 0.1. The fold is at 0.09997, between two values."""
    _, runs = both_ways
    assert [(run.direction, run.start) for run in runs] == [("up", 1), ("down", 1)]
    for run in runs:
        found = run.sweep
        assert np.all(np.diff(found.values) > 0.0) == (run.direction == "up")
        assert np.all((found.impact_rates > 0.0) == (found.values > 0.1))


def test_pieces_make_the_same_sweep_as_one(both_ways):
    plan, runs = both_ways
    whole, _ = sweep(plan.at, plan.values("down"), settings=plan.settings)
    for name in ("values", "periods", "impact_rates", "offsets"):
        assert np.array_equal(getattr(whole, name), getattr(runs[1].sweep, name)), name
    assert np.abs(whole.states - runs[1].sweep.states).max() < 1e-9


def test_an_executor_makes_the_same_sweeps(both_ways):
    plan, runs = both_ways
    counts = []
    with ThreadPoolExecutor(2) as executor:
        others, interrupted = run_sweeps(plan, executor, counts.append)
    assert not interrupted and counts[-1] == 62
    for run, other in zip(runs, others, strict=True):
        assert run.direction == other.direction and np.array_equal(run.sweep.states, other.sweep.states)


def test_each_start_is_a_sweep():
    """Oracle: without impacts the motions of a linear oscillator meet; so do their exponents, -c/2."""
    starts = (np.array([0.0, 0.0]), np.array([0.5, -0.3]))
    runs, _ = run_sweeps(plan_of("A", 0.02, 0.03, points=2, directions=("down",), starts=starts, settings=SweepSettings(150, 10)))
    assert [(run.direction, run.start) for run in runs] == [("down", 1), ("down", 2)]
    assert np.abs(runs[0].sweep.states[0] - runs[1].sweep.states[0]).max() < 1e-12
    assert np.abs(runs[0].sweep.exponents + 0.05).max() < 1e-12


def test_an_interrupt_keeps_the_pieces_that_are_finished(monkeypatch):
    plan = plan_of("A", 0.05, 0.2, points=32, settings=SweepSettings(10, 5))
    calls = []

    def interrupted(*task):
        calls.append(task)
        if len(calls) > 3:
            raise KeyboardInterrupt
        return sweep(task[0], task[1], start=task[2], settings=task[3])

    monkeypatch.setattr(module, "_piece", interrupted)
    runs, came = run_sweeps(plan)
    assert came and len(runs) == 1 and len(runs[0].sweep) == 6
    calls.extend([None] * 3)
    with pytest.raises(KeyboardInterrupt):
        run_sweeps(plan)


def test_a_plan_is_checked_before_the_work():
    check_plan(plan_of("A", 0.05, 0.2, points=3))
    with pytest.raises(ValueError, match=r"restitution.*1\.2"):
        check_plan(plan_of("r", 0.5, 1.2, points=3))
    with pytest.raises(ValueError, match="nearest: w"):
        check_plan(plan_of("ww", 0.5, 1.2, points=3))
    with pytest.raises(BeyondStop, match="beyond stop a"):
        check_plan(plan_of("s", 0.5, 1.2, points=3, starts=(np.array([0.8, 0.0]),)))
    check_plan(plan_of("s", 0.5, 1.2, points=3, starts=(np.array([0.8, 0.0]),), directions=("down",)))


def test_the_table_has_a_row_for_each_value(both_ways):
    """Oracle: the arrays of the sweeps."""
    _, runs = both_ways
    table = sweeps_table(runs)
    assert {len(column) for column in table.values()} == {62}
    assert table["direction"].tolist() == ["up"] * 31 + ["down"] * 31
    assert np.array_equal(table["value"][:31], table["value"][31:][::-1])
    assert sum(map(len, table["impact_speeds"])) == sum(len(run.sweep.impact_speeds) for run in runs)
    assert np.array_equal(np.concatenate(table["impact_phases"][31:]), runs[1].sweep.impact_phases)
    assert all(len(states) == 20 for states in table["strobe_v.u1"])
    assert table["ended"][0] == "duration_reached" and np.all(np.isfinite(table["exponent"]))
    assert failures(runs) == {}
    with_failure = [module.SweepRun(runs[0].sweep, "up", 1)]
    object.__setattr__(with_failure[0], "sweep", module.join_sweeps([runs[0].sweep]))
    object.__setattr__(with_failure[0].sweep, "statuses", (MotionStatus.SIMULTANEOUS, *runs[0].sweep.statuses[1:]))
    assert failures(with_failure) == {MotionStatus.SIMULTANEOUS: 1}


def drawn(figure, panel, gid):
    return next(line for line in figure.axes[panel].get_lines() if line.get_gid() == gid)


def test_the_figure_draws_every_impact_and_the_exponents(both_ways):
    """Oracle: the numbers of the sweeps."""
    _, runs = both_ways
    figure = sweep_figure(runs, "A", title="an oscillator")
    up = drawn(figure, 0, "up-1")
    assert len(up.get_xdata()) == len(runs[0].sweep.impact_speeds)
    assert set(np.round(up.get_xdata(), 12)) == set(np.round(runs[0].sweep.values[runs[0].sweep.impact_rates > 0.0], 12))
    assert len(figure.axes) == 2 and figure.axes[1].get_xlabel() == "$A$" and "lambda" in figure.axes[1].get_ylabel()
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["up", "down"]
    plt.close("all")


@pytest.mark.parametrize("y", ["phase", "impacts", "period", "sticking", "work", "max:u1", "strobe:u1", "strobe:u1'", "dissipated:stop a"])
def test_every_measure_can_be_drawn(both_ways, y):
    """Oracle: the arrays of the sweep."""
    _, runs = both_ways
    found = runs[0].sweep
    x, values = sweep_points(found, y)
    assert len(x) == len(values) == {"phase": len(found.impact_phases)}.get(y, 620 if y.startswith("strobe") else 31)
    if y == "strobe:u1'":
        assert np.array_equal(values, found.states[:, :, 1].ravel())
    if y == "max:u1":
        assert np.abs(values[:5] - x[:5] / 0.1).max() < 1e-9
    figure = sweep_figure(runs, "A", y=y, exponent=False)
    assert len(figure.axes) == 1 and y in measures_of(found.coordinates, found.parts)
    plt.close("all")


def test_curves_are_drawn_on_top_solid_and_dashed(both_ways):
    _, runs = both_ways
    x = np.linspace(0.1, 0.2, 11)
    curve = Curve(x, 3.0 * x, x < 0.15)
    figure = sweep_figure(runs, "A", curves=[curve, curve])
    lines = [line for line in figure.axes[0].get_lines() if line.get_gid() is None]
    assert {line.get_linestyle() for line in lines} == {"-", "--"} and len(lines) == 4
    stable, unstable = (line.get_ydata() for line in lines[:2])
    # The two pieces meet: no gap is left.
    assert np.count_nonzero(np.isfinite(stable)) + np.count_nonzero(np.isfinite(unstable)) == 12
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["up", "down", "stable", "unstable"]
    plt.close("all")


def test_values_without_a_tangent_vector_are_marked(both_ways):
    _, runs = both_ways
    found = module.join_sweeps([runs[0].sweep])
    object.__setattr__(found, "exponents", np.where(found.values < 0.1, -math.inf, -0.1))
    figure = sweep_figure([module.SweepRun(found, "up", 1)], "A")
    assert len(drawn(figure, 1, "vanishing").get_xdata()) == np.count_nonzero(found.values < 0.1)
    object.__setattr__(found, "exponents", np.full(31, math.nan))
    assert len(sweep_figure([module.SweepRun(found, "up", 1)], "A").axes) == 1
    plt.close("all")


def test_an_unknown_measure_names_the_nearest(both_ways):
    _, runs = both_ways
    with pytest.raises(ValueError, match="unknown measure 'max:u2'; nearest: max:u1"):
        sweep_figure(runs, "A", y="max:u2")
