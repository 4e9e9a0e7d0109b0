"""The oracles of `curve_oracles` against published numbers, against each other, and against events of families in one parameter."""

from __future__ import annotations

import math
from functools import cache

import mpmath as mp
import numpy as np
import pytest

import saltus
from benchmarks.backbone import Backbone
from branches.forced.family import ForcedFamily
from branches.forced.tracing import follow_response
from bvp.forced import ForcedProblem
from continuation.run import follow_both_ways
from tests.branches.curve_oracles import (
    DIGITS,
    AbsorberOrbit,
    BogdanovTakens,
    ImpactOscillator,
    ReferenceBackbone,
    ResonantMap,
    breaking_turn,
    cusp_fold,
    double_breaking,
    doubling_coefficient,
    doubling_stop,
    fold_stop,
    internal_resonances,
    map_derivative,
)
from tests.branches.forced_systems import absorber_families, impact_speed, oscillator

COCO = ImpactOscillator(damping="0.1", restitution="0.8")
WALL = ImpactOscillator(damping="0.04", restitution="0.9", periods=2)
SHARP = mp.mpf(10) ** (8 - DIGITS)


@pytest.fixture(autouse=True)
def many():
    with mp.workdps(DIGITS):
        yield


def problem_of(one, orbit, settings=None):
    """The problem in A of the program, and the unknowns of an orbit of the oracle."""
    values = {"w": float(orbit.w), "A": float(orbit.amplitude)}
    if settings is None:
        parametric = oscillator(float(one.damping), r=float(one.restitution), s=float(one.distance))
        start = float(one.distance)
    else:
        parametric, start = saltus.load_scene("oscillator_at_wall", **settings).parametric, 0.0
    problem = ForcedProblem(parametric, ["+"], ["A"], load_periods=one.periods, values=values)
    fraction = float(orbit.phase) / (2 * math.pi * one.periods)
    return problem, problem.pack([[start, -float(one.restitution) * float(orbit.speed)]], [fraction], [values["A"]])


def program_events(one, orbit, settings=None):
    """(code, A) of the events along the family in A through an orbit of the oracle."""
    a = float(orbit.amplitude)
    beside = min(one.orbits(orbit.w, 1.001 * orbit.amplitude), key=lambda other: abs(other.speed - orbit.speed))  # a fold is singular
    problem, y = problem_of(one, beside, settings)
    run = follow_both_ways(ForcedFamily(problem, (0.5 * a, 1.5 * a)), problem.solve(y).y)
    return [(event.code, event.point.parameter) for event in run.events]


def nearest(events, code, value):
    return min((found for kind, found in events if kind == code), key=lambda found: abs(found - float(value)))


# One degree of freedom


def test_published_numbers_of_coco_s_oscillator():
    """Oracle: design section 9: grazing at A = 0.1 exactly, fold at A = 0.0999707536283133 with impact speed 0.0041115."""
    assert abs(COCO.grazing(1).amplitude - mp.mpf("0.1")) < SHARP
    fold = COCO.fold(1)
    assert float(fold.amplitude) == pytest.approx(0.0999707536283133, abs=1e-16)
    assert float(fold.speed) == pytest.approx(0.0041115, abs=5e-8)


def test_published_numbers_without_damping():
    """Oracle: design section 9: fold and period doubling at w = 2.8; at w = 3.7 the doubling of period 2 penetrates by 0.0567."""
    one = ImpactOscillator(0, "0.8", distance=0)
    fold, doubling = one.fold("2.8", 1), one.doubling("2.8", 1)
    assert float(fold.distance) == pytest.approx(-1.78023560132159, abs=1e-14)
    assert float(fold.speed) == pytest.approx(4.07973990413528, abs=1e-14)
    assert float(doubling.distance) == pytest.approx(-0.0685756522788391, abs=1e-16)
    assert one.clearance(doubling) == mp.inf
    at_zero = one.orbits("2.8", 1)
    assert [float(orbit.speed) for orbit in at_zero] == [pytest.approx(0.3361772699757, abs=1e-13)]
    two = ImpactOscillator(0, "0.8", periods=2)
    deep = two.doubling("3.7", 1)
    assert float(deep.distance) == pytest.approx(-0.0613186, abs=5e-8)
    assert float(two.clearance(deep)) == pytest.approx(-0.0567, abs=5e-5)


