"""Orthogonal elimination of block-bidiagonal Jacobians in the core.

Oracle: the same matrix, dense, in numpy: numpy.linalg.lstsq for the least-norm solution, the singular value decomposition for the
conditioning, slogdet for the determinant's sign, the matrix itself for the null vector.
"""

import numpy as np
import pytest
import saltus_core
from hypothesis import given, settings
from hypothesis import strategies as st

EPS = np.finfo(float).eps


def random_problem(rng, flights, half, periodic, growth=None):
    """Rows of a flight, size of the first block, and a random Jacobian with the pattern of a multipoint problem.

    growth: each flight magnifies half of the directions by it and shrinks the others, as unstable orbits do.
    """
    rows = 2 * half + 1
    start = 2 * half + 1 if periodic else half + 1
    closers = 2 * half + 1 if periodic else half
    unknowns = start + flights * rows + int(periodic)
    assert unknowns == flights * rows + closers + 1
    jacobian = np.zeros((unknowns - 1, unknowns))
    edges = [0] + [start + i * rows for i in range(flights + 1)]
    frame = np.linalg.qr(rng.normal(size=(2 * half, 2 * half)))[0]
    for i in range(flights):
        block = jacobian[i * rows : (i + 1) * rows, edges[i] : edges[i + 2]]
        block[:] = rng.normal(size=block.shape)
        if growth is not None:
            width = edges[i + 1] - edges[i]
            flow = frame @ np.diag([growth] * half + [1.0 / growth] * half) @ frame.T
            block[:-1, : width - 1] = flow if i > 0 or periodic else flow @ frame @ rng.normal(size=(2 * half, half))
            block[:-1, width:-1] = -np.eye(2 * half)
            block[:, width - 1] *= 0.1
            block[-1, :width] = 0.0
    first = flights * rows
    jacobian[first:, edges[flights] : edges[flights + 1]] = rng.normal(size=(closers, edges[flights + 1] - edges[flights]))
    if periodic:
        jacobian[first:, :start] += rng.normal(size=(closers, start))
        jacobian[first:, -1] = rng.normal(size=closers)
    return rows, start, jacobian


def eliminated(flights, rows, start, jacobian, periodic):
    """The factorised elimination, and its pivots."""
    closers = len(jacobian) - flights * rows
    elimination = saltus_core.BlockElimination(flights, rows, start, closers, periodic)
    return elimination, elimination.factorise(np.ascontiguousarray(jacobian), np.zeros(closers))


@settings(max_examples=25)
@given(st.integers(0, 6), st.integers(1, 5), st.booleans(), st.integers(0, 2**32 - 1))
def test_solutions_of_random_patterns(flights, half, periodic, seed):
    rng = np.random.default_rng(seed)
    rows, start, jacobian = random_problem(rng, flights, half, periodic)
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
    rows, start, jacobian = random_problem(rng, 200, 2, periodic, growth)
    elimination, _ = eliminated(200, rows, start, jacobian, periodic)
    right = rng.normal(size=jacobian.shape[0])
    solution = elimination.solve(right)
    assert np.max(np.abs(jacobian @ solution - right)) < 1e-13 * np.max(np.abs(jacobian) @ np.abs(solution) + np.abs(right))
    null = elimination.null_vector()
    assert abs(np.linalg.norm(null) - 1.0) < 1e-13
    assert np.max(np.abs(jacobian @ null)) < 1e-13 * np.linalg.norm(jacobian, np.inf)


def test_a_rank_deficient_jacobian_has_no_pivot():
    rows, start, jacobian = random_problem(np.random.default_rng(3), 2, 2, False)
    jacobian[7] = jacobian[6]
    assert eliminated(2, rows, start, jacobian, False)[1][1] < 1e-14
    assert eliminated(2, rows, start, jacobian, False)[0].conditioning() < 1e-13
