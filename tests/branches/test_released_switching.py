"""Families that begin at events of families of free orbits in a parameter: both pass the event at one value of the parameter."""

from __future__ import annotations

import numpy as np
import pytest

from branches.building.responses import link_at
from branches.forced.tracing import follow_response
from branches.released.switching import switch_released
from tests.branches.test_released import in_phase


@pytest.fixture(scope="module")
def at_energy():
    """S13O00+ in mu at the energy that it has at alpha = 1.7."""
    problem, y, _ = in_phase(("mu",), ["energy = {h!r}"])
    return follow_response(problem, y, (0.03, 0.3))


def followed(branch, event, points=80):
    return [follow_response(problem, step, branch.interval, points=points) for problem, step in switch_released(branch, event)]


@pytest.fixture(scope="module")
def at_quarter_period():
    """S13O00+ in mu at alpha = 1.7, where it grazes, and the families that meet it there."""
    problem, y, _ = in_phase(("mu",), ["quarter_period = {alpha!r}"])
    branch = follow_response(problem, y, (0.09, 0.25))
    (event,) = events_of(branch, "GR")
    return branch, event, followed(branch, event, points=12)


def passes(branch, kind, value):
    """Whether a branch has an event of a type at a value of its parameter."""
    return any(event.type == kind and abs(event.values["mu"] / value - 1.0) < 1e-8 for event in branch.events)


def events_of(branch, kind):
    return [event for event in branch.events if event.type == kind]


@pytest.mark.parametrize("number", [1])
def test_symmetry_breaking(at_energy, number):
    """Oracle: see `require_symmetry_breaking`."""
    require_symmetry_breaking(at_energy, number)


def require_symmetry_breaking(at_energy, number):
    """The family that breaks the symmetry crosses the symmetric one (BP) where that has SB, at the same energy. Both sides are images."""
    event = events_of(at_energy, "SB")[number]
    (other,) = followed(at_energy, event)
    assert other.problem.ends != at_energy.problem.ends
    assert passes(other, "BP", event.values["mu"])
    assert other.columns["h"] == pytest.approx([at_energy.columns["h"][0]] * len(other), rel=1e-12)
    (crossing,) = events_of(other, "BP")
    assert crossing.values["quarter_period"] == pytest.approx(event.values["quarter_period"], rel=1e-7)
    first, last = other.columns["alpha"][crossing.point + np.array([-3, 3])]
    assert abs(first - last) < 0.1 * abs(first - event.values["quarter_period"]) + 1e-3


def test_events_where_nothing_begins(at_energy):
    end = events_of(at_energy, "EP")[0]
    with pytest.raises(ValueError, match="no other family begins at EP1; expected an event of type"):
        switch_released(at_energy, end)
    with pytest.raises(RuntimeError, match=r"all impacts vanish at GR1: the linear mode L11\+ remains"):
        switch_released(at_energy, events_of(at_energy, "GR")[0])


def test_an_edge_at_a_grazing_is_a_fold_on_one_side(at_quarter_period):
    """Oracle: the ranges of the families. Those below the grazing in mu, as the backbone is, meet it in a nonsmooth fold."""
    branch, event, found = at_quarter_period
    branch = branch.known_as("origin-stop+::00000000")
    kinds = set()
    for onward in found:
        middle = 0.5 * (onward.parameter.min() + onward.parameter.max()) - event.values["mu"]
        if abs(middle) > 1e-6:  # along others mu does not change
            link = link_at(branch, event, onward.sequence, onward)
            assert link.kind == ("fold" if middle < 0.0 else "passage")
            kinds.add(link.kind)
    assert kinds == {"fold", "passage"}
