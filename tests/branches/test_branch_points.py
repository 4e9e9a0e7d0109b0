"""Branch points where families with more symmetry, or of multiple covers, are crossed.

Oracles: the way there and back; the normal form of a p:q resonance.
"""

import numpy as np
import pytest

import saltus
from branches import switching
from branches.family import Family
from branches.presentation import symmetries
from branches.switching import _crossing, emanating_families, switch
from branches.tracing import follow_family
from bvp.closures import cycle_of
from continuation.switching import SwitchError, branch_directions, refine_branch_point
from tests.branches.traced import traced

SYSTEM = saltus.vibro_impact_nes()


def test_a_branch_point_that_is_known_to_the_square_root_of_rounding_is_refined():
    """Oracle: the way there: the last reversal breaks on a family, and from the family born there one comes back to it."""
    found = saltus.discover(SYSTEM, 12.1, quarter_period=5.1, impacts=9, ends=("rest-stop",))
    starts = [orbit for orbit in found.orbits if orbit.sequence == "+++--+"]
    old = [follow_family(start.problem, start.solution.y, energy=(11.9, 12.2)) for start in starts]
    old, breaking = next((branch, event) for branch in old for event in branch.events if event.breaks == "reversal")
    born = switch(old, breaking, energy=(11.9, 12.05))[0]
    through = follow_family(born.problem, born.unknowns(len(born) // 2), energy=(11.9, 12.05))
    crossing = next(event for event in through.events if event.type == "BP")
    before, here, after = (through.unknowns(crossing.point + place) for place in (-1, 0, 1))
    known = after - before
    beside = here + 0.1 * (after - here)
    with pytest.raises(SwitchError, match="null space"):
        branch_directions(Family(through.problem), beside, known)
    (family,) = _crossing(through.problem, beside, known, crossing)
    assert [other.problem.ends for other in emanating_families(through, crossing)] == [family.problem.ends]
    assert family.cover == 1 and set(family.problem.ends) == {"rest", "stop+"}
    back = follow_family(family.problem, family.step, energy=(11.9, 12.2))
    again = next(event for event in back.events if event.breaks == "reversal")
    assert again.h == pytest.approx(breaking.h, rel=2e-10)  # both are located to 1e-10 in arclength
    exact = refine_branch_point(Family(through.problem), through.unknowns(crossing.point))
    assert through.problem.energy(exact) == pytest.approx(breaking.h, rel=1e-9)


def test_a_family_of_5_fold_covers_breaks_no_reversal_at_its_crossing():
    """Oracle: the normal form: its half map's entry goes with the cube of the distance, whose change of sign rounding shifts."""
    old = saltus.trace("S11O00-", SYSTEM, energy=(0.0692, 0.1))
    event = min((e for e in old.events if e.p_q == [2, 5]), key=lambda e: abs(e.h - 0.0779734))
    crossed = 0
    for born in switch(old, event, energy=(0.07, 0.09)):
        both = follow_family(born.problem, born.unknowns(len(born) // 2), energy=(0.07, 0.09))
        for crossing in both.events:
            if crossing.type == "BP" and abs(crossing.h / event.h - 1.0) < 1e-6:
                crossed += 1
                b = both.points["tau"] - 2.0
                far = np.abs(both.points["arclength"] - crossing.arclength) > 0.02
                sides = both.points["arclength"] > crossing.arclength
                assert np.all(b[far & sides][:3] * b[far & ~sides][-3:] < 0.0)
                assert not [e.id for e in both.events if e.type == "SB" and abs(e.arclength - crossing.arclength) < 0.01]
    assert crossed


def fail(*arguments):
    """Stands in for a search of directions."""
    raise SwitchError("made to fail")


@pytest.mark.parametrize(
    ("name", "kind", "changes", "made", "words"),
    [
        ("S13O00+", "SB", {"point": 8}, {}, "SB1 is no bifurcation of the wider problem: its smallest singular value is 9.0e-03"),
        ("S73O33-", "BP", {"point": 8}, {}, "no second family at BP1: no branch point"),
        ("S73O33-", "BP", {}, {"branch_directions": fail}, "no second family at BP1: made to fail"),
        ("S73O33-", "BP", {}, {"first_orbits": lambda *arguments, **options: ()}, "no orbit of a new family was found next to BP1"),
        ("S11O00-", "RT", {}, {"branch_directions": fail}, "no family of 3-fold orbits at RT.*: made to fail"),
    ],
)
def test_switching_says_why_it_fails(monkeypatch, name, kind, changes, made, words):
    """Oracle: points beside the event, and steps that are made to fail."""
    branch = traced(name)
    event = next(e for e in branch.events if e.type == kind and (kind != "RT" or e.p_q[1] == 3))
    for function, other in made.items():
        monkeypatch.setattr(switching, function, other)
    with pytest.raises(RuntimeError, match=words):
        switch(branch, event._replace(point=event.point + changes.get("point", 0)))


def test_sides_that_are_not_found_are_reported(monkeypatch):
    """Oracle: the ends of the family; an RT without its fraction."""
    branch = traced("S13O00+")
    event = next(e for e in branch.events if e.type == "SB")
    with pytest.raises(ValueError, match="SB1: its p/q is not known"):
        emanating_families(branch, event._replace(type="RT"))
    monkeypatch.setattr(switching, "first_orbits", lambda *arguments, **options: ())
    with (
        pytest.raises(RuntimeError, match="no orbit of a new family was found next to SB1"),
        pytest.warns(RuntimeWarning, match="SB1: no orbit found of a family between the ends origin, origin"),
    ):
        emanating_families(branch, event)


def test_orbits_without_a_reversal_triple(monkeypatch):
    """Oracle: Arnold's normal form: at 1/3 orbits of three times the period cross on both sides, as far as the energy is; both sides are
    one family, and three starts of them are one orbit."""
    found = saltus.discover(SYSTEM, 9.7, quarter_period=1.7, impacts=3, ends=("rest-rest", "rest-stop", "stop-stop"))
    branches = [follow_family(o.problem, o.solution.y, energy=(9.0, 10.5), quarter_period=5.1) for o in found.orbits]
    old, breaking = next((b, e) for b in branches for e in b.events if e.breaks == "reversal" and abs(e.h - 9.51616) < 1e-3)
    born = switch(old, breaking, energy=(9.0, 10.5))[0]
    tripling = next(event for event in born.events if event.p_q == [1, 3])
    assert born.problem.periodic and tripling.h == pytest.approx(9.9644062, abs=1e-6)
    sides = emanating_families(born, tripling)
    energies = [family.step.extra["energy"] - tripling.h for family in sides]
    assert len(sides) == 2 and energies[0] * energies[1] < 0.0
    ids = set()
    for family in sides:
        orbit = family.step.extra
        assert orbit["residual"] < 1e-12 and family.cover == 0
        assert orbit["quarter_period"] == pytest.approx(3.0 * tripling.alpha, rel=1e-4)
        kept = symmetries(cycle_of(family.problem, family.step.y))
        assert kept.cover == 1 and not kept.reversals
        ids.add(follow_family(family.problem, family.step, energy=(9.0, 10.5), quarter_period=5.1).id)
    assert len(ids) == 1
    other = next(event for event in born.events if event.type == "RT" and event.p_q[1] != 3)
    with pytest.raises(ValueError, match="q is 3 at most"):
        emanating_families(born, other)
    monkeypatch.setattr(switching, "tripling_direction", fail)
    with pytest.raises(RuntimeError, match="no family of 3-fold orbits at RT.*: made to fail"):
        emanating_families(born, tripling)


def test_a_fold_beside_a_tripling_is_found():
    """Oracle: the parabola of the energy along the family, from points on both sides: near 1/3 the tripled orbits turn back just beside the
    crossing (Arnold's normal form)."""
    branch = saltus.trace("S31O11-", SYSTEM, energy=(0.15, 1.0))
    crossing = min((e for e in branch.events if e.type == "BP"), key=lambda e: abs(e.h - 0.172891195))
    fold = min((e for e in branch.events if e.type == "SN"), key=lambda e: abs(e.h - crossing.h))
    s, h = branch.points["arclength"], branch.points["h"]
    near = np.abs(s - crossing.arclength) < 0.05
    parabola = np.polynomial.Polynomial.fit(s[near] - crossing.arclength, h[near], 3).convert()
    least = min(parabola.deriv().roots(), key=lambda root: abs(root)).real
    assert 1e-4 < abs(fold.arclength - crossing.arclength) < 1e-3
    assert abs((fold.arclength - crossing.arclength) - least) < 5e-5
    assert 1e-7 < 1.0 - fold.h / crossing.h < 2e-7
