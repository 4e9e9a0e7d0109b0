"""New families where a symmetry breaks, the period doubles, or two families cross.

Oracles: the closed form where the new family is a backbone run several times; the period at a doubling; continuity at the
event; the exchange of stability at a branch point; the event-driven run.
"""

import math

import numpy as np
import pytest

import saltus
from benchmarks.backbone import Backbone
from branches.family import Family
from branches.forced.family import parameter_family
from branches.forced.primitive import twice
from branches.forced.tracing import switch_response
from branches.naming.labels import parse
from branches.presentation import embed, same_orbit, symmetries
from branches.tracing import follow_family
from bvp.closures import cycle_of
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
    born = branch.switch(event, **options)
    assert born
    return branch, at, born


def samples(orbit, count=400):
    u, v = orbit.sample(np.linspace(0.0, orbit.period, count, endpoint=False))
    return np.hstack([u, v])


def assert_label_is_that_of_the_start(family):
    """An origin..origin orbit is printed with p <= q, and its velocities are those of that start."""
    label = parse(family.label) if family.label else None
    assert label is None or label.p <= label.q
    orbit = family.orbit(0)
    if orbit.velocities is not None:
        u, v = orbit.sample(np.zeros(1))
        assert np.allclose(v[0], orbit.velocities, rtol=1e-12) and np.max(np.abs(u)) < 1e-12


def distance(orbit, other, way=1.0):
    """Largest distance of a sample of one orbit (`way` -1: run backwards) from the other orbit, over the size of the state; the start does
    not matter."""
    mine, theirs = samples(orbit, 60) * [1.0, 1.0, way, way], samples(other, 4000)
    scale = np.max(np.abs(theirs), axis=0)
    return float(np.max(np.min(np.linalg.norm((mine[:, None, :] - theirs[None, :, :]) / scale, axis=2), axis=1)))


@pytest.mark.parametrize(("name", "event", "ends", "times"), CASES[::3], ids=[f"{case[0][:7]}-{case[1]}" for case in CASES][::3])
def test_new_families(name, event, ends, times):
    """Oracle: see `require_new_families`."""
    require_new_families(name, event, ends, times)


def require_new_families(name, event, ends, times):
    """Oracle: continuity at the event, the period there (twice the old one at PD), the event-driven run, and both sides; the unfolding
    parameter xi of a conservative system is 0 on solutions."""
    branch, at, born = switched(name, event)
    assert len(born) >= 2 and ends in {family.ends for family in born}
    old = branch.orbit(at.point)
    for family in born:
        assert math.isclose(family.points["alpha"][0] / at.alpha, times, rel_tol=1e-3)
        assert family.id != branch.id and (family.ends, family.sequence) != (branch.ends, branch.sequence)
        orbit = family.orbit(0)
        u, v = orbit.sample(np.array([0.0371 * orbit.period]))
        start = np.concatenate([u[0], v[0]])
        run = saltus.simulate(family.system, u[0], v[0], orbit.period)
        size = np.linalg.norm(monodromy(orbit), 2)
        assert np.linalg.norm(run.final - start) < 1000.0 * EPS * max(size, 1.0) * np.linalg.norm(start)
        assert orbit.residual < 1e-12 and family.problem.periodic is (family.ends == ("periodic", "periodic"))
        if family.problem.periodic:
            assert max(abs(family.orbit(i).solution.y[-1]) for i in range(len(family))) < 1e-12
        assert_label_is_that_of_the_start(family)
        near, far = distance(family.orbit(0), old), distance(family.orbit(min(8, len(family) - 2)), old)
        assert near < 0.1 and (far > near or family.ended[1].reason == "EVENT")


