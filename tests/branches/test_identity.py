"""One family, one id: however it was reached, cut, or presented.

Oracles: the orbit itself, rewritten by hand with numpy in another presentation; the branch that was not cut; closed form numbers.
"""

import hashlib
import itertools
import math

import numpy as np
import pytest

import saltus
from branches.full_family import BORDER, FamilyMark, digests, energy_scale
from branches.presentation import canonical_orbit, cover_of, embed, pattern_of, same_orbit, solved, symmetries
from branches.sequences import PERIODIC, canonical_sequence, mirror
from branches.tracing import follow_family
from bvp.closures import cycle_of
from bvp.multipoint import MultipointProblem
from bvp.system import ImpactSystem, Stop
from tests.branches.traced import traced

REST = "S11E11+@h=3.0"
FAMILIES = ["S13O00+", "S11O00-", "S73O33-", "U8353-", "U3201-", REST, "S35O22+@h=1.0,alpha=4.91349"]


def exchanged(problem, y):
    """The orbit solved from its far end, by hand: states before the impacts, turned round, in the other order."""
    flip = np.repeat([1.0, -1.0], problem.half)
    arrivals = problem.end_states(y) * flip
    other = MultipointProblem(problem.system, problem.ends[::-1], problem.sequence[::-1])
    return other, other.pack(arrivals[-1], arrivals[-2::-1], problem.flight_times(y)[::-1])


def mirrored(problem, y):
    """The orbit -u."""
    other = MultipointProblem(problem.system, mirror(problem.ends), mirror(problem.sequence))
    return other, other.pack(-problem.start(y), -problem.nodes(y), problem.flight_times(y))


def in_window(problem, y, window):
    """The orbit over another window of its time."""
    presentation = embed(problem, y, window)
    other = MultipointProblem(problem.system, presentation.ends, presentation.sequence)
    return other, presentation.unknowns(other)


def rotated(problem, y, by):
    """The orbit as it closes on itself from another of its impacts."""
    cycle = cycle_of(problem, y)
    nodes, times = np.roll(cycle.after, -by, axis=0), np.roll(cycle.duration, -by)
    letters = cycle.letters[by:] + cycle.letters[:by]
    other = MultipointProblem(problem.system, PERIODIC, letters)
    return other, other.pack(nodes[0], nodes[1:], times)


def images(problem, y):
    """Presentations of one orbit."""
    yield "itself", (problem, y)
    yield "exchanged", exchanged(problem, y)
    yield "mirrored", mirrored(problem, y)
    yield "both", mirrored(*exchanged(problem, y))
    for first, length in itertools.product(range(4), range(1, 9)):
        yield f"window {first} to {first + length}", in_window(problem, y, (first, first + length))
    for by in range(len(cycle_of(problem, y).duration)):
        yield f"closed from impact {by}", rotated(problem, y, by)
    yield "2-fold cover closed", in_window(problem, y, 2)


@pytest.mark.parametrize("name", FAMILIES[::2])
def test_all_presentations_of_an_orbit_are_one(name):
    """Oracle: see `require_all_presentations_of_an_orbit_are_one`."""
    require_all_presentations_of_an_orbit_are_one(name)


