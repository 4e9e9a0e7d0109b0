"""Orthogonal elimination of block-bidiagonal Jacobians.

Oracle: the same matrix, dense, in numpy: orthogonality of Q, J^T = Q [R; 0], numpy.linalg.lstsq for the least-norm solution, the
singular value decomposition for the null vector, slogdet for the determinant's sign.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bvp.kernels.newton import apply_reflectors, eliminate, forward

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
    """Factor the arrays in place and return (diagonal, factor, reflections)."""
    count = closing.shape[1] - 1
    diagonal, factor = np.zeros(count), np.zeros(count)
    first = 0 if periodic else max(0, flights - 1)
    reflections = eliminate(flights, rows, start, first, window, closing, diagonal, factor)
    return diagonal, factor, reflections


def dense_q(flights, rows, start, window, closing, factor):
    """Q, column by column."""
    unknowns = closing.shape[1]
    q = np.eye(unknowns)
    for j in range(unknowns):
        column = q[:, j].copy()
        apply_reflectors(flights, rows, start, window, closing, factor, column)
        q[:, j] = column
    return q


def dense_r(flights, rows, window, closing, diagonal):
    """R, (u, u - 1): what stands above the pivots in the factored arrays, and the diagonal."""
    unknowns = closing.shape[1]
    r = np.zeros((unknowns, unknowns - 1))
    for j in range(unknowns - 1):
        if j < flights * rows:
            base = max(0, (j // rows - 1) * rows)
            r[base:j, j] = window[j, : j - base]
        else:
            r[:j, j] = closing[j - flights * rows, :j]
        r[j, j] = diagonal[j]
    return r


def least_norm(jacobian, right, flights, rows, start, window, closing, diagonal, factor):
    """The least-norm solution from the factored arrays."""
    solution = np.zeros(jacobian.shape[1])
    solution[:-1] = right
    forward(flights, rows, window, closing, diagonal, solution[:-1])
    apply_reflectors(flights, rows, start, window, closing, factor, solution)
    return solution


@settings(max_examples=25)
@given(st.integers(0, 6), st.integers(1, 5), st.booleans(), st.integers(0, 2**32 - 1))
def test_factors_and_solutions_of_random_patterns(flights, half, periodic, seed):
    rng = np.random.default_rng(seed)
    rows, start, window, closing, jacobian = random_problem(rng, flights, half, periodic)
    diagonal, factor, reflections = eliminated(flights, periodic, rows, start, window, closing)
    unknowns = closing.shape[1]
    size = np.linalg.norm(jacobian)
    q = dense_q(flights, rows, start, window, closing, factor)
    r = dense_r(flights, rows, window, closing, diagonal)
    assert np.max(np.abs(q.T @ q - np.eye(unknowns))) < 50 * unknowns * EPS
    assert np.max(np.abs(q @ r - jacobian.T)) < 50 * unknowns * EPS * size
    null = q[:, -1]
    assert np.max(np.abs(jacobian @ null)) < 50 * unknowns * EPS * size
    sign, _ = np.linalg.slogdet(np.vstack([jacobian, null]))
    assert sign == (-1.0) ** reflections * np.prod(np.sign(diagonal))
    right = rng.normal(size=unknowns - 1)
    expected = np.linalg.lstsq(jacobian, right, rcond=None)[0]
    solution = least_norm(jacobian, right, flights, rows, start, window, closing, diagonal, factor)
    assert np.linalg.norm(solution - expected) < 100 * unknowns * EPS * np.linalg.cond(jacobian) * np.linalg.norm(expected)


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("growth", [None, 50.0])
def test_two_hundred_flights(periodic, growth):
    """Oracle: the Jacobian itself: residuals of solution and null vector stay at rounding, without pivots, however the flights grow."""
    rng = np.random.default_rng(5)
    rows, start, window, closing, jacobian = random_problem(rng, 200, 2, periodic, growth)
    assert np.linalg.cond(jacobian) < 1e6
    diagonal, factor, _ = eliminated(200, periodic, rows, start, window, closing)
    right = rng.normal(size=jacobian.shape[0])
    solution = least_norm(jacobian, right, 200, rows, start, window, closing, diagonal, factor)
    assert np.max(np.abs(jacobian @ solution - right)) < 1e-13 * np.max(np.abs(jacobian) @ np.abs(solution) + np.abs(right))
    null = np.eye(1, len(solution), len(solution) - 1)[0]
    apply_reflectors(200, rows, start, window, closing, factor, null)
    assert abs(np.linalg.norm(null) - 1.0) < 1e-13
    assert np.max(np.abs(jacobian @ null)) < 1e-13 * np.linalg.norm(jacobian, np.inf)


def test_a_rank_deficient_jacobian_shows_on_the_diagonal():
    rng = np.random.default_rng(3)
    rows, start, window, closing, jacobian = random_problem(rng, 2, 2, False)
    window[7] = window[6]
    diagonal, _, _ = eliminated(2, False, rows, start, window, closing)
    assert np.min(np.abs(diagonal)) < 1e-14 * np.linalg.norm(jacobian)
