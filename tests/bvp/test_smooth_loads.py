"""Orbits with smooth forces under periodic loads. Oracles: another integrator with its own Newton's method, differences, determinants."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bvp.closures import EndsError
from bvp.forced import ForcedProblem
from bvp.parameters import ParametricSystem
from tests.bvp.test_multipliers import nearest
from tests.lab.problems import fly

DUFFING = {
    "parameters": {"F": 0.3, "c": 0.1, "k": 1.0, "a": 1.0, "p": 3.0, "m": 1.0, "w": 1.2},
    "system": {"mass": [["m"]], "damping": [["c"]], "stiffness": [["k"]], "springs": [{"c": [1.0], "stiffness": "a", "power": "p"}]},
    "forces": [{"load": [1.0], "amplitude": "F", "harmonic": 1}],
}
SHIFTED = DUFFING | {
    "forces": [{"load": [1.0], "amplitude": "F", "harmonic": 1, "phase": 0.4}, {"load": [1.0], "constant": 0.1}],
}
PAIR = {
    "parameters": {"F": 0.5, "c": 0.1, "a": 0.5, "b": 0.2, "q": 0.3, "m": 0.2, "w": 1.1},
    "system": {
        "mass": [["m", 0.0], [0.0, 1.0]],
        "damping": [["c", "-c"], ["-c", "2*c"]],
        "stiffness": [[0.3, -0.3], [-0.3, 1.3]],
        "springs": [{"between": ["u1", "u2"], "stiffness": "a", "power": "2 + b"}, {"on": "u2", "potential": "q*w**4"}],
        "dampers": [{"on": "u2", "polynomial": [0.0, 0.0, 0.05]}],
    },
    "forces": [{"load": [0.0, 1.0], "amplitude": "F", "harmonic": 1}, {"load": [0.1, 0.0], "amplitude": "F", "harmonic": 3}],
}


def motion(description, values, s):
    """z' of the description at a time, written out once more."""
    v = ParametricSystem.from_description(description).at(values)

    def duffing(t, z):
        angle = 2.0 * math.pi * s + v["w"] * t
        load = v["F"] * math.cos(angle + (0.4 if description is SHIFTED else 0.0)) + (0.1 if description is SHIFTED else 0.0)
        return [z[1], (load - v["c"] * z[1] - v["k"] * z[0] - v["a"] * abs(z[0]) ** v["p"] * math.copysign(1.0, z[0])) / v["m"]]

    def pair(t, z):
        angle = 2.0 * math.pi * s + v["w"] * t
        x, y, p, r = z
        w = x - y
        spring = 0.3 * w + v["a"] * abs(w) ** (2.0 + v["b"]) * math.copysign(1.0, w) + v["c"] * (p - r)
        first = 0.1 * v["F"] * math.cos(3.0 * angle) - spring
        second = v["F"] * math.cos(angle) + spring - y - v["c"] * r - 4.0 * v["q"] * y**3 - 0.05 * r**3
        return [p, r, first / v["m"], second]

    return pair if description is PAIR else duffing


def flown(description, values, s, state, time):
    return solve_ivp(motion(description, values, s), (0.0, time), state, method="DOP853", rtol=1e-13, atol=1e-15).y[:, -1]


@pytest.mark.parametrize(
    ("description", "state"), [(SHIFTED, [0.7, -0.3]), (PAIR, [0.7, -0.3, 0.2, 0.4])], ids=["one coordinate", "two coordinates"]
)
def test_a_flight_and_its_derivatives(description, state):
    """Oracles: another integrator; differences of three lengths, extrapolated, by the state, the time and each parameter."""
    parametric = ParametricSystem.from_description(description)
    size = len(state)
    end = flown(description, {}, 0.15, state, 3.3)
    for name in parametric.names:
        problem = ForcedProblem(parametric, (), [name])
        node = np.array([*state, 0.15, parametric.values[name]])
        out, jacobian, rate = fly(problem, node, 3.3)
        assert np.abs(out[:size] - end).max() < 1e-12  # what the other one is asked for
        assert np.abs(rate[:size] - motion(description, {}, 0.15)(3.3, out[:size])).max() < 1e-13
        assert abs(out[size] - 0.15 - 3.3 * parametric.values["w"] / (2.0 * math.pi)) < 1e-15
        for c in range(len(node)):
            steps = np.eye(len(node))[c] * np.array([[1e-3], [5e-4], [2.5e-4]])
            first = [(fly(problem, node + h, 3.3)[0] - fly(problem, node - h, 3.3)[0]) / (2.0 * h[c]) for h in steps]
            second = [(4.0 * first[1] - first[0]) / 3.0, (4.0 * first[2] - first[1]) / 3.0]
            assert np.abs((16.0 * second[1] - second[0]) / 15.0 - jacobian[:, c]).max() < 2e-11


