"""Families that meet at grazing.

Oracles: both problems have the grazing orbit as a solution, sampled over the period; the relation is symmetric; where orbits exist near the
grazing orbit, by scanning angles beside it; the event-driven run; hand-made simultaneous impacts.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from branches.grazing import following
from branches.grazing.following import CannotMerge, merged, neighbours
from branches.grazing.touching import candidate, touching
from branches.linear_modes import linear_modes
from branches.orbit import Orbit
from branches.sequences import canonical_sequence
from branches.tracing import follow_family
from bvp.closures import cycle_of
from bvp.multipoint import MultipointProblem, Solution
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from tests.branches.scans import refined, sampled
from tests.branches.traced import traced

SYSTEM = vibro_impact_nes()
S73 = "S73O33-@h=7.3348,alpha=1.6459"
U8353 = "U8353-@h=1.9458,alpha=4.9065"

GRAZINGS = [("S13O00+", 14.5537), (S73, 72.737), (S73, 127.484), (U8353, 1.88971), (U8353, 2.58769)]
IDS = [f"{name[:7]}-{h}" for name, h in GRAZINGS]


def grazing(name, h):
    branch = traced(name)
    return branch, next(event for event in branch.events if event.type == "GR" and abs(event.h / h - 1.0) < 1e-4)


@cache
def met(name, h):
    branch, event = grazing(name, h)
    return branch, event, branch.neighbours(event, points=40)


def family(ends, sequence):
    return canonical_sequence(tuple(sequence), ends)


def states(problem, y, count):
    """The orbit over its period, (count, 2n), from its first instant with an impact of some speed."""
    cycle = cycle_of(problem, y)
    begin = float(cycle.times[int(np.argmax(cycle.speeds > 1e-6))])
    times = begin + (np.arange(count) + 0.37) * cycle.period / count
    u, v = cycle.sample(times)
    return np.hstack([u, v])


@pytest.mark.parametrize(("name", "h"), GRAZINGS[1:4:2], ids=IDS[1:4:2])
def test_the_grazing_orbit_solves_both_problems(name, h):
    """Oracle: see `require_the_grazing_orbit_solves_both_problems`."""
    require_the_grazing_orbit_solves_both_problems(name, h)


def require_the_grazing_orbit_solves_both_problems(name, h):
    """Oracle: samples over a period: every state of one orbit is on the other, up to the mirror; energies and residuals."""
    _, event, found = met(name, h)
    assert any(item.branch is not None for item in found)
    for item in found:
        assert item.here.residual < 1e-12 and item.there.residual < 1e-12
        assert abs(item.there.problem.energy(item.there.y) / item.here.problem.energy(item.here.y) - 1.0) < 1e-10
        old, new = states(item.here.problem, item.here.y, 3), cycle_of(item.there.problem, item.there.y)
        size = np.max(np.abs(new.after))
        nearest = []
        for state in old:
            z = SYSTEM.modes.from_state @ state
            fine = np.linspace(0.0, new.period, 4001)
            u, v = new.sample(fine)
            images = np.hstack([u, v]) @ SYSTEM.modes.from_state.T
            i, sign = min(((i, s) for i in range(len(fine)) for s in (1.0, -1.0)), key=lambda k: np.max(np.abs(images[k[0]] - k[1] * z)))
            time = fine[i]
            for _ in range(4):
                u, v = new.sample(np.array([time]))
                here = SYSTEM.modes.from_state @ np.concatenate([u[0], v[0]])
                flow = SYSTEM.modes.matrix @ here
                time -= flow @ (here - sign * z) / (flow @ flow)
            u, v = new.sample(np.array([time]))
            nearest.append(np.max(np.abs(SYSTEM.modes.from_state @ np.concatenate([u[0], v[0]]) - sign * z)))
        assert max(nearest) < 1e-10 * size


@pytest.mark.parametrize(("name", "h"), GRAZINGS, ids=IDS)
def test_the_relation_is_symmetric(name, h):
    """Oracle: the neighbour ends at the same orbit, and the branch is found among the neighbours of each neighbour there."""
    branch, event, found = met(name, h)
    me = family(branch.ends, branch.problem.sequence)
    for item in found:
        if item.branch is None:
            continue
        assert item.event is not None and abs(item.event.h / event.h - 1.0) < 1e-9
        assert abs(item.event.alpha * item.cover / event.alpha - 1.0) < 1e-9
        back = item.branch.neighbours(item.event, points=10)
        again = [other for other in back if other.branch is not None and family(other.ends, other.branch.problem.sequence) == me]
        assert len(again) == 1 and again[0].kind == item.kind
        assert abs(again[0].event.h / event.h - 1.0) < 1e-9


@pytest.mark.parametrize(("name", "h"), GRAZINGS, ids=IDS)
def test_folds_and_passages(name, h):
    """Oracle: the energies of both families next to the grazing orbit; the orbits there are orbits."""
    branch, event, found = met(name, h)
    inside = event.point + 1 if event.point == 0 else event.point - 1
    side = np.sign(branch.points["h"][inside] - event.h)
    for item in found:
        if item.branch is None:
            assert item.kind == "dead end" and item.reason and item.event is None
            continue
        at = item.event.point
        beside = at + 1 if at == 0 else at - 1
        other = np.sign(item.branch.points["h"][beside] - item.event.h)
        assert item.kind == ("fold" if other == side else "passage")
        orbit = item.branch.orbit(beside)
        u, _ = orbit.sample(np.linspace(0.0, orbit.period, 5001))
        assert np.max(np.abs(u[:, 0] - u[:, 1])) < 1.0 + 1e-12 and min(impact.speed for impact in orbit.impacts) > 0.0
        assert len(orbit.impacts) == item.impacts


def test_the_backbone_meets_two_more_impacts_in_a_fold():
    """Oracle: the reference: beyond h = 14.5537 there is neither; unsymmetric families meet there too."""
    _, _, found = met("S13O00+", 14.5537)
    kinds = {(item.ends, len(item.sequence)): item.kind for item in found}
    assert kinds[(("origin", "stop+"), 1)] == "fold"
    assert kinds[(("origin", "origin"), 2)] == "fold"
    assert kinds[(("periodic", "periodic"), 3)] == "dead end"


def test_the_end_changes_its_kind():
    """Oracle: the impact at the quarter vanishes, so the orbit reverses at rest there."""
    _, _, found = met(S73, 72.737)
    (only,) = [item for item in found if item.branch is not None]
    assert only.ends == ("origin", "rest") and only.kind == "passage" and only.label == "S31E33+"
    back = only.branch.neighbours(only.event, points=10)
    assert ("origin", "stop+") in [item.ends for item in back if item.branch is not None]


@pytest.mark.parametrize(("name", "h", "label"), [("S13O00+", 0.1185078106, "L11+"), ("S11O00-", 0.0864921894, "L11-")])
def test_all_impacts_vanish_at_a_linear_mode(name, h, label):
    """Oracle: closed form: w^2/(2 b^2)."""
    branch, event = grazing(name, h)
    (only,) = neighbours(branch, event)
    assert only.kind == "linear mode" and only.label == label and only.branch is None
    modes = SYSTEM.modes
    k = 0 if label == "L11+" else 1
    assert abs(only.h / (0.5 * (modes.frequencies[k] / modes.contacts.gap[0, k]) ** 2) - 1.0) < 1e-10


def beside(branch, event, side, most):
    """Families of the orbits that start at the origin next to a grazing orbit, at an energy a little above or below."""
    old = branch.orbit(event.point)
    h = event.h * (1.0 + side * 1e-4)
    u, v = old.sample(np.linspace(0.0, old.period, 8000, endpoint=False))
    path = np.hstack([u, v])
    path = np.vstack([path, -path])
    size = np.max(np.abs(path), axis=0)
    out = set()
    for axis in (0.0, 0.5 * old.period)[: branch.problem.quarters]:
        u, v = old.sample(np.array([axis]))
        z = SYSTEM.modes.from_state @ np.concatenate([u[0], v[0]])
        for end in ("stop", "rest", "origin"):
            grid = refined(SYSTEM, end, 1.4 * event.alpha, h, np.arctan2(z[3], z[2]), most, 1e-3)
            for found in sampled(SYSTEM, end, 1.4 * event.alpha, h, grid, range(most + 1)):
                if abs(found.alpha / event.alpha - 1.0) > 1e-3:
                    continue
                orbit = Orbit(found.problem, found.solution)
                mine = np.hstack(orbit.sample(np.linspace(0.0, orbit.period, 60, endpoint=False)))
                if max(np.min(np.max(np.abs(state - path) / size, axis=1)) for state in mine) < 0.01:
                    out.add(family(found.problem.ends, found.problem.sequence))
    return out


@pytest.mark.parametrize(("name", "h", "most"), [(S73, 72.737, 4)])
def test_orbits_beside_the_grazing_are_those_of_the_neighbours(name, h, most):
    """Oracle: see `require_orbits_beside_the_grazing_are_those_of_the_neighbours`."""
    require_orbits_beside_the_grazing_are_those_of_the_neighbours(name, h, most)


def require_orbits_beside_the_grazing_are_those_of_the_neighbours(name, h, most):
    """Oracle: a scan over the angles of the start, beside the grazing orbit, above and below its energy."""
    branch, event, found = met(name, h)
    inside = event.point + 1 if event.point == 0 else event.point - 1
    side = 1 if branch.points["h"][inside] > event.h else -1
    expected = {side: {family(branch.ends, branch.problem.sequence)}, -side: set()}
    for item in found:
        if item.branch is not None and item.ends[0] == "origin":
            expected[side if item.kind == "fold" else -side].add(family(item.ends, item.branch.problem.sequence))
    assert {way: beside(branch, event, way, most) for way in (1, -1)} == expected


def test_neighbours_of_twice_the_period():
    """Oracle: a family of twice the period that ends at the backbone's grazing has the backbone, run once, as its neighbour."""
    branch, event = grazing("S13O00+", 14.5537)
    twice = [item for item in branch.neighbours(event, cover=2, points=30) if item.cover == 1 and item.branch is not None]
    assert twice
    chosen = next(item for item in twice if item.ends == ("origin", "origin"))
    assert abs(chosen.event.alpha / event.alpha - 2.0) < 1e-9
    back = chosen.branch.neighbours(chosen.event, points=10)
    followed = [item for item in back if item.branch is not None and item.cover == 2]
    assert family(("origin", "stop+"), "") in [family(item.ends, item.sequence) for item in followed]


