"""A family that is kept over part of its range, and followed further: the wider branch takes its place, edges and all."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import pytest

import saltus
from branches.catalogue import Catalogue, CatalogueError, Edge, Node
from branches.catalogue.check import check_catalogue
from branches.catalogue.members import orbit_of_event, switch_edge
from branches.catalogue.widening import CannotWiden, Kept, _name, holds
from tests.branches.catalogue.families import linear_mode, real, rows, same_columns, scene


@cache
def part(low, high):
    """S13O00+ between two energies."""
    return saltus.trace("S13O00+", scene=scene(), energy=(low, high))


def event_near(branch, type, h):
    return next(event for event in branch.events if event.type == type and abs(event.h / h - 1.0) < 1e-6)


def fill(path, backbone):
    """A catalogue with the backbone as it is given, the family born from it where it has that SB, and what meets it at its grazings."""
    whole, born = real()[0], real()[3]
    at = {event.id: event for event in whole.events}
    with Catalogue(path, "a", scene=scene()) as filled:
        filled.add(backbone)
        held = [event.h for event in backbone.events if event.type in ("SB", "GR")]
        for wanted in (at["SB1"], at["GR1"], at["GR2"]):
            if not any(abs(h / wanted.h - 1.0) < 1e-6 for h in held):
                continue
            here = event_near(backbone, wanted.type, wanted.h)
            if wanted is at["SB1"]:
                filled.add(born)
                filled.connect(switch_edge(backbone, here, born))
            elif wanted is at["GR1"]:
                filled.add_node(Node("L11+", "linear mode", "L11+", (0.0, here.h), here.alpha))
                orbits = linear_mode(here.h), orbit_of_event(backbone, here)
                filled.connect(Edge("L11+", "", "GR", "linear mode", backbone.id, here.h, here.alpha, here.id, here.stop, None, *orbits))
            else:
                orbit = orbit_of_event(backbone, here)
                where = here.h, here.alpha, "", here.stop
                filled.connect(Edge(backbone.id, here.id, "GR", "dead end", None, *where, "nothing there", orbit))
    return path


def dump(path):
    """All rows of a file."""
    return rows(path, "families", "points", "arrays", "events", "nodes", "edges", "work", "progress", "counts", "scene", "provenance")


def meetings(catalogue):
    """Edges by all but their orbits."""
    return [(e.source, e.source_event, e.type, e.kind, e.target, e.target_event, e.note, e.h) for e in catalogue.edges()]


@pytest.mark.parametrize(("low", "high", "count"), [(0.3, 1.0, 1), (1.0, 20.0, 1), (0.05, 1.0, 2)])
def test_the_wider_branch_takes_the_place(tmp_path, low, high, count):
    """Oracles: the catalogue into which the wide branch is put at first; the check of every point, event and edge. Above h = 1 the upper
    grazing is the first one, and is the second on the whole family: its edge, and the dead end that is named for it, go along."""
    wide, narrow = real()[0], part(low, high)
    assert narrow.id == wide.id and not holds(narrow, wide) and holds(wide, narrow)
    path = fill(tmp_path / "narrow.sqlite", narrow)
    with Catalogue(path, "a") as catalogue:
        before = catalogue.edges()
        assert len(before) == count
        assert catalogue.widen(wide) is Kept.WIDER
    with Catalogue(path) as catalogue, Catalogue(fill(tmp_path / "wide.sqlite", wide)) as expected:
        assert same_columns(catalogue.points(wide.id), wide.points) and catalogue.events(wide.id) == wide.events
        # Energies agree to the accuracy of a located event.
        near = [(*m[:-1], pytest.approx(m[-1], abs=1e-7)) for m in meetings(expected)]
        hoped = [meeting for meeting in near if any(edge.h == meeting[-1] for edge in before)]
        assert meetings(catalogue) == hoped
        assert {node.id for node in catalogue.nodes if node.kind == "dead end"} == {m[4] for m in hoped if m[3] == "dead end"}
        counts, failures = check_catalogue(catalogue)
        assert not failures and counts["edges"] == count


def test_what_is_kept_already_stays(tmp_path):
    """Oracle: every row of the file, after a narrower branch, the same one, and one that lies beside it."""
    path = fill(tmp_path / "kept.sqlite", part(0.3, 1.0))
    before = dump(path)
    with Catalogue(path, "a") as catalogue:
        assert catalogue.widen(part(0.4, 0.9)) is Kept.KNOWN
        assert catalogue.widen(part(0.3, 1.0)) is Kept.KNOWN
        for beside in (part(1.0, 20.0), part(0.5, 2.0)):
            with pytest.raises(CannotWiden, match="does not have all orbits of the family in the catalogue"):
                catalogue.widen(beside)
    assert dump(path) == before
    with Catalogue(path) as catalogue, pytest.raises(CatalogueError, match="opened to read"):
        catalogue.widen(real()[0])


def test_an_unfinished_build_keeps_its_events(tmp_path):
    """Oracle: the row, as long as work is left that may name its events; then the wider one."""
    path = fill(tmp_path / "kept.sqlite", part(0.3, 1.0))
    with Catalogue(path, "a") as catalogue:
        catalogue.add_work([("0000001", {"any": "thing"})])
        with pytest.raises(CannotWiden, match="a build of the catalogue is not finished"):
            catalogue.widen(real()[0])
        assert catalogue.family(real()[0].id).points == len(part(0.3, 1.0))
        catalogue.finish("0000001")
        assert catalogue.widen(real()[0]) is Kept.WIDER


def test_an_event_that_is_lost_keeps_the_narrow_one(tmp_path):
    """Oracle: an edge whose event the wider branch does not have; nothing of the file changes."""
    wide = real()[0]
    path = fill(tmp_path / "kept.sqlite", part(0.3, 1.0))
    lost = replace(wide, events=tuple(event for event in wide.events if event.type != "SB")).known_as(wide.id)
    before = dump(path)
    with Catalogue(path, "a") as catalogue, pytest.raises(CannotWiden, match="the event SB1, where other families meet it"):
        catalogue.widen(lost)
    assert dump(path) == before


def test_it_is_one_transaction(tmp_path, monkeypatch):
    """Oracle: a failure at the last of its steps; family, events, edges and nodes are as before."""
    path = fill(tmp_path / "kept.sqlite", part(1.0, 20.0))
    with Catalogue(path) as catalogue:
        before = catalogue.family(real()[0].id), catalogue.events(real()[0].id), catalogue.edges(), catalogue.nodes
    with Catalogue(path, "a") as catalogue:
        monkeypatch.setattr(Catalogue, "connect", lambda self, edge: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            catalogue.widen(real()[0])
    with Catalogue(path) as catalogue:
        assert (catalogue.family(real()[0].id), catalogue.events(real()[0].id), catalogue.edges(), catalogue.nodes) == before


@pytest.mark.parametrize("noise", [-1e-12, 1e-12])
def test_events_at_two_passes_through_one_orbit_keep_apart(noise):
    """Oracle: their order, however rounding moves them. One of them alone has no second name."""
    event = real()[0].events[0]
    passes = [event._replace(id=f"{event.type}{k}", h=event.h * (1.0 + k * noise)) for k in (1, 2)]
    narrow, names = SimpleNamespace(events=passes), {}
    wider = SimpleNamespace(events=[one._replace(h=event.h) for one in passes[::-1]])
    found = [_name(one.id, narrow, wider, names) for one in passes]
    assert found == [one.id for one in wider.events]
    with pytest.raises(CannotWiden, match="is not found on the new branch"):
        _name(passes[1].id, narrow, SimpleNamespace(events=passes[:1]), {"": "", passes[0].id: passes[0].id})
