"""The runs of a study: against single runs, closed forms, units, endings; blocks that depend on the plan alone."""

import numpy as np
import pytest

from bvp.forcing import Harmonic
from bvp.simulate import simulate
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from transitions.study.plan import CLEAR, Axis, StudyPlan
from transitions.study.runs import Ending, Starts, block_columns, run_block, spent_to_rest

ENERGY = Axis("energy", low=0.06, high=10.0, scale="log", points=9)
RHO = Axis("rho", low=0.5, high=0.9, points=3)


def plan_of(system=None, axes=(ENERGY,), **more):
    system = vibro_impact_nes(lam=0.01, rho=0.7) if system is None else system
    return StudyPlan(**{"system": system.describe(), "nes": (0,), "lo": (1,), "axes": axes, "fixed": {}, "design": "grid", **more})


def results(plan, starts=None):
    return run_block(plan, plan.values(0, plan.count), starts)


def test_the_runs_are_those_of_simulate():
    """Oracle: simulate, one by one, bit for bit; peaks by their search along the recorded flights."""
    plan = plan_of(axes=(ENERGY, RHO, Axis("mu", values=(0.05, 0.2)), Axis("lam", values=(0.0, 0.03))), until=10.0)
    found = results(plan)
    assert list(found) == list(block_columns(plan)) and np.all(found["ended"] == Ending.DURATION.code)
    for b, energy in enumerate(found["given.energy"].tolist()):
        system = vibro_impact_nes(found["given.mu"][b], lam=found["given.lam"][b], rho=found["given.rho"][b])
        motion = simulate(system, [0.0, 0.0], [0.0, np.sqrt(2.0 * energy)], 10.0, marks=(0.5, 0.9, 0.99))
        assert found["impacts"][b] == motion.impacts and found["sticking_time"][b] == motion.sticking_time
        times = [np.nan if mark.time is None else mark.time for mark in motion.marks]
        assert np.array_equal([found[f"time_{k}"][b] for k in (50, 90, 99)], times, equal_nan=True)
        assert found["nes_share"][b] == pytest.approx(motion.dissipated["stop a"] / motion.initial_energy, abs=1e-13)
        assert [found["peak_u1"][b], found["peak_u2"][b]] == pytest.approx(motion.peaks, rel=1e-12)
    assert np.max(found["impacts"]) > 5


def test_until_no_impact_is_possible():
    """Oracle: all energy is dissipated in the end; the general run until then, whose last impact it is; a bound of the gap's amplitude."""
    plan = plan_of()
    found = results(plan)
    assert np.all(found["ended"] == Ending.CLEAR.code)
    assert np.abs(found["nes_share"] + found["lo_share"] - 1.0).max() < 1e-12 and found["balance_error"].max() < 1e-12
    system, h = vibro_impact_nes(lam=0.01, rho=0.7), found["h"][0]
    motion = simulate(system, [0.0, 0.0], [0.0, np.sqrt(2.0 * h)], 2000.0)
    assert motion.clear_from is not None and found["impacts"][0] == motion.impacts
    assert found["last_impact"][0] == found["duration"][0] == pytest.approx(motion.last_impact, abs=1e-9)
    assert found["nes_share"][0] == pytest.approx(motion.dissipated["stop a"] / h, abs=1e-9)
    for name, fraction in (("time_50", 0.5), ("time_90", 0.9), ("time_99", 0.99)):
        assert motion.spent([found[name][0]])[0, :-1].sum() / h == pytest.approx(fraction, abs=1e-8)


@pytest.mark.parametrize(("rho", "sigma"), [(0.0, 0.1), (0.2, 0.1), (0.6, 0.0)])
def test_sticking_and_the_free_sink(rho, sigma):
    """Oracle: the general run of the same start; the balance of energies."""
    system = vibro_impact_nes(sigma=sigma, lam=0.02, rho=rho)
    plan = plan_of(system, until=40.0)
    found = results(plan)
    for b, energy in enumerate(found["given.energy"].tolist()):
        motion = simulate(system, [0.0, 0.0], [0.0, np.sqrt(2.0 * energy)], 40.0)
        assert (found["impacts"][b], found["sticking_time"][b]) == (motion.impacts, motion.sticking_time)
    assert found["balance_error"].max() < 1e-12 and (rho > 0.5 or found["sticking_time"].max() > 0.0)


def test_a_run_that_never_becomes_clear_says_so():
    """Oracle: an elastic and undamped motion hits for ever."""
    found = results(plan_of(vibro_impact_nes(), until=CLEAR, longest=200.0))
    assert np.all(found["ended"] == Ending.LONGEST.code) and np.all(found["duration"] == 200.0) and not found["nes_share"].any()
    few = results(plan_of(vibro_impact_nes(), impacts=3))
    assert np.all(few["ended"] == Ending.IMPACTS_FULL.code) and np.all(few["impacts"] == 3)


