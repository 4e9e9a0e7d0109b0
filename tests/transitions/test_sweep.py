"""Sweeps of forced motion.

Oracles: the closed form of one impact in n periods (docs/theory.md has the saltation); the bouncing ball's; linear oscillators in complex
numbers; eigenvalues of the differenced stroboscopic map of `simulate`, which has no tangent vectors.
"""

import cmath
import math

import numpy as np
import pytest

from bvp.forcing import Constant, Harmonic, Record
from bvp.motion import MotionStatus
from bvp.simulate import BeyondStop, simulate
from bvp.system import ImpactSystem, Stop
from transitions.sweep.forced import Carried, carried_into, harmonics_of
from transitions.sweep.returns import LOOSEST, find_period, mean_growth
from transitions.sweep.sweep import SweepSettings, sweep

PERIOD_DOUBLING = -0.0685756522788391


def oscillator(s, r=0.8, damping=0.0):
    return ImpactSystem([[1.0]], [[damping]], [[1.0]], [Stop((1.0,), upper=s, restitution=r)])


def one_impact(w, r, n, s):
    """Impact speed, phase and multipliers of the motion x'' + x = cos(w t), x <= s, with one impact in n periods: upper root."""
    period, gamma = 2.0 * math.pi * n / w, 1.0 / (1.0 - w * w)
    c, d = (1.0 + r) * math.sin(period) / (1.0 - math.cos(period)), (1.0 - r) / w
    speed = (-2.0 * c * s + math.sqrt(4.0 * (gamma**2 * c**2 - (s**2 - gamma**2) * d**2))) / (c**2 + d**2)
    cos, sin = math.cos(period), math.sin(period)
    # x(0) = s, x'(0) = -r v, x(period) = s, x'(period) = v are linear in cos and sin of the phase at the impact.
    rows = gamma * np.array([[1.0 - cos, w * sin], [sin, w * (cos - 1.0)]])
    phase = np.linalg.solve(rows, [s - s * cos + r * speed * sin, speed + s * sin + r * speed * cos])
    acceleration = phase[0] - s
    saltation = np.array([[-r, 0.0], [(1.0 + r) * acceleration / speed, -r]])
    multipliers = np.linalg.eigvals(saltation @ np.array([[cos, sin], [-sin, cos]]))
    return speed, math.atan2(phase[1], phase[0]) % (2.0 * math.pi), multipliers


def test_the_closed_form_has_the_published_period_doubling():
    """Oracle: multipliers -1 and -r^2 at the period doubling, speed at s = 0 (design of the problem, in many digits)."""
    assert abs(one_impact(2.8, 0.8, 1, 0.0)[0] - 0.3361772699757) < 1e-12
    assert np.allclose(sorted(one_impact(2.8, 0.8, 1, PERIOD_DOUBLING)[2]), [-1.0, -0.64], atol=1e-11)


def impact_oscillator(s):
    return oscillator(s), [Harmonic(2.8, [1.0])]


@pytest.fixture(scope="module")
def through_the_doubling():
    values = np.array([-0.16, -0.12, -0.1, -0.08, -0.07, PERIOD_DOUBLING - 3e-4, PERIOD_DOUBLING + 3e-4, -0.06])
    return sweep(impact_oscillator, values, u=[-0.66], settings=SweepSettings(4000, 400))[0]


def test_a_sweep_finds_the_period_doubling(through_the_doubling):
    """Oracle: the closed form: period 1 below, and 2 above."""
    assert through_the_doubling.periods.tolist() == [1, 1, 1, 1, 1, 1, 2, 2]


def test_speeds_phases_and_exponents_are_those_of_the_closed_form(through_the_doubling):
    found = through_the_doubling
    for k in range(6):
        speed, phase, multipliers = one_impact(2.8, 0.8, 1, found.values[k])
        own = slice(found.offsets[k], found.offsets[k + 1])
        assert np.abs(found.impact_speeds[own] - speed).max() < 1e-10
        assert np.abs(found.impact_phases[own] - phase).max() < 1e-10
        assert abs(found.exponents[k] - math.log(np.abs(multipliers).max()) * 2.8 / (2.0 * math.pi)) < 1e-9
        assert found.impact_rates[k] == 1.0
        # Equation of the energy: an impact takes (1 - r^2) v^2/2, and the load gives as much.
        assert found.parts[-1] == "stop a"
        assert abs(found.dissipated[k, -1] - 0.18 * speed**2) < 1e-10 and abs(found.work[k] - 0.18 * speed**2) < 1e-10


