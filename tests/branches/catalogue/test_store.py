"""The catalogue as a store: what goes in comes out to the last bit, and its graph does not depend on the order of filling."""

import dataclasses
import os
import pickle

import numpy as np
import pytest

import saltus
from branches.catalogue import CatalogueError, Edge, EventOrbit, Node
from branches.catalogue.catalogue import graph_of
from branches.catalogue.members import switch_edge
from branches.catalogue.rows import event_from_row, event_values
from branches.events import BranchEvent
from branches.normal_forms import with_normal_forms
from saltus.commands.tree import _Tree
from tests.branches.catalogue.families import real, renamed, rows, same_columns, scene

FAMILY_TABLES = ("families", "points", "arrays", "events")


@pytest.fixture
def path(tmp_path):
    with saltus.Catalogue(tmp_path / "real.sqlite", "a", scene=scene()) as catalogue:
        for branch in real():
            catalogue.add(branch)
    return tmp_path / "real.sqlite"


def test_a_family_comes_back_bit_for_bit(path):
    """Oracle: the branch that was added."""
    with saltus.Catalogue(path) as catalogue:
        assert len(catalogue) == len(real())
        for branch in real():
            back = catalogue.branch(branch.id)
            assert same_columns(branch.points, back.points)
            assert back.events == branch.events and back.ended == branch.ended and back.start == branch.start
            assert (back.id, back.label, back.ends, back.sequence) == (branch.id, branch.label, branch.ends, branch.sequence)
            assert "full_family" not in back.__dict__, "it was followed for its id"
            assert back.full_family.ids == branch.full_family.ids


@pytest.mark.parametrize("how", ["read", "packed by a worker"])
def test_a_family_read_or_packed_elsewhere_is_the_family_added(path, tmp_path, how):
    """Oracle: the same rows, byte by byte, in a second catalogue: of the branches that the first one gives, or of what another process
    packs."""
    with saltus.Catalogue(path) as catalogue, saltus.Catalogue(tmp_path / "copy.sqlite", "a", scene=scene()) as copy:
        for branch in real():
            copy.add(catalogue.branch(branch.id) if how == "read" else pickle.loads(pickle.dumps(saltus.pack_family(branch))))
    assert rows(path, *FAMILY_TABLES) == rows(tmp_path / "copy.sqlite", *FAMILY_TABLES)


def test_every_field_of_an_event_survives(path):
    """Oracle: the events that were added, field by field, among them impulsive orbits; one with every field set, and one
    without any that may be missing."""
    with saltus.Catalogue(path) as catalogue:
        kept = [(event, back) for branch in real() for event, back in zip(branch.events, catalogue.events(branch.id), strict=True)]
    assert {"IO", "GR", "SB", "EP"} <= {back.type for _, back in kept}
    located = ("located", (2.4, 2.6), 1e-13)
    full = BranchEvent("RT2", "RT", 7, -3, 0.5, 1.7, 2.5, *located, "S13O00+", "+", [1, 5], "half", "a note", False, 1.0)
    bare = full._replace(stop=None, p_q=None, breaks=None, note=None, stable=None, multiplier=None)
    for event, back in (*kept, (full, event_from_row(event_values(full))), (bare, event_from_row(event_values(bare)))):
        for name, value in event._asdict().items():
            assert getattr(back, name) == value or value != value, name
        assert isinstance(back.bracket, tuple) and (back.stable is None or isinstance(back.stable, bool))


def test_normal_forms_are_kept(path, tmp_path):
    """Oracle: the branches that were added, one with normal forms and the others without."""
    branch = with_normal_forms(real()[0])
    assert branch.event("SB1").criticality == "subcritical"
    with saltus.Catalogue(tmp_path / "one.sqlite", "a", scene=scene()) as catalogue:
        catalogue.add(branch)
        assert catalogue.events(branch.id) == branch.events == catalogue.branch(branch.id).events
    with saltus.Catalogue(path) as catalogue:
        assert all(event.coefficient is event.criticality is None for one in real() for event in catalogue.events(one.id))


def test_odd_numbers_survive(tmp_path):
    """Oracle: the bits, in a column of the table of points: a negative zero, an infinity, a NaN, the smallest number."""
    branch = real()[0]
    points = {name: values.copy() for name, values in branch.points.items()}
    points["tau"][:4] = [-0.0, np.inf, np.nan, 5e-324]
    branch = dataclasses.replace(branch, points=points)
    with saltus.Catalogue(tmp_path / "odd.sqlite", "a", scene=scene()) as catalogue:
        id = catalogue.add(branch)
        back = catalogue.points(id)
    assert same_columns(points, back)
    assert np.signbit(back["tau"][0])


def test_a_point_takes_little_room(path, tmp_path):
    """Oracle: less than 140 bytes for a point of few impacts, with events and names, where the numbers of a point alone are 256 bytes and
    more."""
    with saltus.Catalogue(path) as catalogue:
        points = sum(row.points for row in catalogue.families())
    saltus.Catalogue(tmp_path / "empty.sqlite", "a", scene=scene()).close()
    assert (os.path.getsize(path) - os.path.getsize(tmp_path / "empty.sqlite")) / points < 140


