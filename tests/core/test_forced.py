"""The multipoint problem under loads in the core.

Oracles: differences of the residual and of its derivatives, what is compiled for one size against what is for any, step by step against
several steps in one call, closed forms. The residual itself is compared in tests/bvp/test_curvature.py and test_smooth_loads.py.
"""

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from branches.forced.family import ForcedFamily
from bvp.forced import ForcedProblem
from bvp.forced_orbits import core_problem
from bvp.orbits import RESULT_INDEX
from bvp.parameters import ParametricSystem
from continuation.control import Settings, control_of
from continuation.problem import Goal, Recent
from tests.core.loaded_systems import (
    AUTONOMOUS,
    CLAMPED,
    DUFFING,
    FLOATING,
    FREE,
    HEAVY,
    HELD,
    ODD,
    OSCILLATOR,
    PAIR,
    SPRINGS,
    STIFF,
    UNDAMPED,
)


def problems():
    def made(description, *arguments, **options):
        return ForcedProblem(ParametricSystem.from_description(description), *arguments, **options)

    yield made(OSCILLATOR, ("+",), ("w",))
    yield made(OSCILLATOR, ("+", "+"), ("A",), load_periods=3)
    yield made(OSCILLATOR, ("+", "+", "+"), ("r",), load_periods=2)
    yield made(OSCILLATOR, (), ("d",), pieces=4)
    yield made(PAIR, ("+", "-", "+", "-"), ("w",), load_periods=2)
    yield made(PAIR, ("+", "-", "+"), ("w", "b", "d"), keep=("b = 0.05*w", "d = 1 + A*b**2"))
    yield made(PAIR, ("+",), ("w",))
    yield made(PAIR, (), ("b",))
    yield made(ODD, ("+", "-", "+"), ("A",), half=True)
    yield made(AUTONOMOUS, ("+", "+"), ("f",))
    yield made(AUTONOMOUS, ("+",), ("d",))
    yield made({**AUTONOMOUS, "parameters": {"d": 0.3, "r": 0.6}, "forces": []}, ("+",), ("d",))
    # at resonance, where the two terms of (38) cancel, and beside it; translations, and overdamped ones
    yield made(OSCILLATOR, ("+", "+"), ("w",), values={"w": 1.0})
    yield made(OSCILLATOR, ("+",), ("w",), values={"w": 0.99})
    yield made(FLOATING, ("+", "-"), ("w", "g"), keep=("g = w/5",))
    yield made(FREE, ("+", "-", "+"), ("w",), load_periods=2)
    yield made(HELD, ("a+=", "b+", "a+:"), ("A",))
    yield made(HELD, ("a+=", "b-", "b+", "a+:"), ("w", "g"), keep=("g = 0.3 + w/4",), load_periods=2)
    # masses, dampers and springs, also at resonance, of real rates far apart, and where stops stick
    yield made(STIFF, ("+", "-"), ("k",))
    yield made(STIFF, ("+", "-", "+"), ("m", "c"), keep=("c = 0.02 + m/9",), load_periods=2)
    yield made(STIFF, (), ("c",), pieces=2)
    yield made(HEAVY, ("+",), ("c",))
    yield made(HEAVY, ("+", "-"), ("k", "m", "w"), keep=("k = 2*m", "w = 1.3 + k/8"))
    yield made(UNDAMPED, ("+", "+"), ("k",))
    yield made(UNDAMPED, ("+",), ("k", "w"), keep=("w = k",))
    yield made(CLAMPED, ("a+=", "b+", "a+:"), ("m",))
    yield made(CLAMPED, ("a+=", "b-", "b+", "a+:"), ("k", "w"), keep=("w = 1 + k/3",), load_periods=2)
    # smooth forces
    yield made(DUFFING, (), ("w",), pieces=2)
    yield made(DUFFING, ("+",), ("F",))
    yield made(DUFFING, ("+", "+"), ("k", "p", "w"), keep=("p = 2 + k", "w = 1.2*k"))
    yield made(SPRINGS, (), ("a", "q"), keep=("q = 0.6*a",))
    yield made(SPRINGS, ("+", "-"), ("m",), half=False)
    yield made(SPRINGS, ("+", "-", "+"), ("b", "c"), keep=("c = b/22",), load_periods=2)
    yield made(SPRINGS, ("+",), ("F",), half=True)


