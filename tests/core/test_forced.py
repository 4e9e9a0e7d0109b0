"""The multipoint problem under loads in the core, against the kernels' and against differences.

Oracles: the residual and Jacobian of `bvp.forced`, whose equations contain those of the core; complex differences are replaced by jets'
own agreement with finite ones; steps along families of the kernels.
"""

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import saltus_core

from branches.forced.family import ForcedFamily
from bvp.forced import ForcedProblem
from bvp.forced_orbits import core_problem, core_unknowns, unknowns_of_core
from bvp.orbits import RESULT_INDEX
from bvp.parameters import ParametricSystem
from continuation.control import Settings, control_of, kinds_of
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
    times = np.sort(rng.uniform(0.0, 0.9, nodes)) * problem.segment.closing[1] - 0.2
    values = [problem.values[name] for name in problem.released]
    if problem.has_clock:
        return problem.pack(rng.normal(size=(nodes, size)), times, values)
    return problem.pack(rng.normal(size=(nodes, size)), np.zeros(nodes), values, rng.uniform(0.5, 2.0, nodes))


def core_rows(problem):
    """Which equations of the kernels those of the core are: without those of the clock and of copies of parameters."""
    size, width, kept = 2 * problem.degrees_of_freedom, problem.size, len(problem.keep)
    rows = [i * (width + 1) + r for i in range(problem.inner) for r in [*range(size), width]]
    first = problem.inner * (width + 1)
    return np.array([*rows, *range(first, first + size), *range(first + size + 1, first + size + 2 + kept)])


@cases
def test_the_residual_is_that_of_the_kernels(problem):
    """Oracle: the kernels' equations that the core has, too; at a cut the times are by equation (45) in another form."""
    core, y = core_problem(problem), some_unknowns(problem)
    ours, theirs = core.residual(core_unknowns(problem, y)), problem.residual(y)[core_rows(problem)]
    compared = np.ones(len(ours), dtype=bool)
    if not problem.sequence:
        compared[2 * problem.degrees_of_freedom :: 2 * problem.degrees_of_freedom + 1] = False
    np.testing.assert_allclose(ours[compared], theirs[compared], rtol=1e-12, atol=1e-12)


@cases
@pytest.mark.parametrize("general", [False, True])
def test_the_jacobian_is_the_derivative(problem, general):
    """Oracle: differences of fourth order of the residual."""
    core, y = core_problem(problem, general=general), core_unknowns(problem, some_unknowns(problem))
    jacobian = core.jacobian(y)
    for j in range(len(y)):
        step = 2e-4 if problem.is_smooth else 1e-3
        unit = step * np.eye(len(y))[j]
        near, far = (core.residual(y + s * unit) - core.residual(y - s * unit) for s in (1.0, 2.0))
        expected = (8.0 * near - far) / (12.0 * step)
        np.testing.assert_allclose(jacobian[:, j], expected, rtol=1e-8, atol=1e-8 * max(1.0, np.abs(expected).max()))


