"""Many motions in one call: against one recorded motion each, its energies, closed forms and samples.

A motion of the batch is the same as a recorded one, bit for bit: neither the record, nor peaks and marks, nor threads change how it rounds.
"""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from bvp.forcing import Constant
from bvp.simulate import Simulator, run_linear
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from tests.lab.motions import batch_of, impulsive

FRACTIONS = (0.3, 0.5, 0.9, 0.99)


def compare(system, states, duration):
    """With recorded motions."""
    found = batch_of(system, states, duration)
    simulator = Simulator(system)
    for b, state in enumerate(np.atleast_2d(states)):
        motion = simulator.run(state[:2], state[2:], duration, marks=FRACTIONS)
        energy = motion.initial_energy
        assert found["impacts"][b] == motion.impacts and found["duration"][b] == motion.duration
        last = np.nan if motion.last_impact is None else motion.last_impact
        assert np.array_equal(found["last_impact"][b], last, equal_nan=True)
        assert np.array_equal(found["dissipated"][b], motion.totals[:-1])
        assert found["energy"][b] == pytest.approx(motion.energy, rel=1e-13)  # sums in another order
        assert found["sticking_time"][b] == motion.sticking_time
        assert abs(found["balance"][b]) < 1e-13 * energy
        times = [np.nan if mark.time is None else mark.time for mark in motion.marks]
        assert np.array_equal(found["times"][b], times, equal_nan=True)
        assert found["peaks"][b] == pytest.approx(motion.peaks, abs=1e-9)
        u, _ = motion.sample(np.sort(np.concatenate([np.linspace(0.0, motion.duration, 2001), motion.times])))
        peaks = np.abs(u).max(axis=0)
        assert np.all(found["peaks"][b] >= peaks - 1e-9) and np.all(found["peaks"][b] <= peaks + 1e-3 * (1.0 + peaks))


@pytest.mark.parametrize(("lam", "rho"), [(0.01, 0.7), (0.0, 0.7), (0.1, 0.9), (0.01, 1.0), (0.0, 1.0), (0.5, 0.5)])
def test_the_reference_system(lam, rho):
    """Oracle: the general run, event by event; dense samples, whose peaks a turning point between them exceeds by their spacing."""
    energies = np.geomspace(0.02, 10.0, 25)
    compare(vibro_impact_nes(lam=lam, rho=rho), impulsive(energies), 12.0)


@settings(max_examples=12)
@given(
    mu=st.floats(0.02, 1.0), sigma=st.floats(0.05, 2.0), lam=st.floats(0.0, 0.5), rho=st.floats(0.3, 1.0), seed=st.integers(0, 1000)
)
@example(mu=1.0, sigma=1.0, lam=9.574507052111664e-09, rho=1.0, seed=0)
def test_other_systems_and_states(mu, sigma, lam, rho, seed):
    """Oracle: as above."""
    system = vibro_impact_nes(mu, sigma, lam, rho)
    random = np.random.default_rng(seed)
    u2, w = random.uniform(-2.0, 2.0, 6), random.uniform(-0.9, 0.9, 6)
    v = random.uniform(-3.0, 3.0, (6, 2))
    compare(system, np.column_stack([u2 + w, u2, v]), 4.0)


def test_a_stop_off_the_middle_one_sided_and_dampers_in_the_gap():
    """Oracle: as above, for a system without a mirror image, with damping that couples the modes."""
    for lower, upper in ((-0.4, 1.3), (-0.7, np.inf), (-np.inf, 0.5)):
        damping = 0.03 * np.array([[1.0, -1.0], [-1.0, 1.0]]) + np.diag([0.0, 0.05])
        system = ImpactSystem(
            [[0.2, 0.0], [0.0, 1.0]], damping, [[0.3, -0.3], [-0.3, 1.3]], [Stop((1.0, -1.0), lower, upper, 0.8)], absorber=0, primary=1
        )
        compare(system, impulsive(np.geomspace(0.05, 5.0, 12)), 12.0)


def test_all_energy_is_dissipated_where_no_impact_is_possible_any_more():
    """Oracle: the energy itself; and a run that is so long that nothing is left."""
    system = vibro_impact_nes(lam=0.01, rho=0.7)
    states = impulsive(np.geomspace(0.01, 10.0, 300))
    found = batch_of(system, states, 1e4, to_rest=True)
    assert np.all(found["rested"] == 1.0) and np.all(found["clear_from"] >= 0.0)
    assert np.abs(found["balance"] / found["initial"]).max() < 1e-13
    long = batch_of(system, states, 1e4)
    assert np.abs(found["dissipated"] - long["dissipated"]).max() < 1e-12
    assert np.allclose(found["times"], long["times"], rtol=1e-9, atol=0.0, equal_nan=True)
    none = found["impacts"] == 0
    assert none.any() and np.all(np.isnan(found["last_impact"][none]))


