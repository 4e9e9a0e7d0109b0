"""What the points of a branch say of its events.

Oracle: branches of the paper, which have all of their events, with some of these taken out; and columns that were changed.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from branches.between_events import missed_events
from bvp.stability import roundings
from tests.branches.paper_names import family

NAMES = ("S11-", "S13+", "U44-", "U11+", "U21-", "S31O11-", "S73O33-", "U4122-", "U5511+", "S95E22-")


@cache
def branch_of(name):
    branch = family(name)
    return replace(branch, points={key: values.copy() for key, values in branch.points.items()})


def without(branch, *ids):
    return replace(branch, events=tuple(event for event in branch.events if event.id not in ids))


@pytest.mark.parametrize("name", NAMES)
def test_a_branch_with_all_of_its_events_misses_none(name):
    """Oracle: none."""
    assert missed_events(branch_of(name)) == []


@pytest.mark.parametrize("name", NAMES)
def test_an_event_that_is_taken_out_is_missed(name):
    """Oracle: the event itself: its type and place; SN, SB, PD and RT in turn, and BP, where it alone changes stability or turns h."""
    branch = branch_of(name)
    taken = [event for event in branch.events if event.type in ("SN", "BP", "SB", "PD", "RT")]
    assert taken
    h, stable = branch.points["h"], branch.points["stable"]
    for event in taken:
        before, after = event.point - 1, event.point + 1
        turns = (h[before] - event.h) * (h[after] - event.h) > 0.0
        if event.type == "BP" and not turns and (stable[after] < 0 or stable[before] == stable[after]):
            continue
        found = missed_events(without(branch, event.id))
        assert any(event.type in missed.types and missed.points[0] < event.point < missed.points[1] for missed in found), event
        for missed in found:
            assert missed.points[0] <= event.point <= missed.points[1]
            assert not missed.hidden


@pytest.mark.parametrize("name", ["U4122-"])
def test_of_two_crossings_one_has_an_event(name):
    """Oracle: all points between two resonances of one p/q are taken out, with the events there but the first: the level is not crossed."""
    branch, tried = branch_of(name), 0
    resonant = [event for event in branch.events if event.type == "RT"]
    for first in resonant:
        second = next((event for event in resonant if event.point > first.point and event.p_q == first.p_q), None)
        tau = branch.points["tau"]
        if second is None or (tau[first.point - 1] > tau[first.point]) != (tau[second.point + 1] > tau[second.point]):
            continue
        if branch.problem.quarters == 1 and branch.points["tau_half"][[first.point, second.point]].prod() < 0.0:
            continue
        kept = np.array([i for i in range(len(branch)) if not first.point < i <= second.point])
        place = {int(i): k for k, i in enumerate(kept)}
        events = tuple(event._replace(point=place[event.point]) for event in branch.events if event.point in place)
        points = {key: values[kept] for key, values in branch.points.items()}
        found = missed_events(replace(branch, points=points, events=events))
        assert any("RT" in missed.types and "does not cross" in missed.text and first.id in missed.text for missed in found)
        tried += 1
    assert tried


def test_rounding_of_the_energy_is_no_turning_point():
    """Oracle: noise of the size that `roundings` bounds, at every point; one ten thousand times as large is seen."""
    rng = np.random.default_rng(3)
    branch = branch_of("S31O11-")
    noise = rng.uniform(-1.0, 1.0, len(branch)) * float(roundings(branch.problem.inner, 1.0))

    def noisy(size):
        return missed_events(replace(branch, points=branch.points | {"h": branch.points["h"] * (1.0 + size * noise)}))

    assert noisy(0.9) == []
    # The two points between which the energy changes most change places.
    quiet = int(np.argmax(np.abs(np.diff(branch.points["h"]))))
    h = branch.points["h"].copy()
    h[quiet], h[quiet + 1] = h[quiet + 1], h[quiet]
    found = missed_events(replace(branch, points=branch.points | {"h": h}))
    assert found and all("SN" in missed.types for missed in found)


def test_a_fold_at_which_the_energy_does_not_turn():
    """Oracle: an SN beside nothing: the energy turns twice there, or it is no fold."""
    branch = branch_of("S11-")
    fold = next(event for event in branch.events if event.type == "SN")
    free = next(i for i in range(5, len(branch)) if all(abs(event.point - i) > 2 for event in branch.events))
    stray = fold._replace(id="SN9", point=free)
    found = missed_events(replace(branch, events=(*branch.events, stray)))
    assert any("does not turn" in missed.text and missed.points == (free - 1, free + 1) for missed in found)


def test_stability_that_changes_without_an_event():
    """Oracle: the stability of one point turned round."""
    branch = branch_of("S13+")
    free = next(i for i in range(5, len(branch)) if all(abs(event.point - i) > 2 for event in branch.events))
    stable = branch.points["stable"].copy()
    stable[free] = 1 - stable[free]
    found = missed_events(replace(branch, points=branch.points | {"stable": stable}))
    assert [missed.points for missed in found if "SB" in missed.types or "SN" in missed.types] == [(free - 1, free), (free, free + 1)]
