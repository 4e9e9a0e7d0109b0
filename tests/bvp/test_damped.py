"""Damped and forced motions. Oracles: closed forms of bouncing, chattering, release and steady vibration, the balance of energies, the
conservative run, and scipy's integrator."""

import math

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks import backbone
from bvp.forcing import Constant, Harmonic
from bvp.motion import EventKind, MotionStatus
from bvp.simulate import simulate
from bvp.system import ImpactSystem, Stop, vibro_impact_nes

EPSILON = float(np.finfo(float).eps)


def ball(restitution, k=0.0, c=0.0, lower=0.0):
    return ImpactSystem([[1.0]], [[c]], [[k]], (Stop((1.0,), lower, restitution=restitution),))


@pytest.mark.parametrize("restitution", [0.01, 0.3, 0.5, 0.7, 0.9, 0.99])
@pytest.mark.parametrize("gravity", [1.0, 9.81])
def test_chatter_accumulates_at_its_closed_form_time(restitution, gravity):
    """A particle under constant load: the first impact with v = sqrt(2 g h), rest 2 v r/(g (1 - r)) after it; all energy goes to the
    stop."""
    motion = simulate(ball(restitution), [0.5], [0.0], 3000.0, forces=Constant([-gravity]))
    speed = math.sqrt(gravity)
    rest = speed / gravity + 2.0 * speed * restitution / (gravity * (1.0 - restitution))
    assert motion.status is MotionStatus.DURATION_REACHED
    assert motion.kinds[-1] == EventKind.STICK.value
    assert abs(motion.times[-1] - rest) <= 1e-10 * max(1.0, 0.01 / (1 - restitution))
    assert motion.switch_error <= 1e-10
    assert motion.sticking_time == pytest.approx(3000.0 - rest, rel=1e-12)
    assert motion.work == pytest.approx(0.5 * gravity, rel=1e-12)
    assert motion.dissipated["stop a"] == pytest.approx(0.5 * gravity, rel=1e-12)
    assert motion.balance_error < 1e-12
    np.testing.assert_allclose(motion.final, 0.0, atol=1e-12)


def bouncing_on(c, bound, restitution, u):
    """u'' + c u' + u = 0 let go at u on u >= bound: time of the end of its bounces, and the loss at the stop, in 40 digits, bounce by
    bounce."""
    with mpmath.workdps(40):
        c, bound, restitution, u = (mpmath.mpf(x) for x in (c, bound, restitution, u))
        w = mpmath.sqrt(1 - c * c / 4)

        def motion(u, v, t):
            e = mpmath.exp(-c * t / 2)
            s, k = mpmath.sin(w * t) / w, mpmath.cos(w * t)
            return e * (u * k + (v + c * u / 2) * s), e * (v * k - (u + c * v / 2) * s)

        v, time, lost, guess = mpmath.mpf(0), mpmath.mpf(0), mpmath.mpf(0), mpmath.mpf(1)
        while True:
            early, late = guess / 20, guess / 10
            while motion(u, v, late)[0] > bound:
                early, late = late, late + guess / 20
            flight = mpmath.findroot(lambda t, u=u, v=v: (motion(u, v, t)[0] - bound) / t, (early, late), solver="anderson")
            u, v = motion(u, v, flight)
            time += flight
            lost += (1 - restitution**2) * v * v / 2
            u, v = bound, -restitution * v
            guess = 2 * v / bound
            if v < mpmath.mpf(10) ** -13:
                return float(time + guess / (1 - restitution)), float(lost + v * v / 2)