def test_the_time_of_a_fraction_of_a_decaying_mode():
    """Oracle: the definition: what is dissipated just before and just after that time, which differ where it is that of an impact."""
    system = vibro_impact_nes(lam=0.02, rho=0.8)
    (state,) = impulsive([3.0])
    times = batch_of(system, state, 1e4, to_rest=True)["times"][0]
    sides = [[batch_of(system, state, t * (1.0 + side))["dissipated"][0].sum() / 3.0 for t in times] for side in (-1e-10, 1e-10)]
    assert all(before <= fraction <= after for before, fraction, after in zip(sides[0], FRACTIONS, sides[1], strict=True))
    assert sum(after - before < 1e-9 for before, after in zip(*sides, strict=True)) >= 2


def test_peaks_of_linear_motion():
    """Oracle: one mode alone turns at its amplitude."""
    system = vibro_impact_nes()
    modes = system.modes
    for k in range(2):
        amplitude = 0.5 / abs(modes.contacts.gap[0, k])
        v = modes.shapes[:, k] * modes.frequencies[k] * amplitude
        found = batch_of(system, [0.0, 0.0, *v], 50.0)
        assert found["clear_from"][0] == 0.0 and found["impacts"][0] == 0
        assert found["peaks"][0] == pytest.approx(np.abs(modes.shapes[:, k]) * amplitude, rel=1e-12)


def test_sticking_and_grazing():
    """Oracle: the recorded motions: some stick, some do not."""
    system = vibro_impact_nes(lam=0.1, rho=0.2)
    found = batch_of(system, impulsive(np.geomspace(0.5, 10.0, 12)), 60.0)
    compare(system, impulsive(np.geomspace(0.5, 10.0, 12)), 60.0)
    assert found["sticking_time"].any()
    compare(vibro_impact_nes(rho=0.0, lam=0.01), impulsive([0.06, 0.4, 3.0]), 60.0)


def test_a_duration_ends_the_run_between_impacts():
    """Oracle: the same start with a duration of just less and just more than the time of an impact."""
    system, (state,) = vibro_impact_nes(lam=0.01, rho=0.7), impulsive([2.0])
    time = batch_of(system, state, 1e4, max_impacts=3)["last_impact"][0]
    before, after = batch_of(system, state, time * (1.0 - 1e-9)), batch_of(system, state, time * (1.0 + 1e-9))
    assert (before["impacts"][0], after["impacts"][0]) == (2, 3)


def test_threads_do_not_change_results():
    """Oracle: the same motions on one thread, bit for bit; some of them need a contact mode that is new."""
    system = vibro_impact_nes(lam=0.1, rho=0.2)
    states = impulsive(np.geomspace(0.05, 10.0, 60))
    one, four = (batch_of(system, states, 60.0, threads=threads) for threads in (1, 4))
    for name, column in one.items():
        assert np.array_equal(column, four[name], equal_nan=True), name


@pytest.mark.parametrize("ratio", [0.5, 0.9, 0.971, 0.975, 0.999])
def test_motion_that_decays_loses_all_energy_beside_critical_damping(ratio):
    """Oracle: the energy at the start, which the damper takes in infinite time. There the sum of exponentials cancels."""
    system = ImpactSystem([[1.0]], [[2.0 * ratio]], [[1.0]], [Stop((1.0,), -10.0, 10.0)])
    starts = np.array([[0.5, 1.0], [-1.0, 0.25], [0.0, 2.0]])
    energies = 0.5 * np.sum(starts**2, axis=1)
    simulator = Simulator(system)
    summary = run_linear(simulator.table, starts, energies, np.full(3, 100), 1e4, np.array([0.5]), to_rest=True).summary
    assert np.all(summary[:, 7] == 1.0)
    parts = len(simulator.parts)
    assert np.abs(summary[:, 9 : 9 + parts].sum(axis=1) / energies - 1.0).max() < 1e-13
    assert np.all((summary[:, 10 + parts] > 0.0) & (summary[:, 10 + parts] < 10.0))  # half of it is gone within some periods


def test_a_contact_mode_that_an_interrupt_leaves_out_is_made_up_for():
    """Oracle: the same motion without the interrupt."""
    motions = []
    for is_cut in (False, True):
        simulator = Simulator(ImpactSystem([[1.0]], [[0.0]], [[0.0]], [Stop((1.0,), 0.0, 2.0, 0.5)]), [Constant([-1.0])])
        assert len(simulator.table.core) == 1
        if is_cut:  # behind the mode and before the core
            simulator.table.modes[1] = simulator.table._mode(1)
            simulator.table.__dict__.pop("stacked", None)
        motions.append(simulator.run([1.0], [0.0], 20.0))
    one, other = motions
    assert one.sticking_time > 0.0 and one.status is other.status
    assert np.array_equal(one.times, other.times) and np.array_equal(one.final, other.final)


def test_threads_are_refused_and_limited():
    """Oracle: the results of one thread."""
    simulator, starts = Simulator(vibro_impact_nes(rho=0.7, lam=0.01)), np.outer(np.linspace(0.5, 2.0, 20), [0.0, 0.0, 0.0, 1.0])
    one, many = (simulator.run_many(starts, 20.0, threads=threads) for threads in (1, 10**6))
    assert np.array_equal(one.final, many.final) and one.status == many.status
    with pytest.raises(ValueError, match="one thread, or more"):
        simulator.run_many(starts, 20.0, threads=0)