def require_all_presentations_of_an_orbit_are_one(name):
    """Oracle: the orbit rewritten by hand: each has the canonical ends and sequence, and the same unknowns to rounding."""
    branch = traced(name)
    problem, y = branch.problem, branch.orbit(2 * len(branch) // 5).solution.y
    mine, there = canonical_orbit(problem, y)
    assert (mine.sequence, mine.ends) == canonical_sequence(problem.sequence, problem.ends)
    for words, (other, z) in images(problem, y):
        assert np.max(np.abs(other.residual(z))) < 1e-8 * np.max(np.abs(z)), words
        found, x = canonical_orbit(other, z)
        assert (found.ends, found.sequence) == (mine.ends, mine.sequence), words
        np.testing.assert_allclose(x, there, rtol=0.0, atol=1e-9 * np.max(np.abs(there)), err_msg=words)
        assert same_orbit((problem, y), (other, z)), words


def test_different_orbits_have_different_ids():
    """Oracle: neighbours on one branch, and two orbits of one family at one energy, are different orbits."""
    branch = traced("S13O00+")
    a, b = (branch.orbit(i).solution.y for i in (50, 51))
    assert not same_orbit((branch.problem, a), (branch.problem, b))
    twice = traced("S11O00-").orbits_at(energy=0.08)
    assert len(twice) == 2 and not same_orbit(*((orbit.problem, orbit.solution.y) for orbit in twice))


@pytest.mark.parametrize("name", FAMILIES)
def test_covers_are_those_of_the_symmetries(name):
    """Oracle: the symmetries, which look at the states whatever the sequence."""
    branch = traced(name)
    problem, y = branch.problem, branch.orbit(2 * len(branch) // 5).solution.y
    counted = set()
    for words, (other, z) in images(problem, y):
        found = symmetries(cycle_of(other, z))
        expected = 2 if found.cover == 1 and other.quarters == 2 and found.half else found.cover
        assert cover_of(other, solved(other, z)) == expected, words
        counted.add(expected)
    assert len(counted) > 1


@pytest.mark.parametrize("name", FAMILIES)
def test_symmetries_of_the_named_families(name):
    """Oracle: the ends: a quarter problem has two instants of each reversal and the half-period symmetry, others two of one kind."""
    branch = traced(name)
    problem, y = branch.problem, branch.orbit(2 * len(branch) // 5).solution.y
    found = symmetries(cycle_of(problem, y))
    kinds = sorted(e for _, e in found.reversals)
    assert found.cover == 1
    assert (found.half, kinds) == ((True, [-1, -1, 1, 1]) if problem.quarters == 1 else (False, [-1, -1]))
    quarter = branch.points["alpha"][2 * len(branch) // 5]
    instants = [c for c, _ in found.reversals]
    assert np.allclose(np.diff(instants), quarter if problem.quarters == 1 else 2.0 * quarter, rtol=1e-9)


@pytest.mark.parametrize("name", FAMILIES[::2])
def test_the_id_does_not_depend_on_the_cut(name):
    """Oracle: see `require_the_id_does_not_depend_on_the_cut`."""
    require_the_id_does_not_depend_on_the_cut(name)


def require_the_id_does_not_depend_on_the_cut(name):
    """Oracle: the full family's id; ranges of energy, points, one direction, a stop, one orbit alone."""
    branch = traced(name)
    y, h = branch.unknowns(len(branch) // 2), branch.points["h"][len(branch) // 2]
    cuts = [
        {"energy": (0.99 * h, 1.02 * h)},
        {"energy": (0.5 * h, 1.0001 * h)},
        {"points": 1},
        {"points": 2},
        {"points": 17},
        {"direction": "up", "points": 9},
        {"direction": "down"},
        {"stop_when": lambda orbit: True},
        {"energy": (0.05, 1e6)},
    ]
    for options in cuts:
        cut = follow_family(branch.problem, y, **{"energy": (0.05, 1e4), **options})
        assert cut.id == branch.id, options
        for name in ("h", "alpha", "pattern"):
            assert math.isclose(getattr(cut.full_family.marks[0], name), getattr(branch.full_family.marks[0], name), rel_tol=1e-10)


@pytest.mark.parametrize("name", ["S11O00-", "S73O33-", "U8353-", REST])
def test_the_id_does_not_depend_on_the_presentation(name):
    """Oracle: the id of the family as it was found; here it is followed in other presentations, cut or full."""
    branch = traced(name)
    problem, y = branch.problem, branch.orbit(2 * len(branch) // 5).solution.y
    for words, (other, z) in images(problem, y):
        if name == "S73O33-" and other.periodic:
            continue  # so unstable that Newton's corrections of the whole period do not settle
        if "window" not in words or words in ("window 0 to 2", "window 1 to 3", "window 1 to 2", "window 0 to 6"):
            found = follow_family(other, solved(other, z).y, points=3)
            assert found.id == branch.id, words


def test_the_lowest_end_identifies():
    """Closed form: S13O00+ and S11O00- begin where the linear modes graze; those are their lowest ends."""
    for name, grazing in (("S13O00+", 0.118507810593582), ("S11O00-", 0.0864921894064179)):
        (mark,) = traced(name).full_family.marks
        assert mark.kind == "GR" and math.isclose(mark.h, grazing, rel_tol=1e-13)


def test_the_pattern_of_two_impacts():
    """Oracle by hand: S13O00+ hits the two sides half a period apart; of the four pairs two are an impact with itself, same side (3 e),
    and two are opposite sides at opposite phase (1/e)."""
    branch = traced("S13O00+")
    for point in (0, len(branch) // 2):
        cycle = branch.orbit(point).cycle
        pattern = pattern_of(branch.system, cycle.times / cycle.period, cycle.contact)
        assert math.isclose(pattern, 1.5 * math.e + 0.5 / math.e, rel_tol=1e-9)


def test_numbers_near_a_border_of_rounding_have_both_hashes():
    """Oracle: runs whose numbers differ across a border have a hash in common, and each accepts the other's first."""
    border = 0.1234565
    for distance in (1e-15, 1e-12, 0.5e-9):
        low, high = (FamilyMark("GR", border * (1.0 + sign * distance), 1.7, 2.5) for sign in (-1, 1))
        mine, theirs = digests([low]), digests([high])
        assert mine[0] != theirs[0] and mine[0] in theirs and theirs[0] in mine
    assert len(digests([FamilyMark("GR", border * (1.0 + 3.0 * BORDER), 1.7, 2.5)])) == 1
    text = "GR:1.23457e-01:1.70000e+00:2.50000e+00"
    assert digests([FamilyMark("GR", 0.1234567, 1.7, 2.5)]) == (hashlib.sha256(text.encode()).hexdigest()[:8],)


def test_ends_that_tie_all_name_the_family():
    """Oracle: two marks equal within their error: the ids of both are accepted, whichever comes first."""
    a, b = FamilyMark("GR", 0.3, 1.7, 2.5), FamilyMark("GR", 0.3 * (1 + 1e-12), 1.7, 2.6)
    assert set(digests([a, b])) == set(digests([b, a])) and len(digests([a, b])) == 2


def test_an_id_finds_its_family_again_from_a_cut_branch():
    """Oracle: the branch that gave the id, and its energy."""
    branch = saltus.trace("U8353-", energy=(2.0, 2.2))
    again = saltus.trace(branch.id, energy=(2.1, 2.3))
    assert again.id == branch.id
    (one,), (other,) = (found.orbits_at(energy=2.15) for found in (branch, again))
    assert same_orbit((one.problem, one.solution.y), (other.problem, other.solution.y))


def test_an_id_that_does_not_exist_is_answered_with_those_that_do():
    branch = saltus.trace("S13O00+", energy=(0.2, 0.4))
    wrong = branch.id[:-8] + "0badcafe"
    with pytest.raises(ValueError, match=r"no orbit origin-stop\+::0badcafe found") as caught:
        saltus.trace(wrong, energy=(0.2, 0.4))
    assert branch.id in str(caught.value) and "\n" not in str(caught.value)


def test_pieces_of_a_cut_family():
    """Closed form: below its fold S11O00- has no orbit, and between the fold and its grazing it has two: a range above the fold
    and below the grazing cuts it into two pieces."""
    low, high = 0.072, 0.08
    branch = saltus.trace("S11O00-@h=0.075,alpha=0.975", energy=(low, high))
    (other,) = branch.others
    assert sorted(h for h, _ in other) == pytest.approx([low, high], rel=1e-12)
    full = traced("S11O00-")
    for h, alpha in other:
        orbits = full.orbits_at(energy=h)
        assert min(abs(orbit.alpha / alpha - 1.0) for orbit in orbits) < 1e-3
    assert branch.points["alpha"].max() < min(alpha for _, alpha in other)
    assert "into 2 pieces" in branch.full_family.cut_text()
    assert traced("S11O00-").others == () and traced("S13O00+").others == ()


def test_the_energy_scale_is_that_of_the_first_impacts():
    """Oracle: by hand: k (gap)^2 / 2 of a mass on a spring against a stop, whatever its unit of energy."""
    for k in (1.0, 3e6):
        system = ImpactSystem([[2.0]], [[0.0]], [[k]], [Stop((1.0,), lower=-0.5, upper=0.5)])
        assert math.isclose(energy_scale(system), 0.5 * k * 0.25, rel_tol=1e-12)