@pytest.mark.parametrize("damper", [40.0, 4e4, 4e6])
def test_derivatives_by_springs_keep_their_digits_beside_fast_rates(damper):
    """Oracle: the kernels' integral along each flight, by Gauss's rule."""
    problem = ForcedProblem(ParametricSystem.from_description(HEAVY), (), ("k",), values={"c": damper}, pieces=2)
    y = some_unknowns(problem)
    jacobian, size = core_problem(problem).jacobian(core_unknowns(problem, y)), 2 * problem.degrees_of_freedom
    problem.residual(y)
    for i in range(2):
        expected = problem.flown(problem.nodes(y)[i], problem.flight_times(y)[i], i)[1][:size, -1]
        np.testing.assert_allclose(jacobian[i * (size + 1) :][:size, -1], expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


@cases
def test_second_and_third_derivatives_are_differences(problem):
    """Oracle: differences of the Jacobian, and of the second derivative."""
    core, y = core_problem(problem), core_unknowns(problem, some_unknowns(problem))
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


SEEN = (
    "clearance", "clearance_flight", "clearance_stop", "clearance_side", "clearance_time", "speed", "speed_node", "speeds", "flight",
    "flight_index", "gave_up",
)  # fmt: skip
"""What is observed of an orbit under loads."""

RESPONSES = [
    (OSCILLATOR, ("+",), ("w",), {}, [[-0.05, -0.3]], [0.2]),
    (PAIR, (), ("w",), {}, [[0.1, 0.1, 0.1, 0.1]], [0.0]),
    (STIFF, (), ("k",), {}, [[0.1, 0.1, 0.1, 0.1]], [0.0]),
    (UNDAMPED, ("+",), ("k",), {"values": {"A": 1.0, "w": 2.8, "k": 1.0, "d": -0.05}}, [[-0.05, -0.3]], [0.2]),
]


@pytest.mark.parametrize("general", [False, True])
@pytest.mark.parametrize("case", range(len(RESPONSES)))
def test_steps_along_a_family_are_those_of_the_kernels(case, general):
    """Oracle: orbits, tangents, positions and numbers of the kernels' steps, forwards and after a turn."""
    description, sequence, released, options, states, fractions = RESPONSES[case]
    problem = ForcedProblem(ParametricSystem.from_description(description), sequence, released, **options)
    core = core_problem(problem, general=general)
    theirs = problem.solve(problem.pack(states, fractions, [problem.values[name] for name in released]))
    arrays = landing(core, problem)
    assert core.step(core_unknowns(problem, theirs.y), np.zeros(2 * core.unknowns), 0.0, 12, True, *arrays)
    turned = np.sign(arrays[1][-1 - core.unknowns] * theirs.tangent[2 * problem.degrees_of_freedom + 1])
    ours = [np.array(part) for part in arrays]
    ours[1] *= turned
    for _ in range(12):
        theirs = problem.step(theirs.y, theirs.tangent, 0.05)
        assert core.step(ours[0], ours[1], 0.05, 12, True, *arrays)
        ours = [np.array(part) for part in arrays]
        np.testing.assert_allclose(unknowns_of_core(problem, ours[0]), theirs.y, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(ours[2], theirs.position, rtol=1e-9, atol=1e-9)
        for name in ("energy", "quarter_period", "slope", "turn", *SEEN):
            assert ours[4][RESULT_INDEX[name]] == pytest.approx(theirs[name], rel=1e-8, abs=1e-9)
        assert ours[4][RESULT_INDEX["residual"]] < 1e-13
        assert ours[4][RESULT_INDEX["branching"]] * theirs["branching"] * turned != 0.0
    assert len(saltus_core.POINT_NAMES) == len(ours[4])


@cases
def test_what_is_seen_is_what_the_kernels_see(problem):
    """Oracle: the kernels' search along the flights; the unknowns need not be an orbit. At a tie the instant is any of two."""
    core = core_problem(problem)
    for seed in range(4):
        y = some_unknowns(problem, seed)
        problem.residual(y)
        theirs, ours = np.full((2, len(RESULT_INDEX)), np.nan)
        problem._observe(np.array(y), problem._factor.before.copy(), theirs)
        at = core_unknowns(problem, unknowns_of_core(problem, core_unknowns(problem, y)))
        exact = unknowns_of_core(problem, at)
        problem.residual(exact)
        problem._observe(exact, problem._factor.before.copy(), theirs)
        core.observe(at, np.zeros((problem.inner + 1, 2 * problem.degrees_of_freedom)), ours)
        for name in SEEN:
            k = RESULT_INDEX[name]
            tolerance = 1e-6 if name == "clearance_time" else 1e-9
            assert ours[k] == pytest.approx(theirs[k], rel=tolerance, abs=tolerance), name


@cases
def test_multipliers_are_those_of_the_kernels(problem):
    """Oracle: the kernels' eigenvalues of the same chain; the unknowns need not be an orbit, but each flight begins on its stop."""
    core = core_problem(problem)
    for seed in range(3):
        y = unknowns_of_core(problem, core_unknowns(problem, some_unknowns(problem, seed)))
        theirs = problem.multipliers(y)
        if np.isnan(theirs).any():
            continue
        real, imaginary = core.multipliers(core_unknowns(problem, y))
        ours = real + 1j * imaginary
        size = np.abs(theirs).max()
        np.testing.assert_allclose(np.poly(ours / size), np.poly(theirs / size), rtol=1e-7, atol=1e-9)


def block_of(core, problem, rows, tests):
    """Arrays that steps along a family fill."""
    u, flights, size = core.unknowns, problem.inner + 1, 2 * problem.degrees_of_freedom
    widths = u, 2 * u, size + 2 + len(problem.released)
    return (
        *(np.empty((rows, width)) for width in widths), np.empty((rows, flights, size)), np.empty((rows, len(RESULT_INDEX))),
        np.empty((rows, tests)), np.empty((rows, 2)),
    )  # fmt: skip


@pytest.mark.parametrize("case", range(3))
def test_test_functions_and_advances_are_those_of_the_kernels(case):
    """Oracle: an advance of `branches.forced` by several steps in one call: as many plain steps, at the same orbits, with the same test
    functions; pivots are relative to other equations."""
    description, sequence, released, options, states, fractions = RESPONSES[case]
    problem = ForcedProblem(ParametricSystem.from_description(description), sequence, released, **options)
    family, core = ForcedFamily(problem, (0.5, 5.0), (1.0, 4.0)), core_problem(problem)
    begin = family.begin(problem.pack(states, fractions, [problem.values[name] for name in released]))
    control, unknown, rows, ds = control_of(Settings()), [math.nan] * len(family.tests), 9, 0.002
    theirs = family.advance(Recent(begin, begin.tests, unknown, unknown), ds, Goal(begin), rows - 1, control)

    arrays, (u, size) = landing(core, problem), (core.unknowns, 2 * problem.degrees_of_freedom)
    assert core.step(core_unknowns(problem, np.asarray(begin.y)), np.zeros(2 * u), 0.0, 12, False, *arrays)
    along = np.array(arrays[1]) * np.sign(arrays[1][u - 1] * begin.tangent[size + 1])
    assert core.step(np.array(arrays[0]), along, 0.0, 12, True, *arrays)
    kinds, singular = kinds_of(family.tests), [test.singular for test in family.tests]
    limits = *family.interval, math.inf, 0.0, [1.0, 4.0], len(kinds), 12, bool(family._work.neutral)
    steps, here, nothing = saltus_core.OrbitFamily(core, kinds, singular, *limits), np.empty(len(kinds)), np.full(len(kinds), math.nan)
    steps.values(arrays[0], arrays[3], arrays[4], here)
    block = block_of(core, problem, rows, len(kinds))
    goal = np.array(arrays[2]), np.full(len(arrays[2]), math.nan)
    count, _, _ = steps.advance(*arrays[:3], here, nothing, nothing, 0.0, 0.0, *goal, ds, tuple(control), *block)
    assert count == len(theirs.steps)
    assert count > 1 or case == 0
    for row, step in enumerate(theirs.steps):
        np.testing.assert_allclose(unknowns_of_core(problem, block[0][row]), step.y, rtol=1e-9, atol=1e-9)
        ours, expected = block[5][row], np.array(step.tests)
        compared = np.arange(len(kinds)) != 1
        np.testing.assert_allclose(ours[compared], expected[compared], rtol=1e-7, atol=1e-8)
        assert (ours[1] != 0.0) == (expected[1] != 0.0)


def test_an_oscillator_with_one_impact_has_its_closed_form():
    """Oracle: x'' + x = cos(w t), one impact a period, w = 2.8, r = 0.8: approach speed at the stop x = 0, determinant r^2 of the
    monodromy, and the period doubling at s = -0.0685756522788391."""
    problem = ForcedProblem(ParametricSystem.from_description(OSCILLATOR), ("+",), ("d",))
    core, arrays = core_problem(problem), landing(core_problem(problem), problem)
    y = core_unknowns(problem, problem.pack([[0.0, -0.27]], [0.4], [0.0]))
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
    core = core_problem(problem)
    points = [core_unknowns(problem, some_unknowns(problem, seed)) for seed in range(40)]
    alone = [core.jacobian(y) for y in points]
    with ThreadPoolExecutor(4) as pool:
        for one, other in zip(alone, pool.map(core.jacobian, points), strict=True):
            np.testing.assert_array_equal(one, other)


def test_arrays_of_other_sizes_are_refused():
    problem = CASES[0]
    core, arrays = core_problem(problem), landing(core_problem(problem), problem)
    y = core_unknowns(problem, some_unknowns(problem))
    for call in (core.residual, core.jacobian, core.multipliers, core.scales):
        with pytest.raises(ValueError, match="unknowns"):
            call(y[:-1])
    with pytest.raises(ValueError, match="a tangent"):
        core.step(y, y, 0.0, 12, False, *arrays)
    with pytest.raises(ValueError, match="a position"):
        core.step(y, np.zeros(2 * len(y)), 0.0, 12, False, *arrays[:2], np.empty(3), *arrays[3:])
    with pytest.raises(ValueError, match="two directions"):
        core.derivative(y, np.zeros((1, len(y))))