@pytest.mark.parametrize(("w", "n"), [("2.8", 1), ("2.05", 1), ("1.5", 1), ("0.8", 1), ("3.7", 2), ("2.5", 3)])
def test_the_stops_without_damping_are_those_of_the_general_form(w, n):
    """Oracle: the two derivations of fold and doubling; the speeds of the quadratic formula in double precision."""
    one = ImpactOscillator(0, "0.8", periods=n)
    fold, doubling = one.fold(w, 1), one.doubling(w, 1)
    with mp.workdps(DIGITS):
        assert abs(fold.distance - fold_stop(w, "0.8", n)) < SHARP * abs(fold.distance)
        assert abs(doubling.distance - doubling_stop(w, "0.8", n)) < SHARP
    speeds = [impact_speed(float(w), 0.8, n, float(doubling.distance), sign) for sign in (1.0, -1.0)]
    assert min(abs(speed - float(doubling.speed)) for speed in speeds) < 1e-12


ONES = {
    "coco": (COCO, "fold", "1.05"),
    "coco PD": (COCO, "doubling", "0.95"),
    "wall": (WALL, "fold", "0.79"),
    "wall PD": (WALL, "doubling", "0.85"),
}


@pytest.mark.parametrize("name", ONES)
def test_the_orbit_closes_and_has_its_multiplier(name):
    """Oracle: the flight, the quadratic, and the derivative of the impact map by differences in 120 digits."""
    one, curve, w = ONES[name]
    orbit = getattr(one, curve)(w)
    with mp.workdps(DIGITS):
        (x0, v0), (x1, v1) = one.state(orbit, 0), one.state(orbit, one.period(w))
        e = mp.mpf(one.restitution)
        for error in (x0 - 1, x1 - 1, v1 - orbit.speed, v0 + e * orbit.speed):
            assert abs(error) < SHARP
        trace, determinant = one.trace_and_determinant(orbit)
        assert abs(1 + determinant + (trace if curve == "doubling" else -trace)) < SHARP
        derivative = map_derivative(one, orbit)
        assert abs(mp.det(derivative) - determinant) < 1e-30 and abs(derivative[0, 0] + derivative[1, 1] - trace) < 1e-30
        # a fold has one speed at its amplitude
        roots = one.orbits(w, orbit.amplitude * (1 + mp.mpf(10) ** -20))
        assert min(abs(root.speed - orbit.speed) for root in roots) < (1e-8 if curve == "fold" else 1e-15)


@pytest.mark.parametrize(("one", "halves", "w"), [(COCO, 2, "0.9987492177719089458"), (WALL, 5, "0.79983998399679919978"), (COCO, 1, None)])
def test_fold_doubling_and_grazing_meet(one, halves, w):
    """Oracle: w = 2 p sqrt(1 - c^2/4)/m: sqrt(1 - c^2/4) and 0.8 sqrt(1 - c^2/4). The curves leave to opposite sides, quadratically
    tangent to the grazing: the error of the coefficients falls in proportion to the distance."""
    at = one.meeting(halves)
    with mp.workdps(DIGITS):
        if w is not None:
            assert abs(at - mp.mpf(w)) < 1e-18
        assert abs(one.flight(one.period(at))[0, 1]) < SHARP
        side = -1 if halves % 2 else 1  # of the fold
        for curve, coefficient, sign in zip((one.fold, one.doubling), one.tangency(halves), (side, -side), strict=True):
            errors = []
            for distance in (mp.mpf("1e-5"), mp.mpf("1e-6")):
                orbit = curve(at + sign * distance)
                errors.append((orbit.amplitude - one.grazing(orbit.w).amplitude) / distance**2 / coefficient - 1)
                assert 0 < orbit.speed < 1000 * distance
                with pytest.raises(ValueError, match="no orbit"):
                    curve(at - sign * distance)
            assert abs(errors[0]) < 1e-2 and errors[0] / errors[1] == pytest.approx(10, rel=0.05)


@pytest.mark.parametrize(("w", "code"), [("1.0", "SN"), ("1.1", "SN"), ("1.5", "SN"), ("0.98", "PD"), ("0.9", "PD"), ("0.8", "PD")])
def test_the_program_has_the_events_of_coco_s_oscillator(w, code):
    """Oracle of both: the other one. Fold, doubling and the vanishing of the impact at the grazing."""
    orbit = COCO.fold(w) if code == "SN" else COCO.doubling(w)
    events = program_events(COCO, orbit)
    assert nearest(events, code, orbit.amplitude) == pytest.approx(float(orbit.amplitude), rel=2e-13)
    grazing = COCO.grazing(w).amplitude
    if 0.5 * orbit.amplitude < grazing < 1.5 * orbit.amplitude:
        assert nearest(events, "GR", grazing) == pytest.approx(float(grazing), rel=1e-12)