def test_columns_can_be_asked_for_in_sql(path):
    """Oracle: numpy on the branch."""
    points = real()[0].points
    where = f"points p JOIN families f ON p.family = f.number WHERE f.id = '{real()[0].id}'"
    (((low, high, stable),),) = rows(path, f"(SELECT min(p.h), max(p.h), sum(p.stable = 1) FROM {where})")
    assert (low, high, stable) == (points["h"].min(), points["h"].max(), np.sum(points["stable"] == 1))


def test_rows_have_ranges_and_intervals(path):
    """Oracle: numpy on the branch: each point lies in an interval with its own label, and stability where that is decided."""
    with saltus.Catalogue(path) as catalogue:
        for branch in real():
            row = catalogue.family(branch.id)
            h, s = branch.points["h"], branch.points["arclength"]
            assert row.h == (h.min(), h.max()) and row.points == len(branch) and row.events == len(branch.events)
            for i in range(len(branch)):
                mine = [part for part in row.labels if part.arclength[0] <= s[i] <= part.arclength[1]]
                assert any(part.value == branch.points["label"][i] and part.h[0] <= h[i] <= part.h[1] for part in mine)
                if branch.points["stable"][i] >= 0:
                    parts = [part for part in row.stability if part.arclength[0] <= s[i] <= part.arclength[1]]
                    assert any(part.value == branch.points["stable"][i] for part in parts)
            assert 0.0 <= row.stable_fraction <= 1.0


def test_filters_agree_with_the_points(path):
    """Oracle: the branches themselves."""
    with saltus.Catalogue(path) as catalogue:

        def ids(**filters):
            return {row.id for row in catalogue.families(**filters)}

        h = 0.5
        assert ids(energy=h) == {b.id for b in real() if b.points["h"].min() <= h <= b.points["h"].max()}
        assert ids(label="U*") == {b.id for b in real() if any(label.startswith("U") for label in b.points["label"])}
        assert ids(label="S13+") == ids(label="S13O00+") == {real()[0].id}
        assert ids(ends="origin-origin") == {real()[3].id} and ids(ends="origin-stop") == {b.id for b in real()[:3]}
        assert ids(impacts=(0, 1)) == {real()[k].id for k in (0, 1, 3)} and ids(impacts=(7, 7)) == {real()[2].id}
        # At h = 0.5 the backbone is unstable beyond its symmetry breaking, and stable below.
        assert real()[0].id in ids(stable=True, energy=1.0, label="S13*")
        # The orbits of S73O33- at h = 15 are labelled S53O33+: label and energy hold together.
        assert ids(label="S53O33+", energy=15.0) and not ids(label="S77O33-", energy=15.0) and not ids(energy=1e9)
        with pytest.raises(CatalogueError, match="origin-origin"):
            ids(ends="origin-rest")


def edge():
    """The symmetry breaking of S13O00+ as an edge."""
    backbone, *_, born = real()
    event = next(event for event in backbone.events if event.id == "SB1")
    return switch_edge(backbone, event, born)


def test_an_edge_comes_back(path):
    """Oracle: the edge that was added; the orbit's numbers to the last bit."""
    one = edge()
    with saltus.Catalogue(path, "a") as catalogue:
        assert catalogue.connect(one) == one
        catalogue.connect(one)
        assert catalogue.edges() == [one] == catalogue.edges(one.target)
    assert isinstance(one.source_orbit, EventOrbit) and len(one.source_orbit.start) == 4


def test_the_graph_has_the_schema_that_it_documents(path):
    """Oracle: the docstring of `graph_of`."""
    with saltus.Catalogue(path, "a") as catalogue:
        catalogue.connect(edge())
        catalogue.connect(Edge(real()[0].id, "GR2", "GR", "dead end", None, 14.5, 1.64, stop="-", note="no neighbour is admissible"))
        catalogue.add_node(Node("L11+", "linear mode", "L11+", (0.0, 0.12), 1.84))
        catalogue.connect(Edge("L11+", "", "GR", "linear mode", real()[0].id, 0.12, 1.84, target_event="GR1"))
        graph = catalogue.graph()
    assert graph.number_of_nodes() == len(real()) + 2 and graph.number_of_edges() == 3
    for _, attributes in [*graph.nodes(data=True), *((0, data) for *_, data in graph.edges(data=True))]:
        for name, value in attributes.items():
            assert f"``{name}``" in graph_of.__doc__
            assert isinstance(value, str | int | float | list | type(None))
    dead = next(node for node, data in graph.nodes(data=True) if data["kind"] == "dead end")
    assert graph.nodes[dead]["note"] == "no neighbour is admissible"


