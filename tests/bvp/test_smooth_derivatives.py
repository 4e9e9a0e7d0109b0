"""Exact derivatives of orbits with smooth forces. Oracles: extrapolated differences of the Jacobian, a Taylor series in many digits, linear
systems, symmetry."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest

from bvp.curvature import differences_along, third_differences
from bvp.forced import ForcedProblem
from bvp.parameters import ParametricSystem
from bvp.released import ReleasedProblem
from tests.bvp.test_curvature import directions, many_digit_derivatives, random_unknowns, second_along, third
from tests.bvp.test_smooth_loads import DUFFING, PAIR, SHIFTED

BOUNDED = {"stops": [{"c": [1.0], "lower": -0.9, "upper": "k", "restitution": "c"}]}
STEEP = {
    "parameters": {"n": 3.0, "s": 0.2, "m": 0.1},
    "system": {
        "mass": [["m", 0.0], [0.0, 1.0]],
        "stiffness": [["s", "-s"], ["-s", "1 + s"]],
        "springs": [{"between": ["u1", "u2"], "stiffness": 1.0, "power": "2*n + 1"}, {"on": "u2", "potential": "m*cos(w)*w**2"}],
    },
}


def random_state(problem, rng, size=0.5):
    """Unknowns of flights from states of order 1, at the default parameters."""
    return random_unknowns(problem, rng, size, (0.6, 1.8))


def forced(description, released, sequence=(), **options):
    keep = [f"{released[0]}*{name} = 0.3" for name in released[1:]]
    return ForcedProblem(ParametricSystem.from_description(description), sequence, released, keep=keep, **options)


def free(released, ends=("origin", "rest"), keep=("energy = 0.3",), sequence=(), pieces=1):
    system = STEEP["system"] | ({"stops": [{"c": [1.0, -1.0], "upper": "1 + m"}]} if sequence else {})
    return ReleasedProblem(ParametricSystem.from_description(STEEP | {"system": system}), ends, sequence, released, keep, pieces=pieces)


CASES = {
    "Duffing": lambda: forced(DUFFING, ("w", "a")),
    "exponent": lambda: forced(DUFFING | {"parameters": DUFFING["parameters"] | {"p": 9.0}}, ("p", "m")),
    "half period": lambda: forced(DUFFING, ("F",), half=True),
    "constant load": lambda: forced(SHIFTED, ("k", "w")),
    "damper, exponent": lambda: forced(PAIR | {"parameters": PAIR["parameters"] | {"b": 4.3}}, ("q", "b"), load_periods=2),
    "stops": lambda: forced(DUFFING | {"system": DUFFING["system"] | BOUNDED}, ("k", "c"), ("+", "-")),
    "free": lambda: free(("n", "m"), keep=("energy = 0.3", "quarter_period*m = n*energy + 1")),
    "free, closed": lambda: free(("m", "s"), ("periodic", "periodic"), ("energy = 0.3", "quarter_period = s")),
    "free, closed, an impact": lambda: free(("n", "m"), ("periodic", "periodic"), ("energy = 0.3", "quarter_period = n"), ("+",)),
    "free, pieces": lambda: free(("n",), pieces=3),
    "free, closed, pieces": lambda: free(("m",), ("periodic", "periodic"), pieces=2),
    "free, closed, an impact, pieces": lambda: free(("s",), ("periodic", "periodic"), ("quarter_period = s",), ("+", "+"), pieces=2),
    "free, other ends": lambda: free(("s",), ("rest", "origin"), ("energy**2 = quarter_period",)),
}


@pytest.mark.parametrize("case", list(CASES))
def test_derivatives(case):
    """Oracle: differences, which are right to 1e-9 and 1e-7; symmetry."""
    problem = CASES[case]()
    rng = np.random.default_rng(7)
    y = random_state(problem, rng)
    a, b, c = directions(problem, 3, rng)
    assert problem.curvature.is_exact
    along, there = second_along(problem, y, a), differences_along(problem, y, a)
    level = np.abs(there).max()
    assert along @ b == pytest.approx(there @ b, abs=1e-8 * level)
    assert along @ b == pytest.approx(second_along(problem, y, b) @ a, abs=1e-12 * level)
    cubic, known = third(problem, y, a, b, c), third_differences(problem, y, a, b, c)
    assert cubic == pytest.approx(known, abs=1e-6 * (level + np.abs(known).max()))
    assert cubic == pytest.approx(third(problem, y, c, a, b), abs=1e-11 * np.abs(cubic).max())


def test_complex_directions():
    """Oracle: linear in each direction."""
    problem = CASES["Duffing"]()
    rng = np.random.default_rng(2)
    y = random_state(problem, rng)
    a, b, c = directions(problem, 3, rng)
    turned = third(problem, y, a + 1j * b, b + 1j * a, c)
    known = third(problem, y, a, b, c) - third(problem, y, b, a, c) + 1j * (third(problem, y, a, a, c) + third(problem, y, b, b, c))
    assert turned == pytest.approx(known, abs=1e-12 * np.abs(known).max())
    both = second_along(problem, y, a + 2j * b)
    assert both == pytest.approx(second_along(problem, y, a) + 2j * second_along(problem, y, b), abs=1e-13 * np.abs(both).max())


def test_weak_springs():
    """Oracle: the linear system, from which a spring of 1e-16 differs by rounding."""
    system = DUFFING["system"] | BOUNDED
    parameters = {name: value for name, value in DUFFING["parameters"].items() if name not in "ap"}
    weak = system | {"springs": [{"c": [1.0], "stiffness": 1e-16, "power": 3}]}
    plain = {name: part for name, part in system.items() if name != "springs"}
    linear, smooth = (forced(DUFFING | {"parameters": parameters, "system": one}, ("m", "w"), ("+", "-")) for one in (plain, weak))
    assert not linear.is_smooth and smooth.is_smooth
    rng = np.random.default_rng(4)
    y = random_state(linear, rng)
    a, b, c = directions(linear, 3, rng)
    along, cubic = second_along(linear, y, a), third(linear, y, a, b, c)
    assert second_along(smooth, y, a) @ b == pytest.approx(along @ b, abs=1e-13 * np.abs(along).max())
    assert third(smooth, y, a, b, c) == pytest.approx(cubic, abs=1e-12 * np.abs(cubic).max())


def many_digit_end(v, u0, v0, s, time):
    """The end of a flight of m u'' + c u' + k u + a u^3 = F cos(2 pi s + w t), by Taylor series of order 40."""
    steps = 24
    h, order, u, rate = time / steps, 40, u0, v0
    for step in range(steps):
        angle = 2 * mp.pi * s + v["w"] * h * step
        series, speeds, squares = [u], [rate], []
        for k in range(order):
            squares.append(mp.fsum(series[i] * series[k - i] for i in range(k + 1)))
            cube = mp.fsum(squares[i] * series[k - i] for i in range(k + 1))
            load = v["F"] * v["w"] ** k / mp.factorial(k) * mp.cos(angle + k * mp.pi / 2)
            force = load - v["c"] * speeds[k] - v["k"] * series[k] - v["a"] * cube
            series.append(speeds[k] / (k + 1))
            speeds.append(force / v["m"] / (k + 1))
        u, rate = (mp.polyval(part[::-1], h) for part in (series, speeds))
    return u, rate


