"""Simulation with smooth forces: closed forms, a second integrator, reversal and the energy budget."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ellipj

from bvp.forcing import Constant, Harmonic
from bvp.motion import MotionStatus
from bvp.simulate import Simulator, simulate
from bvp.springs import Damper, Spring
from bvp.system import ImpactSystem, Stop

MASS = np.diag([0.1, 1.0])


def sink(restitution=1.0, damped=True):
    """An oscillator and a sink on a cubic spring, between stops, with a linear and a cubic damper."""
    damping = np.array([[0.005, -0.005], [-0.005, 0.025]]) * damped
    dampers = [Damper((1.0, -1.0), damping=0.02, power=3)] if damped else []
    stop = Stop((1.0, -1.0), -1.0, 1.0, restitution)
    springs = [Spring((1.0, -1.0), stiffness=0.5, power=3)]
    return ImpactSystem(MASS, damping, np.diag([0.0, 1.0]), [stop], ("u1", "u2"), springs=springs, dampers=dampers)


def rate(t, x, load):
    """The sink of `sink` with dampers."""
    (u1, u2), (v1, v2) = x[:2], x[2:]
    w, speed = u1 - u2, v1 - v2
    pull = 0.005 * speed + 0.5 * w**3 + 0.02 * speed**3
    return [v1, v2, (-pull + 0.01 * (load > 0)) / 0.1, pull - u2 - 0.02 * v2 + load * np.cos(1.3 * t)]


def test_duffing_oscillator():
    """Oracle: u = cn(sqrt(1 + k) t) for u'' + u + k u^3 = 0 from u = 1."""
    k, times = 2.0, np.linspace(0.0, 20.0, 41)
    motion = simulate(ImpactSystem([[1.0]], [[0.0]], [[1.0]], [], springs=[Spring((1.0,), stiffness=k, power=3)]), [1.0], [0.0], 20.0)
    sn, cn, dn, _ = ellipj(np.sqrt(1.0 + k) * times, k / (1.0 + k) / 2.0)
    u, v = motion.sample(times)
    assert np.abs(u[:, 0] - cn).max() < 1e-13
    assert np.abs(v[:, 0] + np.sqrt(1.0 + k) * sn * dn).max() < 1e-13
    assert motion.balance_error < 1e-14
    assert abs(motion.peaks[0] - 1.0) < 1e-14


@pytest.mark.parametrize("load", [0.0, 0.3])
def test_impacts_agree_with_a_second_integrator(load):
    """Oracle: DOP853 with events, from impact to impact."""
    forces = [Harmonic(1.3, cosine=[0.0, load]), Constant([0.01, 0.0])] if load else None
    motion = simulate(sink(0.7), [0.0, 0.0], [0.0, 1.6], 12.0, forces=forces)
    x, t, hits = np.array([0.0, 0.0, 0.0, 1.6]), 0.0, []

    def gap(t, x, load):
        return 1.0 - abs(x[0] - x[1])

    gap.terminal, gap.direction = True, -1
    push = np.linalg.solve(MASS, [1.0, -1.0]) / 11.0
    while t < 12.0:
        found = solve_ivp(rate, (t, 12.0), x, "DOP853", events=gap, args=(load,), rtol=1e-13, atol=1e-15, max_step=0.1)
        t, x = found.t[-1], found.y[:, -1].copy()
        if found.status == 1:
            hits.append(t)
            x[2:] -= 1.7 * (x[2] - x[3]) * push
    assert len(hits) == motion.impacts > 0
    assert np.abs(motion.stop_events.times - hits).max() < 1e-11
    assert np.abs(motion.final - x).max() < 1e-11


def test_energy_budget_of_each_mechanism():
    """Invariant: energy and what dampers, cubic damper and stop take sum to the initial energy and the work, at all times."""
    system = sink(0.7)
    motion = simulate(system, [0.0, 0.0], [0.0, 1.6], 30.0, forces=[Harmonic(1.3, cosine=[0.0, 0.3])])
    times = np.linspace(0.0, 30.0, 61)
    spent = motion.spent(times)
    balance = system.energy(*motion.sample(times)) + spent[:, :-1].sum(axis=1) - spent[:, -1] - motion.initial_energy
    assert np.abs(balance).max() < 1e-14 * motion.turnover * 10
    assert motion.balance_error < 1e-14
    assert list(motion.dissipated) == ["gaps", "rest", "the damper between u1 and u2", "stop a"]
    assert min(motion.dissipated.values()) > 0.0
    batch = Simulator(system).run_many([[0.0, 0.0, 0.0, 1.6], [0.0, 0.0, 0.0, 0.1]], 20.0, with_peaks=True)
    assert np.abs(batch.balance).max() < 1e-14
    alone = simulate(system, [0.0, 0.0], [0.0, 1.6], 20.0)
    assert np.array_equal(batch.final[0], alone.final)
    assert np.array_equal(batch.peaks[0], alone.peaks)


def test_reversal():
    """Invariant: a conservative motion with impacts runs back."""
    motion = simulate(sink(1.0, damped=False), [0.0, 0.0], [0.0, 1.6], 30.0)
    back = simulate(motion.system, motion.final[:2], -motion.final[2:], 30.0)
    assert motion.impacts == back.impacts > 5
    assert np.abs(back.final - motion.start * [1, 1, -1, -1]).max() < 1e-11
    assert motion.balance_error < 1e-14


def test_sticking_and_release():
    """Oracle: DOP853 of the motion that is left while a stop sticks, up to the zero of the contact force; bounces halve."""
    springs = [Spring((1.0, -1.0), stiffness=0.5, power=3)]
    damping, stiffness = np.array([[0.05, -0.02], [-0.02, 0.05]]), np.array([[1.5, -0.5], [-0.5, 1.0]])
    system = ImpactSystem(np.diag([1.0, 0.5]), damping, stiffness, [Stop((1.0, 0.0), lower=0.0, restitution=0.5)], springs=springs)
    motion = simulate(system, [0.3, 0.2], [0.0, 0.4], 20.0, forces=[Harmonic(0.7, cosine=[1.0, 0.2]), Constant([-0.6, 0.0])])
    interval = next(part for part in motion.contact_intervals if part.sticking)

    def force(t, y, speed):
        load = np.array([1.0, 0.2]) * np.cos(0.7 * t) + [-0.6, 0.0]
        return load - damping @ [0.0, speed] - stiffness @ [0.0, y] + np.array([1.0, -1.0]) * 0.5 * y**3

    def release(t, x):
        return force(t, *x)[0]

    release.terminal, release.direction = True, 1
    (u,), (v,) = motion.sample([interval.begin])
    begin = (interval.begin, interval.begin + 20.0)
    found = solve_ivp(
        lambda t, x: [x[1], force(t, *x)[1] / 0.5], begin, [u[1], v[1]], "DOP853", events=release, rtol=1e-13, atol=1e-15, max_step=0.1
    )
    (u,), (v,) = motion.sample([interval.end])
    assert abs(found.t[-1] - interval.end) < 1e-11
    assert np.abs(found.y[:, -1] - [u[1], v[1]]).max() < 1e-11
    times = motion.stop_events.times[motion.stop_events.times < interval.begin]
    assert abs((interval.begin - times[-1]) / (times[-1] - times[-2]) - 1.0) < 0.01
    assert motion.balance_error < 1e-13


def test_two_stops_stick_at_once():
    """Oracles: while both stick, each contact force is the load on its mass, and opens the contact where that changes its sign. Then DOP853
    of the mass that moves, up to the zero of the force on the other one."""
    mass, damping = np.array([[1.0, 0.2], [0.2, 0.5]]), np.array([[0.3, -0.1], [-0.1, 0.2]])
    stops = [Stop((1.0, 0.0), lower=0.0, restitution=0.3), Stop((0.0, 1.0), lower=0.0, restitution=0.2)]
    springs = [Spring((1.0, -1.0), stiffness=20.0, power=3)]
    system = ImpactSystem(mass, damping, np.diag([1.0, 2.0]), stops, springs=springs)
    loads = [Harmonic(0.5, sine=[1.0, 0.5]), Constant([-0.6, -0.4])]
    motion = simulate(system, [0.05, 0.04], [0.0, 0.0], 20.0, forces=loads)
    parts = motion.contact_intervals
    begun = next(k for k, part in enumerate(parts) if len(part.sticking) == 2 and parts[k + 1].sticking == ("b-",))
    both, alone = parts[begun : begun + 2]
    cycles = 2.0 * np.pi / 0.5
    assert abs(math.remainder(both.end - np.arcsin(0.6) / 0.5, cycles)) < 1e-12 and alone.sticking == ("b-",)

    def forces(t, y, v):
        load = np.array([1.0, 0.5]) * np.sin(0.5 * t) + [-0.6, -0.4]
        return load - damping @ [v, 0.0] - np.array([y, 0.0]) - np.array([20.0, -20.0]) * y**3

    def press(t, x):
        # The force that keeps the second mass at rest, while the first one accelerates by force/m11.
        first, second = forces(t, *x)
        return second - 0.2 * first

    press.terminal, press.direction = True, 1
    begin = (both.end, both.end + cycles)
    found = solve_ivp(
        lambda t, x: [x[1], forces(t, *x)[0]], begin, [0.0, 0.0], "DOP853", events=press, rtol=1e-13, atol=1e-15, max_step=0.02
    )
    (u,), (v,) = motion.sample([alone.end])
    assert abs(found.t[-1] - alone.end) < 1e-11
    assert np.abs(found.y[:, -1] - [u[0], v[0]]).max() < 1e-11
    assert abs(motion.balance) < 1e-14 * motion.turnover


def test_a_motion_that_runs_away_ends_where_its_forces_do():
    """Oracle: u = 1/(1 - t/sqrt(2)) of u'' = u^3 has no value beyond sqrt(2)."""
    system = ImpactSystem([[1.0]], [[0.0]], [[0.0]], [], springs=[Spring((1.0,), stiffness=-1.0, power=3)])
    motion = simulate(system, [1.0], [np.sqrt(0.5)], 5.0)
    assert motion.status is MotionStatus.UNRESOLVED
    assert 0.0 < np.sqrt(2.0) - motion.duration < 1e-5
    times = np.linspace(0.0, 1.4, 15)
    assert motion.sample(times)[0][:, 0] == pytest.approx(1.0 / (1.0 - times / np.sqrt(2.0)), rel=1e-11)
    batch = Simulator(system).run_many([[1.0, np.sqrt(0.5)], [0.1, 0.0]], 5.0)
    assert [status.name for status in batch.status] == ["UNRESOLVED", "DURATION_REACHED"]
    assert batch.duration.tolist() == [motion.duration, 5.0]


def test_springs_without_energy_are_refused():
    """A potential that is not known."""
    system = ImpactSystem([[1.0]], [[0.0]], [[1.0]], [], springs=[Spring((1.0,), force="sin(w)")])
    with pytest.raises(ValueError, match="the energy of the motion is not known"):
        Simulator(system)
