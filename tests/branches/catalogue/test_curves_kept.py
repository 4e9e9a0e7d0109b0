"""Curves in the plane of two parameters in a catalogue: their rows, their edges, and older files."""

from __future__ import annotations

import json
import sqlite3
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from branches.catalogue import Catalogue, CatalogueError
from branches.catalogue.catalogue import graph_text
from branches.catalogue.check import check_catalogue
from branches.catalogue.curves import find_curve
from branches.catalogue.database import checksum
from branches.catalogue.kept_curves import curve_row
from branches.catalogue.responses import system_of
from branches.catalogue.rows import SceneRecord
from branches.catalogue.widening import Kept
from branches.curves.files import COLUMNS
from branches.curves.starting import curve_at
from branches.curves.switching import curve_through
from branches.curves.tracing import extend_curve, follow_curve
from branches.forced.tracing import follow_response, switch_response
from tests.branches.catalogue.families import scene
from tests.branches.test_curves_extended import NARROW, WIDE, curve, family


@cache
def doubled():
    """The family that begins at the period doubling."""
    event = next(event for event in family().events if event.type == "PD")
    return follow_response(*switch_response(family(), event)[0], (-0.1, 0.1), points=30)


@cache
def whole():
    return extend_curve(curve(), WIDE)


def record(branch):
    return SceneRecord(system_of(branch.problem), parameters={"names": list(branch.problem.released), "keep": list(branch.problem.keep)})


@pytest.fixture
def catalogue(tmp_path):
    with Catalogue(tmp_path / "one.sqlite", "a", scene=record(family())) as open_one:
        yield open_one


def same(one, other):
    for name in COLUMNS.values():
        assert np.array_equal(getattr(one, name), getattr(other, name), equal_nan=True), name
    names = ("code", "names", "events", "ended", "start", "closed", "window", "origin", "grazing")
    assert all(getattr(one, name) == getattr(other, name) for name in names)
    y = one.unknowns[0, : one.plane.size]
    assert np.array_equal(one.plane.position(y), other.plane.position(y)), "the arclength is another one"


def test_a_curve_comes_back_bit_for_bit(catalogue):
    """Oracle: the curve that was added."""
    kept, id = catalogue.keep_curve(curve())
    assert kept is Kept.NEW and catalogue.keep_curve(curve()) == (Kept.KNOWN, id)
    same(catalogue.curve(id), curve())
    (row,) = catalogue.curve_rows()
    assert (row.id, row.code, row.names, row.points) == (id, "PD", ("s", "w"), len(curve()))
    low, high = curve().span
    assert row.ranges == ((low[1], high[1]), (low[0], high[0]))
    assert find_curve(catalogue, "PD:s") == find_curve(catalogue, id.rpartition(":")[2]) == row and find_curve(catalogue, "NS:") is None
    with pytest.raises(CatalogueError, match=f"has no curve 'PD:x'; it has {id}"):
        catalogue.curve("PD:x")
    counts, failures = check_catalogue(catalogue)
    assert not failures and counts["curves"] == 1
    catalogue.remove_curve(id)
    assert catalogue.curve_rows() == [] and not check_catalogue(catalogue)[1]


def test_a_longer_curve_replaces_its_parts(catalogue):
    """Oracle: the curve of one run in the wide range; overlapping parts are joined."""
    left = follow_curve(curve_at(family(), "PD1", ("w", "s")), ((2.45, 2.55), (-1.0, 1.0)))
    right = extend_curve(follow_curve(curve_at(family(), "PD1", ("w", "s")), ((2.49, 2.52), (-1.0, 1.0))), ((2.49, 2.7), (-1.0, 1.0)))
    assert catalogue.keep_curve(left)[0] is Kept.NEW
    assert catalogue.keep_curve(right)[0] is Kept.WIDER
    (row,) = catalogue.curve_rows()
    assert row.ranges[1] == pytest.approx((2.45, 2.7), rel=1e-9)
    assert catalogue.keep_curve(left)[0] is catalogue.keep_curve(right)[0] is Kept.KNOWN
    kept, id = catalogue.keep_curve(whole())
    assert kept is Kept.WIDER and [row.id for row in catalogue.curve_rows()] == [id]
    same(catalogue.curve(id), whole())
    assert catalogue.keep_curve(follow_curve(curve_at(family(), "PD1", ("s", "w")), NARROW[::-1])) == (Kept.KNOWN, id)
    assert not check_catalogue(catalogue)[1]


