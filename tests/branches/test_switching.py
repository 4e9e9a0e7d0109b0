"""New families where a symmetry breaks, the period doubles, or two families cross.

Oracles: the closed form where the new family is a backbone run several times; the period at a doubling; continuity at the
event; the exchange of stability at a branch point; the event-driven run.
"""

import math

import numpy as np
import pytest

import saltus
from tests.branches.closed_form import Backbone
from tests.branches.traced import EPS, monodromy, traced

REST = "S11E11+@h=3.0"
STEEP = "S35O22+@h=1.0,alpha=4.91349"

CASES = [
    ("S13O00+", "SB1", ("origin", "origin"), 1),
    ("S11O00-", "PD1", ("origin", "origin"), 2),
    ("S73O33-", "SB1", ("origin", "origin"), 1),
    ("S73O33-", "PD1", ("origin", "origin"), 2),
    (REST, "SB1", ("periodic", "periodic"), 1),
    (REST, "PD1", ("rest", "rest"), 2),
    (REST, "SB2", ("origin", "origin"), 1),
    (STEEP, "SB1", ("periodic", "periodic"), 1),
    (STEEP, "SB2", ("origin", "origin"), 1),
]


def switched(name, event, **options):
    options.setdefault("points", 12)
    branch = traced(name)
    at = next(item for item in branch.events if item.id == event)
    return branch, at, branch.switch(event, **options)


def samples(orbit, count=400):
    u, v = orbit.sample(np.linspace(0.0, orbit.period, count, endpoint=False))
    return np.hstack([u, v])


def distance(orbit, other):
    """Largest distance of a sample of one orbit from the other orbit, over the size of the state; the start does not matter."""
    mine, theirs = samples(orbit, 60), samples(other, 4000)
    scale = np.max(np.abs(theirs), axis=0)
    gaps = np.min(np.linalg.norm((mine[:, None, :] - theirs[None, :, :]) / scale, axis=2), axis=1)
    return float(np.max(gaps))


@pytest.mark.parametrize(("name", "event", "ends", "times"), CASES, ids=[f"{case[0][:7]}-{case[1]}" for case in CASES])
def test_new_families(name, event, ends, times):
    """Oracle: continuity at the event, the period there (twice the old one at PD), the event-driven run, and both sides."""
    branch, at, born = switched(name, event)
    assert len(born) >= 2 and ends in {family.ends for family in born}
    old = branch.orbit(at.point)
    for family in born:
        assert math.isclose(family.points["alpha"][0] / at.alpha, times, rel_tol=1e-3)
        assert family.id != branch.id and (family.ends, family.word) != (branch.ends, branch.word)
        orbit = family.orbit(0)
        u, v = orbit.sample(np.array([0.0371 * orbit.period]))
        start = np.concatenate([u[0], v[0]])
        run = saltus.run(family.system, u[0], v[0], orbit.period)
        size = np.linalg.norm(monodromy(orbit), 2)
        assert np.linalg.norm(run.final - start) < 1000.0 * EPS * max(size, 1.0) * np.linalg.norm(start)
        assert orbit.residual < 1e-12
        near, far = distance(family.orbit(0), old), distance(family.orbit(min(8, len(family) - 2)), old)
        assert near < 0.1 and (far > near or family.ended[1].reason == "EVENT")


@pytest.mark.parametrize(("name", "event"), [("S13O00+", "SB1"), ("S11O00-", "PD1"), (REST, "SB1"), (STEEP, "SB1")])
def test_new_families_start_at_the_event(name, event):
    """Oracle: traced back towards the event, the distance from the old orbit goes to zero with the arclength."""
    branch, at, born = switched(name, event, points=2)
    for family in born:
        back = family.trace(0, direction="both", points=60, energy=(0.5 * at.h, 2.0 * at.h))
        period = back.points["alpha"] / (family.points["alpha"][0])
        miss = np.hypot(np.log(back.points["h"] / at.h), np.log(period))
        i = int(np.argmin(miss))
        assert abs(back.points["h"][i] / at.h - 1.0) < 1e-2
        places = [back.points["h"][i]]
        assert places and back.points["residual"].max() < 1e-12
        # the wider problem has its own event where both families cross
        events = [event for event in back.events if event.type in ("BP", "SN", "SB")]
        assert any(abs(event.h / at.h - 1.0) < 1e-6 for event in events), [(e.type, e.h) for e in back.events]


def test_the_reversal_breaking_family_closes_without_unfolding():
    """Oracle: the unfolding parameter xi of a conservative system is 0 on solutions."""
    for name in (REST, STEEP):
        _, _, born = switched(name, "SB1")
        for family in born:
            assert family.ends == ("periodic", "periodic") and family.problem.periodic
            xi = [family.orbit(i).solution.y[-1] for i in range(len(family))]
            assert np.max(np.abs(xi)) < 1e-12


