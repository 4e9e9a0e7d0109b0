"""Families of forced orbits in a catalogue."""

import numpy as np
import pytest

from branches.catalogue import Catalogue, CatalogueError, Edge
from branches.catalogue.check import check_catalogue
from branches.catalogue.responses import contains, orbit_of, system_of
from branches.catalogue.rows import SceneRecord
from branches.catalogue.widening import CannotWiden, Kept
from branches.forced.primitive import full_period
from branches.forced.tracing import follow_response
from tests.branches.catalogue.families import real, scene
from tests.branches.forced_systems import absorber_families, oscillator, settled


@pytest.fixture(scope="module")
def families():
    return absorber_families()


def record(branch):
    return SceneRecord(system_of(branch.problem), parameters={"names": list(branch.problem.released), "keep": list(branch.problem.keep)})


@pytest.fixture
def catalogue(families, tmp_path):
    with Catalogue(tmp_path / "absorber.sqlite", "a", scene=record(families[0])) as open_one:
        yield open_one


def inside(branch, low, high):
    """The first point of a branch in a range of its parameter."""
    return int(np.flatnonzero((branch.parameter > low) & (branch.parameter < high))[0])


def part(branch, low, high):
    """A part of a branch, followed from a point inside."""
    return follow_response(branch.problem, branch.unknowns[inside(branch, low, high)], (low, high))


def test_a_family_comes_back_bit_for_bit(families, catalogue):
    """Oracle: the branch that was added."""
    for branch in families:
        assert catalogue.widen(branch) is Kept.NEW
        again = catalogue.branch(branch.id)
        for name in ("unknowns", "tangents", "arclength", "residual"):
            assert np.array_equal(getattr(again, name), getattr(branch, name))
        assert (again.events, again.ended, again.start, again.interval) == (branch.events, branch.ended, branch.start, branch.interval)
        row = catalogue.family(branch.id)
        assert row.h == (branch.parameter.min(), branch.parameter.max()) and row.points == len(branch)
        assert row.ends == branch.id.partition(":")[0]
        wanted = [(event.type, event.coefficient, event.criticality) for event in branch.events]
        assert [(event.type, event.coefficient, event.criticality) for event in catalogue.events(branch.id)] == wanted
        assert catalogue.points(branch.id)["stable"].tolist() == branch.stable.tolist()
    assert any(event.criticality for branch in families for event in branch.events)
    assert len(catalogue) == len(families) and catalogue.scene.axes.symbols == ("w", "T")
    counts, failures = check_catalogue(catalogue)
    assert not failures and counts["points"] == sum(map(len, families))


def test_parts_of_a_family_are_merged(families, catalogue):
    """Oracle: the family as a whole contains both parts, and neither contains the other."""
    whole = families[0]
    left, right, beside = part(whole, 1.1, 1.2), part(whole, 1.15, 1.3), part(whole, 1.6, 1.7)
    assert not contains(left, right) and contains(whole, left) and contains(whole, beside) and not contains(left, whole)
    assert catalogue.widen(left) is Kept.NEW and catalogue.widen(left) is Kept.KNOWN
    assert catalogue.widen(right) is Kept.WIDER
    assert catalogue.family(whole.id).h == pytest.approx((1.1, 1.3), rel=1e-12)
    assert catalogue.widen(beside) is Kept.WIDER and catalogue.widen(right) is Kept.KNOWN
    assert len(catalogue) == 1 and contains(catalogue.branch(whole.id), beside)
    assert not check_catalogue(catalogue)[1]


def test_edges_follow_their_events_to_a_wider_branch(families, catalogue):
    """Oracle: the event at the same value of the parameter."""
    first, four = families[:2]
    narrow = part(four, 0.98, 0.986)
    event = next(event for event in narrow.events if event.type == "SB")
    catalogue.widen(narrow)
    catalogue.widen(families[2])
    here = orbit_of(narrow.problem, narrow.unknowns[event.point])
    there = orbit_of(families[2].problem, families[2].unknowns[families[2].start])
    edge = Edge(four.id, event.id, "SB", "switch", families[2].id, float(narrow.parameter[event.point]), 1.0, "", None, None, here, there)
    catalogue.connect(edge)
    assert catalogue.widen(first) is Kept.NEW and catalogue.widen(four) is Kept.WIDER
    (moved,) = catalogue.edges(four.id)
    found = next(event for event in catalogue.events(four.id) if event.id == moved.source_event)
    assert found.type == "SB" and found.h == pytest.approx(moved.h, rel=1e-9)


def test_a_branch_of_full_periods_is_kept_as_the_symmetric_family(families, catalogue):
    """Oracle: the family whose half period was solved."""
    first = families[0]
    full, whole = full_period(first.problem, first.unknowns[inside(first, 1.0, 1.2)])
    catalogue.widen(follow_response(full, whole, (1.0, 1.2)))
    (row,) = catalogue.all_families()
    assert row.id == first.id and row.ends == "half-period-1"


def test_only_families_of_its_system_and_parameters_are_taken(families, catalogue):
    """Oracle: the differences by hand."""
    problem, y = settled(oscillator(), ["s"], values={"s": -0.03, "w": 2.8}, start=(np.array([-0.66]), np.zeros(1)))
    with pytest.raises(CatalogueError, match="belongs to another system"):
        catalogue.widen(follow_response(problem, y, (-0.05, 0.0)))
    first = families[0]
    y = first.unknowns[inside(first, 1.0, 1.05)]
    other = first.problem.sibling(first.problem.sequence, values=first.problem.parameters(y) | {"F": 0.31})
    with pytest.raises(CatalogueError, match=r"parameters.F is 0.3, not 0.31"):
        catalogue.widen(follow_response(other, y, (0.95, 1.05)))
    with pytest.raises(CatalogueError, match="holds responses in w, and no families in the energy"):
        catalogue.add(real()[0])
    assert not len(catalogue)


def test_a_catalogue_of_energies_takes_no_response(families, tmp_path):
    """Oracle: a message that says what it holds."""
    with Catalogue(tmp_path / "energies.sqlite", "a", scene=scene()) as catalogue:
        with pytest.raises(CatalogueError, match="holds families in the energy, and no families in a parameter"):
            catalogue.add(families[0])


def test_the_value_of_the_parameter_does_not_make_another_system(families, catalogue):
    """Oracle: the same family, from a system whose default frequency is another one."""
    first = families[0]
    parametric = first.problem.parametric.replaced({"w": 1.2})
    problem = type(first.problem)(parametric, first.problem.sequence, ["w"], half=True)
    k = int(np.argmin(np.abs(first.parameter - 1.2)))
    catalogue.widen(first)
    assert catalogue.widen(follow_response(problem, first.unknowns[k], (1.0, 1.3))) is Kept.KNOWN


def test_a_point_that_was_changed_is_found(families, catalogue):
    """Oracle: the residual that the change makes."""
    from dataclasses import replace

    unknowns = families[0].unknowns.copy()
    unknowns[7, 0] += 1e-6
    catalogue.add(replace(families[0], unknowns=unknowns).known_as(families[0].id))
    _, failures = check_catalogue(catalogue)
    assert any("point 7" in failure.text and "residual" in failure.text for failure in failures)


def test_what_cannot_be_joined_is_refused(families, catalogue, monkeypatch):
    """Oracle: a part that cannot be followed to the other one."""
    monkeypatch.setattr("branches.catalogue.responses.joined_family", lambda narrow, branch: None)
    catalogue.widen(part(families[0], 1.1, 1.2))
    with pytest.raises(CannotWiden):
        catalogue.widen(part(families[0], 1.6, 1.7))
