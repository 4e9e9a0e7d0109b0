"""Free orbits in released parameters in the core, equation (41).

Oracles: the kernels' equations, which contain those of the core, and their steps; differences of the residual; a backbone in closed form.
"""

import numpy as np
import pytest

from bvp.forced_orbits import core_problem, core_unknowns, unknowns_of_core
from bvp.orbits import RESULT_INDEX
from bvp.released import ReleasedProblem
from tests.bvp.test_released import CASES, backbone_at, chain, exact, released
from tests.bvp.test_smooth_released import OSCILLATOR, STOPPED, WALL
from tests.core.test_forced import landing

CLOSED = {name: ReleasedProblem(chain(), *arguments[:4]) for name, arguments in CASES.items()} | {
    "smooth oscillator": ReleasedProblem(OSCILLATOR, ("origin", "rest"), (), ["a", "m"], ["energy = 0.8", "m = 1 + a/9"]),
    "smooth wall": ReleasedProblem(WALL, ("origin", "rest"), (), ["b"], ["energy = 0.8*b"], pieces=2),
    "smooth closed": ReleasedProblem(WALL, ("periodic", "periodic"), (), ["sigma"], ["quarter_period = 1.3 + energy"], pieces=3),
    "smooth impacts": ReleasedProblem(STOPPED, ("periodic", "periodic"), ("+", "-"), ["mu", "sigma"], ["energy = 0.9", "mu = sigma"]),
}
cases = pytest.mark.parametrize("problem", CLOSED.values(), ids=CLOSED)


def some_unknowns(problem, seed=1):
    """Unknowns that fulfil no equation."""
    rng, rows = np.random.default_rng(seed), problem.inner + 1
    start = [problem.values[name] * 1.07 for name in problem.released]
    y = problem.pack(rng.normal(size=(rows, 2 * problem.degrees_of_freedom)), np.zeros(rows), start, rng.uniform(0.4, 1.5, rows))
    if problem.periodic:
        y[-1] = 0.3
    return y


def core_rows(problem):
    """Which equations of the kernels those of the core are: without those of the clock and of copies of parameters."""
    size, width = 2 * problem.degrees_of_freedom, problem.size
    rows = [i * (width + 1) + r for i in range(problem.inner) for r in [*range(size), width]]
    first, last = problem.inner * (width + 1), len(problem.keep) + problem.periodic
    return np.array([*rows, *range(first, first + size), *range(first + size + 1, first + size + 1 + last)])


@cases
def test_the_residual_is_that_of_the_kernels(problem):
    core, y = core_problem(problem), some_unknowns(problem)
    ours, theirs = core.residual(core_unknowns(problem, y)), problem.residual(y)[core_rows(problem)]
    assert np.isfinite(theirs).all()
    size = 2 * problem.degrees_of_freedom
    if problem.is_smooth and not problem.sequence:  # flights of equal time
        cuts = slice(size, problem.inner * (size + 1), size + 1)
        ours[cuts] *= -1.0
    np.testing.assert_allclose(ours, theirs, rtol=1e-11, atol=1e-11)
    assert np.array_equal(unknowns_of_core(problem, core_unknowns(problem, y)), y)


@cases
def test_derivatives_are_differences(problem):
    """Of fourth order: of the residual, of the Jacobian, and of the second derivative."""
    core, y = core_problem(problem), core_unknowns(problem, some_unknowns(problem))

    def slope(function, direction):
        near, far = (function(y + s * 1e-3 * direction) - function(y - s * 1e-3 * direction) for s in (1.0, 2.0))
        return (8.0 * near - far) / 12e-3

    jacobian = core.jacobian(y)
    for j, unit in enumerate(np.eye(len(y))):
        expected = slope(core.residual, unit)
        np.testing.assert_allclose(jacobian[:, j], expected, rtol=1e-8, atol=1e-9 * max(1.0, np.abs(expected).max()))
    a, b, c = 0.1 * np.random.default_rng(2).normal(size=(3, len(y)))
    second, third = core.derivative(y, np.array([a, b])), core.derivative(y, np.array([a, b, c]))
    np.testing.assert_allclose(second, slope(core.jacobian, a) @ b, rtol=1e-7, atol=1e-8 * np.abs(second).max())
    expected = slope(lambda at: core.derivative(at, np.array([a, b])), c)
    np.testing.assert_allclose(third, expected, rtol=1e-7, atol=1e-8 * np.abs(third).max())


@pytest.mark.parametrize("name", ["mu", "sigma"])
def test_backbone_at_a_fixed_energy(name):
    """Oracle: the quarter period of the closed form at every value, to 1e-12."""
    problem, y, h, _ = backbone_at("energy = {h!r}", (name,))
    core, arrays = core_problem(problem), landing(core_problem(problem), problem)
    at, row = core_unknowns(problem, y), np.eye(core_problem(problem).unknowns)[-1]
    for value in np.linspace(0.1, 0.16, 7):
        assert core.correct(at, row, value, 30, *arrays)
        at = np.array(arrays[0])
        parameters = problem.parameters(unknowns_of_core(problem, at))
        found = arrays[4][RESULT_INDEX["quarter_period"]]
        assert found == pytest.approx(exact(parameters["mu"], parameters["sigma"], h, found), rel=1e-12)


@pytest.mark.parametrize("names", [("m",), ("k", "d")])
def test_steps_along_a_family_are_those_of_the_kernels(names):
    start, keep = [0.0, 0.0, 0.0, 1.1, 0.8, 0.5], ["energy = {h!r}", "d = 1 + 0.2*k"][: len(names)]
    problem, y, *_ = released(chain(d=1.14), ("origin", "stop+"), (), names, keep, start, [1.4])
    core, theirs = core_problem(problem), problem.solve(y)
    arrays, u = landing(core, problem), core.unknowns
    assert core.step(core_unknowns(problem, theirs.y), np.zeros(2 * u), 0.0, 12, True, *arrays)
    ours = [np.array(part) for part in arrays]
    ours[1] *= np.sign(ours[1][u - len(names)] * theirs.tangent[2 * problem.degrees_of_freedom + 1])
    for _ in range(8):
        theirs = problem.step(theirs.y, theirs.tangent, 0.05)
        assert core.step(ours[0], ours[1], 0.05, 12, True, *arrays)
        ours = [np.array(part) for part in arrays]
        np.testing.assert_allclose(unknowns_of_core(problem, ours[0]), theirs.y, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(ours[2], theirs.position, rtol=1e-9, atol=1e-9)
        for name in ("energy", "quarter_period", "slope", "turn"):
            assert ours[4][RESULT_INDEX[name]] == pytest.approx(theirs[name], rel=1e-8, abs=1e-9)
