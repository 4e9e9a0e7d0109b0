"""The benchmarks of catalogues, on small ones. No time is asserted."""

import saltus
from benchmarks import catalogues
from branches.catalogue import Catalogue

TINY = ("--energy", "0.1:0.2", "--max-quarter-period", "1.9", "--max-impacts", "2")


def test_the_report_of_a_build_is_its_catalogue(tmp_path):
    """Oracle: the catalogue itself, and the size of its file."""
    built = catalogues.build(1, TINY, tmp_path)
    path = tmp_path / "1.sqlite"
    with Catalogue(path) as catalogue:
        assert built.families == len(catalogue) > 0 and built.points == catalogue.counts()["points"]
    assert built.size == path.stat().st_size and built.complete
    assert built.memory == built.main + built.worker > 50e6
    ((_, _, faster, families, *_),) = catalogues.table([built]).rows
    assert (faster, families) == ("1", str(built.families))


def test_the_synthetic_catalogue_is_one(tmp_path):
    """Oracle: the count of families, and of points by the families themselves."""
    points, _ = catalogues.fill_catalogue(tmp_path / "synthetic.sqlite", 12)
    with saltus.Catalogue(tmp_path / "synthetic.sqlite") as catalogue:
        assert len(catalogue) == 12 and sum(row.points for row in catalogue.families()) == points == catalogue.counts()["points"]
        assert catalogue.graph().number_of_edges() > 12


def test_each_command_that_reads_a_catalogue_has_a_row(tmp_path):
    """Oracle: the commands."""
    table = catalogues.browse(4, str(tmp_path), repeats=1)
    names = [row[0].partition(" --")[0] for row in table.rows]
    assert names == ["python -c pass", "saltus list", "saltus list", "saltus show ID", "saltus show S11O00-@h=50", "saltus tree ID",
                     "saltus path ID ID"]  # fmt: skip
    assert all(len([float(cell) for cell in row[1:]]) == 2 for row in table.rows)
    assert "4 families" in table.notes[0] and not list(tmp_path.iterdir())
