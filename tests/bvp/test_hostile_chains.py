"""Chains that do what they can to keep a run from its end: translations without limit, stops that say the same, bodies that lie still.

Oracles: closed forms, a copy of the system that stands where the other one drifts, the balance of energies, the bounds of the gaps."""

import math

import mpmath
import numpy as np
import pytest

from bvp.checks import EPSILON, InvalidSystem
from bvp.forcing import Constant, Harmonic
from bvp.kernels import contact_mode as places
from bvp.modes import repeated_contacts
from bvp.motion import MotionStatus
from bvp.simulate import Simulator, simulate
from bvp.system import ImpactSystem, Stop
from tests.bvp.twins import chain


def turnover(motion):
    return motion.initial_energy + abs(motion.work) + motion.totals[:-1].sum()


def free_pair(masses=(0.3, 0.7), spring=2.0, restitution=0.4):
    """Two bodies on one spring that nothing holds in place, closer than 1/5 never."""
    stiffness = spring * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return ImpactSystem(np.diag(masses), np.zeros((2, 2)), stiffness, (Stop((-1.0, 1.0), lower=-0.2, restitution=restitution),))


def relative(masses=(0.3, 0.7), spring=2.0, restitution=0.4):
    """The distance of the two alone, with their reduced mass."""
    reduced = 1.0 / (1.0 / masses[0] + 1.0 / masses[1])
    return ImpactSystem([[reduced]], [[0.0]], [[spring]], (Stop((1.0,), lower=-0.2, restitution=restitution),))


@pytest.mark.parametrize("push", [0.0, 1e2, 1e6])
@pytest.mark.parametrize("restitution", [0.0, 0.4, 1.0])
def test_what_a_chain_does_inside_does_not_depend_on_how_far_it_has_gone(push, restitution):
    """Displacements of 1e8 at the end: stick, release, chatter and impacts as of the distance alone, and the centre of mass as a body."""
    masses = 0.3, 0.7
    wave = 0.8
    both = simulate(
        free_pair(restitution=restitution), [0.0, 0.0], [0.5, -1.0], 20.0,
        forces=[Constant([0.3 * push, 0.7 * push]), Harmonic(1.1, cosine=[-wave, wave])],
    )  # fmt: skip
    alone = simulate(relative(restitution=restitution), [0.0], [-1.5], 20.0, forces=Harmonic(1.1, cosine=[wave]))
    assert both.status is alone.status is MotionStatus.DURATION_REACHED
    assert alone.impacts > 5 and [s.sticking for s in both.contact_intervals] == [s.sticking for s in alone.contact_intervals]
    hits, others = (m.stop_events.times[m.stop_events.speeds > 1e-3] for m in (both, alone))
    np.testing.assert_allclose(hits, others, rtol=1e-9)  # slower ones can be summed earlier or later
    centre = np.array(masses) @ both.final[:2]
    assert centre == pytest.approx(0.5 * push * 400.0 + 20.0 * (0.3 * 0.5 - 0.7), rel=1e-12)
    assert abs(both.balance) <= 1e-12 * turnover(both)


def test_the_gaps_of_a_free_chain_have_nothing_of_its_translation():
    """The rows of the gaps, of the forces of held contacts too, are 0 at the translation, exactly."""
    stiffness = np.array([[2.9, -2.9, 0.0], [-2.9, 4.8, -1.9], [0.0, -1.9, 1.9]])
    stops = (Stop((-1.0, 0.0, 1.0), lower=-0.05, restitution=0.38), Stop((-1.0, 1.0, 0.0), upper=0.1, restitution=0.0))
    system = ImpactSystem(np.diag([0.24, 0.89, 0.045]), np.zeros((3, 3)), stiffness, stops)
    simulator = Simulator(system, Constant([1.38, 2.13, 0.22]))
    for held in (1, 2, 3):
        simulator.table.add(held)
    for mode in simulator.table.modes.values():
        moved = mode["from_modes"][:, :3] @ (system.modes.shapes.T @ system.mass @ np.ones(3))
        rigid = np.abs(moved) > 1e-6
        assert rigid.sum() == 1 and np.all(mode["gap"][:, rigid] == 0.0) and np.all(mode["rate"] @ mode["matrix"][:, rigid] == 0.0)


def test_a_translation_is_not_damped_by_a_damper_that_turns_with_it():
    """Two pairs of bodies, each held together: the damper stands between a pair and does nothing, so the rate of the translation is 0."""
    system = chain([5.952, 0.155, 8.165, 0.071], [2.42, 2.70, 2.83], stops=(
        Stop((0.0, 0.0, -1.0, 1.0), upper=0.2, restitution=0.95), Stop((-2.0, 2.0, 0.0, 0.0), lower=-0.2, restitution=0.5),
    ))  # fmt: skip
    damping = np.zeros((4, 4))
    damping[:2, :2] = 0.51 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    system = ImpactSystem(system.mass, damping, system.stiffness, system.stops)
    simulator = Simulator(system)
    simulator.table.add(3)
    mode = simulator.table.modes[3]
    assert np.abs(mode["gap"]).max() < 100.0 and np.all(mode["mean"] == 0.0)


