"""Long cases of tests/benchmarks/test_catalogues.py."""

from benchmarks import catalogues


def test_each_command_that_reads_a_catalogue_has_a_row(tmp_path):
    """Oracle: the commands."""
    table = catalogues.browse(4, str(tmp_path), repeats=1)
    names = [row[0].partition(" --")[0] for row in table.rows]
    assert names == ["python -c pass", "saltus list", "saltus list", "saltus show ID", "saltus show S11O00-@h=50", "saltus tree ID",
                     "saltus path ID ID"]  # fmt: skip
    assert all(len([float(cell) for cell in row[1:]]) == 2 for row in table.rows)
    assert "4 families" in table.notes[0] and not list(tmp_path.iterdir())
