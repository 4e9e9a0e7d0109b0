"""The benchmark of building on a tiny scene: what it reports is what the catalogue holds. No time is asserted."""

from benchmarks.building import build, table
from branches.catalogue import Catalogue

TINY = ("--energy", "0.1:0.2", "--max-quarter-period", "1.9", "--max-impacts", "2")


def test_it_reports_the_catalogue_that_was_built(tmp_path):
    """Oracle: the catalogue itself, and the size of its file."""
    run = build(1, TINY, tmp_path)
    path = tmp_path / "1.sqlite"
    with Catalogue(path) as catalogue:
        assert run.families == len(catalogue) > 0 and run.points == catalogue.counts()["points"]
    assert run.size == path.stat().st_size and run.settled
    assert run.memory == run.main + run.worker > 50e6
    assert str(run.families) in table([run]).text()