def test_a_body_that_lies_on_its_stop_unpressed_lets_the_rest_move():
    """A body without load, put to rest on its stop by an impact without restitution, beside an oscillator: u = sin t for all the time."""
    stops = (Stop((0.0, 1.0), upper=0.05, restitution=0.0), Stop((1.0, 0.0), upper=2.0))
    system = ImpactSystem(np.eye(2), np.zeros((2, 2)), np.diag([1.0, 0.0]), stops)
    motion = simulate(system, [0.0, 0.0], [1.0, 0.3], 100.0)
    assert motion.status is MotionStatus.DURATION_REACHED and motion.impacts == 1
    np.testing.assert_allclose(motion.final, [math.sin(100.0), 0.05, math.cos(100.0), 0.0], atol=1e-12)


def test_a_crossing_within_the_tolerance_of_another_impact_is_not_passed_over():
    """Two balls, one of them known no better than 1e-12 for it oscillates about a distant place: none is ever below the ground by more than
    its tolerance, though they bounce within 1e-8 of each other's time. The motion starts with little energy: the loads do more work, and
    its rounding is the error of the sums."""
    stops = (Stop((1.0, 0.0), lower=0.0, restitution=0.95), Stop((0.0, 1.0), lower=0.0, restitution=0.5))
    system = ImpactSystem(np.array([[1.0, 0.4], [0.4, 1.0]]), np.zeros((2, 2)), np.diag([0.01, 0.02]), stops)
    for seed in (*range(12), 1142, 1294, 1862, 2004):
        random = np.random.default_rng(seed)
        start = random.uniform(0.01, 0.1, 2)
        motion = simulate(system, start, [0.0, 0.0], 6.0, forces=Constant([-3.0, -5.0]))
        assert motion.status is MotionStatus.DURATION_REACHED
        u, _ = motion.sample(np.linspace(0.0, 6.0, 4000))
        assert u.min() > -1e-11 and abs(motion.balance) <= 1e-12 * turnover(motion)


def test_a_release_is_no_impact():
    """A ball on a flexible floor without rebound, dropped or at rest on it. Oracle: it sticks until the force is 0, and then it rises. An
    impact has a speed."""
    for seed in range(60):
        random = np.random.default_rng(seed)
        n = int(random.integers(1, 5))
        mass, springs = 10.0 ** random.uniform(-1.0, 1.0, n + 1), 10.0 ** random.uniform(-1.0, 2.0, n)
        rows = np.eye(n, n + 1, 1) - np.eye(n, n + 1, 2)  # of the springs of the floor, the last one to the ground
        stop = Stop((1.0, -1.0, *np.zeros(n - 1)), lower=0.0, restitution=0.0)
        system = ImpactSystem(np.diag(mass), np.zeros((n + 1, n + 1)), rows.T @ np.diag(springs) @ rows, (stop,))
        start, load = np.zeros((2, n + 1))
        start[0], load[0] = seed % 2, -mass[0]
        motion = simulate(system, start, np.zeros(n + 1), 20.0, forces=Constant(load))
        assert motion.status is MotionStatus.DURATION_REACHED
        assert np.min(motion.stop_events.speeds[~motion.stop_events.touches], initial=1.0) > 1e-6


def test_a_light_ball_between_a_wall_and_a_heavy_body_that_comes_is_stopped_with_it():
    """Inelastic collapse at one instant: impact after impact without time passing. Both bodies end at rest at the wall."""
    stops = (Stop((1.0, 0.0), lower=0.0, restitution=0.07), Stop((-1.0, 1.0), lower=0.0, restitution=0.17))
    system = ImpactSystem(np.diag([0.038, 8.8]), np.zeros((2, 2)), np.zeros((2, 2)), stops)
    motion = simulate(system, [0.0, 0.2], [0.0, -0.8], 20.0, forces=Constant([-0.1, -1.0]))
    assert motion.status is MotionStatus.DURATION_REACHED
    np.testing.assert_allclose(motion.final, 0.0, atol=1e-9)
    assert abs(motion.balance) <= 1e-12 * turnover(motion)


def test_an_end_that_makes_no_way_is_counted():
    """By construction: events to which time passes, but less than a radian of the fastest motion in thousands of them, end the run."""
    simulator = Simulator(free_pair(), Constant([1.0, -1.0]))
    counts, clock = np.zeros(places.COUNTS, dtype=np.int64), np.zeros(places.CLOCK)
    from bvp.kernels.motion import PATIENCE, impatient

    phases = simulator.table.stacked
    events = 0
    while not impatient(phases, 0, False, 1e-9, counts, clock):
        clock[places.TIME] += 1e-9
        events += 1
    assert events == PATIENCE * (2 + phases.side.shape[1])


