"""Periodic impulsive orbits: every one that exists is found, and each found is one.

Oracles: the impulsive events of families that are followed; runs in time, sampled densely; a scan over energy of no cleverness.
"""

from functools import cache

import numpy as np
import pytest

from branches.naming.labels import canonical_label, parse
from branches.search.impulsive_motions import impulsive_manifold, impulsive_state, oscillator_period
from branches.search.impulsive_orbits import impulsive_orbits, solve_impulsive
from branches.tracing import follow_family
from bvp.multipoint import NotConverged
from bvp.simulate import simulate
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from continuation.control import Settings
from tests.branches.traced import traced

SYSTEM = vibro_impact_nes()


@cache
def listed(low, high, quarter_period, mu=0.1, sigma=0.1, impacts=None):
    return impulsive_orbits(vibro_impact_nes(mu=mu, sigma=sigma), (low, high), quarter_period=quarter_period, impacts=impacts)


def at_energy(found, h):
    """The listed orbit nearest in energy."""
    return min(found.orbits, key=lambda orbit: abs(orbit.h - h))


# ------------------------------------------------------------------------------------------------ against families followed


@pytest.mark.parametrize("name", ["S73O33-@h=7.3348,alpha=1.6459", "U8353-@h=1.9458,alpha=4.9065"])
def test_events_of_named_families_are_listed(name):
    """Oracle: the events IO of a family that was found by its name and followed."""
    found = listed(0.05, 20.0, 5.1)
    events = [event for event in traced(name).events if event.type == "IO"]
    assert events
    for event in events:
        orbit = at_energy(found, event.h)
        assert abs(orbit.h / event.h - 1.0) < 1e-10 and abs(orbit.alpha / event.alpha - 1.0) < 1e-10


@pytest.mark.parametrize(("mu", "sigma"), [(0.37, 0.81)])
def test_families_through_the_listed_orbits_have_these_events_and_no_others(mu, sigma):
    """Oracle: see `require_families_through_the_listed_orbits_have_these_events_and_no_others`."""
    require_families_through_the_listed_orbits_have_these_events_and_no_others(mu, sigma)


def require_families_through_the_listed_orbits_have_these_events_and_no_others(mu, sigma):
    """Oracle: the family through each orbit, followed both ways: an event IO at the orbit, and none inside the bounds that is not
    listed."""
    found = listed(0.2, 3.0, 5.1, mu, sigma)
    assert found.complete and len(found.orbits) > 3
    for orbit in found.orbits:
        branch = follow_family(orbit.orbit.problem, orbit.orbit.solution.y, energy=(0.2, 3.0))
        events = [event for event in branch.events if event.type == "IO" and event.alpha <= 5.1]
        assert any(abs(event.h / orbit.h - 1.0) < 1e-10 and abs(event.alpha / orbit.alpha - 1.0) < 1e-10 for event in events)
        for event in events:
            near = at_energy(found, event.h)
            assert abs(near.h / event.h - 1.0) < 1e-9
            ours, theirs = canonical_label(parse(near.label)), canonical_label(parse(event.label))
            assert (ours.kind, ours.parity, ours.p, ours.q) == (theirs.kind, theirs.parity, theirs.p, theirs.q)


def test_orbits_of_the_paper():
    """Oracle: Lee et al. (2009), Fig. 9, shows impulsive orbits on U5231 and U4122, and Fig. 6 one on U3201-; each label is on one."""
    labels = [orbit.label for orbit in listed(0.05, 20.0, 5.1).orbits]
    assert {"U5231-", "U4122-", "U3201-", "S55O11-", "S73E33-", "S73O33-"} <= set(labels)
    assert len(labels) == len(set(labels))


# ------------------------------------------------------------------------------------------------ against a scan


def test_other_places_of_the_first_intervals_find_the_same():
    """Oracle: the same range in three parts, whose first intervals lie elsewhere."""
    whole = listed(0.05, 20.0, 5.1)
    parts = [listed(a, b, 5.1) for a, b in ((0.05, 0.83), (0.83, 4.4), (4.4, 20.0))]
    together = [orbit.h for part in parts for orbit in part.orbits]
    np.testing.assert_allclose(together, [orbit.h for orbit in whole.orbits], rtol=1e-12)
    assert whole.complete and all(part.complete for part in parts)


# ------------------------------------------------------------------------------------------------ each is one