@pytest.mark.parametrize(("w", "code", "c"), [("0.79", "SN", "0.04"), ("0.81", "PD", "0.04"), ("0.75", "SN", "0.2"), ("0.85", "PD", "0.2")])
def test_the_program_has_the_events_of_the_oscillator_at_its_wall(w, code, c):
    """Oracle of both: the other one, with one impact in two periods, at the damping of the scene and at 0.04."""
    one = ImpactOscillator(c, "0.9", periods=2)
    orbit = one.fold(w) if code == "SN" else one.doubling(w)
    assert one.clearance(orbit) > 0
    events = program_events(one, orbit, {"c": float(c), "r": 0.9})
    assert nearest(events, code, orbit.amplitude) == pytest.approx(float(orbit.amplitude), rel=2e-13)


def test_where_the_fold_at_the_wall_becomes_inadmissible():
    """Oracle: the clearance on both sides, and the program: the orbit closes there, and beside it the family grazes where it should."""
    orbit, time = WALL.touching(WALL.fold, "0.7885", "10.42")
    assert mp.nstr(orbit.w, 25) == "0.7881222563629103606420819"
    assert mp.nstr(orbit.amplitude, 25) == "0.3506490263434484673466658"
    assert 0.65 < time / WALL.period(orbit.w) < 0.66
    assert abs(WALL.clearance(orbit)) < SHARP
    assert WALL.clearance(WALL.fold(orbit.w + 1e-6)) > 0 > WALL.clearance(WALL.fold(orbit.w - 1e-6))
    problem, y = problem_of(WALL, orbit, {"c": 0.04, "r": 0.9})
    assert np.abs(problem.residual(y)).max() < 1e-13
    assert float(problem.multipliers(y).real.max()) == pytest.approx(1.0, abs=1e-12)
    beside, _ = WALL.touching(lambda speed: WALL.orbit("0.79", speed), "1.35", "10.4")
    events = program_events(WALL, WALL.fold("0.79"), {"c": 0.04, "r": 0.9})
    assert nearest(events, "GR", beside.amplitude) == pytest.approx(float(beside.amplitude), rel=1e-11)


def test_the_fold_at_the_wall_is_admissible_with_the_damping_of_the_scene():
    """Oracle: the clearance, from the meeting with m = 5 to that with m = 6 half periods."""
    one = ImpactOscillator("0.2", "0.9", periods=2)
    ends = one.meeting(6), one.meeting(5)
    for share in (0.001, 0.1, 0.3, 0.5, 0.7, 0.9, 0.999):
        assert one.clearance(one.fold(ends[0] + share * (ends[1] - ends[0]))) > 0


def test_the_coefficient_of_the_doubling():
    """Oracle: a cycle of two points of the map at a size xi has a fixed point with the multiplier -(1 + c xi^2) inside."""
    one = ImpactOscillator(0, "0.8")
    orbit = one.doubling("2.8", 1)
    found = doubling_coefficient(one, orbit)
    assert mp.nstr(found.coefficient, 25) == "3.822592842454038157486244"
    with mp.workdps(DIGITS):
        w, a = mp.mpf("2.8"), mp.mpf(1)

        def moved(distance):
            return orbit._replace(distance=distance)

        errors = []
        for size in (mp.mpf("1e-3"), mp.mpf("5e-4")):

            def cycle(x, v, y, u, distance, size=size):
                there = one.impact_map(mp.matrix([x, v]), moved(distance))
                back = one.impact_map(mp.matrix([y, u]), moved(distance))
                return [there[0] - y, there[1] - u, back[0] - x, back[1] - v, (x - y) ** 2 + (v - u) ** 2 - 4 * size**2]

            z, q = mp.matrix([orbit.phase, -mp.mpf("0.8") * orbit.speed]), found.eigenvector
            start = [z[0] + size * q[0], z[1] + size * q[1], z[0] - size * q[0], z[1] - size * q[1], orbit.distance]
            distance = mp.findroot(cycle, start, tol=1e-50)[4]
            inner = min(ImpactOscillator(0, "0.8", distance=distance).orbits(w, a), key=lambda other: abs(other.speed - orbit.speed))
            trace, determinant = one.trace_and_determinant(inner)
            multiplier = (trace - mp.sqrt(trace**2 - 4 * determinant)) / 2
            errors.append((-multiplier - 1) / size**2 / found.coefficient - 1)
        assert abs(errors[1]) < 1e-4 and errors[0] / errors[1] == pytest.approx(4, rel=0.01)


