"""Sign changes, crossings, clearances and peaks of the compiled core. Oracle: the searches of `bvp.kernels.extrema`, and a closed form."""

import math

import numpy as np
import pytest
import saltus_core as core

from bvp.kernels import extrema as kernels
from bvp.kernels.impact import work_array
from bvp.multipoint import observed_of
from bvp.system import ImpactSystem, Stop
from tests.bvp.test_extrema import random_system
from tests.bvp.test_impact import oscillator
from tests.bvp.test_impact import random_system as full_system
from tests.bvp.test_modes import exceptional_point
from tests.core.test_next_impact import Searches


def systems():
    """Systems without and with damping, free bodies, motion that grows, coalescing pairs."""
    rng = np.random.default_rng(3)
    for n in (1, 2, 3, 5):
        yield from (random_system(rng, n, damped) for damped in (False, True))
        yield from (full_system(rng, n, damping, shift) for damping in (0.0, 0.01, 5.0) for shift in (0.0, 0.5))
    yield from (oscillator(-1.0, 1.0, k=k, c=c) for k in (-1.0, 0.0, 1.0) for c in (0.0, 0.5, 2.0, -0.3))
    yield exceptional_point()


def arrays(system, row):
    """The functional w = row . (u, v) on the states of a system's flights, with its first two derivatives."""
    value = np.ascontiguousarray(system.modes.to_state.T @ row)
    rate = np.ascontiguousarray(value @ system.modes.matrix)
    return value, rate, np.ascontiguousarray(rate @ system.modes.matrix)


def trials(system, count=10):
    """The searches for a system, with states, durations and functionals."""
    rng = np.random.default_rng(5)
    size = 2 * system.degrees_of_freedom
    for _ in range(count):
        z = system.modes.from_state @ (0.6 * rng.normal(size=size) * rng.choice([0.0, 1.0, 1.0, 1.0], size=size))
        rows = arrays(system, np.eye(size)[rng.integers(size)])
        yield z, float(rng.choice([0.01, 0.3, 3.0, 20.0])), rows


@pytest.mark.parametrize("a", [0.3, -0.6])
@pytest.mark.parametrize("depth", [sign * 10.0**-k for k in range(1, 11) for sign in (1.0, -1.0)])
def test_short_dips_below_zero_are_counted(a, depth):
    """Oracle: (cos t - a)^2 - depth is zero where cos t = a +- sqrt(depth). Two zeros are up to 1e-5 apart, or there are none."""
    system = ImpactSystem(np.eye(3), np.zeros((3, 3)), np.diag([0.0, 1.0, 4.0]), (Stop((1.0, 0.0, 0.0), -1.0, 1.0),))
    z = system.modes.from_state @ np.array([0.5 + a * a - depth, -2.0 * a, 0.5, 0.0, 0.0, 0.0])
    angles = [math.acos(a + side * math.sqrt(depth)) for side in (-1.0, 1.0)] if depth > 0.0 else []
    times = sorted(t for angle in angles for turn in range(4) for t in (math.tau * turn + angle, math.tau * (turn + 1) - angle) if t < 20.0)
    rows, flight, found = np.array(arrays(system, np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]))), Searches(system).flight, np.zeros(20)
    assert core.sign_changes(flight, rows, z, 20.0, 0, False, False)[0] == len(times)
    assert core.crossing_times(flight, rows, z, 20.0, found) == len(times)
    np.testing.assert_allclose(found[: len(times)], times, atol=1e-13 / math.sqrt(abs(depth)))


def changes_between_samples(flight, rows, z, duration):
    """(sign changes, last sign) of the functional, by samples that are dense at the ends; what is zero but for rounding has no sign.
    None where a motion grows or decays by more than six digits: rounding decides there, or the search gives up."""
    near, times = np.geomspace(1e-12, 1e-3, 200), np.linspace(0.0, 1.0, 4001)
    states = core.sample(flight, z, duration * np.sort(np.concatenate([times, near, 1.0 - near])))
    sizes, values = np.abs(states).max(axis=1), states @ rows[0]
    if sizes.max() > 1e6 * sizes.min() or np.abs(values).max() > 1e12 * np.abs(values[-1]) > 0.0:
        return None
    signs = np.sign(values[np.abs(values) > 1e-14 * sizes.max() * np.linalg.norm(rows[0])])
    return (int(np.count_nonzero(np.diff(signs))), int(signs[-1])) if len(signs) else (0, 0)