@pytest.mark.parametrize("restitution", [0.1, 0.5, 0.7, 0.9])
def test_chatter_under_a_force_that_changes_ends_where_all_of_its_bounces_end(restitution):
    """The oscillator pressed on u >= 1/2 while it moves; 40 digits, bounce by bounce to a speed of 1e-13."""
    system = ImpactSystem([[1.0]], [[0.3]], [[1.0]], (Stop((1.0,), 0.5, restitution=restitution),))
    motion = simulate(system, [0.9], [0.0], 100.0)
    rest, lost = bouncing_on(0.3, 0.5, restitution, 0.9)
    assert motion.kinds[-1] == EventKind.STICK.value
    assert abs(motion.times[-1] - rest) <= 1e-12
    assert motion.dissipated["stop a"] == pytest.approx(lost, rel=1e-12)
    assert motion.balance_error < 1e-14


@pytest.mark.parametrize("c", [0.0, 0.2, 2.0, 5.0])
def test_a_mass_held_against_a_stop_by_a_spring_is_released(c):
    """u1 rests on u1 >= 0, joined to u2 by a spring; u2 swings alone, u2'' + c u2' + u2 = 0 (spring 1, mass 1), and presses while u2 < 0.

    Released when u2 crosses 0: u2 = -1 at rest, undamped pi/2; damped by the closed form of the oscillator (never, if c >= 2)."""
    system = ImpactSystem(np.diag([0.5, 1.0]), np.diag([0.0, c]), [[1.0, -1.0], [-1.0, 1.0]], (Stop((1.0, 0.0), 0.0, restitution=0.3),))
    motion = simulate(system, [0.0, -1.0], [0.0, 0.0], 30.0)
    assert motion.kinds[1] == EventKind.STICK.value and motion.times[1] == 0.0
    if c >= 2.0:
        assert len(motion.kinds) == 2 and motion.sticking_time == 30.0
        return
    w = math.sqrt(1.0 - c * c / 4.0)
    closed = (math.pi - math.atan2(w, c / 2.0)) / w if c else math.pi / 2
    released = motion.times[2]
    assert motion.kinds[2] == EventKind.RELEASE.value
    assert abs(released - closed) <= 1e-14 * 8
    after = motion.sample([released + 1e-3])[0][0]
    assert after[0] > 0.0
    assert motion.balance_error < 1e-13


def test_an_elastic_ball_never_sticks():
    """Oracle: a fall of 1, then a bounce of 2, for ever."""
    bounces = simulate(ball(1.0), [0.5], [0.0], 5000.0, forces=Constant([-1.0]))
    assert bounces.sticking_time == 0.0 and bounces.impacts == 2500
    np.testing.assert_allclose(bounces.times[1:], 1.0 + 2.0 * np.arange(2500), rtol=1e-12)


@pytest.mark.rounding
@pytest.mark.parametrize(
    ("lam", "rho", "velocity", "load", "passes", "bound"),
    [
        (1e-4, 0.999, 5.0, (1.0, 0.01), 0.0, 1e-12),
        (1e-3, 0.999, 5.0, (0.9, 0.1), 0.0, 1e-12),
        (0.01, 0.999, 5.0, (1.0, 1.0), 100.0, 5e-14),
        (0.05, 0.7, 0.5, (1.0, 1.0), 100.0, 5e-14),
        (0.05, 0.7, 5.0, (1.0, 1.0), 1000.0, 16.0 * EPSILON),
    ],
)
def test_the_balance_closes_over_ten_thousand_impacts(lam, rho, velocity, load, passes, bound):
    """Oracle: the balance of energies, to 1e-12 of the initial energy. Where a load pumps it up: to some eps of what passes through.

    Its parts are sums over all flights, of numbers that a rounded row makes: four roundings each, to the same side in all of them.
    """
    forces = Harmonic(load[0], cosine=[0.0, load[1]])
    motion = simulate(vibro_impact_nes(0.1, 0.1, lam, rho), [0.0, 0.0], [0.0, velocity], 1e9, forces=forces, max_impacts=10_000)
    assert motion.impacts == 10_000 and motion.turnover > passes * motion.initial_energy
    assert abs(motion.balance) < bound * (motion.turnover if passes else motion.initial_energy)
    if not passes:
        assert 0.01 < np.abs(motion.sums[:, -1]).max() / motion.initial_energy < 3.0


