"""Stops that are held, several at once, and marks, shares and parts of the dissipation. Oracles: the same motion of a system that has the
constraint built in, a stop of very little restitution, closed forms, the conservative flight."""

import math
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bvp.forcing import Constant, Harmonic, Record, split_damping
from bvp.motion import EventKind, MotionStatus
from bvp.simulate import Simulator, simulate
from bvp.springs import Spring
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from tests.bvp.twins import chain, force_at


def random_held(seed, n, restitution=0.0):
    """A random damped system pressed onto one stop by a constant load, at rest there."""
    rng = np.random.default_rng(seed)
    half, root, top = rng.normal(size=(3, n, n))
    mass = top @ top.T + n * np.eye(n)
    row = rng.normal(size=n)
    system = ImpactSystem(mass, 0.3 * half @ half.T, root @ root.T + np.eye(n), (Stop(tuple(row), upper=0.2, restitution=restitution),))
    u = rng.normal(size=n)
    u += row * (0.2 - row @ u) / (row @ row)
    v = rng.normal(size=n)
    v -= np.linalg.solve(mass, row) * (row @ v) / (row @ np.linalg.solve(mass, row))
    return system, row, u, v, rng


@settings(max_examples=12, deadline=None)
@given(st.integers(2, 4), st.integers(0, 2**31), st.booleans())
def test_a_held_motion_is_that_of_the_constrained_equations(n, seed, forced):
    """M u'' + C u' + K u = f + c force, c . u'' = 0: the residual of the dense output, by its own accelerations, and the sign of the
    force."""
    system, row, u, v, rng = random_held(seed, n)
    press = 50.0 * row / (row @ np.linalg.solve(system.mass, row))
    forces = [Constant(press)] + ([Harmonic(1.3, cosine=rng.normal(size=n))] if forced else [])
    motion = simulate(system, u, v, 2.0, forces=forces)
    assert [stretch.sticking for stretch in motion.contact_intervals if stretch.end > 0.0] == [("+",)]
    times = np.linspace(0.1, 1.9, 7)
    h = 1e-4
    for t in times:
        (a, b, c), (_, rate, _) = motion.sample([t - h, t, t + h])
        np.testing.assert_allclose(row @ b, 0.2, atol=1e-13)
        np.testing.assert_allclose(row @ rate, 0.0, atol=1e-13)
        acceleration = (a - 2 * b + c) / h**2
        force = system.mass @ acceleration + system.damping @ rate + system.stiffness @ b - force_at(motion.forcing, t)
        multiplier = (force @ row) / (row @ row)
        assert multiplier < 0.0
        np.testing.assert_allclose(force, multiplier * row, atol=2e-5 * np.abs(force).max())
    assert motion.balance_error < 1e-12 and motion.sticking_time == 2.0


def test_a_contact_stays_held_while_bounces_at_another_are_summed():
    """Oracle: the first contact is pressed all the time, so that it is held as long as the motion lasts; the second chatters meanwhile."""
    stops = Stop((1.0, 0.0), upper=1.0, restitution=0.0, name="a"), Stop((0.0, 1.0), upper=1.0, restitution=0.6, name="b")
    system = ImpactSystem(np.eye(2), np.zeros((2, 2)), np.zeros((2, 2)), stops)
    motion = simulate(system, [1.0, 0.5], [0.0, 0.0], 20.0, forces=[Constant([1.0, 1.0])])
    assert EventKind.CHATTER.value in motion.kinds
    assert motion.sticking_time == pytest.approx(20.0, rel=1e-14)


def test_a_release_is_where_the_force_vanishes_and_not_later():
    """Chain of three, pressed by a record that fades: the multiplier, from the constrained equations in numpy, changes sign there."""
    system = chain([0.5, 1.0, 2.0], [1.0, 0.7], ground=0.3, damping=0.05, stops=(Stop((1.0, 0.0, 0.0), lower=-0.1, restitution=0.0),))
    forces = Record([-1.0, 0.2, 0.0], [0.0, 4.0], [2.0, -1.0])
    motion = simulate(system, [-0.1, 0.3, -0.2], [0.0, 0.1, 0.0], 4.0, forces=forces)
    at = int(np.flatnonzero(motion.kinds == EventKind.RELEASE.value)[0])
    row = np.array([1.0, 0.0, 0.0])
    inverse = np.linalg.inv(system.mass)

    def force(state, t):
        free = inverse @ (force_at(motion.forcing, t) - system.stiffness @ state[:3] - system.damping @ state[3:])
        return -(row @ free) / (row @ inverse @ row)

    time = motion.times[at]
    assert abs(force(motion.before[at], time)) < 1e-14
    for t in np.linspace(motion.times[at - 1], time - 1e-3, 200):
        assert force(np.hstack(motion.sample([t]))[0], t) > 0.0
    assert motion.sample([time + 0.01])[0][0, 0] > -0.1