def test_a_fold_next_to_the_grazing_does_not_change_the_kind():
    """Oracle: symmetry of the relation, where a saddle-node lies within 1e-4 of the grazing energy of the neighbour."""
    system = vibro_impact_nes(mu=0.37, sigma=0.81)
    found = sampled(system, "origin", 5.5, 0.5305, 4000, [4])
    me = family(("origin", "origin"), "+-++")
    start = next(orbit for orbit in found if family(orbit.problem.ends, orbit.problem.sequence) == me and abs(orbit.alpha - 5.2118) < 1e-3)
    branch = follow_family(start.problem, start.solution.y, energy=(0.5, 0.6))
    event = next(e for e in branch.events if e.type == "GR" and abs(e.h - 0.5304283397) < 1e-9)
    item = next(item for item in branch.neighbours(event, energy=(0.5, 0.6)) if item.ends == ("periodic", "periodic"))
    assert any(e.type == "SN" and 0.0 < abs(e.h - event.h) < 1e-4 for e in item.branch.events)
    back = item.branch.neighbours(item.event, energy=(0.5, 0.6))
    kinds = [other.kind for other in back if other.branch and family(other.ends, other.branch.problem.sequence) == me]
    assert kinds == [item.kind] == ["fold"]


def test_symmetries_of_a_grazing_orbit():
    """Oracle: by hand: four touches and two impacts a period, with the mirror and both reversals."""
    branch, event = grazing("S13O00+", 14.5537)
    orbit = touching(branch.problem, branch.orbit(event.point).solution.y)
    assert len(orbit.times) == 6 and orbit.grazing.sum() == 4 and len(orbit.symmetries) == 4
    assert sorted(str(s.axis) for s in orbit.symmetries) == ["None", "None", "origin", "rest"]
    assert len(list(orbit.choices())) == 7  # none, 1, three pairs, 3, all
    own = candidate(orbit, orbit.smallest(orbit.kept))
    assert own.ends[0] == "origin" and own.sequence == () and own.impacts == 2


