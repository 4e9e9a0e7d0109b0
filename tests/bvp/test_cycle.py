"""The whole period of an orbit, unfolded by its reversals, and orbits sampled and run.

Oracles: the numpy event-driven flow; conservation of energy; the symmetries that an orbit between two ends has.
"""

import numpy as np

from benchmarks import backbone
from benchmarks.saltation import monodromy
from bvp.closures import cycle_of
from bvp.multipoint import MultipointProblem
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from tests.bvp.flow_twin import Twin
from tests.bvp.orbits import backbone_segment, chains, collection

EPS = np.finfo(float).eps
OTHER = {"+": "-", "-": "+"}


def orbits():
    return collection() + chains()


def physical(orbit, states):
    return states @ orbit.problem.modes.to_state.T


def test_flights_land_on_the_next_impact_and_the_orbit_closes():
    for orbit in orbits():
        cycle = cycle_of(orbit.problem, orbit.solution.y)
        twin = Twin(orbit.problem.system)
        before, after = physical(orbit, cycle.before), physical(orbit, cycle.after)
        size = np.max(np.abs(before))
        for i in range(len(cycle.contact)):
            j = (i + 1) % len(cycle.contact)
            landed = twin.flow(after[i], cycle.duration[i])
            assert np.max(np.abs(landed - before[j])) < 50 * EPS * size * max(1.0, cycle.duration[i]), orbit.name
            assert np.max(np.abs(twin.impact(before[j], cycle.contact[j]) - after[j])) < 50 * EPS * size, orbit.name
        assert abs(cycle.period / (4.0 * orbit.solution["quarter_period"]) - 1.0) < 1e-14
        assert np.min(cycle.speeds) > 0.0


def test_a_flipped_restitution_is_noticed():
    """The comparison of impacts above, with the twin's restitution turned round."""
    orbit = collection()[0]
    cycle = cycle_of(orbit.problem, orbit.solution.y)
    twin = Twin(orbit.problem.system, restitution_sign=-1.0)
    before, after = physical(orbit, cycle.before), physical(orbit, cycle.after)
    assert np.max(np.abs(twin.impact(before[0], cycle.contact[0]) - after[0])) > 0.1


def test_samples_keep_their_energy_and_stay_between_the_stops():
    for orbit in orbits():
        cycle = cycle_of(orbit.problem, orbit.solution.y)
        u, v = cycle.sample(np.linspace(0.0, 2.0 * cycle.period, 4000))
        assert np.max(np.abs(orbit.problem.system.energy(u, v) / orbit.energy - 1.0)) < 1e-13, orbit.name
        for stop in orbit.problem.system.stops:
            w = u @ np.array(stop.gap)
            assert np.max(w) < stop.upper + 1e-12 and np.min(w) > stop.lower - 1e-12


def test_sequences_have_the_symmetry_of_their_ends():
    """Beyond an end the impacts come back in reverse order, mirrored at an origin; a quarter's half period repeats mirrored."""
    for orbit in collection():
        problem = orbit.problem
        cycle = cycle_of(problem, orbit.solution.y)
        sequence = list(problem.sequence)
        if problem.ends[1].startswith("stop"):
            there = sequence + [problem.ends[1][-1]] + sequence[::-1]
        elif problem.ends[1] == "rest":
            there = sequence + sequence[::-1]
        else:
            there = sequence + [OTHER[x] for x in sequence[::-1]]
        start = [problem.ends[0][-1]] if problem.ends[0].startswith("stop") else []
        if problem.quarters == 1:
            mirrored = [OTHER[x] for x in there]
            expected = there + [OTHER[x] for x in start] + mirrored + start
        else:
            expected = there + start
        assert list(cycle.letters) == expected, orbit.name


def test_run_around_returns_to_itself():
    """The numpy flow from the start once round: the same impacts, and back within 100 eps |M| |state|."""
    checked = 0
    for orbit in orbits():
        problem = orbit.problem
        cycle = cycle_of(problem, orbit.solution.y)
        twin = Twin(problem.system)
        n = problem.half
        size = np.linalg.norm(monodromy(cycle), 2)
        if size > 1e8 or cycle.period > 100.0:
            continue
        # begin in the middle of a flight, so that rounding cannot move an impact across the ends of the run
        x = twin.flow(physical(orbit, cycle.after[:1])[0], 0.5 * cycle.duration[0])
        end, events = twin.run(x, cycle.period)
        letters = [twin.contacts[event[1]][4] for event in events]
        assert letters == list(cycle.letters[1:]) + [cycle.letters[0]], orbit.name
        scale = np.concatenate([np.full(n, np.max(np.abs(x[:n]))), np.full(n, np.max(np.abs(x[n:])))])
        matrix = np.linalg.norm(problem.modes.to_state @ monodromy(cycle) @ problem.modes.from_state, 2)
        assert np.max(np.abs(end - x)) < 100 * EPS * max(matrix, 1.0) * np.max(scale), orbit.name
        checked += 1
    assert checked >= 40


def test_samples_agree_with_the_run_and_are_right_continuous():
    system = vibro_impact_nes()
    problem, y = backbone_segment(system, 1.0)
    cycle = cycle_of(problem, y)
    twin = Twin(system)
    times = np.linspace(0.0, 3.9, 40)
    u, v = cycle.sample(times)
    expected = np.array([twin.run(np.concatenate([np.zeros(2), backbone.origin_velocity(system, 1.0)]), t)[0] for t in times])
    assert np.max(np.abs(np.hstack([u, v]) - expected)) < 1e-13
    again, _ = cycle.sample(times + 3.0 * cycle.period)
    assert np.max(np.abs(again - u)) < 1e-12
    instant = cycle.times[0]
    assert abs(instant - 1.0) < 1e-15
    modes = system.modes
    _, at = cycle.sample(np.array([instant]))
    assert np.array_equal(at, (cycle.after[:1] @ modes.to_state.T)[:, 2:])  # a product of one row more can round in another way
    u, v = backbone.motion(system, 1.0, np.linspace(-0.99, 0.99, 21))
    sampled = cycle.sample(np.linspace(-0.99, 0.99, 21))
    assert np.max(np.abs(np.hstack([u, v]) - np.hstack(sampled))) < 1e-14


def test_mirrored_contacts_of_two_stops():
    """A chain between two different stops: in the second half period each impact is on the same stop's other side."""
    stops = (Stop((1.0, -1.0), -1.0, 1.0), Stop((0.0, 1.0), -2.5, 2.5))
    system = ImpactSystem(np.diag([0.5, 1.0]), np.zeros((2, 2)), [[0.3, -0.3], [-0.3, 1.3]], stops)
    alpha = 0.3
    problem = MultipointProblem(system, ("origin", "stopa+"), ())
    y = problem.pack(
        system.modes.from_state @ np.concatenate([np.zeros(2), backbone.origin_velocity(system, alpha)]), np.zeros((0, 4)), [alpha]
    )
    cycle = cycle_of(problem, problem.solve(y, quarter_period=alpha).y)
    assert cycle.letters == ("a+", "a-")
    assert np.min(cycle.speeds) > 0.0