def test_two_stops_are_held_and_released_one_by_one():
    """Two separate masses as one system: each as if alone."""
    def alone(k, bound, rate):
        return ImpactSystem([[1.0]], [[0.1]], [[k]], (Stop((1.0,), lower=bound, restitution=rate),))

    stops = (Stop((1.0, 0.0), lower=0.0, restitution=0.5), Stop((0.0, 1.0), lower=0.1, restitution=0.2))
    together = ImpactSystem(np.eye(2), 0.1 * np.eye(2), np.diag([1.0, 3.0]), stops)
    first, second = Harmonic(0.7, cosine=[1.0], sine=[-1.0]), Harmonic(1.1, sine=[1.5])
    both = [Harmonic(0.7, cosine=[1.0, 0.0], sine=[-1.0, 0.0]), Harmonic(1.1, sine=[0.0, 1.5])]
    motion = simulate(together, [0.4, 0.3], [0.0, -1.0], 60.0, forces=both)
    one = simulate(alone(1.0, 0.0, 0.5), [0.4], [0.0], 60.0, forces=first)
    two = simulate(alone(3.0, 0.1, 0.2), [0.3], [-1.0], 60.0, forces=second)
    assert motion.status is MotionStatus.DURATION_REACHED
    np.testing.assert_allclose(motion.final, [one.final[0], two.final[0], one.final[1], two.final[1]], atol=1e-9)
    assert {stretch.sticking for stretch in motion.contact_intervals} >= {(), ("b-",), ("a-", "b-")}
    assert motion.dissipated["stop a"] == pytest.approx(one.dissipated["stop a"], rel=1e-9)
    assert motion.dissipated["stop b"] == pytest.approx(two.dissipated["stop a"], rel=1e-9)
    assert motion.balance_error < 1e-12


def row_of_three(second, duration=0.9):
    """Three masses, the middle one pressed onto its stop by a force of 1; the left one hits it at time 0.5 with speed 2."""
    stops = (Stop((0.0, 1.0, 0.0), lower=0.0, restitution=0.0), second)
    system = ImpactSystem(np.eye(3), np.zeros((3, 3)), np.diag([0.0, 1e-3, 1.0]), stops)
    side = 1.0 if second.upper > 1e9 else -1.0
    return simulate(system, [0.0, 0.0, 0.0], [2.0 * side, 0.0, 0.0], duration, forces=Constant([0.0, -1.0, 0.0]))


def test_a_blow_away_from_its_stop_frees_a_held_mass():
    away = row_of_three(Stop((-1.0, 1.0, 0.0), lower=-1.0, restitution=0.6))
    assert away.status is MotionStatus.DURATION_REACHED
    assert [s.sticking for s in away.contact_intervals][-2:] == [("a-",), ()]
    assert away.after[np.flatnonzero(away.kinds == EventKind.IMPACT.value)[-1], 3:5] == pytest.approx([2.0 * 0.2, 2.0 * 0.8], rel=1e-14)


def test_a_blow_onto_its_stop_meets_a_held_mass_as_a_wall():
    """The held mass stays: the other one leaves with 0.6 of its speed and loses (1 - 0.36) 2^2/2, as from a wall."""
    into = row_of_three(Stop((-1.0, 1.0, 0.0), upper=1.0, restitution=0.6))
    assert into.status is MotionStatus.DURATION_REACHED and into.contact_intervals[-1].sticking == ("a-",)
    assert into.last_impact == pytest.approx(0.5, rel=1e-14)
    assert into.dissipated["stop b"] == pytest.approx(1.28, rel=1e-14) and into.dissipated["stop a"] == 0.0
    np.testing.assert_allclose(into.final, [-1.0 + 1.2 * 0.4, 0.0, 0.0, 1.2, 0.0, 0.0], atol=1e-14)
    assert into.balance_error < 1e-15


