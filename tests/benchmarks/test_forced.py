"""The benchmark of forced points: its orbits are right, and the table is complete. No time is asserted."""

import numpy as np
import pytest

from benchmarks.forced import SIZES, chain, one_impact, points_table, repeated


@pytest.mark.parametrize("n", SIZES)
def test_the_orbits_have_one_impact_and_can_be_repeated(n):
    """Oracle: the residual of the repeated orbit, and the powers of the multipliers."""
    problem, y = one_impact(chain(n))
    assert len(problem.sequence) == 1 and np.abs(problem.residual(y)).max() < 1e-13
    wide, more = repeated(problem, y, 8)
    assert np.abs(wide.residual(more)).max() < 1e-12
    assert np.abs(wide.multipliers(more)).max() == pytest.approx(np.abs(problem.multipliers(y)).max() ** 8, rel=1e-8)


def test_each_orbit_has_a_row():
    table = points_table(quick=True)
    assert [row[:2] for row in table.rows] == [("1", "1"), ("1", "2"), ("2", "1"), ("2", "2")]
    assert {len(row) for row in table.rows} == {len(table.columns)}
    assert all(float(row[4]) < 1e-12 and float(row[6]) < 1e-6 for row in table.rows)
