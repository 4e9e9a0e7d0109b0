"""The test functions of a family of two degrees of freedom, from made-up result entries.

Oracles: the return map of a reversible orbit as a product of matrices, R phi^-1 R phi with R = diag(1, -1), and its square where a quarter
is solved; logarithms by hand. All functions are weighted with the impacts' speeds.
"""

import math

import numpy as np
import pytest

from branches.family import RESONANCES, multiplication
from branches.kernels.functions import COMMON, TANGENT_NOISE, common_tests, two_dof_tests
from bvp.kernels.multipoint import (
    BRANCHING,
    ENERGY,
    HALF_A,
    HALF_B,
    HALF_C,
    HALF_D,
    ORIGIN,
    QUARTER_PERIOD,
    REST,
    RESULT,
    SPEEDS,
    STOP,
)  # fmt: skip

TARGETS = [multiplication(p, q) for p, q in RESONANCES]
HALF_TARGETS = [sign * math.cos(math.pi * p / q) for p, q in RESONANCES for sign in (2.0, -2.0)]
SPEED = 0.3


@pytest.mark.parametrize("seed", range(6))
def test_traces_are_those_of_the_return_map(seed):
    rng = np.random.default_rng(seed)
    a, b, c = rng.normal(size=3)
    phi = np.array([[a, b], [c, (1.0 + b * c) / a]])
    result = np.zeros(len(RESULT))
    result[[HALF_A, HALF_B, HALF_C, HALF_D]] = phi.ravel()
    result[SPEEDS] = SPEED
    result[BRANCHING] = 0.1
    reversal = np.diag([1.0, -1.0])
    closed = reversal @ np.linalg.inv(phi) @ reversal @ phi
    half, quarter = np.zeros(14 + len(TARGETS)), np.zeros(15 + len(HALF_TARGETS))
    two_dof_tests(result, (0, 0, 2, ORIGIN, REST, 0), TARGETS, half)
    two_dof_tests(result, (0, 0, 1, ORIGIN, STOP, 0), HALF_TARGETS, quarter)
    half[11:14] /= SPEED
    half[14:] /= SPEED**2
    quarter[11:14] /= SPEED
    quarter[14:] /= SPEED**2
    np.testing.assert_allclose(half[11:14], phi[[0, 0, 1], [1, 0, 1]], rtol=1e-12)
    np.testing.assert_allclose(half[14:], np.trace(closed) - TARGETS, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(quarter[14], np.trace(closed), rtol=1e-12)
    pairs = np.reshape(quarter[15:], (-1, 2))  # tau - level = (tau_half - l)(tau_half + l), where l^2 = level + 2
    np.testing.assert_allclose(pairs.prod(axis=1), np.trace(closed @ closed) - TARGETS, rtol=1e-12, atol=1e-12)


def test_bounds_are_left_where_they_are_passed():
    """The guards of the bounds are positive inside and vanish at them; without a bound they stay positive."""
    for h, alpha, signs in ((1.0, 3.0, (1, 1, 1)), (0.1, 3.0, (-1, 1, 1)), (9.0, 3.0, (1, -1, 1)), (1.0, 6.0, (1, 1, -1))):
        result = np.zeros(len(RESULT))
        result[[ENERGY, QUARTER_PERIOD]] = h, alpha
        out = np.zeros(COMMON)
        common_tests(result, math.log(0.2), math.log(8.0), math.log(5.0), TANGENT_NOISE, out)
        np.testing.assert_allclose(out[5:8], [math.log(h / 0.2), math.log(8.0 / h), math.log(5.0 / alpha)], rtol=0, atol=1e-14)
        assert tuple(np.sign(out[5:8])) == signs
        common_tests(result, -math.inf, math.inf, math.inf, TANGENT_NOISE, out)
        assert (out[5:8] > 0.0).all()