@settings(max_examples=20, deadline=None)
@given(st.floats(0.0, 1.0), st.integers(0, 2**31), st.sampled_from([0.0, 0.02, 0.5]), st.booleans())
def test_no_restitution_hangs_and_the_balance_closes(rho, seed, lam, forced):
    rng = np.random.default_rng(seed)
    system = vibro_impact_nes(rng.uniform(0.05, 2.0), rng.uniform(0.0, 2.0), lam, rho)
    forces = Harmonic(rng.uniform(0.3, 2.0), cosine=rng.normal(size=2)) if forced else None
    motion = simulate(system, [0.0, 0.0], 3 * rng.normal(size=2), 100.0, forces=forces, max_impacts=5000)
    assert motion.status in (MotionStatus.DURATION_REACHED, MotionStatus.IMPACTS_FULL)
    turned_over = motion.initial_energy + abs(motion.work) + motion.totals[:-1].sum()
    assert abs(motion.balance) <= 1e-12 * turned_over
    met = motion.stop_events
    energies = system.energy(met.after[:, :2], met.after[:, 2:])
    assert forced or np.all(np.diff(energies) <= 1e-12 * energies.max(initial=1.0))
    u, _ = motion.sample(np.linspace(0.0, motion.duration, 500))
    assert np.all(np.abs(u[:, 0] - u[:, 1]) <= 1.0 + 1e-12)
    assert np.all(motion.totals[:-1] >= 0.0)
    assert motion.switch_error < 1e-10


def test_damped_motion_from_two_published_orbits():
    """Oracle: Lee et al. 2009, section 3, lam = 0.01, rho = 0.7, read off figures by eye; 38, 47 and 92 % is found here.

    From S13O00+ at h = 10: when 85 % is gone, about 40 by the LO and 45 by the NES. From S11O00- at h = 0.8: impacts only for t < 10, and
    almost 90 % gone by then.
    """
    plain, damped = vibro_impact_nes(0.1, 0.1), vibro_impact_nes(0.1, 0.1, 0.01, 0.7)
    v = backbone.origin_velocity(plain, backbone.orbits_at(plain, 10.0, 2.0)[1])
    assert v[0] > 0.0 and v[1] > 0.0
    motion = simulate(damped, [0.0, 0.0], v, 400.0)
    mark = next(mark for mark in motion.marks if mark.fraction == 0.85)
    assert mark.dissipated["rest"] / 10.0 == pytest.approx(0.40, abs=0.03)
    assert mark.dissipated["stop a"] / 10.0 == pytest.approx(0.45, abs=0.03)
    v = backbone.origin_velocity(plain, backbone.orbits_at(plain, 0.8, 1.0)[0])
    assert v[0] * v[1] < 0.0
    motion = simulate(damped, [0.0, 0.0], v, 60.0)
    assert motion.clear_from is not None and motion.last_impact < 10.0
    assert motion.spent([motion.last_impact])[0, :-1].sum() / 0.8 == pytest.approx(0.90, abs=0.03)


def overdamped(c, load, start):
    """x(t) and x'(t) of x'' + c x' + x = f + A cos t, load = (f, A), from a start (x, x'), with 50 digits and its two rates apart."""
    c, (f, amplitude), (x, v) = mpmath.mpf(c), map(mpmath.mpf, load), map(mpmath.mpf, start)
    fast = -c / 2 - mpmath.sqrt(c * c / 4 - 1)
    slow = 1 / fast
    x, v = x - f, v - amplitude / c  # A cos t is A sin t/c here: the load is at resonance
    far, near = (v - slow * x) / (fast - slow), (fast * x - v) / (fast - slow)

    def motion(t):
        both = far * mpmath.exp(fast * t), near * mpmath.exp(slow * t)
        return f + amplitude / c * mpmath.sin(t) + sum(both), amplitude / c * mpmath.cos(t) + fast * both[0] + slow * both[1]

    return motion