@pytest.mark.parametrize("index", [0, 1, 5, 9, 15, 24])
def test_each_is_an_impulsive_periodic_orbit(index):
    """Oracle: a run in time from the start comes back after T, not after T/2, T/3; dense samples stay between the stops."""
    orbit = listed(0.05, 20.0, 5.1).orbits[index]
    whole = orbit.orbit
    start = SYSTEM.modes.to_state @ whole.problem.start(whole.solution.y)
    speed = np.sqrt(2.0 * orbit.h)
    assert np.all(start[:2] == 0.0) and abs(start[2]) < 1e-14 * speed and abs(abs(start[3]) / speed - 1.0) < 1e-14
    assert abs(orbit.velocity / speed - 1.0) < 1e-14 and whole.residual < 1e-12
    motion = simulate(SYSTEM, *impulsive_state(SYSTEM, orbit.h), 4.0 * orbit.alpha)
    assert len(motion.stop_events) == 2 * orbit.impacts
    assert np.max(np.abs(motion.final - motion.start)) < 1e-6 * speed
    for part in (2, 3, 5):
        state = np.concatenate(motion.sample([4.0 * orbit.alpha / part]), axis=1)[0]
        assert np.max(np.abs(state - motion.start)) > 1e-3 * speed
    inside, _ = whole.sample(np.linspace(0.0, whole.period, 5001))
    assert np.max(np.abs(inside[:, 0] - inside[:, 1])) <= 1.0 + 1e-12


NEAR = Settings(initial_step=1e-4, maximum_step=1e-4)
"""Steps to orbits so near that the label does not change for another reason."""


def test_label_is_that_of_the_side_out_of_phase():
    """Oracle: the family a little to both sides of the orbit, and the sign of its start velocities there."""
    for orbit in listed(0.05, 20.0, 5.1).orbits[:12]:
        branch = follow_family(orbit.orbit.problem, orbit.orbit.solution.y, points=3, direction="both", settings=NEAR)
        start = int(np.argmin(np.abs(branch.points["h"] - orbit.h)))
        beside = {}
        for i in (start - 1, start + 1):
            first, second = branch.points["velocities"][i]
            beside[first * second < 0.0] = parse(str(branch.points["label"][i]))
        assert set(beside) == {True, False}
        assert beside[True].sign == "-" and beside[True].m == parse(orbit.label).m and parse(orbit.label).sign == "-"
        assert beside[False].m == parse(orbit.other_label).m == beside[True].m - (1 if orbit.orbit.ends[1] == "origin" else 2)


def test_bounds():
    """Oracle: the list without bounds, filtered."""
    whole, fewer, shorter = listed(0.05, 20.0, 5.1), listed(0.05, 20.0, 5.1, impacts=5), listed(0.05, 20.0, 3.0)
    assert [orbit.label for orbit in fewer.orbits] == [orbit.label for orbit in whole.orbits if orbit.impacts <= 5]
    assert [orbit.label for orbit in shorter.orbits] == [orbit.label for orbit in whole.orbits if orbit.alpha <= 3.0]


@pytest.mark.parametrize(("low", "high", "quarter_period", "longer"), [(0.05, 100.0, 5.1, 5.6)])
def test_orbits_near_the_longest_quarter_period(low, high, quarter_period, longer):
    """Oracle: see `require_orbits_near_the_longest_quarter_period`."""
    require_orbits_near_the_longest_quarter_period(low, high, quarter_period, longer)


def require_orbits_near_the_longest_quarter_period(low, high, quarter_period, longer):
    """Oracle: the list up to a longer quarter period, filtered."""
    whole, shorter = listed(low, high, longer), listed(low, high, quarter_period)
    assert whole.complete and shorter.complete
    expected = [(orbit.label, orbit.impacts) for orbit in whole.orbits if orbit.alpha <= quarter_period]
    assert [(orbit.label, orbit.impacts) for orbit in shorter.orbits] == expected
    assert max(orbit.alpha for orbit in shorter.orbits) > 0.98 * quarter_period


def test_below_the_energy_of_the_first_impact_there_is_none():
    """Oracle: no motion of this system hits below h = sigma/2."""
    found = listed(0.01, 0.05, 10.0)
    assert found.orbits == () and found.complete


# ------------------------------------------------------------------------------------------------ its parts


def test_oscillator_period():
    """Oracle: 2 pi for the reference system; sqrt(m/k) of the mass on its spring for another."""
    assert oscillator_period(vibro_impact_nes(mu=0.3, sigma=0.7)) == pytest.approx(2.0 * np.pi, rel=1e-15)
    system = ImpactSystem([[0.2, 0.0], [0.0, 3.0]], np.zeros((2, 2)), [[0.4, -0.4], [-0.4, 2.4]], [Stop((1.0, -1.0), -1.0, 1.0)],
                          absorber=0, primary=1)  # fmt: skip
    assert oscillator_period(system) == pytest.approx(2.0 * np.pi * np.sqrt(3.0 / 2.0), rel=1e-14)


