"""Names to families: what a name finds, what it lists, and what it refuses.

Oracles: closed form, published points, and the labels of the orbits that are found.
"""

import dataclasses
import math
import re

import numpy as np
import pytest

import saltus
from branches.naming.families import resolve
from branches.naming.matching import AmbiguousName, NameNotFound
from branches.naming.search import Limits, passes, search_bounds
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from tests.branches.traced import traced

SYSTEM = vibro_impact_nes()


def found(text, energy=(0.05, 1e4), pins=None, system=SYSTEM, limits=None):
    return resolve(text, system, reference_points=pins or {}, limits=limits or Limits(), energy=energy)


@pytest.mark.parametrize(("short", "whole"), [("S11-", "S11O00-"), ("S13+", "S13O00+")])
def test_short_names_are_the_backbones(short, whole):
    """Oracle: the published short names."""
    orbit, _ = found(short)
    assert str(orbit.label) == whole and orbit.problem.sequence == ()


@pytest.mark.parametrize("h", [0.12, 0.3, 5.0, 14.5])
def test_a_suffix_selects_the_orbit(h):
    """Oracle: the energy that was asked for, and the closed form's quarter period through it."""
    from benchmarks.backbone import Backbone

    orbit, _ = found(f"S13O00+@h={h}")
    assert math.isclose(orbit.h, h, rel_tol=1e-13) and abs(Backbone().energy(orbit.alpha) / h - 1) < 1e-12
    again, _ = found(f"S13O00+@alpha={orbit.alpha!r}")
    assert math.isclose(again.h, h, rel_tol=1e-11)


def test_both_legs_of_a_folded_family_are_selected():
    """Oracle: closed form: at h = 0.08 S11O00- has two orbits, on both sides of alpha = 1.1358."""
    first, _ = found("S11O00-@h=0.08,alpha=1.29")
    second, _ = found("S11O00-@h=0.08,alpha=0.913")
    assert first.alpha > 1.1358 > second.alpha and math.isclose(first.h, second.h, rel_tol=1e-13)


def test_several_families_are_listed_and_each_suffix_selects_its_own():
    """Oracle: published: two families carry S73O33-, near alpha = 1.646 and 4.866."""
    with pytest.raises(AmbiguousName) as caught:
        found("S73O33-")
    names = re.findall(r"S73O33-@\S+", str(caught.value))
    assert len(names) == 2 and "\n" not in str(caught.value)
    ids = {saltus.trace(name, SYSTEM).id for name in names}
    assert len(ids) == 2
    orbit, _ = found("S73O33-", pins={"S73O33-": {"h": 7.3348, "alpha": 1.6459}})
    assert abs(orbit.alpha - 1.646) < 1e-3
    orbit, _ = found("S73O33-", pins={"S73O33-": {"h": 0.18, "alpha": 4.8652}})
    assert abs(orbit.alpha - 4.8652) < 0.05


def test_a_pin_chooses_and_never_invents():
    """Oracle: a pin far from every family leaves the name ambiguous; a pin of a name with one family changes nothing."""
    with pytest.raises(AmbiguousName):
        found("S73O33-", pins={"S73O33-": {"h": 7.3348, "alpha": 9.0}})
    plain, _ = found("S13O00+")
    pinned, _ = found("S13O00+", pins={"S13O00+": {"h": 3.0, "alpha": 3.0}})
    assert plain.h == pinned.h and plain.alpha == pinned.alpha


def test_the_id_of_a_family_is_a_name():
    """Oracle: the id that tracing gives; no family has another hash."""
    family = traced("S13O00+").id
    assert saltus.trace(family, SYSTEM).id == family
    with pytest.raises(NameNotFound):
        found(family[:-1] + ("0" if family[-1] != "0" else "1"))


@pytest.mark.parametrize(
    ("text", "energy", "words"),
    [
        ("S13O00-", (0.1, 1.0), ["S13O00-", "0.1:1", "quarter period up to 10", "nearest that exist", "@h="]),
        ("S13O00+@h=0.01", (0.05, 1e4), ["at h = 0.01"]),
        ("S13O00+@h=0.3,alpha=3", (0.05, 1e4), ["at h = 0.3, alpha = 3; at h = 0.3 there are S13O00+@h=0.3,alpha="]),
        ("S13O00+@alpha=3", (0.05, 1e4), ["at alpha = 3; followed over alpha = 1.64016:1.83867"]),
        ("periodic:+-:00000000", (0.05, 1e4), ["0.05:10000", "no SB or GR where it begins", "one impact more", "expected a catalogue"]),
        ("L11+", (0.05, 1e4), ["linear mode", "0.1185078106"]),
        ("L11-", (0.05, 1e4), ["linear mode", "0.0864921894"]),
        ("U3401", (0.09, 0.15), ["nearest that exist", "U4401+@h=", "U3201-@h="]),
        ("stop+-stop+:-:00000000", (0.05, 1e4), ["0.05:10000", "with these ends", "stop+-stop+:-:48a04991"]),
    ],
)
def test_names_that_nothing_has(text, energy, words):
    """Oracle: the message, one line: what was searched, and the nearest that exists."""
    with pytest.raises(NameNotFound) as caught:
        found(text, energy)
    assert all(word in str(caught.value) for word in words), str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_mode_too_fast_for_the_scan_is_told_where_nothing_is_found():
    """Oracle: its angle over half of the longest period, by hand; a name that is found is answered as ever: the closed form's energy."""
    from benchmarks.backbone import Backbone

    fast = vibro_impact_nes(mu=1e-8)
    with pytest.raises(NameNotFound, match=r"fastest mode rotates by 6\.325e\+04 rad within half of the longest period"):
        found("S13O00+", (0.05, 20.0), system=fast)
    orbit, _ = found("S11O00-", (0.05, 20.0), system=fast)
    assert abs(Backbone.of(fast).energy(orbit.alpha) / orbit.h - 1) < 1e-10
    with pytest.raises(NameNotFound) as caught:
        found("S13O00-", (0.3, 1.0))
    assert "fastest mode" not in str(caught.value)