def test_orbits_without_the_reversal_have_none():
    """Oracle: samples: the old orbit run backwards is itself; the new one is not, and the two new ones are each other's images."""
    branch, at, born = switched(REST, "SB1")
    first, second = (family.orbit(9) for family in born)

    def reversed_distance(orbit, other):
        mine, theirs = samples(orbit, 60), samples(other, 4000)
        mine = np.hstack([mine[:, :2], -mine[:, 2:]])
        scale = np.max(np.abs(theirs), axis=0)
        return float(np.max(np.min(np.linalg.norm((mine[:, None] - theirs[None]) / scale, axis=2), axis=1)))

    old = branch.orbit(at.point)
    assert reversed_distance(old, old) < 5e-3
    assert reversed_distance(first, first) > 2e-2
    assert math.isclose(first.h, second.h, rel_tol=1e-3)
    assert min(reversed_distance(first, second), distance(first, second)) < reversed_distance(first, first)


def test_both_sides_are_images_of_each_other():
    """Oracle: the two families at one energy have one quarter period and one trace, and swapped labels."""
    for name, event in (("S13O00+", "SB1"), ("S73O33-", "PD1"), (REST, "SB2")):
        _, at, born = switched(name, event, points=15)
        first, second = born[:2]
        low = max(min(f.points["h"].min() for f in (first,)), second.points["h"].min())
        high = min(first.points["h"].max(), second.points["h"].max())
        energy = 0.5 * (low + high)
        a, b = first.orbit_at(energy=energy), second.orbit_at(energy=energy)
        assert math.isclose(a.alpha, b.alpha, rel_tol=1e-10)
        assert math.isclose(a.tau, b.tau, rel_tol=1e-7, abs_tol=1e-7)
        assert distance(a, b) > 1e-3


def test_period_doubled_orbits_are_not_the_old_ones_twice():
    """Oracle: half a period later the state is another one."""
    _, _, born = switched("S11O00-", "PD1")
    assert {family.ends[0][:4] for family in born} == {"orig", "stop"}
    for family in born:
        orbit = family.orbit(10)
        u, v = orbit.sample(np.array([0.01, 0.01 + 0.5 * orbit.period]) * 1.0)
        assert np.linalg.norm(np.concatenate([u[0] - u[1], v[0] - v[1]])) > 1e-3


def test_stability_is_exchanged_at_a_doubling():
    """Oracle: theory: of the two families that a reversible doubling gives birth to, one is stable and one is not."""
    _, _, born = switched("S11O00-", "PD1")
    stable = {family.ends[0][:4]: {int(x) for x in family.points["stable"][:8]} for family in born}
    assert stable in ({"orig": {1}, "stop": {0}}, {"orig": {0}, "stop": {1}})


def test_stability_at_the_symmetry_breaking_of_the_backbone():
    """Oracle: theory of a pitchfork: the new orbits have the stability that the old family loses, or are unstable beside a
    stable one."""
    branch, at, born = switched("S13O00+", "SB1")
    stable = branch.points["stable"]
    old = {int(stable[i]) for i in range(len(branch)) if branch.points["h"][i] > at.h * (1 + 1e-6) and i - at.point < 20}
    rising = born[0].points["h"][5] > at.h
    beside = {int(stable[i]) for i in range(at.point + 1, at.point + 6)} if rising else {int(x) for x in stable[at.point - 6 : at.point]}
    new = {int(x) for family in born for x in family.points["stable"][:6]}
    assert len(beside) == len(new) == 1 and beside != new and old


def test_the_branch_point_leads_onto_the_backbone_run_seven_times():
    """Oracle: closed form: the family that S73O33- crosses is seven turns of S11O00-."""
    _, at, born = switched("S73O33-", "BP1", points=25)
    backbone = Backbone()
    assert len(born) == 2
    for family in born:
        for h, alpha in zip(family.points["h"], family.points["alpha"], strict=True):
            assert abs(h / backbone.energy(alpha / 7.0) - 1) < 1e-11
        assert math.isclose(family.points["h"][0], at.h, rel_tol=0.02)
    assert (born[0].points["h"][5] - at.h) * (born[1].points["h"][5] - at.h) < 0.0


def test_events_that_are_no_bifurcation_are_refused():
    """Oracle: the message names the types that switching starts from, or the events that there are."""
    branch = traced("S13O00+")
    with pytest.raises(ValueError, match="switching starts from BP, SB or PD"):
        branch.switch("GR1")
    with pytest.raises(ValueError, match="no event 'SB7' on this branch; it has GR1"):
        branch.switch("SB7")