def test_many_digits():
    """Oracle: differences of a Taylor series in 70 digits."""
    problem = forced(DUFFING, ("a", "w"))
    rng = np.random.default_rng(11)
    y = random_state(problem, rng)
    a, b, c = directions(problem, 3, rng)

    def residual(place):
        s, u, v, *values = place
        at = {name: mp.mpf(value) for name, value in problem.values.items()} | dict(zip(("a", "w"), values, strict=True))
        end = many_digit_end(at, u, v, s, 2 * mp.pi / at["w"])
        return mp.matrix([end[0] - u, end[1] - v])

    value, _, *twins = many_digit_derivatives(residual, y, (a, b, c))
    assert value == pytest.approx(problem.residual(y)[:2], abs=1e-14)
    for twin, found in zip(twins, (second_along(problem, y, a) @ b, third(problem, y, a, b, c)), strict=True):
        assert found[:2] == pytest.approx(twin, abs=2e-13 * np.abs(twin).max())


@pytest.mark.parametrize("description", [STEEP, PAIR])
def test_slopes_of_the_energy(description):
    """Oracle: differences of order 4 of the potential, and of its first derivatives."""
    forces = ParametricSystem.from_description(description).smooth_forces()
    u, step = np.array([0.7, -0.4]), 1e-3
    first, second = forces.energy_slopes(u)
    for i, axis in enumerate(np.eye(2)):
        places = [u + k * step * axis for k in (2, 1, -1, -2)]
        weights = np.array([-1.0, 8.0, -8.0, 1.0]) / (12.0 * step)
        assert first[i] == pytest.approx(weights @ [float(forces.energy(place)) for place in places], abs=1e-8 * np.abs(first).max())
        bends = weights @ [forces.energy_slopes(place)[0] for place in places]
        assert second[i] == pytest.approx(bends, abs=1e-8 * np.abs(second).max())


@pytest.mark.parametrize("released", [("a",), ("p",)])
def test_forces_without_such_derivatives(released):
    """Where an orbit crosses w = 0, |w|^2.5 has no third derivative, and none of second order with its exponent: differences take their
    place, and say so."""
    problem = forced(DUFFING | {"parameters": DUFFING["parameters"] | {"p": 2.5}}, released)
    rng = np.random.default_rng(1)
    y = problem.pack([[0.4, -0.9]], [0.1], [problem.values[name] for name in released], [2.0])
    a, b, c = directions(problem, 3, rng)
    assert third(problem, y, a, b, c) == pytest.approx(third_differences(problem, y, a, b, c))
    assert not problem.curvature.is_exact
    assert second_along(problem, y, a) == pytest.approx(differences_along(problem, y, a))
