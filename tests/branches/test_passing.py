"""Runs that are stuck beside branch points: the longest of several, and families of which one side is the image of the other."""

import numpy as np
import pytest

import saltus
from branches.building.work import _followed, is_half
from branches.catalogue.members import kept_orbit, unknowns_of
from branches.full_family import PARTS, Course, longest_course
from branches.presentation import embed, first_of, presentations, symmetries
from branches.sequences import parse_sequence
from branches.switching import emanating_families
from branches.tracing import SETTINGS, follow_family
from bvp.closures import cycle_of
from bvp.multipoint import MultipointProblem


def test_runs_start_elsewhere_until_none_is_stuck():
    """Oracle: the lengths that are given."""
    asked = []

    def longest(stuck, lengths):
        """The length of the longest of some runs, of which those numbered in `stuck` are stuck."""
        asked.clear()

        def follow(start, settings):
            asked.append(float(start[0]))
            number = len(asked) - 1
            # Three points: too few to have gone over to another family.
            return Course(number, np.array([0.0, 0.5, 1.0]) * lengths[number], lambda i: np.array([0.5 * i]), number in stuck)

        return longest_course(None, follow, np.array([-1.0]), SETTINGS).length

    assert longest({0, 1}, (1.0, 0.5, 2.0)) == 2.0 and len(asked) == 3
    assert longest(set(), (3.0,)) == 3.0 and asked == [-1.0]
    assert longest({0, 1, 2, 3}, (2.0, 1.0, 1.0, 1.0)) == 2.0 and len(asked) == 1 + len(PARTS)


def test_a_family_beside_its_symmetry_breaking_is_a_half():
    """Oracle: the family with U1110+ at h = 0.5 is born where S13O00+ loses its half-period symmetry, at its own lowest energy
    0.4555854652; at its other end it grazes, and has no more symmetry than elsewhere."""
    born = saltus.trace("U1110+@h=0.5", energy=(0.3, 0.8))
    beside = born.trace(len(born) - 3, direction="down", stop_when=lambda orbit: orbit.h < 0.455588)
    lower = 0 if beside.points["h"][0] < beside.points["h"][-1] else 1
    assert beside.ended[lower].reason == "STOP_WHEN"
    assert is_half(beside, lower) and not is_half(beside, 1 - lower)


@pytest.mark.parametrize(
    ("energy", "ends", "words", "limits", "born"),
    [
        (10.0, "rest-stop", ("-++--++++", "++++--++-"), (9.7, 13.0), 9.7452144),
        (21.3, "origin-origin", ("++-+--++", "++--+-++", "--+-++--", "--++-+--"), (19.0, 27.0), 21.2657745),
    ],
)
def test_steps_that_leave_a_family_at_a_branch_point_are_made_finer(energy, ends, words, limits, born):
    """Oracle: the symmetries: a family without a reversal meets one with a reversal at one point, and has none on either side of it."""
    system = saltus.vibro_impact_nes()
    found = saltus.discover(system, energy, quarter_period=5.1, impacts=10, ends=(ends,))
    starts = [orbit for orbit in found.orbits if orbit.sequence in words]
    branches = [follow_family(o.problem, o.solution.y, energy=limits, quarter_period=5.1) for o in starts]
    old, event = next((b, e) for b in branches for e in b.events if e.breaks == "reversal" and abs(e.h / born - 1.0) < 1e-6)
    (family,) = emanating_families(old, event)
    crossed = embed(old.problem, old.unknowns(event.point), 1)
    before, after = (symmetries(cycle_of(family.problem, y)).order for y in (family.step.y, crossed.unknowns(family.problem)))
    assert before != after
    orbit = kept_orbit(system, first_of(presentations(family.problem, family.step.y)))
    problem = MultipointProblem(system, orbit.ends, parse_sequence(orbit.sequence))
    y = unknowns_of(problem, orbit)
    branch = _followed(problem, y, limits, 5.1)
    first, last = (symmetries(cycle_of(problem, branch.unknowns(i))).order for i in (1, len(branch) - 2))
    assert first == last
    between = [i for i in range(len(branch)) if i not in {event.point for event in branch.events}]
    for place in (between[len(between) // 4], between[3 * len(between) // 4]):
        assert not symmetries(cycle_of(problem, branch.unknowns(place))).reversals
    assert branch.points["h"].min() == pytest.approx(event.h, rel=1e-6)
    assert branch.id != old.id and branch.id.startswith("periodic:")