# The reference system


@pytest.mark.parametrize(("mu", "sigma"), [(0.1, 0.1), (0.3, 0.1), (0.1, 0.02)])
def test_the_backbone_is_that_of_the_matrices(mu, sigma):
    """Oracle: `Backbone`: eigenvectors, and tau_half as the trace of a product of matrices, in forty digits of rounded stiffnesses."""
    line, other = ReferenceBackbone(mu, sigma), Backbone(mu, sigma)
    for alpha in (0.3, 1.1, 1.7, 2.4):
        assert float(line.energy(alpha)) == pytest.approx(float(other.energy(alpha)), rel=1e-11)
        assert float(line.tau_half(alpha)) == pytest.approx(float(other.tau_half(alpha)), abs=1e-10)
    fold = line.fold()
    assert float(line.tau_half(fold.alpha)) == pytest.approx(2.0, abs=1e-25)


def test_published_numbers_of_the_backbones():
    """Oracle: design section 9: S13O00+ alpha = 1.7 <-> h = 0.58875; the fold of S11O00- at 0.0691; grazing energy of the first mode."""
    line = ReferenceBackbone()
    assert float(line.energy(1.7)) == pytest.approx(0.58875, abs=5e-6)
    assert float(line.fold().h) == pytest.approx(0.0691, abs=5e-5)
    (w, b), _ = line.modes
    assert float(w**2 / (2 * b)) == pytest.approx(0.11850781059358, abs=1e-13)
    assert mp.nstr(line.fold().h, 25) == "0.06911644996826899106805826"


@cache
def family(name, mu, sigma):
    scene = saltus.load_scene(mu=mu, sigma=sigma)
    return saltus.trace(name, scene.system, scene=scene, energy=(0.03, 20.0))


@pytest.mark.parametrize(("mu", "sigma"), [(0.1, 0.1), (0.2, 0.1), (0.1, 0.05)])
def test_the_program_has_the_events_of_the_backbones(mu, sigma):
    """Oracle of both: the other one. The fold of S11O00-, both kinds of symmetry breaking of S13O00+."""
    line = ReferenceBackbone(mu, sigma)
    fold = line.fold()
    (found,) = [event for event in family("S11O00-", mu, sigma).events if event.type == "SN"]
    assert found.h == pytest.approx(float(fold.h), rel=1e-13) and found.alpha == pytest.approx(float(fold.alpha), abs=1e-7)
    events = family("S13O00+", mu, sigma).events
    for kept in ("origin", "stop") if (mu, sigma) != (0.1, 0.1) else ("origin",):
        expected = line.symmetry_breaking(kept)
        assert line.clearance(expected.alpha) > 0
        near = min((event for event in events if event.type == "SB"), key=lambda event: abs(event.alpha - expected.alpha))
        assert near.h == pytest.approx(float(expected.h), rel=1e-12)
        assert near.alpha == pytest.approx(float(expected.alpha), abs=1e-12)


def test_a_touch_of_the_backbone():
    """Oracle: the grazing of S13O00+ in the program, 0.764418 after its start at u = 0 a quarter period before the impact."""
    events = family("S13O00+", 0.1, 0.1).events
    found = max((event for event in events if event.type == "GR"), key=lambda event: event.h)
    line = ReferenceBackbone()
    point, time = line.touch(1.64, 0.76)
    assert found.alpha == pytest.approx(float(point.alpha), abs=1e-12) and found.h == pytest.approx(float(point.h), rel=1e-11)
    assert float(time) == pytest.approx(0.764418, abs=5e-7)
    assert line.clearance(point.alpha - 1e-6) < 0 < line.clearance(point.alpha + 1e-6)


def test_the_limit_without_coupling():
    """Oracle: sigma = 0: b1^2 = 1/mu at w1 = 0, b2 = w2 = 1, where 10 sin(2 alpha) + 2 alpha = 0 breaks the symmetry at mu = 0.1."""
    limit = ReferenceBackbone("0.1", 0)
    assert [float(x) for mode in limit.modes for x in mode] == pytest.approx([0.0, 10.0, 1.0, 1.0], abs=1e-30)
    with mp.workdps(DIGITS):
        alpha = mp.findroot(lambda x: 10 * mp.sin(2 * x) + 2 * x, 1.75)
        assert abs(limit.symmetry_breaking().alpha - alpha) < SHARP
        for sigma in ("1e-10", "1e-12"):
            near = ReferenceBackbone("0.1", sigma)
            assert abs(near.symmetry_breaking().h - limit.symmetry_breaking().h) < 3 * mp.mpf(sigma)
            assert abs(near.fold().h - limit.fold().h) < 3 * mp.mpf(sigma)


