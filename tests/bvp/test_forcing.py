"""Loads. Oracles: mpmath's exponential of the system joined with its load at 50 digits, closed forms of resonance, of a ramp and of a free
particle, and the equation of motion itself."""

import math
from functools import partial

import mpmath
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from bvp.forcing import Constant, Harmonic, Record, forcing_of, ground_load
from bvp.motion import EventKind
from bvp.simulate import Simulator, simulate
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from tests.bvp.twins import first_order

FAR = 1e6


def far(mass, damping, stiffness, bound=FAR):
    """A system with a stop that is not reached."""
    n = len(mass)
    return ImpactSystem(mass, damping, stiffness, (Stop((1.0,) + (0.0,) * (n - 1), upper=bound),))


def joined(system, forces):
    """The matrix of (u, v) joined with the states of constant and harmonic loads, and these states at time 0, in mpmath numbers."""
    n, forcing = system.degrees_of_freedom, forcing_of(forces, system.degrees_of_freedom)
    inverse = mpmath.matrix(system.mass.tolist()) ** -1
    a = mpmath.zeros(2 * n + 2 * len(forcing.loads))
    a[:n, n : 2 * n] = mpmath.eye(n)
    a[n : 2 * n, :n] = -inverse * mpmath.matrix(system.stiffness.tolist())
    a[n : 2 * n, n : 2 * n] = -inverse * mpmath.matrix(system.damping.tolist())
    for g, frequency in enumerate(map(float, forcing.frequency)):
        at = 2 * n + 2 * g
        a[n : 2 * n, at : at + 2] = inverse * mpmath.matrix(forcing.loads[g].tolist())
        a[at, at + 1], a[at + 1, at] = -mpmath.mpf(frequency), mpmath.mpf(frequency)
    return a, [mpmath.mpf(1), mpmath.mpf(0)] * len(forcing.loads)


def exact(system, force, u, v, t):
    """(u, v) at t under one constant or harmonic load, by the exponential of the joined system at 50 digits."""
    with mpmath.workdps(60):
        a, loads = joined(system, force)
        start = mpmath.matrix([*map(mpmath.mpf, map(float, [*u, *v])), *loads])
        return np.array((mpmath.expm(a * mpmath.mpf(t)) * start).tolist(), dtype=float)[: 2 * len(u), 0]


@pytest.mark.parametrize("detuning", [0.0, -1e-9, 0.03])
@pytest.mark.parametrize("damping", [0.0, 0.05, 2.1])
def test_a_load_near_resonance(detuning, damping):
    """Oracle: see `require_a_load_near_resonance`."""
    require_a_load_near_resonance(detuning, damping)


def require_a_load_near_resonance(detuning, damping):
    """w = 1 + detuning on an oscillator of frequency 1, through critical damping: no digits are lost at, above or below resonance."""
    system, force = far([[1.0]], [[damping]], [[1.0]]), Harmonic(1.0 + detuning, cosine=[0.3], sine=[-0.2])
    for t in (1e-3, 0.7, 20.0, 300.0):
        final = simulate(system, [0.1], [0.2], t, forces=force).final
        reference = exact(system, force, [0.1], [0.2], t)
        assert np.abs(final - reference).max() <= 4e-16 * (8.0 + 30.0 * t) * max(1.0, np.abs(reference).max())