def test_the_graph_does_not_depend_on_the_order_of_filling(tmp_path):
    """Oracle: the graph, nodes and edges in order, of the same families added in the other order."""
    graphs = []
    for k, order in enumerate((real(), real()[::-1])):
        with saltus.Catalogue(tmp_path / f"{k}.sqlite", "a", scene=scene()) as catalogue:
            if k:
                catalogue.connect(edge())
            for branch in order:
                catalogue.add(branch)
            catalogue.connect(edge())
            graph = catalogue.graph()
            graphs.append((list(graph.nodes(data=True)), list(graph.edges(keys=True, data=True))))
    assert graphs[0] == graphs[1]


def test_work_is_done_once(tmp_path):
    """Oracle: the queue as it was filled."""
    path = tmp_path / "work.sqlite"
    with saltus.Catalogue(path, "a", scene=scene()) as catalogue:
        assert catalogue.add_work([("b", {"h": 1.0}), ("a", [1, 2])]) == 2
        assert catalogue.add_work([("b", [3]), ("c", [4])]) == 1
        with catalogue.transaction():
            catalogue.add(real()[0])
            catalogue.finish("b")
        catalogue.note("settled", {"energy": [0.05, 1.0]})
    with saltus.Catalogue(path) as catalogue:
        assert catalogue.work() == [("a", [1, 2]), ("c", [4])]
        assert catalogue.counts() == {
            "families": 1, "points": len(real()[0]), "events": len(real()[0].events), "edges": 0, "pending": 2
        }  # fmt: skip
        assert catalogue.progress("settled") == {"energy": [0.05, 1.0]} and catalogue.progress("nothing") is None


def test_a_transaction_is_all_or_nothing(tmp_path):
    """Oracle: the families before it."""
    path = tmp_path / "half.sqlite"
    with saltus.Catalogue(path, "a", scene=scene()) as catalogue:
        catalogue.add(real()[0])
        catalogue.add_work([("one", 1)])
        with pytest.raises(RuntimeError, match="interrupted"), catalogue.transaction():
            catalogue.add(real()[1])
            catalogue.finish("one")
            raise RuntimeError("interrupted")
        assert [row.id for row in catalogue.families()] == [real()[0].id] and len(catalogue.work()) == 1
        catalogue.add(renamed(real()[0], 1))
        assert catalogue.add(real()[0]) == real()[0].id and len(catalogue) == 2, "a family is kept once"


def test_it_knows_what_it_was_made_with(path):
    """Oracle: the versions of the libraries that run, and the scene."""
    with saltus.Catalogue(path) as catalogue:
        assert catalogue.provenance["versions"]["numpy"] == np.__version__ and catalogue.provenance["schema"] == 3
        assert catalogue.scene.system == scene().system.describe() and catalogue.scene.reference_points["S73O33-"]["h"] == 7.3348
        assert catalogue.system.describe() == scene().system.describe()


def test_another_system_is_refused(path):
    """Oracle: the difference, named."""
    other = saltus.load_scene(mu=0.2)
    with pytest.raises(CatalogueError, match=r"another system: there mu is 0\.1, not 0\.2"):
        saltus.Catalogue(path, scene=other)
    with saltus.Catalogue(path, "a", scene=scene()) as catalogue, pytest.raises(CatalogueError, match=r"mu is 0\.1"):
        catalogue.add(saltus.trace("S11O00-", saltus.vibro_impact_nes(mu=0.2), energy=(0.2, 0.4)))


def test_reading_changes_nothing(path):
    """Oracle: the bytes of the file, and the files beside it."""
    before = path.read_bytes()
    with saltus.Catalogue(path) as catalogue:
        catalogue.graph()
        catalogue.branch(real()[0].id)
        with pytest.raises(CatalogueError, match="mode a"):
            catalogue.add(real()[0])
    assert path.read_bytes() == before and [entry.name for entry in path.parent.iterdir()] == [path.name]


@pytest.mark.parametrize("noise", [-1e-13, 1e-13])
def test_rounding_does_not_order_families_and_edges(tmp_path, noise):
    """Oracle: the order of ids and events, where energies are the same but for rounding, also among the ways of a tree."""
    one, other = real()[0], renamed(real()[0], 1)
    other = dataclasses.replace(other, points=one.points | {"h": one.points["h"] * (1.0 + noise)})
    other.__dict__["full_family"] = renamed(one, 1).full_family
    with saltus.Catalogue(tmp_path / "tied.sqlite", "a", scene=scene()) as catalogue:
        for branch in (other, one):
            catalogue.add(branch)
        for k, (event, h) in enumerate((("GR2", 1.0), ("GR1", 1.0 + noise), ("GR3", 0.5), ("GR4", 1.0 + 1e-8))):
            catalogue.connect(Edge(one.id, event, "GR", "dead end", None, h, 1.6 + k))
        assert [row.id for row in catalogue.families()] == sorted((one.id, other.id))
        assert [edge.source_event for edge in catalogue.edges()] == ["GR3", "GR1", "GR2", "GR4"]
        assert [way.event for way in _Tree(catalogue, one.id, 1).ways[one.id]] == ["GR3", "GR1", "GR2", "GR4"]
