"""Eigenvalues of products of matrices and inverses. Oracle: the eigenvalues of the same product, formed in 80 digits, and what rounding of
the factors changes of them."""

import mpmath as mp
import numpy as np
import pytest
import saltus_core as core

EPS = np.finfo(float).eps


def turned(radius, angle):
    """A block with a complex pair."""
    return radius * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def chain(blocks, count, beside=0.3, seed=0):
    """Factors, every other one inverted, that keep the same flag of subspaces: the product has powers of the eigenvalues of the blocks.
    beside: size of the entries above the blocks. With them, eigenvalues that are close are sensitive."""
    random = np.random.default_rng(seed)
    blocks = [np.atleast_2d(block) for block in blocks]
    m = sum(map(len, blocks))
    frames = [np.linalg.qr(random.normal(size=(m, m)))[0] for _ in range(count)]
    factors, inverse = [], []
    for k in range(count):
        middle, at = np.triu(random.normal(size=(m, m)), 2) * beside, 0
        for block in blocks:
            middle[at : at + len(block), at : at + len(block)] = block
            at += len(block)
        backwards = k % 2 == 0 and k < count - 1
        first, last = frames[k], frames[(k + 1) % count]
        factors.append(first @ np.linalg.inv(middle) @ last.T if backwards else last @ middle @ first.T)
        inverse.append(int(backwards))
    return np.array(factors), np.array(inverse, dtype=np.int64)


def exact(factors, inverse):
    with mp.workdps(80):
        product = mp.eye(factors.shape[1])
        for factor, backwards in zip(factors, inverse, strict=True):
            matrix = mp.matrix(factor.tolist())
            product = (matrix**-1 if backwards else matrix) * product
        return mp.eig(product, left=False, right=False) if len(product) > 1 else [product[0]]


def eigenvalues(factors, inverse):
    steps, found, product = core.product_eigenvalues(factors, inverse)
    return steps, [mp.mpc(value) for value in found.tolist()], product


def error(found, values):
    """Largest difference of an eigenvalue from the nearest one of the other list, relative to itself."""
    with mp.workdps(80):
        return float(max(max(min(abs(a / b - 1) for a in found) for b in values), max(min(abs(a / b - 1) for b in values) for a in found)))


CASES = {
    "1e8": ([3.0, 1.0, 1 / 3], 17),
    "1e30": ([10.0, turned(1.0, 0.7), 0.1], 30),
    "pairs of equal size": ([turned(2.0, 0.3), turned(2.0, 0.6), turned(1.0, 0.7), turned(0.5, 0.3), turned(0.5, 0.6)], 31),
    "opposite signs": ([5.0, -5.0, 1.0, -1.0, 0.2, -0.2], 41),
    "near one": ([1.2, 1.1, 1.05, 0.95, 0.9], 11),
    "two": ([2.0, 0.5], 101),
    "a pair": ([turned(1.0, 0.4)], 5),
    "one": ([-2.0], 7),
    "two factors": ([3.0, turned(1.0, 0.5), 0.2], 2),
    "many on the circle": ([7.0, *(turned(1.0, 0.05 * k) for k in range(1, 10)), 1 / 7], 36),
}


@pytest.mark.parametrize("name", [*CASES][:-1])
def test_each_eigenvalue_keeps_its_digits(name):
    """Oracle: see `require_each_eigenvalue_keeps_its_digits`."""
    require_each_eigenvalue_keeps_its_digits(name)


def require_each_eigenvalue_keeps_its_digits(name):
    """From 1e-30 to 1e30, with factors of equal size: complex pairs, real ones of opposite sign, up to twenty on a circle."""
    blocks, count = CASES[name]
    factors, inverse = chain(blocks, count, 0.0 if name == "many on the circle" else 0.3)
    steps, found, product = eigenvalues(factors, inverse)
    values = exact(factors, inverse)
    assert 0 < steps < 6 * len(found)
    assert error(found, values) < 2e-14 * count
    largest = float(max(abs(value) for value in values))
    assert largest < (1 + 1e-12) * np.linalg.norm(product, 2)