def test_the_tail_to_rest():
    """Oracle: all of the energy, in parts; a run so long that nothing is left."""
    system = vibro_impact_nes(lam=0.05)
    gaps = 0.02 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    system = ImpactSystem(system.mass, system.damping + gaps, system.stiffness, [Stop((1.0, -1.0), -9.0, 9.0)])
    state = np.array([0.3, -0.2, 1.0, 0.5])
    parts = {"gaps": gaps, "rest": system.damping - gaps}
    tail = spent_to_rest(system, parts, state)
    motion = simulate(system, state[:2], state[2:], 3000.0, dampers=parts)
    assert sum(tail.values()) == pytest.approx(motion.initial_energy, rel=1e-13)
    assert tail == pytest.approx({name: motion.dissipated[name] for name in parts}, rel=1e-12)
    assert spent_to_rest(vibro_impact_nes(), {"rest": np.zeros((2, 2))}, state) is None


def test_physical_units():
    """Oracle: h = E/d^2 and h = (V/d)^2/2; the runs of natural units with these h."""
    clearance = Axis("clearance", values=(0.5, 2.0))
    by_energy = results(plan_of(axes=(clearance, Axis("energy", values=(0.3, 4.0))), units="physical"))
    assert by_energy["h"] == pytest.approx([1.2, 16.0, 0.075, 1.0], rel=1e-15)
    by_impulse = results(plan_of(axes=(clearance,), fixed={"impulse": 2.0}, units="physical"))
    assert by_impulse["h"] == pytest.approx([8.0, 0.5], rel=1e-15)
    natural = results(plan_of(axes=(Axis("energy", values=(1.2, 16.0, 0.075, 1.0)),)))
    for name in ("impacts", "ended"):
        assert np.array_equal(natural[name], by_energy[name])
    assert natural["peak_u2"] == pytest.approx(by_energy["peak_u2"], rel=1e-9)


def test_starts_that_are_given():
    """Oracle: the general run from the same state; NaN is no orbit."""
    plan = plan_of(axes=(Axis("family", values=("S11O00-", "impulsive")), Axis("energy", values=(0.5, 1.0))), until=5.0)
    states = np.full((4, 4), np.nan)
    states[0] = [0.0, 0.0, -2.0, 0.5]
    found = results(plan, Starts(states, np.full(4, "")))
    assert found["ended"].tolist() == [Ending.DURATION.code, Ending.NO_ORBIT.code, Ending.DURATION.code, Ending.DURATION.code]
    motion = simulate(vibro_impact_nes(lam=0.01, rho=0.7), states[0, :2], states[0, 2:], 5.0)
    assert found["impacts"][0] == motion.impacts and found["h"][0] == motion.initial_energy
    assert np.isnan(found["nes_share"][1]) and found["impacts"][1] == 0 and found["h"][2:] == pytest.approx([0.5, 1.0])


def test_loads_and_more_coordinates():
    """Oracle: the general run, with the shares of the energy that came in."""
    force = Harmonic(1.0, [0.0, 0.3])
    plan = plan_of(axes=(RHO,), until=60.0, forces=(force,))
    found = results(plan)
    for b, rho in enumerate(RHO.grid()):
        motion = simulate(vibro_impact_nes(lam=0.01, rho=rho), [0.0, 0.0], [0.0, 0.0], 60.0, forces=[force])
        came = sum(motion.dissipated.values()) + motion.energy
        assert found["impacts"][b] == motion.impacts > 0
        assert found["nes_share"][b] == pytest.approx(motion.dissipated["stop a"] / came, abs=1e-12)
    stiffness = np.array([[1.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 2.0]])
    stops = [Stop((1.0, -1.0, 0.0), -0.3, 0.3, 0.8), Stop((0.0, 0.0, 1.0), -0.5, 0.5, 0.8)]
    chain = ImpactSystem(np.eye(3), 0.02 * np.eye(3), stiffness, stops, absorber=0, primary=1)
    found = results(plan_of(chain, axes=(ENERGY,)))
    assert np.all(found["ended"] == Ending.CLEAR.code) and found["balance_error"].max() < 1e-12 and "peak_u3" in found
    assert np.abs(found["nes_share"] + found["lo_share"] - 1.0).max() < 1e-12


def test_a_block_depends_on_its_runs_alone():
    """Oracle: the same runs in pieces, bit for bit."""
    axes = (ENERGY, Axis("rho", low=0.0, high=1.0), Axis("mu", low=0.05, high=0.3))
    plan = plan_of(axes=axes, design="hypercube", runs=60, seed=2, until=50.0)
    whole = results(plan)
    pieces = [run_block(plan, plan.values(first, first + 20)) for first in (0, 20, 40)]
    for name, column in whole.items():
        assert np.array_equal(column, np.concatenate([piece[name] for piece in pieces]), equal_nan=True), name
