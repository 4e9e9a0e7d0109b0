"""Orthogonal elimination of block-bidiagonal Jacobians.

Oracle: the same matrix, dense, in numpy: orthogonality of Q, J^T = Q [R; 0], numpy.linalg.lstsq for the least-norm solution, the
singular value decomposition for the null vector, slogdet for the determinant's sign.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.lab.matrices import Elimination

EPS = np.finfo(float).eps


def random_problem(rng, flights, half, periodic, growth=None):
    """Factor arrays of a random Jacobian with the pattern of a multipoint problem, and that Jacobian dense.

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
    window = np.zeros((flights * rows, start + 2 * rows))
    for j in range(flights * rows):
        base = max(0, (j // rows - 1) * rows)
        width = min(window.shape[1], unknowns - base)
        window[j, :width] = jacobian[j, base : base + width]
    return rows, start, window, jacobian[first:].copy(), jacobian


def eliminated(flights, periodic, rows, start, window, closing):
    """The factored Jacobian."""
    return Elimination(flights, rows, start, window, closing, 0 if periodic else max(0, flights - 1))


@settings(max_examples=25)
@given(st.integers(0, 6), st.integers(1, 5), st.booleans(), st.integers(0, 2**32 - 1))
def test_factors_and_solutions_of_random_patterns(flights, half, periodic, seed):
    rng = np.random.default_rng(seed)
    rows, start, window, closing, jacobian = random_problem(rng, flights, half, periodic)
    factors = eliminated(flights, periodic, rows, start, window, closing)
    unknowns = closing.shape[1]
    size = np.linalg.norm(jacobian)
    q, r = factors.q, factors.r
    assert np.max(np.abs(q.T @ q - np.eye(unknowns))) < 50 * unknowns * EPS
    assert np.max(np.abs(q @ r - jacobian.T)) < 50 * unknowns * EPS * size
    null = q[:, -1]
    assert np.max(np.abs(jacobian @ null)) < 50 * unknowns * EPS * size
    sign, _ = np.linalg.slogdet(np.vstack([jacobian, null]))
    assert sign == (-1.0) ** factors.reflections * np.prod(np.sign(factors.diagonal))
    right = rng.normal(size=unknowns - 1)
    expected = np.linalg.lstsq(jacobian, right, rcond=None)[0]
    solution = factors.least_norm(right)
    assert np.linalg.norm(solution - expected) < 100 * unknowns * EPS * np.linalg.cond(jacobian) * np.linalg.norm(expected)


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("growth", [None, 50.0])
def test_two_hundred_flights(periodic, growth):
    """Oracle: the Jacobian itself: residuals of solution and null vector stay at rounding, without pivots, however the flights grow."""
    rng = np.random.default_rng(5)
    rows, start, window, closing, jacobian = random_problem(rng, 200, 2, periodic, growth)
    assert np.linalg.cond(jacobian) < 1e6
    factors = eliminated(200, periodic, rows, start, window, closing)
    right = rng.normal(size=jacobian.shape[0])
    solution = factors.least_norm(right)
    assert np.max(np.abs(jacobian @ solution - right)) < 1e-13 * np.max(np.abs(jacobian) @ np.abs(solution) + np.abs(right))
    null = factors.times_q(np.eye(1, len(solution), len(solution) - 1)[0])
    assert abs(np.linalg.norm(null) - 1.0) < 1e-13
    assert np.max(np.abs(jacobian @ null)) < 1e-13 * np.linalg.norm(jacobian, np.inf)


def test_a_rank_deficient_jacobian_shows_on_the_diagonal():
    rng = np.random.default_rng(3)
    rows, start, window, closing, jacobian = random_problem(rng, 2, 2, False)
    window[7] = window[6]
    factors = eliminated(2, False, rows, start, window, closing)
    assert np.min(np.abs(factors.diagonal)) < 1e-14 * np.linalg.norm(jacobian)