def test_orbits_without_the_reversal_have_none():
    """Oracle: samples: the old orbit run backwards is itself; the new one is not, and the two new ones are each other's images."""
    branch, at, born = switched(REST, "SB1")
    first, second = (family.orbit(9) for family in born)
    old = branch.orbit(at.point)
    assert distance(old, old, -1.0) < 5e-3
    assert distance(first, first, -1.0) > 2e-2
    assert math.isclose(first.h, second.h, rel_tol=1e-3)
    assert min(distance(first, second, -1.0), distance(first, second)) < distance(first, first, -1.0)


SYMMETRY_BREAKING = [("S13O00+", "SB1"), ("S73O33-", "SB1"), (REST, "SB2"), (REST, "SB1"), ("U3201-", "SB1"), (STEEP, "SB1")]


@pytest.mark.parametrize(("name", "event"), SYMMETRY_BREAKING)
def test_both_sides_are_exact_images_of_each_other(name, event):
    """Oracle: the images by hand: the mirror where a reversal is left, time reversed where none is; all that no image changes is equal
    bit for bit, and the image is a branch like any other: its orbits solve its problem, and following it gives the same energies."""
    _, at, (first, second) = switched(name, event, points=15)
    assert first.id == second.id
    for key in ("h", "alpha", "tau", "stable", "arclength", "multipliers"):
        np.testing.assert_array_equal(first.points[key], second.points[key])
    assert [(e.id, e.h, e.label) for e in first.events] == [(e.id, e.h, e.label) for e in second.events]
    assert [(p, q) for p, q in zip(first.points["label"], second.points["label"], strict=True) if p != q] == []
    if first.problem.periodic:
        a, b = (orbit.impacts for orbit in (first.orbit(7), second.orbit(7)))
        assert sorted(i.speed for i in a) == pytest.approx(sorted(i.speed for i in b), rel=1e-9)
        assert distance(first.orbit(min(9, len(first) - 2)), second.orbit(min(9, len(first) - 2))) > 5e-3
    else:
        np.testing.assert_array_equal(first.points["start_v"], -second.points["start_v"])
        np.testing.assert_array_equal(first.points["flight_times"], second.points["flight_times"])
        assert second.sequence == first.sequence.translate(str.maketrans("+-", "-+"))
    again = second.trace(0, points=9, energy=(0.5 * at.h, 2.0 * at.h))
    orbit = again.orbit(4)
    assert any(abs(other.alpha / orbit.alpha - 1.0) < 1e-10 for other in first.trace(0, points=60).orbits_at(energy=orbit.h))


def test_notes_of_the_image_are_those_of_its_own_orbit():
    """Oracle: the mirror: the stop that the one side touches is the other stop for the other side."""
    branch = traced("S13O00+")
    first, second = branch.switch("SB1")
    ours, theirs = (next(e for e in family.events if e.type == "GR") for family in (first, second))
    assert {ours.stop, theirs.stop} == {"+", "-"} and ours.note.replace("stop " + ours.stop, "stop " + theirs.stop) == theirs.note
    assert theirs.note in second.ended[1].text


@pytest.mark.parametrize(("name", "event"), [("S11O00-", "PD1"), ("S73O33-", "PD1"), (REST, "PD1"), ("S11O00-", "RT2")])
def test_the_other_side_of_a_doubling_is_the_same_orbit_started_later(name, event):
    """Oracle: theory: a doubled orbit started one old period later lies on the other side; so one side is followed."""
    branch, at, born = switched(name, event)
    assert len({family.ends for family in born}) == len(born) == 2
    for family in born:
        problem, y = family.problem, family.orbit(0).solution.y
        late = embed(problem, y, (1, 2))
        assert (late.ends, late.sequence) == (problem.ends, problem.sequence)
        there = late.unknowns(problem)
        assert same_orbit((problem, y), (problem, there)) and np.max(np.abs(there - y)) > 1e-3
        old = 0.5 * (there + y)
        assert symmetries(cycle_of(problem, old), 1e-2).cover >= 2