def three_masses():
    stiffness = [[0.1, -0.1, 0.0], [-0.1, 1.1, -1.0], [0.0, -1.0, 2.0]]
    return ImpactSystem(np.eye(3), np.zeros((3, 3)), stiffness, [Stop((1.0, -1.0, 0.0), -1.0, 1.0)], absorber=0, primary=1)


@pytest.mark.parametrize(
    ("system", "energy", "said"),
    [
        (SYSTEM, (2.0, 1.0), "^energy range 2:1 is empty or reversed; expected 0 < LO < HI < inf$"),
        (SYSTEM, (0.0, 1.0), "^energy range 0:1: expected 0 < LO < HI < inf$"),
        (SYSTEM, (1.0, np.inf), "^energy range 1:inf: expected 0 < LO < HI < inf$"),
        (vibro_impact_nes(rho=0.7), (1.0, 2.0), "restitution 0.7"),
        (vibro_impact_nes(lam=0.01), (1.0, 2.0), "damping"),
        (three_masses(), (1.0, 2.0), "two degrees of freedom; this system has 3"),
        (ImpactSystem(np.eye(2), np.zeros((2, 2)), np.eye(2), [Stop((1.0, -1.0), -1.0, 1.0)]), (1.0, 2.0), "names no absorber and primary"),
        (
            ImpactSystem(np.eye(2), np.zeros((2, 2)), np.eye(2), [Stop((1.0, -1.0), -1.0, 2.0)], absorber=0, primary=1),
            (1.0, 2.0),
            "equal gaps",
        ),
    ],
)
def test_what_cannot_be(system, energy, said):
    """Oracle: the words of the message."""
    with pytest.raises(ValueError, match=said) as caught:
        impulsive_orbits(system, energy, quarter_period=2.0)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("bounds", "said"),
    [
        ({"quarter_period": 0.0}, "the longest quarter period is 0.0, expected a finite number above 0"),
        ({"quarter_period": "2"}, "the longest quarter period is '2', expected a finite number above 0"),
        ({"quarter_period": 2.0, "impacts": -1}, "the most impacts of half a period is -1, expected an integer from 0 to 10000"),
        ({"quarter_period": 2.0, "impacts": 0.5}, "the most impacts of half a period is 0.5, expected an integer from 0 to 10000"),
        ({"quarter_period": 2.0, "impacts": 10**9}, "the most impacts of half a period is 1000000000, expected an integer from 0 to 10000"),
    ],
)
def test_bounds_that_cannot_be(bounds, said):
    """Oracle: the words of the message."""
    with pytest.raises(ValueError, match=said):
        impulsive_orbits(SYSTEM, (1.0, 2.0), **bounds)


def test_more_impacts_than_memory_holds_are_refused():
    """Oracle: at energy 1e20 the gap closes in less than 1e-9 of time, so half a period has more than a billion impacts."""
    with pytest.raises(ValueError, match=r"with energy 1e\+20 can have \d{11,} impacts .* the most impacts$"):
        impulsive_orbits(SYSTEM, (1e19, 1e20), quarter_period=2.0)


@pytest.mark.parametrize(("name", "value"), [("density", 0), ("density", "a"), ("density", 2.5), ("periods", 0), ("periods", True)])
def test_a_manifold_needs_whole_numbers(name, value):
    """Oracle: the words of the message."""
    with pytest.raises(ValueError, match=rf"^{name} = {value!r}: expected an integer, at least 1$"):
        impulsive_manifold(SYSTEM, (1.0, 1.1), **{name: value})


@pytest.mark.parametrize(
    ("factor", "said"),
    [(np.nan, "corrections diverged"), (10.0, "corrections did not converge .residual"), (1e8, "corrections did not converge$")],
)
def test_newtons_method_says_why_it_fails(factor, said):
    """Oracle: starts far from any orbit."""
    orbit = listed(2.5, 3.5, 2.0).orbits[0].orbit
    with pytest.raises(NotConverged, match=said):
        solve_impulsive(orbit.problem, factor * orbit.solution.y)


def test_a_bracket_without_a_solution_is_reported(monkeypatch):
    """Oracle: every zero is in the list of the unpolished if Newton's method is made to fail, and the list is not complete."""
    from branches.search import impulsive_orbits as orbits

    def fail(problem, y):
        raise NotConverged("made to fail")

    monkeypatch.setattr(orbits, "solve_impulsive", fail)
    found = impulsive_orbits(SYSTEM, (2.5, 3.5), quarter_period=2.0)
    assert not found.complete and found.orbits == () and found.unpolished
    assert found.unpolished[0].low <= 2.98736732 and found.unpolished[0].high >= 2.98736731 and found.unpolished[0].reason == "made to fail"