def test_many_touches_are_changed_by_twos():
    """Oracle: by hand: the 7-fold cover has 28 touches in 14 pairs about each kind of axis; one or two pairs are added."""
    branch, event = grazing("S13O00+", 14.5537)
    orbit = touching(branch.problem, branch.orbit(event.point).solution.y).repeated(7)
    added = [bin(mask ^ orbit.hard).count("1") for mask in orbit.choices()]
    assert orbit.grazing.sum() == 28 and set(added) == {2, 4} and added.count(2) > 2


def two_stops(mixed):
    """Two masses, each with a stop; the second stop can be one for both masses, so that its impulse acts at the first."""
    second = (1.0, 1.0) if mixed else (0.0, 1.0)
    stops = (Stop((1.0, 0.0), -1.0, 1.0, name="a"), Stop(second, -0.8, 0.8, name="b"))
    return ImpactSystem([[1.0, 0.0], [0.0, 1.5]], [[0.0] * 2] * 2, [[2.0, -0.7], [-0.7, 1.6]], stops)


def at_one_instant(system, ends=("origin", "rest")):
    """A segment whose two inner impacts, at a+ and b+, happen at one instant, with the equations of its impacts solved."""
    modes = system.modes
    problem = MultipointProblem(system, ends, ("a+", "b+"))
    a, b = (modes.contact_letters.index(letter) for letter in ("a+", "b+"))
    rows = np.array([modes.contacts.gap[a], modes.contacts.gap[b]])
    rates = np.array([modes.contacts.rate[a], modes.contacts.rate[b]])
    before = np.concatenate([np.linalg.solve(rows[:, :2], [1.0, 0.8]), np.linalg.solve(rates[:, 2:], [0.9, 0.4])])
    between = before - 2.0 * modes.contacts.push[a] * (modes.contacts.rate[a] @ before)
    after = between - 2.0 * modes.contacts.push[b] * (modes.contacts.rate[b] @ between)
    y = problem.pack(np.zeros(4), [between, after], [0.6, 0.0, 0.7])
    return problem, Solution(y, np.zeros(2 * len(y)), np.zeros(6), np.zeros((3, 4)), np.zeros(39)), before


