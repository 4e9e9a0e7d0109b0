"""The event-driven run. Oracles: closed forms of bouncing and of an oscillator between walls, energy, the closed form of a
periodic orbit, the paper's Eq. (11), the plain twin with and without flipped signs, and reversal of time."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from benchmarks import backbone
from bvp.motion import EventKind, MotionStatus
from bvp.simulate import Simulator, simulate
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from tests.bvp import twins
from tests.bvp.flow_twin import Twin
from tests.bvp.twins import chain


def rigid(lower, upper, restitution=1.0, gap=(1.0,)):
    return ImpactSystem([[1.0]], [[0.0]], [[0.0]], (Stop(gap, lower, upper, restitution),))


def oscillator(lower=-math.inf, upper=math.inf, restitution=1.0, damping=0.0):
    return ImpactSystem([[1.0]], [[damping]], [[1.0]], (Stop((1.0,), lower, upper, restitution),))


K = np.arange(60)
BOUNCES = [
    # u = v t between walls 1 apart: at constant speed, or with r^k after k impacts, the k-th wait 1/r^k.
    (rigid(0.0, 1.0), 0.5, 1.0, 60.0, "+-", K + 0.5, np.ones(60)),
    (rigid(0.0, 1.0, 0.5), 0.5, 1.0, 100.0, "+-", 2.0 ** (K + 1.0) - 1.5, 0.5**K),
    # u'' = -u on u >= 0: half periods of pi, the speed times r at each.
    (oscillator(lower=0.0, restitution=0.8), 0.0, 1.0, 30.0, "--", math.pi * (K + 1.0), 0.8**K),
    # u = A sin t between -1 and 1: the wait between walls is 2 asin(1/A), the speed sqrt(A^2 - 1).
    *(
        (oscillator(-1.0, 1.0), 0.0, a, 20.0, "+-", 2.0 * math.asin(1.0 / a) * (np.arange(400) + 0.5), np.full(400, math.sqrt(a * a - 1.0)))
        for a in (1.001, 1.5, 30.0)
    ),
]


@pytest.mark.parametrize(("system", "u", "v", "duration", "contacts", "times", "speeds"), BOUNCES)
def test_one_degree_of_freedom_bounces_as_its_closed_form(system, u, v, duration, contacts, times, speeds):
    result = simulate(system, [u], [v], duration)
    met, count = result.stop_events, int(np.count_nonzero(times < duration))
    assert result.status is MotionStatus.DURATION_REACHED and result.duration == duration
    assert len(met) == count > 3 and not met.touches.any()
    np.testing.assert_allclose(met.times, times[:count], rtol=1e-11)
    np.testing.assert_allclose(met.speeds, speeds[:count], rtol=1e-11)
    assert set(met.contacts[::2]) == {contacts[0]} and set(met.contacts[1::2]) == {contacts[1]}


@settings(max_examples=15)
@given(st.floats(0.05, 2.0), st.floats(0.0, 2.0), st.floats(0.0, 1.0), st.integers(0, 2**31))
def test_impacts_of_a_run_follow_formula_11(mu, sigma, rho, seed):
    """Velocities after each impact by Lee et al. 2009, Eq. (11), and the energy (1 - rho^2) mu/(1 + mu) (u1' - u2')^2/2 that it loses. It
    is at |u1 - u2| = 1, and the speed is that of approach."""
    system = vibro_impact_nes(mu, sigma, 0.0, rho)
    v = 2 * np.random.default_rng(seed).normal(size=2)
    result = simulate(system, [0.0, 0.0], v, 20.0, max_impacts=30).stop_events
    a, b = result.before[:, 2], result.before[:, 3]
    after = np.stack([(mu - rho) * a + (1 + rho) * b, mu * (1 + rho) * a + (1 - rho * mu) * b], axis=1) / (1 + mu)
    hit = ~result.touches
    np.testing.assert_allclose(result.after[hit, 2:], after[hit], atol=1e-13 * (1.0 + np.abs(v).max() / mu))
    lost = system.energy(result.before[:, :2], result.before[:, 2:]) - system.energy(result.after[:, :2], result.after[:, 2:])
    expected = 0.5 * (1 - rho**2) * mu / (1 + mu) * result.speeds**2
    np.testing.assert_allclose(lost, expected, atol=1e-12 * (1.0 + v @ v))
    side = np.where(np.array(result.contacts, dtype=str) == "+", 1.0, -1.0)
    np.testing.assert_array_equal(result.before[:, :2], result.after[:, :2])
    np.testing.assert_allclose(result.after[hit, 0] - result.after[hit, 1], side[hit], atol=1e-13)
    np.testing.assert_allclose(result.speeds[hit], (side * (a - b))[hit], rtol=1e-12, atol=1e-13)


def test_the_published_orbit_s13o_at_quarter_period_1_7_closes():
    """Closed form: h = 0.588748128566443 (published 0.58875); one impact at each odd quarter; back after T = 6.8."""
    system = vibro_impact_nes(0.1, 0.1)
    velocity = backbone.origin_velocity(system, 1.7)
    assert backbone.energy(system, 1.7) == pytest.approx(0.588748128566443, rel=1e-14)
    result = simulate(system, [0.0, 0.0], velocity, 6.8)
    np.testing.assert_allclose(result.stop_events.times, [1.7, 5.1], rtol=1e-13)
    assert sorted(result.stop_events.contacts) == ["+", "-"]
    np.testing.assert_allclose(result.final, [0.0, 0.0, *velocity], atol=1e-13)
    u, v = result.sample([0.0, result.stop_events.times[0], 3.4, 6.8])
    np.testing.assert_allclose(v[[0, 3]], [velocity, velocity], atol=1e-13)
    np.testing.assert_allclose(v[2], -velocity, atol=1e-13)
    np.testing.assert_allclose(v[1], result.stop_events.after[0, 2:], atol=1e-13)
    np.testing.assert_allclose(u[[0, 2, 3]], 0.0, atol=1e-13)


def test_time_reversed_the_elastic_motion_goes_back():
    """(u, v) -> (u, -v) at the end returns to the start within the growth of the motion (a short run)."""
    system = vibro_impact_nes(0.37, 0.81)
    there = simulate(system, [0.1, -0.2], [1.3, -0.7], 12.0)
    assert len(there.stop_events.times) >= 4
    back = simulate(system, there.final[:2], -there.final[2:], 12.0)
    np.testing.assert_allclose(back.final, [0.1, -0.2, -1.3, 0.7], atol=1e-9)
    np.testing.assert_allclose(12.0 - back.stop_events.times[::-1], there.stop_events.times, atol=1e-9)


@settings(max_examples=15)
@given(st.integers(2, 6), st.integers(0, 2**31), st.sampled_from([0.0, 1.0]))
def test_free_free_chains_keep_energy_and_momentum(n, seed, ground):
    """Internal impacts do not move the centre of mass of a free-free chain."""
    rng = np.random.default_rng(seed)
    system = chain(rng.uniform(0.2, 2.0, n), rng.uniform(0.2, 2.0, n - 1), ground)
    v = 2 * rng.normal(size=n)
    result = simulate(system, np.zeros(n), v, 50.0)
    assert result.status is MotionStatus.DURATION_REACHED
    # displacements of a drifting chain round with their size
    size = 1.0 + np.abs(result.stop_events.after[:, :n]).max(initial=1.0) ** 2 + v @ system.mass @ v
    h = system.energy(result.stop_events.after[:, :n], result.stop_events.after[:, n:])
    np.testing.assert_allclose(h, system.energy(np.zeros(n), v), atol=1e-13 * size)
    if ground == 0.0:
        np.testing.assert_allclose(
            result.stop_events.after[:, n:] @ system.mass @ np.ones(n), v @ system.mass @ np.ones(n), atol=1e-12 * size
        )


@pytest.mark.parametrize(("lam", "rho", "impacts"), [(0.0, 1.0, 6), (0.01, 0.7, 6), (0.05, 0.7, 6), (0.3, 0.9, 3)])
@pytest.mark.parametrize(("u", "v"), [([0.0, 0.0], [2.0, 1.5]), ([0.3, 0.1], [0.0, -4.0])])
def test_the_run_against_the_plain_twin(u, v, lam, rho, impacts):
    """Up to six impacts by sampling and bisection."""
    system = vibro_impact_nes(0.1, 0.1, lam, rho)
    _, events = Twin(system).run(np.array([*u, *v]), 1e3, most=impacts)
    times, states = [event[0] for event in events], [event[3] for event in events]
    result = simulate(system, u, v, 100.0, max_impacts=impacts)
    met = result.stop_events
    assert result.status is MotionStatus.IMPACTS_FULL and len(times) == len(met) == impacts
    np.testing.assert_allclose(met.times, times, atol=1e-9)
    np.testing.assert_allclose(met.after, states, atol=1e-8)
    np.testing.assert_allclose(result.final, met.after[-1], rtol=1e-14)


@pytest.mark.parametrize("mutated", ["rate", "push"])
def test_a_flipped_sign_in_a_contact_mode_makes_the_comparison_fail(mutated):
    """Mutation of what the compiled core is given: the impact no longer reverses the rate."""
    reference = simulate(vibro_impact_nes(0.1, 0.1), [0.0, 0.0], [2.0, 1.5], 5.0).stop_events.after[0]
    simulator = Simulator(vibro_impact_nes(0.1, 0.1))
    simulator.table.modes[0][mutated] *= -1.0
    broken = simulator.run([0.0, 0.0], [2.0, 1.5], 5.0, max_impacts=1).stop_events
    assert len(broken) == 0 or np.abs(broken.after[0] - reference).max() > 0.1


@pytest.mark.parametrize("restitution", [0.1, 0.5, 0.9, 0.99])
def test_chattering_comes_to_its_end_and_sticks(restitution):
    """u'' = -u pressed against u <= -1/2: from -0.6 at rest it arrives at acos(5/6) with s^2 = 0.11; a bounce that leaves with s comes back
    after 2 atan(2 s) with s, so it rests from acos(5/6) + the sum of 2 atan(2 s r^k), k = 1, 2, ..., and stays, for the spring presses."""
    result = simulate(oscillator(upper=-0.5, restitution=restitution), [-0.6], [0.0], 1e4)
    assert result.status is MotionStatus.DURATION_REACHED
    speeds = math.sqrt(0.11) * restitution ** np.arange(len(result.stop_events))
    late = speeds > 1e-4  # a slower bounce is known to the rounding of its place over its speed
    np.testing.assert_allclose(result.stop_events.speeds[late], speeds[late], rtol=1e-8)
    end = math.acos(5.0 / 6.0) + math.fsum(2.0 * math.atan(2.0 * math.sqrt(0.11) * restitution**k) for k in range(1, 20_000))
    free, held = result.contact_intervals
    assert held.sticking == ("+",) and held.begin == pytest.approx(end, abs=1e-11) and held.end == 1e4
    assert result.final.tolist() == pytest.approx([-0.5, 0.0], abs=1e-13)
    assert result.dissipated["stop a"] == pytest.approx(0.5 * 0.11, rel=1e-12)


def test_a_perfectly_plastic_impact_sticks_or_leaves():
    """r = 0: pressed, it sticks; pulled away, it leaves at zero speed and comes back after a full period."""
    stuck = simulate(oscillator(upper=-0.5, restitution=0.0), [-0.6], [0.0], 100.0)
    assert stuck.status is MotionStatus.DURATION_REACHED and len(stuck.stop_events) == 1
    assert stuck.sticking_time == pytest.approx(100.0 - math.acos(5.0 / 6.0), rel=1e-14)
    assert stuck.final.tolist() == pytest.approx([-0.5, 0.0], abs=1e-15)
    left = simulate(oscillator(upper=0.5, restitution=0.0), [0.0], [1.0], 3.0 * math.pi)
    assert left.status is MotionStatus.DURATION_REACHED and left.sticking_time == 0.0
    met = left.stop_events
    assert met.contacts == ("+", "+") and met.touches.tolist() == [False, True]
    assert met.times[1] - met.times[0] == pytest.approx(2 * math.pi, abs=1e-6)
    pressed = simulate(oscillator(upper=-0.5), [-0.5], [0.0], 1.0)
    assert pressed.status is MotionStatus.DURATION_REACHED and pressed.sticking_time == 1.0


def two_masses(row, other, coupling=0.0):
    """Two unit masses on unit springs, two stops hit at once when both start alike."""
    mass = np.array([[1.0, coupling], [coupling, 1.0]])
    return ImpactSystem(mass, np.zeros((2, 2)), mass, (Stop(row, upper=0.5), Stop(other, upper=0.5)))


def test_simultaneous_impacts_that_do_not_interact_are_taken_in_turn():
    """Two separate oscillators: each as if alone."""
    result = simulate(two_masses((1.0, 0.0), (0.0, 1.0)), [0.0, 0.0], [1.0, 1.0], 5.0)
    alone = simulate(oscillator(upper=0.5), [0.0], [1.0], 5.0)
    assert result.status is MotionStatus.DURATION_REACHED
    assert result.stop_events.contacts == ("a+", "b+") * len(alone.stop_events.times)
    np.testing.assert_allclose(result.stop_events.times[::2], alone.stop_events.times, rtol=1e-13)
    np.testing.assert_allclose(result.stop_events.times[1::2], alone.stop_events.times, rtol=1e-13)
    np.testing.assert_allclose(result.final, np.repeat(alone.final, 2), atol=1e-12)
    full = simulate(two_masses((1.0, 0.0), (0.0, 1.0)), [0.0, 0.0], [1.0, 1.0], 5.0, max_impacts=1)
    onward = simulate(full.system, full.final[:2], full.final[2:], 0.1)
    assert full.stop_events.contacts == ("a+",) and onward.stop_events.contacts == ("b+",)
    assert onward.stop_events.times[0] == pytest.approx(0.0, abs=1e-12)


@settings(max_examples=20)
@given(st.integers(0, 2**31), st.sampled_from([0.0, 0.1]))
@example(1126633, 0.0)
def test_samples_lie_on_the_flights(seed, lam):
    """Dense output against the twin's expm from the state after the last impact; right-continuous at impacts. Where a chatter begins with
    an impact, the output goes on with its mean."""
    rng = np.random.default_rng(seed)
    system = vibro_impact_nes(0.2, 0.3, lam, 0.9)
    result = simulate(system, [0.0, 0.0], 2 * rng.normal(size=2), 10.0)
    times = rng.uniform(0.0, result.duration, 10)
    u, v = result.sample(times)
    for k, t in enumerate(times):
        last = np.searchsorted(result.stop_events.times, t, side="right")
        begin, state = (result.stop_events.times[last - 1], result.stop_events.after[last - 1]) if last else (0.0, result.start)
        np.testing.assert_allclose(
            np.concatenate([u[k], v[k]]), twins.flow(system, state[:2], state[2:], t - begin), atol=1e-11
        )
    alone = ~np.isin(result.stop_events.times, result.times[result.kinds == EventKind.CHATTER.value])
    u, v = result.sample(result.stop_events.times[alone])
    np.testing.assert_allclose(np.hstack([u, v]), result.stop_events.after[alone], atol=1e-12)
    assert result.sample([])[0].shape == (0, 2)


@pytest.mark.parametrize("n", [6, 21, 51])
def test_the_energy_of_a_stiff_bar_closes_to_rounding(n):
    """A steel bar flies against a wall, 1 cm away, and back. Oracle: its kinetic energy at first, and the balance. The elastic energy
    u . K u of a displacement of the whole bar would cancel from 1e6 times that."""
    spring, mass = 2e11 * 1e-4 * (n - 1), np.full(n, 0.78 / (n - 1))
    mass[[0, -1]] *= 0.5
    stiffness = spring * (2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    stiffness[0, 0] = stiffness[-1, -1] = spring
    system = ImpactSystem(np.diag(mass), np.zeros((n, n)), stiffness, (Stop(tuple(np.eye(n)[0]), lower=0.0, restitution=1.0),))
    motion = simulate(system, np.full(n, 0.01), -np.ones(n), 0.02)
    assert motion.impacts > n
    assert motion.initial_energy == pytest.approx(0.39, rel=1e-14)
    assert motion.balance_error < 2.2e-16 * (8.0 * math.sqrt(motion.impacts) + 16.0)
