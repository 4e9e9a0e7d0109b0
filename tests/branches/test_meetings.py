"""Orbits by the meetings of their halves, and searches that are closed by them."""

from collections import Counter

import numpy as np
import pytest
from saltus_core import Arc, MeetingSearch, are_apart, boxes_apart, turn_between

from branches.catalogue.members import KnownFamilies
from branches.search import discovery, meetings
from branches.search.discovery import discover_orbits
from branches.search.meetings import met_segments, nothing_new
from branches.search.orbit_search import CLASSES, WITHOUT_ORIGIN, OrbitSearch
from branches.sequences import canonical_sequence
from branches.tracing import follow_family
from bvp.system import ImpactSystem, Stop, vibro_impact_nes

SYSTEM = vibro_impact_nes()
ONE_SIDED = ImpactSystem([[1.0, 0.0], [0.0, 0.6]], [[0.0, 0.0], [0.0, 0.0]], [[1.5, -0.4], [-0.4, 0.9]], [Stop((1.0, -1.0), upper=0.7)])
UNEQUAL = ImpactSystem(
    [[1.0, 0.0], [0.0, 0.6]], [[0.0, 0.0], [0.0, 0.0]], [[1.5, -0.4], [-0.4, 0.9]], [Stop((0.3, 1.0), upper=0.7, lower=-1.1)]
)


def searched(system):
    """All pairs of ends of a system, as a build asks for them, and as the scan takes them."""
    ends = ("origin-origin", *WITHOUT_ORIGIN) if system.has_odd_symmetry else WITHOUT_ORIGIN
    return ends, sorted({part for name in ends for part in CLASSES[name] if system.has_odd_symmetry or "origin" not in part})


def kinds_of(ends):
    return tuple(end.rstrip("+-") for end in ends)


MET = [
    (SYSTEM, 0.3, 5.1, 10),
    (SYSTEM, 1.0, 5.1, 10),
    (SYSTEM, 30.0, 3.0, 6),
    (SYSTEM, 90.0, 3.0, 5),
    (vibro_impact_nes(0.37, 0.81), 5.0, 5.0, 7),
    (ONE_SIDED, 3.0, 5.0, 5),
    (ONE_SIDED, 6.0, 6.0, 8),
    (UNEQUAL, 2.0, 4.0, 5),
    (UNEQUAL, 3.0, 3.0, 2),
]
"""Systems, each with an energy, the longest quarter period and the most impacts."""


@pytest.mark.parametrize(("system", "energy", "quarter_period", "impacts"), MET)
def test_each_orbit_is_met_from_both_its_ends_and_no_other_motion(system, energy, quarter_period, impacts):
    """Oracle: see `require_each_orbit_is_met_from_both_its_ends_and_no_other_motion`."""
    require_each_orbit_is_met_from_both_its_ends_and_no_other_motion(system, energy, quarter_period, impacts)


def require_each_orbit_is_met_from_both_its_ends_and_no_other_motion(system, energy, quarter_period, impacts):
    """Oracle: the complete scan, which follows each start through the whole segment."""
    ends, wanted = searched(system)
    found = discover_orbits(system, energy, quarter_period=quarter_period, impacts=impacts, ends=ends)
    assert found.complete and len(found.orbits) > 5
    expected, times = [], []
    for orbit in found.orbits:
        kind = canonical_sequence(orbit.problem.sequence, orbit.problem.ends, odd_symmetry=system.has_odd_symmetry)
        first, last = kinds_of(orbit.problem.ends)
        expected += [(str(kind), orbit.alpha)] * (1 + (first == last))
        times.append(orbit.problem.flight_times(orbit.solution.y))
    met, counts = met_segments(system, energy, wanted, quarter_period, impacts)
    assert met is not None and counts["undecided"] == 0 and counts["met"] >= len(found.orbits)
    mine = []
    for segment in met:
        kind = canonical_sequence(segment.sequence, segment.ends, odd_symmetry=system.has_odd_symmetry)
        mine.append((str(kind), segment.alpha))
        assert any(
            len(other) == len(segment.flight_times)
            and (np.allclose(segment.flight_times, other, atol=1e-7) or np.allclose(segment.flight_times[::-1], other, atol=1e-7))
            for other in times
        )
    (kinds, alphas), (exact, theirs) = zip(*sorted(mine), strict=True), zip(*sorted(expected), strict=True)
    assert kinds == exact and alphas == pytest.approx(theirs, abs=1e-8)