def test_the_oscillator_has_no_impact_below_the_grazing():
    """Oracle: x'' + 0.1 x' + x = A cos t has amplitude A/0.1 and exponent -0.05; it grazes its stop at A = 0.1."""

    def at(amplitude):
        return oscillator(1.0, damping=0.1), [Harmonic(1.0, [amplitude])]

    found, _ = sweep(at, [0.05, 0.09, 0.0999, 0.1005], settings=SweepSettings(400, 100))
    assert np.all(found.impact_rates[:3] == 0.0) and found.impact_rates[3] > 0.0
    assert np.abs(found.peaks[:3, 0] - found.values[:3] / 0.1).max() < 1e-12
    assert found.periods[:3].tolist() == [1, 1, 1]
    assert np.abs(found.exponents[:3] + 0.05).max() < 1e-12
    damper = found.parts.index("gaps")
    assert np.abs(found.dissipated[:3, damper] - 0.1 * math.pi * (found.values[:3] / 0.1) ** 2).max() < 1e-12


def bouncing_ball(e):
    def at(gamma):
        # Relative to a table that moves by -gamma cos(t), with g = 1.
        system = ImpactSystem([[1.0]], [[0.0]], [[0.0]], [Stop((1.0,), lower=0.0, restitution=e)])
        return system, [Constant([-1.0]), Harmonic(1.0, [-gamma])]

    return at


@pytest.mark.parametrize("e", [0.5])
def test_the_bouncing_ball_doubles_its_period(e):
    """Oracle: see `require_the_bouncing_ball_doubles_its_period`."""
    require_the_bouncing_ball_doubles_its_period(e)


def require_the_bouncing_ball_doubles_its_period(e):
    """Oracle: one impact in a period, at the speed 2 pi/(1 + e), from SN at pi (1 - e)/(1 + e) up to PD; the closed form of both."""
    saddle = math.pi * (1.0 - e) / (1.0 + e)
    doubling = math.hypot(saddle, 2.0 * (1.0 + e * e) / (1.0 + e) ** 2)
    speed = 2.0 * math.pi / (1.0 + e)
    middle = 0.5 * (saddle + doubling)
    values = [middle, doubling - 0.01, doubling + 0.01]
    found, _ = sweep(bouncing_ball(e), values, start=on_the_ball_orbit(e, middle), settings=SweepSettings(1500, 20))
    assert found.periods.tolist() == [1, 1, 2]
    for k in range(2):
        assert np.abs(found.impact_speeds[found.offsets[k] : found.offsets[k + 1]] - speed).max() < 1e-9


def on_the_ball_orbit(e, gamma):
    """The state at phase 0 of the ball with one impact in a period: it leaves the table at pi, upwards, in the frame of the laboratory."""
    velocity = math.pi * (1.0 - e) / (1.0 + e)
    # The table is at -gamma cos t, and has the velocity gamma sin t, here while it slows down.
    phase = math.pi - math.asin(velocity / gamma)
    left = 2.0 * math.pi - phase
    height = -gamma * math.cos(phase) + math.pi * left - 0.5 * left**2
    return Carried(np.array([height + gamma, math.pi - left]))


def test_state_and_phase_are_carried_over_when_the_frequency_changes():
    """Oracle: x'' + 0.2 x' + x = cos(w t) in complex numbers, one period for each w, from the state before."""

    def at(w):
        return oscillator(50.0, damping=0.2), [Harmonic(w, [1.0])]

    values = 1.3 + 1e-3 * np.arange(40)
    found, _ = sweep(at, values, u=[0.3], v=[-0.2], settings=SweepSettings(0, 1))
    u, v = 0.3, -0.2
    root = complex(-0.1, math.sqrt(1.0 - 0.01))
    for k, w in enumerate(values):
        response = 1.0 / (1.0 - w * w + 0.2j * w)
        x, y = u - response.real, v - (1j * w * response).real
        # x = Re(a exp(root t)) with a = x + i b.
        a = complex(x, (root.real * x - y) / root.imag)
        period = 2.0 * math.pi / w
        u = (a * cmath.exp(root * period)).real + response.real
        v = (a * root * cmath.exp(root * period)).real + (1j * w * response).real
        assert np.abs(found.states[k, 0] - [u, v]).max() < 1e-12


