"""Orbits without a clock, and impacts that exchange their order."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import mpmath as mp
import numpy as np
import pytest

from branches.building.responses import ResponsePlan, build_responses, seed_of
from branches.catalogue import Catalogue
from branches.catalogue.rows import SceneRecord
from branches.family import SETTINGS
from branches.forced.family import ForcedFamily
from branches.forced.onwards import ResponseStart, follow_onwards, trace_start
from branches.forced.primitive import half_of
from branches.forced.resequencing import exchanged, later
from branches.forced.switching import beside_grazing
from branches.forced.tracing import follow_response, switch_response
from branches.tables import plain
from bvp.criticality import criticality
from bvp.forced import ForcedProblem
from bvp.parameters import ParametricSystem
from continuation.run import follow_both_ways
from tests.branches.forced_systems import settled
from tests.branches.test_forced_chains import require_motion


def self_excited(**values):
    """x'' - c x' + x = g, x <= 1: energy comes in through negative damping, and leaves at the stop."""
    return ParametricSystem.from_description(
        {
            "parameters": {"c": 0.1, "r": 0.6, "g": 0.0} | values,
            "system": {
                "mass": [[1.0]], "damping": [["-c"]], "stiffness": [[1.0]], "stops": [{"c": [1.0], "upper": 1.0, "restitution": "r"}],
            },
            "forces": [{"load": [1.0], "constant": "g"}],
        }
    )  # fmt: skip


def closed_form(c, r, g, speed, period):
    """Impact speed and period of the orbit with one impact: the flight from (1, -r v) ends at (1, v)."""
    with mp.workdps(30):

        def miss(v, t):
            half = mp.mpf(c) / 2
            w = mp.sqrt(1 - half**2)
            x, dx = 1 - mp.mpf(g), -mp.mpf(r) * v
            a, b = x, (dx - half * x) / w
            grow = mp.exp(half * t)
            end = grow * (a * mp.cos(w * t) + b * mp.sin(w * t))
            rate = half * end + grow * w * (b * mp.cos(w * t) - a * mp.sin(w * t))
            return end + mp.mpf(g) - 1, rate - v

        found = mp.findroot(miss, (mp.mpf(speed), mp.mpf(period)))
        return float(found[0]), float(found[1])


@pytest.mark.parametrize("name", ["r", "c", "g"])
def test_an_orbit_without_a_clock_has_the_period_of_the_closed_form(name):
    """Oracle: two equations in thirty digits; one multiplier is 1, and the other one r^2 exp(c T)."""
    problem = ForcedProblem(self_excited(), ["+"], [name])
    speed, period = closed_form(0.1, 0.6, 0.0, 0.4, 5.5)
    y = problem.solve(problem.pack([[1.0, -0.6 * speed]], [0.0], [problem.values[name]], [period])).y
    family = ForcedFamily(problem, {"r": (0.4, 0.9), "c": (0.02, 0.5), "g": (-0.5, 0.5)}[name])
    run = follow_both_ways(family, y, replace(SETTINGS, maximum_points=200))
    assert len(run.points) > 20
    for point in list(run.points)[::5]:
        y = point.step.y
        at = problem.parameters(y)
        speed, period = closed_form(at["c"], at["r"], at["g"], -problem.states(y)[0, 1] / at["r"], problem.period(y))
        assert -problem.states(y)[0, 1] / at["r"] == pytest.approx(speed, rel=1e-11)
        assert problem.period(y) == pytest.approx(period, rel=1e-11)
        if point.step.extra["speed"] > 1e-3:
            other = at["r"] ** 2 * math.exp(at["c"] * period)
            assert np.sort(problem.multipliers(y).real) == pytest.approx(sorted([1.0, other]), abs=1e-9)


def test_an_orbit_that_nothing_determines_is_refused():
    """Without loads it needs an impact, and something that gains or loses energy."""
    with pytest.raises(ValueError, match="expected an impact"):
        ForcedProblem(self_excited(), [], ["r"])
    with pytest.raises(ValueError, match="expected damping, restitution below 1 or a harmonic load"):
        ForcedProblem(self_excited(c=0.0, r=1.0), ["+"], ["g"])


def pair(**values):
    """Two oscillators with a stop each, weakly coupled, under the same load: at k = 1 they impact at the same instant."""
    return ParametricSystem.from_description(
        {
            "parameters": {"k": 1.1, "w": 1.3, "m": 0.0} | values,
            "system": {
                "mass": [[1.0, "m"], ["m", 1.0]], "damping": [[0.2, 0.0], [0.0, 0.2]], "stiffness": [[1.05, -0.05], [-0.05, "k + 0.05"]],
                "stops": [{"c": row, "upper": 0.5, "restitution": 0.6} for row in ([1.0, 0.0], [0.0, 1.0])],
            },
            "forces": [{"load": [1.0, 1.0], "amplitude": 0.8, "harmonic": 1}],
        }
    )  # fmt: skip