def test_a_period_doubles_where_the_trace_touches_minus_two():
    """A family without a reversal, whose half periods are mirror images: tau + 2 does not change its sign. Oracles: the zero of its root,
    as a polynomial; and a family with twice the impacts."""
    branch = saltus.trace("periodic:++++--++----++--:851fed32", energy=(6.8, 6.9))  # the last point inside is a branch point
    event = next(event for event in branch.events if event.type == "PD")
    beside = np.delete(np.arange(-4, 5), 4)
    roots = np.sqrt(branch.points["tau"][event.point + beside] + 2.0) * np.sign(beside)
    assert event.h == pytest.approx(np.polyfit(roots, branch.points["h"][event.point + beside], 5)[-1], rel=1e-12)
    assert saltus.switch(branch, event.id, energy=(6.5, 7.5))[0].problem.sequence == branch.problem.sequence * 2


def test_period_doubled_orbits_are_not_the_old_ones_twice():
    """Oracle: half a period later the state is another one; of the two families of a reversible doubling one is stable and one is not."""
    _, _, born = switched("S11O00-", "PD1")
    assert {family.ends[0][:4] for family in born} == {"orig", "stop"}
    for family in born:
        orbit = family.orbit(10)
        u, v = orbit.sample(np.array([0.01, 0.01 + 0.5 * orbit.period]) * 1.0)
        assert np.linalg.norm(np.concatenate([u[0] - u[1], v[0] - v[1]])) > 1e-3
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


def test_a_crossing_with_a_7_fold_cover_leads_onto_the_backbone_itself():
    """Oracle: closed form: the family that S73O33- crosses is the 7-fold cover of S11O00-; the answer is S11O00-, through the crossing."""
    _, at, born = switched("S73O33-", "BP1", points=25)
    backbone = Backbone()
    (family,) = born
    assert family.cover == 7 and family.id == traced("S11O00-").id and family.label == "S11O00-"
    for h, alpha in zip(family.points["h"], family.points["alpha"], strict=True):
        assert abs(h / backbone.energy(alpha) - 1) < 1e-11
    assert family.points["h"].min() < at.h < family.points["h"].max()
    assert math.isclose(family.orbit_at(energy=at.h).alpha, at.alpha / 7.0, rel_tol=1e-5)


WAYS_BACK = [("S13O00+", "SB1", 1), ("S11O00-", "PD1", 2), (REST, "SB1", 1), (REST, "PD1", 2), (STEEP, "SB1", 1), ("U3201-", "SB1", 1),
             ("S11O00-", "RT4", 5), ("S11O00-", "RT2", 4), ("U3201-", "RT2", 3), ("U3201-", "RT3", 4)]  # fmt: skip


@pytest.mark.parametrize(("name", "event", "cover"), WAYS_BACK[::3])
def test_every_emanating_family_leads_back_to_the_old_family(name, event, cover):
    """Oracle: see `require_every_emanating_family_leads_back_to_the_old_family`."""
    require_every_emanating_family_leads_back_to_the_old_family(name, event, cover)


def require_every_emanating_family_leads_back_to_the_old_family(name, event, cover):
    """Oracle: the old family: seen from the new one, it is crossed where it began."""
    branch, at, born = switched(name, event, points=3)
    for family in born:
        through = family.trace(1, energy=(0.5 * at.h, 2.0 * at.h))
        crossings = [e for e in through.events if e.type == "BP" and abs(e.h / at.h - 1.0) < 1e-5]
        assert len(crossings) == 1 and through.id == family.id
        (back,) = through.switch(crossings[0], points=5)
        assert back.id == branch.id and back.cover == cover


RESONANT = [("S11O00-", f"RT{k}") for k in range(1, 9)] + [("U3201-", f"RT{k}") for k in range(1, 6)] + [(REST, "RT1"), (REST, "RT3")]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("name", "event"), RESONANT[::3])
def test_families_that_emanate_at_a_resonance(name, event):
    """Oracle: see `require_families_that_emanate_at_a_resonance`."""
    require_families_that_emanate_at_a_resonance(name, event)