def test_a_body_that_lies_on_its_stop_unpressed_is_a_wall_too():
    """Two free bodies: the first comes to rest at 0 at time 0.1, the second meets it at time 1.8 and leaves with half its speed."""
    stops = (Stop((1.0, 0.0), lower=0.0, restitution=0.0), Stop((-1.0, 1.0), lower=0.1, restitution=0.5))
    motion = simulate(ImpactSystem(np.eye(2), np.zeros((2, 2)), np.zeros((2, 2)), stops), [0.1, 1.0], [-1.0, -0.5], 2.8)
    assert motion.status is MotionStatus.DURATION_REACHED
    np.testing.assert_allclose(motion.times, [0.0, 0.1, 1.8], rtol=1e-14)
    np.testing.assert_allclose(motion.final, [0.0, 0.35, 0.0, 0.25], atol=1e-14)
    assert motion.dissipated == {"gaps": 0.0, "rest": 0.0, "stop a": 0.5, "stop b": pytest.approx(0.5 * 0.25 * 0.75, rel=1e-14)}


def shared_blow(mass, gaps, held, struck, restitution, v):
    """Newton's law at all contacts at once, by trying every set of held contacts that stays: velocities after it, and the set."""
    inverse = np.linalg.inv(mass)
    for count in range(len(held), -1, -1):
        for stay in combinations(held, count):
            rows = gaps[[*stay, struck]]
            target = np.append(np.zeros(count), -restitution * gaps[struck] @ v)
            impulse = np.linalg.solve(rows @ inverse @ rows.T, target - rows @ v)
            after = v + inverse @ rows.T @ impulse
            left = [k for k in held if k not in stay]
            if np.all(impulse[:count] >= 0.0) and np.all(gaps[left] @ after >= 0.0):
                return after, set(stay)
    raise AssertionError("no set")


def test_a_blow_on_held_contacts_presses_some_and_frees_others():
    """Bodies that share inertia, three of them held at lower stops by loads: against the enumeration of what may stay held."""
    random = np.random.default_rng(3)
    seen = set()
    for _ in range(12):
        root = random.normal(size=(4, 4))
        mass = root @ root.T + 0.3 * np.eye(4)
        stops = [Stop(tuple(np.eye(4)[k]), lower=0.0, restitution=0.0) for k in range(3)]
        stops.append(Stop((0.0, 0.0, 0.0, 1.0), lower=-1.0, restitution=0.4))
        system = ImpactSystem(mass, np.zeros((4, 4)), 1e-3 * np.eye(4), tuple(stops))
        # With x4'' = 0 and a force of -1 on all held bodies, these are pressed with 1 each.
        motion = simulate(system, np.zeros(4), [0.0, 0.0, 0.0, -2.0], 1.0, forces=Constant([-1.0, -1.0, -1.0, 0.0]))
        assert motion.status is MotionStatus.DURATION_REACHED
        hit = int(np.flatnonzero((motion.kinds == EventKind.IMPACT.value) & (motion.contacts == 3))[0])
        before = motion.before[hit, 4:]
        held = next(stretch.sticking for stretch in motion.contact_intervals if stretch.begin < motion.times[hit] - 1e-9 <= stretch.end)
        assert held == ("a-", "b-", "c-")
        after, stay = shared_blow(mass, np.eye(4), [0, 1, 2], 3, 0.4, before)
        np.testing.assert_allclose(motion.after[hit, 4:], after, atol=1e-12)
        assert motion.losses[hit] == pytest.approx(0.5 * (before @ mass @ before - after @ mass @ after), rel=1e-12)
        assert motion.balance_error < 1e-12
        seen.add(len(stay))
    assert {0, 1, 2} <= seen


