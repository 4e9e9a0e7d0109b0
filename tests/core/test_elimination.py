"""Orthogonal elimination of block-bidiagonal Jacobians in the core.

Oracle: the same matrix, dense, in numpy: numpy.linalg.lstsq for the least-norm solution, the singular value decomposition for the
conditioning, slogdet for the determinant's sign, the matrix itself for the null vector.
"""

import numpy as np
import pytest
import saltus_core
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.bvp.test_elimination import EPS, random_problem


def eliminated(flights, rows, start, jacobian, periodic):
    """The factorised elimination, and its pivots."""
    closers = len(jacobian) - flights * rows
    elimination = saltus_core.BlockElimination(flights, rows, start, closers, periodic)
    return elimination, elimination.factorise(np.ascontiguousarray(jacobian), np.zeros(closers))


@settings(max_examples=25)
@given(st.integers(0, 6), st.integers(1, 5), st.booleans(), st.integers(0, 2**32 - 1))
def test_solutions_of_random_patterns(flights, half, periodic, seed):
    rng = np.random.default_rng(seed)
    rows, start, _, _, jacobian = random_problem(rng, flights, half, periodic)
    elimination, (sign, smallest) = eliminated(flights, rows, start, jacobian, periodic)
    unknowns, size = jacobian.shape[1], np.linalg.norm(jacobian)
    null = elimination.null_vector()
    assert abs(np.linalg.norm(null) - 1.0) < 50 * unknowns * EPS
    assert np.max(np.abs(jacobian @ null)) < 50 * unknowns * EPS * size
    assert sign == np.linalg.slogdet(np.vstack([jacobian, null]))[0]
    assert 0.0 < smallest <= 1.0 + 1e-14
    right = rng.normal(size=unknowns - 1)
    expected = np.linalg.lstsq(jacobian, right, rcond=None)[0]
    assert np.linalg.norm(elimination.solve(right) - expected) < 100 * unknowns * EPS * np.linalg.cond(jacobian) * np.linalg.norm(expected)
    scaled = jacobian / np.linalg.norm(jacobian, axis=1)[:, None]
    least = np.linalg.svd(scaled, compute_uv=False)[-1]
    assert least / (1.0 + 1e-9) <= elimination.conditioning() * np.sqrt(unknowns)


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("growth", [None, 50.0])
def test_two_hundred_flights(periodic, growth):
    """Oracle: the Jacobian itself: residuals of solution and null vector stay at rounding, without pivots, however the flights grow."""
    rng = np.random.default_rng(5)
    rows, start, _, _, jacobian = random_problem(rng, 200, 2, periodic, growth)
    elimination, _ = eliminated(200, rows, start, jacobian, periodic)
    right = rng.normal(size=jacobian.shape[0])
    solution = elimination.solve(right)
    assert np.max(np.abs(jacobian @ solution - right)) < 1e-13 * np.max(np.abs(jacobian) @ np.abs(solution) + np.abs(right))
    null = elimination.null_vector()
    assert abs(np.linalg.norm(null) - 1.0) < 1e-13
    assert np.max(np.abs(jacobian @ null)) < 1e-13 * np.linalg.norm(jacobian, np.inf)


def test_a_rank_deficient_jacobian_has_no_pivot():
    rows, start, _, _, jacobian = random_problem(np.random.default_rng(3), 2, 2, False)
    jacobian[7] = jacobian[6]
    assert eliminated(2, rows, start, jacobian, False)[1][1] < 1e-14
    assert eliminated(2, rows, start, jacobian, False)[0].conditioning() < 1e-13
