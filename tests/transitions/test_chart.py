"""A chart of the damped impact oscillator over the frequency and the amplitude of its load.

Oracles: the closed forms of its fold, doubling and grazing in forty digits (`tests.branches.curve_oracles`), the event-driven simulation,
and invariants: each curve once, the same chart twice.
"""

import dataclasses
import math

import numpy as np
import pytest

import saltus
from branches.curves.plane import plane_of
from branches.curves.starting import CurveStart
from bvp.motion import EventKind
from bvp.simulate import Simulator
from saltus.processes import open_executor
from saltus.scene import load_scene
from tests.branches.curve_oracles import ImpactOscillator
from transitions.chart.cells import find_regions
from transitions.chart.chart import find_chart, follow_level, places_between
from transitions.chart.curves import CurveSearch
from transitions.chart.files import chart_record, chart_table
from transitions.chart.known import KnownCurves
from transitions.chart.plan import ChartPlan, default_window
from transitions.chart.regions import MotionKind

WINDOW = ((0.9, 1.1), (0.06, 0.25))
ROUNDING = 1e-9  # of amplitudes; a curve's points are solved to 1e-11 of their unknowns


def oracle(periods=1):
    return ImpactOscillator(0.1, 0.8, periods=periods)


@pytest.fixture(scope="module")
def branches():
    """The response with one impact at A = 0.12: it ends where it grazes, and its period doubles."""
    found = saltus.trace_response(load_scene("damped_impact_oscillator").parametric, "w", WINDOW[0], values={"A": 0.12})
    assert [event.type for event in found[0].events] == ["GR", "PD", "EP"]
    return found


@pytest.fixture(scope="module")
def plan(branches):
    return ChartPlan(branches, ("w", "A"), WINDOW, levels=1, grid=(6, 4))


@pytest.fixture(scope="module")
def chart(plan):
    found, interrupted = find_chart(plan)
    assert not interrupted
    return found


def shape(curve):
    """Type, impacts and period of a curve."""
    return curve.code, len(curve.plane.problem.sequence), curve.plane.problem.load_periods


def test_fold_doubling_and_grazing_meet_in_one_point(chart):
    """Oracle: w = sqrt(1 - c^2/4), the amplitude of grazing there. The branch has no fold in this range: the grazing leads to it."""
    w = oracle().meeting(2)
    point = next(point for point in chart.points if {"SN-GR", "PD-GR"} <= set(point.types))
    np.testing.assert_allclose(point.place, (float(w), float(oracle().grazing(w).amplitude)), rtol=1e-9)
    assert {("SN", 1, 1), ("PD", 1, 1), ("GR", 1, 1)} <= {shape(chart.curves[k - 1]) for k in point.curves}
    assert sum({"SN-GR", "PD-GR"} <= set(one.types) for one in chart.points) == 1
    assert [curve.origin for curve in chart.curves if curve.code == "SN"] == ["SN-GR1 of curve 1"]


def test_every_point_with_one_impact_is_on_its_closed_form(chart):
    """Oracle: the amplitudes of fold, doubling and grazing at the frequency of each point, for an impact in one and in two periods."""
    checked = 0
    for curve in chart.curves:
        code, impacts, periods = shape(curve)
        if impacts != 1:
            continue
        forms = oracle(periods)
        form = {"SN": forms.fold, "PD": forms.doubling, "GR": forms.grazing}[code]
        for w, amplitude in curve.parameters:
            # At the end of SN and PD the speed is zero, and the form has none.
            if code == "GR" or abs(w - float(forms.meeting(2 * periods))) > 1e-9:
                assert amplitude == pytest.approx(float(form(w).amplitude), rel=ROUNDING), (code, w)
                checked += 1
    # All but the two ends of a curve.
    assert checked >= sum(len(curve) - 2 for curve in chart.curves if shape(curve)[1] == 1) > 0
    assert {shape(curve) for curve in chart.curves} >= {("SN", 1, 1), ("PD", 1, 1), ("GR", 1, 1), ("PD", 1, 2)}


