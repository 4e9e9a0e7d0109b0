"""Derivatives by jets, and complex numbers.

Oracles: derivatives of the same functions by mpmath in sixty digits; complex steps; the formulas of complex numbers in many digits.
"""

import mpmath as mp
import numpy as np
import pytest
import saltus_core
from hypothesis import given
from hypothesis import strategies as st

from tests.core.digits import EXACT

jets, numbers = saltus_core.jets, saltus_core.complex

ULP = 2.0**-52

POINTS = {name: np.linspace(-1.2, 1.3, 6) for name in ("sin", "cos", "tan", "exp", "expm1", "sinh", "cosh", "tanh", "asinh", "atan")}
POINTS |= {name: np.linspace(0.3, 4.0, 6) for name in ("log", "log1p", "sqrt")}
POINTS |= {name: np.linspace(-0.7, 0.8, 6) for name in ("asin", "acos")}


@pytest.mark.parametrize("name", POINTS)
def test_three_derivatives(name):
    """Three derivatives. Each is a sum of terms of about the size of the largest, rounded a few dozen times."""
    found = getattr(jets, name)(POINTS[name])
    with mp.workdps(60):
        for x, column in zip(POINTS[name], found.T, strict=True):
            exact = [mp.diff(EXACT[name], mp.mpf(float(x)), order) for order in range(4)]
            size = max(abs(value) for value in exact) + 1
            assert max(abs(mp.mpf(float(a)) - b) for a, b in zip(column, exact, strict=True)) < 64 * ULP * size


@pytest.mark.parametrize("exponent", [3.0, 4.0, -1.5, 2.5, 0.0])
def test_powers(exponent):
    """Oracle: the rule of powers; also at 0, where the power says nothing of its derivatives."""
    x = np.array([0.5, 1.7, *([0.0] if exponent in (3.0, 4.0) else [])])
    factors = np.cumprod([1.0, *(exponent - np.arange(3))])
    with np.errstate(divide="ignore", invalid="ignore"):
        exact = np.where(factors[:, None] == 0.0, 0.0, factors[:, None] * x ** (exponent - np.arange(4.0))[:, None])
    assert np.abs(jets.pow(x, exponent) - exact).max() < 64 * ULP * np.abs(exact).max()


def mixture(x, y):
    """The function of the same name in `bvp/core/bind_numbers.cpp`."""
    total = 2 / (x + 3) - (1 - x) * (y - mp.mpf(1) / 2) / 4 + x**-2 + x**y + y ** mp.mpf(1.5)
    total += mp.atan2(y, x) * mp.hypot(x, y)
    total -= mp.tanh(x / y) if x < y else mp.log1p(x * y) / mp.sqrt(y)
    total *= 1 + mp.cosh(x - y) / 4
    return total / (mp.exp(-x) + 1)


def test_all_operations_in_two_variables():
    """First and second derivatives of a function of many operations, on both sides of its branch."""
    x, y = np.array([0.6, 1.7, 2.2, 0.9]), np.array([1.9, 0.8, 2.1, 0.95])
    found = jets.mixture(x, y)
    with mp.workdps(60):
        for i in range(x.size):
            point = mp.mpf(float(x[i])), mp.mpf(float(y[i]))
            orders = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (1, 1), (0, 2)]
            exact = [mixture(*point), *(mp.diff(mixture, point, order) for order in orders[1:])]
            for a, b in zip(found[:, i], exact, strict=True):
                assert abs(mp.mpf(float(a)) - b) < 256 * ULP * max(abs(value) for value in exact)


def flight_and_impact(x):
    """The function of the same name in `bvp/core/bind_numbers.cpp`, for complex numbers."""
    z = np.empty(4, dtype=complex)
    for k, w in enumerate((0.7, 1.3)):
        s, c = np.sin(w * x[4]), np.cos(w * x[4])
        z[k], z[k + 2] = c * x[k] + s / w * x[k + 2], c * x[k + 2] - w * s * x[k]
    speed = 0.6 * z[2] - 0.8 * z[3]
    z[2:] -= 2.0 * speed * np.array([0.6, -0.8])
    return z


