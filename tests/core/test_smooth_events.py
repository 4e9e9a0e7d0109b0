"""Events along flights with smooth forces in the compiled core. Oracles: roots of the polynomials of the steps, and elliptic functions."""

import math

import mpmath
import numpy as np
import pytest
import saltus_core as core
from scipy.special import ellipj, ellipk

from bvp.motion import EventKind
from bvp.multipoint import observed_of
from bvp.simulate import Simulator, simulate
from bvp.smooth_flights import core_flight
from bvp.springs import Spring
from bvp.system import ImpactSystem, Stop
from tests.core.smooth_systems import states


def stopped(n, power=3.0, restitution=1.0):
    """A chain with a spring of some power at its end, and stops there and between neighbours."""
    stiffness = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    rows = np.vstack([np.eye(n)[:1], np.diff(np.eye(n), axis=0)])
    stops = [Stop(tuple(row), -0.8, 0.9, restitution) for row in rows]
    springs = (Spring(tuple(rows[-1]), stiffness=2.0, power=power, nonlinear_only=True),)
    return ImpactSystem(np.eye(n), np.zeros((n, n)), stiffness, stops, springs=springs)


SYSTEMS = [stopped(1), stopped(2), stopped(2, 7), stopped(3, 2.5), stopped(5)]


def searches(system, count=8):
    """Flights, and their states and durations."""
    rng = np.random.default_rng(7)
    flight = core_flight(system)
    for z in states(system, count):
        yield flight, z, float(rng.choice([0.05, 0.7, 2.0, 6.0]))


def zeros(path, row):
    """Times inside a flight at which row . z is zero: the roots of its polynomials."""
    found = []
    for begin, end, step in zip(path.times[:-1], path.times[1:], path.coefficients, strict=True):
        h = end - begin
        roots = np.polynomial.Polynomial(step @ row * h ** np.arange(len(step))).roots()
        inside = roots.real[(np.abs(roots.imag) < 1e-12) & (roots.real > 0.0) & (roots.real <= 1.0)]
        found += [begin + h * x for x in sorted(inside) if begin + h * x < path.duration]
    return np.array(found)


@pytest.mark.parametrize("system", SYSTEMS)
def test_sign_changes_are_the_roots_of_the_polynomials(system):
    n, modes = system.degrees_of_freedom, system.modes
    for flight, z, duration in searches(system):
        path, found = flight.path(z, duration, True), np.zeros(50)
        for k in range(n):
            rows = np.array([modes.to_state[k], modes.to_state[n + k], np.zeros(2 * n)])
            expected = zeros(path, rows[0])
            falls = rows[0] @ z < 0.0
            assert core.sign_changes(flight, rows, z, duration) == (len(expected), -1 if (len(expected) + falls) % 2 else 1)
            assert core.crossing_times(flight, rows, z, duration, found) == len(expected)
            np.testing.assert_allclose(found[: len(expected)], expected, atol=1e-12 * duration)
            upwards = expected[int(not falls) :: 2]
            assert core.rises(flight, rows, z, duration, 0, found)[0] == len(upwards)
            np.testing.assert_allclose(found[: len(upwards)], upwards, atol=1e-12 * duration)


@pytest.mark.parametrize("system", SYSTEMS)
def test_clearances_are_at_the_roots_of_the_rates(system):
    observed = observed_of(system)
    for flight, z, duration in searches(system):
        path = flight.path(z, duration, True)
        for stop, (lower, upper) in enumerate(observed.bounds.T):
            rows = np.ascontiguousarray(observed.rows[stop])
            turns, rate = zeros(path, rows[1]), rows[1] @ z
            gaps = [rows[0] @ flight.end(z, t) for t in turns]
            tops = [(rate > 0.0) == (k % 2 == 0) for k in range(len(turns))]
            distances = [upper - w if top else w - lower for w, top in zip(gaps, tops, strict=True)]
            distance, side, time = core.clearance(flight, rows, lower, upper, z, duration)
            if not distances:
                assert distance == math.inf
                continue
            # Turning points of equal size differ by rounding.
            k = int(np.argmin(np.abs(turns - time)))
            assert abs(turns[k] - time) < 1e-7 * duration and side == (1.0 if tops[k] else -1.0)
            assert distance == pytest.approx(min(distances), abs=1e-13) and distances[k] == pytest.approx(distance, abs=1e-13)


