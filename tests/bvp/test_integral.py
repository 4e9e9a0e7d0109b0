"""Integrals of products along a flight. Oracle: mpmath at 40 digits, the integral of the matrix by the exponential of a larger matrix
(Van Loan), over damping ratios through critical damping, rigid bodies and loads; and the three ways of summing against each other."""

import mpmath
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from bvp.system import ImpactSystem, Stop
from tests.bvp.test_modes import exceptional_point
from tests.bvp.twins import first_order
from tests.lab.paths import integral

EPSILON = np.finfo(float).eps


def exact(matrix, first, second, z, t):
    """Integral of (a . exp(A s) z)(b . exp(A s) z): the corner of the exponential of [[-A', a b'], [0, A]]."""
    n = len(matrix)
    with mpmath.workdps(60 + int(2 * np.abs(matrix).sum() * t / 2.3)):
        a = mpmath.matrix(np.asarray(matrix).tolist())
        whole = mpmath.zeros(2 * n)
        for i in range(n):
            for j in range(n):
                whole[i, j] = -a[j, i]
                whole[n + i, n + j] = a[i, j]
                whole[i, n + j] = mpmath.mpf(float(first[i])) * mpmath.mpf(float(second[j]))
        whole = mpmath.expm(whole * mpmath.mpf(t))
        flow, corner = whole[n:, n:], whole[:n, n:]
        start = mpmath.matrix([mpmath.mpf(float(x)) for x in z])
        return float((start.T * flow.T * corner * start)[0])


def one(c, k):
    return ImpactSystem([[1.0]], [[c]], [[k]], (Stop((1.0,), -1.0, 1.0),))


OFFSETS = (-0.9, -0.5, -1e-2, -1e-4, -1e-8, -1e-12, -1e-15, 0.0, 1e-15, 1e-12, 1e-8, 1e-4, 1e-2, 0.5)
V, STATE = np.array([0.0, 1.0]), np.array([0.3, -1.1])
TWO_DOF_STATE = np.array([0.4, -0.2, 1.0, 1.5])
DAMPER, RATE = np.array([0.0, 0.0, 0.0, 1.0]), np.array([0.0, 0.0, 1.0, -0.5])


@pytest.mark.parametrize(
    ("systems", "row", "z", "times", "accuracy"),
    [
        ([one(c, k) for c in (0.0, 1e-9, 0.3, 50.0) for k in (0.0, 1e-12, -0.5)], V, STATE, (0.2, 7.0), 200 * EPSILON),
        ([exceptional_point()], RATE, TWO_DOF_STATE, (0.1, 3.0, 60.0), 1e-12),
    ],
    ids=["rigid bodies and negative stiffness", "a larger block"],
)
def test_dissipation(systems, row, z, times, accuracy):
    """Oracle: see `require_dissipation`."""
    require_dissipation(systems, row, z, times, accuracy)


def require_dissipation(systems, row, z, times, accuracy):
    """The integral of the square of a rate, to rounding of itself, on both sides of critical damping and at it."""
    for system in systems:
        for t in times:
            expected = exact(first_order(system), row, row, z, t)
            assert integral(system, row, row, z, t) == pytest.approx(expected, rel=accuracy), (system, t)


def test_light_damping_over_a_flight_without_end():
    """u'' + c u' + u = 0 from v = 1: c times the integral of v^2 is all of the energy, 1/2."""
    for c in (1e-12, 1e-3, 1.9999999, 2.0, 2.0000001, 1e4):
        v = np.array([0.0, 1.0])
        assert c * integral(one(c, 1.0), v, v, v, 1e18 if c < 1.0 else 1e6) == pytest.approx(0.5, rel=1e-13)


@pytest.mark.rounding
@settings(max_examples=10, deadline=None)
@given(st.integers(1, 3), st.integers(0, 2**31), st.floats(-3, 1.0), st.floats(1e-3, 10.0))
@example(3, 29, -2.0, 1.0)
@example(2, 1606785832, -1.2288444397180198, 0.6286338468107386)
def test_random_systems_and_unequal_rows(n, seed, size, t):
    """Any damping; the product of two different rates; scaled by the integrals of their squares."""
    rng = np.random.default_rng(seed)
    half, root = rng.normal(size=(n, n)), rng.normal(size=(n, n))
    system = ImpactSystem(
        np.diag(rng.uniform(0.3, 3.0, n)), 10.0**size * half @ half.T, root @ root.T, (Stop(tuple(rng.normal(size=n)), -1.0, 1.0),)
    )
    a, b, z = rng.normal(size=(3, 2 * n))
    modes = system.modes
    matrix = first_order(system)
    size = np.sqrt(exact(matrix, a, a, z, t) * exact(matrix, b, b, z, t))
    expected = exact(matrix, a, b, z, t)
    assert abs(integral(system, a, b, z, t) - expected) <= 1e-12 * size
    rows = [np.array([row]) @ modes.to_state for row in (a, b)]
    start = modes.from_state @ z
    # The integrand is a sum over modes, whose parts are larger than it where modes are nearly parallel. Each part rounds by itself.
    parts = np.finfo(float).eps * t * np.prod([np.linalg.norm(row) * np.linalg.norm(start) for row in rows])
    for way in ("series", "doubling"):
        assert abs(integral(system, a, b, z, t, way) - expected) <= 1e-12 * size + parts