@pytest.mark.parametrize(
    ("system", "energy", "quarter_period", "impacts", "clearance"),
    [
        (SYSTEM, 0.6042481981963775, 3.0, 3, 4e-6), (SYSTEM, 0.6042488018409312, 3.0, 3, 4e-9),
        (UNEQUAL, 2.4028485278714795, 3.0, 4, 1e-6),
    ],
)  # fmt: skip
def test_an_orbit_that_nearly_grazes_is_met(system, energy, quarter_period, impacts, clearance):
    """Oracle: the complete scan. Starts next to that of this orbit hit the stop at the grazing, and go elsewhere."""
    ends, wanted = searched(system)
    found = discover_orbits(system, energy, quarter_period=quarter_period, impacts=impacts, ends=ends)
    near = [orbit for orbit in found.orbits if orbit.solution["clearance"] < clearance]
    met, _ = met_segments(system, energy, wanted, quarter_period, impacts)
    assert found.complete and len(near) == 1 and met is not None
    assert any(segment.alpha == pytest.approx(near[0].alpha, abs=1e-8) for segment in met)


@pytest.fixture(scope="module")
def scanned():
    """The arcs of all searched curves, and what their starts are followed with."""
    found = []

    class Watched(MeetingSearch):
        def __init__(self, curves, gone, *limits):
            super().__init__(curves, gone, *limits)
            self.gone = gone

        def run(self, arcs):
            found.append((self, [arc for some in arcs for arc in some]))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(meetings, "MeetingSearch", Watched)
        for energy in (1.0, 10.0, 60.0):
            met_segments(SYSTEM, energy, searched(SYSTEM)[1], 5.1, 10)
    return found


def test_arcs_stay_within_their_bounds(scanned):
    """Oracle: starts inside the intervals, which are followed. Bounds that are drawn from samples fail where rounding decides."""
    rng = np.random.default_rng(3)
    total, beyond, largest = 0, 0, 0.0
    for search, arcs in scanned:
        for arc in (arcs[i] for i in rng.choice(len(arcs), 1500)):
            if search.gone[arc.curve]:
                continue
            for u in rng.uniform(-1.0, 1.0, 3).tolist():
                arrives, value, rate, flights = search.follow_arc(arc, u)
                assert arrives
                if arc.impacts > 0:
                    last = flights[arc.impacts - 1]
                    assert arc.left[0] <= last.time <= arc.left[1]
                    assert arc.arrived[0] <= last.time + last.duration <= arc.arrived[1]
                a, m, b = arc.rates
                parabola = m + 0.5 * u * (b - a) + u * u * (0.5 * (a + b) - m)
                assert np.all(np.abs(np.array(value) - arc.model(u)[0]) <= arc.miss)
                assert np.all((arc.box[:, 0] <= value) & (value <= arc.box[:, 1]))
                parts = np.abs(rate - parabola) / (arc.error + 1e-12)
                total, beyond, largest = total + 3, beyond + int(np.sum(parts > 1.0)), max(largest, float(parts.max()))
    assert total > 30_000 and beyond < 1e-3 * total and largest < 3.0


def arc_of(polynomials):
    """An arc whose coordinates are cubics of u: (3, 4) coefficients."""
    u = np.array([-1.0, 0.0, 1.0])
    values, rates = (np.array([np.polyval(f(p), u) for p in polynomials]).T.tolist() for f in (np.asarray, np.polyder))
    return Arc(values, rates)


def crossings_of(one, other):
    """Crossings of two plane polygons (N, 2), by the signs of areas."""
    a, b, c, d = one[:-1, None], one[1:, None], other[None, :-1], other[None, 1:]

    def side(p, q, r):
        return (q - p)[..., 0] * (r - p)[..., 1] - (q - p)[..., 1] * (r - p)[..., 0] > 0.0

    return int(np.count_nonzero((side(a, b, c) != side(a, b, d)) & (side(c, d, a) != side(c, d, b))))


@pytest.mark.parametrize("chart", [(0, 1)])
def test_arcs_that_are_apart_do_not_cross_and_those_that_turn_apart_cross_once_at_most(chart):
    """Oracle: see `require_arcs_that_are_apart_do_not_cross_and_those_that_turn_apart_cross_once_at_most`."""
    require_arcs_that_are_apart_do_not_cross_and_those_that_turn_apart_cross_once_at_most(chart)


