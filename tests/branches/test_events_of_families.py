"""The events of a family are the same from every start and with every step length."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.optimize import brentq

from branches.between_events import missed_events
from branches.naming.families import trace_named
from branches.switching import emanating_families
from branches.tracing import SETTINGS, follow_family
from bvp.many_digits import orbit_in_digits
from bvp.system import vibro_impact_nes
from tests.branches.building.pieces import differences
from tests.branches.test_smooth_agreement import family as smooth_family

SYSTEM = vibro_impact_nes(mu=0.1, sigma=0.1)
RESONANCES = [2.591576, 2.592445, 2.594166, 2.595702, 2.600394, 2.601768, 2.603223, 2.603926]
"""Energies of the eight resonances that lie within one step, where tau_half runs from +2 to -2."""


@pytest.fixture(scope="module")
def family():
    return trace_named("origin-stop+:-++:b8ea1bf0@h=2.54", SYSTEM, energy=(2.0, 3.8))


def test_eight_resonances_within_one_step_are_found(family):
    """Oracle: the zeros of tau_half -+ 2 cos(pi p/q), by an independent program."""
    found = sorted(event.h for event in family.events if event.type == "RT" and 2.585 < event.h < 2.61)
    assert found == pytest.approx(RESONANCES, abs=6e-7)


@pytest.mark.parametrize("place", [0, 1])
def test_a_suffix_chooses_between_two_orbits_of_one_energy(family, place):
    """Oracle: the two orbits themselves; their quarter periods differ by 0.02 per cent."""
    low, high = sorted(orbit.alpha for orbit in family.orbits_at(energy=2.55))
    wanted = (low, high)[place]
    start = trace_named(f"origin-stop+:-++:b8ea1bf0@h=2.55,alpha={wanted}", SYSTEM, energy=(2.5499, 2.5501))
    assert start.points["alpha"][start.start] == pytest.approx(wanted, rel=1e-9) and high / low > 1.0001


@pytest.mark.parametrize(
    ("part", "longest"), [(0.05, 0.1), (0.2, 0.025), (0.35, 0.01), (0.5, 0.1), (0.65, 0.025), (0.8, 0.1), (0.95, 0.01)]
)
def test_events_do_not_depend_on_the_start_or_the_steps(family, part, longest):
    """Oracle: the events from another start, to 1e-9."""
    events = {event.point for event in family.events}
    start = min((i for i in range(len(family)) if i not in events), key=lambda i: abs(i - part * len(family)))
    settings = replace(SETTINGS, maximum_step=longest, initial_step=0.3 * longest, target_turn=2.0 * longest)
    run = follow_family(family.problem, family.unknowns(start), energy=(2.0, 3.8), settings=settings)
    assert differences(family, start, run) == ([], [])


def forces_at_rest(branch, event, h):
    """Those of the springs (n,) on the orbit at an energy that is next to an event."""
    orbit = min(branch.orbits_at(energy=h), key=lambda orbit: abs(orbit.alpha - event.alpha))
    u = orbit.sample(np.array([orbit.alpha]))[0][0]
    forces = branch.system.stiffness @ u
    for spring in branch.system.describe().get("springs", []):
        c = np.array(spring["c"])
        forces += c * spring["stiffness"] * (c @ u) ** spring["power"]
    return forces


@pytest.mark.parametrize("smooth", [False, True])
def test_a_label_changes_where_a_coordinate_at_rest_has_no_force(smooth):
    """Oracle: the zeros of the forces, by Brent's method. A half-wave that begins at rest is lower than rounding for long: its height grows
    with the power 3/2 of the distance from there."""
    family = smooth_family("smooth_wall", "mode:1", 0.3, 0.8, n=20) if smooth else trace_named("S11E11+@h=30", SYSTEM, energy=(2.0, 40.0))
    events = [event for event in family.events if event.type == "LB"]
    assert len(events) == (1 if smooth else 2)
    for event in events:
        k = int(np.argmin(np.abs(forces_at_rest(family, event, event.h))))
        around = event.h * (1.0 - 1e-4), event.h * (1.0 + 1e-4)
        zero = brentq(lambda h, k=k, event=event: forces_at_rest(family, event, h)[k], *around, rtol=1e-14)
        assert abs(event.h / zero - 1.0) < 1e-10


def test_a_family_whose_trace_is_2_or_more_has_no_doubling_and_no_resonance():
    """Oracle: its trace in fifty digits: more than 2 beside its branch point, and growing without bound towards both its grazings.
    From the last place a run steps onto the grazing, where the trace in double precision is noise of any sign. At the branch point itself
    the equations are singular to rounding, which decides there how many digits Newton's method reaches."""
    parent = trace_named("origin-origin:+-:d8f0965d", SYSTEM, energy=(0.078, 0.082))
    (born,) = (one for one in emanating_families(parent, parent.event("SB1")) if one.problem.periodic)
    branch = follow_family(born.problem, born.step.y)
    (crossing,) = [event.point for event in branch.events if event.type == "BP"]
    orbits = [orbit_in_digits(branch.problem, branch.unknowns(i)) for i in range(1, len(branch) - 1) if i != crossing]
    traces = [float(orbit.trace) for orbit in orbits]
    assert branch.points["tau"][crossing] == pytest.approx(2.0, abs=1e-9)
    assert 2.0 < min(traces) < 2.1 and min(traces[0], traces[-1]) > 30.0
    for found in (branch, *(follow_family(branch.problem, branch.unknowns(place)) for place in (2, 8, 20, 26, 27))):
        assert [event.type for event in found.events] == ["GR", "BP", "GR"]
        assert (found.points["stable"][1:-1] != 1).all()