def test_a_curve_is_a_loop_until_the_other_family_is_there(catalogue):
    """Oracle: the period doubling, and the family of twice the period, by hand."""
    _, id = catalogue.keep_curve(curve())
    assert catalogue.curve_edges() == []
    catalogue.widen(family())
    ((row, edge),) = catalogue.curve_edges()
    event = next(event for event in family().events if event.type == "PD")
    assert row.id == id and edge.source == edge.target and edge.source_event == "PD1"
    assert edge.h == pytest.approx(event.values["s"], abs=1e-9) and "twice the period" in edge.note
    catalogue.widen(doubled())
    ((_, edge),) = catalogue.curve_edges()
    ids = {row.ends: row.id for row in catalogue.all_families()}
    assert (edge.source, edge.target, edge.kind, edge.note) == (ids["period-1"], ids["period-2"], "curve", None)
    assert edge.target_event.startswith("BP")
    for end in (edge.source, edge.target):
        assert [found.edge for found in catalogue.curve_edges(end)] == [edge]
    # Events are counted anew on a wider branch, and the edge follows.
    wider = follow_response(family().problem, family().unknowns[family().start], (-0.12, 0.25))
    assert catalogue.widen(wider) is Kept.WIDER and catalogue.curve_edges()[0].edge.target == ids["period-2"]
    catalogue.remove(ids["period-2"])
    assert catalogue.curve_edges()[0].edge.target == ids["period-1"]
    assert catalogue.edges() == []


def test_a_curve_of_grazings_is_between_both_families(tmp_path):
    """Oracle: the response without impacts, and the one with an impact, which meet at s = 1/(w^2 - 1)."""
    (event,) = (event for event in whole().events if event.type == "PD-GR")
    grazing = follow_curve(curve_through(whole(), event.point, "GR"), ((1.9, 2.8), (-1.0, 1.0)))
    longer = follow_response(family().problem, family().unknowns[family().start], (-0.1, 0.3))
    touch = next(event for event in longer.events if event.type == "GR")
    other = follow_response(*switch_response(longer, touch)[0], (0.1, 0.4))
    with Catalogue(tmp_path / "two.sqlite", "a", scene=record(longer)) as catalogue:
        catalogue.widen(longer)
        catalogue.keep_curve(grazing)
        ((row, edge),) = catalogue.curve_edges()
        assert edge.source == edge.target and edge.h == pytest.approx(1.0 / (2.5**2 - 1.0), abs=1e-9)
        catalogue.widen(other)
        ((row, edge),) = catalogue.curve_edges()
        assert {edge.source, edge.target} == {row.id for row in catalogue.all_families()} and edge.type == "GR"
        assert not check_catalogue(catalogue)[1]
        assert [place[0] for place in row.places] == [event.id for event in grazing.events]


def test_a_curve_crosses_the_line_of_the_families_where_its_formula_does(catalogue):
    """Oracle: the place of the event on the family, though the curve was started far away from it, in one direction."""
    beside = extend_curve(follow_curve(curve_at(family(), "PD1", ("w", "s")), NARROW, direction="up"), NARROW)
    far = replace(beside, start=len(beside) - 2)
    event = next(event for event in family().events if event.type == "PD")
    ((value, period),) = curve_row(catalogue, far).meetings
    assert value == pytest.approx(event.values["s"], abs=1e-9) and period == pytest.approx(2.0 * np.pi / 2.5, rel=1e-12)
    away = follow_curve(curve_at(family(), "PD1", ("w", "s")), ((2.5, 2.6), (-1.0, 1.0)))
    assert len(curve_row(catalogue, away).meetings) == 1, "an end of the curve is on the line"
    elsewhere = replace(away, **{name: getattr(away, name)[10:] for name in COLUMNS.values()}, events=(), start=0)
    assert curve_row(catalogue, elsewhere).meetings == []


def test_the_graph_has_curves_as_edges(catalogue):
    """Oracle: the rows."""
    for branch in (family(), doubled()):
        catalogue.widen(branch)
    _, id = catalogue.keep_curve(whole())
    graph = catalogue.graph()
    ((source, target, key, data),) = graph.edges(keys=True, data=True)
    assert key == f"PD1>{data['target_event']}:curve {id}" and data["curve"] == id and data["names"] == ["s", "w"]
    assert source != target and data["points"] == len(whole()) and data["second"] == [whole().span[0][0], whole().span[1][0]]
    assert [event[0] for event in data["events"]] == [event.id for event in whole().events]
    plain = json.loads(graph_text(graph, "json"))
    assert plain["edges"][0]["events"] == data["events"]
    name, s, w = next(event for event in data["events"] if event[0] == "PD-GR1")
    assert (s, w) == pytest.approx((1.0 / 3.0, 2.0), abs=1e-9)
    for kind in ("graphml", "dot"):
        assert f"{name}:{s!r}:{w!r}" in graph_text(graph, kind)


