"""The test functions of a family of two degrees of freedom, from made-up result entries.

Oracles: the return map of a reversible orbit as a product of matrices, R phi^-1 R phi with R = diag(1, -1), and its square where a quarter
is solved; logarithms by hand. All functions are weighted with the impacts' speeds.
"""

import math

import numpy as np
import pytest

from branches.family import RESONANCES, multiplication
from tests.lab.functions import distances_from_bounds, half_map_tests

TARGETS = [multiplication(p, q) for p, q in RESONANCES]
HALF_TARGETS = [sign * math.cos(math.pi * p / q) for p, q in RESONANCES for sign in (2.0, -2.0)]
SPEED = 0.3


@pytest.mark.parametrize("seed", range(6))
def test_traces_are_those_of_the_return_map(seed):
    rng = np.random.default_rng(seed)
    a, b, c = rng.normal(size=3)
    phi = np.array([[a, b], [c, (1.0 + b * c) / a]])
    reversal = np.diag([1.0, -1.0])
    closed = reversal @ np.linalg.inv(phi) @ reversal @ phi
    half = half_map_tests(phi, SPEED, ("origin", "rest"), 2, TARGETS)
    quarter = half_map_tests(phi, SPEED, ("origin", "stop"), 1, HALF_TARGETS)
    for found in (half, quarter):
        found[:3] /= SPEED
        found[3:] /= SPEED**2
    np.testing.assert_allclose(half[:3], phi[[0, 0, 1], [1, 0, 1]], rtol=1e-12)
    np.testing.assert_allclose(half[3:], np.trace(closed) - TARGETS, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(quarter[3], np.trace(closed), rtol=1e-12)
    pairs = np.reshape(quarter[4:], (-1, 2))  # tau - level = (tau_half - l)(tau_half + l), where l^2 = level + 2
    np.testing.assert_allclose(pairs.prod(axis=1), np.trace(closed @ closed) - TARGETS, rtol=1e-12, atol=1e-12)


def test_bounds_are_left_where_they_are_passed():
    """The guards of the bounds are positive inside and vanish at them; without a bound they stay positive."""
    for h, alpha, signs in ((1.0, 3.0, (1, 1, 1)), (0.1, 3.0, (-1, 1, 1)), (9.0, 3.0, (1, -1, 1)), (1.0, 6.0, (1, 1, -1))):
        found = distances_from_bounds(h, alpha, energy=(0.2, 8.0), longest=5.0)
        np.testing.assert_allclose(found, [math.log(h / 0.2), math.log(8.0 / h), math.log(5.0 / alpha)], rtol=0, atol=1e-14)
        assert tuple(np.sign(found)) == signs
        assert (distances_from_bounds(h, alpha) > 0.0).all()
