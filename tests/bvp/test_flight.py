"""Exact free flight. Oracles: mpmath's exponential at 50 digits, the group property, energy, closed forms, scipy's expm as
twin."""

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from tests.bvp.test_modes import exceptional_point, nearly_equal
from tests.bvp.twins import chain, exact_flow_matrix, first_order, flow
from tests.lab.flights import LinearFlight, circular

EPSILON = np.finfo(float).eps


def physical_flow(system, t):
    """exp(A t) of (u, v) through the modes."""
    return system.modes.to_state @ LinearFlight(system).map(t) @ system.modes.from_state


def flow_error(system, t):
    """Largest error of exp(A t) over its own size, both in coordinates sqrt(M) w u and sqrt(M) v with the system's own rate
    w."""
    root = np.sqrt(np.diag(system.mass))
    fastest = max(float(np.nanmax(np.abs(system.modes.squares))) ** 0.5, 1e-3)
    scale = np.concatenate([root * fastest, root])
    exact = exact_flow_matrix(system, t) * scale[:, None] / scale
    return np.abs(physical_flow(system, t) * scale[:, None] / scale - exact).max() / np.abs(exact).max()


def one(c, k):
    """u'' + c u' + k u = 0."""
    return ImpactSystem([[1.0]], [[c]], [[k]], (Stop((1.0,), -1.0, 1.0),))


def dampers(*strong):
    """Masses in a row with strong dampers between them."""
    n, between = len(strong) + 1, np.diff(np.eye(len(strong) + 1), axis=0)
    damping = between.T @ np.diag(strong) @ between + 0.1 * np.diag(np.arange(n))
    return ImpactSystem(np.eye(n) + 0.5 * np.diag(np.arange(n)), damping, np.diag(np.arange(1.0, n + 1)), (Stop((1.0,) * n, -1.0, 1.0),))


OFFSETS = (-0.5, -1e-4, -1e-8, -1e-12, -1e-15, 0.0, 1e-15, 1e-12, 1e-8, 1e-4, 0.5)
REFERENCE = [vibro_impact_nes(mu, 0.1) for mu in (1e-8, 1e-3, 0.1, 1.0, 1e8)]
CASES = [
    # The error of a phase w t grows with it: (systems, times, roundings, and their growth with time).
    *[([system], (1e-9, 0.3, 7.0, 50.0), 16, 8 * np.max(system.modes.frequencies)) for system in REFERENCE],
    ([one(2.0 * (1.0 + offset), 1.0) for offset in OFFSETS], (1e-6, 0.7, 5.0, 40.0), 32, 32),
    ([one(c, k) for c in (0.0, 0.3, -0.2) for k in (-4.0, -1e-12, 0.0, 1e-12)], (1e-5, 1.0, 8.0), 64, 0),
    ([dampers(*strong) for strong in ([1e3], [1e5], [1e8], [1e12], [1e6, 1e6], [1e3, 1e8])], (0.1, 1.0, 10.0), 64, 32),
    ([nearly_equal()], (1.0, 30.0, 1000.0), 8, 4),
    ([exceptional_point()], (1e-3, 1.0, 20.0), 200, 200),
]


@pytest.mark.parametrize(("systems", "times", "roundings", "growth"), CASES)
def test_special_systems_against_fifty_digits(systems, times, roundings, growth):
    """Any mass ratio; critical damping above, below and at it; zero frequency, hyperbolic pairs and negative damping; nearly equal
    frequencies; complex pairs that coalesce to a dense block; slow motions beside strong dampers."""
    for system in systems:
        for t in times:
            assert flow_error(system, t) <= (roundings + growth * t) * EPSILON


@pytest.mark.parametrize("c", [1e2, 1e4, 1e8])
@pytest.mark.parametrize("t", [1e-3, 1.0, 100.0])
def test_strong_overdamping_neither_overflows_nor_loses_the_slow_rate(c, t):
    """50 digits on the displacement row; the slow rate is k/c and exp(-c t) is far below the smallest number."""
    exact = exact_flow_matrix(one(c, 1.0), t)
    np.testing.assert_allclose(physical_flow(one(c, 1.0), t)[0], exact[0], rtol=8 * EPSILON)


@settings(max_examples=20)
@given(st.integers(1, 4), st.integers(0, 2**31), st.floats(-4, 1.5), st.floats(0.0, 20.0))
def test_random_damped_systems(n, seed, size, t):
    """Non-proportional damping from light to overdamped; 50 digits."""
    rng = np.random.default_rng(seed)
    half, root = rng.normal(size=(n, n)), rng.normal(size=(n, n))
    mass = np.diag(10.0 ** rng.uniform(-1, 1, n))
    system = ImpactSystem(mass, 10.0**size * half @ half.T, root @ root.T, (Stop(tuple(rng.normal(size=n)), -1.0, 1.0),))
    fastest = np.abs(np.linalg.eigvals(first_order(system))).max()
    assert flow_error(system, t) <= 2000 * EPSILON * (1.0 + fastest * t)