@pytest.mark.parametrize("system", list(systems()))
def test_sign_changes_are_those_between_many_samples(system):
    """Oracles: samples; the values at the times that are found; of rises, the kernels. An end where f is zero has no sign of its own."""
    flight, core_flight = system.modes.flight, Searches(system).flight
    for z, duration, rows in trials(system):
        at_zero = z - rows[0] * (rows[0] @ z) / (rows[0] @ rows[0])
        before = core_flight.end(at_zero, -duration)
        simple = bool(abs(rows[1] @ at_zero) > 1e-6)  # the sign beside a double zero is that of rounding
        comes_back = simple and np.allclose(core_flight.end(before, duration), at_zero, rtol=0.0, atol=1e-9)
        vanishes = bool(abs(rows[0] @ z) <= 1e-14 * np.linalg.norm(rows[0]) * np.linalg.norm(z))
        for state, begins, ends in ((z, vanishes, False), *[(at_zero, True, False)] * simple, *[(before, False, True)] * comes_back):
            expected = changes_between_samples(core_flight, rows, state, duration)
            assert core.sign_changes(core_flight, np.array(rows), state, duration, 0, begins, ends) == expected or expected is None
        times, found = np.zeros(400), np.zeros(400)
        count = core.crossing_times(core_flight, np.array(rows), z, duration, found)
        expected = changes_between_samples(core_flight, rows, z, duration)
        assert vanishes or expected is None or count == expected[0]
        states = core.sample(core_flight, z, found[: max(count, 0)])
        assert np.all(np.abs(states @ rows[0]) <= 1e-11 * np.abs(states).max(axis=0, initial=1.0) @ np.abs(rows[0]))
        found[:] = 0.0
        expected = kernels.rises(flight, *rows, z, duration, -1, times, np.empty(len(z)))
        assert core.rises(core_flight, np.array(rows), z, duration, -1, found) == expected
        np.testing.assert_allclose(found, times, atol=1e-11 * duration)


@pytest.mark.parametrize("system", list(systems()))
def test_clearances_are_those_of_the_kernels(system):
    both, observed = Searches(system), observed_of(system)
    for z, duration, _ in trials(system):
        for stop, (lower, upper) in enumerate(observed.bounds.T):
            rows = np.ascontiguousarray(observed.rows[stop])
            tie = kernels.tie_of(rows[0], rows[1], z, z, duration)
            expected = kernels.clearance(both.modes.flight, observed, stop, z, duration, tie, math.inf, np.empty((2, len(z))))
            found = core.clearance(both.flight, rows, lower, upper, z, duration, tie)
            np.testing.assert_allclose(found[0], expected[0], rtol=1e-12, atol=1e-12)
            assert found[1] == expected[1]
            assert found[2] == pytest.approx(expected[2], abs=1e-6 * duration)


@pytest.mark.parametrize("system", list(systems()))
def test_peaks_are_those_of_the_kernels(system):
    both, n = Searches(system), system.degrees_of_freedom
    leave = np.ascontiguousarray(system.modes.to_state)
    for z, duration, _ in trials(system):
        for least in (0.0, 0.3):
            peaks, when = np.full((2, n), least), np.zeros((2, n))
            scratch = np.zeros((kernels.PEAK_ROWS, 1, 2 * n)), np.zeros((2, 1)), work_array(2 * n, 1)
            assert kernels.peak_flight(both.modes.flight, leave, z, duration, peaks[0], when[0], *scratch)
            assert core.raise_peaks(both.flight, leave[:n], leave[n:], z, duration, peaks[1], when[1])
            np.testing.assert_allclose(peaks[1], peaks[0], rtol=1e-13, atol=1e-13 * peaks.max())


@pytest.mark.parametrize("amplitude", [1e-6, 1.0])
@pytest.mark.parametrize("turns", [0.4, 0.6, 5000.3])
def test_the_peak_of_one_mode(amplitude, turns):
    """u = A sin t: its first peak A is at pi/2, however long the flight; before it the peak is at the end."""
    system = oscillator(-2.0, 2.0)
    peaks, when = np.zeros(1), np.zeros(1)
    flight, to_state = Searches(system).flight, system.modes.to_state
    duration = turns * math.pi
    z = system.modes.from_state @ [0.0, amplitude]
    assert core.raise_peaks(flight, np.ascontiguousarray(to_state[:1]), np.ascontiguousarray(to_state[1:]), z, duration, peaks, when)
    assert peaks[0] == pytest.approx(amplitude * math.sin(min(duration, math.pi / 2)), rel=1e-14)
    assert when[0] == pytest.approx(min(duration, math.pi / 2), abs=1e-6)


def test_sizes_are_checked_at_the_border():
    system = oscillator(-1.0, 1.0)
    flight, z = Searches(system).flight, np.zeros(2)
    for rows, state in ((np.zeros((2, 2)), z), (np.zeros((3, 3)), z), (np.zeros((3, 2)), np.zeros(3))):
        with pytest.raises(ValueError):
            core.sign_changes(flight, rows, state, 1.0)
    with pytest.raises(ValueError):
        core.raise_peaks(flight, np.zeros((1, 2)), np.zeros((1, 2)), z, 1.0, np.zeros(2), np.zeros(0))
