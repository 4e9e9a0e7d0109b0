"""Determinants and eigenvalues of small dense matrices.

Oracles: mpmath with 40 digits; matrices with known eigenvalues; singular values by numpy; graded matrices.
"""

import mpmath
import numpy as np
import pytest
import saltus_core as core


def computed(matrix):
    return np.sort_complex(core.eigenvalues(np.array(matrix, dtype=float)))


def digits(matrix):
    """Eigenvalues in 40 digits, rounded."""
    with mpmath.workdps(40):
        values = mpmath.eig(mpmath.matrix(np.asarray(matrix).tolist()), left=False, right=False)
        return np.sort_complex(np.array([complex(value) for value in values]))


def distance(found, exact):
    """Largest distance of a value from the nearest one of the other list, both ways."""
    apart = np.abs(np.subtract.outer(found, exact))
    return max(np.max(np.min(apart, axis=0)), np.max(np.min(apart, axis=1)))


@pytest.mark.parametrize("size", range(8))
def test_determinants(size):
    """Oracle: 40 digits; exchanged rows change the sign."""
    random = np.random.default_rng(size)
    for _ in range(8):
        matrix = random.normal(size=(size, size)) * 10.0 ** random.uniform(-3, 3, size=(size, 1))
        with mpmath.workdps(40):
            exact = float(mpmath.det(mpmath.matrix(matrix.tolist()))) if size else 1.0
        scale = np.prod(np.linalg.norm(matrix, axis=1))
        assert abs(core.determinant(matrix) - exact) < 1e-14 * max(size, 1) * scale
        if size > 1:
            swapped = matrix[[1, 0, *range(2, size)]]
            assert abs(core.determinant(swapped) + exact) < 1e-14 * size * scale


@pytest.mark.parametrize("size", range(1, 12))
def test_the_least_singular_value_is_bounded_from_below(size):
    """Oracle: numpy's singular values."""
    random = np.random.default_rng(size)
    for exponent in (0.0, 3.0, 6.0, 9.0):
        left, right = (np.linalg.qr(random.normal(size=(size, size)))[0] for _ in range(2))
        matrix = left @ np.diag(10.0 ** -np.linspace(0.0, exponent, size)) @ right
        singular = np.linalg.svd(matrix, compute_uv=False)[-1]
        for level in singular * np.array([1e-12, 1e-6, 1e-3, 0.9 / np.sqrt(size), 1.1, 1e3]):
            certain = core.certain_determinant(matrix, level)
            assert certain == core.determinant(matrix) if level < singular else np.isnan(certain)
        bound = core.signed_least_singular(matrix)
        assert singular / np.sqrt(size) * (1.0 - 1e-5) <= abs(bound) <= singular * (1.0 + 1e-5)
        assert np.sign(bound) == np.sign(np.linalg.det(matrix))
    zero = np.zeros((size, size))
    assert core.determinant(zero) == 0.0 and core.signed_least_singular(zero) == 0.0


@pytest.mark.parametrize("size", range(2, 13))
def test_eigenvalues_of_random_matrices(size):
    """Oracle: 40 digits, to rounding times the condition of the eigenvectors."""
    random = np.random.default_rng(size)
    for _ in range(2):
        matrix = random.normal(size=(size, size))
        condition = np.linalg.cond(np.linalg.eig(matrix)[1])
        assert distance(computed(matrix), digits(matrix)) < 1e-14 * size * condition


@pytest.mark.parametrize("matrix", [
    np.zeros((3, 3)),
    np.eye(4),
    np.diag([3.0, -1.0, 2.0]),
    np.roll(np.eye(5), 1, axis=0),
    np.roll(np.eye(4), 1, axis=0),
    [[0.0, 1.0], [-1.0, 0.0]],
    [[1.0, 2.0, 3.0], [0.0, 4.0, 5.0], [0.0, 0.0, 6.0]],
    [[0.0, 0.0, 1.0], [0.0, 2.0, 0.0], [4.0, 0.0, 0.0]],
])  # fmt: skip
def test_eigenvalues_of_special_matrices(matrix):
    """Oracle: 40 digits. Cyclic matrices need shifts from outside their trailing block."""
    assert distance(computed(matrix), digits(matrix)) < 1e-14


def test_badly_scaled_matrices_are_balanced():
    """Oracle: a similarity by powers of two changes no eigenvalue; a row of 1e12 does not cover the others."""
    random = np.random.default_rng(8)
    matrix = random.normal(size=(6, 6))
    scale = 2.0 ** random.integers(-40, 40, 6)
    plain = computed(matrix)
    assert distance(computed(matrix * scale[:, None] / scale), plain) < 1e-12
    assert list(computed([[0.0, 1e300], [1e-300, 0.0]])) == [-1.0, 1.0]


def test_the_distance_of_a_double_eigenvalue_is_the_root_of_the_perturbation():
    """Oracle: the discriminant 4 (square + below) of [[1, 1], [below, 1]] beside another eigenvalue, of either sign."""
    for below in (1e-8, -1e-8, 1e-12, -1e-12):
        matrix = np.diag([1.0, 1.0, 5.0])
        matrix[0, 1], matrix[1, 0] = 1.0, below
        found = computed(matrix)
        assert abs(((found[0] - found[1]) ** 2).real / (4.0 * below) - 1.0) < 1e-6


