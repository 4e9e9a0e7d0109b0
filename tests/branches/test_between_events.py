"""Stability between events: one decided orbit decides an interval, in fifty digits where double precision decides none.

Oracles: `tests.branches.many_digits` (single shooting over the whole period), counts, and columns made by hand.
"""

from functools import cache

import numpy as np
import pytest

import saltus
from branches import between_events
from branches.between_events import Barrier, decide_between, missed_events, stability_events
from branches.orbit import orbit_columns
from branches.tracing import follow_family
from bvp.multipoint import MultipointProblem
from tests.branches.many_digits import ManyDigits
from tests.branches.paper_names import family

MIDDLE = {
    # The start state (u, v) and the flight times of an orbit that double precision leaves undecided, with all up to the next events.
    "stop+-stop+:-+-+-+-+-": (
        [0.8471296340094546, -0.1528703659905455, -5.451540051620384, 0.5451540051620386],
        [0.3293610455294466, 0.3293256334976281, 0.3293928049044436, 0.3293001482195252, 0.3294089190259043, 0.3292944950921253]
        + [0.32940337167382355, 0.3293108861372876, 0.3293782286928813, 0.329342922437023],
        (1.69, 3.5),
    ),
    "stop+-stop-:+--+-+": (
        [3.878733826876753, 2.8787338268767515, -0.5144596455307066, 0.05144596455307067],
        [0.6430224139008901, 2.3664014864266925, 2.6357498394463232, 1.1197534693037505, 0.8982854481571384, 1.292231731944389]
        + [0.9321819736419646],
        (3.8, 5.2),
    ),
}

HIDDEN = (
    # The start velocities and the flight times of an orbit with |tau| - 2 near 1e-11.
    [0.07554065916805676, -2.654531978913927],
    [0.38590179577246103, 0.6795398699779682, 0.755400013877697, 0.7722890177514774, 0.6673648656782392, 0.774014289004343]
    + [0.701069035959848, 0.7289161950621111, 0.7768484800947256, 0.3318248640136091],
)


@cache
def branch_of(name):
    if name not in MIDDLE:
        return family(name)
    state, times, energy = MIDDLE[name]
    ends, sequence = name.split(":")
    problem = MultipointProblem(saltus.vibro_impact_nes(), tuple(end for end in ends.replace("-stop", " stop").split()), tuple(sequence))
    return follow_family(problem, problem.pack(problem.modes.from_state @ np.array(state), None, times), energy=energy)


def in_double_precision(branch):
    """Stability of each point by itself."""
    return orbit_columns(branch.problem, [branch.orbit(i).solution for i in range(len(branch))])["stable"]


@pytest.mark.parametrize("name", ["U4122-", "S73O33-", *[*MIDDLE][1:]])
def test_what_is_decided_between_events_is_so_in_fifty_digits(name):
    """Oracle: see `require_what_is_decided_between_events_is_so_in_fifty_digits`."""
    require_what_is_decided_between_events_is_so_in_fifty_digits(name)


def require_what_is_decided_between_events_is_so_in_fifty_digits(name):
    """Oracle: the sign of |tau| - 2 in fifty digits, at random points of the intervals that double precision leaves undecided."""
    branch = branch_of(name)
    new = np.flatnonzero((in_double_precision(branch) < 0) & (branch.points["stable"] >= 0))
    settled = 0
    for i in np.random.default_rng(5).permutation(new)[:8]:
        try:
            margin = ManyDigits(branch.orbit(int(i)), 150).margin
        except ArithmeticError:
            continue  # the equations of a whole period are singular to more digits than the start has
        assert (margin < 0) == (branch.points["stable"][i] == 1)
        settled += 1
    assert settled >= 4


