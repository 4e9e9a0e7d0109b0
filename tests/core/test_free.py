"""Free orbits in released parameters in the core, equation (41).

Oracles: differences of the residual, and a backbone in closed form. The residual itself is compared in tests/bvp/test_released.py.
"""

import numpy as np
import pytest

from bvp.orbits import RESULT_INDEX
from bvp.released import ReleasedProblem
from tests.bvp.test_released import CASES, backbone_at, chain, exact
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
        y[problem.place - 1] = 0.3
    return y


@cases
def test_derivatives_are_differences(problem):
    """Of fourth order: of the residual, of the Jacobian, and of the second derivative."""
    core, y = problem.core, some_unknowns(problem)

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
    core, arrays = problem.core, landing(problem.core, problem)
    at, row = y, np.eye(problem.unknowns)[-1]
    for value in np.linspace(0.1, 0.16, 7):
        assert core.correct(at, row, value, 30, *arrays)
        at = np.array(arrays[0])
        parameters = problem.parameters(at)
        found = arrays[4][RESULT_INDEX["quarter_period"]]
        assert found == pytest.approx(exact(parameters["mu"], parameters["sigma"], h, found), rel=1e-12)
