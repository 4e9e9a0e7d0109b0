"""The benchmark of catalogues on a small one: what it writes is a catalogue, and it prints what it says. No time is asserted."""

import saltus
from benchmarks import browsing


def test_the_synthetic_catalogue_is_one(tmp_path):
    """Oracle: the count of families, and of points by the families themselves."""
    points, seconds = browsing.fill(tmp_path / "synthetic.sqlite", 12)
    with saltus.Catalogue(tmp_path / "synthetic.sqlite") as catalogue:
        assert len(catalogue) == 12 and sum(row.points for row in catalogue.families()) == points == catalogue.counts()["points"]
        assert catalogue.graph().number_of_edges() > 12 and seconds > 0.0


def test_the_table_is_printed(tmp_path, capsys):
    """Oracle: a line for each command."""
    browsing.main(4, str(tmp_path), repeats=1)
    out = capsys.readouterr().out
    assert "bytes a point" in out and "saltus list" in out and "saltus path" in out