def test_a_grazing_of_two_impacts_is_that_of_one_that_touches(chart):
    """Oracle: the orbit with one impact in two periods whose flight touches the stop, at the frequency of a point."""
    curve = next(curve for curve in chart.curves if shape(curve) == ("GR", 2, 2))
    problem, forms = curve.plane.problem, oracle(2)
    for k in (len(curve) // 4, len(curve) // 2):
        y, (w, amplitude) = curve.unknowns[k], curve.parameters[k]
        speeds, times = problem.impact_speeds(y), problem.flight_times(y)
        fast = int(np.argmax(speeds))
        touched, _ = forms.touching(lambda speed, w=w: forms.orbit(w, speed), float(speeds[fast]), float(times[fast]))
        assert amplitude == pytest.approx(float(touched.amplitude), rel=1e-8)


def test_no_curve_is_there_twice(chart):
    """Invariant: points inside each curve are on no other one."""
    known = KnownCurves()
    for curve in chart.curves:
        known.add(curve)
    for number, curve in enumerate(chart.curves):
        for k in {len(curve) // 3, 2 * len(curve) // 3}:
            y = curve.unknowns[k]
            start = CurveStart(curve.plane, curve.code, curve.grazing, y)
            assert known.number_at(start, y) == number
    assert len({(shape(curve)) for curve in chart.curves if shape(curve)[1] == 1}) == sum(shape(curve)[1] == 1 for curve in chart.curves)


def test_an_orbit_is_known_between_the_points_and_begun_at_another_impact(chart):
    """Invariant: a point beside one of a curve is on it; with its impacts in another order, too; with a parameter moved off it is not."""
    curve = next(curve for curve in chart.curves if shape(curve) == ("GR", 2, 2))
    known = KnownCurves()
    known.add(curve)
    problem, k = curve.plane.problem, len(curve) // 2
    y = 0.5 * (curve.unknowns[k] + curve.unknowns[k + 1])
    start = CurveStart(curve.plane, "GR", curve.grazing, y)
    y = start.curve(curve.window).begin(y).y
    assert known.number_at(start, y) == 0
    nodes, n = problem.nodes(y), 2 * problem.degrees_of_freedom
    values = problem.parameters(y)
    fractions = np.array([nodes[1, n], nodes[0, n] + 1.0])
    turned = problem.pack(
        nodes[::-1, :n], fractions - math.floor(fractions[0]), [values[name] for name in problem.released], problem.flight_times(y)[::-1]
    )
    plane, again = plane_of(problem, turned, ("w", "A"))
    grazing = curve.grazing._replace(flight=1 - curve.grazing.flight)
    assert known.number_at(CurveStart(plane, "GR", grazing, again), again) == 0
    moved = again.copy()
    moved[0] *= 1.001
    off = CurveStart(plane, "PD", None, again)
    assert known.number_at(off, again) is None


def test_events_of_a_branch_at_another_amplitude_start_no_second_curve(plan, chart):
    """Oracle: the curves of the chart pass through the same response's events at A = 0.2."""
    others = saltus.trace_response(plan.parametric, "w", WINDOW[0], values={"A": 0.2})
    assert {event.type for event in others[0].events} >= {"GR", "PD"}
    search = CurveSearch(plan)
    for curve in chart.curves:
        search.known.add(curve)
    search.from_events("again", [("", others[0])])
    (stage,) = search.stages
    assert (stage.starts, stage.known, stage.curves) == (2, 2, 0)


def test_a_branch_on_a_level_finds_what_the_first_branch_has_not(chart):
    """Invariant: each curve is counted in one stage, in order."""
    assert len(chart.stage_of) == len(chart.curves)
    level = next(stage for stage in chart.stages if " at A = 0.155" in stage.name)
    assert level.curves > 0 and level.known > 0
    assert all(stage.starts == stage.known + stage.outside + stage.failed + stage.curves + stage.left for stage in chart.stages)


def simulated(parametric, w, amplitude):
    """Period and impacts in it of the motion from rest, by the event-driven simulation of 700 periods; None if it does not repeat."""
    values = {"w": w, "A": amplitude}
    simulator = Simulator(parametric.system(values), list(parametric.forces(values)))
    period = 2.0 * math.pi / w
    late = simulator.run([0.0], [0.0], 600.0 * period).final
    motion = simulator.run(late[:1], late[1:], 33.0 * period)
    states = np.hstack(motion.sample(np.arange(33) * period))
    for p in range(1, 17):
        if np.abs(states[p : 2 * p] - states[:p]).max() < 1e-6:
            impacts = motion.times[motion.kinds == EventKind.IMPACT.value]
            return p, int(np.sum((impacts >= period) & (impacts < (1 + p) * period)))
    return None


def test_regions_are_those_of_a_simulation_by_other_means(plan, chart):
    """Oracle: the event-driven simulation from rest. The label of a cell has its period and number of impacts, or is no period."""
    regions, seen = chart.regions, set()
    assert regions.image.shape == (4, 6) and regions.simulated >= len(regions) and not regions.reasons
    for j, i in ((0, 0), (0, 2), (1, 0), (2, 5), (3, 2), (3, 5), (2, 2)):
        found = simulated(plan.parametric, float(regions.x[i]), float(regions.y[j]))
        labels = {(kind.period, kind.impacts) if kind.kind == "periodic" else None for kind in regions.found[j][i]}
        assert found in labels, (i, j, found, labels)
        seen.add(found)
    assert {(1, 0), (1, 1), None} <= seen


def test_regions_do_not_depend_on_processes(plan, chart):
    """Invariant: with two processes the cells are those of one."""
    small = dataclasses.replace(plan, grid=(3, 2))
    here, _ = find_regions(small)
    with open_executor(2) as (executor, _):
        beside, interrupted = find_regions(small, executor)
    assert not interrupted and here.found == beside.found and here.simulated == beside.simulated


def test_a_chart_is_the_same_again(branches, plan):
    """Invariant: two runs give the same bytes, without levels."""
    short = dataclasses.replace(plan, levels=0, grid=(2, 2))
    first, second = (chart_record(find_chart(short)[0]) for _ in range(2))
    assert first == second
    assert [curve["code"] for curve in first["curves"]] == ["GR", "PD", "SN"]


def test_the_table_has_curves_and_cells(chart):
    """Contract: a row for each point of each curve, then one for each cell."""
    table = chart_table(chart)
    rows = sum(map(len, chart.curves))
    assert {len(values) for values in table.values()} == {rows + 24}
    assert set(table["type"][rows:]) == {"cell"} and set(table["curve"][rows:]) == {0}
    assert table["attractors"][rows] == "period 1, no impacts" and table["attractors"][0] == ""
    np.testing.assert_allclose(table["w"][rows : rows + 6], chart.regions.x)


def test_default_ranges(branches):
    """Contract: the range of the branch for its parameter, a factor of 4 around the value of the other one."""
    window, words = default_window(branches, ("w", "A"))
    np.testing.assert_allclose(window, ((0.9, 1.1), (0.03, 0.48)))
    assert words == ["w = 0.9 to 1.1, the range of the branch", "A = 0.03 to 0.48, a factor of 4 around its value 0.12"]
    assert default_window(branches, ("A", "w"))[0] == (window[1], window[0])
    window, words = default_window(branches, ("w", "e"))  # a restitution of 0.8 is 1 at most
    assert window[1] == (0.2, 1.0) and words[1] == "e = 0.2 to 1, a factor of 4 around its value 0.8, in its domain"


def test_levels_are_even_or_by_ratios(branches):
    """Contract: by ratios where the range spans a factor of 8."""
    even = ChartPlan(branches, ("w", "A"), WINDOW, levels=3).level_values
    np.testing.assert_allclose(np.diff(even), np.diff(even)[0])
    ratios = ChartPlan(branches, ("w", "A"), (WINDOW[0], (0.01, 0.16)), levels=3).level_values
    np.testing.assert_allclose(ratios, [0.02, 0.04, 0.08])


def test_motions_are_simulated_between_the_curves(chart):
    """Oracle: A = |1 - w^2 + 0.1 i w| of the grazing; the widest interval is between its two sides."""
    places = places_between([chart.curves[0]], 0.15, WINDOW[0])
    assert len(places) == 3
    w = np.linspace(*WINDOW[0], 2001)
    grazing = w[np.abs(np.hypot(1.0 - w * w, 0.1 * w) - 0.15) < 3e-4]
    assert grazing[0] < places[0] < grazing[-1]


def test_a_motion_without_a_branch_is_noted(plan):
    """Oracle: ten periods are too few for a damping of 0.1."""
    branches, (note,) = follow_level(dataclasses.replace(plan, periods=10), 0.155, [])
    assert branches == [] and note.startswith("the motion from rest at w = 1, A = 0.155: it has not settled yet")


def test_a_start_out_of_the_range_is_counted(branches):
    """Contract."""
    search = CurveSearch(ChartPlan(branches, ("w", "A"), ((0.99, 1.1), (0.06, 0.25))))
    search.from_events("events", [("of branch 1", branches[0])])
    (stage,) = search.stages
    assert (stage.starts, stage.outside, stage.curves) == (2, 1, 1)


@pytest.mark.parametrize(
    ("names", "options", "words"),
    [
        (("w",), {}, "two parameters"),
        (("w", "w"), {}, "two parameters"),
        (("w", "A", "c"), {}, "one more for each equation"),
        (("w", "B"), {}, "unknown parameter 'B'"),
        (("c", "A"), {}, "expected w among the parameters"),
        (("w", "A"), {"window": ((0.9, 1.1), (0.2, 0.1))}, "the range of A"),
        (("w", "A"), {"levels": -1}, "levels is an integer from 0"),
        (("w", "A"), {"most": 0}, "most is an integer from 1"),
        (("w", "A"), {"periods": 10**10}, "periods is an integer from 1"),
        (("w", "A"), {"grid": (0, 5)}, "grid is two integers"),
    ],
)
def test_charts_that_cannot_be(branches, names, options, words):
    """Contract: refused when the plan is made, before any curve is followed."""
    with pytest.raises(ValueError, match=words):
        ChartPlan(branches, names, **{"window": WINDOW, **options})


def test_kinds_in_words():
    """Contract."""
    assert MotionKind("periodic", 1, 0, True).text == "period 1, no impacts, symmetric"
    assert MotionKind("periodic", 1, 0).text == "period 1, no impacts"
    assert MotionKind("periodic", 3, 1, False, True).text == "period 3, 1 impact, sticks"
