"""Segments of a scan that are recognised as orbits of known families, and those that are not."""

import numpy as np
import pytest

from branches.catalogue.members import KnownFamilies
from branches.search.discovery import discover_orbits
from branches.search.known import boxes_between, recognised
from branches.search.orbit_search import WITHOUT_ORIGIN
from branches.search.starts import ScannedSegment
from branches.tracing import follow_family
from bvp.system import vibro_impact_nes

SYSTEM = vibro_impact_nes()
BOUNDS = {"quarter_period": 3.0, "impacts": 3, "ends": ("origin-origin", *WITHOUT_ORIGIN)}


@pytest.fixture(scope="module")
def families():
    found = discover_orbits(SYSTEM, 0.5, **BOUNDS).orbits
    return [follow_family(orbit.problem, orbit.solution.y, energy=(0.3, 0.9), quarter_period=3.0) for orbit in found]


def place(known, orbit):
    return known.find(orbit.problem, orbit.solution.y)


@pytest.mark.parametrize("energy", [0.37, 0.52, 0.81])
def test_a_search_leaves_out_the_orbits_of_known_families_and_no_others(families, energy):
    """Oracle: the comparison of each solved orbit with the curve of each family."""
    every = discover_orbits(SYSTEM, energy, **BOUNDS)
    assert every.complete and len(every.orbits) > 5
    for without in range(len(families) + 1):
        known = KnownFamilies()
        for i, branch in enumerate(families):
            if i != without:
                known.add(str(i), branch)
        rest = [orbit for orbit in every.orbits if place(known, orbit) is None]
        expected = [(orbit.ends, orbit.sequence, pytest.approx(orbit.alpha, rel=1e-12)) for orbit in rest]
        found = discover_orbits(SYSTEM, energy, **BOUNDS, known=known.boxes_at(energy))
        assert [(orbit.ends, orbit.sequence, orbit.alpha) for orbit in found.orbits] == expected and found.complete
        if without < len(families):
            reached = families[without].points["h"]
            assert bool(expected) is bool(reached.min() < energy < reached.max())
        else:
            assert not expected


def segment(ends, sequence, *times):
    zero = np.zeros(4)
    return ScannedSegment(ends, tuple(sequence), zero, np.zeros((len(sequence), 4)), np.array(times), 0.0, 0.0, 0.0, 0.0)


def known(ends, sequence, *pairs):
    return boxes_between({(ends, tuple(sequence)): [np.array(pair, float) for pair in pairs]})


def test_of_two_orbits_in_one_box_none_is_recognised():
    """Oracle: the flight times, which could be of either family."""
    ends = ("origin", "stop+")
    boxes = known(ends, "+", [[1.0, 2.0], [1.1, 2.2]])
    one, near, far = (segment(ends, "+", *times) for times in ((1.05, 2.1), (1.06, 2.1), (1.5, 2.1)))
    assert recognised([one, far], boxes, odd_symmetry=True) == {0}
    assert recognised([one, near, far], boxes, odd_symmetry=True) == set()
    assert recognised([far], boxes, odd_symmetry=True) == set()


def test_two_families_with_one_orbit_between_them_recognise_none():
    ends = ("origin", "stop+")
    one, other = segment(ends, "+", 1.05, 2.1), segment(ends, "+", 1.2, 2.4)
    boxes = known(ends, "+", [[1.0, 2.0], [1.1, 2.2]], [[1.0, 2.0], [1.4, 2.8]])
    assert recognised([one, other], boxes, odd_symmetry=True) == set()


def test_an_orbit_with_two_ends_of_one_kind_is_recognised_from_both_alone():
    """Oracle: run backwards, or mirrored, it has the flight times in the other order, or the other sides."""
    ends, boxes = ("origin", "origin"), known(("origin", "origin"), "++-", [[1.0, 2.0, 3.0, 4.0], [1.1, 2.1, 3.1, 4.1]])
    one, back = segment(ends, "++-", 1.05, 2.05, 3.05, 4.05), segment(ends, "-++", 4.05, 3.05, 2.05, 1.05)
    mirrored, other = segment(ends, "+--", 4.05, 3.05, 2.05, 1.05), segment(ends, "-++", 4.05, 3.05, 2.06, 1.05)
    assert recognised([one, back], boxes, odd_symmetry=True) == {0, 1}
    assert recognised([one, mirrored], boxes, odd_symmetry=True) == {0, 1}
    assert recognised([one, mirrored], boxes, odd_symmetry=False) == set()
    assert recognised([one], boxes, odd_symmetry=True) == set()
    assert recognised([one, other], boxes, odd_symmetry=True) == set()


def test_boxes_of_all_kinds_at_once_are_those_of_each():
    """Oracle: the margins of one family, each written out."""
    two = [[[1.0, 2.0], [1.1, 2.4]], [[3.0, 1.0], [2.0, 1.5]]]
    pairs = {(("origin", "stop+"), ("+",)): two, (("rest", "rest"), ()): [[[5.0], [4.0]]]}
    boxes = boxes_between({kind: [np.array(pair) for pair in some] for kind, some in pairs.items()})
    assert list(boxes) == list(pairs)
    for kind, some in pairs.items():
        for box, (here, there) in zip(boxes[kind], some, strict=True):
            apart = [abs(a - b) for a, b in zip(here, there, strict=True)]
            for low, high, a, b, far in zip(*box, here, there, apart, strict=True):
                margin = 0.5 * far + 0.1 * max(apart) + 1e-6 * max(*here, *there)
                assert (low, high) == pytest.approx((min(a, b) - margin, max(a, b) + margin), rel=1e-14)
    assert boxes_between({}) == {}
