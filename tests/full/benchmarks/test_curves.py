"""Long cases of tests/benchmarks/test_curves.py."""

from benchmarks import curves


def test_each_curve_has_a_row():
    table = curves.curves_table(quick=True)
    systems = [("oscillator", "SN"), ("oscillator", "PD"), ("absorber", "SN"), ("absorber", "SB"), ("reference", "SN")]
    assert [row[:2] for row in table.rows] == systems
    assert {len(row) for row in table.rows} == {len(table.columns)}
    assert all(float(row[-1]) < 1e-11 for row in table.rows)
