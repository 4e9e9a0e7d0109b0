"""Stability between events: one decided orbit decides an interval, in fifty digits where double precision decides none.

Oracles: `tests.branches.many_digits` (single shooting over the whole period), counts, and columns made by hand.
"""

from functools import cache

import numpy as np
import pytest

import saltus
from branches.between_events import Barrier, decide_between, stability_events
from branches.stability import describe
from branches.tracing import follow_family
from bvp.multipoint import MultipointProblem
from tests.branches.many_digits import ManyDigits
from tests.branches.paper_names import family

MIDDLE = {
    # The start state (u, v) and the flight times of an orbit that double precision does not decide, nor its neighbours up to the next events.
    "stop+-stop+:-+-+-+-+-": (
        [0.8471296340094546, -0.1528703659905455, -5.451540051620384, 0.5451540051620386],
        [0.3293610455294466, 0.3293256334976281, 0.3293928049044436, 0.3293001482195252, 0.3294089190259043, 0.3292944950921253]
        + [0.32940337167382355, 0.3293108861372876, 0.3293782286928813, 0.329342922437023],
        (1.69, 2.5),
    ),
    "stop+-stop-:+--+-+": (
        [3.878733826876753, 2.8787338268767515, -0.5144596455307066, 0.05144596455307067],
        [0.6430224139008901, 2.3664014864266925, 2.6357498394463232, 1.1197534693037505, 0.8982854481571384, 1.292231731944389]
        + [0.9321819736419646],
        (3.8, 5.2),
    ),
}


@cache
def branch_of(name):
    if name not in MIDDLE:
        return family(name)
    state, times, energy = MIDDLE[name]
    ends, word = name.split(":")
    problem = MultipointProblem(saltus.vibro_impact_nes(), tuple(end for end in ends.replace("-stop", " stop").split()), tuple(word))
    return follow_family(problem, problem.shoot(problem.modes.from_state @ np.array(state), times), energy=energy)


def in_double_precision(branch):
    """Stability of each point by itself."""
    return describe(branch.problem, [branch.orbit(i).solution for i in range(len(branch))]).columns["stable"]


@pytest.mark.parametrize("name", ["U8344-", "U(15)578-", "U4122-", "S73O33-", *MIDDLE])
def test_what_is_decided_between_events_is_so_in_fifty_digits(name):
    """Oracle: the sign of |tau| - 2 in fifty digits, at random points of the intervals that double precision leaves undecided."""
    branch = branch_of(name)
    new = np.flatnonzero((in_double_precision(branch) < 0) & (branch.points["stable"] >= 0))
    assert len(new) >= 4
    for i in np.random.default_rng(5).choice(new, min(len(new), 6), replace=False):
        assert (ManyDigits(branch.orbit(int(i))).margin < 0) == (branch.points["stable"][i] == 1)


@pytest.mark.parametrize("name", ["S11-", "U8344-", "U(15)578-", "U4122-", "S73O33-", "S31O11-", *MIDDLE])
def test_what_stays_undecided_is_at_an_event_or_grazes(name):
    """Oracle: the events of the branch."""
    branch = branch_of(name)
    at = {event.point for event in branch.events if event.type in ("SN", "BP", "SB", "PD")}
    open_ = np.flatnonzero(branch.points["stable"] < 0)
    assert all(i in at or np.isnan(branch.points["tau"][i]) for i in open_)


def test_fifty_digits_are_asked_for_only_where_no_orbit_of_an_interval_is_decided():
    """Oracle: counts; on both sides of its branch point the first family has no orbit that double precision decides."""
    counts = [branch_of(name).digit_work.orbits for name in ("S11-", "U8344-", "U(15)578-", *MIDDLE)]
    assert counts[:3] == [0, 0, 0] and counts[3] == 2 and counts[4] >= 1
    works = [branch_of(name).digit_work for name in MIDDLE]
    total = works[0] + works[1]
    assert total.orbits == counts[3] + counts[4] and total.seconds == works[0].seconds + works[1].seconds > 0.0


