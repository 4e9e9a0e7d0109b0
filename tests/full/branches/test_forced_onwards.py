"""Long cases of tests/branches/test_forced_onwards.py."""

from __future__ import annotations

import pytest

from branches.forced.onwards import ResponseStart, follow_onwards
from tests.branches.test_forced_onwards import rest, within


def summary(found):
    """Sequence length, symmetry and inner events of each family, sorted, and the places of the events."""
    rows = []
    for branch in found.branches:
        inner = sorted((e.type, e.values["w"]) for e in branch.events if e.type not in ("GR", "EP"))
        rows.append((len(branch.sequence), branch.problem.half, [type for type, _ in inner], [w for _, w in inner]))
    return [row[:3] for row in sorted(rows)], [w for row in sorted(rows) for w in row[3]]


def test_the_families_do_not_depend_on_the_end_that_is_followed_first():
    """From the response above resonance, and from the symmetric one with six impacts in a period that is reached from it."""
    whole = follow_onwards([rest(2.0)], within(0.955, 2.2), through=("GR",))
    assert whole.left == 0 and not whole.notes
    (six,) = (branch for branch in whole.branches if branch.problem.half and len(branch.sequence) == 3)
    again = follow_onwards([ResponseStart(six.problem, six.unknowns[len(six) // 2])], within(0.955, 2.2), through=("GR",))
    (families, places), (exact, theirs) = summary(again), summary(whole)
    assert families == exact and places == pytest.approx(theirs, abs=1e-8)
