"""The coordinates in which arclength is measured. Oracle: central differences of their closed form in numpy."""

import numpy as np
import pytest

from bvp.forced import ForcedProblem
from bvp.forced_metric import position_slopes
from bvp.multipoint import MultipointProblem
from bvp.parameters import ParametricSystem
from bvp.released import ReleasedProblem
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from tests.bvp.orbits import backbone_segment, chain
from tests.lab.problems import Arclength
from tests.lab.problems import units as units_of

PERIODIC = ("periodic", "periodic")


def position_of(problem, y):
    """(start displacements times a frequency, and velocities, / sqrt(2 h); log h, log alpha)."""
    h, squares = problem.energy(y), problem.system.modes.squares
    power = np.floor(0.5 * np.log2(squares[squares > 0.0].min()) + 0.6) if squares.any() else None
    unit = np.repeat([2.0**power if power is not None else 1.0 / problem.quarter_period(y), 1.0], len(squares))
    return np.concatenate([unit * problem.start(y) / np.sqrt(2.0 * h), [np.log(h), np.log(problem.quarter_period(y))]])


def problems():
    rng = np.random.default_rng(11)
    problem, y = backbone_segment(vibro_impact_nes(), 0.9, 3)
    yield problem, y
    loose = ImpactSystem(np.diag([1.0, 2.0]), np.zeros((2, 2)), np.zeros((2, 2)), [Stop((1.0, -1.0), -1.0, 1.0)])
    cases = [(("rest", "stop+"), ("-",)), (("stop-", "origin"), ()), (PERIODIC, ("+", "-", "+"))]
    for system, (ends, sequence) in [*((chain(rng, 3, grounded=True), case) for case in cases), (loose, cases[1])]:
        problem = MultipointProblem(system, ends, sequence)
        y = rng.normal(size=problem.unknowns)
        problem.flight_times(y)[:] = rng.uniform(0.5, 1.5, problem.inner + 1)
        yield problem, y


@pytest.mark.parametrize("problem, y", list(problems()))
def test_changes_of_the_coordinates_against_differences(problem, y):
    rng = np.random.default_rng(5)
    size = problem.size + 2
    direction, found = rng.normal(size=size), Arclength(problem, y)
    np.testing.assert_allclose(found.position, position_of(problem, y), rtol=1e-14, atol=1e-14)
    assert np.isclose(found.value, problem.energy(y), rtol=1e-14) and np.isclose(found.period, problem.quarter_period(y), rtol=1e-14)
    row = found.row(direction)
    for step in rng.normal(size=(5, problem.unknowns)):
        expected = (position_of(problem, y + 1e-6 * step) - position_of(problem, y - 1e-6 * step)) / 2e-6
        change, length, slope = found.change(step)
        np.testing.assert_allclose(change, expected, rtol=1e-7, atol=1e-7 * length)
        assert np.isclose(length, np.linalg.norm(change), rtol=1e-13)
        # h is quadratic, so its central difference is exact
        assert np.isclose(slope, (problem.energy(y + step) - problem.energy(y - step)) / 2.0, rtol=1e-12, atol=1e-12)
        assert abs(row @ step - direction @ expected) < 1e-6 * length * np.linalg.norm(direction)


def forced_problem(**values):
    """x'' + c x' + x = A cos(w t), x <= s, with one impact a period, in w, s and A."""
    stop = {"c": [1.0], "upper": "s", "restitution": 0.6}
    system = {"mass": [[1.0]], "damping": [["c"]], "stiffness": [[1.0]], "stops": [stop]}
    parameters = {"c": 0.1, "A": 1.0, "w": 2.0, "s": 0.1} | values
    description = {"parameters": parameters, "system": system, "forces": [{"load": [1.0], "amplitude": "A", "harmonic": 1}]}
    return ForcedProblem(ParametricSystem.from_description(description), ("+",), ["w", "s", "A"], keep=["s = 0.1*w", "A = 3*s"])


def free_problem():
    """m x'' + k x = 0, x <= s, with two impacts a period, in m, s and k."""
    system = {"mass": [["m"]], "stiffness": [["k"]], "stops": [{"c": [1.0], "upper": "s", "restitution": 1.0}]}
    parametric = ParametricSystem.from_description({"parameters": {"m": 2.0, "s": 0.1, "k": 1.0}, "system": system})
    return ReleasedProblem(parametric, PERIODIC, ("+", "+"), ["m", "s", "k"], ["energy = m", "s = k", "energy = 1"])


@pytest.mark.parametrize("free", [0, 1])
def test_coordinates_in_parameters_against_differences(free):
    problem, rng = (forced_problem, free_problem)[free](), np.random.default_rng(3)
    units = units_of(problem)
    for size in (1e-3, 1.0, 1e3):
        y = problem.pack(size * rng.normal(size=(1 + free, 2)), [0.3] * (1 + free), [1.7, -0.2 * size, size], [[1.0], [0.7, 1.1]][free])
        time = np.log(1.8) if free else 0.3
        x = problem.states(y)[0] / units[:2]
        reach = np.sqrt(1.0 + x @ x)
        plain = [*(x / reach), time, np.log(1.7), np.arcsinh(-0.2 * size / units[4]), np.arcsinh(size / units[5]), np.log(reach)]
        direction, found = rng.normal(size=7), Arclength(problem, y)
        np.testing.assert_allclose(found.position, plain, rtol=1e-14)
        np.testing.assert_allclose(problem.position(y), plain, rtol=1e-14)
        row = found.row(direction)
        for step in rng.normal(size=(5, problem.unknowns)) * np.maximum(np.abs(y), units.max()):
            expected = (problem.position(y + 1e-6 * step) - problem.position(y - 1e-6 * step)) / 2e-6
            change, length, slope = found.change(step)
            np.testing.assert_allclose(change, expected, rtol=1e-6, atol=1e-7 * length)
            np.testing.assert_allclose(position_slopes(problem, y) @ step, expected, rtol=1e-6, atol=1e-7 * length)
            assert np.isclose(length, np.linalg.norm(change), rtol=1e-13) and slope == step[problem.place]
            assert abs(row @ step - direction @ expected) < 1e-6 * length * np.linalg.norm(direction)


@pytest.mark.parametrize("s", [0.0, 1e-12, 1e-6, 0.05])
def test_units_do_not_come_from_a_value_of_the_scene(s):
    """Oracle: the response to the load, 1/(1 + w^2), is the largest length; a load A = 1 + w^2 has the response 1."""
    units = units_of(forced_problem(s=s))
    assert units == pytest.approx([0.2, 0.4, 1.0, 0.0, 0.2, 1.0], rel=1e-14)