@pytest.mark.parametrize("c", [4.0, 400.0, 4e4, 4e6, 4e8, 4e10, 4e13, 4e16])
def test_an_overdamped_oscillator_moves_by_its_slow_rate(c):
    """Oracle: `overdamped`. The speed, too, has all its digits, however small it is beside the first one."""
    for load, start in (((0.0, 0.1), (1.0, 0.0)), ((0.0, 0.1), (0.5, 1.0)), ((0.3, 0.1), (-0.5, 1.0)), ((0.3, 0.1), (0.5, 0.0))):
        system = ImpactSystem([[1.0]], [[c]], [[1.0]], (Stop((1.0,), upper=1.0, restitution=0.8),))
        motion = simulate(system, [start[0]], [start[1]], 100.0, forces=[Constant([load[0]]), Harmonic(1.0, [load[1]])])
        with mpmath.workdps(50):
            exact = [float(part) for part in overdamped(c, load, start)(100)]
        assert motion.status is MotionStatus.DURATION_REACHED and motion.impacts == 0 and motion.balance_error <= 1e-13
        np.testing.assert_allclose(motion.final, exact, rtol=1e-13)


@pytest.mark.parametrize("c", [4.0, 400.0, 4e4, 4e6, 4e8, 4e10, 4e12, 4e14])
@pytest.mark.parametrize("load", [2.0, 1.000001])
def test_an_overdamped_oscillator_creeps_to_its_stop_and_stays(c, load):
    """Oracle: the zero of `overdamped`, which is at a time in proportion to c. The load holds the mass on the stop."""
    system = ImpactSystem([[1.0]], [[c]], [[1.0]], (Stop((1.0,), upper=1.0, restitution=0.8),))
    motion = simulate(system, [0.5], [0.0], 60.0 * c, forces=Constant([load]))
    with mpmath.workdps(50):
        path = overdamped(c, (load, 0.0), (0.5, 0.0))
        first = float(mpmath.findroot(lambda t: path(t)[0] - 1, c * math.log((load - 0.5) / (load - 1.0)), tol=1e-40))
    assert motion.status is MotionStatus.DURATION_REACHED and motion.kinds[-1] == EventKind.STICK.value
    assert motion.stop_events.times[0] == pytest.approx(first, rel=1e-16 / (load - 1.0) + 1e-14)
    np.testing.assert_allclose(motion.final, [1.0, 0.0], rtol=1e-15, atol=0.0)


@pytest.mark.parametrize("c", [4e4, 4e6, 1e8, 4e8, 4e10, 4e13, 4e16])
@pytest.mark.parametrize("load", [0.0, 2.0])
def test_an_elastic_stop_with_a_damper_ends_to_bounce(c, load):
    """Each bounce is slower than the one before. Oracle: after one at the speed F/c the distance is F/c^2 (2 (1 - exp(-s)) - s), s = c t.
    The speed of the next one is F/c (s - 1). Where bounces are below rounding, the load or the spring presses the mass on the stop."""
    system = ImpactSystem([[1.0]], [[c]], [[1.0]], (Stop((1.0,), upper=load - 1.0, restitution=1.0),))
    motion = simulate(system, [load - 1.5], [0.0], 60.0 * c, 1000, forces=Constant([load]))
    assert motion.status is MotionStatus.DURATION_REACHED and motion.kinds[-1] == EventKind.STICK.value
    assert motion.impacts < 1000 and motion.balance_error <= 1e-13
    np.testing.assert_allclose(motion.final, [load - 1.0, 0.0], rtol=1e-15, atol=0.0)
    if c <= 4e4:
        next_one = float(mpmath.findroot(lambda s: 2 * (1 - mpmath.exp(-s)) - s, 1.6)) - 1.0
        assert motion.speeds[2] == pytest.approx(next_one * motion.speeds[1], rel=1e-5)