def test_where_the_symmetry_breaking_begins_and_ends():
    """Oracle: the condition on both sides. It begins at the linear mode where w2 = 2 w1, and two coalesce at mu = 0.3234."""
    first, second = internal_resonances(sigma="0.1")
    assert (mp.nstr(first, 20), mp.nstr(second, 20)) == ("0.026844312926286742303", "0.30786643087536615026")
    assert internal_resonances(mu="0.1")[1] == pytest.approx(second, abs=1e-30)  # mu and sigma can be exchanged at 0.1
    for mu in (first, second):
        (w1, _), (w2, _) = ReferenceBackbone(mu, "0.1").modes
        assert abs(w2 - 2 * w1) < SHARP
    with pytest.raises(ValueError, match="does not break"):
        ReferenceBackbone(first - 1e-6, "0.1").symmetry_breaking()
    near = ReferenceBackbone(first + 1e-6, "0.1")
    (w, b), _ = near.modes
    assert abs(near.symmetry_breaking().h / (w**2 / (2 * b)) - 1) < 1e-3
    turn, at = breaking_turn(2.58, 0.323, "0.1")
    assert (mp.nstr(turn, 20), mp.nstr(at.alpha, 15)) == ("0.32338629913300088733", "2.57947625906345")
    both = [ReferenceBackbone(turn - 1e-6, "0.1").symmetry_breaking(order=order).alpha for order in (0, 1)]
    assert both[0] < at.alpha < both[1] and both[1] - both[0] < 0.05
    with pytest.raises(ValueError, match="does not break"):
        ReferenceBackbone(turn + 1e-6, "0.1").symmetry_breaking()


@pytest.mark.parametrize(("alpha", "value", "released"), [(1.84, 0.17, "mu"), (2.18, 0.285, "mu"), (1.72, 0.0738, "sigma")])
def test_where_both_symmetry_breakings_meet(alpha, value, released):
    """Oracle: tau_half + 2 has a double zero in alpha there, and the other parameter on both sides splits it."""
    given = {"mu": mp.mpf("0.1"), "sigma": mp.mpf("0.1")} | {released: value}
    found, point = double_breaking(alpha, **given, released=released)
    line = ReferenceBackbone(**given | {released: found})
    for step in (1e-4, 1e-5):
        assert all(abs(line.tau_half(point.alpha + sign * step) + 2) < 1e3 * step**2 for sign in (1, -1))
    beside = [ReferenceBackbone(**given | {released: found + sign * 1e-4}) for sign in (1, -1)]
    apart = [other.symmetry_breaking("origin").alpha - other.symmetry_breaking("stop").alpha for other in beside]
    assert apart[0] * apart[1] < 0


# The absorber


@pytest.mark.parametrize("index", range(4))
def test_the_absorber_s_events_have_their_multipliers(index):
    """Oracle: matrix exponentials beside the families of the program. At each event its condition holds, at a point beside it does not."""
    branch = absorber_families()[index]
    checked = 0
    for event in branch.events:
        if event.type == "EP":
            continue
        orbit = AbsorberOrbit.of(branch.problem, branch.unknowns[event.point])
        assert orbit.residual() < 1e-12
        before = AbsorberOrbit.of(branch.problem, branch.unknowns[event.point - 2 if event.point > 2 else event.point + 2])
        assert before.residual() < 1e-12
        if event.type == "GR":
            slowest = orbit.impact_speeds().min(initial=math.inf)
            turn = orbit.closest_turn()
            assert min(slowest, abs(turn.clearance)) < 1e-9
            if slowest > 1e-9:
                assert orbit.at(turn.time) == pytest.approx((turn.side, 0.0), abs=1e-9) and abs(turn.rate) < 1e-10
        elif event.type in ("SN", "SB", "PD", "NS"):
            assert orbit.distance(event.type) < 1e-12 < 1e-5 < before.distance(event.type)
        checked += 1
    assert checked