def two_names(first, second, *, factor=-2.0):
    """One gap with two stops at its upper bound."""
    stops = (Stop((1.0, 0.0), -0.3, 0.1, restitution=first), Stop((factor, 0.0), lower=factor * 0.1, restitution=second))
    return ImpactSystem(np.eye(2), np.zeros((2, 2)), np.array([[2.0, -1.0], [-1.0, 1.0]]), stops)


@pytest.mark.parametrize("restitution", [0.0, 0.5, 0.95, 1.0])
def test_a_stop_with_two_names_is_hit_once(restitution):
    """Oracle: the same system without the second name."""
    twice = two_names(restitution, restitution)
    once = ImpactSystem(twice.mass, twice.damping, twice.stiffness, twice.stops[:1])
    assert repeated_contacts(twice.stops) == {2: 1}
    results = [simulate(system, [0.0, 0.0], [1.0, -0.5], 30.0, forces=Constant([0.4, 0.1])) for system in (twice, once)]
    assert all(motion.status is MotionStatus.DURATION_REACHED for motion in results)
    assert results[0].impacts == results[1].impacts > 0
    np.testing.assert_array_equal(results[0].final, results[1].final)


def test_two_restitutions_at_one_place_are_refused():
    words = "stops a and b end the same gap at the same place, 0.1 of stop a, with restitutions 0.5 and 0.7"
    with pytest.raises(InvalidSystem, match=words):
        two_names(0.5, 0.7)
    assert two_names(0.5, 0.7, factor=1.0).stops[1].lower == 0.1  # the other way: a different obstacle


def test_resting_contacts_that_depend_on_each_other_take_a_blow():
    """A body in a corner of three stops whose rows depend on each other, struck by another one: momentum along the free direction is kept,
    and no speed is left towards a stop."""
    rows = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (1.0, 1.0, 0.0))
    stops = (*(Stop(row, lower=0.0, restitution=0.0) for row in rows), Stop((-1.0, 0.0, 1.0), lower=0.0, restitution=0.5))
    system = ImpactSystem(np.diag([1.0, 2.0, 0.5]), np.zeros((3, 3)), np.zeros((3, 3)), stops)
    motion = simulate(system, [0.0, 0.0, 0.5], [0.0, 0.0, -1.0], 5.0, forces=Constant([-1.0, -1.0, 0.0]))
    assert motion.status is MotionStatus.DURATION_REACHED and motion.impacts == 1
    np.testing.assert_allclose(motion.final, [0.0, 0.0, 0.5 * 4.5, 0.0, 0.0, 0.5], atol=1e-13)


def test_many_long_drifts_have_the_energy_of_each_alone():
    """Bodies 1e6 away, whose stiff springs turn the rounding of so long a way into energy where it is taken from (u, v)."""
    system = chain([0.24, 0.89, 0.45], [2.9e4, 1.9e4], stops=(Stop((-1.0, 0.0, 1.0), lower=-0.2, restitution=0.4),))
    simulator = Simulator(system, Constant([1.38e3, 2.13e3, 0.22e3]))
    batch = simulator.run_many([[0.0, 0.0, 0.0, 0.5, -1.0, 0.3]], 30.0)
    alone = simulator.run([0.0, 0.0, 0.0], [0.5, -1.0, 0.3], 30.0)
    assert batch.final[0, 0] > 1e6 and abs(batch.energy[0] - alone.energy) <= 1e-15 * alone.energy
    assert abs(batch.balance[0]) <= 1e-13 * turnover(alone)


@pytest.mark.parametrize("damper", [1e4])
def test_rates_far_apart_do_not_overflow(damper):
    """Oracle: see `require_rates_far_apart_do_not_overflow`."""
    require_rates_far_apart_do_not_overflow(damper)


def require_rates_far_apart_do_not_overflow(damper, duration=3.0):
    """Rates as far apart as c^2/k beside a load. Oracle: the matrix exponential with 50 digits; rounding is that of the gap, 50."""
    stiffness, load, v = np.array([[0.06, -0.02], [-0.02, 0.02]]), [0.2, -0.3], [0.5, -0.3]
    system = ImpactSystem(np.eye(2), damper * np.eye(2), stiffness, (Stop((1.0, 0.0), upper=50.0),))
    simulator = Simulator(system, Constant(load))
    motion, batch = simulator.run([0.0, 0.0], v, duration), simulator.run_many([[0.0, 0.0, *v]], duration)
    assert motion.status is batch.status[0] is MotionStatus.DURATION_REACHED and abs(motion.balance) <= 1e-12 * turnover(motion)
    with mpmath.workdps(50):
        rates = np.zeros((5, 5))
        rates[:2, 2:4], rates[2:4, :2], rates[2:4, 2:4], rates[2:4, 4] = np.eye(2), -stiffness, -damper * np.eye(2), load
        exact = mpmath.expm(mpmath.matrix(rates) * duration) * mpmath.matrix([0.0, 0.0, *v, 1.0])
    for state in (motion.final, batch.final[0]):
        np.testing.assert_allclose(state, [float(x) for x in exact[:4]], rtol=1e-12, atol=50.0 * EPSILON)