@pytest.mark.parametrize("name", ["U8344-", *MIDDLE])
def test_an_orbit_of_a_branch_has_the_stability_that_the_family_decides(name):
    """Oracle: the points of the branch; between two that agree the family is as at both. What stays undecided is at an event or grazes."""
    branch = branch_of(name)
    stable, tau = branch.points["stable"], branch.points["tau"]
    new = np.flatnonzero((in_double_precision(branch) < 0) & (stable >= 0))
    events = {event.point for event in branch.events}
    at = {event.point for event in branch.events if event.type in ("SN", "BP", "SB", "PD")}
    assert len(new) and all(i in at or np.isnan(tau[i]) for i in np.flatnonzero(stable < 0))
    for i in new[:: max(1, len(new) // 8)].tolist():
        assert branch.orbit(i).stable == (branch.points["stable"][i] == 1)
        if {i, i + 1}.isdisjoint(events) and i + 1 in new:
            middle = branch.orbit_between(i, 0.5, energy=float(0.5 * (branch.points["h"][i] + branch.points["h"][i + 1])))
            assert middle.stable == (branch.points["stable"][i] == 1)


def test_the_work_in_fifty_digits_is_counted():
    """Oracle: counts: none where double precision decides every orbit; on both sides of its branch point the last family has none."""
    assert branch_of("S11-").digit_work.orbits == 0
    works = [branch_of(name).digit_work for name in MIDDLE]
    assert all(work.orbits >= 2 and work.seconds > 0.0 for work in works)
    total = works[0] + works[1]
    assert total.orbits == works[0].orbits + works[1].orbits and total.seconds == works[0].seconds + works[1].seconds


def test_events_that_rounding_hides_are_seen():
    """Oracle: fifty digits at the two orbits, and single shooting in many: b of the half map changes its sign twice between 1e-9 and 1e-35,
    where double precision has no more than its rounding."""
    problem = MultipointProblem(saltus.vibro_impact_nes(), ("origin", "origin"), tuple("+-+-+-+-+"))
    start = problem.modes.from_state @ np.array([0.0, 0.0, *HIDDEN[0]])
    branch = follow_family(problem, problem.pack(start, None, HIDDEN[1]), energy=(1.5, 6.0))
    stable = branch.points["stable"]
    assert {0, 1} == set(stable[stable >= 0])
    for i in (1, len(branch) // 2, len(branch) - 2):
        assert (ManyDigits(branch.orbit(i), 100).margin < 0) == (stable[i] == 1)
    missed = [found for found in missed_events(branch) if "SB" in found.types]
    assert all(found.hidden for found in missed)
    assert len(missed) + sum(event.type == "SB" for event in branch.events) == 2


# -- columns made by hand -----------------------------------------------------------------------------------------------------

HALF = MultipointProblem(saltus.vibro_impact_nes(), ("rest", "rest"), ("+",))
QUARTER = MultipointProblem(saltus.vibro_impact_nes(), ("origin", "stop+"), ())


@pytest.fixture
def decided(monkeypatch):
    """(stability in double precision, the true one, events) -> stability of points at arclengths 0, 1, 2, ..., and those solved."""

    def decide(stable, true, *barriers, problem=HALF, grazing=()):
        asked = []

        def solved(problem, y, distance):
            asked.append(int(y[0]))
            return true[int(y[0])]

        monkeypatch.setattr(between_events, "_in_digits", solved)
        multipliers = np.ones((len(stable), 2), complex)
        multipliers[list(grazing)] = np.nan
        columns = {"stable": np.array(stable, np.int8), "arclength": np.arange(float(len(stable))), "multipliers": multipliers}
        found, work = decide_between(problem, lambda i: (problem, np.array([i])), columns, barriers)
        assert work.orbits == len(asked) == len(set(asked))
        return found.tolist(), asked

    return decide


def at(type, point, width=0.0):
    return Barrier(type, point, (point - width, point + width))


def test_few_points_follow_from_those_around_them(decided):
    """Oracle: by hand: at an event stability is not decided, on either side it may differ."""
    assert decided([1, -1, -1, 1, -1, 0, -1, 0], [9] * 8, at("PD", 4)) == ([1, 1, 1, 1, -1, 0, 0, 0], [])
    assert decided([1, -1, -1, 1], [9] * 4, at("RT", 2), at("GR", 0), at("LB", 1), at("IO", 3)) == ([1, 1, 1, 1], [])


def test_points_inside_a_bracket_and_at_a_grazing_stay_undecided(decided):
    """Oracle: by hand."""
    assert decided([0, -1, -1, -1, 1, 1], [9] * 6, at("SB", 2, 1.5))[0] == [0, -1, -1, -1, 1, 1]
    assert decided([-1, 1, -1, 1, -1], [9] * 5, grazing=(0, 4))[0] == [-1, 1, 1, 1, -1]


def test_an_interval_without_a_decided_orbit_is_decided_in_fifty_digits(decided):
    """Oracle: counts: the first orbit that is solved is the farthest from the events; one that is not decided ends the search."""
    stable, asked = decided([-1] * 41, [0] * 20 + [-1] + [1] * 20, at("BP", 20))
    assert stable == [0] * 20 + [-1] + [1] * 20 and asked[0] == 10 and len(asked) <= 2 * (20 // between_events.SPACING + 4)
    assert decided([-1] * 100, [-1] * 100) == ([-1] * 100, [49])


def test_an_event_that_was_missed_in_a_run_of_undecided_points_is_found(decided):
    """Oracle: the true stability, which changes at places that are further apart than the orbits that are solved; the points on either side
    of each change were solved themselves."""
    rng = np.random.default_rng(7)
    for _ in range(50):
        true = np.repeat(np.arange(6) % 2, rng.integers(between_events.SPACING + 1, 30, 6))
        known = np.where(rng.random(len(true)) < 0.02, true, -1)
        known[rng.integers(len(true))] = -1
        stable, asked = decided(known.tolist(), true.tolist())
        assert stable == true.tolist()
        for i in np.flatnonzero(np.diff(true)):
            assert {i, i + 1} <= set(asked) | set(np.flatnonzero(known >= 0))


def test_an_event_that_was_missed_beside_an_end_is_found(decided):
    """Oracle: by hand: of three points between an event and a decided one the first differs from that one."""
    assert decided([-1, -1, -1, -1, 0, 0], [-1, 1, 1, 1, 0, 0], at("SN", 0))[0] == [-1, 1, 1, 1, 0, 0]


def test_neighbours_that_differ_are_decided_in_fifty_digits(decided):
    """Oracle: by hand: of two that differ one is wrong, or both are right and an event was missed."""
    assert decided([1, 1, 0, 1, 1], [1] * 5) == ([1] * 5, [1, 2, 3])
    assert decided([0, 1, 1, 0, 0], [0, 0, 0, 0, 0]) == ([0] * 5, [0, 1, 2, 3])
    assert decided([0, 0, 1, 1], [0, 0, 1, 1]) == ([0, 0, 1, 1], [1, 2])
    assert decided([0, 0, 1, 1], [-1] * 4) == ([0, 0, 1, 1], [1, 2])


def test_orbits_next_to_an_event_that_fifty_digits_do_not_decide_are_as_those_further_on(decided):
    """Oracle: by hand."""
    assert decided([-1] + [-1] * 9 + [1], [-1] * 4 + [1] * 7, at("BP", 0))[0] == [-1] + [1] * 10


def test_which_events_change_stability(decided):
    """Oracle: with reversals a quarter period apart the period doubles at tau_half = 0, and orbits are stable for |tau_half| < 2."""
    assert decided([1, -1, -1, 1], [9] * 4, at("PD", 2), problem=QUARTER)[0] == [1, 1, 1, 1]
    assert "PD" in stability_events(HALF) and "PD" not in stability_events(QUARTER)
    for problem in (HALF, QUARTER):
        assert {"SN", "BP", "SB", "NS"} <= set(stability_events(problem))