def test_numbers_that_are_none_are_refused():
    """Oracle: no endless iteration."""
    for bad in (np.nan, np.inf):
        matrix = np.ones((3, 3))
        matrix[1, 2] = bad
        with pytest.raises(RuntimeError, match="did not converge"):
            core.eigenvalues(matrix)


def test_matrices_that_are_not_square_are_refused():
    for function in (core.determinant, core.eigenvalues, core.symmetric_eigenvalues, core.signed_least_singular):
        with pytest.raises(ValueError, match="not square"):
            function(np.ones((2, 3)))


@pytest.mark.parametrize("size", range(1, 13))
def test_symmetric_eigenvalues(size):
    """Oracle: 40 digits. A graded matrix D A D keeps the relative accuracy of its small eigenvalues; the vectors are orthonormal."""
    random = np.random.default_rng(size)
    vectors = np.linalg.qr(random.normal(size=(size, size)))[0]
    core_part = vectors @ np.diag(random.uniform(1.0, 3.0, size)) @ vectors.T
    grade = 10.0 ** random.uniform(-6, 6, size)
    for matrix in (core_part, grade[:, None] * core_part * grade):
        matrix = 0.5 * (matrix + matrix.T)
        values, found = core.symmetric_eigenvalues(matrix)
        np.testing.assert_allclose(found.T @ found, np.eye(size), rtol=0, atol=1e-14 * size)
        with mpmath.workdps(40):
            exact = np.array([float(value) for value in mpmath.eigsy(mpmath.matrix(matrix.tolist()), eigvals_only=True)])
        np.testing.assert_allclose(np.sort(values), np.sort(exact), rtol=1e-14 * size)
        back = found @ np.diag(values) @ found.T
        assert np.max(np.abs(back - matrix)) < 1e-14 * size * np.max(np.abs(matrix))


@pytest.mark.parametrize("size", range(1, 12))
def test_eigensystems(size):
    """Oracle: the definition, and the condition numbers 1/|y* x| of numpy's unit vectors."""
    random = np.random.default_rng(size)
    for matrix in (random.normal(size=(size, size)), np.diag(random.normal(size=size)), np.eye(size)):
        values, real, imaginary, condition = core.eigensystem(matrix)
        vectors = real + 1j * imaginary
        scale = max(1.0, np.linalg.norm(matrix, 2))
        np.testing.assert_allclose(np.linalg.norm(vectors, axis=0), 1.0, atol=1e-14)
        assert np.max(np.abs(matrix @ vectors - vectors * values)) < 1e-13 * size * scale
        np.testing.assert_allclose(condition, np.linalg.norm(np.linalg.inv(vectors), axis=1), rtol=1e-6)
        assert np.all(vectors[:, np.imag(values) == 0.0].imag == 0.0)
    exact = np.linalg.inv(np.linalg.eig(matrix := random.normal(size=(size, size)))[1])
    found = core.eigensystem(matrix)
    order = [int(np.argmin(np.abs(np.linalg.eig(matrix)[0] - value))) for value in found[0]]
    np.testing.assert_allclose(found[3], np.linalg.norm(exact, axis=1)[order], rtol=1e-6)


def test_eigenvalues_without_enough_vectors_have_no_condition():
    """Oracle: a block of Jordan's form, whose eigenvalue moves by the root of a perturbation."""
    for size in (2, 3):
        assert np.min(core.eigensystem(np.eye(size) + np.eye(size, k=1))[3]) > 1e6


@pytest.mark.parametrize("size", range(1, 10))
def test_singular_values(size):
    """Oracle: 40 digits. Graded rows keep the relative accuracy of small ones."""
    random = np.random.default_rng(size)
    for grade in (np.ones(size), 10.0 ** random.uniform(-8, 8, size)):
        matrix = grade[:, None] * random.normal(size=(size, size))
        found = np.sort(core.singular_values(matrix))
        with mpmath.workdps(60):
            exact = sorted(float(value) for value in mpmath.svd_r(mpmath.matrix(matrix.tolist()), compute_uv=False))
        np.testing.assert_allclose(found, exact, rtol=1e-12)
    assert np.array_equal(core.singular_values(np.zeros((size, size))), np.zeros(size))


@pytest.mark.parametrize(("size", "seed"), [(10, 78), (12, 399), (16, 191)])
def test_singular_values_in_equal_pairs(size, seed):
    """Oracle: numpy's of a complex matrix, whose real form has each of them twice. These matrices leave products of rows that are rounding,
    but above that of one term: rotations for them would never end."""
    _, real, imaginary, _ = core.eigensystem(np.random.default_rng(seed).integers(-9, 10, size=(size, size)).astype(float))
    found = np.sort(core.singular_values(np.block([[real, -imaginary], [imaginary, real]])))
    np.testing.assert_allclose(found, np.repeat(np.linalg.svd(real + 1j * imaginary, compute_uv=False)[::-1], 2), rtol=1e-12)
