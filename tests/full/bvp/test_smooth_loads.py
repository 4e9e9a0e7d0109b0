"""Long cases of tests/bvp/test_smooth_loads.py."""

from __future__ import annotations

import math

import numpy as np

from bvp.forced import ForcedProblem
from bvp.parameters import ParametricSystem
from tests.bvp.test_multipliers import nearest
from tests.bvp.test_smooth_loads import PAIR, shot


def test_two_coordinates_with_a_nonlinear_damper():
    """Oracle: another integrator with Newton's method of its own."""
    problem = ForcedProblem(ParametricSystem.from_description(PAIR), (), ["w"])
    period = 2.0 * math.pi / 1.1
    rough = np.zeros(4)
    for _ in range(20):
        rough, _ = problem.fly(np.array([*rough, 0.0, 1.1]), period)
    y = problem.solve(problem.pack([rough], [0.0], [1.1])).y
    state, matrix = shot(PAIR, {}, problem.nodes(y)[0, :4] + 1e-3, period)
    assert np.abs(problem.nodes(y)[0, :4] - state).max() < 1e-11
    expected = np.linalg.eigvals(matrix)
    assert nearest(problem.multipliers(y), expected) < 1e-8
