"""Many motions of two modes in one call: against the general run, its energies, closed forms and samples.

Impacts magnify what they start from: motions are compared over times in which rounding does not grow to what is asked.
"""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from bvp.fast_path import CLEARED, DECLINED, TIMED, fast_path_numbers, run_fast_path
from bvp.simulate import Simulator
from bvp.system import ImpactSystem, Stop, vibro_impact_nes

FRACTIONS = (0.3, 0.5, 0.9, 0.99)


def many(system, states, duration, *, to_rest=False, max_impacts=10**7, fractions=FRACTIONS):
    """`run_fast_path` of one system."""
    states = np.atleast_2d(states)
    energies = np.atleast_1d(system.energy(states[:, :2], states[:, 2:]))
    return run_fast_path(
        fast_path_numbers(system)[None], np.zeros(len(states), dtype=np.int64), states, energies, duration=duration, to_rest=to_rest,
        max_impacts=max_impacts, fractions=fractions,
    )  # fmt: skip


def impulsive(energies):
    states = np.zeros((len(energies), 4))
    states[:, 3] = np.sqrt(2.0 * np.asarray(energies))
    return states


def compare(system, states, duration):
    """With the general run; how many were not declined."""
    found = many(system, states, duration)
    simulator, kept = Simulator(system), 0
    for b, state in enumerate(np.atleast_2d(states)):
        if found.reason[b] == DECLINED:
            continue
        kept += 1
        motion = simulator.run(state[:2], state[2:], duration, marks=FRACTIONS)
        energy = motion.initial_energy
        assert found.impacts[b] == motion.impacts and found.duration[b] == duration
        assert (motion.last_impact is None) == np.isnan(found.last_impact[b])
        if motion.impacts:
            assert found.last_impact[b] == pytest.approx(motion.last_impact, abs=1e-9)
        assert found.dissipated[b] == pytest.approx(motion.totals[:3], abs=1e-9 * energy)
        assert found.energy[b] == pytest.approx(motion.energy, abs=1e-9 * energy)
        assert abs(found.balance[b]) < 1e-13 * energy
        for time, mark in zip(found.times[b], motion.marks, strict=True):
            assert np.isnan(time) if mark.time is None else time == pytest.approx(mark.time, abs=1e-7)
        assert found.peaks[b] == pytest.approx(motion.peaks, abs=1e-9)
        u, _ = motion.sample(np.sort(np.concatenate([np.linspace(0.0, duration, 2001), motion.times])))
        peaks = np.abs(u).max(axis=0)
        assert np.all(found.peaks[b] >= peaks - 1e-9) and np.all(found.peaks[b] <= peaks + 1e-3 * (1.0 + peaks))
    return kept


@pytest.mark.parametrize(("lam", "rho"), [(0.01, 0.7), (0.0, 0.7), (0.1, 0.9), (0.01, 1.0), (0.0, 1.0), (0.5, 0.5)])
def test_the_reference_system(lam, rho):
    """Oracle: the general run, event by event; dense samples, whose peaks a turning point between them exceeds by their spacing."""
    energies = np.geomspace(0.02, 10.0, 25)
    assert compare(vibro_impact_nes(lam=lam, rho=rho), impulsive(energies), 12.0) >= 20


@settings(max_examples=12)
@given(
    mu=st.floats(0.02, 1.0), sigma=st.floats(0.05, 2.0), lam=st.floats(0.0, 0.5), rho=st.floats(0.3, 1.0), seed=st.integers(0, 1000)
)
@example(mu=1.0, sigma=1.0, lam=9.574507052111664e-09, rho=1.0, seed=0)
def test_other_systems_and_states(mu, sigma, lam, rho, seed):
    """Oracle: as above."""
    system = vibro_impact_nes(mu, sigma, lam, rho)
    if fast_path_numbers(system) is None:
        return
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
        assert compare(system, impulsive(np.geomspace(0.05, 5.0, 12)), 12.0) >= 10


