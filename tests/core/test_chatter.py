"""Chatter that is summed to its end, equation (44), in orbits of the core. Oracles: bounces under a constant force in closed form;
differences."""

import math

import numpy as np
import pytest

from bvp.forced import ForcedProblem
from bvp.parameters import ParametricSystem
from tests.branches.forced_systems import oscillator
from tests.branches.test_forced_sticking import chain
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
    core = ForcedProblem(table, ("+=",), ("r",)).core
    found, _, _ = core.flights(np.array([0.3, 0.5, speed, 0.9, 0.5, 0.0, restitution]))
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
def test_derivatives_of_an_orbit_with_chatter_are_differences(orbit):
    problem, y = orbit()
    assert np.abs(problem.residual(y)).max() < 1e-12 and problem.curvature.is_exact
    nodes = problem.nodes(y)
    again = problem.pack(nodes[:, : problem.size], nodes[:, problem.size], problem.released_values(y), problem.flight_times(y))
    np.testing.assert_allclose(again, y, atol=1e-12)

    def slope(function, direction):
        near, far = (function(y + s * 1e-4 * direction) - function(y - s * 1e-4 * direction) for s in (1.0, 2.0))
        return (8.0 * near - far) / 12e-4

    jacobian = problem.jacobian(y)
    for j, unit in enumerate(np.eye(len(y))):
        expected = slope(problem.residual, unit)
        np.testing.assert_allclose(jacobian[:, j], expected, rtol=1e-6, atol=1e-8 * max(1.0, np.abs(expected).max()))
    a, b = 0.1 * np.random.default_rng(2).normal(size=(2, len(y)))
    second = problem.core.derivative(y, np.array([a, b]))
    np.testing.assert_allclose(second, slope(problem.jacobian, a) @ b, rtol=1e-5, atol=1e-6 * np.abs(second).max())
    np.testing.assert_allclose(problem.curvature.second_along(y, a) @ b, second, rtol=1e-9, atol=1e-9 * np.abs(second).max())
    assert np.count_nonzero(problem.multipliers(y) == 0.0) == 2
