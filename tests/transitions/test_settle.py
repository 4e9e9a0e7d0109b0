"""What a forced motion settles to.

Oracles: closed forms of periodic motions; `simulate`; a linear oscillator without damping, whose motion is quasiperiodic; two chaotic
motions that part; a load that presses for ever.
"""

import math

import numpy as np
import pytest

from bvp.forcing import Constant, Harmonic
from bvp.motion import MotionStatus
from bvp.multipliers import sort_multipliers
from bvp.parameters import ParametricSystem
from bvp.simulate import BeyondStop, simulate
from bvp.system import ImpactSystem, Stop
from saltus.scene import load_scene
from tests.transitions.test_sweep import impact_oscillator, one_impact, oscillator, pressed_chain
from transitions.response.path import ParameterPath
from transitions.response.starting import NoOrbit, settled_orbit
from transitions.sweep.settle import SettledKind, settle
from transitions.sweep.sweep import SweepSettings, sweep


def test_a_periodic_motion_with_its_impacts_and_multipliers():
    """Oracle: the closed form of one impact in a period."""
    system, forces = impact_oscillator(-0.1)
    found = settle(system, forces, [-0.66], [0.0])
    speed, phase, multipliers = one_impact(2.8, 0.8, 1, -0.1)
    assert found.kind is SettledKind.PERIODIC and found.period == 1 and found.distance < 1e-10
    assert found.stops == ("+",) and abs(found.impacts.speeds[0] - speed) < 1e-11 and abs(found.impacts.times[0] * 2.8 - phase) < 1e-11
    assert np.allclose(found.impacts.before[0], [-0.1, speed], atol=1e-11)
    assert np.allclose(found.impacts.after[0], [-0.1, -0.8 * speed], atol=1e-11)
    assert np.allclose(found.multipliers, sort_multipliers(multipliers), atol=1e-9)
    assert abs(found.exponent - math.log(0.8) * 2.8 / (2.0 * math.pi)) < 1e-10
    assert "period 1 with 1 impacts" in found.text


def test_a_motion_of_period_two_returns_in_the_simulation():
    """Oracle: `simulate` over two periods of the loads."""
    system, forces = impact_oscillator(-0.06)
    found = settle(system, forces, [-0.66])
    assert found.period == 2 and len(found.states) == 2 and len(found.impacts) == 2
    motion = simulate(system, found.states[0, :1], found.states[0, 1:], 2.0 * found.period_of_loads, forces=forces)
    assert np.abs(motion.final - found.states[0]).max() < 1e-9
    times = found.impacts.periods * found.period_of_loads + found.impacts.times
    assert np.abs(motion.stop_events.times - times).max() < 1e-9 and found.sticking_time == 0.0
    assert np.abs(motion.stop_events.after - found.impacts.after).max() < 1e-9


def test_a_periodic_motion_that_sticks_for_a_while():
    """Oracle: `simulate` over its period: the same state, and the same time of sticking."""
    system, forces = pressed_chain(0.4)
    found = settle(system, forces)
    motion = simulate(system, found.states[0, :2], found.states[0, 2:], found.period * found.period_of_loads, forces=forces)
    assert found.kind is SettledKind.PERIODIC and found.sticking == () and found.sticking_time > 0.1
    assert np.abs(motion.final - found.states[0]).max() < 1e-9 and abs(motion.sticking_time - found.sticking_time) < 1e-7
    # A sticking stop gives two multipliers 0.
    assert np.sum(np.abs(found.multipliers) < 1e-12) == 2 and np.sum(np.abs(found.multipliers) > 1e-6) == 2


def test_the_phase_of_the_start_counts():
    """Oracle: `simulate` from phase 0 passes through the state at phase 2; both go on to the same states."""
    system, forces = impact_oscillator(-0.06)
    u, v = (part[0] for part in simulate(system, [-0.66], [0.0], 2.0 / 2.8, forces=forces).sample([2.0 / 2.8]))
    later = settle(system, forces, u, v, phase=2.0, most=200)
    first = settle(system, forces, [-0.66], [0.0], most=200)
    assert later.period == first.period == 2
    assert min(np.abs(later.states[0] - state).max() for state in first.states) < 1e-8


def test_multipliers_of_equal_modulus_are_in_the_order_of_their_angles():
    """Oracle: exp(-c T/2 +- i w T) for each mode, as all are damped alike. Rounding makes one modulus the largest."""
    for squares in ([1.0, 4.0, 2.0], [1.3, 4.1, 2.2], [1.0, 2.0, 7.7]):
        stiffness = np.diag(squares) + 0.2
        system = ImpactSystem(np.eye(3), 0.1 * np.eye(3), stiffness, [Stop((1.0, 0.0, 0.0), upper=50.0)])
        found = settle(system, [Harmonic(0.7, [1.0, 0.5, 0.2])])
        turns = np.sqrt(np.linalg.eigvalsh(stiffness) - 0.0025) * found.period_of_loads
        angles = sorted(math.remainder(sign * turn, 2.0 * math.pi) for turn in turns for sign in (1.0, -1.0))
        expected = np.exp(-0.05 * found.period_of_loads + 1j * np.array(angles))
        assert found.period == 1 and np.allclose(found.multipliers, expected, atol=1e-9)


