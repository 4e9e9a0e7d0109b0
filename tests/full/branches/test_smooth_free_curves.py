"""All kinds of curves of free orbits with smooth forces, over wider ranges than in tests/branches."""

from __future__ import annotations

import pytest

from tests.branches.test_smooth_free_curves import SINK, WALL, require_end_at_an_event


@pytest.mark.parametrize(
    ("parametric", "label", "code", "name", "window", "value"),
    [
        (WALL, "S11-", "PD", "mu", (0.09, 0.12), 0.12),
        (WALL, "S11-", "PD", "n", (5.0, 14.0), 14.0),
        (WALL, "S11+", "SB", "sigma", (0.099, 0.102), 0.102),
        (SINK, "S11O00-", "SN", "mu", (0.09, 0.12), 0.12),
        (SINK, "S11O00-", "PD", "k3", (0.4, 0.6), 0.6),
        (SINK, "S11O00-", "GR", "mu", (0.09, 0.12), 0.12),
    ],
)
def test_curves_end_at_events_of_families(parametric, label, code, name, window, value):
    """Oracle: the event of the family at the end of the range, with its coefficient."""
    require_end_at_an_event(parametric, label, code, name, window, value)