def test_all_energy_is_dissipated_where_no_impact_is_possible_any_more():
    """Oracle: the energy itself; and a run that is so long that nothing is left."""
    system = vibro_impact_nes(lam=0.01, rho=0.7)
    states = impulsive(np.geomspace(0.01, 10.0, 300))
    found = many(system, states, 1e4, to_rest=True)
    kept = found.reason != DECLINED
    assert kept.mean() > 0.99 and np.all(found.reason[kept] == CLEARED) and np.all(found.energy[kept] == 0.0)
    assert np.abs(found.balance / found.initial_energy)[kept].max() < 1e-13
    long = many(system, states, 1e4)
    assert np.abs(found.dissipated - long.dissipated)[kept].max() < 1e-12
    assert np.allclose(found.times[kept], long.times[kept], rtol=1e-9, atol=0.0, equal_nan=True)
    none = kept & (found.impacts == 0)
    assert none.any() and np.all(np.isnan(found.last_impact[none])) and np.all(found.duration[none] == 0.0)
    assert np.all(found.duration[kept & ~none] == found.last_impact[kept & ~none])


def test_the_time_of_a_fraction_of_a_decaying_mode():
    """Oracle: the definition: what is dissipated just before and just after that time, which differ where it is that of an impact."""
    system = vibro_impact_nes(lam=0.02, rho=0.8)
    (state,) = impulsive([3.0])
    times = many(system, state, 1e4, to_rest=True).times[0]
    sides = [[many(system, state, time * (1.0 + side)).dissipated[0].sum() / 3.0 for time in times] for side in (-1e-10, 1e-10)]
    assert all(before <= fraction <= after for before, fraction, after in zip(sides[0], FRACTIONS, sides[1], strict=True))
    assert sum(after - before < 1e-9 for before, after in zip(*sides, strict=True)) >= 2


def test_peaks_of_linear_motion():
    """Oracle: one mode alone turns at its amplitude."""
    system = vibro_impact_nes()
    modes = system.modes
    for k in range(2):
        amplitude = 0.5 / abs(modes.contacts.gap[0, k])
        v = modes.shapes[:, k] * modes.frequencies[k] * amplitude
        found = many(system, [0.0, 0.0, *v], 50.0)
        assert found.reason[0] == CLEARED and found.impacts[0] == 0
        assert found.peaks[0] == pytest.approx(np.abs(modes.shapes[:, k]) * amplitude, rel=1e-12)


def test_what_is_not_ordinary_is_declined():
    """Oracle: the general run sticks, or grazes; a start on a stop is no start in flight."""
    sticking = vibro_impact_nes(lam=0.1, rho=0.2)
    states = impulsive(np.geomspace(0.5, 10.0, 40))
    found = many(sticking, states, 60.0)
    simulator = Simulator(sticking)
    held = np.array([simulator.run(state[:2], state[2:], 60.0).sticking_time > 0.0 for state in states])
    assert held.any() and np.all(found.reason[held] == DECLINED)
    assert many(vibro_impact_nes(rho=0.7), [[1.0, 0.0, 0.0, 0.3]], 1.0).reason[0] == DECLINED
    assert fast_path_numbers(vibro_impact_nes(rho=0.0)) is None and fast_path_numbers(vibro_impact_nes(lam=5.0)) is None


def test_a_duration_ends_the_run_between_impacts():
    """Oracle: the general run; the same start with a duration of just less and just more than the time of an impact."""
    system, (state,) = vibro_impact_nes(lam=0.01, rho=0.7), impulsive([2.0])
    time = many(system, state, 1e4, max_impacts=3).last_impact[0]
    before, after = many(system, state, time * (1.0 - 1e-9)), many(system, state, time * (1.0 + 1e-9))
    assert (before.impacts[0], after.impacts[0]) == (2, 3) and before.reason[0] == after.reason[0] == TIMED
