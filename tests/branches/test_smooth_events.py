"""Events of smooth families. Oracle: the same orbits in many digits, where determinants of their flights vanish at the event."""

from __future__ import annotations

import numpy as np
import pytest

from branches.naming.at_modes import orbit_at_mode
from branches.switching import switch
from branches.tracing import follow_family
from bvp.springs import Spring
from bvp.system import ImpactSystem
from saltus.families import trace
from saltus.scene import load_scene
from tests.branches.smooth_digits import SpringDigits, energy_of_event, fixed
from tests.branches.test_smooth_agreement import family, second

FAMILIES = [
    ("cubic_nes", {}, "mode:2", (1e-3, 2.0), ("SN", "PD", "RT")),
    ("smooth_wall", {"n": 3}, "mode:1", (0.02, 4.0), ("PD", "SB", "RT")),
    ("smooth_wall", {"n": 10}, "mode:1", (0.02, 60.0), ("SN", "BP", "PD", "SB", "RT")),
    ("smooth_wall", {"n": 20}, "mode:1", (0.02, 4.0), ("PD", "SB", "RT")),
    ("smooth_wall", {"n": 100}, "mode:1", (0.02, 15.0), ("SN", "BP", "PD", "SB", "RT")),
    ("smooth_wall", {"n": 100}, "mode:2", (0.02, 0.5), ("SN", "PD", "RT")),
    ("duffing_pair", {}, "mode:1", (1e-3, 1e4), ("SN", "BP", "PD", "SB", "RT")),
    ("duffing_pair", {}, "mode:2", (1e-3, 100.0), ("PD", "RT")),
    ("beam_on_cubic_spring", {}, "mode:1", (0.01, 0.02), ("BP", "PD", "SB")),
    ("beam_on_cubic_spring", {}, "mode:3", (100.0, 150.0), ("NS",)),
]


@pytest.mark.parametrize(
    ("scene", "values", "mode", "energy", "types"), [FAMILIES[0], ("duffing_pair", {}, "mode:1", (1e-3, 1e4), ("BP", "SB"))]
)
def test_events_agree_with_many_digits(scene, values, mode, energy, types):
    """Oracle: see `require_events`. One event of each kind; more are in tests/full."""
    require_events(family(scene, mode, *energy, **values), types, 1)


def require_events(branch, types, each):
    """Oracle: the zeros of determinants in many digits, of at most so many events of each kind. Where an event is found its arclength has
    an error of its bracket; the logarithm of the energy, which is a part of the arclength, has at most the same."""
    spring = SpringDigits(branch.system, branch.ends[1])
    kinds = {(event.type, event.note) for event in branch.events if event.type in types}
    assert {code for code, _ in kinds} == set(types)
    for kind in sorted(kinds):
        for event in [event for event in branch.events if (event.type, event.note) == kind][:each]:
            h, away = energy_of_event(spring, branch, event)
            assert abs(h / event.h - 1.0) < 1e-10 + event.bracket[1] - event.bracket[0], (event.id, event.h, h)
            # The cubic through four orbits is a series about the event, with room for less than 1e-3.
            assert abs(away) < 1e-6, (event.id, away)


@pytest.mark.parametrize(("scene", "values", "name", "energy", "fold_at"), [
    ("cubic_nes", {}, "S31@h=0.103709,alpha=1.61088", (0.05, 0.4), 0.08034042957793),
    ("smooth_wall", {"n": 3}, "S31+", (0.2, 0.4), 0.2498223360511),
    ("smooth_wall", {"n": 10}, "S31+", (0.15, 0.4), 0.2156260486491),
    ("smooth_wall", {"n": 20}, "S31+", (0.15, 0.4), 0.1997943981687),
])  # fmt: skip
def test_a_fold_beside_a_branch_point_is_an_event_of_its_own(scene, values, name, energy, fold_at):
    """Oracle: many digits, and folds of an independent computation. Fold and branch point are 4e-9 to 9e-8 apart, relative. Stability
    changes at the fold alone: the family is that of threefold orbits near a 1:3 resonance, at which tau touches 2."""
    branch = trace(name, scene=load_scene(scene, **values), energy=energy)
    found = {event.type: event for event in branch.events if event.type in ("SN", "BP")}
    assert len(found) == 2 == sum(event.type in found for event in branch.events)
    spring = SpringDigits(branch.system, branch.ends[1])
    for event in found.values():
        h, _ = energy_of_event(spring, branch, event)
        assert abs(h / event.h - 1.0) < 1e-11, (event.id, event.h, h)
        assert event.bracket[1] - event.bracket[0] < 1e-8
    assert 1e-9 < found["BP"].h / found["SN"].h - 1.0 < 1e-7 and found["SN"].h == pytest.approx(fold_at, rel=1e-11)
    stable, (fold, point) = branch.points["stable"], (found[code].point for code in ("SN", "BP"))
    inner, outer = (1, -1) if point > fold else (-1, 1)
    assert abs(point - fold) == 2
    assert [stable[point + inner], stable[fold + inner], stable[fold + outer]] == [0, 0, 1]