def test_simultaneous_impacts_of_stops_that_interact_end_the_motion():
    mass = np.array([[1.0, 0.3], [0.3, 1.0]])
    system = ImpactSystem(mass, np.zeros((2, 2)), mass, (Stop((1.0, 0.0), upper=0.5), Stop((0.0, 1.0), upper=0.5)))
    motion = simulate(system, [0.0, 0.0], [1.0, 1.0], 5.0)
    assert motion.status is MotionStatus.SIMULTANEOUS and motion.duration == pytest.approx(math.pi / 6, rel=1e-12)
    assert "interact" in motion.status.value and motion.balance_error < 1e-14 and not len(motion.stop_events)


def test_marks_are_the_times_at_which_so_much_is_gone():
    """Against the cumulated dissipation at those times, in flights, at impacts and in the tail."""
    motion = simulate(vibro_impact_nes(0.1, 0.1, 0.01, 0.7), [0.0, 0.0], [0.0, 4.0], 3000.0, marks=(0.1, 0.5, 0.85, 0.9, 0.99, 0.999999))
    assert motion.clear_from is not None and motion.clear_from >= motion.last_impact
    for mark in motion.marks:
        spent = motion.spent([mark.time])[0, :-1]
        just_before = motion.spent([mark.time * (1 - 1e-13)])[0, :-1].sum()
        assert just_before <= mark.fraction * motion.initial_energy * (1 + 1e-12)
        assert spent.sum() >= mark.fraction * motion.initial_energy * (1 - 1e-12)
        np.testing.assert_allclose(list(mark.dissipated.values()), spent, rtol=1e-11)
    late = simulate(vibro_impact_nes(0.1, 0.1, 0.0, 0.7), [0.0, 0.0], [0.0, 4.0], 3000.0, marks=(0.5, 0.9999999)).marks
    assert late[0].time is not None and late[1].time is None


def test_dampers_across_gaps_are_told_from_the_rest():
    """C = 0.2 (1, -1)'(1, -1) + diag(0, 0.05): 0.2 belongs to the gap; the parts are each the integral of their own v'Cv."""
    gap = 0.2 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    plain = vibro_impact_nes(0.1, 0.1, 0.05, 0.7)
    system = ImpactSystem(plain.mass, plain.damping + gap, plain.stiffness, plain.stops, absorber=0, primary=1)
    parts = split_damping(system)
    np.testing.assert_allclose(parts["gaps"], gap, atol=1e-16)
    np.testing.assert_allclose(parts["rest"], plain.damping, atol=1e-16)
    motion = simulate(system, [0.0, 0.0], [0.0, 3.0], 20.0)
    own = simulate(system, [0.0, 0.0], [0.0, 3.0], 20.0, dampers={"all": system.damping})
    assert motion.dissipated["gaps"] + motion.dissipated["rest"] == pytest.approx(own.dissipated["all"], rel=1e-12)
    assert motion.dissipated["gaps"] > 0.0 < motion.dissipated["rest"] and motion.balance_error < 1e-13


def test_many_motions_are_those_run_one_by_one():
    simulator = Simulator(vibro_impact_nes(0.3, 0.05, 0.02, 0.3), forces=Harmonic(1.2, cosine=[0.0, 0.4]))
    states = np.random.default_rng(4).normal(size=(20, 4)) * [0.2, 0.2, 2.0, 2.0]
    batch = simulator.run_many(states, 60.0, marks=(0.5, 0.9))
    for k, state in enumerate(states):
        motion = Simulator(simulator.system, forces=Harmonic(1.2, cosine=[0.0, 0.4])).run(state[:2], state[2:], 60.0, marks=(0.5, 0.9))
        assert batch.impacts[k] == motion.impacts and batch.status[k] is motion.status
        np.testing.assert_allclose(batch.final[k], motion.final, atol=1e-11)
        np.testing.assert_allclose(batch.totals[k], motion.totals, rtol=1e-11)
        assert batch.sticking_time[k] == pytest.approx(motion.sticking_time, rel=1e-11, abs=1e-15)
        for q, mark in enumerate(motion.marks):
            assert np.isnan(batch.marks[k, q, 0]) if mark.time is None else batch.marks[k, q, 0] == pytest.approx(mark.time, rel=1e-10)
    assert (batch.sticking_time > 0.0).any()