def test_double_eigenvalues_next_to_large_ones():
    """1 and -1 twice, without being diagonal: the root of rounding, while 1e20 and 1e-20 keep their digits."""
    factors, inverse = chain([4.0, 1.0, 1.0, -1.0, -1.0, 0.25], 33)
    _, found, _ = eigenvalues(factors, inverse)
    values = exact(factors, inverse)
    sizes = sorted(abs(value) for value in values)
    mine = sorted(abs(value) for value in found)
    assert sizes[-1] > 1e19 and abs(mine[-1] / sizes[-1] - 1) < 1e-12 and abs(mine[0] / sizes[0] - 1) < 1e-12
    assert error(found, values) < 1e-5


def rounding(factors, inverse, value):
    """Largest change of an eigenvalue, to first order, for changes of each factor by eps of its norm, from its vectors in 80 digits."""
    with mp.workdps(80):
        forward = [mp.matrix(factor.tolist()) ** (-1 if backwards else 1) for factor, backwards in zip(factors, inverse, strict=True)]
        product = mp.eye(len(forward[0]))
        for matrix in forward:
            product = matrix * product
        away = product - (value + mp.mpf(10) ** -60 * mp.norm(product)) * mp.eye(len(product))
        start = mp.matrix([1] * len(product))
        right, left = mp.lu_solve(away, start), mp.lu_solve(away.T, start)
        right, left = mp.lu_solve(away, right), mp.lu_solve(away.T, left)
        lefts = [left.T]
        for matrix in forward[::-1]:
            lefts.append(lefts[-1] * matrix)
        total, scale = mp.mpf(0), abs((left.T * right)[0])
        for k, (matrix, factor, backwards) in enumerate(zip(forward, factors, inverse, strict=True)):
            before, after = right, matrix * right
            ahead = lefts[len(forward) - 1 - k]
            total += np.linalg.norm(factor) * (mp.norm(ahead * matrix) * mp.norm(after) if backwards else mp.norm(ahead) * mp.norm(before))
            right = after
        return float(EPS * total / scale)


@pytest.mark.parametrize(
    "m, pairs, plastic, grade",
    [(3, 1, 1, 1.0), (3, 5, 5, 1e4), (5, 1, 1, 1e4), (5, 5, 1, 1.0), (5, 20, 7, 1e2), (9, 3, 2, 1e3)],
)
def test_factors_with_columns_of_zeros(m, pairs, plastic, grade):
    """Random flights and impacts, some of them plastic: one eigenvalue is rounding, and the others are those of the product."""
    random = np.random.default_rng([m, pairs, 0])
    flights = random.normal(size=(pairs, m, m)) * np.logspace(0.0, -np.log10(grade), m)
    for k in random.choice(pairs, plastic, replace=False):
        flights[k, :, random.integers(m)] = 0.0
    factors = np.empty((2 * pairs, m, m))
    factors[::2], factors[1::2] = random.normal(size=(pairs, m, m)), flights
    inverse = np.tile(np.array([1, 0], np.int64), pairs)
    steps, found, product = eigenvalues(factors, inverse)
    values = sorted(exact(factors, inverse), key=abs)
    assert steps > 0 and abs(values[0]) < 1e-60
    assert min(map(abs, found)) < min(EPS * np.linalg.norm(product), 1e-10 * abs(values[1]))
    assert all(min(abs(other - value) for other in found) < rounding(factors, inverse, value) for value in values[1:])


def test_a_singular_inverse_is_said():
    factors, inverse = chain([2.0, 0.5], 3)
    factors[0] = np.diag([1.0, 0.0])
    assert eigenvalues(factors, inverse)[0] == -1


def test_factors_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="last factor"):
        core.product_eigenvalues(np.ones((2, 3, 3)), np.array([0, 1]))
    with pytest.raises(ValueError, match="received 1 entries of inverse; expected 2"):
        core.product_eigenvalues(np.ones((2, 3, 3)), np.array([0]))


@pytest.mark.parametrize("size", [1.0, 1e45, 1e-45])
def test_products_beyond_the_range_of_floats(size):
    """Twelve factors of size 1e45 overflow, and so do the eigenvalues; those of factors that are divided again do not."""
    random = np.random.default_rng(7)
    middle = random.normal(size=(12, 3, 3))
    factors = np.concatenate([size * middle[:6], middle[6:] * size])
    inverse = np.array([0] * 6 + [1] * 5 + [0])
    steps, found, _ = eigenvalues(factors, inverse)
    assert steps > 0
    with mp.workdps(80):
        assert error(found, exact(factors, inverse)) < 1e-10