BORN = [
    ("origin-rest:+----:98efd23d", 2.8332488493508),  # unknowns change 2000 times as fast as the metric coordinates
    ("origin-origin:+++---+++:e0d57d1d", 97.545081181853),  # the smallest pivot is another one until the branch point is very near
    ("stop+-stop-:+--+-+:9ee1b097", 4.000100907963),
    ("rest-rest:+--+++-:f8535360", 11.389625320605),  # steps inside a step go over to the parent
    ("stop+-stop-:++++--++:f7d69f88", 4.488862331302),
]
# Rounding leaves 1e-8 of the unknowns open beside this branch point. It decides whether a run goes on to the other side or stops there.
OPEN = ("origin-origin:++++---+++:f15c85e2", 85.116314855647)


@cache
def born_at(parent, energy):
    """Follow the family that is born at the symmetry-breaking point of a parent: the branch, and its branch point at that energy."""
    around = (0.999 * energy, 1.001 * energy)
    # A family can pass an energy several times: the piece of its whole range, or that of the orbit of a name, has the point.
    pieces = (trace_named(name, SYSTEM, energy=(0.5 * energy, 1.5 * energy)) for name in (parent, f"{parent}@h={energy}"))

    def near(event):
        return abs(event.h / energy - 1.0) < 1e-9

    parents, breaking = next((piece, event) for piece in pieces for event in piece.events if event.type == "SB" and near(event))
    (family,) = emanating_families(parents, breaking)
    born = follow_family(family.problem, family.step.y, energy=around)
    (crossing,) = [event for event in born.events if event.type == "BP"]
    assert crossing.h == pytest.approx(breaking.h, rel=1e-9)
    return born, crossing


@pytest.mark.parametrize(("parent", "energy"), [BORN[0], *BORN[2:4]])
def test_a_family_passes_the_branch_point_that_it_is_born_at(parent, energy):
    """Oracle: see `require_a_family_passes_the_branch_point_that_it_is_born_at`."""
    require_a_family_passes_the_branch_point_that_it_is_born_at(parent, energy)


def require_a_family_passes_the_branch_point_that_it_is_born_at(parent, energy):
    """Oracle: the family's image under the parent's symmetry is the family itself: it has one such point, at the parent's energy."""
    born, _ = born_at(parent, energy)
    assert missed_events(born) == []


@pytest.mark.parametrize(("parent", "energy"), BORN)
def test_a_family_has_every_event_on_both_sides_of_the_branch_point_that_it_is_born_at(parent, energy):
    """Oracle: the same image, seen from the branch point: every event twice, at one energy."""
    born, crossing = born_at(parent, energy)
    others = [event for event in born.events if event.type not in ("BP", "LB", "IO")]
    before, after = ([event for event in others if (event.arclength < crossing.arclength) is side] for side in (True, False))
    assert [event.type for event in before] == [event.type for event in reversed(after)]
    assert [event.h for event in before] == pytest.approx([event.h for event in reversed(after)], rel=1e-8)