@pytest.mark.parametrize("system", SYSTEMS)
def test_peaks_are_at_the_roots_of_the_velocities(system):
    n = system.degrees_of_freedom
    leave = np.ascontiguousarray(system.modes.to_state)
    for flight, z, duration in searches(system):
        peaks, when = np.zeros(n), np.zeros(n)
        assert core.raise_peaks(flight, leave[:n], leave[n:], z, duration, peaks, when)
        path = flight.path(z, duration, True)
        for i in range(n):
            times = [0.0, *zeros(path, leave[n + i]), duration]
            sizes = [abs(leave[i] @ (flight.end(z, t) if t else z)) for t in times]
            assert peaks[i] == pytest.approx(max(sizes), rel=1e-12)
            assert min(abs(t - when[i]) for t in times) < 1e-6 * duration
            assert abs(leave[i] @ (flight.end(z, when[i]) if when[i] else z)) == pytest.approx(peaks[i], rel=1e-12)


def test_zeros_and_peaks_of_an_elliptic_function():
    """x'' = -2 x - 2 x^3 from the top A moves as A cn(W t | m), W^2 = 2 (1 + A^2), m = A^2/(1 + A^2)/2: zeros at odd quarters."""
    system, amplitude = stopped(1), 0.7
    flight, modes = core_flight(system), system.modes
    frequency, m = math.sqrt(2.0 * (1.0 + amplitude**2)), amplitude**2 / (1.0 + amplitude**2) / 2.0
    quarter = ellipk(m) / frequency
    z = modes.from_state @ [amplitude, 0.0]
    sn, cn, dn, _ = ellipj(1.1 * frequency, m)
    np.testing.assert_allclose(modes.to_state @ flight.end(z, 1.1), [amplitude * cn, -amplitude * frequency * sn * dn], rtol=0, atol=1e-15)
    rows = np.array([modes.to_state[0], modes.to_state[1], np.zeros(2)])
    times = np.zeros(9)
    assert core.crossing_times(flight, rows, z, 8.5 * quarter, times) == 4
    np.testing.assert_allclose(times[:4], quarter * np.arange(1, 8, 2), rtol=1e-13)
    distance, side, time = core.clearance(flight, np.vstack([rows, np.zeros(2)]), -0.8, 0.9, z, 3.0 * quarter)
    assert (distance, side) == (pytest.approx(0.1, abs=1e-14), -1.0) and time == pytest.approx(2.0 * quarter, rel=1e-7)
    peaks, when = np.zeros(1), np.zeros(1)
    assert core.raise_peaks(flight, rows[:1], rows[1:2], modes.from_state @ [0.0, 0.3], 20.0, peaks, when)
    # H = v^2/2 + x^2 + x^4/2
    assert peaks[0] == pytest.approx(math.sqrt(math.sqrt(1.0 + 0.09) - 1.0), rel=1e-13)


def test_a_search_along_a_flight_without_an_end_gives_up():
    """Oracle: the answer."""
    system = stopped(1, 21.0)
    flight, z = core_flight(system), np.array([0.0, 1e150])
    rows = np.vstack([system.modes.to_state, np.zeros((2, 2))])
    assert core.sign_changes(flight, rows, z, 1.0)[0] == -1
    assert math.isnan(core.clearance(flight, rows, -1.0, 1.0, z, 1.0)[0])
    assert not core.raise_peaks(flight, rows[:1], rows[1:2], z, 1.0, np.zeros(1), np.zeros(1))
    linear, contacts = with_forces(system)
    assert core.next_impact(flight, linear, contacts, -1, False, np.array([0.0, 1e100]), 1.0)[0] == 5


