"""Modes and blocks. Oracles: mpmath's eigenvalues at 50 digits, the first-order matrix itself, closed forms of small
systems."""

import mpmath
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.linalg import eigh

from bvp.blocks import cut
from bvp.modes import undamped_modes
from bvp.motion import MotionStatus
from bvp.simulate import simulate
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from tests.bvp.twins import chain, first_order

EPSILON = np.finfo(float).eps


def exact_squares(system):
    """w^2 at 50 digits from the exact values of the floats, ascending."""
    with mpmath.workdps(60):
        low = mpmath.cholesky(mpmath.matrix(system.mass.tolist()))
        inverse = low**-1
        values = mpmath.eigsy(inverse * mpmath.matrix(system.stiffness.tolist()) * inverse.T, eigvals_only=True)
        return np.array(sorted(float(x) for x in values))


def assert_blocks_are_the_system(system, tolerance):
    """to_state B from_state is the first-order matrix and the maps are inverse, in coordinates scaled by energy."""
    modes = system.modes
    n = system.degrees_of_freedom
    root = np.sqrt(np.diag(system.mass))
    scale = np.concatenate([root, root])
    first = scale[:, None] * first_order(system) / scale
    built = scale[:, None] * (modes.to_state @ modes.matrix @ modes.from_state) / scale
    size = np.abs(scale[:, None] * modes.to_state) @ np.abs(modes.matrix) @ np.abs(modes.from_state / scale)
    assert np.all(np.abs(built - first) <= tolerance * (size + np.abs(first)).max())
    product = np.abs(modes.from_state) @ np.abs(modes.to_state)
    assert np.all(np.abs(modes.from_state @ modes.to_state - np.eye(2 * n)) <= tolerance * product.max())
    inside = np.zeros_like(modes.matrix, dtype=bool)
    for i, j in modes.pairs:
        block = [i, j] if j >= 0 else list(range(i, i - j))
        inside[np.ix_(block, block)] = True
    assert not np.any(modes.matrix[~inside])
    assert inside.sum() == sum(4 if j >= 0 else j * j for _, j in modes.pairs)


@pytest.mark.parametrize("damping", [2e-313, 1e-308, 1e-200])
def test_damping_below_the_normal_numbers(damping):
    assert_blocks_are_the_system(vibro_impact_nes(1.0, 1.0, damping, 1.0), 16 * EPSILON)


@pytest.mark.parametrize("mu", [1e-8, 1e-4, 0.1, 1.0, 1e4, 1e8])
@pytest.mark.parametrize("sigma", [1e-6, 0.1, 2.0, 1e3])
def test_frequencies_of_the_reference_system_keep_their_digits_at_any_mass_ratio(mu, sigma):
    """Relative to the size of the terms of the Rayleigh quotient, at 50 digits."""
    system = vibro_impact_nes(mu, sigma)
    modes = system.modes
    size = np.einsum("ik,ij,jk->k", np.abs(modes.shapes), np.abs(system.stiffness), np.abs(modes.shapes))
    assert np.all(np.abs(modes.squares - exact_squares(system)) <= 8 * EPSILON * size)
    residual = system.stiffness @ modes.shapes - system.mass @ modes.shapes * modes.squares
    terms = np.abs(system.stiffness) @ np.abs(modes.shapes) + system.mass @ np.abs(modes.shapes) * np.abs(modes.squares)
    assert np.all(np.abs(residual) <= 16 * EPSILON * terms.max(axis=0))
    np.testing.assert_allclose(modes.shapes.T @ system.mass @ modes.shapes, np.eye(2), atol=8 * EPSILON)


def test_the_ratio_of_the_mode_shape_is_the_published_one():
    """Lee et al. (2009) print 3.702 for the in-phase mode at mu = sigma = 0.1."""
    shape = vibro_impact_nes(0.1, 0.1).modes.shapes[:, 0]
    assert round(shape[0] / shape[1], 3) == 3.702