def test_slow_convergence_is_reported_with_its_rate():
    """Oracle: x'' + 1e-4 x' + x = cos(1.5 t) converges by exp(-5e-5 2 pi/1.5) in each period."""
    system = oscillator(50.0, damping=1e-4)
    found = settle(system, [Harmonic(1.5, [1.0])], [0.3], most=1000)
    assert found.kind is SettledKind.NOT_CONVERGED and abs(found.growth + 5e-5 * 2.0 * math.pi / 1.5) < 1e-5
    assert "allow more periods" in found.text


def test_a_decay_that_is_slow_is_no_torus():
    """Oracle: the closed form. A transient of x'' + c x' + x = A cos(w t) decays by exp(-c/2 2 pi/w) in each period, and its returns with
    it: more periods than are said suffice, and fewer do not."""
    w, damping = 0.9999, 1e-5
    found = settle(oscillator(50.0, damping=damping), [Harmonic(w, [1e-4])], most=2048)
    exact = -0.5 * damping * 2.0 * math.pi / w
    assert found.kind is SettledKind.NOT_CONVERGED, found.text
    assert found.growth < -5.0 * found.growth_error and found.growth == pytest.approx(exact, rel=2e-3)
    # The transient has nearly the size of the response. After a period it has turned by 2 pi (1/w - 1).
    expected = math.log(2.0 * math.pi * (1.0 / w - 1.0) / 1e-9) / -exact - 2048
    assert abs(found.remaining / expected - 1.0) < 0.05, (found.remaining, expected)
    assert "about 420000 more are expected" in found.text and "torus" not in found.text


@pytest.mark.parametrize(("part", "kind"), [(0.95, SettledKind.NOT_CONVERGED), (1.05, SettledKind.PERIODIC)])
def test_the_periods_that_are_expected_suffice(part, kind):
    system, forces = oscillator(50.0, damping=1e-3), [Harmonic(1.5, [1.0])]
    first = settle(system, forces, [0.3], most=1100)
    assert first.kind is SettledKind.NOT_CONVERGED and first.remaining > 1000.0
    assert settle(system, forces, [0.3], most=1100 + int(part * first.remaining)).kind is kind


def test_a_settled_motion_of_a_longer_period_is_reported():
    """Oracle: at the rate of its tangent vector, -0.006, the absorber at w = 1.33 would have returned after 3000 periods. With
    longer periods, its period is found."""
    scene = load_scene("absorber", w=1.33)
    found = settle(scene.system, scene.forces)
    assert found.kind is SettledKind.LONG_PERIOD and found.growth < -1e-3, found.text
    assert math.isnan(found.remaining) and "its period is above 128" in found.text
    assert settle(scene.system, scene.forces, longest=1000).period == 773


def test_gears_that_turn_return_relative_to_each_other():
    """Oracle: the mean torque 10 turns both by 10/0.1 in a unit of time, 4 pi in a period 2 pi/50. `simulate` gives the multiplier of their
    common speed; the teeth close for a while, so no other difference of two motions is left."""
    teeth = Stop((1.0, -1.0), lower=-0.001, upper=0.001, restitution=0.3)
    gears = ImpactSystem(np.diag([0.01, 0.02]), np.diag([0.0, 0.1]), np.zeros((2, 2)), [teeth])
    loads = [Constant([10.0, 0.0]), Harmonic(50.0, [20.0, 0.0])]
    found = settle(gears, loads)
    assert found.kind is SettledKind.PERIODIC and found.period == 1 and "drifting by 12.5664, 12.5664" in found.text
    np.testing.assert_allclose(found.drift, 4.0 * math.pi, rtol=1e-9)
    u, v, period = found.states[0][:2], found.states[0][2:], 2.0 * math.pi / 50.0
    ends = [simulate(gears, u, v + change, period, forces=loads).final[2:] for change in (1e-3, -1e-3)]
    np.testing.assert_allclose(found.multipliers, [(ends[0] - ends[1])[0] / 2e-3, 0.0, 0.0], atol=1e-6)
    swept, _ = sweep(lambda load: (gears, [loads[0], Harmonic(50.0, [load, 0.0])]), [20.0], settings=SweepSettings(300, 20))
    assert swept.periods[0] == 1 and swept.exponents[0] == pytest.approx(found.growth / period, rel=1e-9)
    for forces in (loads, loads[1:]):  # without a mean torque they turn nowhere, and every place of the train is one of its orbit
        with pytest.raises(NoOrbit, match="orbits of what can drift are not followed"):
            settled_orbit(ParameterPath(ParametricSystem.of(gears, forces), ("w",)), settle(gears, forces))