def test_impacts_at_independent_stops_change_their_order():
    """Oracle: M is diagonal, so the impulses do not interact: b+ first gives the same motion."""
    problem, solution, before = at_one_instant(two_stops(False))
    other, y, stops = merged(problem, solution.y)
    assert other.sequence == ("b+", "a+") and stops == ("a+", "b+")
    modes = problem.modes
    b = modes.contact_letters.index("b+")
    assert np.allclose(other.nodes(y)[0], before - 2.0 * modes.contacts.push[b] * (modes.contacts.rate[b] @ before), atol=1e-14)
    assert np.allclose(other.nodes(y)[1], problem.nodes(solution.y)[1], atol=1e-14)
    rows = other.size + 1
    assert np.allclose(other.residual(y)[rows : 2 * rows], 0.0, atol=1e-14)


@pytest.mark.parametrize(
    ("mixed", "times", "words"),
    [(True, [0.6, 0.0, 0.7], "act on each other"), (False, [0.0, 0.6, 0.7], "comes to an end of the solved segment")],
)
def test_impacts_that_interact_or_come_to_an_end_do_not_merge(mixed, times, words):
    """Oracle: the impulse at b changes the speed at a; the first flight has vanished."""
    problem, solution, _ = at_one_instant(two_stops(mixed))
    with pytest.raises(CannotMerge, match=words):
        merged(problem, problem.pack(problem.start(solution.y), problem.nodes(solution.y), times))


@pytest.mark.parametrize(
    ("solved", "words"),
    [
        (lambda problem, y: (y, 0.0, []), "several families cross there, and their directions were not found"),
        (lambda problem, y: (y, 1e-11, []), "the grazing orbit does not solve this problem"),
        (lambda problem, y: (y, 0.0, [np.zeros(len(y))]), "the orbit does not change with the first impulses"),
    ],
)
def test_a_dead_end_has_its_reason(monkeypatch, solved, words):
    """Oracle: solutions at the grazing orbit that are made up."""
    monkeypatch.setattr(following, "_solve", solved)
    branch, event = grazing("S13O00+", 14.5537)
    found = branch.neighbours(event)
    assert found and all((item.kind, item.reason, item.branch) == ("dead end", words, None) for item in found)


def test_a_motion_without_impacts_and_reversals_solves_no_problem():
    """Oracle: a grazing of both modes at different phases, which no symmetry keeps."""
    mode = linear_modes(SYSTEM)[0].touching(1)
    state = mode.after[:1] + [0.0, 0.0, 0.0, 0.1]
    mixed = replace(mode, times=mode.times[:1], contact=mode.contact[:1], before=state, after=state, grazing=mode.grazing[:1])
    with pytest.raises(ValueError, match="without impacts and without a reversal"):
        candidate(mixed, 0)