@settings(max_examples=25)
@given(st.integers(1, 6), st.integers(0, 2**31), st.floats(0, 8), st.sampled_from([0.0, 1.0]))
def test_random_chains_have_the_modes_of_the_fifty_digit_pencil(n, seed, spread, ground):
    """Free-free chains (ground 0) have one frequency that is exactly 0."""
    rng = np.random.default_rng(seed)
    system = chain(10.0 ** rng.uniform(-spread, spread, n), rng.uniform(0.1, 2.0, n - 1), ground)
    modes = system.modes
    size = np.einsum("ik,ij,jk->k", np.abs(modes.shapes), np.abs(system.stiffness), np.abs(modes.shapes))
    assert np.all(np.abs(modes.squares - exact_squares(system)) <= 16 * n * EPSILON * np.maximum(size, modes.squares))
    np.testing.assert_allclose(modes.shapes.T @ system.mass @ modes.shapes, np.eye(n), atol=1e-14 * n)
    assert np.all(np.diff(modes.frequencies) >= 0.0)
    assert np.count_nonzero(modes.frequencies == 0.0) == (1 if ground == 0.0 else 0)


def test_a_full_mass_matrix_and_a_repeated_frequency():
    """K = w^2 M has one frequency only, and every basis is one of modes."""
    mass = np.array([[2.0, 0.3, 0.1], [0.3, 1.0, 0.2], [0.1, 0.2, 3.0]])
    squares, shapes = undamped_modes(mass, 4.0 * mass)
    np.testing.assert_allclose(squares, 4.0, rtol=1e-14)
    np.testing.assert_allclose(shapes.T @ mass @ shapes, np.eye(3), atol=1e-14)


def nearly_equal():
    """w1 - w2 = 1e-10, shapes turned by 53 degrees."""
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    stiffness = turn @ np.diag([1.0, (1.0 + 1e-10) ** 2]) @ turn.T
    return ImpactSystem(np.eye(2), np.zeros((2, 2)), 0.5 * (stiffness + stiffness.T), (Stop((1.0, 0.0), -1.0, 1.0),))


def test_frequencies_that_differ_by_1e_10_are_separate():
    system = nearly_equal()
    squares, shapes = undamped_modes(system.mass, system.stiffness)
    assert abs(np.sqrt(squares[1]) - np.sqrt(squares[0]) - 1e-10) < 1e-15
    np.testing.assert_allclose(shapes.T @ shapes, np.eye(2), atol=1e-15)


def test_an_indefinite_stiffness_has_a_hyperbolic_pair():
    system = ImpactSystem(np.diag([1.0, 2.0]), np.zeros((2, 2)), np.diag([-4.0, 2.0]), (Stop((1.0, 0.0), -1.0, 1.0),))
    modes = system.modes
    np.testing.assert_allclose(modes.squares, [-4.0, 1.0], rtol=1e-15)
    np.testing.assert_allclose(modes.delta, [4.0, -1.0], rtol=1e-15)
    assert np.isnan(modes.frequencies[0]) and modes.frequencies[1] == pytest.approx(1.0, rel=1e-15)
    assert_blocks_are_the_system(system, 8 * EPSILON)


def test_the_contacts_of_several_stops():
    """Rows against c, c M^-1 c and B; order and letters as documented."""
    stops = (Stop((1.0, -1.0), -1.0, 2.0, 0.9), Stop((0.0, 1.0), upper=3.0, restitution=0.5, name="k"))
    system = ImpactSystem([[2.0, 0.5], [0.5, 1.0]], [[0.1, 0.0], [0.0, 0.3]], [[3.0, -1.0], [-1.0, 1.0]], stops)
    modes = system.modes
    assert modes.contact_letters == ("a-", "a+", "k+")
    assert modes.contact_stop.tolist() == [0, 0, 1]
    assert modes.contacts.side.tolist() == [-1.0, 1.0, 1.0]
    assert modes.contacts.bound.tolist() == [-1.0, 2.0, 3.0]
    assert modes.contacts.restitution.tolist() == [0.9, 0.9, 0.5]
    for row, k in zip(range(3), (0, 0, 1), strict=True):
        c = np.array(stops[k].gap)
        direction = np.linalg.solve(system.mass, c)
        np.testing.assert_allclose(modes.contacts.gap[row] @ modes.from_state, [*c, 0.0, 0.0], atol=1e-14)
        np.testing.assert_allclose(modes.contacts.rate[row] @ modes.from_state, [0.0, 0.0, *c], atol=1e-14)
        np.testing.assert_allclose(
            modes.contacts.acceleration[row] @ modes.from_state,
            np.array([*c, 0.0, 0.0]) @ first_order(system) @ first_order(system),
            atol=1e-13,
        )
        np.testing.assert_allclose(
            modes.to_state @ modes.contacts.push[row], [0.0, 0.0, *direction / (c @ direction)], atol=1e-14
        )