def test_impacts_that_do_not_interact_exchange_their_order():
    """Oracle: by symmetry this happens at k = 1. The neighbour has the other order, and the simulation repeats its orbits on both sides."""
    problem, y = settled(pair(), ["k"])
    run = follow_both_ways(ForcedFamily(problem, (0.8, 1.2)), problem.solve(y).y, SETTINGS)
    (event,) = [event for event in run.events if event.code == "LB"]
    assert event.point.parameter == pytest.approx(1.0, abs=1e-10)
    assert "exchange their order" in event.details["note"]
    inside = run.points[1 if event.index == 0 else -2].step.y
    (found,) = beside_grazing(problem, event.point.extra, inside - event.point.y)
    assert sorted(found.problem.sequence) == sorted(problem.sequence) and found.persists
    assert np.sign(found.step.parameter - 1.0) != np.sign(inside[problem.place] - 1.0)
    require_motion(found.problem, found.step.y)
    beyond = follow_both_ways(ForcedFamily(found.problem, (0.8, 1.2)), found.step, SETTINGS, both=False, direction=0)
    for point in list(beyond.points)[::6]:
        require_motion(found.problem, point.step.y)


def test_impacts_that_interact_at_the_same_instant_end_the_family():
    """A mass that couples both velocities makes the impulses interact."""
    problem, y = settled(pair(m=0.02), ["k"])
    run = follow_both_ways(ForcedFamily(problem, (0.8, 1.2)), problem.solve(y).y, SETTINGS)
    (event,) = [event for event in run.events if "interact" in event.details["note"]]
    assert event.code == "EP" and event.terminal
    assert problem.flight_times(event.point.y)[0] == pytest.approx(0.0, abs=1e-10)


def test_an_orbit_can_be_begun_at_any_impact():
    """Oracle: the residual, and the multipliers, which belong to the orbit."""
    problem, y = settled(pair(), ["k"])
    y = problem.solve(y).y
    turned, moved = later(problem, y)
    assert turned.sequence == (*problem.sequence[1:], problem.sequence[0])
    assert np.abs(turned.residual(moved)).max() < 1e-13
    assert np.sort_complex(turned.multipliers(moved)) == pytest.approx(np.sort_complex(problem.multipliers(y)), abs=1e-12)


def alike(*masses, restitutions=(0.8,) * 5, damping=0.1, harmonic=1.1, lower=None):
    """Oscillators, each before its own stop, with all forces as large as their mass: each has the motion of a single one."""
    weights, unit, bounds = np.diag(masses), np.eye(len(masses)), {"upper": "s"} | ({"lower": lower} if lower else {})
    return ParametricSystem.from_description(
        {
            "parameters": {"F": 0.5, "w": harmonic, "s": 1.0},
            "system": {
                "mass": weights.tolist(), "damping": (damping * weights).tolist(), "stiffness": weights.tolist(),
                "stops": [bounds | {"c": row.tolist(), "restitution": e} for row, e in zip(unit, restitutions, strict=False)],
            },
            "forces": [{"load": list(masses), "amplitude": "F", "harmonic": 1}],
        }
    )  # fmt: skip


def test_independent_impacts_at_one_instant_are_followed():
    """Oracle: the response of a single oscillator, which each of two and of three is."""
    single, _ = settled(alike(1.0), ["F"])
    for count in (2, 3):
        problem, begun = settled(alike(*[1.0] * count), ["F"])
        run = follow_both_ways(ForcedFamily(problem, (0.05, 2.0)), problem.solve(begun).y, SETTINGS)
        parameters = np.array([point.step.parameter for point in run.points])
        assert parameters.max() == pytest.approx(2.0, abs=1e-12) and not [event for event in run.events if event.code == "LB"]
        upper = [point.step.y for point in run.points if point.step.parameter > 0.3]
        assert len(upper) > 20
        for y in upper[::8]:
            last = problem.nodes(y)[-1]  # after all impacts
            for k in range(count):
                fraction, value = last[2 * count], last[2 * count + 1]
                alone = single.pack(last[[[k, count + k]]], np.array([fraction]), [value], np.array([problem.period(y)]))
                assert single.scaled_residual(alone) < 1e-12