def test_a_motion_is_sampled_alike_after_its_simulator_has_met_more_contact_modes():
    """Oracle: the samples, peaks and sums before."""
    simulator = Simulator(vibro_impact_nes(0.1, 0.1, 0.01, 0.0))
    free = simulator.run([0.0, 0.0], [0.0, 0.2], 2.0)
    times = np.linspace(0.0, 2.0, 9)
    before = [*free.sample(times), free.spent(times), free.peaks, free.after]
    stuck = simulator.run([0.0, 0.0], [0.0, 3.0], 5.0)
    assert stuck.sticking_time > 0.0 and len(stuck.contact_modes.sticking) > len(free.contact_modes.sticking)
    for name in ("peaks", "after"):
        del free.__dict__[name]
    for one, other in zip(before, [*free.sample(times), free.spent(times), free.peaks, free.after], strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_peak_after_a_hundred_thousand_periods_is_found():
    """Oracle: two unit oscillators and a weak spring k between them: from (1, 0) at rest u2 = (cos t - cos w t)/2, w^2 = 1 + 2 k, grows
    to 1 over the half beat pi/(w - 1), some 120,000 periods of u2."""
    k = 8e-6
    system = ImpactSystem(np.eye(2), np.zeros((2, 2)), [[1.0 + k, -k], [-k, 1.0 + k]], (Stop((1.0, 0.0), upper=9.0),))
    beat = math.pi / (math.sqrt(1.0 + 2.0 * k) - 1.0)
    simulator = Simulator(system)
    state = np.array([[1.0, 0.0, 0.0, 0.0]])
    np.testing.assert_allclose(simulator.run(state[0, :2], state[0, 2:], beat).peaks, 1.0, rtol=1e-9)
    np.testing.assert_allclose(simulator.run_many(state, beat, with_peaks=True).peaks[0], 1.0, rtol=1e-9)


@pytest.mark.parametrize("forced", [False, True])
def test_peaks_are_the_largest_displacements(forced):
    """Against dense samples: none is larger, and one comes near to second order of their distance."""
    simulator = Simulator(vibro_impact_nes(0.3, 0.05, 0.02, 0.3), forces=Harmonic(1.2, cosine=[0.0, 0.4]) if forced else None)
    states = np.random.default_rng(5).normal(size=(8, 4)) * [0.2, 0.2, 2.0, 2.0]
    batch = simulator.run_many(states, 40.0, with_peaks=True)
    for state, peaks in zip(states, batch.peaks, strict=True):
        motion = simulator.run(state[:2], state[2:], 40.0)
        u, _ = motion.sample(np.linspace(0.0, 40.0, 40_001))
        largest = np.abs(u).max(axis=0)
        assert np.all(motion.peaks >= largest * (1 - 1e-14))
        np.testing.assert_allclose(motion.peaks, largest, rtol=2e-3)
        np.testing.assert_allclose(peaks, motion.peaks, rtol=1e-11)
    closed = simulate(ImpactSystem([[1.0]], [[0.2]], [[1.0]], (Stop((1.0,), upper=9.0),)), [0.0], [1.0], 30.0)
    w = math.sqrt(0.99)
    assert closed.peaks[0] == pytest.approx(math.exp(-0.1 * math.atan2(w, 0.1) / w), rel=1e-14)


@pytest.mark.parametrize("duration", [0.1, 20.0, 300.0])
def test_peaks_of_masses_at_rest_that_a_far_load_moves(duration):
    """The last of five masses moves with the tenth power of the time. Oracle: the closed form of each mode from rest, sampled."""
    stiffness = 2.0 * np.eye(5) - np.eye(5, k=1) - np.eye(5, k=-1)
    system = ImpactSystem(np.eye(5), np.zeros((5, 5)), stiffness, (Stop((0.0,) * 4 + (1.0,), upper=9.0),))
    squares, shapes = np.linalg.eigh(stiffness)
    times = np.linspace(0.0, duration, 100_001)
    nu = 0.4
    modal = [shapes[0, k] * (np.cos(nu * times) - np.cos(math.sqrt(s) * times)) / (s - nu * nu) for k, s in enumerate(squares)]
    largest = np.abs(shapes @ modal).max(axis=1)
    simulator, start = Simulator(system, forces=Harmonic(nu, cosine=np.eye(5)[0])), np.zeros(5)
    close = {"rtol": 2e-5, "atol": 1e-14}
    np.testing.assert_allclose(simulator.run_many(np.zeros((1, 10)), duration, with_peaks=True).peaks[0], largest, **close)
    np.testing.assert_allclose(simulator.run(start, start, duration).peaks, largest, **close)


def test_samples_of_summed_bounces_stay_at_the_stop():
    """From the last impact that is reported to the end of the bounces: the gap is closed to the height of a bounce, and energies go on."""
    system = ImpactSystem([[1.0]], [[0.3]], [[1.0]], (Stop((1.0,), 0.5, restitution=0.7),))
    motion = simulate(system, [0.9], [0.0], 20.0)
    begin = int(np.flatnonzero(motion.kinds == EventKind.CHATTER.value)[0])
    assert [EventKind(k).name for k in motion.kinds[begin - 1 :]] == ["IMPACT", "CHATTER", "STICK"]
    assert motion.times[begin] == pytest.approx(motion.times[begin - 1], rel=1e-15)
    times = np.linspace(motion.times[begin], motion.times[begin + 1], 50)
    u, _ = motion.sample(times)
    np.testing.assert_allclose(u, 0.5, atol=1e-13)
    spent = motion.spent(times)
    assert np.all(np.diff(spent.sum(axis=1)) >= -4.0 * np.finfo(float).eps * motion.initial_energy)
    assert spent[-1].sum() == pytest.approx(motion.sums[begin + 1].sum(), rel=1e-15)
    assert motion.contact_intervals[0].end == motion.times[begin + 1]


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda simulator: simulator.run([0.0, 0.0], [0.0, 0.0], -1.0), "duration is a finite time of 0 or more; received -1.0"),
        (lambda simulator: simulator.run([0.0, 0.0], [0.0, 0.0], 1.0, 10, "a+"), r"no contact 'a\+'; this system's contacts are -, \+"),
        (lambda simulator: simulator.run([0.0, 0.0], [0.0, 0.0], 1.0, marks=(0.5, 1.0)), "marks are fractions of the initial energy"),
        (lambda simulator: simulator.run_many([[0.0, 0.0]], 1.0), r"states is an array \(m, 4\) of finite numbers"),
        (lambda simulator: simulator.run([0.0, 0.0], [0.0, 1.0], 1.0).sample([2.0]), "the motion covers times 0 to 1; received 2"),
    ],
)
def test_bad_input_is_refused(call, words):
    with pytest.raises(ValueError, match=words):
        call(Simulator(vibro_impact_nes()))