@settings(max_examples=25)
@given(st.integers(1, 5), st.integers(0, 2**31), st.floats(-11, 3))
@example(2, 0, -9.0)
def test_random_damping_gives_well_conditioned_blocks(n, seed, size):
    """to_state B from_state against the first-order matrix; the transformation amplifies rounding by no more than 1e4."""
    rng = np.random.default_rng(seed)
    mass = np.diag(rng.uniform(0.1, 2.0, n))
    half = rng.normal(size=(n, n))
    root = rng.normal(size=(n, n))
    row = rng.normal(size=n)
    system = ImpactSystem(mass, 10.0**size * half @ half.T, root @ root.T, (Stop(tuple(row), -1.0, 1.0),))
    assert_blocks_are_the_system(system, 1e4 * EPSILON)


def test_proportional_damping_keeps_the_real_modes():
    """Rayleigh damping a M + b K: B[n+k, n+k] = -(a + b w^2), pairs (k, n + k), no mode coupled."""
    plain = chain([0.5, 1.0, 2.0], [1.0, 2.0], 0.7)
    system = ImpactSystem(plain.mass, 0.1 * plain.mass + 0.02 * plain.stiffness, plain.stiffness, plain.stops)
    modes = system.modes
    assert modes.layout == "uncoupled" and modes.pairs.tolist() == [[0, 3], [1, 4], [2, 5]]
    np.testing.assert_allclose(np.diag(modes.matrix)[3:], -(0.1 + 0.02 * modes.squares), rtol=1e-13)
    np.testing.assert_allclose(modes.mean, -(0.1 + 0.02 * modes.squares) / 2, rtol=1e-13)
    np.testing.assert_allclose(modes.delta, modes.mean**2 - modes.squares, rtol=1e-12)
    assert_blocks_are_the_system(system, 32 * EPSILON)


def test_proportional_damping_of_a_repeated_frequency_is_not_coupled():
    """Two equal oscillators, coupled by their damper only: the shapes turn to (1, 1) and (1, -1)."""
    system = ImpactSystem(np.eye(2), [[0.2, -0.2], [-0.2, 0.2]], np.eye(2), (Stop((1.0, -1.0), -1.0, 1.0),))
    assert system.modes.layout == "uncoupled"
    np.testing.assert_allclose(np.sort(np.diag(system.modes.matrix)[2:]), [-0.4, 0.0], atol=1e-15)
    assert_blocks_are_the_system(system, 16 * EPSILON)


def test_internal_damping_leaves_the_rigid_body_mode_free():
    system = chain([1.0, 3.0, 0.7], [1.0, 0.3], damping=0.1)
    modes = system.modes
    assert modes.frequencies[0] == 0.0 and modes.matrix[3, 3] == 0.0 and modes.mean[0] == 0.0 and modes.delta[0] == 0.0


def bodies_behind_dampers():
    """Two bodies joined by a spring, a third and a fourth hung on by dampers alone: all drift, the last two stay where they are."""
    damping = np.zeros((4, 4))
    for k in (1, 2):
        damping[k : k + 2, k : k + 2] += 3.0 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    stiffness = np.zeros((4, 4))
    stiffness[:2, :2] = 1.7 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    stops = (Stop((1.0, 0.0, 0.0, 0.0), upper=0.2, restitution=0.95), Stop((0.0, 0.0, 1.0, 0.0), lower=-0.8, restitution=0.95))
    return ImpactSystem(np.diag([1.98, 1.42, 1.6, 0.21]), damping, stiffness, stops)


def test_a_translation_that_dampers_resist_only_in_rounding_is_free():
    """Of the three bodies' shapes without a spring one is the drift of all:
    no damper sees it, and its states are of the size of the others."""
    system = bodies_behind_dampers()
    modes = system.modes
    assert_blocks_are_the_system(system, 1e-14)
    assert np.abs(modes.to_state).max() < 10.0 and np.abs(modes.from_state).max() < 10.0
    motion = simulate(system, np.zeros(4), [-3.0, 1.1, -0.5, 1.2], 40.0)
    assert motion.status is MotionStatus.DURATION_REACHED and motion.balance_error < 1e-13