@pytest.mark.parametrize("masses", [(1.0, 1.0), (1.0, 2.0), (1.0, 1.0, 1.0), (1.0, 2.0, 3.0), (1.0, 2.0, 3.0, 4.0, 5.0)])
def test_alike_oscillators_have_the_events_of_one(masses):
    """Oracle: one oscillator. As many multipliers pass 1 at once as there are oscillators, so that each of their families has its fold in
    the branch point of them all, whether the determinant changes its sign there or not. All impacts vanish at once, too: each choice of
    the others is a family."""
    places, count = [], len(masses)
    for some in ((1.0,), masses):
        problem, y = settled(alike(*some), ["F"])
        run = follow_both_ways(ForcedFamily(problem, (0.05, 0.6)), problem.solve(y).y, SETTINGS)
        places.append({event.code: event.point.parameter for event in run.events})
        assert len(run.events) == len(places[-1])
        assert all(event.residual < 1e-5 and "absorbed" not in event.details for event in run.events)
    one, found = places
    assert set(one) == {"SN", "GR", "EP"} and set(found) - set(one) == {"BP"}
    one["BP"] = one["SN"]
    assert found == pytest.approx(one, rel=1e-12)
    with pytest.raises(ValueError, match="several multipliers are there"):
        criticality(problem, next(event.point.y for event in run.events if event.code == "SN"), "SN")
    grazing = next(event for event in run.events if event.code == "GR")
    inwards = run.points[1 if grazing.index == 0 else -2].step.y - grazing.point.y
    neighbours = [beside.problem.sequence for beside in beside_grazing(problem, grazing.point.extra, inwards)]
    assert len({frozenset(sequence) for sequence in neighbours}) == len(neighbours) == 2**count - 1
    assert max(map(len, neighbours)) == count - 1


@pytest.mark.parametrize("masses", [(1.0, 1.0), (1.0, 2.0), (1.0, 1.0, 1.0)])
def test_alike_oscillators_double_their_periods_together(masses):
    """Oracle: one oscillator. det(M + 1) has a zero of each: of two it only touches zero."""
    places = []
    for some in ((1.0,), masses):
        start = np.full(len(some), -1.0), np.zeros(len(some))
        problem, y = settled(alike(*some, damping=0.05, harmonic=2.8), ["s"], values={"F": 1.0, "s": -0.3}, start=start)
        run = follow_both_ways(ForcedFamily(problem, (-1.0, 1.0)), problem.solve(y).y, SETTINGS)
        (event,) = [event for event in run.events if event.code == "PD"]
        places.append(event.point.parameter)
        assert np.sum(np.abs(problem.multipliers(event.point.y) + 1.0) < 1e-9) == len(some)
    with pytest.raises(ValueError, match="several multipliers are there"):
        criticality(problem, event.point.y, "PD")
    assert places[1] == pytest.approx(places[0], abs=1e-11)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_alike_oscillators_lose_their_symmetry_together(count):
    """Oracle: one oscillator. Where all impacts vanish each of n has both, the upper or the lower one: of these 3^n - 1 other choices one
    of two mirror images is listed, and on the other side the response without impacts."""
    problem, y = settled(alike(*[1.0] * count, restitutions=[0.6] * count, lower="-s"), ["w"])
    orders = [(problem, y), *(exchanged(problem, y, k) for k in range(2 * count - 1) if k % count != count - 1)]
    (half, solution), *others = (half_of(problem, problem.solve(y).y) for problem, y in orders)
    assert all(other.sequence == half.sequence for other, _ in others) and sorted(half.sequence) == list(half.sequence)
    run = follow_both_ways(ForcedFamily(half, (0.5, 1.5)), solution.y, SETTINGS)
    grazing, breaking = run.events[:2]
    assert (breaking.code, breaking.point.parameter) == ("SB", pytest.approx(0.9522525583265588, abs=1e-10))
    found = beside_grazing(half, grazing.point.extra, run.points[1].step.y - grazing.point.y)
    assert len(found) == (3**count - 1) // 2 + 1 and [beside.problem.sequence for beside in found if beside.persists] == [()]


@pytest.mark.parametrize("half", [True, False])
def test_alike_absorbers_become_quasiperiodic_together(half):
    """Oracle: one absorber. The product of 1 - mu_i mu_j has a zero of each pair of multipliers of them all: four at once of two."""
    places = []
    for count in (1, 2):
        unit, coupling = np.eye(count), np.array([[1.0, -1.0], [-1.0, 1.0]])
        parametric = ParametricSystem.from_description(
            {
                "parameters": {"w": 1.1},
                "system": {
                    "mass": np.kron(unit, np.diag([0.1, 1.0])).tolist(),
                    "damping": np.kron(unit, 0.005 * coupling + np.diag([0.0, 0.02])).tolist(),
                    "stiffness": np.kron(unit, 0.1 * coupling + np.diag([0.0, 1.0])).tolist(),
                    "stops": [{"c": row, "lower": -1.0, "upper": 1.0, "restitution": 0.7} for row in np.kron(unit, [1.0, -1.0]).tolist()],
                },
                "forces": [{"load": [0.0, 1.0] * count, "amplitude": 0.3, "harmonic": 1}],
            }
        )
        problem, y = settled(parametric, ["w"], periods=600, half=half)
        run = follow_both_ways(ForcedFamily(problem, (0.7, 2.2)), problem.solve(y).y, SETTINGS)
        places.append([event.point.parameter for event in run.events if event.code == "NS"])
        assert {event.code for event in run.events} == {"GR", "NS", "SN"} | ({"BP"} if count == 2 else set())
    assert len(places[0]) == 2 and places[1] == pytest.approx(places[0], rel=1e-9)