def test_the_nearest_names_exist():
    """Oracle: each name that the message suggests, with its suffix, is found."""
    with pytest.raises(NameNotFound) as caught:
        found("S13O00-", (0.3, 1.0))
    suggested = re.findall(r"[SU][^\s,]+@h=[^\s,]+,alpha=[0-9.e+-]+[0-9]", str(caught.value))
    assert suggested
    for name in suggested:
        orbit, _ = found(name, (0.05, 1e4))
        assert str(orbit.label) == name.split("@")[0]


@pytest.mark.parametrize("energy", [(0.001, 0.049), (0.001, 0.06), (0.0, math.inf)])
def test_a_range_beyond_the_limits_is_searched(energy):
    """Oracle: the closed form's energy; least of all 0.0005, so that the family lies below the limits, which begin at 0.05."""
    from benchmarks.backbone import Backbone

    soft = vibro_impact_nes(mu=0.1, sigma=0.001)
    orbit, _ = found("S17O00+", energy, system=soft)
    assert orbit.h < Limits().energy[0] and abs(Backbone.of(soft).energy(orbit.alpha) / orbit.h - 1) < 1e-10


def test_a_quarter_period_beyond_the_limits_is_searched():
    """Oracle: the closed form, by whose quarter period the orbit is asked for."""
    from benchmarks.backbone import Backbone

    orbit, _ = found("S13O00+@alpha=1.7", limits=Limits(quarter_period=1.5))
    assert abs(orbit.h / Backbone().energy(1.7) - 1) < 1e-11


def test_orbits_without_impacts_are_no_answer():
    """Oracle: S13 leaves the parity open; the linear modes, which have no impact, are not among the matches."""
    for text in ("S13", "S11"):
        try:
            orbit, _ = found(text, (0.05, 0.3))
        except AmbiguousName as error:
            assert "E00" not in str(error)
        else:
            assert orbit.problem.sequence or orbit.problem.ends[1].startswith("stop")


@pytest.mark.parametrize(
    ("system", "words"),
    [
        (ImpactSystem(np.eye(3), np.zeros((3, 3)), np.diag([2.0, 2.0, 1.0]), (Stop((1.0, -1, 0), -1, 1),)), "this system has 3: saltus"),
        (ImpactSystem(np.eye(2), np.zeros((2, 2)), [[2.0, -1], [-1, 2]], (Stop((1.0, -1), upper=1.0),)), "odd symmetry"),
        (vibro_impact_nes(rho=0.7), "conservative system: restitution 0.7"),
        (vibro_impact_nes(lam=0.1), "conservative system: damping"),
        (dataclasses.replace(SYSTEM, absorber=None, primary=None, model=None, parameters=None), "absorber and a primary"),
    ],
)
def test_systems_on_which_names_cannot_be_searched(system, words):
    """Oracle: the message says what the system has and what is expected instead."""
    with pytest.raises(ValueError, match=words):
        found("S11O00-", system=system)


def test_bounds_of_a_scene():
    """Oracle: the defaults, and what the scene says; impacts beyond the bound are not searched."""
    assert search_bounds(None) == Limits()
    limits = search_bounds({"energy": [0.1, 2.0], "impacts": 4})
    assert limits.energy == (0.1, 2.0) and limits.impacts == 4 and limits.quarter_period == 10.0
    with pytest.raises(NameNotFound, match="quarter period up to 1.5"):
        found("S13O00+", limits=Limits(quarter_period=1.5))


def test_passes_knows_an_orbit_from_either_end():
    """Oracle: the branch's own orbits; an orbit of another family is not on it."""
    branch, other = traced("U8353-"), traced("S13O00+")
    orbit, _ = found("U8353-@h=1.9458,alpha=4.9065")
    assert passes(branch, orbit) and not passes(other, orbit)
    turned, _ = found("U8335-@h=1.9458,alpha=4.9065")
    assert passes(branch, turned)