@pytest.mark.parametrize("offset", [-1e-3, -1e-8, -1e-12, 0.0, 1e-12, 1e-8, 1e-3])
def test_near_critical_damping_of_coupled_modes_stays_well_conditioned(offset):
    """A critically damped oscillator, weakly tied to an undamped one: no block is larger than a pair."""
    system = ImpactSystem(
        np.eye(2), [[2.0 + offset, 0.05], [0.05, 0.01]], [[1.0, 0.0], [0.0, 9.0]], (Stop((1.0, -1.0), -1.0, 1.0),)
    )
    assert system.modes.layout == "coupled"
    assert (system.modes.pairs[:, 1] >= -1).all()
    assert np.linalg.cond(system.modes.to_state) < 1e3
    assert_blocks_are_the_system(system, 200 * EPSILON)


def exceptional_point():
    """Two unit oscillators coupled by stiffness s, one damped by 2c: at c = s the two complex pairs nearly coalesce; where
    exactly is found by bisection on the discriminant-like gap of the eigenvalues, with mpmath."""
    s = 0.05

    def gap(c, e):
        a = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.array([[1.0 + e, -s], [-s, 1.0]]), -np.diag([2 * c, 0.0])]])
        values = np.linalg.eigvals(a)
        upper = values[values.imag > 0]
        return (upper[0] - upper[1]) ** 2

    # Newton in two unknowns (complex gap^2 = 0) by finite differences
    x = np.array([s, 0.0])
    for _ in range(60):
        f = gap(*x)
        step = 1e-7
        dc = (gap(x[0] + step, x[1]) - gap(x[0] - step, x[1])) / (2 * step)
        de = (gap(x[0], x[1] + step) - gap(x[0], x[1] - step)) / (2 * step)
        jacobian = np.array([[dc.real, de.real], [dc.imag, de.imag]])
        x = x - np.linalg.solve(jacobian, [f.real, f.imag])
        if abs(f) < 1e-15:
            break
    c, e = x
    return ImpactSystem(np.eye(2), np.diag([2 * c, 0.0]), [[1.0 + e, -s], [-s, 1.0]], (Stop((1.0, -1.0), -1.0, 1.0),))


def test_an_exceptional_point_becomes_one_larger_block():
    """Two complex pairs that coalesce into a Jordan block cannot be cut apart: condition and first-order matrix as oracle."""
    system = exceptional_point()
    assert system.modes.pairs.tolist() == [[0, -4]]
    assert np.linalg.cond(system.modes.to_state) < 100.0
    assert_blocks_are_the_system(system, 100 * EPSILON)


@settings(max_examples=25)
@given(st.integers(1, 8), st.integers(0, 2**31))
def test_cut_is_a_similarity(size, seed):
    """Random matrices, some with repeated and defective eigenvalues built in."""
    rng = np.random.default_rng(seed)
    core = np.triu(rng.normal(size=(size, size)), 1) + np.diag(rng.integers(-2, 3, size).astype(float))
    q, _ = np.linalg.qr(rng.normal(size=(size, size)))
    a = q @ core @ q.T
    blocks, forward, backward = cut(a)
    diagonal = np.zeros((size, size))
    start = 0
    for block in blocks:
        diagonal[start : start + len(block), start : start + len(block)] = block
        start += len(block)
    assert start == size
    growth = np.linalg.cond(forward)
    assert growth < 1e5
    np.testing.assert_allclose(forward @ diagonal @ backward, a, atol=1e-14 * growth * max(1.0, np.abs(a).max()) * size)


@pytest.mark.parametrize("n", [1, 2, 3, 6, 12])
def test_modes_of_changing_parameters(n):
    """Oracle: those of LAPACK. Where frequencies are far apart, shapes are known to rounding."""
    rng = np.random.default_rng(n)
    for _ in range(20):
        lower = np.tril(0.2 * rng.standard_normal((n, n)), -1) + np.diag(rng.uniform(0.5, 2.0, n))
        turned = np.linalg.qr(rng.standard_normal((n, n)))[0]
        mass, stiffness = lower @ lower.T, lower @ turned @ np.diag(np.arange(n) ** 2.0) @ turned.T @ lower.T
        stiffness = 0.5 * (stiffness + stiffness.T)
        squares, shapes = undamped_modes(mass, stiffness)
        wanted = eigh(stiffness, mass)
        wanted[1][:] *= np.sign(np.sum(wanted[1] * (mass @ shapes), axis=0))
        assert np.abs(squares - wanted[0]).max() < 1e-13 * n * max(1.0, wanted[0].max())
        assert np.abs(shapes - wanted[1]).max() < 1e-13 * n