CASES = list(problems())
NAMES = [
    "".join(problem.sequence) + "," + ",".join(problem.released) + ("/2" if problem.half else "") + f",{problem.values.get('w', 0)}"
    for problem in CASES
]
cases = pytest.mark.parametrize("problem", CASES, ids=NAMES)


def some_unknowns(problem, seed=1):
    """Unknowns that fulfil no equation but those of the times."""
    rng, nodes, size = np.random.default_rng(seed), problem.inner + 1, 2 * problem.degrees_of_freedom
    times = np.sort(rng.uniform(0.0, 0.9, nodes)) * problem.closing[1] - 0.2
    values = [problem.values[name] for name in problem.released]
    if problem.has_clock:
        return problem.pack(rng.normal(size=(nodes, size)), times, values)
    return problem.pack(rng.normal(size=(nodes, size)), np.zeros(nodes), values, rng.uniform(0.5, 2.0, nodes))


@cases
@pytest.mark.parametrize("general", [False, True])
def test_the_jacobian_is_the_derivative(problem, general):
    """Oracle: differences of fourth order of the residual."""
    core, y = core_problem(problem, general=general), some_unknowns(problem)
    jacobian = core.jacobian(y)
    for j in range(len(y)):
        step = 2e-4 if problem.is_smooth else 1e-3
        unit = step * np.eye(len(y))[j]
        near, far = (core.residual(y + s * unit) - core.residual(y - s * unit) for s in (1.0, 2.0))
        expected = (8.0 * near - far) / (12.0 * step)
        np.testing.assert_allclose(jacobian[:, j], expected, rtol=1e-8, atol=1e-8 * max(1.0, np.abs(expected).max()))


@pytest.mark.parametrize("damper", [40.0, 4e4, 4e6])
def test_derivatives_by_springs_keep_their_digits_beside_fast_rates(damper):
    """Oracle: the integral along each flight, by Gauss's rule on parts that are short where the motion is fast."""
    problem = ForcedProblem(ParametricSystem.from_description(HEAVY), (), ("k",), values={"c": damper}, pieces=2)
    y, size, n = some_unknowns(problem), problem.size, problem.degrees_of_freedom
    jacobian, system = problem.jacobian(y), problem.system
    layout = problem.parametric.layout
    slope = problem.parametric.derivatives(problem.values, problem.released)[layout.stiffness, 0].reshape(n, n)
    push = np.vstack([np.zeros((n, n)), np.linalg.solve(system.mass, -slope)])
    nodes, times = problem.nodes(y), problem.flight_times(y)
    points, weights = np.polynomial.legendre.leggauss(16)
    for i in range(2):
        edges = np.concatenate([[0.0], times[i] * np.geomspace(1e-9, 1.0, 181)])
        edges = np.sort(np.concatenate([edges, times[i] - edges]))
        expected = np.zeros(size)
        for low, high in zip(edges, edges[1:], strict=False):
            for x, weight in zip(points, weights, strict=True):
                at = 0.5 * (low + high + (high - low) * x)
                state, fraction = problem.fly(nodes[i], at, i)
                behind = problem.flown(np.array([*state, fraction, *nodes[i, size + 1 :]]), times[i] - at, i)
                expected += 0.5 * (high - low) * weight * behind.slopes[:size, :size] @ (push @ state[:n])
        found = jacobian[i * (size + 1) :][:size, -1]
        np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-8 * np.abs(expected).max())


