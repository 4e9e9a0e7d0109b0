"""Long cases of tests/branches/test_forced_closing.py."""

from __future__ import annotations

import pytest

from tests.branches.test_forced_closing import coupled, require_the_contact_force_touches_zero_inside_sticking, response, table


@pytest.mark.parametrize("restitution", [0.0, 0.2])
def test_the_contact_force_touches_zero_inside_sticking(restitution):
    """Oracle: see `require_the_contact_force_touches_zero_inside_sticking`."""
    require_the_contact_force_touches_zero_inside_sticking(restitution)


def test_the_id_of_such_a_family_does_not_depend_on_the_start():
    """Oracle: two starts and ranges. The end at which equations are singular is one of the two that identify it."""
    ids = {response(table(0.1), "A", (0.5, high), {"A": value}).id for high, value in ((1.3, 1.2), (1.25, 1.1))}
    assert len(ids) == 1


def test_a_family_ends_where_its_masses_let_an_impact_pull_a_sticking_stop_open():
    """Oracle: the impulse at the stop that sticks has the sign of m."""
    branch = response(coupled(0.02, 0.65), "m", (-0.3, 0.4))
    value, ended = float(branch.parameter[0]), branch.ended[0]
    assert value == pytest.approx(0.0, abs=1e-7) and value >= 0.0
    assert ended.reason == "DOMAIN" and "b+ pulls stop a+ open" in ended.text