def test_of_many_starts_each_has_a_status_of_its_own():
    """Oracle: the gap and its bounds."""
    batch = Simulator(vibro_impact_nes()).run_many([[1.5, 0.0, 0.0, 0.0], [0.5, 0.0, 0.0, 0.0]], 1.0)
    assert batch.status == (MotionStatus.OUTSIDE, MotionStatus.DURATION_REACHED) and batch.duration[0] == 0.0


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("power", [0, 3])
def test_a_start_on_a_stop_without_force_leaves_it(side, power):
    """Oracles: x = 1 - t^4/6 to the fourth order, and of the linear spring the closed form (4 cos t - cos 2 t)/3."""
    bounds = {"upper": 1.0} if side > 0.0 else {"lower": -1.0}
    springs = [Spring((1.0,), stiffness=1.0, power=power)] if power else []
    system = ImpactSystem([[1.0]], [[0.0]], [[0.0 if power else 1.0]], (Stop((1.0,), restitution=0.8, **bounds),), springs=springs)
    motion = simulate(system, [side], [0.0], 3.0, forces=Harmonic(2.0, cosine=[side]))
    assert motion.status is MotionStatus.DURATION_REACHED and motion.impacts == 0 and motion.sticking_time == 0.0
    early = np.array([0.01, 0.02, 0.05])
    assert np.abs(side * motion.sample(early)[0][:, 0] - (1.0 - early**4 / 6.0)).max() < 1e-8  # the next term is of the sixth order
    if not power:
        times = np.linspace(0.0, 3.0, 31)
        assert np.abs(side * motion.sample(times)[0][:, 0] - (4.0 * np.cos(times) - np.cos(2.0 * times)) / 3.0).max() < 1e-14


