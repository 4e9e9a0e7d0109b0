"""`check` finds what is wrong with points and edges whose checksums are right: catalogues that are filled with wrong things."""

import dataclasses

import numpy as np
import pytest

import saltus
from branches.catalogue import Edge, EventOrbit
from branches.catalogue.check import check_catalogue
from branches.catalogue.members import distances_from_orbit, event_orbit, seen_from, switch_edge, unknowns_of
from branches.tracing import follow_family
from bvp.multipoint import MultipointProblem
from tests.branches.catalogue.families import real, same_columns, scene, sql


def checked(tmp_path, *branches, edges=()):
    """What `check` says of a catalogue with these families and edges."""
    with saltus.Catalogue(tmp_path / "checked.sqlite", "a", scene=scene()) as catalogue:
        for branch in branches:
            catalogue.add(branch)
        for edge in edges:
            catalogue.connect(edge)
        return check_catalogue(catalogue)


def changed(branch, name, index, factor):
    points = {key: values.copy() for key, values in branch.points.items()}
    points[name][index] *= factor
    return dataclasses.replace(branch, points=points)


def breaking():
    """The edge from S13O00+ to the family born at its SB1."""
    backbone, *_, born = real()
    return switch_edge(backbone, next(event for event in backbone.events if event.id == "SB1"), born)


def test_a_good_catalogue_passes(tmp_path):
    """Oracle: no failure, and everything was looked at."""
    counts, failures = checked(tmp_path, *real(), edges=[breaking()])
    assert failures == []
    assert counts == {
        "families": 4, "points": sum(map(len, real())), "events": sum(len(branch.events) for branch in real()), "edges": 1,
        "curves": 0, "hidden": 0,
    }  # fmt: skip


def test_a_missed_event_is_reported(tmp_path):
    """Oracle: the breaking of symmetry and a resonance of S13O00+, taken out."""
    backbone = real()[0]
    for id in ("SB1", next(event.id for event in backbone.events if event.type == "RT")):
        place = next(event.point for event in backbone.events if event.id == id)
        branch = dataclasses.replace(backbone, events=tuple(event for event in backbone.events if event.id != id))
        (tmp_path / id).mkdir()
        _, failures = checked(tmp_path / id, branch)
        assert len(failures) == 1 and f"({id[:2]}) is missed" in failures[0].text
        assert f"point {place - 1}, " in failures[0].text and f"point {place + 1}, " in failures[0].text


@pytest.mark.parametrize(
    ("name", "index", "factor", "words"),
    [
        ("flight_times", 20, 1.0 + 1e-10, "its residual is"),
        ("start_v", (20, 1), 1.0 + 1e-10, "its residual is"),
        ("h", 20, 1.0 + 1e-11, "the energy"),
        ("alpha", 20, 1.0 + 1e-11, "the quarter period"),
        ("arclength", 20, 0.5, "order of arclength"),
    ],
)
def test_a_point_that_is_no_orbit_is_found(tmp_path, name, index, factor, words):
    """Oracle: the number that was changed, by less than any other digit would show."""
    failures = checked(tmp_path, changed(real()[0], name, index, factor))[1]
    assert any(words in failure.text for failure in failures)
    assert all(failure.where == real()[0].id for failure in failures)


def test_an_orbit_that_pierces_a_stop_is_found(tmp_path):
    """Oracle: S13O00+ solved beyond its grazing at h = 14.55, where its closed form goes through the stop."""
    branch = real()[0]
    last = len(branch) - 1
    beyond = branch.problem.solve(branch.unknowns(last), energy=1.05 * branch.points["h"][last])
    points = {name: values.copy() for name, values in branch.points.items()}
    start = branch.problem.modes.to_state @ branch.problem.start(beyond.y)
    points["start_u"][last - 1], points["start_v"][last - 1] = start[:2], start[2:]
    points["velocities"][last - 1] = start[2:]
    points["flight_times"][last - 1] = branch.problem.flight_times(beyond.y)
    points["h"][last - 1], points["alpha"][last - 1] = beyond["energy"], beyond["quarter_period"]
    failures = checked(tmp_path, dataclasses.replace(branch, points=points))[1]
    assert any("a flight pierces a stop" in failure.text for failure in failures)
    assert not any("residual" in failure.text for failure in failures)


def test_an_edge_that_does_not_close_is_found(tmp_path):
    """Oracle: the number that was changed."""
    edge = breaking()
    moved = dataclasses.replace(edge.target_orbit, start=(*edge.target_orbit.start[:3], edge.target_orbit.start[3] * (1.0 + 1e-8)))
    slower = dataclasses.replace(edge.source_orbit, flight_times=(edge.source_orbit.flight_times[0] * (1.0 + 1e-8),))
    cases = {
        "problem of its target": dataclasses.replace(edge, target_orbit=moved),
        "problem of its source": dataclasses.replace(edge, source_orbit=slower),
        "no event 'SB9'": dataclasses.replace(edge, source_event="SB9"),
        "not in the catalogue": dataclasses.replace(edge, target="origin-origin:+:00000000"),
        "cannot be seen to close": dataclasses.replace(edge, target_orbit=None),
        "the edge h = 0.4": dataclasses.replace(edge, h=0.4),
        "not of that family": dataclasses.replace(edge, target=real()[1].id),
    }
    for k, (words, wrong) in enumerate(cases.items()):
        (tmp_path / str(k)).mkdir()
        failures = checked(tmp_path / str(k), *real(), edges=[wrong])[1]
        assert any(words in failure.text for failure in failures), (words, failures)


