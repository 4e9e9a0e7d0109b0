"""Families of forced orbits against closed forms, published numbers and simulation."""

from __future__ import annotations

import math

import numpy as np
import pytest

from branches.admissible import describe_grazing
from branches.family import SETTINGS
from branches.forced.branch import wrapped
from branches.forced.closing import with_exact_ends
from branches.forced.family import ForcedFamily
from bvp.forced import ForcedProblem
from bvp.multipoint import RESULT_INDEX, Solution
from bvp.parameters import ParametricSystem
from continuation.run import follow_both_ways
from saltus import load_scene, trace_response
from tests.branches.forced_systems import impact_speed, oscillator, settled
from transitions.response.path import ParameterPath
from transitions.response.starting import settled_orbit
from transitions.sweep.settle import settle


def followed(problem, y, interval, settings=SETTINGS, values=()):
    return follow_both_ways(ForcedFamily(problem, interval, values), problem.solve(y).y, settings)


def events_of(run, *codes):
    return [event for event in run.events if event.code in codes]


class OneByOne(ForcedFamily):
    """A family whose events the engine locates by itself."""

    scan = None

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.advance = None


def test_compiled_location_gives_the_events_of_the_engine(one_impact):
    """Oracle: the same run step by step in Python."""
    problem, run = one_impact
    alone = follow_both_ways(OneByOne(problem, (-3.0, 1.0)), run.points[len(run.points) // 2].step.y, SETTINGS)
    together = follow_both_ways(ForcedFamily(problem, (-3.0, 1.0)), run.points[len(run.points) // 2].step.y, SETTINGS)
    assert len(run.events) > 3
    for one, other in zip(alone.events, together.events, strict=True):
        assert one.code == other.code and one.details == other.details
        assert abs(one.arclength - other.arclength) < 1e-12 and abs(one.point.parameter - other.point.parameter) < 1e-13


@pytest.fixture(scope="module")
def one_impact():
    """x'' + x = cos(2.8 t), r = 0.8, one impact a period, in the place of the stop."""
    problem, y = settled(oscillator(), ["s"], values={"s": -0.2}, start=([-1.0], [0.0]))
    return problem, followed(problem, y, (-3.0, 1.0))


def test_one_impact_follows_both_roots_of_the_formula(one_impact):
    """Oracle: the closed form, to 1e-12, on both sides of the fold."""
    problem, run = one_impact
    (fold,) = events_of(run, "SN")
    for point in run.points:
        s, speed = point.step.parameter, -problem.states(point.step.y)[0, 1] / 0.8
        if abs(s - fold.point.parameter) > 1e-6:  # there the speed is known to the root of rounding
            assert speed == pytest.approx(impact_speed(2.8, 0.8, 1, s, -1.0 if point.index < fold.index else 1.0), abs=1e-12)
    # all multipliers: their product is r^2
    for point in list(run.points)[::20]:
        assert np.prod(problem.multipliers(point.step.y)) == pytest.approx(0.64, abs=1e-9)


def test_the_events_of_one_impact_are_those_of_the_formula(one_impact):
    """Oracle: design section 9. The fold, the period doubling with its multipliers, the touch at the end of the lower sheet."""
    problem, run = one_impact
    touch, fold, doubling, vanishing = run.events
    assert [event.code for event in run.events] == ["GR", "SN", "PD", "GR"]
    assert touch.point.parameter == pytest.approx(-0.368968205647608, abs=1e-13)
    assert fold.point.parameter == pytest.approx(-1.78023560132159, abs=1e-13)
    # A fold locates the speed to the root of rounding.
    assert -problem.states(fold.point.y)[0, 1] / 0.8 == pytest.approx(4.07973990413528, abs=1e-6)
    assert doubling.point.parameter == pytest.approx(-0.0685756522788391, abs=1e-14)
    assert problem.multipliers(doubling.point.y) == pytest.approx([-1.0, -0.64], abs=1e-12)
    assert "vanishes" in vanishing.details["note"]
    assert vanishing.point.parameter == pytest.approx(-1.0 / (1.0 - 2.8**2), abs=1e-12)  # the amplitude of the steady motion


def test_a_root_that_passes_through_the_stop_is_refused():
    """Oracle: at w = 3.7, r = 0.8, n = 2 the formula's period doubling at s = -0.0613186 penetrates the stop by 0.0567."""
    s, w, r = -0.0613186, 3.7, 0.8
    problem = ForcedProblem(oscillator(), ["+"], ["s"], load_periods=2, values={"w": w, "s": s})
    speed = max(impact_speed(w, r, 2, s, sign) for sign in (1.0, -1.0))
    guesses = [problem.pack([[s, -r * speed]], [phase], [s]) for phase in np.linspace(0.0, 0.5, 60)]
    solution = problem.solve(min(guesses, key=lambda y: np.abs(problem.residual(y)).max()))
    assert -problem.states(solution.y)[0, 1] / r == pytest.approx(speed, abs=1e-10)
    assert solution["clearance"] == pytest.approx(-0.0567, abs=5e-5)


def test_a_fold_beside_a_grazing_is_told_apart():
    """Oracle: COCO's oscillator grazes at A = 0.1 exactly, and folds at A = 0.0999707536283133 with impact speed 0.0041115."""
    problem, y = settled(oscillator(0.1, w=1.0, s=1.0, A=0.12), ["A"])
    run = followed(problem, y, (0.09, 0.2))
    (fold,) = events_of(run, "SN")
    (grazing,) = events_of(run, "GR")
    assert fold.point.parameter == pytest.approx(0.0999707536283133, abs=1e-13)
    assert -problem.states(fold.point.y)[0, 1] / 0.8 == pytest.approx(0.0041115, abs=1e-7)
    assert grazing.point.parameter == pytest.approx(0.1, abs=1e-12)


def test_the_response_without_impacts_grazes_where_the_formula_says():
    """Oracle: A = d sqrt((k - w^2)^2 + c^2 w^2) with k = d = 1, c = 0.1; the response itself is a closed form."""
    for w in (0.7, 1.0, 1.4):
        amplitude = math.sqrt((1.0 - w * w) ** 2 + 0.01 * w * w)
        problem = ForcedProblem(oscillator(0.1, w=w, s=1.0, A=0.5 * amplitude), [], ["A"])
        run = followed(problem, problem.pack([[0.0, 0.0]], [0.0], [0.5 * amplitude]), (0.1 * amplitude, 2.0))
        (grazing,) = events_of(run, "GR")
        assert grazing.point.parameter == pytest.approx(amplitude, rel=1e-12)
        free = np.exp(complex(-0.05, math.sqrt(1.0 - 0.0025)) * 2.0 * math.pi / w)
        assert sorted(problem.multipliers(grazing.point.y).imag) == pytest.approx([-abs(free.imag), abs(free.imag)], abs=1e-12)
        response = 1.0 / complex(1.0 - w * w, 0.1 * w)
        for point in run.points:
            a = point.step.parameter
            assert problem.states(point.step.y)[0] == pytest.approx([a * response.real, -a * w * response.imag], abs=1e-12)


@pytest.mark.parametrize("e", [0.5, 0.8])
@pytest.mark.parametrize("n", [1, 2])
def test_a_bouncing_ball_doubles_its_period_where_the_formula_says(n, e):
    """Oracle: SN at Gamma = n pi (1 - e)/(1 + e), PD at sqrt(SN^2 + (2 (1 + e^2)/(1 + e)^2)^2) with multipliers -1 and -e^2, for a ball
    under gravity 1 on a table A cos t with Gamma = A, in coordinates of the table: x'' = -1 + Gamma cos t, x >= 0."""
    ball = ParametricSystem.from_description(
        {
            "parameters": {"G": 1.0, "e": e, "w": 1.0},
            "system": {"mass": [[1.0]], "stiffness": [[0.0]], "stops": [{"c": [1.0], "lower": 0.0, "restitution": "e"}]},
            "forces": [{"load": [1.0], "constant": -1.0}, {"load": [1.0], "amplitude": "G", "harmonic": 1}],
        }
    )
    fold = n * math.pi * (1.0 - e) / (1.0 + e)
    doubling = math.hypot(fold, 2.0 * (1.0 + e * e) / (1.0 + e) ** 2)
    problem = ForcedProblem(ball, ["-"], ["G"], load_periods=n)
    # v+ = n pi e ... from rest to rest: the flight lasts n periods
    value = 0.5 * (fold + doubling)
    speed = n * math.pi * 2.0 / (1.0 + e) / 1.0
    guesses = [problem.pack([[0.0, e * speed]], [phase], [value]) for phase in np.linspace(0.0, 1.0 / n, 120, endpoint=False)]
    run = followed(problem, min(guesses, key=lambda y: np.abs(problem.residual(y)).max()), (0.0, 10.0))
    (sn,) = events_of(run, "SN")
    assert sn.point.parameter == pytest.approx(fold, abs=1e-12)
    found = [event for event in events_of(run, "PD") if abs(event.point.parameter - doubling) < 1e-9]
    assert len(found) == 1
    assert problem.multipliers(found[0].point.y) == pytest.approx([-1.0, -e * e], abs=1e-10)


@pytest.mark.parametrize("speed", [1e-3, 1e-6, 1e-9])
def test_multipliers_keep_their_digits_beside_a_grazing(speed):
    """Oracle: of one impact a period, the product r^2 and the trace of the map, from the impact's speed and the load there."""
    w, r = 2.8, 0.8
    period, gamma = 2.0 * math.pi / w, 1.0 / (1.0 - w * w)
    c, rest = (1.0 + r) * math.sin(period) / (1.0 - math.cos(period)), (1.0 - r) / w
    # s from v by the formula's quadratic, on the side of the vanishing impact; the load at the impact is x'' + x before it
    s = (-c * speed + math.sqrt(4.0 * gamma * gamma - rest * rest * speed * speed)) / 2.0
    problem = ForcedProblem(oscillator(), ["+"], ["s"], values={"s": s})
    guesses = [problem.pack([[s, -r * speed]], [phase], [s]) for phase in np.linspace(0.0, 1.0, 200)]
    y = problem.solve(min(guesses, key=lambda y: np.abs(problem.residual(y)).max())).y
    assert -problem.states(y)[0, 1] / r == pytest.approx(speed, rel=1e-6)
    load = math.cos(2.0 * math.pi * problem.instants(y)[0])
    cosine, sine = math.cos(period), math.sin(period)
    # S = [[-r, 0], [(1 + r)(load - s)/v, -r]] after the flight's rotation
    trace = -2.0 * r * cosine + (1.0 + r) * (load - s) / speed * sine
    found = problem.multipliers(y)
    assert found[0].real == pytest.approx(0.5 * trace + math.copysign(math.sqrt(0.25 * trace * trace - r * r), trace), rel=1e-6)
    assert found[1].real == pytest.approx(r * r / found[0].real, rel=1e-6)


def test_an_impact_at_phase_0_is_not_the_last_one_of_the_period():
    """Oracle: fractions of the period that differ from whole ones by rounding are whole."""
    assert wrapped(np.array([-1e-17, 0.0, 1.0 - 1e-16, 2.0, 1.3, -0.2])) == pytest.approx([0.0, 0.0, 0.0, 0.0, 0.3, 0.8], abs=1e-15)


def with_restitution(kind):
    """Systems with stops of restitution e: one of one degree of freedom, one in half periods, one with several stops, one that sticks.

    Returns the system, released parameters, equations, half, and a restitution at which their motion is settled."""
    two = {
        "mass": [[1.0, 0.2], [0.2, 0.7]],
        "damping": [["3*c", "-c"], ["-c", "2*c"]],
        "stiffness": [[2.0, -1.0], [-1.0, 2.5]],
        "stops": [{"c": [1.0, 0.0], "upper": 0.4, "restitution": "e"}, {"c": [0.5, 1.0], "lower": -0.5, "restitution": "0.5 + 0.5*e"}],
    }
    one = {"mass": [[1.0]], "damping": [["c"]], "stiffness": [[1.0]], "stops": [{"c": [1.0], "upper": 1.0, "restitution": "e"}]}
    sides = one | {"stops": [{"c": [1.0], "lower": -0.5, "upper": 0.5, "restitution": "e"}]}
    system = {"one": one, "curve": one, "sticking": one, "half": sides, "several": two}[kind]
    load = [1.0, 0.3] if kind == "several" else [1.0]
    amplitude, frequency = {"sticking": (1.5, 0.3), "several": (3.0, 3.0)}.get(kind, (0.5, 1.0))
    values = {"e": 0.0, "c": 0.1, "A": amplitude, "w": frequency}
    description = {"parameters": values, "system": system, "forces": [{"load": load, "amplitude": "A", "harmonic": 1}]}
    released, keep = (("e", "c"), ("c = 0.1 + 0.2*e",)) if kind == "curve" else (("e",), ())
    return ParametricSystem.from_description(description), released, keep, kind == "half"


@pytest.mark.parametrize("kind", ["one", "half", "several", "curve"])
@pytest.mark.parametrize("begin", [0.0, 0.3])
def test_multipliers_have_the_right_product_at_each_restitution(kind, begin):
    """Families that begin, pass or end at restitution 0. Oracle: the product of all multipliers is that of all rho_i^2, times
    exp(-tr(M^-1 C) T); at restitution 0 one multiplier vanishes."""
    parametric, released, keep, half = with_restitution(kind)
    plain, y = settled(parametric, ["e"], half=half, values={"e": begin})
    problem = ForcedProblem(parametric, plain.sequence, released, half=half, values=plain.values, keep=keep)
    at = plain.parameters(plain.solve(y).y) | ({"c": 0.1 + 0.2 * begin} if keep else {})
    size = 2 * plain.degrees_of_freedom
    guess = problem.pack(plain.nodes(y)[:, :size], plain.nodes(y)[:, size], [at[name] for name in released])
    run = followed(problem, guess, (0.0, 1.0))
    seen = []
    for point in run.points:
        at = problem.parameters(point.step.y)
        system = parametric.system(at)
        loss = np.trace(np.linalg.solve(system.mass, system.damping)) * problem.period(point.step.y) * (0.5 if half else 1.0)
        rates = [system.stops[system.modes.contact_stop[contact]].restitution for contact in problem.contacts[:-1]]
        found = problem.multipliers(point.step.y)
        if np.isfinite(found).all():
            # One that vanishes is known to the rounding of the map.
            rounding = size * np.finfo(float).eps * max(1.0, np.abs(found[0])) * np.prod(np.abs(found[:-1]))
            assert np.prod(found) == pytest.approx(np.prod(np.square(rates)) * math.exp(-loss), rel=1e-9, abs=rounding)
            seen.append(at["e"])
        if abs(at["e"]) < 1e-11:
            assert np.abs(found).min() < 1e-11
    assert abs(min(seen)) < 1e-11 and max(seen) > 0.45 and len(seen) > 20


def test_a_period_doubling_of_a_family_from_restitution_zero():
    """Two impacts a period of an undamped oscillator. Oracle: the product of its multipliers is r^4, and one of them is -1."""
    branch, *_ = trace_response(load_scene("impact_oscillator").parametric, "r", (0.0, 0.5), start="simulate", values={"r": 0.0, "s": 0.0})
    (event,) = (event for event in branch.events if event.type == "PD")
    found = branch.problem.multipliers(branch.unknowns[event.point])
    assert found[0] == pytest.approx(-1.0, rel=1e-11) and found[1] == pytest.approx(-(event.values["r"] ** 4), rel=1e-9)


def test_a_stop_that_sticks_can_begin_and_end_at_restitution_zero():
    """Its bounces vanish there. Oracle: equality of paths (families from restitution 0 and to it), and simulations at both restitutions."""
    parametric, *_ = with_restitution("sticking")
    found = {}
    for begin in (0.0, 0.1):
        values = parametric.at({"e": begin})
        motion = settle(parametric.system(values), parametric.forces(values))
        start = settled_orbit(ParameterPath(parametric, ("e",), values=values), motion)
        family = ForcedFamily(start.problem, (0.0, 0.1))
        found[begin] = start, with_exact_ends(family, follow_both_ways(family, start.y, SETTINGS))
    ends = {begin: {round(point.step.parameter, 12): point.step.y for point in run.points} for begin, (_, run) in found.items()}
    for value in (0.0, 0.1):
        start, run = found[value]
        one, other = (ends[begin][value] for begin in (0.0, 0.1))
        assert one == pytest.approx(other, abs=1e-10)
        assert start.distance < 1e-9 and start.problem.sequence == found[0.0][0].problem.sequence


def test_a_touch_at_an_impact_is_its_vanishing_speed(one_impact):
    """Oracle: the impact at which the family ends; rounding finds the touch a moment after it, or before it."""
    problem, run = one_impact
    event = next(event for event in events_of(run, "GR") if "vanishes" in event.details["note"])
    solution = event.point.extra
    for time in (7.3e-17, float(problem.flight_times(solution.y)[0]) - 1e-15):
        touched = Solution(solution.y, solution.tangent, solution.position, solution.ends, solution.result.copy())
        for name, value in {"flight": 0.0, "time": time, "stop": 0.0, "side": 1.0}.items():
            touched.result[RESULT_INDEX[f"clearance_{name}"]] = value
        assert describe_grazing(problem, touched, "touches")["note"].endswith("(stop +) vanishes: its speed reaches zero")


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_an_impact_keeps_its_speed_where_its_rebound_vanishes(unit):
    """Oracle: the same motion in other units of length. A touch at an impact with a speed is its rebound, however small the unit."""
    problem, y = settled(oscillator(A=unit), ["s"], values={"s": -0.2 * unit}, start=([-unit], [0.0]))
    solution = problem.solve(y)
    for name, value in {"flight": 0.0, "time": 0.0, "stop": 0.0, "side": 1.0}.items():
        solution.result[RESULT_INDEX[f"clearance_{name}"]] = value
    assert describe_grazing(problem, solution, "touches")["note"] == "the rebound at stop + vanishes: its restitution reaches zero"


def test_impacts_of_a_closed_orbit_are_numbered_from_its_start():
    """Oracle: a flight and its neighbour name the impact between them alike; impact 1 is that at the start."""
    problem, y = settled(oscillator(0.1, A=1.2, w=0.35, r=0.5, s=1.0), ["r"])
    solution, times = problem.solve(y), problem.flight_times(y)
    assert len(times) == 2
    solution.result[RESULT_INDEX["speed"]] = 0.0
    for flight, time, number in ((0, 0.0, 1), (0, times[0], 2), (1, 0.0, 2), (1, times[1], 1)):
        for name, value in {"flight": flight, "time": time, "stop": 0.0, "side": 1.0}.items():
            solution.result[RESULT_INDEX[f"clearance_{name}"]] = value
        assert describe_grazing(problem, solution, "touches")["note"].startswith(f"the impact {number} of 2 (stop +) vanishes")
    for flight, names in ((0, "impact 1 of 2 and impact 2 of 2"), (1, "impact 2 of 2 and impact 1 of 2")):
        solution.result[RESULT_INDEX["flight_index"]] = flight
        assert describe_grazing(problem, solution, "merge")["note"].startswith(f"{names} merge")