def test_a_force_that_rises_from_zero_with_the_second_order_keeps_a_contact_closed():
    """Oracle: on the stop x = 1 the contact force is 1 - cos 2 t, which is never below 0."""
    system = ImpactSystem([[1.0]], [[0.0]], [[1.0]], (Stop((1.0,), upper=1.0, restitution=0.8),))
    motion = simulate(system, [1.0], [0.0], 3.0, forces=[Constant([2.0]), Harmonic(2.0, cosine=[-1.0])])
    assert motion.status is MotionStatus.DURATION_REACHED and motion.impacts == 0 and motion.sticking_time == 3.0


@pytest.mark.parametrize("n", [2, 3, 8, 14])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_first_derivative_that_is_not_zero_decides_of_any_order(n, sign):
    """A chain of unit masses and springs, pulled or pushed at its far end: the first mass begins with the derivative of order 2 n, as
    +-t^(2n)/(2n)!. Oracle: the modes of the chain without a stop."""
    stiffness = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    system = ImpactSystem(np.eye(n), np.zeros((n, n)), stiffness, (Stop(tuple(np.eye(n)[0]), upper=0.0, restitution=0.5),))
    motion = simulate(system, np.zeros(n), np.zeros(n), 2.5, forces=Constant(sign * np.eye(n)[-1]))
    assert motion.status is MotionStatus.DURATION_REACHED and motion.impacts == 0
    assert motion.sticking_time == (2.5 if sign > 0.0 else 0.0)
    if sign < 0.0:
        squares, shapes = np.linalg.eigh(stiffness)
        times = np.linspace(0.0, 2.5, 11)
        free = -(1.0 - np.cos(np.outer(times, np.sqrt(squares)))) @ (shapes[0] * shapes[-1] / squares)
        assert np.abs(motion.sample(times)[0][:, 0] - free).max() < 1e-14


def balls(gap, mass=1.0):
    """Two balls under unit gravity, above a floor and above each other. The upper one has unit mass."""
    stops = Stop((1.0, 0.0), lower=0.0, restitution=1.0, name="a"), Stop((-1.0, 1.0), lower=0.0, restitution=1.0, name="b")
    return simulate(
        ImpactSystem(np.diag([mass, 1.0]), np.zeros((2, 2)), np.zeros((2, 2)), stops), [1.0, 1.0 + gap], [0.0, 0.0], 2.0,
        forces=Constant([-mass, -1.0]),
    )  # fmt: skip


def test_an_impact_through_touching_bodies_ends_the_motion():
    """Balls that touch and fall together have no force between them. What the impact of the lower one does depends on whether they touch:
    restitution does not define it. Oracle: with a gap the balls of mass M and 1 meet after the impact at the floor, and the upper one
    rises to ((3 M - 1)/(M + 1))^2 times its height: 8.976 for M = 1000."""
    touching = balls(0.0)
    assert touching.status is MotionStatus.SIMULTANEOUS and touching.impacts == 0 and touching.sticking_time == 0.0
    assert touching.duration == pytest.approx(math.sqrt(2.0), rel=1e-14)
    for mass in (1.0, 1000.0):
        apart = balls(1e-9, mass)
        assert apart.status is MotionStatus.DURATION_REACHED and apart.stop_events.contacts[:2] == ("a-", "b-")
        speed = apart.final[3] + 2.0 - math.sqrt(2.0)
        assert 0.5 * speed**2 == pytest.approx(((3.0 * mass - 1.0) / (mass + 1.0)) ** 2, rel=1e-8)


def test_a_body_that_touches_another_one_and_is_not_driven_into_it_goes_on():
    """Two masses fall together and touch sideways; a third one, on which neither acts, bounces. Oracle: free fall, without an impact."""
    stops = Stop((0.0, 0.0, 1.0), lower=0.0, restitution=1.0, name="a"), Stop((-1.0, 1.0, 0.0), lower=0.0, restitution=0.5, name="b")
    system = ImpactSystem(np.eye(3), np.zeros((3, 3)), np.zeros((3, 3)), stops)
    motion = simulate(system, [1.0, 1.0, 0.5], [0.0] * 3, 4.0, forces=Constant([-1.0, -1.0, -1.0]))
    assert motion.status is MotionStatus.DURATION_REACHED and set(motion.stop_events.contacts) == {"a-"} and motion.impacts == 2
    assert np.abs(motion.final[:2] - (1.0 - 8.0)).max() < 1e-14 * 8.0