def require_families_that_emanate_at_a_resonance(name, event):
    """Oracle: theory: q times the period and tau to 2 at the event, orbits that do not repeat themselves, and the event-driven run; for
    q >= 5 one of the two families (or sides of a family) is stable beside the event and the other is not."""
    branch, at, born = switched(name, event)
    q = at.p_q[1]
    kinds = {}
    for family in born:
        gap = abs(family.points["alpha"][0] / at.alpha / q - 1.0)
        assert gap < 5e-3 and abs(family.points["h"][0] / at.h - 1.0) < 5e-3
        orbit = family.orbit(0)
        assert symmetries(orbit.cycle).cover == 1
        assert abs(orbit.tau - 2.0) < (1.1 if q < 5 else 0.05)
        u, v = orbit.sample(np.array([0.0371 * orbit.period]))  # inside a flight: at an impact, rounding decides which side of it is last
        run = saltus.simulate(family.system, u[0], v[0], orbit.period)
        start = np.concatenate([u[0], v[0]])
        assert np.linalg.norm(run.final - start) < 1e4 * EPS * max(np.linalg.norm(monodromy(orbit), 2), 1.0) * np.linalg.norm(start)
        assert_label_is_that_of_the_start(family)
        kinds.setdefault(family.id, []).append(family)
    # One family with two different sides, or two families.
    sides = born if len(kinds) == 1 else [families[0] for families in kinds.values()]
    stable = [{int(x) for x in family.points["stable"][:4]} - {-1} for family in sides]
    if q >= 5 and all(len(each) == 1 for each in stable):
        assert sorted(each.pop() for each in stable) == [0, 1]


def test_a_sixtupling_that_is_located_by_hand():
    """Oracle: tau = 2 cos(2 pi/6) = 1 on S11O00-, found by bisection in the energy; six times the period there."""
    branch = traced("S11O00-")
    low, high = 0.44, 2.0  # tau rises here from its value at 1/5 towards 2
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if branch.orbit_at(energy=middle).tau < 1.0 else (low, middle)
    orbit = branch.orbit_at(energy=high)
    start = follow_family(orbit.problem, orbit.solution.y, points=3)
    event = branch.events[-1]._replace(id="RT", type="RT", p_q=[1, 6], point=start.start, h=high, alpha=orbit.alpha)
    born = start.switch(event, points=6)
    assert [family.ends[0][:4] for family in born] == ["orig", "stop"]
    for family in born:
        assert math.isclose(family.points["alpha"][0] / orbit.alpha, 6.0, rel_tol=1e-4)
        assert abs(family.points["tau"][0] - 2.0) < 1e-3 and symmetries(family.orbit(0).cycle).cover == 1


CHAINS = [
    ("S73O33-", "PD1", ("stop+", "stop+"), "PD1", ("stop+", "stop+")),
    ("S13O00+", "SB1", ("origin", "origin"), "SB1", ("periodic", "periodic")),
    ("S11O00-", "PD1", ("origin", "origin"), "PD1", ("origin", "origin")),
    (REST, "PD1", ("origin", "origin"), "PD1", ("origin", "origin")),
    ("S11O00-", "RT1", ("origin", "origin"), "PD1", ("origin", "origin")),
]


@pytest.mark.parametrize(("name", "event", "ends", "following", "last"), CHAINS, ids=[f"{c[0][:7]}-{c[1]}-{c[3]}" for c in CHAINS])
def test_switching_goes_on_from_what_was_switched_to(name, event, ends, following, last):
    """Oracle: the period: kept where a symmetry breaks, doubled where it doubles; orbits that do not repeat themselves, whose
    reversals are those of their ends."""
    family = next(f for f in traced(name).switch(event) if f.ends == ends)
    found = next(e for e in family.events if e.id == following)
    born = family.switch(found, points=5)
    assert last in {new.ends for new in born}
    for new in born:
        assert math.isclose(new.points["alpha"][0] / found.alpha, 2.0 if found.type == "PD" else 1.0, rel_tol=1e-3)
        symmetric = symmetries(new.orbit(1).cycle)
        assert symmetric.cover == 1 and bool(symmetric.reversals) is not new.problem.periodic


