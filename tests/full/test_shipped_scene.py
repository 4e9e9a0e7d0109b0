"""The reference scene, built whole as it ships. Takes minutes, and is run apart: `python -m pytest tests/full`."""

import json

import pytest

import saltus
from branches.building.plan import Bounds
from branches.catalogue import Catalogue
from branches.catalogue.check import check_catalogue
from branches.naming.families import resolve
from branches.naming.search import search_bounds
from saltus.__main__ import main
from tests.branches.building.agreement import Families, decided_stability
from tests.branches.building.meetings import unanswered
from tests.full.frozen import read, record, unlike

SCENE = saltus.load_scene()
COMPLETE = SCENE.complete

FEW = 2
"""Families, of more than two thousand, at whose branch points the rounding of one processor may hide an event. Here there are none."""


def test_it_is_complete_and_nothing_failed(built):
    """Oracle: the build's own account. Of over 20,000 events two symmetry breakings at most give no new family: where tau is 2 within 1e-11
    all along, rounding can make a sign change."""
    _, report, code = built
    assert report["failed"] == [] and code == 0
    assert report["complete"] and report["levels"][-1]["new"] == 0
    assert report["open"] == []
    assert len(report["lost"]) <= FEW and len(report["missed"]) <= FEW


def test_families_and_events_are_the_frozen_ones(built):
    """Oracle: the record of an earlier build, which `tests/full/frozen.py` describes."""
    found, frozen = record(built[0]), read()
    assert unlike(found, frozen) == []
    assert sum(line.points for line in found) == pytest.approx(sum(line.points for line in frozen), rel=0.01)


@pytest.mark.parametrize("change", [{"h": 2e-9}, {"alpha": -2e-9}, {"label_h": 2e-7}, {"events": "BP1 GR3"}, {"label": "S13O00-"}])
def test_a_change_of_one_family_is_noticed(change):
    """Oracle: by hand: one sentence, about this family; two where the id is another one."""
    frozen = read()
    first = frozen[0]
    sums = {name: getattr(first, name) + value if isinstance(value, float) else value for name, value in change.items()}
    (text,) = unlike([first._replace(**sums), *frozen[1:]], frozen)
    assert text.startswith(first.id)
    assert len(unlike([first._replace(id="origin-rest:?:0"), *frozen[1:]], frozen)) == 2 and unlike(frozen, frozen) == []


def test_every_point_and_edge_holds(built):
    """Oracle: residual below 1e-12, the bound of admissibility, constant energy; each edge's orbit solves both problems to 1e-10; tau and h
    cross no level without an event."""
    with Catalogue(built[0]) as catalogue:
        counts, failures = check_catalogue(catalogue)
    missed = [failure for failure in failures if "is missed between" in failure.text]
    assert [failure for failure in failures if failure not in missed] == []
    assert len({failure.where for failure in missed}) <= FEW
    assert counts["families"] > 1000 and counts["edges"] > 2000


def test_every_meeting_has_an_edge_or_a_dead_end(built):
    """Oracle: the events themselves."""
    with Catalogue(built[0]) as catalogue:
        assert unanswered(catalogue, catalogue.families(), longest=COMPLETE["quarter_period"]) == []


def test_a_family_has_the_branch_point_that_it_is_born_at(built):
    """Oracle: the edges of symmetry breakings, doublings and q-tuplings: the family at their other end has a branch point there."""
    with Catalogue(built[0]) as catalogue:
        crossed = {row.id: [event.h for event in catalogue.events(row.id) if event.type == "BP"] for row in catalogue.families()}
        births = [edge for edge in catalogue.edges() if edge.kind == "switch" and edge.type in ("SB", "PD", "RT")]
    without = [edge for edge in births if not any(abs(h / edge.h - 1.0) < 1e-8 for h in crossed[edge.target])]
    assert len({edge.target for edge in without}) <= FEW and len(births) > 900


