"""Catalogues that are built whole: against discovery at energies between those of the build, their own check, other workers, and a kill."""

import numpy as np
import pytest

import saltus
from branches.building import build as module
from branches.building.build import build
from branches.building.plan import Bounds, BuildPlan
from branches.catalogue import Catalogue
from branches.catalogue.check import check_catalogue
from branches.catalogue.database import CatalogueDamaged, CatalogueError, checksum
from branches.events import DigitWork
from tests.branches.building.agreement import Families, decided_stability
from tests.branches.building.meetings import unanswered
from tests.branches.building.test_frontier import Serial

BOUNDS = Bounds((0.06, 3.0), 2.0, 3)
"""Of a tiny catalogue, which is built several times."""


def built(path, executor, workers=1):
    """A catalogue of the small bounds and the report of its build."""
    with Catalogue(path, "a", scene=saltus.load_scene()) as catalogue:
        return build(catalogue, BuildPlan.within(BOUNDS), executor, workers)


FOLLOWED = []
"""Ids of the families that the build of `tiny` followed, one for each time."""


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    path = tmp_path_factory.mktemp("tiny") / "tiny.sqlite"

    def counted(description, seed, work=module.work):
        answer = work(description, seed)
        FOLLOWED.extend([answer.branch.id] if answer.branch is not None else [])
        return answer

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "work", counted)
        report = built(path, Serial())
    return path, report


def content(path):
    """Everything that a catalogue says, but for when it was made."""
    with Catalogue(path) as catalogue:
        families = [(row.id, tuple(row)) for row in catalogue.families()]
        points = {row.id: catalogue.points(row.id) for row in catalogue.families()}
        return families, points, catalogue.edges(), catalogue.nodes


def test_it_is_complete_and_holds_what_must_be_there(small_scene):
    """Oracle: the backbones of Lee et al. 2009 and the two families that the first one's symmetry breaking gives."""
    path, report = small_scene
    assert report["complete"] and not report["failed"]
    with Catalogue(path) as catalogue:
        labels = {row.label for row in catalogue.families()}
        assert {"S13O00+", "S11O00-"} <= labels
        assert {node.label for node in catalogue.nodes if node.kind == "linear mode"} == {"L11+", "L11-"}
        backbone = next(row for row in catalogue.families() if row.label == "S13O00+")
        edges = [edge for edge in catalogue.edges(backbone.id) if edge.source_event == "SB1"]
        assert len(edges) == 1 and catalogue.family(edges[0].target).ends == "origin-origin"


def test_points_and_edges_hold(small_scene):
    """Oracle: the residual and the bound of admissibility of every point, and the orbit of every edge in both families."""
    with Catalogue(small_scene[0]) as catalogue:
        counts, failures = check_catalogue(catalogue)
    assert not failures and counts["edges"] > 50


def test_every_family_that_begins_at_a_linear_mode_is_joined_to_it(small_scene):
    """Oracle: the grazing energies of the modes, in closed form."""
    with Catalogue(small_scene[0]) as catalogue:
        modes = {node.label: node.h[1] for node in catalogue.nodes if node.kind == "linear mode"}
        joined = [frozenset((edge.source, edge.target)) for edge in catalogue.edges()]
        begin = [
            (row.id, label)
            for row in catalogue.families()
            for event in catalogue.events(row.id)
            for label, h in modes.items()
            if event.type == "GR" and abs(event.h / h - 1.0) < 1e-9
        ]
    assert len(begin) > 2 and all(joined.count(frozenset(pair)) for pair in begin)


def test_every_meeting_has_an_edge_or_a_dead_end(small_scene):
    """Oracle: the events themselves."""
    with Catalogue(small_scene[0]) as catalogue:
        assert unanswered(catalogue, catalogue.families()) == []


def test_branch_points_are_where_the_other_family_has_its_event(small_scene):
    """Oracle: the event on the family from which the other one is born, where the equations are regular."""
    with Catalogue(small_scene[0]) as catalogue:
        events = {row.id: {event.id: event for event in catalogue.events(row.id)} for row in catalogue.families()}
        met = [
            (events[edge.source][edge.source_event], events[edge.target][edge.target_event])
            for edge in catalogue.edges()
            if edge.kind == "switch" and edge.target in events and edge.target_event
        ]
    assert len(met) > 20 and all(there.status == "located" for _, there in met)
    assert all(abs(there.h / here.h - 1.0) < 4e-10 + here.bracket[1] - here.bracket[0] for here, there in met)


def test_stability_is_decided_for_nine_tenths_of_the_points(small_scene):
    """Oracle: a count."""
    assert decided_stability(small_scene[0]) > 0.9


def test_what_fifty_digits_cost_and_missed_events_are_reported(tmp_path, monkeypatch):
    """Oracle: counts: half a second and one orbit for each family that is followed, and an event that each one lacks."""
    from branches import tracing
    from branches.between_events import Missed
    from branches.building import work

    calls = []

    def decided(problem, unknowns, points, barriers):
        calls.append(problem)
        return points["stable"], DigitWork(1, 0.5)

    def missed(branch):
        found = Missed(("RT",), (0, 1), "between the points 0 and 1")
        return [found, found._replace(hidden=True)]

    monkeypatch.setattr(tracing, "decide_between", decided)
    monkeypatch.setattr(work, "missed_events", missed)
    with Catalogue(tmp_path / "counted.sqlite", "a", scene=saltus.load_scene()) as catalogue:
        report = build(catalogue, BuildPlan.within(Bounds((0.06, 0.4), 1.9, 2)), Serial())
        assert catalogue.progress("built")["digits"] == report["digits"]
    assert 0 < report["families"] <= report["digits"]["orbits"] == 2 * report["digits"]["seconds"] <= len(calls)
    assert len(report["missed"]) == report["families"]


