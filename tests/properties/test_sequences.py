"""Properties of orbits at random systems and energies: sequences found there are solved, closed, admissible, and named.

Oracles: the event-driven run; conservation of energy; the saltation product in numpy; the labels' own grammar and dense counts.
"""

from functools import cache

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import saltus
from branches.naming.labels import parse, parse_name
from branches.naming.matching import matches
from branches.orbit import Orbit
from branches.sequences import canonical_sequence
from branches.tracing import follow_family
from bvp.multipliers import saddle_point_multipliers
from tests.branches.scans import sampled
from tests.branches.traced import EPS, count_label, monodromy

SYSTEMS = st.tuples(st.floats(0.02, 2.0), st.floats(0.0, 2.0))
KINDS = st.sampled_from([("stop", (0, 1, 2, 3)), ("origin", (1, 2, 3, 4, 5)), ("rest", (1, 2, 3))])


@cache
def collected():
    """Orbits found at ten random systems and energies, one for each sequence between its ends, over all systems."""
    random = np.random.default_rng(4)
    found = {}
    for _ in range(10):
        mu, sigma = random.uniform(0.02, 2.0, 2)
        energy = float(np.exp(random.uniform(np.log(0.3), np.log(20.0))))
        system = saltus.vibro_impact_nes(float(mu), float(sigma))
        for kind, impacts in (("stop", range(5)), ("origin", range(1, 7)), ("rest", range(1, 4))):
            for orbit in sampled(system, kind, 9.0, energy, 500, impacts):
                ends, sequence = orbit.problem.ends, orbit.problem.sequence
                found.setdefault(canonical_sequence(sequence, ends, odd_symmetry=True), orbit)
    return found


def whole(found):
    return Orbit(found.problem, found.solution)


def check(orbit, label):
    """All that an orbit owes."""
    period = orbit.period
    assert orbit.residual < 1e-12 and orbit.impacts
    u, v = orbit.sample(np.linspace(0.0, period, 3001))
    assert np.max(np.abs(u[:, 0] - u[:, 1])) < 1.0 + 1e-12
    assert np.max(np.abs(orbit.system.energy(u, v) / orbit.h - 1.0)) < 1e-13
    start_u, start_v = orbit.sample(np.array([0.0213 * period]))
    start = np.concatenate([start_u[0], start_v[0]])
    run = saltus.simulate(orbit.system, start_u[0], start_v[0], period)
    size = np.linalg.norm(monodromy(orbit), 2)
    # for n impacts the run rounds n times as often as for one
    assert np.linalg.norm(run.final - start) < 100.0 * EPS * max(1.0, size) * np.linalg.norm(start)
    assert len(run.stop_events) == len(orbit.impacts)
    found = saddle_point_multipliers(orbit.cycle)
    assert abs(found.values[0] * found.values[1] - 1.0) < 1e-6
    tau = np.trace(monodromy(orbit)) - 2.0
    assert abs(tau - orbit.tau) < 1e-9 * max(1.0, abs(tau)) + 1e3 * EPS * size
    if label is not None:
        assert str(label) == orbit.label and parse(str(label)) == label and matches(label, label)
        assert parse_name(f"{label}@h={orbit.h!r}").h == orbit.h
        m, n, first, second, _ = count_label(orbit)
        assert (label.m, label.n, label.p, label.q) == (m, n, first, second)


def test_twenty_sequences_are_solved():
    """Oracle: the count: sequences that differ in the canonical form, over all random systems; each orbit owes what `check` asks."""
    sequences = {sequence for sequence, _ in collected()}
    assert len(sequences) >= 20, sorted(sequences)
    assert len(collected()) >= 25
    for found in collected().values():
        check(whole(found), found.label)


def test_unstable_orbits_are_among_them():
    """Oracle: the multipliers: the collection spans stable orbits and ones that grow a thousandfold in a period."""
    sizes = [abs(whole(found).multipliers[0]) for found in collected().values()]
    assert min(sizes) < 1.0 + 1e-6 and max(sizes) > 1e3