@settings(max_examples=15)
@given(st.integers(2, 6), st.integers(0, 2**31), st.floats(0.0, 30.0))
def test_free_free_chains(n, seed, t):
    """One rigid-body mode, masses over six decades; 50 digits."""
    rng = np.random.default_rng(seed)
    system = chain(10.0 ** rng.uniform(-3, 3, n), rng.uniform(0.1, 2.0, n - 1))
    fastest = system.modes.frequencies[-1]
    assert flow_error(system, t) <= 16 * n * EPSILON * (2.0 + fastest * t)


def test_the_larger_block_alone_against_fifty_digits():
    """A nilpotent block has a polynomial for exponential; a random one mpmath's."""
    nilpotent = np.diag([1.0, 1.0], 1)
    flow = LinearFlight.of_blocks(nilpotent, [(0, 3)]).map(2.0)
    np.testing.assert_allclose(flow, [[1, 2, 2], [0, 1, 2], [0, 0, 1]], rtol=0, atol=4 * EPSILON)
    a = np.random.default_rng(5).normal(size=(5, 5))
    with mpmath.workdps(50):
        exact = np.array(mpmath.expm(mpmath.matrix(a[1:5, 1:5].tolist()) * 3).tolist(), dtype=float)
    flow = LinearFlight.of_blocks(a, [(0, 1), (1, 4)]).map(3.0)
    np.testing.assert_allclose(flow[1:, 1:], exact, rtol=0, atol=1e-13 * np.abs(exact).max())


@pytest.mark.parametrize("x", [-40.0, -0.0301, -0.03, -0.0299, -1e-9, 0.0, 1e-9, 0.0299, 0.03, 0.0301, 40.0])
def test_circular_functions_are_continuous_through_zero(x):
    """C and S from mpmath, at t = 0.7 and delta = x/t^2."""
    t = 0.7
    delta = x / t**2
    with mpmath.workdps(40):
        root = mpmath.sqrt(mpmath.mpf(delta))
        c = float(mpmath.re(mpmath.cosh(root * mpmath.mpf(t))))
        s = float(mpmath.re(mpmath.sinh(root * mpmath.mpf(t)) / root)) if delta != 0.0 else t
    np.testing.assert_allclose(circular(delta, t), [c, s], rtol=8 * EPSILON, atol=2 * EPSILON)


@settings(max_examples=20)
@given(st.integers(0, 2**31), st.floats(0.0, 10.0), st.floats(-3.0, 10.0), st.sampled_from([0.0, 0.05, 1.0]))
def test_flights_add_up(seed, s, t, damping):
    """exp(B (s + t)) = exp(B s) exp(B t), also backwards."""
    rng = np.random.default_rng(seed)
    plain = chain(rng.uniform(0.2, 2.0, 3), rng.uniform(0.2, 2.0, 2))
    system = ImpactSystem(plain.mass, damping * np.diag(rng.uniform(0.0, 1.0, 3)), plain.stiffness, plain.stops)
    whole, first, second = physical_flow(system, s + t), physical_flow(system, s), physical_flow(system, t)
    np.testing.assert_allclose(second @ first, whole, rtol=0, atol=1e-13 * np.abs(second).max() * np.abs(first).max() * 20)


@settings(max_examples=20)
@given(st.integers(1, 6), st.integers(0, 2**31), st.floats(0.0, 1000.0))
def test_an_undamped_flight_keeps_its_energy(n, seed, t):
    rng = np.random.default_rng(seed)
    system = chain(rng.uniform(0.2, 2.0, n), rng.uniform(0.2, 2.0, n - 1), rng.choice([0.0, 1.0]))
    modes = system.modes
    u, v = rng.normal(size=n), rng.normal(size=n)
    after = modes.to_state @ LinearFlight(system).end(modes.from_state @ np.concatenate([u, v]), t)
    # the rigid-body displacement carries no energy but rounds with its size
    travelled = np.abs(after[:n]).max() ** 2 * np.abs(system.stiffness).max()
    assert abs(system.energy(after[:n], after[n:]) - system.energy(u, v)) <= 64 * EPSILON * (system.energy(u, v) + travelled)


@settings(max_examples=15)
@given(st.integers(0, 2**31), st.floats(0.0, 10.0), st.floats(-3, 1))
def test_states_and_rates_agree_with_the_plain_twins(seed, t, size):
    """The end against scipy's expm, the rate against the first-order matrix."""
    rng = np.random.default_rng(seed)
    half = rng.normal(size=(3, 3))
    plain = chain(rng.uniform(0.2, 2.0, 3), rng.uniform(0.2, 2.0, 2), 1.0)
    system = ImpactSystem(plain.mass, 10.0**size * half @ half.T, plain.stiffness, plain.stops)
    modes = system.modes
    u, v = rng.normal(size=3), rng.normal(size=3)
    z, flight = modes.from_state @ np.concatenate([u, v]), LinearFlight(system)
    np.testing.assert_allclose(modes.to_state @ flight.end(z, t), flow(system, u, v, t), rtol=0, atol=1e-10)
    np.testing.assert_allclose(modes.to_state @ flight.rate(z), first_order(system) @ np.concatenate([u, v]), rtol=0, atol=1e-10)
