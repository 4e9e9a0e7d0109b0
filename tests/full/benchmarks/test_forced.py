"""Long cases of tests/benchmarks/test_forced.py."""

from benchmarks.forced import points_table


def test_each_orbit_has_a_row():
    table = points_table(quick=True)
    assert [row[:2] for row in table.rows] == [("1", "1"), ("1", "2"), ("2", "1"), ("2", "2")]
    assert {len(row) for row in table.rows} == {len(table.columns)}
    assert all(float(row[4]) < 1e-12 and float(row[6]) < 1e-6 for row in table.rows)