@cases
def test_the_derivative_of_the_jacobian_is_the_second_one(problem):
    """Oracle: the second derivative along two directions, by other jets; also of an open orbit."""
    y, rng = some_unknowns(problem), np.random.default_rng(5)
    a, b = rng.normal(size=(2, len(y)))
    found, wanted = problem.core.second_along(y, a) @ b, problem.core.derivative(y, np.array([a, b]))
    np.testing.assert_allclose(found, wanted, rtol=1e-11, atol=1e-12 * np.abs(found).max())
    if not problem.has_clock:
        return
    a, b = rng.normal(size=(2, len(y) + 1))
    wide = np.append(y, y[0] + problem.closing[1])
    found, wanted = problem.core.second_along(wide, a) @ b, problem.core.open_derivative(wide, np.array([a, b]))
    np.testing.assert_allclose(found, wanted, rtol=1e-11, atol=1e-12 * np.abs(found).max())
    closed = np.append(b[:-1], b[0])  # the end moves with the begin
    np.testing.assert_allclose(problem.core.open_derivative(wide, closed[None]), problem.jacobian(y) @ b[:-1], rtol=1e-10, atol=1e-9)


@cases
def test_second_and_third_derivatives_are_differences(problem):
    """Oracle: differences of the Jacobian, and of the second derivative."""
    core, y = problem.core, some_unknowns(problem)
    rng = np.random.default_rng(2)
    a, b, c = 0.1 * rng.normal(size=(3, len(y)))

    def slope(function, direction):
        step = 2e-4 if problem.is_smooth else 1e-3
        near, far = (function(y + s * step * direction) - function(y - s * step * direction) for s in (1.0, 2.0))
        return (8.0 * near - far) / (12.0 * step)

    second, third = core.derivative(y, np.array([a, b])), core.derivative(y, np.array([a, b, c]))
    np.testing.assert_allclose(second, slope(core.jacobian, a) @ b, rtol=1e-7, atol=1e-8 * np.abs(second).max())
    expected = slope(lambda at: core.derivative(at, np.array([a, b])), c)
    # Where a power is left out beside zero its third derivative is not all rounding.
    tolerance = 1e-6 if problem.is_smooth else 1e-7
    np.testing.assert_allclose(third, expected, rtol=tolerance, atol=0.1 * tolerance * np.abs(third).max())


def landing(core, problem):
    """Arrays that a step fills."""
    u, flights, size = core.unknowns, problem.inner + 1, 2 * problem.degrees_of_freedom
    position = np.empty(size + 2 + len(problem.released))
    return np.empty(u), np.empty(2 * u), position, np.empty((flights, size)), np.empty(len(RESULT_INDEX))


RESPONSES = [
    (OSCILLATOR, ("+",), ("w",), {}, [[-0.05, -0.3]], [0.2]),
    (PAIR, (), ("w",), {}, [[0.1, 0.1, 0.1, 0.1]], [0.0]),
    (STIFF, (), ("k",), {}, [[0.1, 0.1, 0.1, 0.1]], [0.0]),
    (UNDAMPED, ("+",), ("k",), {"values": {"A": 1.0, "w": 2.8, "k": 1.0, "d": -0.05}}, [[-0.05, -0.3]], [0.2]),
]


@pytest.mark.parametrize("case", range(len(RESPONSES)))
def test_steps_do_not_depend_on_what_they_are_compiled_for(case):
    """Oracle: what is compiled for one number of states and parameters, against what is for any."""
    description, sequence, released, options, states, fractions = RESPONSES[case]
    problem = ForcedProblem(ParametricSystem.from_description(description), sequence, released, **options)
    begin = problem.solve(problem.pack(states, fractions, [problem.values[name] for name in released]))
    found = []
    for general in (False, True):
        core = core_problem(problem, general=general)
        arrays, y, tangent = landing(core, problem), begin.y, begin.tangent
        for _ in range(12):
            assert core.step(y, tangent, 0.05, 12, True, *arrays)
            y, tangent = np.array(arrays[0]), np.array(arrays[1])
        assert arrays[4][RESULT_INDEX["residual"]] < 1e-13
        found.append([np.array(part) for part in arrays])
    for one, other in list(zip(*found, strict=True))[:4]:
        np.testing.assert_allclose(one, other, rtol=1e-8, atol=1e-9)