def test_undamped_resonance_grows_as_its_closed_form():
    """u'' + u = cos t from rest: u = t sin(t)/2, and the load's work is the energy."""
    motion = simulate(far([[1.0]], [[0.0]], [[1.0]]), [0.0], [0.0], 50.0, forces=Harmonic(1.0, cosine=[1.0]))
    times = np.linspace(0.0, 50.0, 41)
    u, v = motion.sample(times)
    np.testing.assert_allclose(u[:, 0], times * np.sin(times) / 2, atol=2e-13)
    np.testing.assert_allclose(v[:, 0], (np.sin(times) + times * np.cos(times)) / 2, atol=2e-13)
    np.testing.assert_allclose(motion.spent(times)[:, -1], motion.system.energy(u, v), rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("k", [0.0, 1e-14, 1e-9, 1e-4, 1.0])
@pytest.mark.parametrize("c", [0.0, 1e-8, 0.4])
def test_a_constant_load_on_a_stiffness_that_vanishes(k, c):
    system = ImpactSystem([[2.0]], [[c]], [[k]], (Stop((1.0,), lower=-10.0),))
    for t in (0.01, 3.0, 40.0):
        final = simulate(system, [0.1], [0.2], t, forces=Constant([0.7])).final
        reference = exact(system, Constant([0.7]), [0.1], [0.2], t)
        np.testing.assert_allclose(final, reference, rtol=2e-14, atol=1e-15)


@settings(max_examples=12, deadline=None)
@given(st.integers(1, 3), st.integers(0, 2**31), st.floats(-3, 0.5), st.floats(0.05, 4.0))
def test_random_systems_under_harmonic_loads(n, seed, size, frequency):
    rng = np.random.default_rng(seed)
    half, root = rng.normal(size=(n, n)), rng.normal(size=(n, n))
    system = far(np.diag(rng.uniform(0.3, 3.0, n)), 10.0**size * half @ half.T, root @ root.T)
    force = Harmonic(frequency, cosine=rng.normal(size=n), sine=rng.normal(size=n))
    u, v = rng.normal(size=(2, n))
    motion = simulate(system, u, v, 9.0, forces=force)
    fastest = np.abs(np.linalg.eigvals(first_order(system))).max()
    reference = exact(system, force, u, v, 9.0)
    assert np.abs(motion.final - reference).max() <= 1e-13 * (1.0 + fastest) ** 2 * max(1.0, np.abs(reference).max())
    assert abs(motion.balance) <= 1e-13 * (motion.initial_energy + motion.totals[:-1].sum() + abs(motion.work)) * (1.0 + fastest)


def test_a_record_is_integrated_exactly_between_its_samples():
    """u'' = s(t) with s linear between samples: u by the cubic of each piece, in rational numbers."""
    times, values = [0.0, 0.5, 0.75, 2.0], [1.0, -1.0, 4.0, 0.0]
    motion = simulate(far([[1.0]], [[0.0]], [[0.0]]), [0.25], [-0.5], 3.0, forces=Record([1.0], times, values))
    u, v = 0.25, -0.5
    for k in range(3):
        h, slope = times[k + 1] - times[k], (values[k + 1] - values[k]) / (times[k + 1] - times[k])
        u += v * h + values[k] * h * h / 2 + slope * h**3 / 6
        v += values[k] * h + slope * h * h / 2
    np.testing.assert_allclose(motion.sample([2.0])[0], [[u]], rtol=1e-14)
    np.testing.assert_allclose(motion.final, [u + v, v], rtol=1e-14)
    assert [EventKind(kind).name for kind in motion.kinds] == ["START", "BREAK", "BREAK", "BREAK"]
    assert motion.balance_error < 1e-14


def test_a_finely_sampled_sine_is_its_harmonic_to_second_order():
    """The record of sin(2 t) with steps h and h/2: the differences from the harmonic load fall by four; impacts on the way."""
    system = vibro_impact_nes(0.1, 0.1, 0.05, 0.7)
    smooth = simulate(system, [0.0, 0.0], [0.0, 3.0], 12.0, forces=Harmonic(2.0, sine=[0.0, 1.0]))
    assert smooth.impacts > 3
    error = []
    for count in (1200, 2400):
        times = np.linspace(0.0, 12.0, count + 1)
        motion = simulate(system, [0.0, 0.0], [0.0, 3.0], 12.0, forces=Record([0.0, 1.0], times, np.sin(2.0 * times)))
        assert motion.impacts == smooth.impacts and motion.balance_error < 1e-12
        error.append(np.abs(motion.final - smooth.final).max())
    assert error[0] < 1e-3 and error[0] / error[1] == pytest.approx(4.0, rel=0.02)


def test_a_gap_that_a_ramp_closes():
    """u'' + u = t/4 from rest: u = (t - sin t)/4 meets 1/2 where t - sin t = 2."""
    system = ImpactSystem([[1.0]], [[0.0]], [[1.0]], (Stop((1.0,), upper=0.5, restitution=0.5),))
    motion = simulate(system, [0.0], [0.0], 4.0, forces=Record([1.0], [0.0, 10.0], [0.0, 2.5]))
    root = float(mpmath.findroot(lambda t: t - mpmath.sin(t) - 2, 2.5))
    assert motion.times[1] == pytest.approx(root, rel=1e-15)
    assert motion.speeds[1] == pytest.approx((1 - math.cos(root)) / 4, rel=1e-14)


def test_steady_vibration_with_one_impact_a_period():
    """x'' + x = cos(w t), stop x <= s, one impact in T = 2 pi n/w (closed form): started on it, it stays for eight periods.

    It is unstable (its multipliers have the product r^2, and one of them is near -3), so rounding would be seen after twenty.
    V, the speed of approach, from (C^2 + R^2) V^2/4 + C s V + s^2 - gamma^2 = 0 with gamma = 1/(1 - w^2), C = (1 + r) sin T/(1 - cos T),
    R = (1 - r)/w."""
    w, r, s = 2.8, 0.8, 0.0
    period = 2 * math.pi / w
    gamma = 1 / (1 - w * w)
    c, big = (1 + r) * math.sin(period) / (1 - math.cos(period)), (1 - r) / w
    speed = 2 * abs(gamma) / math.hypot(c, big)
    assert speed == pytest.approx(0.3361772699757, rel=1e-12)
    # over one period x closes, a (1 - cos T) = b sin T, and its rate goes from -r V to V: b (1 - cos T) + a sin T = -(1 + r) V
    b = -(1 + r) * speed / 2
    a = b * math.sin(period) / (1 - math.cos(period))
    cosine = (s - a) / gamma
    sine = -(b + r * speed) / (w * gamma)
    assert cosine * cosine + sine * sine == pytest.approx(1.0, rel=1e-12)
    # x = gamma (cosine cos(w t) + sine sin(w t)) + a cos t + b sin t, so the load is cosine cos(w t) + sine sin(w t)
    system = ImpactSystem([[1.0]], [[0.0]], [[1.0]], (Stop((1.0,), upper=s, restitution=r),))
    motion = simulate(system, [s], [-r * speed], 8.5 * period, forces=Harmonic(w, cosine=[cosine], sine=[sine]), leaving="+")
    assert motion.impacts == 8
    np.testing.assert_allclose(motion.times[1:], period * np.arange(1, 9), rtol=1e-11)
    np.testing.assert_allclose(motion.speeds[1:], speed, rtol=1e-10)


def test_a_body_on_a_shaking_table_lifts_off_where_the_table_falls_faster_than_it():
    """u >= 0 above a table moving as A sin(w t): u'' = -g + A w^2 sin(w t), at rest until sin(w t) = g/(A w^2)."""
    system = ImpactSystem([[1.0]], [[0.0]], [[0.0]], (Stop((1.0,), lower=0.0, restitution=0.4),))
    forces = [Constant([-1.0]), Harmonic(2.0, sine=[1.6])]
    motion = simulate(system, [0.0], [0.0], 40.0, forces=forces)
    assert EventKind(motion.kinds[1]) is EventKind.STICK and EventKind(motion.kinds[2]) is EventKind.RELEASE
    assert motion.times[2] == pytest.approx(math.asin(1 / 1.6) / 2, rel=1e-14)
    assert sum(kind == EventKind.RELEASE.value for kind in motion.kinds) > 5
    u, _ = motion.sample(np.linspace(0.0, 40.0, 4001))
    assert u.min() >= -1e-13
    assert abs(motion.balance) <= 1e-13 * motion.totals[:-1].sum()


def test_ground_motion_moves_the_masses_against_the_ground():
    system = vibro_impact_nes(mu=0.2)
    np.testing.assert_array_equal(ground_load(system), [-0.2, -1.0])
    np.testing.assert_array_equal(ground_load(system, [0.0, 1.0]), [0.0, -1.0])


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Harmonic(1.0), "a harmonic load has cosine, sine or both"),
        (lambda: Record([1.0], [0.0, 0.0], [1.0, 2.0]), "the times of a record ascend; received 0 before 0"),
        (lambda: Record([1.0], [0.0, 1.0], [1.0]), "as many values as times"),
        (lambda: forcing_of([Constant([1.0, 2.0])], 1), "an entry for each of 1 coordinates; received 2"),
        (lambda: forcing_of("wind", 1), "forces is a list of Constant, Harmonic and Record loads; received 'wind'"),
        (lambda: Simulator(vibro_impact_nes(lam=0.1), dampers={"a": np.zeros((2, 2))}), "damping matrix; entry 2,2 is 0.1, theirs 0"),
    ],
)  # fmt: skip
def test_bad_loads_are_refused(make, words):
    with pytest.raises(ValueError, match=words):
        make()


