"""Eigenvalues of products of matrices and inverses. Oracle: the eigenvalues of the same product, formed in 80 digits."""

import mpmath as mp
import numpy as np
import pytest

from bvp.kernels.periodic_qr import product_eigenvalues


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
    m = factors.shape[1]
    found, product = np.empty((2, m)), np.empty((m, m))
    steps = product_eigenvalues(factors.copy(), inverse, np.empty((3, 3)), product, found)
    return steps, [mp.mpc(*pair) for pair in found.T], product


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


@pytest.mark.parametrize("name", CASES)
def test_each_eigenvalue_keeps_its_digits(name):
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


def test_a_singular_factor_gives_zero():
    """A plastic impact: one multiplier is 0 exactly, and the others are those of the product."""
    factors, inverse = chain([3.0, 1.1, 0.9, 0.5], 21)
    left, sizes, right = np.linalg.svd(factors[9])
    factors[9] = left[:, :-1] * sizes[:-1] @ right[:-1]
    _, found, _ = eigenvalues(factors, inverse)
    assert sum(value == 0 for value in found) == 1
    values = sorted(exact(factors, inverse), key=abs)
    assert abs(values[0]) < 1e-12 * abs(values[1])
    assert error([value for value in found if value != 0], values[1:]) < 1e-11


def test_a_singular_inverse_is_said():
    factors, inverse = chain([2.0, 0.5], 3)
    factors[0] = np.diag([1.0, 0.0])
    assert eigenvalues(factors, inverse)[0] == -1