def test_a_linear_oscillator_without_damping_is_quasiperiodic():
    found = settle(oscillator(50.0), [Harmonic(math.sqrt(2.0), [1.0])], [0.3], most=4096)
    assert found.kind is SettledKind.TORUS and abs(found.growth) < 1e-6 and found.period == 0
    # Two thirds of the frequency of the load: the motion returns after three periods, and does not attract.
    found = settle(oscillator(50.0), [Harmonic(1.5, [1.0])], [0.3])
    assert found.kind is SettledKind.PERIODIC and found.period == 3 and abs(found.growth) < 1e-12


def test_chaos_is_told_by_its_growing_tangent_vector():
    """With the wall in the middle the impact oscillator is chaotic. Oracle: two motions from near starts part, too."""
    system, forces = impact_oscillator(0.0)
    found = settle(system, forces, [-0.3], [0.0])
    assert found.kind is SettledKind.CHAOS and found.growth > 10.0 * found.growth_error > 0.0
    near, growths = found.states[0], []
    for _ in range(100):
        far = near + 1e-9 * np.array([1.0, 1.0])
        ends = [simulate(system, x[:1], x[1:], found.period_of_loads, forces=forces).final for x in (near, far) if x[0] <= 0.0]
        if len(ends) == 2:
            growths.append(np.linalg.norm((ends[1] - ends[0]) * [2.8, 1.0]) / np.linalg.norm((far - near) * [2.8, 1.0]))
        near = ends[0]
    assert np.mean(np.log(growths)) > 0.0


def test_a_pressed_mass_is_at_rest():
    system = ImpactSystem([[1.0]], [[0.0]], [[1.0]], [Stop((1.0,), lower=0.0, restitution=0.3)])
    found = settle(system, [Constant([-1.0]), Harmonic(1.0, [0.5])], [0.7])
    assert found.kind is SettledKind.AT_REST and found.sticking == ("-",) and np.abs(found.states).max() < 1e-12
    # One contact that sticks for ever, while the other mass moves, is a periodic motion.
    chain, forces = pressed_chain(0.4, -1.2)
    found = settle(chain, forces)
    assert found.kind is SettledKind.PERIODIC and found.sticking == ("-",) and not found.stops
    assert "sticking all the time" in found.text


def test_a_simulation_that_ends_is_reported():
    stops = [Stop((1.0, 0.0), lower=-1.0, restitution=0.9), Stop((1.0, 1.0), lower=-1.0, restitution=0.9)]
    system = ImpactSystem(np.eye(2), np.zeros((2, 2)), np.zeros((2, 2)), stops)
    found = settle(system, [Harmonic(1.0, [0.0, 0.0])], [0.0, 0.0], [-1.0, 0.0])
    assert found.kind is SettledKind.FAILED and found.status is MotionStatus.SIMULTANEOUS and "same instant" in found.text


def test_bad_input():
    system, forces = impact_oscillator(-0.1)
    with pytest.raises(BeyondStop):
        settle(system, forces, [0.0])
    with pytest.raises(ValueError, match="phase is a number from 0"):
        settle(system, forces, [-0.2], phase=7.0)
    with pytest.raises(ValueError, match="most is an integer above 0"):
        settle(system, forces, [-0.2], most=0)
    with pytest.raises(ValueError, match="no load is periodic"):
        settle(system, [Constant([1.0])], [-0.2])


@pytest.mark.parametrize("name", ["absorber", "forced_chain", "forced_impact_damper", "oscillator_at_wall", "damped_impact_oscillator"])
def test_the_product_of_the_multipliers_of_shipped_scenes(name):
    """Oracle: the determinant of the map: restitution^2 for each impact, times exp(-tr(M^-1 C) T)."""
    scene = load_scene(name)
    found = settle(scene.system, scene.forces)
    assert found.kind is SettledKind.PERIODIC
    trace = float(np.trace(np.linalg.solve(scene.system.mass, scene.system.damping)))
    expected = math.exp(-trace * found.period * found.period_of_loads)
    for contact in found.impacts.contacts:
        expected *= scene.system.stops[scene.system.modes.contact_stop[contact]].restitution ** 2
    assert abs(np.prod(found.multipliers) / expected - 1.0) < 1e-8


def test_a_motion_that_is_at_zero_at_phase_0_returns():
    """Oracle: y'' = A cos(t) from rest: y = A (1 - cos(t)), which is 0 at phase 0, has period 1 and both multipliers 1."""
    scene = load_scene("impact_pair")
    found = settle(scene.system, scene.forces)
    assert found.kind is SettledKind.PERIODIC and found.period == 1 and not found.stops
    assert np.abs(found.states).max() < 1e-9 and np.allclose(found.multipliers, 1.0, atol=1e-6)


def test_progress_counts_the_periods():
    """Oracle: the numbers rise, and the last one is that of the result."""
    oscillator = ImpactSystem([[1.0]], [[0.1]], [[1.0]], [Stop((1.0,), upper=1.0, restitution=0.8)])
    seen = []
    found = settle(oscillator, [Harmonic(1.0, [0.099])], on_progress=seen.append)
    assert len(seen) > 1 and seen == sorted(seen) and seen[-1] == found.elapsed