@given(st.lists(st.floats(-10.0, 10.0), min_size=5, max_size=5))
def test_jacobian_of_a_flight(x):
    """Oracle: complex steps, which have no error but rounding; then double-doubles, whose first parts are the Jacobian."""
    steps = [flight_and_impact(np.array(x) + 1e-100j * unit).imag * 1e100 for unit in np.eye(5)]
    found = jets.jacobian(x)[0]
    size = 1.0 + np.abs(x).max()
    assert np.abs(found - np.transpose(steps)).max() < 64 * ULP * size
    high, low = jets.jacobian_in_double_double(x)
    assert np.abs(found - high).max() < 64 * ULP * size
    assert np.all(np.abs(low) <= np.spacing(np.abs(high)) / 2)


@pytest.mark.parametrize(("name", "parts", "bits"), [("jacobian_in_double_double", 2, 98), ("jacobian_in_quad_double", 4, 195)])
def test_jacobian_in_many_digits(name, parts, bits):
    """Oracle: the derivatives of the displacements by the flight time, in closed form."""
    x = [0.3, -0.7, 1.1, 0.4, 2.9]
    found = getattr(jets, name)(x)
    assert found.shape == (parts, 4, 5) and np.all(np.any(found != 0.0, axis=(1, 2)))
    with mp.workdps(80):
        t = mp.mpf(x[4])
        for k, w in enumerate((mp.mpf(0.7), mp.mpf(1.3))):
            exact = mp.cos(w * t) * mp.mpf(x[k + 2]) - w * mp.sin(w * t) * mp.mpf(x[k])
            assert abs(mp.fsum(found[:, k, 4].tolist()) - exact) < mp.mpf(2) ** -bits


PART = st.floats(min_value=-1e300, max_value=1e300).filter(lambda x: x == 0.0 or abs(x) > 1e-290)


def close(value, exact, limit):
    """Whether a complex number is right to so many units, relative to its size."""
    return abs(mp.mpc(complex(value)) - exact) <= limit * ULP * abs(exact) + mp.mpf(2) ** -1070


@given(PART, PART, PART, PART)
def test_quotients_and_roots(a, b, c, d):
    """All magnitudes: no product overflows or vanishes on the way to a quotient or a root that is a double."""
    x, y = complex(a, b), complex(c, d)
    with mp.workdps(700):
        if y:
            exact = mp.mpc(x) / mp.mpc(y)
            if 1e-290 < abs(exact) < 1e300:
                assert close(numbers.divide(np.array([x]), np.array([y]))[0], exact, 6)
        if b or a >= 0.0:
            assert close(numbers.sqrt(x), mp.sqrt(mp.mpc(x)), 6)
        exact = mp.mpc(x) * mp.mpc(y)
        if 1e-290 < abs(exact) < 1e300 and max(abs(a), abs(b)) * max(abs(c), abs(d)) < 1e300:
            assert close(numbers.multiply(np.array([x]), np.array([y]))[0], exact, 4)


@pytest.mark.parametrize("z", [1.0 + 0.5j, -2.0 + 0.1j, -2.0 - 0.1j, 3.0 - 4.0j, 0.01j])
def test_derivatives_of_complex_functions(z):
    """Oracle: the derivative of sqrt(z) e^z/(1 + z) in closed form. Complex numbers of jets and jets of complex numbers."""
    value, in_parts, whole = numbers.derivatives(z)
    with mp.workdps(50):
        w = mp.mpc(z)
        exact = mp.sqrt(w) * mp.exp(w) / (1 + w)
        slope = exact * (1 / (2 * w) + 1 - 1 / (1 + w))
        assert close(value, exact, 16)
        assert close(in_parts, slope, 64) and close(whole, slope, 64)


def test_root_on_the_cut():
    """Oracle: the sign of the zero decides the side of the cut (C standard, annex G)."""
    assert numbers.sqrt(complex(-4.0, 0.0)) == 2j and numbers.sqrt(complex(-4.0, -0.0)) == -2j
    assert numbers.sqrt(0j) == 0.0 and numbers.sqrt(4 + 0j) == 2.0