# -- columns made by hand -----------------------------------------------------------------------------------------------------

HALF = MultipointProblem(saltus.vibro_impact_nes(), ("rest", "rest"), ("+",))
QUARTER = MultipointProblem(saltus.vibro_impact_nes(), ("origin", "stop+"), ())


def decided(stable, *barriers, problem=HALF, grazing=(), closed=False):
    """Stability of points at arclengths 0, 1, 2, ...; no orbit may be asked for."""
    multipliers = np.ones((len(stable), 2), complex)
    multipliers[list(grazing)] = np.nan
    columns = {"stable": np.array(stable, np.int8), "arclength": np.arange(float(len(stable))), "multipliers": multipliers}
    found, work = decide_between(problem, lambda i: pytest.fail(f"orbit {i}"), columns, barriers, closed)
    assert work.orbits == 0
    return found.tolist()


def at(type, point, width=0.0):
    return Barrier(type, point, (point - width, point + width))


def test_a_decided_orbit_decides_as_far_as_the_next_events():
    """Oracle: by hand: at an event stability is not decided, on either side it may differ."""
    assert decided([-1, 1, -1, -1, -1, 0, -1], at("PD", 3)) == [1, 1, 1, -1, 0, 0, 0]
    assert decided([-1, 1, -1, 1], at("RT", 2), at("GR", 0), at("LB", 1), at("IO", 3)) == [1, 1, 1, 1]
    assert decided([1, 0, 1]) == [1, 0, 1]


def test_points_inside_a_bracket_and_at_a_grazing_stay_undecided():
    """Oracle: by hand."""
    assert decided([0, -1, -1, -1, -1, 1], at("SB", 2, 1.5)) == [0, -1, -1, -1, 1, 1]
    assert decided([-1, 1, -1, -1], grazing=(0, 3)) == [-1, 1, 1, -1]


def test_orbits_that_contradict_each_other_decide_nothing():
    """Oracle: by hand: an event between them is missed."""
    assert decided([-1, 1, -1, 0, -1, -1, 1, -1], at("SN", 5)) == [-1, 1, -1, 0, -1, -1, 1, 1]


def test_over_the_seam_of_a_closed_family():
    """Oracle: by hand: the last point leads on to the first one."""
    assert decided([-1, -1, -1, 0, -1, 1], at("SN", 2), at("SN", 4), closed=True) == [1, 1, -1, 0, -1, 1]


def test_which_events_change_stability():
    """Oracle: the period of an orbit between reversals a quarter period apart doubles at tau_half = 0; it is stable for -2 < tau_half < 2."""
    assert decided([1, -1, -1, -1], at("PD", 2), problem=QUARTER) == [1, 1, 1, 1]
    assert "PD" in stability_events(HALF) and "PD" not in stability_events(QUARTER)
    for problem in (HALF, QUARTER):
        assert {"SN", "BP", "SB", "NS"} <= set(stability_events(problem))


def test_an_unstable_side_is_not_carried_over_a_missed_event():
    """Oracle: the same branch with its symmetry breaking taken out: the two sides contradict each other, and nothing is decided."""
    branch = branch_of("U4122-")
    raw = in_double_precision(branch)
    events = [Barrier(event.type, event.point, event.bracket) for event in branch.events]
    places = [i for i, event in enumerate(events) if event.type in stability_events(branch.problem)]
    full, _ = decide_between(branch.problem, branch.unknowns, branch.points | {"stable": raw}, events)
    for place in places:
        point = events[place].point
        if full[point - 1] == full[point + 1]:
            continue
        found, _ = decide_between(branch.problem, branch.unknowns, branch.points | {"stable": raw}, events[:place] + events[place + 1 :])
        assert np.array_equal(found[raw >= 0], raw[raw >= 0])
        low, high = (events[k].point if 0 <= k < len(events) else edge for k, edge in ((places[0] - 1, 0), (len(events), len(branch))))
        inside = np.arange(low, high)
        assert np.all((found[inside] == full[inside]) | (found[inside] < 0))
        break
    else:
        pytest.fail("no event of the branch changes its stability")