def dense_first_crossing(system, forces, u, v, horizon, step):
    """First time at which a gap passes a bound, or None: the joined system of all loads at 50 digits, stepped densely, minima between steps
    by their parabola, the crossing between two steps to 1e-30."""
    with mpmath.workdps(50):
        a, loads = joined(system, forces)
        z = mpmath.matrix([*map(mpmath.mpf, map(float, [*u, *v])), *loads])
        step, horizon = mpmath.mpf(step), mpmath.mpf(horizon)
        flow = mpmath.expm(a * step)

        def distance(z):
            return min(
                side * (bound - sum(c * z[i] for i, c in enumerate(stop.gap)))
                for stop in system.stops
                for side, bound in ((-1, stop.lower), (1, stop.upper))
                if math.isfinite(bound)
            )

        def later(z, t):
            return distance(mpmath.expm(a * t) * z)

        time, last, before = mpmath.mpf(0), distance(z), None
        while time < horizon:
            following = flow * z
            now = distance(following)
            if before is not None and last <= min(before, now) and last < abs(before - last) + abs(now - last):
                return "close"
            if now < 0:
                return float(time + mpmath.findroot(partial(later, z), (0, step), solver="anderson", tol=1e-64))
            z, time, before, last = following, time + step, last, now
        return None


@settings(max_examples=12, deadline=None)
@given(st.integers(1, 2), st.integers(0, 2**31), st.floats(-2, 0.3))
@example(2, 2802, 4e-12)
def test_no_impact_of_a_forced_motion_is_missed(n, seed, size):
    """The first impact against a dense search at 50 digits; motions that come within a step's change of a stop without a hit are left
    out."""
    rng = np.random.default_rng(seed)
    half, root = rng.normal(size=(n, n)), rng.normal(size=(n, n))
    stops = (Stop(tuple(rng.normal(size=n)), -1.0, rng.uniform(0.5, 2.0)),)
    system = ImpactSystem(np.diag(rng.uniform(0.3, 2.0, n)), 10.0**size * half @ half.T, root @ root.T, stops)
    forces = [Harmonic(rng.uniform(0.3, 4.0), cosine=rng.normal(size=n)), Constant(0.3 * rng.normal(size=n))]
    v = 0.5 * rng.normal(size=n)
    expected = dense_first_crossing(system, forces, np.zeros(n), v, 8.0, 0.02)
    motion = simulate(system, np.zeros(n), v, 8.0, forces=forces, max_impacts=1)
    if expected is None:
        assert motion.impacts == 0
    elif expected != "close":
        assert motion.impacts == 1
        assert abs(motion.last_impact - expected) * max(motion.speeds[1], 1e-6) <= 1e-13 * (1.0 + np.abs(motion.final).max())
