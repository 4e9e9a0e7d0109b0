"""What special points are said to be. Oracle: the labels of the points on both sides, in the order of arclength."""

import numpy as np
import pytest

from branches.tracing import record_of_event
from continuation.problem import Event
from tests.branches.traced import traced


@pytest.mark.parametrize(
    ("name", "low", "high"), [("S73O33-", 0.05, 1e4), ("U8353-", 0.05, 1e4), ("S95E22-", 0.05, 10.0), ("S35O11+", 0.05, 10.0)]
)
def test_changes_of_label_read_along_the_branch(name, low, high):
    """Each change of label is an event whose note says which label becomes which; its own label is the one below it."""
    branch = traced(name, low=low, high=high)
    labels = branch.points["label"]
    noted = {}
    for event in branch.events:
        if event.type in ("LB", "IO"):
            below, above = labels[event.point], labels[event.point + 1]
            assert event.label == below
            # No other point may lie between two changes.
            before = noted.get(event.point - 1)
            assert before.note.endswith(f"becomes {below}") if before else labels[event.point - 1] == below
            if below != above:
                assert event.note.endswith(f"{below} becomes {above}") and event.note.count("becomes") == 1
                noted[event.point] = event
            else:
                assert event.type == "IO" and "becomes" not in event.note
    changes = [i for i in range(len(branch) - 1) if labels[i] != labels[i + 1]]
    assert sorted(noted) == changes and any(event.type == "IO" for event in noted.values())
    assert any(event.number < 0 for event in noted.values()) or name == "U8353-"
    assert np.all(branch.points["frequency_index"] > 0.0)


@pytest.mark.parametrize(
    ("kind", "words"), [("interrupted", "a shorter step does not converge"), ("pole", "without bound"), ("jump", "without passing zero")]
)
def test_a_wide_bracket_is_explained(kind, words):
    """Oracle: status and bracket of the event."""
    branch = traced("S13O00+")
    details = {"label": "S13O00+", "half_waves": 1, "note": "branch point", "kind": kind, "reason": "a shorter step does not converge"}
    event = Event("BP", 1, "bracketed", 1.0, (0.998, 1.0005), 0.1, branch.orbit(3).solution, 3, False, details)
    made = record_of_event(event, "BP1", 3, 3, branch.points, 3, backward=False)
    assert made.note.startswith("branch point; only bracketed, in 2.5e-03 of arclength: ") and words in made.note
    located = Event("BP", 1, "located", 1.0, (1.0, 1.0), 0.1, branch.orbit(3).solution, 3, False, details)
    assert record_of_event(located, "BP1", 3, 3, branch.points, 3, backward=False).note == "branch point"