def with_forces(system):
    """The linear part and the contacts of the states with forces, as a simulation without contacts that stick has them."""
    mode = Simulator(system).table.modes[0]
    pairs, matrix = mode["pairs"], mode["matrix"]
    zeros_ = np.zeros(len(pairs))
    mean = np.array([0.5 * (matrix[i, i] + matrix[j, j]) if j >= 0 else matrix[i, i] for i, j in pairs])
    delta = np.array([matrix[i, j] * matrix[j, i] if j >= 0 else 0.0 for i, j in pairs])
    linear = core.LinearFlight(pairs, mean + zeros_, delta, matrix, np.ones(len(matrix)))
    restitution = system.modes.contacts.restitution
    rows = mode["gap"], mode["rate"], mode["acceleration"], mode["side"], mode["bound"], mode["push"], restitution
    return linear, core.Contacts(*map(np.ascontiguousarray, rows))


@pytest.mark.parametrize("restitution", [1.0, 0.8])
@pytest.mark.parametrize(("n", "power"), [(1, 3.0), (2, 3.0), (3, 5.0), (2, 2.5)])
def test_the_impacts_of_a_motion(n, power, restitution):
    """Oracle: the simulator. From the state after each of its impacts the next one is found."""
    system = stopped(n, power, restitution)
    flight, (linear, contacts) = core_flight(system), with_forces(system)
    modes, found = system.modes, 0
    rng = np.random.default_rng(n)
    for _ in range(2):
        u, v = 0.1 * rng.normal(size=n), 2.0 * rng.normal(size=n)
        motion = simulate(system, u, v, 12.0)
        times, events = [0.0, *motion.times[1:]], motion.contacts
        for k in range(len(times)):
            kind = motion.kinds[k]
            if k > 0 and kind != EventKind.IMPACT.value:
                break
            z = modes.from_state @ (motion.start if k == 0 else motion.before[k])
            leaving = -1 if k == 0 else int(events[k])
            if leaving >= 0:
                z = z - (1.0 + restitution) * modes.contacts.push[leaving] * (modes.contacts.rate[leaving] @ z)
            horizon = 12.0 - times[k]
            status, contact, time = core.next_impact(flight, linear, contacts, leaving, False, z, horizon)
            if k + 1 == len(times):
                assert (status, contact, time) == (0, -1, horizon)
            elif motion.kinds[k + 1] == EventKind.IMPACT.value:
                assert (status, contact) == (1, events[k + 1])
                assert time == pytest.approx(times[k + 1] - times[k], abs=1e-11)
                found += 1
    assert found > 2


def test_the_next_impact_of_an_elliptic_function():
    """x'' = -2 x - 2 x^3 from the stop at 0.9, which it leaves at some speed: it meets the other one at -0.8 by the energy integral."""
    system = stopped(1)
    flight, (linear, contacts) = core_flight(system), with_forces(system)
    speed = 1.3
    z = system.modes.from_state @ [0.9, -speed]
    total = speed**2 + 2.0 * 0.9**2 + 0.9**4
    with mpmath.workdps(30):
        expected = float(mpmath.quad(lambda x: 1 / mpmath.sqrt(total - 2 * x**2 - x**4), [-0.8, 0, 0.9]))
    upper = int(np.flatnonzero(system.modes.contacts.side > 0.0)[0])
    status, contact, time = core.next_impact(flight, linear, contacts, upper, False, z, 50.0)
    assert (status, contact) == (1, 1 - upper) and time == pytest.approx(expected, rel=1e-14)
    # Slower than the height of the other stop: it comes back.
    z = system.modes.from_state @ [0.5, 0.0]
    assert core.next_impact(flight, linear, contacts, -1, False, z, 300.0) == (0, -1, 300.0)
    with pytest.raises(ValueError):
        core.next_impact(flight, core.LinearFlight(*system.modes.flight, np.ones(2)), contacts, -1, False, z, 1.0)
