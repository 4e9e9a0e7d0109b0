"""The multipoint problem of the core: derivatives by jets, code for a known size against code for any, threads, sizes from Python.

Residual and Jacobian are tested against complex steps in `tests/bvp/test_multipoint.py`.
"""

import math
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
import pytest
import saltus_core

from bvp.closures import cycle_of
from bvp.multipoint import RESULT_INDEX, MultipointProblem
from bvp.orbits import Orbits
from bvp.stability import chain_half_map
from bvp.system import ImpactSystem, Stop
from tests.bvp.orbits import chains, collection


def orbits(most=8):
    """Orbits of every closure, with two degrees of freedom and with more; and the closure of one."""
    seen, found = set(), []
    for orbit in [*collection(), *chains()]:
        kind = (orbit.problem.kinds, min(orbit.problem.inner, 2), orbit.problem.half)
        if kind not in seen and orbit.problem.inner < most:
            seen.add(kind)
            found.append((orbit.problem, orbit.solution.y))
    for problem, y in found[:2]:
        cycle = cycle_of(problem, y)
        closed = MultipointProblem(problem.system, ("periodic", "periodic"), cycle.letters)
        found.append((closed, closed.pack(cycle.after[0], cycle.after[1:], cycle.duration)))
    return found


def slope(function, y, direction):
    """The derivative along a direction by differences of fourth order."""
    h = 1e-3
    near, far = (function(y + s * h * direction) - function(y - s * h * direction) for s in (1.0, 2.0))
    return (8.0 * near - far) / (12.0 * h)


def test_second_and_third_derivatives_against_differences():
    """Oracle: differences of the Jacobian, and of the second derivative, in directions of the unknowns' sizes."""
    rng = np.random.default_rng(1)
    for problem, y in orbits():
        core, scale = problem.orbits.core, problem.scales(y)
        a, b, c = 0.1 * rng.normal(size=(3, len(y))) * scale
        second, third = core.derivative(y, np.array([a, b])), core.derivative(y, np.array([a, b, c]))
        expected = slope(problem.jacobian, y, a) @ b
        size = np.max(np.abs(second))
        assert np.max(np.abs(second - expected)) < 1e-8 * size
        np.testing.assert_allclose(core.derivative(y, np.array([b, a])), second, rtol=1e-12, atol=1e-13 * size)
        expected = slope(partial(core.derivative, directions=np.array([a, b])), y, c)
        assert np.max(np.abs(third - expected)) < 1e-8 * np.max(np.abs(third))


def test_what_is_compiled_for_a_number_of_states_is_what_is_compiled_for_any():
    """Oracle: the same equations without a known size: the same orbits, tangents and observations to rounding."""
    compared = 0
    for problem, y in orbits():
        if problem.half > 2:
            continue
        plain = MultipointProblem(problem.system, problem.ends, problem.sequence)
        plain._two_dof = False
        known = problem.solve(y)
        for ds in (0.0, 0.01):
            one, other = (each.step(known.y, known.tangent, ds) for each in (problem, plain))
            assert (one is None) == (other is None)
            if one is None:
                continue
            for name in ("y", "tangent", "position", "ends"):
                np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-11, atol=1e-11)
            rounding = "contraction", "residual", "iterations"
            seen = [k for name, k in RESULT_INDEX.items() if k < RESULT_INDEX["a"] and name not in rounding]
            np.testing.assert_allclose(one.result[seen], other.result[seen], rtol=1e-9, atol=1e-10)
            compared += 1
    assert compared >= 16


def test_threads_share_a_problem():
    """Oracle: the same steps one after the other, to the last bit."""
    problem, y = max(orbits(), key=lambda pair: pair[0].inner)
    known = problem.solve(y)
    lengths = np.linspace(-0.02, 0.02, 64).tolist()

    def step(ds):
        return problem.step(known.y, known.tangent, ds)

    alone = [step(ds) for ds in lengths]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(step, lengths))
    for one, other in zip(alone, together, strict=True):
        assert (one is None) == (other is None)
        if one is not None:
            np.testing.assert_array_equal(one.y, other.y)
            np.testing.assert_array_equal(one.result, other.result)


def test_test_functions_of_free_masses():
    """Oracle: the entries of the half map times the product of the speeds. Without a frequency the unit of time is the quarter period: ends
    of different kinds made the noise of the entries infinite. The last one, which is 0, has no sign."""
    stops = (Stop((1.0, -1.0), -1.0, 1.0), Stop((1.0, 0.0), -1.0, 1.0))
    system = ImpactSystem(np.diag([1.0, 2.0]), np.zeros((2, 2)), np.zeros((2, 2)), stops)
    problem, z = MultipointProblem(system, ("origin", "stopa-"), ("b+",)), system.modes.from_state
    for speed in (1.0, 1e3):
        start, node = (z @ np.array(state) for state in ([0.0, 0.0, speed, 0.5 * speed], [1.0, 0.5, -speed, 0.5 * speed]))
        found = problem.solve(problem.pack(start, [node], [1.0 / speed, 1.0 / speed]))
        count = 11 + 3 + (problem.quarters == 1)
        family = saltus_core.OrbitFamily(problem.orbits.core, [], [], -math.inf, math.inf, math.inf, 2e-13, [], count, 12)
        tests = np.empty(count)
        family.values(found.y, found.ends, found.result, tests)
        assert np.array_equal(tests[11:13], [found["speeds"] * found["b"], found["speeds"] * found["a"]])
        assert abs(tests[11]) > 0.1 and math.isnan(tests[13])
        phi = chain_half_map(problem, found)[0]
        np.testing.assert_allclose([found["a"], found["b"]], phi[0], rtol=1e-12)


def test_wrong_sizes_are_refused():
    problem, y = orbits()[0]
    core = problem.orbits.core
    with pytest.raises(ValueError, match=f"received {len(y) + 1} entries of unknowns; expected {len(y)}"):
        core.residual(np.zeros(len(y) + 1))
    with pytest.raises(ValueError, match="entries of a tangent"):
        problem.step(y, np.zeros(len(y)), 0.1)
    with pytest.raises(ValueError, match="a second derivative has two directions"):
        core.derivative(y, np.zeros((1, len(y))))
    problem.contacts[-1] = 99
    try:
        with pytest.raises(ValueError, match="a contact that the system does not have"):
            Orbits(problem)
    finally:
        problem.contacts[-1] = -1
    assert math.isfinite(problem.residual(y)[0])
