"""The clearance of flights under loads against dense samples of the path, by matrix exponentials of the state and of its loads."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
import scipy.linalg

from bvp.forced import ForcedProblem
from bvp.parameters import ParametricSystem
from saltus.scene import load_scene
from tests.lab.limits import TIE
from tests.lab.problems import clearance_under_loads

STOPS = [
    {"c": [1.0, 0.0], "upper": 0.5, "restitution": 0.8},
    {"c": [-1.0, 1.0], "upper": 0.7, "lower": -0.6, "restitution": 0.8},
]  # fmt: skip
SYSTEMS = {
    "undamped": ([[0.0, 0.0], [0.0, 0.0]], [[2.0, -1.0], [-1.0, 2.0]]),
    "modal damping": ([[0.2, -0.1], [-0.1, 0.2]], [[2.0, -1.0], [-1.0, 2.0]]),
    "coupled damping": ([[0.1, 0.0], [0.0, 0.0]], [[2.0, -1.0], [-1.0, 2.0]]),
    "critical damping": ([[2.0, 0.0], [0.0, 6.0]], [[1.0, 0.0], [0.0, 9.0]]),
    "free": ([[0.0, 0.0], [0.0, 0.0]], [[0.0, 0.0], [0.0, 0.0]]),
    "free and damped": ([[0.2, -0.2], [-0.2, 0.2]], [[0.0, 0.0], [0.0, 0.0]]),
}
STIFF = [[2e4, 0.0], [0.0, 0.1]], [[1e6, 0.0], [0.0, 1.0]]


def problem_of(kind, w, load_periods=1, force=1.0):
    damping, stiffness = STIFF if kind == "stiff and damped" else SYSTEMS[kind]
    parametric = ParametricSystem.from_description(
        {
            "parameters": {"F": force, "w": w},
            "system": {"mass": [[1.0, 0.0], [0.0, 1.0]], "damping": damping, "stiffness": stiffness, "stops": STOPS},
            "forces": [
                {"load": [1.0, 0.0], "amplitude": "F", "harmonic": 1},
                {"load": [0.0, 1.0], "amplitude": "0.4*F", "harmonic": 7, "phase": 0.3},
                {"load": [0.0, 1.0], "constant": "0.3*F"},
            ],
        }
    )
    return ForcedProblem(parametric, ["a+", "b-"], ["w"], load_periods=load_periods)


def larger_state(problem, y):
    """The matrix of the state of the system, of 1, and of the loads, and these states (k + 1, E) after each impact."""
    at, n = problem.parameters(y), problem.degrees_of_freedom
    system, layout = problem.parametric.system(at), problem.parametric.layout
    entries, inverse = problem.parametric.entries(at), np.linalg.inv(system.mass)
    size = 2 * n + 1 + 2 * len(layout.harmonics)
    matrix = np.zeros((size, size))
    matrix[:n, n : 2 * n] = np.eye(n)
    matrix[n : 2 * n, : 2 * n] = -inverse @ np.hstack([system.stiffness, system.damping])
    matrix[n : 2 * n, 2 * n] = inverse @ entries[layout.constant]
    cosines, sines = (entries[part].reshape(-1, n) for part in (layout.cosine, layout.sine))
    for h, k in enumerate(layout.harmonics):
        i = 2 * n + 1 + 2 * h
        matrix[i, i + 1], matrix[i + 1, i] = -k * at["w"], k * at["w"]
        matrix[n : 2 * n, i], matrix[n : 2 * n, i + 1] = inverse @ cosines[h], inverse @ sines[h]
    angles = 2.0 * np.pi * problem.load_periods * problem.nodes(y)[:, 2 * n]
    loads = [part(k * angles) for k in layout.harmonics for part in (np.cos, np.sin)]
    return matrix, np.column_stack([problem.nodes(y)[:, : 2 * n], np.ones(len(angles)), *loads])


def sampled(problem, y, samples):
    """The smallest distance from a stop at turning points inside flights, and of the other stops at their ends."""
    system, n = problem.system, problem.degrees_of_freedom
    matrix, states = larger_state(problem, y)
    best = np.inf
    for i, (state, duration) in enumerate(zip(states, problem.flight_times(y), strict=True)):
        path, ahead = state[None], scipy.linalg.expm(matrix * duration / samples)
        while len(path) <= samples:
            path, ahead = np.concatenate([path, path @ ahead.T]), ahead @ ahead
        path = path[: samples + 1]
        for place, stop in enumerate(system.stops):
            w = path[:, :n] @ stop.gap
            for towards, distance in ((1.0, stop.upper - w), (-1.0, w - stop.lower)):
                if not np.isfinite(distance[0]):
                    continue
                turns = (distance[1:-1] <= distance[:-2]) & (distance[1:-1] < distance[2:])
                a, b, c = distance[:-2][turns], distance[1:-1][turns], distance[2:][turns]
                best = min([best, *(b - (a - c) ** 2 / (8.0 * (a - 2.0 * b + c)))])
                # An impact at another stop can turn the path round.
                after = problem.nodes(y)[(i + 1) % len(problem.nodes(y)), n : 2 * n] @ stop.gap
                rates = [towards * (path[-1][n : 2 * n] @ stop.gap), towards * after]
                if problem.modes.contact_stop[problem.contacts[i]] != place and rates[0] >= 0.0 >= rates[1]:
                    best = min(best, float(distance[-1]))
    return best


def require_clearance(problem, seed, samples):
    """Nodes need not be those of an orbit: each flight has its own path."""
    random = np.random.RandomState(seed)
    force = problem.values["F"]
    y = problem.pack(force * random.normal(size=(2, 4)), np.sort(random.uniform(size=2)), [problem.values["w"]])
    expected = sampled(problem, y, samples)
    assert clearance_under_loads(problem, y) == pytest.approx(expected, abs=1e-4 * max(1.0, abs(expected)))


@pytest.mark.parametrize("w", [1.0, 1.0 + 1e-9, np.sqrt(3.0) / 7.0, 0.6, 3.0])
@pytest.mark.parametrize("kind", SYSTEMS)
def test_no_turning_point_is_lost(kind, w):
    """Oracle: dense samples. w is at a resonance, beside it, and far from it."""
    problem = problem_of(kind, w)
    for seed in range(2):
        require_clearance(problem, seed, 4000)


@pytest.mark.parametrize("w", [1.0, np.sqrt(3.0) / 7.0, 0.05])
@pytest.mark.parametrize("kind", SYSTEMS)
def test_flights_of_many_periods_are_searched_to_their_end(kind, w):
    """Oracle: dense samples. The bounds of resonant and of strongly damped modes grow with the duration of the flight."""
    require_clearance(problem_of(kind, w, load_periods=10), 0, 20000)


@pytest.mark.parametrize("force", [1e-8, 1e8])
def test_the_size_of_a_resonant_load_does_not_matter(force):
    """Oracle: dense samples."""
    for w in (1.0, np.sqrt(3.0)):
        require_clearance(problem_of("undamped", w, load_periods=3, force=force), 0, 4000)


@pytest.mark.parametrize(("kind", "w"), [("free and damped", 0.01), ("critical damping", 0.01), ("stiff and damped", 0.3)])
def test_long_flights_of_strongly_damped_modes_are_exact(kind, w):
    """Oracle: the matrix exponential. cosh of the rates' difference overflows."""
    problem = problem_of(kind, w, load_periods=10)
    y = problem.pack(np.random.RandomState(0).normal(size=(2, 4)), [0.1, 0.8], [w])
    matrix, states = larger_state(problem, y)
    for node, state, duration in zip(problem.nodes(y), states, problem.flight_times(y), strict=True):
        expected = (scipy.linalg.expm(matrix * duration) @ state)[:4]
        assert problem.fly(node, duration)[0] == pytest.approx(expected, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("duration", [5e-9, 2.6e-8])
def test_a_flight_that_hardly_leaves_its_stop(duration):
    """Oracle: closed form. The ball leaves its table where the acceleration of the table is that of gravity, and largest. The gap and three
    derivatives are zero there, and the velocity, t^3/6, is far below its rounding."""
    problem = ForcedProblem(load_scene("bouncing_ball", e=0.0, Gamma=1.0).parametric, ["-="], ["Gamma"])
    y = problem.pack(np.zeros((2, 2)), [0.25 + duration / (2.0 * np.pi), 1.25], [1.0])
    assert problem.flight_times(y)[1] == pytest.approx(duration, rel=1e-6)
    assert abs(clearance_under_loads(problem, y)) < 1e-15


def overdamped_turns(c, start, w, duration):
    """Values x at the turning points of x'' + c x' + x = 0.3 + cos w t, from (x, x'), with 50 digits and its two rates apart."""
    c, x, v, w = (mpmath.mpf(value) for value in (c, *start, w))
    rates = [-c / 2 - mpmath.sqrt(c * c / 4 - 1), -c / 2 + mpmath.sqrt(c * c / 4 - 1)]
    load = 1 / (1 - w * w + 1j * c * w)
    x, v = x - mpmath.mpf("0.3") - load.real, v - (1j * w * load).real
    parts = [(v - rates[1] * x) / (rates[0] - rates[1]), (rates[0] * x - v) / (rates[0] - rates[1])]

    def path(t, order):
        free = mpmath.fsum(part * rate**order * mpmath.exp(rate * t) for part, rate in zip(parts, rates, strict=True))
        return free + ((1j * w) ** order * load * mpmath.expj(w * t)).real

    grid = np.unique(np.concatenate([[0.0], np.geomspace(1e-3 / float(c), duration, 400), np.linspace(0.0, duration, 100)[1:]]))
    speeds = [path(t, 1) for t in grid.tolist()]
    zeros = [
        mpmath.findroot(lambda t: path(t, 1), (grid[i], grid[i + 1]), solver="anderson", tol=1e-70)
        for i in range(len(grid) - 1)
        if speeds[i] * speeds[i + 1] < 0
    ]
    return [mpmath.mpf("0.3") + path(t, 0) for t in zeros], mpmath.mpf("0.3") + path(mpmath.mpf(duration), 0), speeds[-1]


@pytest.mark.parametrize("c", [4.0, 400.0, 4e4, 4e6, 4e8, 4e10, 4e13])
def test_no_touch_of_an_overdamped_flight_is_lost(c):
    """Oracle: `overdamped_turns`, for a stop a little above and below the highest peak of flights with all of the fast motion in them."""
    parametric = ParametricSystem.from_description(
        {
            "parameters": {"d": 1.0, "w": 0.7},
            "system": {"mass": [[1.0]], "damping": [[c]], "stiffness": [[1.0]], "stops": [{"c": [1.0], "upper": "d", "restitution": 0.8}]},
            "forces": [{"load": [1.0], "amplitude": 1.0, "harmonic": 1}, {"load": [1.0], "constant": 0.3}],
        }
    )
    random, peaks = np.random.RandomState(3), 0
    for start in np.column_stack([random.uniform(-1.0, 1.0, 12), random.choice([1.0, c, 1.0 / c], 12) * random.normal(size=12)]).tolist():
        problem = ForcedProblem(parametric, [], ["d"])
        with mpmath.workdps(50):
            turns, end, speed = overdamped_turns(c, start, 0.7, 2.0 * np.pi / 0.7)
            turns = [x for x in turns] + ([end] if speed >= 0 >= start[1] else [])
            for part in (1e-12, -1e-12) if turns else ():
                d = float(max(turns)) + part
                found = clearance_under_loads(problem, problem.pack([start], [0.0], [d]))
                assert found == pytest.approx(float(d - max(turns)), abs=TIE), (start, part)
                peaks += 1
    assert peaks >= 8