def test_the_exponent_of_a_linear_system_is_its_largest_real_part():
    """Oracle: eigenvalues of the state matrix, two degrees of freedom, complex and real."""
    mass, stiffness = np.diag([1.0, 2.0]), np.array([[3.0, -1.0], [-1.0, 2.0]])
    for damping in (np.array([[0.3, -0.1], [-0.1, 0.2]]), np.array([[9.0, 0.0], [0.0, 11.0]])):
        system = ImpactSystem(mass, damping, stiffness, [Stop((1.0, -1.0), -50.0, 50.0, 0.5)])
        inverse = np.linalg.inv(mass)
        state = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ stiffness, -inverse @ damping]])
        found, _ = sweep(lambda w, system=system: (system, [Harmonic(w, [1.0, 0.0])]), [0.9], settings=SweepSettings(60, 300))
        assert abs(found.exponents[0] - np.linalg.eigvals(state).real.max()) < 1e-8
        assert found.periods.tolist() == [1]


def differenced_map(system, forces, state, period, sticking, step=1e-6):
    """Derivative of the stroboscopic map by differences of `simulate` of fourth order, in the directions that the sticking stops leave."""
    n = system.degrees_of_freedom
    rows = np.array([system.stops[0].gap]) if sticking else np.zeros((0, n))
    free = np.linalg.svd(rows)[2][len(rows) :].T if sticking else np.eye(n)
    basis = np.kron(np.eye(2), free)

    def image(change):
        x = state + basis @ change
        return basis.T @ simulate(system, x[:n], x[n:], period, forces=forces).final

    columns = []
    for direction in np.eye(basis.shape[1]):
        near, far = (image(k * step * direction) - image(-k * step * direction) for k in (1.0, 2.0))
        columns.append((8.0 * near - far) / (12.0 * step))
    return np.array(columns).T


def pressed_chain(r, push=-0.8):
    """A mass that a constant load presses against its stop, coupled to another one under a harmonic load: chattering, sticking, release."""
    system = ImpactSystem(
        [[1.0, 0.0], [0.0, 1.0]], [[0.05, -0.01], [-0.01, 0.04]], [[1.5, -1.0], [-1.0, 2.0]], [Stop((1.0, 0.0), lower=0.0, restitution=r)]
    )
    return system, [Constant([push, 0.0]), Harmonic(1.1, [0.0, 0.9])]


@pytest.mark.parametrize("r", [0.0, 0.4])
def test_the_exponent_of_a_motion_that_sticks_is_that_of_the_differenced_map(r):
    """Oracle: see `require_the_exponent_of_a_motion_that_sticks_is_that_of_the_differenced_map`."""
    require_the_exponent_of_a_motion_that_sticks_is_that_of_the_differenced_map(r)


def require_the_exponent_of_a_motion_that_sticks_is_that_of_the_differenced_map(r):
    """Oracle: the largest eigenvalue of the differenced map over the period of the motion."""
    system, forces = pressed_chain(r)
    found, end = sweep(lambda w: (system, [forces[0], Harmonic(w, [0.0, 0.9])]), [1.1], settings=SweepSettings(100, 40))
    p = int(found.periods[0])
    assert p > 0 and 0.0 < found.sticking[0] < 1.0
    state = end.state
    derivative = differenced_map(system, forces, state, p * 2.0 * math.pi / 1.1, end.sticking)
    largest = np.abs(np.linalg.eigvals(derivative)).max()
    assert abs(found.exponents[0] - math.log(largest) / (p * 2.0 * math.pi / 1.1)) < 2e-6


def test_sticking_of_the_only_mass_takes_every_tangent_vector_away():
    """With one degree of freedom the stroboscopic map has rank 0 after sticking: the multipliers are 0, exactly."""
    system = ImpactSystem([[1.0]], [[0.0]], [[1.0]], [Stop((1.0,), upper=0.0, restitution=0.3)])
    found, _ = sweep(lambda w: (system, [Constant([0.5]), Harmonic(w, [1.0])]), [0.7, 0.71], settings=SweepSettings(50, 20))
    assert np.all(np.isneginf(found.exponents)) and np.all(found.periods == 1) and np.all(found.sticking > 0.0)


