"""Chains of up to six masses with stops between them and to the ground, traced from given states; rigid-body modes included.

Oracles: the event-driven run; conservation of energy and, where nothing ties the chain down, of momentum; the saltation product in numpy.
"""

from functools import cache

import numpy as np
import pytest

import saltus
from branches.tracing import follow_family
from bvp.closures import EndsError
from bvp.multipoint import MultipointProblem, NotConverged
from bvp.stability import stability
from bvp.system import ImpactSystem, Stop
from tests.branches.traced import EPS, monodromy
from tests.bvp import orbits as by_numpy
from tests.bvp.flow_twin import Twin


def tied(random, n):
    """A chain tied to the ground at its first mass, one one-sided stop between two masses and one to the ground."""
    chain = by_numpy.chain(random, n, grounded=True)
    ground = np.zeros(n)
    ground[n - 1] = 1.0
    stops = (Stop(chain.stops[0].gap, upper=0.7), Stop(tuple(ground), -1.0, 1.3))
    return ImpactSystem(chain.mass, chain.damping, chain.stiffness, stops)


@cache
def between_stops():
    """Solved orbits from an impact or a rest that reverses the motion to an impact that does, on chains tied to the ground."""
    random = np.random.default_rng(2)
    out = []
    for n in (2, 3, 4, 5, 6):
        for _ in range(14):
            system = tied(random, n)
            twin = Twin(system)
            contacts = twin.contacts
            if random.random() < 0.5:
                kind, leaving = "rest", None
                x = np.concatenate([random.uniform(-1.2, 0.6, n), np.zeros(n)])
                if np.min(twin.distances(x[None])) < 1e-2:
                    continue
            else:
                leaving = int(random.integers(len(contacts)))
                c, side, bound, _, letter = contacts[leaving]
                kind = "stop" + letter
                u = random.uniform(-0.6, 0.6, n)
                u += np.asarray(c) * (bound - c @ u) / (c @ c)
                direction = np.linalg.solve(system.mass, c)
                x = np.concatenate([u, -side * random.uniform(0.5, 3.0) * direction])
                if np.min(np.delete(twin.distances(x[None]), leaving)) < 1e-2:
                    continue
            _, events = twin.run(x, 30.0, leaving, 3)
            flights = np.diff([0.0] + [event[0] for event in events])
            nodes = np.array([system.modes.from_state @ event[3] for event in events]).reshape(len(events), 2 * n)
            for k in range(len(events)):
                letters = [contacts[event[1]][4] for event in events]
                problem = MultipointProblem(system, (kind, "stop" + letters[k]), tuple(letters[:k]))
                guess = problem.pack(system.modes.from_state @ x, nodes[:k], flights[: k + 1])
                try:
                    solution = problem.solve(guess)
                except NotConverged:
                    continue
                if min(solution["clearance"], solution["flight"], solution["speed"]) > 1e-3:
                    out.append((problem, solution))
                    break
    return tuple(out)


@cache
def from_origins():
    """Solved orbits of chains with odd symmetry, half of them free to move as a whole (tests/bvp/orbits.py)."""
    return tuple((orbit.problem, orbit.solution) for orbit in by_numpy.chains())


def families():
    return [*from_origins()[::2], *between_stops()]


@cache
def traced():
    """Their families, twenty points each."""
    return tuple(follow_family(problem, solution.y, points=20) for problem, solution in families())


def test_there_are_chains_of_every_kind():
    """Oracle: the count: 2 to 6 masses, rest and stop starts, zero-frequency modes, several stops."""
    branches = traced()
    assert {branch.system.degrees_of_freedom for branch in branches} == {2, 3, 4, 5, 6}
    assert {branch.ends[0][:4] for branch in branches} == {"orig", "rest", "stop"}
    free = [branch for branch in branches if branch.system.modes.frequencies[0] == 0.0]
    assert len(free) >= 4 and len(branches) >= 20
    assert sum(len(branch) > 5 for branch in branches) >= 0.7 * len(branches)