def test_events_do_not_depend_on_steps_that_go_over_beside_a_branch_point():
    """Oracle: equality of paths; many digits for the branch point. From some starts a step beside it converged to the other family, whose
    determinant has the other sign: the branch point was taken for a place where the determinant touches zero."""
    starts = ("S11+@h=0.01", "S11+@h=0.000877276,alpha=1.94208", "S11+@h=0.1,alpha=1.639346")
    branches = [trace(name, scene="cubic_nes", energy=(8e-4, 0.2)) for name in starts]
    # The second start is on a piece of the family that the range of energies cuts off, so all are followed through all of it.
    wide = [follow_family(branch.problem, branch.unknowns(branch.start), energy=(1e-5, 2.0)) for branch in branches]
    first, second, third = ([(event.type, event.p_q) for event in branch.events] for branch in wide)
    assert first == second == third and ("BP", None) in first
    for one, *others in zip(*(branch.events for branch in wide), strict=True):
        # Rounding of a velocity decides where a label changes.
        assert one.type == "LB" or [other.h for other in others] == pytest.approx([one.h] * 2, rel=1e-8)
    point = next(event for event in wide[1].events if event.type == "BP" and event.h < 0.01)
    assert abs(energy_of_event(SpringDigits(wide[1].system), wide[1], point)[0] / point.h - 1.0) < 1e-10


def not_on_their_way_back(orbit):
    """How far the states of an orbit with their velocities turned round are from it at most, in parts of its size."""
    states = np.hstack(orbit.sample(np.linspace(0.0, orbit.period, 4000, endpoint=False)))
    states /= np.abs(states).max(axis=0)
    back = states[::50] * [1.0, 1.0, -1.0, -1.0]
    return np.linalg.norm(back[:, None] - states[None], axis=2).min(axis=1).max()


def test_a_family_without_a_reversal_begins_where_its_own_problem_is_regular():
    """Oracles: many digits. What displaces the start does not displace the far end: this block of the derivative is b times a matrix of
    rank one, and vanishes. The problem between origin and rest is regular there, and so are the other determinants. DOP853 closes the new
    orbits over half a period with u -> -u. None of them comes back with its velocity turned round, as all orbits of the old family do."""
    branch = family("smooth_wall", "mode:1", 0.02, 60.0, n=10)
    event = [event for event in branch.events if event.breaks == "reversal"][1]
    assert (event.type, event.note) == ("SB", "the last reversal is broken") and branch.ends == ("origin", "rest")
    orbit, spring = branch.orbit(event.point), SpringDigits(branch.system)
    assert abs(energy_of_event(spring, branch, event)[0] / event.h - 1.0) < 1e-10
    quarter = spring.quarter(fixed(np.append(orbit.velocities, orbit.alpha)))
    flow, jacobian = (np.array(matrix.tolist(), dtype=float) for matrix in (quarter.flow, quarter.jacobian))
    # The event is located to 1e-10, and b changes with a slope of about 1.
    assert np.abs(flow[:2, :2]).max() < 1e-9 < 1.0 < np.abs(flow[:2, 2:]).max()
    assert np.linalg.svd(jacobian, compute_uv=False).min() > 0.1
    assert min(abs(quarter.value(kind, 2)) for kind in ("SN", "BP", "start", "far end")) > 1.0
    born = switch(branch, event, points=30)
    assert len(born) == 2 and not_on_their_way_back(orbit) < 2e-3
    for one in born:
        assert one.ends == ("periodic", "periodic") and one.sequence == ""
        assert abs(one.points["h"][0] / event.h - 1.0) < 0.01 and abs(one.points["alpha"][0] / event.alpha - 1.0) < 1e-4
        new = one.orbit(20)
        start = np.hstack(new.sample(np.zeros(1)))[0]
        end, columns = second(branch.system).flown(start, 0.5 * new.period)
        assert np.abs(end + start).max() < 1e-12 * np.abs(columns).max() * np.abs(start).max()
        assert not_on_their_way_back(new) > 0.02


def test_orbits_without_labels_change_their_half_waves():
    """Oracle: the spring is not odd, so no orbit has a label; the column of half-waves."""
    spring = Spring((1.0, -1.0), polynomial=(0.7, 0.5, 0.9))
    system = ImpactSystem([[1.0, 0.0], [0.0, 0.4]], np.zeros((2, 2)), np.diag([1.0, 0.0]), (), absorber=1, primary=0, springs=(spring,))
    orbit = orbit_at_mode("mode:1", system, (3.0, 9.0))
    branch = follow_family(orbit.problem, orbit.solution.y, energy=(3.0, 9.0))
    waves = branch.points["half_waves"]
    changes = [event for event in branch.events if event.type == "LB"]
    assert set(branch.points["label"]) == {""} and len(changes) == np.sum(np.diff(waves) != 0) > 0
    assert all(event.note == f"{waves[event.point]} half-waves become {waves[event.point + 1]}" for event in changes)
