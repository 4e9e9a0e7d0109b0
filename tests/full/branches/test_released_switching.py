"""Long cases of tests/branches/test_released_switching.py."""

from __future__ import annotations

import pytest

from branches.forced.tracing import follow_response
from tests.branches import test_released_switching as origin
from tests.branches.test_released import in_phase
from tests.branches.test_released_switching import events_of, followed, passes, require_symmetry_breaking

at_energy = origin.at_energy


@pytest.mark.parametrize("number", [0, 1])
def test_symmetry_breaking(at_energy, number):
    """Oracle: see `require_symmetry_breaking`."""
    require_symmetry_breaking(at_energy, number)


def test_families_of_five_periods_begin_at_a_resonance():
    """Stable between two 1:5 resonances: the family of five periods that begins at one of them leads to the other."""
    problem, y, _ = in_phase(("mu",), ["energy = 0.8"], alpha=1.6887)
    branch = follow_response(problem, problem.solve(y).y, (0.06, 0.15))
    first, last = events_of(branch, "RT")
    (other,) = followed(branch, first, points=300)
    assert passes(other, "BP", first.values["mu"]) and passes(other, "BP", last.values["mu"])
    assert other.ended[0].reason == "CLOSED"
    assert other.columns["alpha"].min() > 4.9 * branch.columns["alpha"].min()
