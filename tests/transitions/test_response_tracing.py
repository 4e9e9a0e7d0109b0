"""Responses from Python: the same as from the command line, saved and read again, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

import saltus


@pytest.fixture(scope="module")
def absorber():
    return saltus.load_scene("absorber").parametric


@pytest.fixture(scope="module")
def symmetric(absorber):
    (branch,) = saltus.trace_response(absorber, "w", (0.9, 1.2))
    return branch


def test_a_response_has_its_events_and_the_families_behind_them(symmetric):
    """Oracle: the grazing of the symmetric response; the family behind it begins there, and has an impact more."""
    (event,) = [event for event in symmetric.events if event.type == "GR"]
    assert event.values["w"] == pytest.approx(0.9873255373, abs=1e-9)
    further = saltus.emanating_responses(symmetric, event.id, points=5)
    assert further and all(np.abs(branch.parameter - event.values["w"]).min() < 1e-4 for branch in further)
    assert all(len(branch.sequence) > len(symmetric.sequence) for branch in further)


def test_saved_responses_are_read_again(symmetric, tmp_path):
    """Oracle: the branch itself; a table has a row for each point."""
    saltus.save_responses([symmetric], tmp_path / "one.json")
    saltus.save_responses([symmetric], tmp_path / "one.csv")
    (again,) = saltus.read_responses(tmp_path / "one.json")
    assert np.array_equal(again.unknowns, symmetric.unknowns) and again.id == symmetric.id
    table = saltus.response_dataframe(symmetric)
    assert len(table) == len(symmetric) == len((tmp_path / "one.csv").read_text(encoding="utf-8").splitlines()) - 1
    assert table["w"].to_numpy() == pytest.approx(symmetric.parameter, abs=0.0)


def test_marks_and_a_response_from_rest(absorber):
    """Oracle: the amplitude of the linear response at the mark."""
    branches = saltus.trace_response(absorber, "w", (0.3, 0.7), start="rest", values={"w": 0.4}, marks=[0.5])
    (at,) = [(branch, event) for branch in branches for event in branch.events if event.type == "UZ"]
    branch, event = at
    system, forces = absorber.system({"w": 0.5}), absorber.forces({"w": 0.5})
    stiffness = system.stiffness - 0.25 * system.mass + 0.5j * system.damping
    expected = np.linalg.solve(stiffness, forces[0].cosine)
    state = branch.problem.nodes(branch.unknowns[event.point])[0]
    np.testing.assert_allclose(state[:4], [*expected.real, *(0.5j * expected).real], atol=1e-13)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"start": "here"}, "start is 'simulate' or 'rest'; received 'here'"),
        ({"interval": (1.2, 1.5)}, "the range 1.2 to 1.5 has not the value w = 1"),
        ({"names": "omega"}, "omega"),
        ({"through": ["NS"]}, "families begin at events of type PD, SB, BP, GR, LB; received NS"),
    ],
)
def test_what_cannot_be_followed_is_refused(absorber, change, message):
    given = {"names": "w", "interval": (0.9, 1.2), **change}
    with pytest.raises(ValueError, match=message):
        saltus.trace_response(absorber, given.pop("names"), given.pop("interval"), **given)


def test_events_without_a_family_are_refused(symmetric):
    with pytest.raises(ValueError, match="no event PD7; known: "):
        saltus.emanating_responses(symmetric, "PD7")
    with pytest.raises(ValueError, match=r"expected a name that ends in \.json or \.csv"):
        saltus.save_responses([symmetric], "one.png")