@pytest.mark.parametrize("name", SCENE.names)
def test_direct_neighbours_of_named_families_are_there(built, name):
    """Oracle: the events of the family, with the period doublings and q-tuplings whose new orbits lie in the wider bounds."""
    wide = Bounds(COMPLETE["energy"], SCENE.quarter_period, SCENE.impacts)
    with Catalogue(built[0]) as catalogue:
        assert unanswered(catalogue, [catalogue.family(catalogue.find(name).id)], wide) == []


@pytest.mark.parametrize(("first", "last"), [("S13+", "S73O33-"), ("S11-", "U8353-"), ("S13+", "U(15)578-")])
def test_families_of_the_paper_are_joined(built, first, last, capsys):
    """Oracle: the edges of the chain lead from each node to the next."""
    assert main(["path", first, last, "--catalogue", str(built[0]), "--json", "-"]) == 0
    record = json.loads(capsys.readouterr().out)
    chain = [node["id"] for node in record["nodes"]]
    assert [{edge["source"], edge["target"]} for edge in record["edges"]] == [set(pair) for pair in zip(chain, chain[1:], strict=False)]


def test_stability_is_decided_for_nine_tenths_of_the_points(built):
    """Oracle: a count."""
    assert decided_stability(built[0]) > 0.9


@pytest.fixture(scope="module")
def families(built):
    return Families(built[0])


@pytest.mark.parametrize("energy", [0.0777, 0.613, 4.21, 17.9, 58.3])
def test_orbits_and_families_agree_one_to_one(families, energy):
    """Oracle: discovery against the families that cross the energy."""
    families.agree(SCENE.system, energy, COMPLETE["quarter_period"], COMPLETE["impacts"])


@pytest.mark.parametrize("name", SCENE.reference_points)
def test_the_named_families_are_there(built, name):
    """Oracle: the cited point of the scene lies on the family that the name stands for."""
    pin = SCENE.reference_points[name]
    with Catalogue(built[0]) as catalogue:
        branch = catalogue.branch(catalogue.find(name).id)
    assert min(abs(orbit.alpha / pin["alpha"] - 1.0) for orbit in branch.orbits_at(energy=pin["h"])) < 1e-3


def test_each_id_is_a_name_without_the_catalogue(built):
    """Oracle: the ids of the build, each at the energies of its family."""
    limits = search_bounds(SCENE.bounds)
    with Catalogue(built[0]) as catalogue:
        rows = [row for row in catalogue.families() if row.ends != "periodic"]
    for row in rows:
        assert row.id in resolve(row.id, SCENE.system, reference_points={}, limits=limits, energy=row.h)[1].full_family.ids
    assert len(rows) > 1000


def test_ids_without_a_reversal_are_names_without_the_catalogue(built):
    """Oracle: the ids of the build and the orbits of its families, each tenth one."""
    limits = search_bounds(SCENE.bounds)
    with Catalogue(built[0]) as catalogue:
        rows = [row for row in catalogue.families() if row.ends == "periodic"][::10]
        for row in rows:
            orbit, branch = resolve(row.id, SCENE.system, reference_points={}, limits=limits, energy=row.h)
            alphas = [kept.alpha for kept in catalogue.branch(row.id).orbits_at(energy=orbit.h)]
            assert row.id in branch.full_family.ids and min(abs(alpha / orbit.alpha - 1.0) for alpha in alphas) < 1e-9
    assert len(rows) > 100


def test_a_second_build_has_nothing_to_do(built, capsys):
    """Oracle: the families of the first one."""
    before = len(Catalogue(built[0]))
    assert main(["build", "--catalogue", str(built[0])]) == 0
    assert f"{before} families" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["U2201+", "U3201-", "U4421+", "U5421-", "U5511+", "S95E22-", "U44-"])
def test_named_families_are_joined_to_the_linear_mode_at_which_they_begin(built, name):
    """Oracle: what the paper says of them (docs/reference/paper.md)."""
    with Catalogue(built[0]) as catalogue:
        id = catalogue.find(name).id
        assert any({edge.source, edge.target} & {"L11+", "L11-"} for edge in catalogue.edges(id))