def test_a_state_beyond_a_stop_is_moved_to_it():
    """The stop comes nearer by 0.3, more than the oscillator is away from it at phase 0."""
    system, distance = carried_into(oscillator(-0.7), Carried(np.array([-0.4, 0.2])))
    assert np.allclose(system.state, [-0.7, 0.2]) and abs(distance - 0.3) < 1e-15
    # Two degrees of freedom move along M^-1 c.
    pair = ImpactSystem(np.diag([1.0, 3.0]), np.zeros((2, 2)), np.eye(2), [Stop((1.0, -1.0), -1.0, 1.0, 0.5)])
    moved, distance = carried_into(pair, Carried(np.array([2.0, 0.2, 0.0, 0.0])))
    assert np.allclose(moved.state[:2], [1.4, 0.4]) and abs(distance - 0.8) < 1e-15
    found, _ = sweep(impact_oscillator, [-0.1, -0.9], u=[-0.66], settings=SweepSettings(0, 1))
    assert found.moved[0] == 0.0 and found.moved[1] > 0.1
    assert all(status is MotionStatus.DURATION_REACHED for status in found.statuses)


def test_a_sticking_contact_stays_closed_or_is_released():
    """Oracle: the contact force at phase 0 is the constant load and the amplitude together, against the stop at 0."""
    system = ImpactSystem([[1.0]], [[0.0]], [[1.0]], [Stop((1.0,), lower=0.0, restitution=0.3)])

    def at(push):
        return system, [Constant([push]), Harmonic(1.0, [0.5])]

    found, _ = sweep(at, [-1.0, -0.8, -0.2], settings=SweepSettings(20, 10))
    assert found.released[:2] == ((), ()) and found.released[2] == ("-",)
    assert np.abs(found.sticking[:2] - 1.0).max() < 1e-14 and found.sticking[2] < 1.0


def test_two_starts_find_two_motions_and_a_sweep_goes_on_where_another_ended():
    """Oracle: the closed form of the motion of period 1; one sweep in two parts is the same sweep."""
    settings = SweepSettings(300, 30)
    near, _ = sweep(impact_oscillator, [-0.1], u=[-0.66], settings=settings)
    rest, _ = sweep(impact_oscillator, [-0.1], settings=settings)
    assert near.periods.tolist() == [1] and rest.periods.tolist() == [3]
    whole, _ = sweep(impact_oscillator, [-0.1, -0.09], u=[-0.66], settings=settings)
    first, end = sweep(impact_oscillator, [-0.1], u=[-0.66], settings=settings)
    second, _ = sweep(impact_oscillator, [-0.09], start=end, settings=settings)
    assert np.abs(whole.states[1] - second.states[0]).max() < 1e-12
    assert np.array_equal(whole.states[0], first.states[0])


def test_loads_have_one_harmonics_of():
    assert harmonics_of([Harmonic(1.5, [1.0]), Harmonic(2.5, [0.5]), Constant([1.0])]) == (0.5, (3, 5, 0))
    with pytest.raises(ValueError, match="frequencies 1 and 1.41421 are incommensurate"):
        harmonics_of([Harmonic(1.0, [1.0]), Harmonic(math.sqrt(2.0), [1.0])])
    with pytest.raises(ValueError, match="no load is periodic"):
        harmonics_of([Constant([1.0])])
    with pytest.raises(ValueError, match="a record has none"):
        harmonics_of([Harmonic(1.0, [1.0]), Record([1.0], [0.0, 1.0], [0.0, 1.0])])


def test_harmonics_are_multiples_of_the_harmonics_of():
    """Oracle: superposition of two responses of a linear oscillator, at phase 0."""
    system = oscillator(50.0, damping=0.3)
    found, _ = sweep(lambda w: (system, [Harmonic(2 * w, [1.0]), Harmonic(3 * w, [0.0], [0.5])]), [0.4], settings=SweepSettings(60, 4))
    expected = sum((force / (1.0 - k * k + 0.3j * k)) for k, force in ((0.8, 1.0), (1.2, -0.5j)))
    assert abs(found.states[0, -1, 0] - expected.real) < 1e-12 and abs(found.loads[0] - 0.4) < 1e-15


def test_bad_starts_and_settings_are_refused():
    with pytest.raises(BeyondStop, match="the start lies beyond stop a: its gap is 0, expected -inf to -0.1"):
        sweep(impact_oscillator, [-0.1], u=[0.0])
    with pytest.raises(ValueError, match="no entry"):
        sweep(impact_oscillator, [])
    with pytest.raises(ValueError, match="transient is an integer from 0"):
        SweepSettings(-1, 5)
    with pytest.raises(ValueError, match="record is an integer from 1"):
        SweepSettings(1, 0)


