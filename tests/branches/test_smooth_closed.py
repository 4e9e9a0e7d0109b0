"""Closed smooth orbits without impacts. Oracles: another integrator, the half map of the same orbits, sequences of events."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from branches.forced.record import problem_from, problem_record
from branches.forced.tracing import follow_response
from branches.naming.at_modes import orbit_at_mode
from branches.orbit import Orbit
from branches.presentation import all_presentations, canonical_orbit, closed_presentation, same_orbit, starts_of, symmetries
from branches.reading import branch_of_record
from branches.record import to_record
from branches.released.branch import ReleasedBranch
from branches.released.family import ReleasedFamily
from branches.switching import switch
from branches.tracing import follow_family
from bvp.closures import EndsError, cycle_of
from bvp.multipoint import MultipointProblem
from bvp.parameters import ParametricSystem
from bvp.released import ReleasedProblem
from bvp.smooth_cycles import start_instants, states_at
from bvp.springs import Spring
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from saltus.scene import load_scene

BOUNDS = {"energy": (1e-2, 0.5), "points": 120}
"""Enough to pass a branch point on either side of the start, of which rounding chooses one: the longer way takes 60 points."""


def sink() -> ImpactSystem:
    """An oscillator with a sink of mass 0.1 on a spring 0.1 w + w^7."""
    spring = Spring((1.0, -1.0), stiffness=1.0, power=7.0)
    mass, stiffness = [[0.1, 0.0], [0.0, 1.0]], [[0.1, -0.1], [-0.1, 1.1]]
    return ImpactSystem(mass, np.zeros((2, 2)), stiffness, (), absorber=0, primary=1, springs=(spring,))


@pytest.fixture(scope="module")
def doubled():
    """The two families with doubled period, between two origins and between two instants of rest. Each loses its last reversal."""
    mode = orbit_at_mode("mode:1", sink(), (1e-3, 1.0))
    first = follow_family(mode.problem, mode.solution.y, energy=(1e-3, 0.06))
    return {branch.ends: branch for branch in switch(first, "PD1", energy=(1e-2, 1.0), points=40)}


@pytest.fixture(scope="module")
def closed(doubled):
    """The family without a reversal, from either of the two."""
    return {ends: switch(branch, "SB1", **BOUNDS)[0] for ends, branch in doubled.items()}


def right(_, y):
    """The sink with its variation."""
    w = y[0] - y[1]
    force, slope = 0.1 * w + w**7, 0.1 + 7.0 * w**6
    matrix = np.zeros((4, 4))
    matrix[0, 2] = matrix[1, 3] = 1.0
    matrix[2, :2], matrix[3, :2] = [-10.0 * slope, 10.0 * slope], [slope, -slope - 1.0]
    return np.concatenate([[y[2], y[3], -10.0 * force, force - y[1]], (matrix @ y[4:].reshape(4, 4)).ravel()])


def test_another_integrator_closes_an_orbit_without_a_reversal(closed):
    """Oracle: DOP853 over the period, with the equation of variations."""
    branch = closed["rest", "rest"]
    orbit = branch.orbit(len(branch) // 4)
    assert symmetries(orbit.cycle) == (1, False, ())
    start = np.concatenate([*(part[0] for part in orbit.sample(np.zeros(1))), np.eye(4).ravel()])
    end = solve_ivp(right, (0.0, orbit.period), start, method="DOP853", rtol=1e-13, atol=1e-15).y[:, -1]
    growth = np.abs(end[4:]).max()
    assert np.abs(end[:4] - start[:4]).max() < 1e-12 * growth
    assert abs(np.trace(end[4:].reshape(4, 4)) - 2.0 - orbit.tau) < 1e-10 * growth
    assert orbit.impacts == [] and orbit.label == ""


def test_a_closed_orbit_is_known_in_all_its_presentations(closed):
    """Oracle: the group of the symmetries, in which an orbit begins at each maximum, forwards and backwards, and its mirror image likewise;
    a file."""
    branch = closed["rest", "rest"]
    orbit = branch.orbit(len(branch) // 4)
    images = all_presentations(orbit.problem, orbit.solution.y)
    starts = starts_of(orbit.cycle)
    assert starts == starts_of(orbit.cycle, -1.0) > 1 and len(images) == 4 * starts
    for image in images:
        y = image.unknowns(orbit.problem)
        assert np.abs(orbit.problem.residual(y)).max() < 1e-10
        assert same_orbit((orbit.problem, y), (orbit.problem, orbit.solution.y))
    again = branch_of_record(json.loads(json.dumps(to_record(branch))))
    assert again.id == branch.id and again.orbit(3).residual < 1e-12


def test_an_orbit_that_starts_at_a_minimum_is_refused(closed):
    """Oracle: contract."""
    branch = closed["rest", "rest"]
    orbit = branch.orbit(len(branch) // 4)
    least = start_instants(orbit.cycle, -1.0)[:1]
    y = orbit.problem.pack(states_at(orbit.cycle, least)[0], None, [orbit.period])
    with pytest.raises(ValueError, match="starts where the sum of the modal displacements is least; an orbit without impacts starts where"):
        follow_family(orbit.problem, y)


def chain() -> ImpactSystem:
    """Three unlike masses with springs w^3."""
    rows = (((1.0, 0.0, 0.0), 1.0), ((0.0, 1.0, 0.0), 0.7), ((0.0, 0.0, 1.0), 1.3), ((1.0, -1.0, 0.0), 0.5))
    springs = tuple(Spring(row, stiffness=k, power=3.0) for row, k in rows)
    stiffness = [[2.0, -0.5, 0.0], [-0.5, 2.3, -0.4], [0.0, -0.4, 2.9]]
    return ImpactSystem(np.diag([1.0, 1.2, 0.8]), np.zeros((3, 3)), stiffness, (), springs=springs)


def test_three_degrees_of_freedom_close_with_the_multipliers_of_the_half_map():
    """Oracle: the half map between origin and rest, for multipliers and for the energies of the Krein collisions."""
    system = chain()
    mode = orbit_at_mode("mode:2", system, (1e-3, 30.0))
    family = follow_family(mode.problem, mode.solution.y, energy=(1e-3, 0.3))
    orbit = family.orbit_at(energy=0.15)
    image = closed_presentation(orbit.cycle)
    problem = MultipointProblem(system, image.ends, image.sequence)
    closed = Orbit(problem, problem.solve(image.unknowns(problem), energy=orbit.h))
    assert abs(closed.alpha / orbit.alpha - 1.0) < 1e-14
    assert np.abs(closed.multipliers - orbit.multipliers).max() < 1e-12
    assert closed.stable is orbit.stable is True and closed.quality["reliable"]
    assert canonical_orbit(problem, closed.solution.y)[0].ends == ("origin", "rest")
    assert symmetries(cycle_of(problem, closed.solution.y)).half
    around = follow_family(problem, closed.solution.y, energy=(0.1, 0.2))
    collisions = [event.h for event in family.events if event.type == "NS"]
    assert len(collisions) == 2
    assert np.allclose([event.h for event in around.events if event.type == "NS"], collisions, rtol=1e-9)


def test_closed_impacting_orbits_with_smooth_forces_have_any_number_of_degrees_of_freedom():
    """Oracle: the half map between the reversals of the same orbit."""
    base = chain()
    stop = Stop((1.0, 0.0, -1.0), -0.4, 0.4)
    system = ImpactSystem(base.mass, np.zeros((3, 3)), base.stiffness, (stop,), springs=base.springs)
    first = MultipointProblem(system, ("origin", "stop+"), ())
    orbit = Orbit(first, first.solve(first.pack(system.modes.from_state @ [0, 0, 0, 0.6, 0.1, -0.6], [], [0.7]), quarter_period=0.7))
    assert orbit.impact_speeds[0] > 0.0
    image = closed_presentation(orbit.cycle)
    problem = MultipointProblem(system, image.ends, image.sequence)
    closed = Orbit(problem, problem.solve(image.unknowns(problem), energy=orbit.h))
    assert len(closed.impacts) == 2
    size = np.abs(orbit.multipliers).max()
    assert np.abs(closed.multipliers - orbit.multipliers).max() < 1e-11 * size**2


def test_linear_systems_still_need_an_impact_to_close():
    """Oracle: contract. The period of a linear mode does not depend on its energy, so nothing holds an orbit of it."""
    with pytest.raises(EndsError, match="at least one impact, where the orbit starts"):
        MultipointProblem(vibro_impact_nes(), ("periodic", "periodic"), ())


def closed_in(parametric, orbit, name, interval, keep, **options):
    """The family of a closed orbit in a parameter."""
    problem = ReleasedProblem(parametric, orbit.ends, (), [name], [keep], energy=orbit.h)
    branch = follow_response(problem, problem.of_orbit(orbit.problem, orbit.solution.y), interval, **options)
    assert isinstance(branch, ReleasedBranch)
    return branch


def mode_to_closed(system):
    """The family without a reversal of a system near that of `sink`, by switching at its own events."""
    mode = orbit_at_mode("mode:1", system, (1e-3, 1.0))
    first = follow_family(mode.problem, mode.solution.y, energy=(1e-3, 0.06))
    doubled = next(branch for branch in switch(first, "PD1", energy=(1e-2, 1.0), points=40) if branch.ends == ("rest", "rest"))
    return switch(doubled, "SB1", energy=(1e-2, 0.5), points=80)[0]


@pytest.mark.parametrize(("name", "value"), [("n", 3.004), ("mu", 0.0995)])
def test_a_closed_orbit_is_followed_in_a_parameter(closed, name, value):
    """Oracle: the family in the energy at another value of the parameter, which is found from the linear mode there. The modes change with
    mu, and with them the instant at which the orbit starts. A file of the problem."""
    parametric = load_scene("smooth_wall").parametric.replaced({"n": 3.0})
    orbit = closed["rest", "rest"].orbits_at(energy=0.0629)[0]
    interval = tuple(sorted((value, parametric.values[name])))
    found = closed_in(parametric, orbit, name, interval, "energy = 0.0629")
    there = found.orbit(int(np.argmin(np.abs(found.parameter - value))))
    other = mode_to_closed(parametric.system({name: value})).orbits_at(energy=0.0629)[0]
    assert abs(there.alpha / other.alpha - 1.0) < 1e-12
    assert np.abs(np.sort_complex(there.multipliers) - np.sort_complex(other.multipliers)).max() < 1e-10
    assert same_orbit((there.problem, there.solution.y), (other.problem, other.solution.y))
    full = found.problem.multipliers(found.unknowns[0])
    assert np.abs(full - 1.0).min() < 1e-6 and np.abs(np.prod(full) - 1.0) < 1e-10
    again = problem_from(parametric, json.loads(json.dumps(problem_record(found.problem))))
    assert np.abs(again.residual(found.unknowns[-1])).max() < 1e-12


def test_a_closed_family_passes_the_orbits_with_a_reversal(closed, doubled, monkeypatch):
    """Oracle: the event SB of the family of these orbits. Slopes are rounding near it, and few orbits are solved for them."""
    parametric = load_scene("smooth_wall").parametric.replaced({"n": 3.0})
    orbit = closed["rest", "rest"].orbits_at(energy=0.0629)[0]
    keep, solved, take = "energy = 0.0629", [], ReleasedProblem.step
    monkeypatch.setattr(ReleasedProblem, "step", lambda *given, **options: solved.append(1) or take(*given, **options))
    found = closed_in(parametric, orbit, "n", (2.987, 3.002), keep)
    assert len(solved) < 10 * len(found)
    assert [event.type for event in found.events] == ["EP", "BP", "EP"]
    symmetric = min(doubled["origin", "origin"].orbits_at(energy=0.0629), key=lambda one: abs(one.alpha - orbit.alpha))
    problem = ReleasedProblem(parametric, symmetric.ends, (), ["n"], [keep], energy=orbit.h)
    beside = follow_response(problem, problem.of_orbit(symmetric.problem, symmetric.solution.y), (2.98, 3.02))
    breaking = [event.values["n"] for event in beside.events if event.type == "SB"]
    assert min(abs(n - found.events[1].values["n"]) for n in breaking) < 1e-8


def test_a_closed_orbit_keeps_its_family_in_a_parameter():
    """Oracle: the same orbits between an origin and an end at rest, over a wide range."""
    parametric = load_scene("smooth_wall").parametric.replaced({"n": 3.0})
    mode = orbit_at_mode("mode:1", parametric.system(), (1e-3, 1.0))
    orbit = follow_family(mode.problem, mode.solution.y, energy=(1e-3, 0.02)).orbit_at(energy=0.015)
    image = closed_presentation(orbit.cycle)
    problem = MultipointProblem(orbit.system, image.ends, image.sequence)
    closed = Orbit(problem, problem.solve(image.unknowns(problem), energy=orbit.h))
    quarter = closed_in(parametric, orbit, "mu", (0.05, 0.1), "energy = 0.015")
    whole = closed_in(parametric, closed, "mu", (0.05, 0.1), "energy = 0.015")
    assert quarter.problem.ends == ("origin", "rest") and whole.problem.starts_rising
    for one, other in ((quarter.orbit(0), whole.orbit(0)), (quarter.orbit(len(quarter) - 1), whole.orbit(len(whole) - 1))):
        assert abs(one.alpha / other.alpha - 1.0) < 1e-12
        assert np.abs(one.multipliers - other.multipliers).max() < 1e-10
    # The run ends where the sum of the modal displacements at mu = 0.1 no longer rises through zero at the start.
    family, y = ReleasedFamily(whole.problem), whole.unknowns[0]
    state = whole.problem.states(y)[0]
    modal = parametric.system().modes.from_state @ state
    assert abs(modal[:2].sum()) < 1e-13 * np.abs(state).max()
    assert (family.tests[3].code, family.tests[3].kind, family.tests[3].terminal) == ("EP", "guard", True)
    assert family.begin(y).tests[3] * modal[2:].sum() > 0.0
    assert whole.problem.rise(-y) == -whole.problem.rise(y) < 0.0


def test_a_sum_that_never_rises_through_zero_is_refused():
    """Oracle: the words. Oscillations about u = 1.9, where u (u - 1) (u - 1.9) is zero, too, stay on one side."""
    spring = {"on": "u1", "potential": "w**4/4 - 2.9*w**3/3"}
    description = {"parameters": {"k": 1.9}, "system": {"mass": [[1.0]], "stiffness": [["k"]], "springs": [spring]}}
    parametric = ParametricSystem.from_description(description)
    problem = MultipointProblem(parametric.system(), ("periodic", "periodic"), ())
    orbit = problem.solve(problem.pack(problem.modes.from_state @ [2.06, 0.0], None, [4.8]), energy=0.08)
    released = ReleasedProblem(parametric, problem.ends, (), ["k"], ["energy = 0.08"])
    with pytest.raises(EndsError, match="from where the sum of its modal displacements rises through zero; it never does"):
        released.of_orbit(problem, orbit.y)