def shot(description, values, guess, period):
    """A periodic orbit and its monodromy matrix, by the other integrator: Newton's method with differences, at last extrapolated."""
    size = len(guess)
    state = np.array(guess, float)

    def differences(h):
        steps = h * np.eye(size)
        ends = [[flown(description, values, 0.0, state + sign * step, period) for sign in (1.0, -1.0)] for step in steps]
        return np.array([(above - below) / (2.0 * h) for above, below in ends]).T

    change = np.ones(size)
    for _ in range(25):
        if np.abs(change).max() > 1e-3:
            slope = differences(1e-4)
        change = np.linalg.solve(slope - np.eye(size), state - flown(description, values, 0.0, state, period))
        state += change
        if np.abs(change).max() < 2e-12:
            break
    first = [differences(h) for h in (2e-3, 1e-3, 5e-4)]
    second = [(4.0 * first[1] - first[0]) / 3.0, (4.0 * first[2] - first[1]) / 3.0]
    return state, (16.0 * second[1] - second[0]) / 15.0


@pytest.mark.parametrize("w", [0.7, 1.2, 1.6])
def test_forced_duffing_oscillator(w):
    """Oracles: another integrator with Newton's method of its own; the determinant exp(-c T)."""
    problem = ForcedProblem(ParametricSystem.from_description(DUFFING), (), ["w"])
    period = 2.0 * math.pi / w
    state, matrix = shot(DUFFING, {"w": w}, [0.3 / (2.0 - w * w), 0.0], period)
    y = problem.solve(problem.pack([state + 1e-3], [0.0], [w])).y
    assert np.abs(problem.nodes(y)[0, :2] - state).max() < 1e-11
    found = problem.multipliers(y)
    expected = np.linalg.eigvals(matrix)
    assert nearest(found, expected) < 1e-9
    assert abs(np.prod(found) - math.exp(-0.1 * period)) < 1e-12
    half = ForcedProblem(ParametricSystem.from_description(DUFFING), (), ["w"], half=True)
    z = half.solve(half.pack([state], [0.0], [w])).y
    assert np.abs(half.nodes(z)[0, :2] - state).max() < 1e-11
    assert nearest(half.multipliers(z) ** 2, found) < 1e-11


def test_a_stop_beside_a_cubic_spring():
    """Oracles: another integrator from impact to impact; the determinant e^2 exp(-c T)."""
    stops = [{"c": [1.0], "upper": 0.5, "restitution": 0.8}]
    description = DUFFING | {"system": DUFFING["system"] | {"stops": stops}}
    problem = ForcedProblem(ParametricSystem.from_description(description), ("+",), ["w"])

    def bounce(t, z):
        return 0.5 - z[0]

    bounce.terminal, bounce.direction = True, -1.0
    state, t = np.array([0.0, 0.0]), 0.0
    impacts = []
    while len(impacts) < 60:
        run = solve_ivp(motion(DUFFING, {}, 0.0), (t, t + 20.0), state, method="DOP853", rtol=1e-12, atol=1e-13, events=bounce)
        t, state = float(run.t[-1]), run.y[:, -1] * [1.0, -0.8]
        impacts.append((t * 1.2 / (2.0 * math.pi), *state))
    fraction, *last = impacts[-1]
    assert abs(fraction - impacts[-2][0] - 1.0) < 1e-8
    solution = problem.solve(problem.pack([last], [fraction % 1.0], [1.2]))
    node = problem.nodes(solution.y)[0]
    assert np.abs(node[:3] - [0.5, last[1], fraction % 1.0]).max() < 1e-8
    assert np.abs(problem.residual(solution.y)).max() < 1e-12
    assert abs(np.prod(problem.multipliers(solution.y)) - 0.64 * math.exp(-0.1 * 2.0 * math.pi / 1.2)) < 1e-11
    path = solve_ivp(motion(DUFFING, {}, 0.0), (0.0, 2.0 * math.pi / 1.2), [0.5, last[1]], method="DOP853", rtol=1e-12, dense_output=True)
    assert path.success and solution["clearance"] > 0.1 and solution["gave_up"] == 0.0


def test_a_stop_that_sticks_is_refused_beside_a_smooth_force():
    stops = [{"c": [1.0], "upper": 0.5, "restitution": 0.8}]
    description = DUFFING | {"system": DUFFING["system"] | {"stops": stops}}
    with pytest.raises(EndsError, match="a stop that sticks needs linear springs and dampers"):
        ForcedProblem(ParametricSystem.from_description(description), ("+=",), ["w"])


def test_a_flight_that_cannot_be_computed_is_named():
    """Oracle: a period of 60 000 has more steps than there is room for."""
    problem = ForcedProblem(ParametricSystem.from_description(DUFFING), (), ["w"])
    y = problem.pack([[1.0, 0.0]], [0.0], [1e-4])
    text = r"flight 1 of an orbit: a flight of time 6.283e\+04 cannot be computed beyond the time (\S+): it takes more than \d+ Taylor "
    where = re.match(text, problem.violation(y))
    assert where and 100.0 < float(where[1]) < 6e4
    assert problem.violation(problem.pack([[1.0, 0.0]], [0.0], [1.0])) is None