def test_symmetries_take_solutions_to_solutions():
    """Oracle: the equations, which an image satisfies too, and the group: one of the symmetries takes the image back. Of segments between
    reversals, of closed orbits, in the energy and in a parameter, and of forced ones."""
    segment = traced("U21@h=0.582963,alpha=1.61731")
    closed = segment.switch("SB1", points=5)[0]
    released = saltus.trace_in_parameter(segment.orbit(2), "sigma", (0.099, 0.101), keep="energy = 0.58", points=8)
    families = [(Family(branch.problem), branch.unknowns(3)) for branch in (segment, closed)]
    families.append((parameter_family(released.problem), released.unknowns[len(released) // 2]))
    ueda = saltus.load_scene("ueda_oscillator").parametric
    (response,) = saltus.trace_response(ueda, "B", (2.0, 2.4), values={"B": 2.1}, points=40)
    problem, step = switch_response(response, next(event for event in response.events if event.type == "SB"))[0]
    families.append((parameter_family(problem), step.y))
    for family, y in families:
        found = family.symmetries(y)
        assert found
        for symmetry in found:
            image = symmetry(y)
            assert np.abs(family.residual(image)).max() < 1e-9 and np.abs(image - y).max() > 1e-3
            assert min(np.abs(other(image) - y).max() for other in found) < 1e-9


def test_an_orbit_traversed_twice_is_its_own_image_a_period_later():
    """Oracle: the same impacts a period of the load later."""
    parametric = saltus.load_scene("impact_oscillator").parametric
    (branch, *_) = saltus.trace_response(parametric, "s", (-0.1, 0.0), values={"s": -0.08}, u=[-0.66], v=[0.0], points=5)
    wide, y = twice(branch.problem, branch.unknowns[2])
    (symmetry,) = parameter_family(wide).symmetries(y)
    assert np.abs(symmetry(y) - y).max() < 1e-14


@pytest.mark.parametrize(("side", "events", "partner"), [
    (0, ["SN", "BP"], ("S11+", "the reversal about the start stays")),
    (1, ["SN", "SN", "BP"], ("S11+", "the reversal about the far end stays")),
])  # fmt: skip
def test_a_family_ends_at_the_symmetric_family_where_it_is_its_own_image(side, events, partner):
    """Oracles: the energies where the symmetry of the other family breaks, zeros of its half map. A step over such a branch point went on
    along the other family, without an event. Followed both ways the family comes to its image: then what it lists is there twice."""
    options = {"scene": "cubic_nes", "energy": (1e-3, 30.0)}
    family = saltus.trace("S11-", **options).switch("PD2", energy=options["energy"])[side]
    assert [event.type for event in family.events if event.type in ("SN", "BP")] == events
    assert [end.reason for end in family.ended] == ["NOT_ASKED", "IMAGE"]
    name, note = partner
    breaking = [event.h for event in saltus.trace(name + "@h=0.1", **options).events if event.type == "SB" and note in event.note]
    assert min(abs(h / family.points["h"][-1] - 1.0) for h in breaking) < 1e-9
    whole = follow_family(family.problem, family.unknowns(len(family) // 2), energy=options["energy"])
    assert whole.is_closed and {end.reason for end in whole.ended} == {"IMAGE"} and whole.id == family.id
    folds = sorted(event.h for event in whole.events if event.type == "SN")
    once = sorted(event.h for event in family.events if event.type == "SN")
    assert folds == pytest.approx(sorted(2 * once), rel=1e-9)