def require_arcs_that_are_apart_do_not_cross_and_those_that_turn_apart_cross_once_at_most(chart):
    """Oracle: dense polygons along random cubics."""
    rng = np.random.default_rng(5)
    u = np.linspace(-1.0, 1.0, 120)
    mirror = np.array([1.0, -1.0, 1.0])
    verdicts, crossed = Counter(), 0
    for _ in range(500):
        size = 10.0 ** rng.uniform(-1.5, 0.3)
        polynomials = rng.normal(size=(2, 3, 4)) * np.array([0.3 * size**2, 0.5 * size, 1.0, 0.8]) * size
        a, b = (arc_of(p) for p in polynomials)
        one, other = (np.stack([np.polyval(p[c], u) for c in chart], axis=1) for p in polynomials)
        count = crossings_of(one, other * mirror[list(chart)])
        apart, turned = are_apart(a, b, chart), turn_between(a, b, chart)
        space = [np.stack([np.polyval(p[c], u) for c in range(3)]) for p in polynomials]
        if boxes_apart(a, b):
            ends = [(points.min(axis=1), points.max(axis=1)) for points in (space[0], mirror[:, None] * space[1])]
            assert np.any((ends[0][0] > ends[1][1]) | (ends[1][0] > ends[0][1]))
        assert not (apart and count)
        assert count <= 1 or turned == 0.0
        verdicts[apart, turned != 0.0] += 1
        crossed += count == 1 and turned != 0.0
    assert min(verdicts.values()) > 15 and len(verdicts) == 4 and crossed > 15


BOUNDS = {"quarter_period": 3.0, "impacts": 3}


@pytest.fixture(scope="module")
def families():
    found = discover_orbits(SYSTEM, 0.5, **BOUNDS, ends=searched(SYSTEM)[0]).orbits
    return [follow_family(orbit.problem, orbit.solution.y, energy=(0.3, 0.9), quarter_period=3.0) for orbit in found]


def boxes(families, energy, without=None):
    known = KnownFamilies()
    for i, branch in enumerate(families):
        if i != without:
            known.add(str(i), branch)
    return known.boxes_at(energy)


@pytest.mark.parametrize("energy", [0.37, 0.52, 0.81])
def test_a_search_is_closed_if_all_families_are_known_and_only_then(families, energy):
    wanted = searched(SYSTEM)[1]
    assert nothing_new(SYSTEM, energy, wanted, 3.0, 3, boxes(families, energy)) is not None
    for without in range(len(families)):
        reached = families[without].points["h"]
        closed = nothing_new(SYSTEM, energy, wanted, 3.0, 3, boxes(families, energy, without))
        assert (closed is None) == bool(reached.min() < energy < reached.max())


def test_a_search_is_open_if_a_known_family_is_not_met(families):
    """Oracle: a family whose orbit is not there; one that is beyond the bounds need not be."""
    wanted, known = searched(SYSTEM)[1], dict(boxes(families, 0.5))
    kind = next(kind for kind in known if len(kind[1]) == 2)
    known[kind] = np.concatenate([known[kind], known[kind][:1] + 0.3])
    assert nothing_new(SYSTEM, 0.5, wanted, 3.0, 3, known) is None
    known[kind] = np.concatenate([known[kind][:-1], known[kind][:1] + 30.0])
    assert nothing_new(SYSTEM, 0.5, wanted, 3.0, 3, known) is not None


def test_a_closed_search_is_not_scanned_and_an_open_one_is(families, monkeypatch):
    """Oracle: the complete scan, whose result does not depend on what was tried before it."""
    ends, known = searched(SYSTEM)[0], boxes(families, 0.52)
    scanned, scans = OrbitSearch.scanned, []
    monkeypatch.setattr(OrbitSearch, "scanned", lambda *arguments: scans.append(0) or scanned(*arguments))
    found = discover_orbits(SYSTEM, 0.52, **BOUNDS, ends=ends, known=known)
    assert not scans and found.complete and not found.orbits and found.counts["starts"] > 100
    expected = discover_orbits(SYSTEM, 0.52, **BOUNDS, ends=ends, known=known | {(("origin", "rest"), ()): np.zeros((1, 2, 1))})
    assert scans and expected.complete and not expected.orbits
    for name, value in (("MOST", 3), ("BUDGET", 50)):
        scans.clear()
        with monkeypatch.context() as patch:
            patch.setattr(meetings, name, value)
            again = discover_orbits(SYSTEM, 0.52, **BOUNDS, ends=ends, known=known)
        assert scans and again.counts == expected.counts and again.complete and not again.orbits
    monkeypatch.setattr(discovery, "nothing_new", lambda *_: None)
    assert discover_orbits(SYSTEM, 0.52, **BOUNDS, ends=ends, known=known).counts == expected.counts


def test_a_system_without_a_stiffness_along_the_stop_is_scanned():
    """Oracle: the scan of starts at the origin. The starts at rest and at a stop are not bounded there, so halves cannot meet."""
    system = ImpactSystem(
        [[1.0, 0.0], [0.0, 0.5]], [[0.0, 0.0], [0.0, 0.0]], [[1.0, -1.0], [-1.0, 1.0]], [Stop((1.0, -1.0), upper=1.0, lower=-1.0)]
    )
    known = {(("origin", "rest"), ("+",)): np.ones((1, 2, 2))}
    found, expected = (discover_orbits(system, 2.0, **BOUNDS, known=boxes) for boxes in (known, None))
    assert expected.complete and len(expected.orbits) == 1 and found.counts == expected.counts