def test_a_file_without_the_table_is_read_and_gets_it(tmp_path):
    """Oracle: a file from before curves were kept."""
    path = tmp_path / "old.sqlite"
    with Catalogue(path, "a", scene=record(family())) as catalogue:
        catalogue.widen(family())
    with sqlite3.connect(path) as connection:
        connection.execute("DROP TABLE curves")
    connection.close()
    with Catalogue(path) as catalogue:
        assert catalogue.curve_rows() == [] and catalogue.curve_edges() == [] and len(catalogue) == 1
        assert not check_catalogue(catalogue)[1] and catalogue.graph().number_of_nodes() == 1
    with Catalogue(path, "a") as catalogue:
        assert catalogue.keep_curve(curve())[0] is Kept.NEW
    with Catalogue(path) as catalogue:
        assert len(catalogue.curve_edges()) == 1 and not check_catalogue(catalogue)[1]


def test_damage_is_reported(catalogue):
    """Oracle: what was changed."""
    _, id = catalogue.keep_curve(curve())
    (row,) = catalogue.curve_rows()
    moved = curve().unknowns.copy()
    moved[5] += 1e-6
    shifted = curve().parameters.copy()
    shifted[5] += 1e-6
    # An orbit of the family beside the curve.
    plane, off, n = curve().plane, curve().unknowns.copy(), family().problem.degrees_of_freedom
    y = family().unknowns[family().start]
    nodes, at = family().problem.nodes(y), family().problem.parameters(y)
    off[5] = plane.problem.pack(
        nodes[:, : 2 * n], nodes[:, 2 * n], [at[name] for name in plane.problem.released], family().problem.flight_times(y)
    )
    parameters = curve().parameters.copy()
    parameters[5] = plane.linearised(off[5]).parameters
    for changed, words in (
        (replace(curve(), unknowns=moved), "its residual is"),
        (replace(curve(), parameters=shifted), "other values of them"),
        (replace(curve(), unknowns=off, parameters=parameters), "its condition PD does not hold"),
        (replace(curve(), events=curve().events[:1]), "give the id"),
    ):
        with catalogue.transaction():
            values = curve_row(catalogue, changed)._replace(id=id)
            catalogue._connection.execute("DELETE FROM curves")
            catalogue._insert("curves", values)
        _, failures = check_catalogue(catalogue)
        assert any(failure.where == id and words in failure.text for failure in failures), words
    with catalogue.transaction():
        catalogue._connection.execute("UPDATE curves SET points = 3")
    _, failures = check_catalogue(catalogue)
    assert [failure.where for failure in failures] == ["curves"] and "checksum" in failures[0].text
    with pytest.raises(CatalogueError, match="does not fit its checksum"):
        catalogue.curve_rows()
    broken = row._replace(npz=b"nothing")
    with catalogue.transaction():
        catalogue._connection.execute("DELETE FROM curves")
        catalogue._connection.execute(f"INSERT INTO curves VALUES ({', '.join('?' * 13)})", (*broken, checksum(broken)))
    assert any("cannot be read" in failure.text for failure in check_catalogue(catalogue)[1])
    with catalogue.transaction():
        catalogue._connection.execute("DELETE FROM curves")
    assert [failure.text for failure in check_catalogue(catalogue)[1]] == ["the catalogue has 0 curves, expected 1"]


def test_only_curves_of_the_system_are_kept(catalogue, tmp_path):
    """Oracle: messages that say what differs."""
    problem = family().problem
    other = problem.sibling(problem.sequence, values=problem.values | {"r": 0.7})
    branch = follow_response(other, other.solve(family().unknowns[family().start]).y, (-0.1, 0.2))
    event = next(event for event in branch.events if event.type == "PD")
    with pytest.raises(CatalogueError, match=r"parameters.r is 0.8, not 0.7"):
        catalogue.keep_curve(follow_curve(curve_at(branch, event, ("w", "s")), NARROW, points=4))
    assert catalogue.curve_rows() == []
    with (
        Catalogue(tmp_path / "energies.sqlite", "a", scene=scene()) as energies,
        pytest.raises(CatalogueError, match="families in the energy"),
    ):
        energies.keep_curve(curve())
