"""Sign changes and turning points of functionals of a flight, by bounds.

Oracle: the flight sampled densely by numpy alone; between samples nothing is claimed, so cases are compared where the samples
resolve every turn. Polynomial flights (rigid-body modes) have roots known exactly.
"""

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from bvp.system import ImpactSystem, Stop
from tests.lab.paths import clearance, sign_changes

SAMPLES = 20001


def random_system(rng, n, damped):
    """Masses on springs, some of them loose (rigid-body modes), with damping where asked for, proportional to mass or not."""
    mass = np.diag(rng.uniform(0.1, 2.0, n))
    stiffness = np.zeros((n, n))
    for i in range(n - 1):
        if rng.random() < 0.8:
            stiffness[i : i + 2, i : i + 2] += rng.uniform(0.1, 3.0) * np.array([[1.0, -1.0], [-1.0, 1.0]])
    if rng.random() < 0.5:
        stiffness[0, 0] += 1.0
    damping = rng.choice([0.1, 2.0]) * rng.uniform(0.0, 1.0) * mass if damped else np.zeros((n, n))
    if damped and rng.random() < 0.5:
        damping[-1, -1] += rng.uniform(0.0, 0.5)
    row = np.zeros(n)
    row[0] = 1.0
    if n > 1:
        row[1] = -1.0
    return ImpactSystem(mass, damping, stiffness, (Stop(tuple(row), -1.0, 1.0),))


def dense(modes, value, z, duration):
    """Samples of value . z(t) by powers of scipy's matrix exponential: (times, values)."""
    times = np.linspace(0.0, duration, SAMPLES)
    power = expm(modes.matrix * times[1])
    states = np.empty((SAMPLES, len(z)))
    states[0] = z
    filled = 1
    while filled < SAMPLES:
        count = min(filled, SAMPLES - filled)
        states[filled : filled + count] = states[:count] @ power.T
        filled += count
        power = power @ power
    return times, states @ value


def resolved(values, margin=1e-6):
    """True where every turning point of the samples, and both ends, keep a clear distance from zero."""
    turns = (values[1:-1] - values[:-2]) * (values[2:] - values[1:-1]) <= 0.0
    size = np.max(np.abs(values))
    critical = np.concatenate([[values[0], values[-1]], values[1:-1][turns]])
    return size > 1e-6 and np.min(np.abs(critical)) > margin * size


@settings(max_examples=30)
@given(st.integers(1, 4), st.booleans(), st.booleans(), st.floats(0.1, 40.0), st.integers(0, 2**32 - 1))
def test_sign_changes_against_dense_samples(n, damped, velocity, duration, seed):
    rng = np.random.default_rng(seed)
    system = random_system(rng, n, damped)
    row = np.zeros(2 * n)
    row[n if velocity else 0] = 1.0
    modes = system.modes
    z = modes.from_state @ rng.normal(size=2 * n)
    _, values = dense(modes, modes.to_state.T @ row, z, duration)
    assume(resolved(values))
    expected = int(np.sum(values[:-1] * values[1:] < 0.0))
    found, sign = sign_changes(system, row, z, duration)
    assert found == expected
    assert sign == np.sign(values[-1])