@pytest.mark.parametrize(("restitutions", "together"), [((0.8, 0.6), "b+a+"), ((0.7, 0.7, 0.7), "a+b+c+"), ((0.6, 0.8, 0.6), "a+c+b+")])
def test_each_choice_of_impacts_at_stops_that_are_touched_together_is_a_family(restitutions, together):
    """Oracle: the folds of single oscillators with these restitutions, and the distance of the stop over the amplification, at which all
    touch their stops at once: their responses without impacts are one motion. Those that fold first have fast impacts behind it."""
    folds = {}
    for name, e in zip("abc", restitutions, strict=False):
        problem, y = settled(alike(1.0, restitutions=(e,)), ["F"])
        run = follow_both_ways(ForcedFamily(problem, (0.05, 0.6)), problem.solve(y).y, SETTINGS)
        (folds[name + "+"],) = (event.point.parameter for event in run.events if event.code == "SN")
    count = len(restitutions)
    problem = ForcedProblem(alike(*[1.0] * count, restitutions=restitutions), (), ["F"], values={"F": 0.1})
    place = math.hypot(1.0 - 1.1**2, 0.11)
    beside = 0.05, place * (1.0 + 1e-10)  # a bound does not move the event
    response = follow_response(problem, problem.pack(np.zeros((1, 2 * count)), np.zeros(1), [0.1]), beside)
    (touch,) = [event for event in response.events if event.type == "GR"]
    assert touch.values["F"] == pytest.approx(place, rel=1e-12)
    assert len(touch.neighbours) == 2**count - 1 and touch.neighbours[-1] == (together, False)
    for start in switch_response(response, touch):
        branch = follow_response(*start, (0.05, 0.6), direction="along", origin="GR1")
        first, last = branch.events[0], branch.events[-1]
        own = [folds[symbol] for symbol in start[0].sequence]
        slow = count - sum(fold > max(own) - 1e-9 for fold in own)
        assert (last.type, len(last.neighbours)) == ("GR" if slow else "EP", 2**slow - 1)
        places = [first.values["F"], last.values["F"]]
        assert places == pytest.approx([max(own), place if slow else 0.6], rel=1e-11)


@pytest.mark.parametrize(("restitutions", "count"), [((0.8, 0.6), 5), ((0.8, 0.8), 6)])
def test_families_of_the_same_impacts_at_one_grazing_are_all_followed(restitutions, count, tmp_path):
    """Oracle: one oscillator of each restitution: each alone has a family from the grazing to its fold and on to all loads. From the later
    fold both go on with fast impacts. Where they fold at once, all four choices of a fast and a slow impact meet there. A build has the
    same families; ids do not depend on the start."""
    problem = ForcedProblem(alike(1.0, 1.0, restitutions=restitutions), (), ["F"], values={"F": 0.1})
    start = ResponseStart(problem, problem.pack(np.zeros((1, 4)), np.zeros(1), [0.1]))
    found = follow_onwards([start], lambda start: trace_start(start, (0.05, 2.0)), through=("GR",)).branches
    assert [len(branch.problem.sequence) for branch in found if branch.parameter.max() > 0.2371] == [2]
    ids = {branch.id for branch in found}
    assert len(ids) == len(found) == count
    again = [follow_response(one.problem, one.unknowns[len(one) // 3], (0.0, one.parameter[len(one) // 3] + 1e-3)) for one in found]
    assert {branch.id for branch in again} == ids
    scene = SceneRecord(plain(problem.parametric.describe()), parameters={"names": ["F"], "keep": []})
    with Catalogue(tmp_path / "a.sqlite", "a", scene=scene, provenance={}) as catalogue, ThreadPoolExecutor(1) as pool:
        build_responses(catalogue, [seed_of(problem, start.orbit, (0.05, 2.0), 4)], ResponsePlan((0.05, 2.0), 4), pool)
        assert {row.id for row in catalogue.all_families()} == ids