@settings(max_examples=20, derandomize=True)
@given(SYSTEMS, st.floats(np.log(0.2), np.log(50.0)), KINDS, st.integers(0, 3))
def test_orbits_at_random(system, level, kind, pick):
    """Oracle: `check`, on an orbit of a random system, energy and kind of end; sigma may be 0."""
    mu, sigma = system
    assume(sigma == 0.0 or sigma > 1e-3)
    name, impacts = kind
    energy = float(np.exp(level))
    for found in sampled(saltus.vibro_impact_nes(mu, sigma), name, 6.0, energy, 200, impacts):
        if pick == 0:
            # next to grazing rounding is magnified without bound
            if min(found.solution["speed"], found.solution["clearance"], found.solution["flight"]) > 1e-4:
                check(whole(found), found.label)
            return
        pick -= 1


@settings(max_examples=10, derandomize=True)
@given(SYSTEMS, st.floats(np.log(0.2), np.log(50.0)), st.integers(0, 5))
def test_families_at_random(system, level, pick):
    """Oracle: a random orbit's family holds the orbit; its points are orbits, its events in order and in their brackets."""
    mu, sigma = system
    assume(sigma == 0.0 or sigma > 1e-3)
    found = sampled(saltus.vibro_impact_nes(mu, sigma), "stop", 6.0, float(np.exp(level)), 200, [0, 1, 2])
    assume(found)
    orbit = found[pick % len(found)]
    energy = (0.3 * orbit.h, 3.0 * orbit.h)
    branch = follow_family(orbit.problem, orbit.solution.y, energy=energy, points=120)
    p = branch.points
    assert np.max(p["residual"]) < 1e-12 and np.all(np.diff(p["arclength"]) > -1e-12)
    assert p["h"].min() >= energy[0] * (1 - 2e-10) and p["h"].max() <= energy[1] * (1 + 2e-10)
    assert math_close(p["h"][branch.start], orbit.h) and math_close(p["alpha"][branch.start], orbit.alpha)
    for event in branch.events:
        assert event.bracket[0] <= event.arclength <= event.bracket[1]
    assert all(end.reason in ("EVENT", "POINTS", "CLOSED") for end in branch.ended), branch.ended
    special = {event.point for event in branch.events}
    for i in {1, len(branch) // 2} - special:
        if p["reliable"][i] and abs(p["multipliers"][i, 0]) < 1e5:
            found_label = parse(str(p["label"][i])) if p["label"][i] else None
            check(branch.orbit(i), found_label)


def math_close(a, b):
    return abs(a / b - 1.0) < 1e-9


@pytest.mark.parametrize("kind", ["stop", "rest", "origin"])
def test_mirrored_orbits_are_orbits(kind):
    """Oracle: symmetry: u -> -u with the walls exchanged solves the mirrored sequence with the same period and trace."""
    other = {"+": "-", "-": "+"}
    from bvp.multipoint import MultipointProblem

    mirrored = 0
    for found in collected().values():
        problem = found.problem
        if not problem.ends[1].startswith(kind):
            continue
        ends = tuple("stop" + other[end[-1]] if end.startswith("stop") else end for end in problem.ends)
        image = MultipointProblem(problem.system, ends, tuple(other[letter] for letter in problem.sequence))
        y = found.solution.y
        start, nodes = -problem.start(y), -problem.nodes(y)
        solution = image.solve(image.pack(start, nodes, problem.flight_times(y)))
        assert abs(solution["energy"] / found.h - 1.0) < 1e-12 and abs(solution["quarter_period"] / found.alpha - 1.0) < 1e-12
        tau = Orbit(image, solution).tau
        assert abs(tau - whole(found).tau) < 1e-7 * max(1.0, abs(tau)) ** 2
        mirrored += 1
    assert mirrored
