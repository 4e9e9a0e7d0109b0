"""Free orbits with smooth forces in released parameters. Oracles: elliptic functions, quadrature in many digits, the problem in modal
coordinates, and differences of its solutions."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from scipy.special import ellipk

from bvp.checks import EPSILON
from bvp.multipoint import MultipointProblem
from bvp.parameters import ParametricSystem
from bvp.released import ReleasedProblem
from saltus.scene import load_scene

OSCILLATOR = ParametricSystem.from_description(
    {
        "parameters": {"k": 1.0, "a": 1.0, "p": 3.0, "m": 1.0},
        "system": {"mass": [["m"]], "stiffness": [["k"]], "springs": [{"c": [1.0], "stiffness": "a", "power": "p"}]},
    }
)
WALL = ParametricSystem.from_description(
    {
        "parameters": {"n": 3.0, "mu": 0.1, "sigma": 0.1, "b": 1.0},
        "system": {
            "mass": [["mu", 0.0], [0.0, 1.0]],
            "stiffness": [["sigma", "-sigma"], ["-sigma", "1 + sigma"]],
            "springs": [{"between": ["u1", "u2"], "stiffness": "b", "power": "2*n + 1"}],
        },
    }
)
STOPPED = ParametricSystem.from_description(
    WALL.describe() | {"system": WALL.describe()["system"] | {"stops": [{"c": [1.0, -1.0], "lower": -1.0, "upper": 1.0}]}}
)


def amplitude(k, a, p, energy):
    found = 1.0
    for _ in range(100):
        found -= (k * found**2 / 2.0 + a * found ** (p + 1.0) / (p + 1.0) - energy) / (k * found + a * found**p)
    return found


def released(parametric, ends, sequence, name, keep, start, nodes, times, **values):
    """The orbit at values of the parameters, of which one is released; its problem too."""
    problem = ReleasedProblem(parametric, ends, sequence, [name], [keep], values=values)
    guess = problem.pack(np.vstack([start, *nodes]), np.zeros(len(times)), [problem.values[name]], times)
    return problem, problem.solve(guess).y


@pytest.mark.parametrize(("name", "value"), [("a", 0.2), ("a", 1.0), ("a", 50.0), ("k", 0.0), ("k", 3.0), ("m", 0.1)])
def test_duffing_oscillator_at_an_energy(name, value):
    """Oracle: the quarter period K(m)/W, W^2 = (k + a A^2)/mass, m = a A^2/(2 (k + a A^2))."""
    at = {"k": 1.0, "a": 1.0, "m": 1.0} | {name: value}
    energy = 0.8
    size = amplitude(at["k"], at["a"], 3.0, energy)
    stiffness = at["k"] + at["a"] * size**2
    quarter = float(ellipk(at["a"] * size**2 / (2.0 * stiffness))) * math.sqrt(at["m"] / stiffness)
    speed = math.sqrt(2.0 * energy / at["m"])
    start, times = [0.0, 1.01 * speed], [1.01 * quarter]
    problem, y = released(OSCILLATOR, ("origin", "rest"), (), name, "energy = 0.8", start, [], times, **{name: value})
    assert abs(problem.flight_times(y)[0] / quarter - 1.0) < 1e-12
    assert abs(problem.nodes(y)[0, 1] / speed - 1.0) < 1e-12
    assert abs(problem.known_values(y)["energy"] - energy) < 1e-13
    assert problem.multipliers(y).tolist() == [1.0, 1.0]


@pytest.mark.parametrize("p", [1.0, 2.7, 3.0, 15.5])
def test_the_exponent_is_released(p):
    """Oracle: the quarter period as an integral, in many digits, without its singular end: x = A sin s."""
    energy, size = 0.8, amplitude(1.0, 1.0, p, 0.8)
    with mpmath.workdps(30):
        e, q = mpmath.mpf(energy), mpmath.mpf(p)
        exact = mpmath.findroot(lambda x: x**2 / 2 + x ** (q + 1) / (q + 1) - e, size)

        def rate(s):
            x = exact * mpmath.sin(s)
            return exact * mpmath.cos(s) / mpmath.sqrt(2 * (e - x**2 / 2 - x ** (q + 1) / (q + 1)))

        quarter = float(mpmath.quad(rate, [0, 0.5, 1, 1.4, 1.55, mpmath.pi / 2 - mpmath.mpf("1e-4")])) + 1e-4 * float(
            rate(mpmath.pi / 2 - mpmath.mpf("0.5e-4"))
        )
    problem, y = released(OSCILLATOR, ("origin", "rest"), (), "p", "energy = 0.8", [0.0, 1.2], [], [quarter], p=p)
    assert abs(problem.flight_times(y)[0] / quarter - 1.0) < 1e-11


@pytest.mark.parametrize(("name", "ends"), [("mu", ("origin", "rest")), ("n", ("origin", "rest")), ("b", ("rest", "rest"))])
def test_two_coordinates_agree_with_the_problem_in_modal_coordinates(name, ends):
    """Oracles: the other problem at the same values; the tangent of the family is a difference of its solutions."""

    def solved(value, guess, time, energy=0.1):
        plain = MultipointProblem(WALL.system({name: value}), ends, ())
        y = plain.solve(plain.pack(plain.modes.from_state @ guess, None, [time]), energy=energy).y
        return plain.modes.to_state @ plain.start(y), plain.flight_times(y)[0]

    # From the linear mode.
    value, modes, before = WALL.values[name], WALL.system().modes, 1e-3
    slowest = int(np.argmin(modes.squares))
    frequency = math.sqrt(modes.squares[slowest])
    shape = modes.shapes[:, slowest] * math.sqrt(2.0 * before)
    state, time = np.array([*(0.0 * shape), *shape]), 0.5 * math.pi / frequency
    if ends[0] == "rest":
        state, time = np.array([*(shape / frequency), *(0.0 * shape)]), math.pi / frequency
    for energy in np.geomspace(1e-3, 0.1, 15):
        state, time = solved(value, state * math.sqrt(energy / before), time, energy)
        before = energy
    problem, y = released(WALL, ends, (), name, "energy = 0.1", state + 1e-4, [], [time])
    assert np.abs(problem.nodes(y)[0, :4] - state).max() < 1e-12 * np.abs(state).max()
    assert abs(problem.flight_times(y)[0] - time) < 1e-12
    solution = problem.step(y, np.zeros(2 * problem.unknowns), 0.0)
    slope = solution.tangent[: problem.unknowns] / solution.tangent[problem.place]
    assert np.abs(problem.residual(y)).max() < 1e-12
    half = problem.flown(problem.nodes(y)[0], problem.flight_times(y)[0], 0).slopes[:4, :4]
    # The way back is that of time reversed: R half^-1 R, R = diag(1, 1, -1, -1); a quarter period is followed by its mirror image.
    reverse = np.diag([1.0, 1.0, -1.0, -1.0])
    there = reverse @ np.linalg.inv(half) @ reverse @ half
    expected = np.linalg.eigvals(there @ there if ends[0] == "origin" else there)
    found = problem.multipliers(y)
    nontrivial = found[np.argsort(np.abs(found - 1.0))[2:]]
    assert min(np.abs(expected - nontrivial[0])) < 1e-7 * abs(nontrivial[0]) and abs(np.prod(nontrivial) - 1.0) < 1e-9
    h = 1e-4 * value
    (after, later), (before, earlier) = solved(value + h, state, time), solved(value - h, state, time)
    state_slope = problem.states(slope)[0]
    assert np.abs(state_slope - (after - before) / (2.0 * h)).max() < 1e-6 * max(1.0, np.abs(state_slope).max())
    time_slope = problem.flight_times(slope)[0]
    assert abs(time_slope - (later - earlier) / (2.0 * h)) < 1e-6 * max(1.0, abs(time_slope))


def test_stops_beside_a_smooth_force():
    """Oracle: the problem in modal coordinates."""
    plain = MultipointProblem(STOPPED.system(), ("origin", "stop+"), ())
    found = None
    for speed in np.linspace(4.0, 8.0, 9):
        guess = plain.modes.from_state @ np.array([0.0, 0.0, speed, 0.5])
        try:
            found = plain.solve(plain.pack(guess, None, [1.0 / speed]), energy=2.0).y
            break
        except RuntimeError:
            continue
    assert found is not None
    state, time = plain.modes.to_state @ plain.start(found), plain.flight_times(found)[0]
    problem, y = released(STOPPED, ("origin", "stop+"), (), "mu", "energy = 2", state * (1.0 + 1e-4), [], [time])
    assert np.abs(problem.nodes(y)[0, :4] - state).max() < 1e-11 * np.abs(state).max()
    assert abs(problem.flight_times(y)[0] - time) < 1e-12


def with_texts():
    """Springs given by expressions of coordinates: their linear parts are in the matrices."""
    given = WALL.describe()
    spring = {"on": "u2", "potential": "k*w**2/2 + c*w**4"}
    system = {**given["system"], "springs": [*given["system"]["springs"], spring]}
    return ParametricSystem.from_description({"parameters": {**given["parameters"], "k": "2*sigma", "c": 0.3}, "system": system})


@pytest.mark.parametrize("scene", ["smooth_wall", "cubic_nes", "cubic_and_stops", "duffing_pair", "beam_on_cubic_spring", ""])
def test_systems_along_a_family_are_those_made_anew(scene):
    """Oracle: the system of the description at the same values, for every parameter of the shipped scenes, and for springs given by texts.
    Matrices, modes and descriptions have the same digits. An exponent 2 n + 1 is rounded there only, which moves |w|^p by p log |w|
    roundings: fewer than 100."""
    parametric = load_scene(scene).parametric if scene else with_texts()
    u, v = np.random.default_rng(5).uniform(-1.2, 1.2, (2, 6, parametric.system().degrees_of_freedom))
    for name, value in parametric.values.items():
        released = parametric.smooth_forces(None, [name])
        for other in (0.7 * value, value, 1.9 * value + 0.01):
            values = {**parametric.values, name: min(other, 1.0) if name == "rho" else other}
            along, anew = parametric.system(values, released.at([values[name]])), parametric.system(values)
            assert along.describe() == anew.describe()
            assert (along.is_conservative, along.has_odd_symmetry) == (anew.is_conservative, anew.has_odd_symmetry)
            np.testing.assert_equal(vars(along.modes), vars(anew.modes))
            for computed in (lambda system: system.energy(u, v), lambda system: system.smooth_forces.acting(u, v)):
                exact = computed(anew)
                np.testing.assert_allclose(computed(along), exact, rtol=0.0, atol=100 * EPSILON * np.abs(exact).max())
