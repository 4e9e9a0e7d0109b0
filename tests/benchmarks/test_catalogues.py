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