def test_the_product_of_the_absorber_s_multipliers():
    """Oracle: det = rho^(2 k) exp(-(lam + c (1 + 1/mu)) T), with k impacts; over half a period half of both."""
    for branch in absorber_families():
        orbit = AbsorberOrbit.of(branch.problem, branch.unknowns[len(branch.unknowns) // 2])
        p = orbit.parameters
        expected = p["rho"] ** (2 * len(orbit.sides)) * math.exp(-(p["lam"] + p["c"] * (1.0 + 1.0 / p["mu"])) * orbit.span)
        assert np.prod(orbit.multipliers()).real == pytest.approx(expected, rel=1e-6)


def test_the_absorber_in_two_other_parameters():
    """Oracle: the events in F at w = 1.05 satisfy the same conditions."""
    first = absorber_families()[0]
    y = min(first.unknowns, key=lambda unknowns: abs(first.problem.parameters(unknowns)["w"] - 1.05))
    values = first.problem.parameters(y)
    problem = ForcedProblem(first.problem.parametric, first.sequence, ["F"], half=first.problem.half, values=values)
    orbit = AbsorberOrbit.of(first.problem, y)
    branch = follow_response(problem, problem.pack(orbit.states, orbit.times / problem.period(y), [values["F"]]), (0.1, 1.0))
    codes = [event.type for event in branch.events if event.type in ("SN", "SB", "NS")]
    for event in branch.events:
        if event.type in codes:
            assert AbsorberOrbit.of(problem, branch.unknowns[event.point]).distance(event.type) < 1e-12
    assert codes


# Algebraic problems


def test_the_folds_of_the_cusp():
    """Oracle: the equation and its derivative."""
    for b in (1e-3, 0.3, 2.0):
        for x, a in cusp_fold(b):
            assert x**3 - b * x - a == pytest.approx(0.0, abs=1e-15) and 3.0 * x * x == pytest.approx(b)
            assert 27.0 * a * a == pytest.approx(4.0 * b**3)


def test_the_curves_of_the_bogdanov_takens_problem():
    """Oracle: eigenvalues by numpy; the derivative by differences."""
    problem = BogdanovTakens(s=-1.0)
    for b in (-0.5, 0.4):
        x, a = problem.fold(b)
        state = np.array([x, 0.0])
        assert problem.field(state, a, b) == pytest.approx([0.0, 0.0], abs=1e-15)
        assert np.abs(np.linalg.eigvals(problem.jacobian(state, a, b))).min() < 1e-15
    x, a = problem.hopf(-0.5)
    assert sorted(np.linalg.eigvals(problem.jacobian(np.array([x, 0.0]), a, -0.5)).imag) == pytest.approx([-(0.5**0.5), 0.5**0.5])
    state, step = np.array([0.3, 0.2]), 1e-6
    columns = [(problem.field(state + d, 0.1, 0.2) - problem.field(state - d, 0.1, 0.2)) / (2 * step) for d in step * np.eye(2)]
    assert problem.jacobian(state, 0.1, 0.2) == pytest.approx(np.transpose(columns), abs=1e-9)


POINTS = {
    # trace and determinant, and the curves that meet there
    "1:1": (2, 1, ("SN", "NS")),
    "1:2": (-2, 1, ("PD", "NS")),
    "1:3": (-1, 1, ("NS",)),
    "1:4": (0, 1, ("NS",)),
    "SN+PD": (0, -1, ("SN", "PD")),
}


@pytest.mark.parametrize("s", [-1.0, 0.5, 3.0])
def test_the_curves_and_points_of_the_resonant_map(s):
    """Oracle: trace and determinant of the Jacobian at the points; its eigenvalues on the curves SN and PD."""
    problem = ResonantMap(s)
    for kind, (trace, determinant, curves) in POINTS.items():
        x, a, b = problem.codimension_two(kind)
        state = np.array([x, 0.0])
        assert problem.image(state, a, b) == pytest.approx(state, abs=1e-13)
        jacobian = problem.jacobian(state, a, b)
        assert (np.trace(jacobian), np.linalg.det(jacobian)) == pytest.approx((trace, determinant), abs=1e-13)
        for code in curves:
            assert problem.point(code, b) == pytest.approx((x, a), abs=1e-13)
    for code, multiplier in (("SN", 1.0), ("PD", -1.0)):
        x, a = problem.point(code, 0.7)
        assert np.abs(np.linalg.eigvals(problem.jacobian(np.array([x, 0.0]), a, 0.7)) - multiplier).min() < 1e-13
