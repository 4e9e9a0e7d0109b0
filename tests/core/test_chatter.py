"""Chatter that is summed to its end, equation (44), in orbits of the core. Oracles: bounces under a constant force in closed form; the
kernels' orbits, steps, multipliers and what they see; differences."""

import math

import numpy as np
import pytest

from bvp.forced import ForcedProblem
from bvp.forced_orbits import core_problem, core_unknowns, unknowns_of_core
from bvp.orbits import RESULT_INDEX
from bvp.parameters import ParametricSystem
from tests.branches.forced_systems import oscillator
from tests.branches.test_forced_sticking import chain
from tests.core.test_forced import SEEN, landing
from transitions.response.path import ParameterPath
from transitions.response.starting import settled_orbit
from transitions.sweep.settle import settle


@pytest.mark.parametrize("restitution", [0.05, 0.4, 0.5, 0.8, 0.93])
def test_a_chatter_under_a_constant_force_has_a_closed_form(restitution):
    """Oracle: bounces under a constant force g last 2 v r/(g (1 - r)) after an impact with the speed v."""
    g, speed, w = 1.3, 0.02, 0.7
    stop = {"c": [1.0], "upper": 0.5, "restitution": "r"}
    table = ParametricSystem.from_description(
        {
            "parameters": {"A": 0.0, "w": w, "r": restitution},
            "system": {"mass": [[2.0]], "damping": [[0.0]], "stiffness": [[0.0]], "stops": [stop]},
            "forces": [{"load": [1.0], "amplitude": "A", "harmonic": 1}, {"load": [1.0], "constant": 2.0 * g}],
        }
    )
    core = core_problem(ForcedProblem(table, ("+=",), ("r",)))
    found = core.starts(np.array([0.3, 0.5, speed, 0.9, 0.5, 0.0, restitution]))
    lasts = 2.0 * speed * restitution / (g * (1.0 - restitution))
    assert found[0] == pytest.approx([0.5, 0.0, 0.3 + lasts * w / (2.0 * math.pi)], abs=1e-14)


TWO_SIDED = ParametricSystem.from_description(
    {
        "parameters": {"A": 1.0, "w": 0.5, "r": 0.4, "s": 0.2},
        "system": {
            "mass": [[1.0]], "damping": [[0.1]], "stiffness": [[1.0]],
            "stops": [{"c": [1.0], "lower": "-s", "upper": "s", "restitution": "r"}],
        },
        "forces": [{"load": [1.0], "amplitude": "A", "harmonic": 1}],
    }
)  # fmt: skip


def half(from_chatter):
    """Half a period of a symmetric orbit, from its first impact or from the chatter on."""
    found = settled_orbit(ParameterPath(TWO_SIDED, ("r",)), settle(TWO_SIDED.system(), TWO_SIDED.forces()))
    problem, y = found.problem, found.y
    assert problem.half and problem.sequence == ("-", "-", "-=", "-:")
    if not from_chatter:
        return problem, y
    other, nodes = ForcedProblem(TWO_SIDED, ("-=", "-:", "+", "+"), ("r",), half=True), problem.nodes(y)
    fractions = np.concatenate([nodes[2:, 2], nodes[:2, 2] + 0.5])
    return other, other.solve(other.pack(np.vstack([nodes[2:, :2], -nodes[:2, :2]]), fractions, [0.4])).y


def settled(n, name):
    parametric = oscillator(damping=0.1, r=0.4, s=0.2, w=0.5) if n == 1 else chain(n, 0.5)
    found = settled_orbit(ParameterPath(parametric, (name,)), settle(parametric.system(), parametric.forces()))
    assert found.problem.contact_modes.sums_chatter
    return found.problem, found.y


@pytest.mark.parametrize(
    "orbit", [lambda: settled(1, "r"), lambda: settled(2, "w"), lambda: settled(2, "d"), lambda: half(False), lambda: half(True)]
)
def test_an_orbit_with_chatter_is_that_of_the_kernels(orbit):
    problem, y = orbit()
    core, at = core_problem(problem), core_unknowns(problem, y)
    assert np.abs(core.residual(at)).max() < 1e-12
    np.testing.assert_allclose(unknowns_of_core(problem, at, core), y, atol=1e-12)

    def slope(function, direction):
        near, far = (function(at + s * 1e-4 * direction) - function(at - s * 1e-4 * direction) for s in (1.0, 2.0))
        return (8.0 * near - far) / 12e-4

    jacobian = core.jacobian(at)
    for j, unit in enumerate(np.eye(len(at))):
        expected = slope(core.residual, unit)
        np.testing.assert_allclose(jacobian[:, j], expected, rtol=1e-6, atol=1e-8 * max(1.0, np.abs(expected).max()))
    a, b = 0.1 * np.random.default_rng(2).normal(size=(2, len(at)))
    second = core.derivative(at, np.array([a, b]))
    np.testing.assert_allclose(second, slope(core.jacobian, a) @ b, rtol=1e-5, atol=1e-6 * np.abs(second).max())
    theirs, (real, imaginary) = problem.multipliers(y), core.multipliers(at)
    np.testing.assert_allclose(np.poly(real + 1j * imaginary), np.poly(theirs), atol=1e-9)
    assert np.count_nonzero(real + 1j * imaginary == 0.0) == np.count_nonzero(theirs == 0.0) == 2
    ours, arrays = problem.solve(y), landing(core, problem)
    assert core.step(at, np.zeros(2 * len(at)), 0.0, 12, True, *arrays)
    for key in SEEN:
        k = RESULT_INDEX[key]
        assert arrays[4][k] == pytest.approx(ours.result[k], rel=1e-7, abs=1e-7), key


@pytest.mark.parametrize(("n", "name"), [(1, "r"), (2, "d")])
def test_steps_along_a_family_are_those_of_the_kernels(n, name):
    """The first node of these orbits is no chatter, so that arclength is the same."""
    problem, y = settled(n, name)
    core, theirs = core_problem(problem), problem.solve(y)
    arrays, u = landing(core, problem), core.unknowns
    assert core.step(core_unknowns(problem, theirs.y), np.zeros(2 * u), 0.0, 12, True, *arrays)
    ours = [np.array(part) for part in arrays]
    ours[1] *= np.sign(ours[1][u - 1] * theirs.tangent[2 * problem.degrees_of_freedom + 1])
    for _ in range(3):
        theirs = problem.step(theirs.y, theirs.tangent, 0.003)
        assert core.step(ours[0], ours[1], 0.003, 12, True, *arrays)
        ours = [np.array(part) for part in arrays]
        np.testing.assert_allclose(unknowns_of_core(problem, ours[0], core), theirs.y, rtol=1e-9, atol=1e-9)
        for key in ("energy", "quarter_period", "slope", "turn"):
            assert ours[4][RESULT_INDEX[key]] == pytest.approx(theirs[key], rel=1e-8, abs=1e-9)
