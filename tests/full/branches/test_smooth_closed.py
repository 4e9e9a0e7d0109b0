"""Long cases of tests/branches/test_smooth_closed.py."""

from __future__ import annotations

from tests.branches import test_smooth_closed as origin

closed = origin.closed
doubled = origin.doubled


def test_a_family_without_a_reversal_leads_from_one_symmetry_breaking_to_the_other(doubled, closed):
    """Oracle: the symmetry breakings of two families with different reversals, which one closed family connects: its branch points."""
    assert len(closed) == 2
    for ends, branch in closed.items():
        assert branch.ends == ("periodic", "periodic") and branch.sequence == ""
        other = next(half for half in doubled.values() if half.ends != ends)
        broken = next(event for event in other.events if event.type == "SB")
        crossed = next(event for event in branch.events if event.type == "BP")
        # Where two families cross, an orbit is known as well as the square root of rounding.
        assert abs(crossed.h / broken.h - 1.0) < 1e-7 and abs(crossed.alpha / broken.alpha - 1.0) < 1e-7
        assert branch.points["residual"].max() < 1e-12 and branch.points["reliable"].all()
    assert len({branch.id for branch in closed.values()}) == 1
