"""Families that a range of energies cuts, reference points with one number, and options that cannot be; each with what must come of it."""

from __future__ import annotations

import numpy as np
import pytest

from branches.naming.families import trace_named
from bvp.system import vibro_impact_nes

SYSTEM = vibro_impact_nes()
FOLD = 0.0691164499682690
GRAZING = 0.118507810593582


def test_a_range_that_holds_only_a_fold_has_the_family():
    """Closed form: S11O00- lives above its fold, so 0.06:0.0692 holds it with its SN."""
    branch = trace_named("S11O00-", SYSTEM, energy=(0.06, 0.0692))
    assert [event.type for event in branch.events if event.type in ("SN", "EP")] == ["EP", "SN", "EP"]
    assert abs(branch.points["h"].min() - FOLD) < 1e-14


def test_a_range_that_barely_reaches_the_grazing_has_the_family():
    """Closed form: S13O00+ begins at its grazing, inside 0.11:0.119; it is located to the width of its bracket."""
    branch = trace_named("S13O00+", SYSTEM, energy=(0.11, 0.119))
    rise = abs((branch.points["h"][1] - branch.points["h"][0]) / (branch.points["arclength"][1] - branch.points["arclength"][0]))
    low, high = branch.events[0].bracket
    assert branch.events[0].type == "GR" and high - low < 2e-10
    assert abs(branch.events[0].h - GRAZING) < 2.0 * rise * (high - low)


def test_two_sides_of_a_fold_below_the_range_are_one_family():
    """Both sides of the fold of S11O00- cross h = 0.08; they are one family, so the name is not ambiguous."""
    assert trace_named("S11O00-", SYSTEM, energy=(0.0692, 0.0863)).label == "S11O00-"


@pytest.mark.parametrize("point", [{"h": 7.3348}, {"alpha": 1.6459}])
def test_a_reference_point_with_one_number_chooses_or_leaves_the_name_ambiguous(point):
    """Two families are named S73O33-; whatever one number decides, it is said in words."""
    try:
        branch = trace_named("S73O33-", SYSTEM, energy=(0.05, 200.0), reference_points={"S73O33-": point})
    except ValueError as error:
        assert "families; choose one of S73O33-@h=" in str(error)
    else:
        reached = branch.orbits_at(energy=point["h"]) if "h" in point else branch.orbits_at(alpha=point["alpha"])
        assert reached


def test_stability_is_not_given_at_a_located_bifurcation():
    """At SB and SN a multiplier is 1 within the location error, whichever side the located point is on."""
    for name, kind in (("S13O00+", "SB"), ("S11O00-", "SN")):
        for energy in ((0.05, 30.0), (0.06, 25.0)):
            branch = trace_named(name, SYSTEM, energy=energy)
            event = next(event for event in branch.events if event.type == kind)
            assert event.stable is None and branch.points["stable"][event.point] == -1
            around = branch.points["stable"][[event.point - 1, event.point + 1]]
            assert sorted(around) == [0, 1]


def test_the_published_fold_energy_itself_has_its_orbit():
    """An energy that is the fold's to all digits printed is answered with the orbit there."""
    branch = trace_named("S11O00-", SYSTEM, energy=(0.06, 1.0))
    assert any(abs(orbit.alpha - 1.13584395619551) < 1e-5 for orbit in branch.orbits_at(energy=FOLD))


def test_every_orbit_of_a_branch_can_be_had_also_at_its_branch_points():
    """Each point, asked for again, has the energy that was saved."""
    branch = trace_named("S73O33-", SYSTEM, energy=(0.5, 8.0), reference_points={"S73O33-": {"h": 7.3348, "alpha": 1.6459}})
    assert len(branch.events) > 3
    for event in branch.events:
        assert np.isclose(branch.orbit(event.point).h, event.h, rtol=1e-9)


def test_an_orbit_is_found_from_either_end():
    """U3201- and U3210- are one orbit started at its two ends; p and q follow the name."""
    one, other = (trace_named(name, SYSTEM, energy=(0.1, 0.2)) for name in ("U3201-", "U3210-"))
    a, b = (branch.orbit_at(energy=0.13) for branch in (one, other))
    assert (a.label, b.label) == ("U3201-", "U3210-") and abs(a.alpha - b.alpha) < 1e-12
