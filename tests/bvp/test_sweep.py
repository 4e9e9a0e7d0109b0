"""A sweep round the cycle of a product pencil. Oracle: the product of the very factors in 60 digits."""

import mpmath
import numpy as np
import pytest

from tests.lab.matrices import cyclic_sweep


@pytest.mark.parametrize("size", [1.0, 1e45, 1e-45])
def test_triangular_factor_of_products_beyond_the_range_of_floats(size):
    """With M the product and Q a frame, M Q = Q' R: |R_11| is the length of M q_1, |R_11 R_22| is |det M|. R is known as mantissas and
    powers of two, for twelve factors of size 1e45 overflow."""
    rng = np.random.default_rng(7)
    left, right = rng.normal(size=(4, 2, 2)), size * rng.normal(size=(4, 2, 2))
    frame = np.linalg.qr(rng.normal(size=(2, 2)))[0]
    first = mpmath.matrix(frame[:, 0].tolist())
    product, exponent = cyclic_sweep(left, right, 3, frame)
    with mpmath.workdps(60):
        whole = mpmath.eye(2)
        for i in [0, 1, 2, 3] * 3:
            whole = mpmath.matrix(left[i].tolist()) ** -1 * mpmath.matrix(right[i].tolist()) * whole
        length = float(mpmath.log(mpmath.norm(whole * first), 2))
        area = float(mpmath.log(abs(mpmath.det(whole)), 2))
    found = np.log2(np.abs(np.diag(product))) + exponent
    np.testing.assert_allclose([found[0], found.sum()], [length, area], rtol=0, atol=1e-10)
    assert (abs(length) > 1100) == (size != 1.0) and np.isfinite(product).all()