@settings(max_examples=30)
@given(st.integers(1, 4), st.booleans(), st.floats(0.1, 40.0), st.integers(0, 2**32 - 1))
@example(n=1, damped=False, duration=0.1, seed=0)
@example(n=3, damped=True, duration=30.0, seed=755)
def test_clearance_against_dense_samples(n, damped, duration, seed):
    rng = np.random.default_rng(seed)
    system = random_system(rng, n, damped)
    modes = system.modes
    gap = modes.to_state.T @ np.concatenate([system.stops[0].gap, np.zeros(n)])
    z = modes.from_state @ (0.5 * rng.normal(size=2 * n))
    _, rates = dense(modes, gap @ modes.matrix, z, duration)
    assume(resolved(rates))
    times, gaps = dense(modes, gap, z, duration)
    up = np.flatnonzero((rates[:-1] > 0.0) & (rates[1:] < 0.0))
    down = np.flatnonzero((rates[:-1] < 0.0) & (rates[1:] > 0.0))
    expected = min([1.0 - max(gaps[i], gaps[i + 1]) for i in up] + [min(gaps[i], gaps[i + 1]) + 1.0 for i in down], default=np.inf)
    distance, side, time = clearance(system, z, duration)
    if np.isinf(expected):
        assert np.isinf(distance)
        return
    spacing = times[1] * np.max(np.abs(rates))
    assert distance <= expected + 1e-9 * (1.0 + abs(expected))
    assert distance >= expected - spacing
    i = int(np.searchsorted(times, time))
    near = gaps[max(0, i - 1) : i + 2]
    assert np.min(np.abs(1.0 - side * near - distance)) < 2.0 * spacing + 1e-9


def test_polynomial_flight_has_its_exact_turning_points():
    """Two free bodies and no spring: w = t - 0.3 never turns and changes its sign once; a constant has no sign change."""
    system = ImpactSystem(np.eye(2), np.zeros((2, 2)), np.zeros((2, 2)), (Stop((1.0, -1.0), -1.0, 1.0),))
    row = np.array([1.0, -1.0, 0.0, 0.0])
    z = system.modes.from_state @ np.array([-0.3, 0.0, 1.0, 0.0])
    assert sign_changes(system, row, z, 0.9) == (1, 1)
    assert sign_changes(system, row, z, 0.29) == (0, -1)
    assert sign_changes(system, row, z, 0.29, 1) == (1, -1)
    distance, _, _ = clearance(system, z, 0.9)
    assert np.isinf(distance)


def test_nearly_double_roots_are_separate():
    """w = cos(2t) + level: two sign changes inside a dip of depth 1e-9, none when it stays above by 1e-9 (closed form)."""
    system = ImpactSystem(np.diag([1.0, 1.0]), np.zeros((2, 2)), np.diag([4.0, 0.0]), (Stop((1.0, 1.0), -3.0, 3.0),))
    for excess, changes in ((-1e-9, 2), (1e-9, 0)):
        z = system.modes.from_state @ np.array([1.0, 1.0 + excess, 0.0, 0.0])
        assert sign_changes(system, np.array([1.0, 1.0, 0.0, 0.0]), z, 3.0)[0] == changes


def test_clearance_of_a_grazing_flight_to_rounding():
    """w = A sin t turns at A: the distance to the bound 1 is 1 - A, however small (closed form)."""
    system = ImpactSystem([[1.0]], [[0.0]], [[1.0]], (Stop((1.0,), -1.0, 1.0),))
    modes = system.modes
    for gap in (1e-3, 1e-9, 1e-14, -1e-9):
        z = modes.from_state @ np.array([0.0, 1.0 - gap])
        distance, side, time = clearance(system, z, 3.0)
        assert abs(distance - gap) < 4e-16 and side == 1.0 and abs(time - np.pi / 2) < 1e-7
        distance, side, time = clearance(system, z, 6.0)
        assert abs(distance - gap) < 4e-16


def test_of_equal_turning_points_the_first_counts():
    """Oracle: w = A cos(t - a) turns at t = a, a + pi, ...: at 0.9, on either side. Rounding makes one of them the nearest."""
    system = ImpactSystem([[1.0]], [[0.0]], [[1.0]], (Stop((1.0,), -1.0, 1.0),))
    modes = system.modes
    for angle in np.linspace(0.05, 3.1, 40):
        z = modes.from_state @ np.array([0.9 * np.cos(angle), 0.9 * np.sin(angle)])
        for side in (1.0, -1.0):
            distance, found, time = clearance(system, side * z, 40.0, first_of_equal=True)
            assert distance == pytest.approx(0.1, abs=1e-14) and found == side and abs(time - angle) < 1e-7