@pytest.mark.parametrize("n", [6, 21, 51])
def test_a_bar_that_lands_without_rebound_stays_on_the_wall(n):
    """A free elastic bar meets a wall with its first mass, which stops. Until then the bar is not strained, so that the contact force
    begins at 0. Oracle: the bar is twice the time of a wave on the wall, about 2, and has one impact of each landing."""
    stiffness = n * (2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    stiffness[0, 0] = stiffness[-1, -1] = n
    system = ImpactSystem(np.eye(n) / n, np.zeros((n, n)), stiffness, (Stop(tuple(np.eye(n)[0]), lower=0.0, restitution=0.0),))
    motion = simulate(system, np.full(n, 0.1), -np.ones(n), 10.0)
    assert motion.status is MotionStatus.DURATION_REACHED
    assert motion.impacts == 1 and motion.stop_events.speeds[0] == pytest.approx(1.0, rel=1e-13)
    assert 1.8 < motion.sticking_time < 2.2


@pytest.mark.parametrize("damping", [4e7, 4e10])
def test_a_body_that_creeps_away_from_its_stop_does_not_hit_it(damping):
    """Oracle: c u' = 0.1 cos t - u < 0 but for parts 1/c^2, so u falls below the stop and no impact comes, though rounding of u is larger
    than the distance."""
    system = ImpactSystem([[1.0]], [[damping]], [[1.0]], (Stop((1.0,), upper=1.0, restitution=0.8),))
    motion = simulate(system, [1.0], [0.0], 1e-6, 20, forces=Harmonic(1.0, cosine=[0.1]))
    assert motion.status is MotionStatus.DURATION_REACHED and motion.impacts == 0
    assert motion.final[1] == pytest.approx(-0.9 / damping, rel=1e-6)


def test_after_an_impact_without_rebound_there_is_no_second_one():
    """A ball on a flexible floor, e = 0, whose gap and displacements vanish at the impacts: their rounding is no impact. Oracle: one
    impact, of a real speed, for each time the ball sticks."""
    mass, damping, stiffness = ([0.051, 3.549], [0.514, 3.933], [38.95, 158.7])
    system = ImpactSystem(np.diag(mass), np.diag(damping), np.diag(stiffness), (Stop((1.0, -1.0), lower=0.0, restitution=0.0),))
    for load in np.linspace(0.38, 0.4, 20):
        motion = simulate(system, [0.42, -0.064], [-1.47, 0.23], 1200.0, forces=Harmonic(0.32, [0.0, load]))
        late = motion.kinds[motion.times > 30.0]
        assert motion.status is MotionStatus.DURATION_REACHED and motion.balance_error <= 1e-13
        assert motion.speeds[motion.kinds == EventKind.IMPACT.value].min() > 1e-12
        assert np.count_nonzero(late == EventKind.IMPACT.value) == np.count_nonzero(late == EventKind.STICK.value) > 10


@pytest.mark.parametrize("duration", [2.0, 50.0, 400.0, 5000.0])
def test_a_long_time_on_a_critically_damped_floor(duration):
    """Critical damping puts the floor, its two rates and the weight into one block, of which parts have died out. Oracle: the ball lies on
    the floor, which the weight of both presses down by (m + M) g/k. Each doubling of the energy's integral rounds."""
    floor = Stop((1.0, -1.0), lower=0.0, restitution=0.0)
    system = ImpactSystem(np.diag([0.04, 0.2]), np.diag([0.0, 20.0]), np.diag([0.0, 500.0]), (floor,))
    motion = simulate(system, [0.01, 0.0], [0.0, 0.0], duration, forces=Constant([-0.4, -2.0]))
    assert motion.status is MotionStatus.DURATION_REACHED and motion.balance_error <= 1e-12 + 1e-13 * duration
    np.testing.assert_allclose(motion.final, [-2.4 / 500.0, -2.4 / 500.0, 0.0, 0.0], rtol=1e-12, atol=1e-15)