def test_a_simulation_that_ends_leaves_its_value_empty():
    """Two balls between walls hit a wall and each other at once, by symmetry: the outcome is not defined."""
    stops = [Stop((1.0, 0.0), lower=-1.0, restitution=0.9), Stop((1.0, 1.0), lower=-1.0, restitution=0.9)]
    system = ImpactSystem(np.eye(2), np.zeros((2, 2)), np.zeros((2, 2)), stops)
    found, end = sweep(lambda w: (system, [Harmonic(w, [0.0, 0.0])]), [1.0], u=[0.0, 0.0], v=[-1.0, 0.0], settings=SweepSettings(2, 3))
    assert found.statuses[0] is MotionStatus.SIMULTANEOUS and found.periods[0] == 0
    assert np.isnan(found.exponents[0]) and np.isnan(found.states).all() and np.array_equal(end.state, [0.0, 0.0, -1.0, 0.0])


def test_a_period_is_found_within_the_distance_that_convergence_leaves():
    """Oracle: x -> -0.99 x + 1e-5 y: a slow spiral to period 1, and a motion of period 3."""
    slow = np.array([[0.5 + 0.3 * (-0.99) ** k, 0.1] for k in range(400)])
    assert find_period(slow[300:], 1.0, math.log(0.99), 400) == 0  # 1e-2 is left
    slow = np.array([[0.5 + 0.3 * (-0.99) ** k, 0.1] for k in range(1400)])
    assert find_period(slow[1300:], 1.0, math.log(0.99), 1400) == 1
    assert find_period(slow[1300:], 1.0, 0.1, 1400) == 0
    three = np.array([[k % 3, 1.0] for k in range(30)], dtype=float)
    assert find_period(three, 1.0, -0.5, 30) == 3 and find_period(three[:5], 1.0, -0.5, 30) == 0
    assert LOOSEST > 1e-5


@pytest.mark.parametrize(("period", "turns"), [(1, 5), (2, 10), (1, 2), (3, 12)])
def test_a_slow_spiral_has_the_period_of_what_it_tends_to(period, turns):
    """Oracle: its formula, limit + 0.1 (rate exp(i angle))^k with an angle near 2 pi/turns: it returns after `turns` periods first."""
    k = np.arange(2000)
    rate = -0.008
    spiral = 0.1 * np.exp(rate * k + 1j * (2.0 * np.pi / turns + 1e-4) * k)
    states = np.column_stack([2.0 + k % period + spiral.real, spiral.imag])
    for stop in (800, 1200, 1900):
        assert find_period(states[stop - 80 : stop], 1.0, rate, stop) == period
    limit = np.column_stack([2.0 + k % turns, np.zeros(len(k))]) + 1e-3 * np.exp(2.0 * rate * k)[:, None]
    assert find_period(limit[1800:1880], 1.0, rate, 1880) == turns


def test_the_mean_growth_of_a_turning_tangent_vector_converges_fast():
    """Oracle: a rotation by an irrational angle in an ellipse, times 0.9: the plain mean is wrong by 1/P."""
    angle, stretch = 2.0, np.diag([1.0, 4.0])
    rotation = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    step, x, growths = 0.9 * stretch @ rotation @ np.linalg.inv(stretch), np.array([1.0, 0.3]), []
    for _ in range(1600):
        y = step @ x
        growths.append(math.log(np.linalg.norm(y) / np.linalg.norm(x)))
        x = y / np.linalg.norm(y)
    assert abs(mean_growth(np.array(growths)) - math.log(0.9)) < 1e-8 < 1e-5 < abs(np.mean(growths) - math.log(0.9))


def test_a_motion_without_impacts_can_be_recorded_for_any_number_of_periods():
    """Oracle: the linear response at phase 0 after 5000 periods."""
    found, _ = sweep(lambda w: (oscillator(50.0, damping=0.3), [Harmonic(w, [1.0])]), [0.4], settings=SweepSettings(100, 5000))
    assert found.periods.tolist() == [1]
    assert np.abs(found.states[0, :, 0] - (1.0 / (1.0 - 0.16 + 0.12j)).real).max() < 1e-12