def test_two_different_orbits_at_one_energy_are_distinguished(tmp_path):
    """Oracle: an orbit of S11O00- at the energy of the SB of S13O00+ solves its own problem, but is not the orbit of that event."""
    backbone, other, *_ = real()
    event = next(event for event in backbone.events if event.id == "SB1")
    orbit = other.orbit_at(energy=event.h)
    edge = Edge(
        backbone.id, event.id, "SB", "switch", other.id, event.h, event.alpha,
        source_orbit=breaking().source_orbit, target_orbit=event_orbit(other.problem, orbit.solution.y),
    )  # fmt: skip
    failures = checked(tmp_path, *real(), edges=[edge])[1]
    assert len(failures) == 1 and "not the same" in failures[0].text


def test_an_orbit_is_known_in_all_its_images():
    """Oracle: the same motion mirrored, run backwards, started at any other time is at no distance; another one is far."""
    branch = real()[2]
    orbit = branch.orbit(len(branch) // 2)
    times = np.linspace(0.0, orbit.period, 7)[1:-1] + 0.01
    u, v = orbit.sample(times)
    for state in np.concatenate([u, v], axis=1):
        for image in (state, -state, state * [1, 1, -1, -1]):
            assert distances_from_orbit(branch.problem, orbit.solution.y, [image])[0] < 1e-12
        assert distances_from_orbit(branch.problem, orbit.solution.y, [state * [1, 1, 1, 1.01]])[0] > 1e-4


def test_an_orbit_is_seen_from_the_problems_that_it_solves():
    """Oracle: the residual of each problem; a quarter-period orbit as half a period from either end, as a period, and mirrored."""
    branch = real()[0]
    y = branch.orbit(50).solution.y
    for ends, sequence in (
        (("origin", "origin"), ("+",)),
        (("origin", "origin"), ("-",)),
        (("stop+", "stop-"), ()),
        (("stop-", "origin"), ()),
        (("periodic", "periodic"), ("+", "-")),
    ):
        seen = seen_from(branch.problem, y, ends, sequence)
        assert isinstance(seen, EventOrbit) and (seen.ends, seen.sequence) == (ends, "".join(sequence))
        problem = MultipointProblem(branch.system, ends, sequence)
        assert np.max(np.abs(problem.residual(unknowns_of(problem, seen)))) < 1e-13
    assert seen_from(branch.problem, y, ("origin", "rest"), ()) is None


@pytest.mark.parametrize(
    ("name", "event"),
    [("S13O00+", "SB1"), ("S11O00-", "PD1"), ("S73O33-", "SB1"), ("S73O33-", "PD1"), ("S11E11+@h=3.0", "SB1"), ("S11E11+@h=3.0", "PD1")],
)
def test_every_switch_is_an_edge_that_closes(tmp_path, name, event):
    """Oracle: `check`: half periods, doubled periods, rest ends, and periods that close on themselves without a reversal."""
    from tests.branches.traced import traced

    branch = traced(name)
    at = next(item for item in branch.events if item.id == event)
    born = branch.switch(at, points=12)
    edges = [switch_edge(branch, at, family) for family in born]
    assert all(edge.target_orbit is not None for edge in edges)
    counts, failures = checked(tmp_path, branch, *born, edges=edges)
    assert failures == [] and counts["edges"] == len({(edge.target) for edge in edges})


def test_other_systems_are_kept_and_checked(tmp_path):
    """Oracle: the branches, bit for bit: chains of 2 to 6 masses with one stop and several, rigid-body modes, rest and stop ends."""
    from tests.properties.test_chains import families

    sizes = set()
    for k, (problem, solution) in enumerate(families()[::6]):
        branch = follow_family(problem, solution.y, points=8)
        with saltus.Catalogue(tmp_path / f"{k}.sqlite", "a", scene=branch.system) as catalogue:
            catalogue.add(branch)
        with saltus.Catalogue(tmp_path / f"{k}.sqlite", scene=branch.system) as catalogue:
            back = catalogue.branch(branch.id)
            assert same_columns(branch.points, back.points) and back.events == branch.events
            assert catalogue.system.describe() == branch.system.describe()
            assert check_catalogue(catalogue)[1] == []
            assert catalogue.find(branch.id[:-3]).id == branch.id
        sizes.add(branch.system.degrees_of_freedom)
    assert len(sizes) > 2


def test_an_edge_that_another_program_deletes_is_missed(tmp_path):
    """Oracle: the number of edges that were added and removed."""
    path = tmp_path / "a.sqlite"
    with saltus.Catalogue(path, "a", scene=scene()) as catalogue:
        for branch in real():
            catalogue.add(branch)
        for _ in range(2):
            catalogue.connect(breaking())
        catalogue.connect(Edge(real()[1].id, "GR1", "GR", "dead end", None, 1.0, 1.0))
        catalogue.remove(real()[1].id)
        assert check_catalogue(catalogue)[1] == []
    sql(path, "DELETE FROM edges")
    with saltus.Catalogue(path) as catalogue:
        assert [failure.text for failure in check_catalogue(catalogue)[1]] == ["the catalogue has 0 edges, expected 1"]