@pytest.fixture(scope="module")
def families(small_scene):
    return Families(small_scene[0])


@pytest.mark.parametrize("energy", [0.0701, 0.377, 2.3, 14.1, 71.0])
def test_orbits_and_families_agree_one_to_one(families, energy):
    """Oracle: discovery against the families that cross the energy."""
    families.agree(saltus.load_scene().system, energy, 3.0, 6)


def test_a_family_is_followed_once(tiny):
    """Oracle: a count of what the worker follows: the families of the catalogue, none of them again, though searches at 33 energies, two
    modes and each bifurcation and grazing lead to them. Seeds that are worked on ahead of their turn count, too."""
    assert sorted(FOLLOWED) == sorted(id for id, _ in content(tiny[0])[0]) and len(FOLLOWED) > 10


@pytest.mark.parametrize("value", ["[]", "null", "{}", "3", '"x"'])
@pytest.mark.parametrize("place", ["report", "plan", "unfolded 0000001", "work"])
def test_a_build_that_cannot_be_gone_on_with_says_so(tmp_path, place, value):
    """Oracle: one line that names the file, whatever stands in place of what a build had noted; with a checksum that fits, as the rows of
    catalogues from before there were any get."""
    path, plan = tmp_path / "cut.sqlite", BuildPlan.within(BOUNDS)
    with Catalogue(path, "a", scene=saltus.load_scene()) as catalogue:
        catalogue.note("plan", plan.plain())
        begun = {"level": 0, "families": 0}
        catalogue.note("report", {"beyond": 0, "failed": [], "halves": 0, "lost": [], "incomplete": [], "levels": [], "begun": begun})
        catalogue.note("unfolded 0000001", [None, False, 2])
        catalogue.add_work([("0000002", {"kind": "name", "value": "S13+", "wide": False, "further": None, "link": None})])
        table, key = ("work", "0000002") if place == "work" else ("progress", place)
        with catalogue.transaction():
            catalogue._connection.execute(f"UPDATE {table} SET value = ?, crc = ? WHERE key = ?", (value, checksum((key, value)), key))
        with pytest.raises(CatalogueError, match="cut.sqlite") as caught:
            build(catalogue, plan, Serial())
        assert isinstance(caught.value, CatalogueDamaged) and "\n" not in str(caught.value)


def test_another_plan_is_refused(tiny):
    """Oracle: the catalogue stays as it was, and the message names both."""
    other = BuildPlan.within(Bounds((0.06, 3.0), 2.0, 4))
    before = content(tiny[0])
    with Catalogue(tiny[0], "a", scene=saltus.load_scene()) as catalogue, pytest.raises(CatalogueError, match="3 impacts.*4 impacts"):
        build(catalogue, other, Serial())
    after = content(tiny[0])
    assert after[0] == before[0] and after[2:] == before[2:]


def test_saved_families_that_were_started_outside_the_limits(tmp_path):
    """Oracle: the catalogue of a build into a new file. One family reaches into the limits, and is followed from there; one does not, and
    is refused with the file left as it was."""
    plan, scene = BuildPlan.within(Bounds((0.06, 0.4), 1.9, 2)), saltus.load_scene()
    across = saltus.trace("S13O00+@h=0.5", scene.system, energy=(0.3, 0.6))
    beyond = saltus.trace("S13O00+@h=2", scene.system, energy=(1.5, 2.5))
    reports, ranges = [], []
    for name in ("new", "saved"):
        with Catalogue(tmp_path / f"{name}.sqlite", "a", scene=scene) as catalogue:
            if name == "saved":
                catalogue.add(across)
            reports.append(build(catalogue, plan, Serial()))
            ranges.append({row.id: row.h for row in catalogue.families()})
    assert not reports[1]["failed"] and reports[1]["families"] == reports[0]["families"]
    for id, energies in ranges[0].items():
        np.testing.assert_allclose(ranges[1][id], energies, rtol=1e-9)
    path = tmp_path / "refused.sqlite"
    with Catalogue(path, "a", scene=scene) as catalogue:
        catalogue.add(beyond)
    before = content(path)
    with Catalogue(path, "a", scene=scene) as catalogue, pytest.raises(CatalogueError, match=r"holds the family .* 1\.5:2\.5.*another"):
        build(catalogue, plan, Serial())
    assert content(path)[0] == before[0] and content(path)[2:] == before[2:]


def test_named_families_are_followed_beyond_the_bounds(tmp_path):
    """Oracle: the name's own search. U2211- has two impacts in half a period, the bounds one; its neighbours have more than one, too."""
    plan = BuildPlan(Bounds((0.06, 0.9), 1.9, 1), Bounds((0.06, 0.9), 1.9, 5), ("U2211-",))
    with Catalogue(tmp_path / "named.sqlite", "a", scene=saltus.load_scene()) as catalogue:
        report = build(catalogue, plan, Serial())
        assert not report["failed"]
        named = catalogue.find("U2211-")
        expected = saltus.trace("U2211-", saltus.load_scene().system, energy=(0.06, 0.9))
        assert named.id == expected.id
        beyond = {row.id for row in catalogue.families() if row.impacts > 1} - {named.id}
        joined = {id for edge in catalogue.edges(named.id) for id in (edge.source, edge.target)}
        assert beyond and beyond <= joined


@pytest.mark.parametrize(
    ("energy", "alpha", "impacts", "said"),
    [((1.0, 0.5), 2.0, 3, "reversed"), ((0.1, 1.0), -1.0, 3, "quarter period"), ((0.1, 1.0), 1.0, 0, "impacts")],
)
def test_bounds_that_cannot_be(energy, alpha, impacts, said):
    with pytest.raises(ValueError, match=said):
        Bounds(energy, alpha, impacts)
