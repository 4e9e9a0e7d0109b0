"""Products, solutions and Schur forms of small dense matrices.

Oracles: sums in the order of the columns, numpy, the definition of each form, matrices with known rates.
"""

import math

import numpy as np
import pytest
import saltus_core as core

from bvp.dense import cholesky, length, orthonormal, product, quadratic, roots, singular, solve

EPSILON = np.finfo(float).eps


def matrices(size):
    """Random ones, graded ones, those of damped chains, and with repeated rates."""
    random = np.random.default_rng(size)
    yield random.normal(size=(size, size))
    yield random.normal(size=(size, size)) * 10.0 ** random.uniform(-4, 4, size=(size, 1))
    yield np.triu(random.normal(size=(size, size)))
    yield np.eye(size, k=1) - np.eye(size, k=-1)
    yield 0.5 * np.eye(size) + np.eye(size, k=1)
    yield np.zeros((size, size))
    yield np.diag(np.arange(size) // 2.0) + 1e-312 * random.normal(size=(size, size))  # of numbers with few digits
    yield 1e-200 * random.normal(size=(size, size))


def require_schur_form(matrix, t, q):
    size = len(matrix)
    scale = max(np.abs(matrix).max(), 1e-305) * size
    assert np.abs(q.T @ q - np.eye(size)).max() < 40 * size * EPSILON
    assert np.abs(q @ t @ q.T - matrix).max() < 40 * size * EPSILON * scale
    assert not np.tril(t, -2).any()
    pairs = np.flatnonzero(np.diagonal(t, -1))
    assert not np.any(np.diff(pairs) == 1)
    for k in pairs:
        assert t[k, k] == t[k + 1, k + 1] and np.sign(t[k, k + 1]) == -np.sign(t[k + 1, k])


@pytest.mark.parametrize("size", range(1, 13))
def test_schur_forms(size):
    for matrix in matrices(size):
        require_schur_form(matrix, *core.schur(matrix))


def test_the_form_of_a_pair_is_that_of_its_rates():
    """Oracle: rates -1/8 +- i, and real ones far apart, in closed form; both signs of each entry."""
    oblique = [(0.25, 1.0, -1.0, -0.5), (0.25, -1.0, 1.0, -0.5), (-0.5, 2.0, -0.5, 0.25), (-0.5, 0.5, -2.0, 0.25)]
    for a, b, c, d in [*oblique, (0.0, 1.0, -1.0, 0.0), (0.3, 1.0, -2.0, 0.3)]:
        t, q = core.schur(np.array([[a, b], [c, d]]))
        mean, square = 0.5 * (a + d), -(0.25 * (a - d) ** 2 + b * c)
        assert t[0, 0] == mean and -t[0, 1] * t[1, 0] == pytest.approx(square, rel=8 * EPSILON)
        require_schur_form(np.array([[a, b], [c, d]]), t, q)
    t, q = core.schur(np.array([[-1e8, 1.0], [1.0, -1.0]]))
    slow, fast = sorted(np.diagonal(t), key=abs)
    assert slow == pytest.approx(-1.0 + 1e-8, rel=1e-15) and fast == pytest.approx(-1e8 - 1e-8, rel=1e-15)


@pytest.mark.parametrize("size", range(2, 11))
def test_a_block_moves_up(size):
    matrix = next(matrices(size))
    t, q = core.schur(matrix)
    starts = [k for k in range(size) if k == 0 or t[k, k - 1] == 0.0]
    rates = {k: t[k, k] for k in starts}
    for start in starts:
        for end in (k for k in starts if k <= start):
            moved, basis = core.move_block(t, q, start, end)
            require_schur_form(matrix, moved, basis)
            assert moved[end, end] == pytest.approx(rates[start], rel=1e-9, abs=1e-9)
    with pytest.raises(ValueError, match="moves up"):
        core.move_block(t, q, 0, size - 1)


def test_blocks_of_equal_rates_are_not_exchanged():
    t = np.array([[1.0, 1.0], [0.0, 1.0]])
    with pytest.raises(ValueError, match="equal rates"):
        core.move_block(t, np.eye(2), 1, 0)
    assert core.sylvester(t, t, np.ones((2, 2))) is None


@pytest.mark.parametrize(("m", "k"), [(1, 1), (1, 2), (2, 1), (2, 2), (3, 4), (4, 3), (2, 7)])
def test_sylvester(m, k):
    random = np.random.default_rng(10 * m + k)
    a, c = random.normal(size=(m, m)), random.normal(size=(m, k))
    b = core.schur(random.normal(size=(k, k)) + 5.0 * np.eye(k))[0]
    x = core.sylvester(a, b, c)
    assert np.abs(a @ x - x @ b - c).max() < 1e-13 * (1.0 + np.abs(x).max())


def test_products_are_summed_in_the_order_of_the_columns():
    random = np.random.default_rng(3)
    a, b, x = random.normal(size=(5, 9)), random.normal(size=(9, 4)), random.normal(size=9)
    for r in range(5):
        for c in range(4):
            total = 0.0
            for k in range(9):
                total += a[r, k] * b[k, c]
            assert product(a, b)[r, c] == total
    assert product(x, x).shape == () and product(x, b).shape == (4,) and product(a, x).shape == (5,)
    square = random.normal(size=(9, 9))
    assert np.array_equal(quadratic(square, b), [product(b[:, k], square, b[:, k]) for k in range(4)])
    assert length(np.array([3.0, 4.0])) == 5.0


@pytest.mark.parametrize("size", range(1, 9))
def test_solutions_and_factors(size):
    random = np.random.default_rng(size)
    matrix, right = random.normal(size=(size, size)), random.normal(size=(size, 3))
    condition = np.linalg.cond(matrix)
    assert np.abs(solve(matrix, right) - np.linalg.solve(matrix, right)).max() < 1e-14 * condition * size * np.abs(right).max() * condition
    assert solve(matrix, right[:, 0]).shape == (size,)
    positive = matrix @ matrix.T + np.eye(size)
    lower = cholesky(positive)
    assert not np.triu(lower, 1).any() and np.abs(lower @ lower.T - positive).max() < 4 * size * EPSILON * np.abs(positive).max()
    for columns in (random.normal(size=(size, size // 2)), random.normal(size=(size, size + 1)), np.eye(size)[:, ::-1]):
        q, numpys = orthonormal(columns), np.linalg.qr(columns, mode="complete")[0]
        assert np.abs(q.T @ q - np.eye(size)).max() < 10 * size * EPSILON
        assert np.abs(q - numpys).max() < 1e-11


@pytest.mark.parametrize("shape", [(1, 1), (1, 4), (3, 3), (4, 2), (2, 5), (0, 2), (6, 6)])
def test_singular_values_and_directions(shape):
    """Oracle: numpy's; the definition for the directions; graded rows keep the digits of small values."""
    random = np.random.default_rng(sum(shape))
    matrix = random.normal(size=shape)
    values, rows = singular(matrix)
    assert np.abs(values - np.linalg.svd(matrix, compute_uv=False)).max(initial=0.0) < 1e-14
    assert np.abs(rows @ rows.T - np.eye(shape[1])).max() < 1e-14
    assert np.abs(np.linalg.norm(matrix @ rows.T, axis=0) - np.pad(values, (0, shape[1] - len(values)))).max() < 1e-14
    values, _ = singular(np.diag(10.0 ** np.arange(0, -16, -3)))
    assert values.tolist() == (10.0 ** np.arange(0, -16, -3)).tolist()


@pytest.mark.parametrize("zeros", [0, 2])
def test_the_roots_of_a_polynomial(zeros):
    """Oracle: the polynomial with these roots."""
    expected = np.array([3.0, 0.5, -2.0])
    found = roots(np.concatenate([np.zeros(zeros), 4.0 * np.poly(expected)]))
    assert np.abs(np.sort(found.real)[::-1] - expected).max() < 1e-13 and not found.imag.any()
    complex_ones = roots(np.array([1.0, 2.0, 5.0]))
    assert np.abs(np.sort_complex(complex_ones) - np.array([-1.0 - 2.0j, -1.0 + 2.0j])).max() < 1e-14


def test_singular_matrices_and_wrong_sizes_are_refused():
    with pytest.raises(np.linalg.LinAlgError, match="singular"):
        solve(np.zeros((2, 2)), np.ones(2))
    for entry in (0.0, -1.0, math.nan):
        with pytest.raises(np.linalg.LinAlgError, match="positive definite"):
            cholesky(np.full((2, 2), entry))
    with pytest.raises(RuntimeError, match="no numbers"):
        core.schur(np.full((2, 2), math.inf))
    for call in (lambda: core.schur(np.ones((2, 3))), lambda: core.product(np.ones((2, 3)), np.ones((2, 3))),
                 lambda: core.solve(np.eye(2), np.ones((3, 1))), lambda: core.sylvester(np.eye(2), np.eye(3), np.ones((2, 2)))):
        with pytest.raises(ValueError, match="expected|not square"):
            call()
    for call in (lambda: solve(np.eye(2), np.ones(3)), lambda: cholesky(np.ones((2, 3)))):
        with pytest.raises(ValueError, match="received 3|not square") as refusal:
            call()
        assert refusal.type is ValueError
