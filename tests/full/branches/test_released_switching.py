"""Long cases of tests/branches/test_released_switching.py."""

from __future__ import annotations

import pytest

from branches.forced.tracing import follow_response
from tests.branches import test_released_switching as origin
from tests.branches.test_released import in_phase
from tests.branches.test_released_switching import events_of, followed, passes, require_symmetry_breaking

at_quarter_period = origin.at_quarter_period
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


def test_grazing(at_quarter_period):
    """Families meet the backbone where it touches a stop at a fixed quarter period. Those with ends begin there, at the same mu and energy.
    Along the others mu does not change, which makes no event."""
    _, event, found = at_quarter_period
    reversible = [one for one in found if one.problem.ends != ("periodic", "periodic")]
    assert {"".join(one.problem.sequence) for one in reversible} == {"+-", "-"}
    for one in found:
        assert one in reversible or not events_of(one, "SN")
    for one in reversible:
        assert passes(one, "GR", event.values["mu"])
        assert min(abs(end.values["energy"] / event.values["energy"] - 1.0) for end in events_of(one, "GR")) < 1e-6