def test_each_orbit_is_one():
    """Oracle: the event-driven run returns within 100 eps |monodromy| |state| for each flight of the period; energy is constant."""
    checked = 0
    for branch in traced():
        for i in {1, len(branch) // 2} & set(range(len(branch))):
            speeds = branch.points["impact_speeds"][i]
            if np.min(speeds) < 1e-3:
                continue
            orbit = branch.orbit(i)
            assert orbit.residual < 1e-12
            u, v = orbit.sample(np.linspace(0.0, orbit.period, 801))
            assert np.max(np.abs(orbit.system.energy(u, v) / orbit.h - 1.0)) < 1e-13
            for stop in orbit.system.stops:
                w = u @ np.array(stop.gap)
                assert np.max(w) < stop.upper + 1e-11 and np.min(w) > stop.lower - 1e-11
            u, v = orbit.sample(np.array([0.0173 * orbit.period]))
            start = np.concatenate([u[0], v[0]])
            run = saltus.simulate(orbit.system, u[0], v[0], orbit.period)
            size = max(1.0, np.linalg.norm(monodromy(orbit), 2))
            assert np.linalg.norm(run.final - start) < 100.0 * EPS * size * np.linalg.norm(start)
            checked += 1
    assert checked >= 20


def test_multipliers_are_those_of_the_saltation_product():
    """Oracle: the trace of the monodromy formed in numpy, less the trivial multipliers: two, and two of each translation that closes no
    gap. Pairs have the product 1."""
    checked = 0
    for branch in traced():
        i = len(branch) // 2
        multipliers = branch.points["multipliers"][i]
        if np.any(np.isnan(multipliers)):
            continue
        product = monodromy(branch.orbit(i))
        size = np.linalg.norm(product, 2)
        modes = branch.system.modes
        free = np.sum((modes.frequencies == 0.0) & (np.abs(modes.contacts.gap[:, : len(modes.frequencies)]).max(axis=0) < 1e-12))
        assert len(multipliers) == 2 * branch.system.degrees_of_freedom - 2 - 2 * free
        error = abs(np.sum(multipliers) - (np.trace(product) - 2.0 - 2.0 * free))
        assert error < 1e-9 * max(1.0, np.abs(multipliers[0])) + 1e4 * EPS * size
        assert branch.points["pairing"][i] < 1e-6 or not branch.points["reliable"][i]
        checked += 1
    assert checked >= 20


def test_stability_is_that_of_the_multipliers():
    """Oracle: the saltation product: no multiplier off the unit circle by more than the square root of its error, or one that is."""
    stable = unstable = 0
    for branch in traced():
        i = len(branch) // 2
        said = branch.points["stable"][i]
        product = monodromy(branch.orbit(i))
        size = np.linalg.norm(product, 2)
        largest = np.max(np.abs(np.linalg.eigvals(product)))
        if said == 1:
            # alone the orbit may be undecided: a branch decides between its events
            assert largest < 1.0 + 1e-3 and stability(branch.problem, branch.orbit(i).solution).stable is not False
            stable += 1
        elif largest > 1.0 + 10.0 * np.sqrt(1e3 * EPS * size):
            assert said == 0
            unstable += 1
    assert stable and unstable


def test_free_chains_keep_their_momentum():
    """Oracle: conservation: no force acts from outside, so an orbit that closes has no momentum."""
    seen = 0
    for branch in traced():
        if branch.system.modes.frequencies[0] != 0.0:
            continue
        orbit = branch.orbit(len(branch) // 2)
        _, v = orbit.sample(np.linspace(0.0, orbit.period, 50))
        assert np.max(np.abs(v @ branch.system.mass.sum(axis=0))) < 1e-10 * np.max(np.abs(v))
        seen += 1
    assert seen >= 4


def test_chains_have_files(tmp_path):
    """Oracle: the branch before it was written."""
    for number, branch in enumerate(traced()[::6]):
        branch.save(tmp_path / f"{number}.json")
        back = saltus.read_branch(tmp_path / f"{number}.json")
        assert back.id == branch.id and back.points["label"].tolist() == [""] * len(branch)
        for key, values in branch.points.items():
            np.testing.assert_array_equal(back.points[key], values)
        again = back.trace(len(back) // 2, points=6)
        assert np.min(np.abs(again.points["h"] / branch.points["h"][len(branch) // 2] - 1.0)) < 1e-12


def test_translations_leave_a_free_chain_underdetermined():
    """Oracle: theory: nothing fixes where a free chain stands when it rests, so its orbits are no one-parameter family: the Jacobian
    lacks a rank at each of them. Such ends are refused, with the motion that nothing resists."""
    random = np.random.default_rng(3)
    system = by_numpy.chain(random, 3)
    twin = Twin(system)
    seen = 0
    for _ in range(60):
        x = np.concatenate([random.uniform(-2.0, 2.0, 3), np.zeros(3)])
        events = twin.run(x, 30.0, None, 1)[1] if np.min(twin.distances(x[None])) > 1e-2 else []
        if not events:
            continue
        problem = MultipointProblem(system, ("rest", "stop" + twin.contacts[events[0][1]][4]), ())
        y = problem.pack(system.modes.from_state @ x, np.zeros((0, 6)), [events[0][0]])
        solution = problem.step(y, np.zeros(2 * problem.unknowns), 0.0)
        if solution is None:
            continue
        singular = np.linalg.svd(problem.jacobian(solution.y))[1]
        assert singular[-1] < 1e-12 * singular[0]
        refused = "free to drift: no spring or stop that is hit resists a motion of u1 by 1, u2 by 1, u3 by 1"
        with pytest.raises(EndsError, match=refused):
            problem.solve(solution.y)
        with pytest.raises(EndsError, match=refused):
            follow_family(problem, solution.y, points=10)
        seen += 1
    assert seen