@cases
def test_flights_are_single_ones(problem):
    """Oracle: single flights, and the speeds at their ends; the unknowns need not be an orbit. Clearances are in
    tests/bvp/test_loaded_paths.py."""
    for seed in range(2):
        y = some_unknowns(problem, seed)
        seen = dict(zip(RESULT_INDEX, problem.observed(y), strict=True))
        nodes, (begins, times, ends) = problem.nodes(y), problem.flights(y)
        np.testing.assert_allclose(nodes[:, : problem.size + 1], begins, rtol=1e-14)
        speeds, hit = problem.approach(ends), problem.side[: problem.inner + 1] != 0.0
        if hit.any():
            assert seen["speed"] == pytest.approx(speeds[hit].min(), rel=1e-12)
        assert seen["flight"] == pytest.approx(times.min(), rel=1e-9)
        for i, time in enumerate(times.tolist()):
            np.testing.assert_allclose(problem.fly(nodes[i], time, i)[0], ends[i], rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("case", range(3))
def test_an_advance_is_its_steps(case):
    """Oracle: the same steps one by one, with the same test functions."""
    description, sequence, released, options, states, fractions = RESPONSES[case]
    problem = ForcedProblem(ParametricSystem.from_description(description), sequence, released, **options)
    family = ForcedFamily(problem, (0.5, 5.0), (1.0, 4.0))
    begin = family.begin(problem.pack(states, fractions, [problem.values[name] for name in released]))
    unknown = [math.nan] * len(family.tests)
    taken = family.advance(Recent(begin, begin.tests, unknown, unknown), 0.002, Goal(begin), 8, control_of(Settings()))
    assert len(taken.steps) > 1 or case == 0
    step = begin
    for other, length in zip(taken.steps, taken.strides, strict=True):
        step = family.step(step.y, step.tangent, float(length))
        np.testing.assert_allclose(step.y, other.y, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(step.tests, other.tests, rtol=1e-10, atol=1e-10)


def test_an_oscillator_with_one_impact_has_its_closed_form():
    """Oracle: x'' + x = cos(w t), one impact a period, w = 2.8, r = 0.8: approach speed at the stop x = 0, determinant r^2 of the
    monodromy, and the period doubling at s = -0.0685756522788391."""
    problem = ForcedProblem(ParametricSystem.from_description(OSCILLATOR), ("+",), ("d",))
    core, arrays = problem.core, landing(problem.core, problem)
    y = problem.pack([[0.0, -0.27]], [0.4], [0.0])
    row = np.eye(core.unknowns)[-1]
    for stop, speed in ((0.0, 0.3361772699757), (-0.0685756522788391, None)):
        assert core.correct(y, row, stop, 30, *arrays)
        assert arrays[4][RESULT_INDEX["energy"]] == pytest.approx(stop, abs=1e-15)
        core.observe(arrays[0], arrays[3], arrays[4])
        multipliers = np.array(core.multipliers(arrays[0]))
        values = multipliers[0] + 1j * multipliers[1]
        assert np.prod(values) == pytest.approx(0.64, abs=1e-12)
        if speed is None:
            assert np.abs(values + 1.0).min() < 1e-11
        else:
            assert arrays[4][RESULT_INDEX["speed"]] == pytest.approx(speed, abs=1e-12)
        y = np.array(arrays[0])


def test_threads_share_a_problem():
    """Oracle: the same calls one after the other."""
    problem = CASES[4]
    core = problem.core
    points = [some_unknowns(problem, seed) for seed in range(40)]
    alone = [core.jacobian(y) for y in points]
    with ThreadPoolExecutor(4) as pool:
        for one, other in zip(alone, pool.map(core.jacobian, points), strict=True):
            np.testing.assert_array_equal(one, other)


def test_arrays_of_other_sizes_are_refused():
    problem = CASES[0]
    core, arrays, y = problem.core, landing(problem.core, problem), some_unknowns(problem)
    for call in (core.residual, core.jacobian, core.multipliers, core.scales):
        with pytest.raises(ValueError, match="unknowns"):
            call(y[:-1])
    with pytest.raises(ValueError, match="a tangent"):
        core.step(y, y, 0.0, 12, False, *arrays)
    with pytest.raises(ValueError, match="a position"):
        core.step(y, np.zeros(2 * len(y)), 0.0, 12, False, *arrays[:2], np.empty(3), *arrays[3:])
    with pytest.raises(ValueError, match="two directions"):
        core.derivative(y, np.zeros((1, len(y))))
