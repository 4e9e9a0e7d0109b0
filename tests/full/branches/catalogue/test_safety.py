"""Long cases of tests/branches/catalogue/test_safety.py."""

import random
import signal
import time

import pytest

import saltus
from tests.branches.catalogue import test_safety as origin
from tests.branches.catalogue.families import real, same_columns, scene
from tests.branches.catalogue.test_safety import CHANGES, require_what_is_damaged_is_named, writer

good = origin.good
branch_file = origin.branch_file


def test_a_killed_writer_loses_no_finished_family(branch_file, tmp_path):
    """Oracle: the ids that the writer printed before it was killed, at random moments, several times in one file; the points themselves."""
    path = tmp_path / "killed.sqlite"
    printed = []
    dice = random.Random(20)
    for run, waited in enumerate((0, 12, 3)):
        process = writer(branch_file, path, 100000 * run)
        # However slow the machine is, so many families are finished.
        printed += [process.stdout.readline().strip() for _ in range(waited)]
        time.sleep(dice.uniform(0.0, 0.1))
        process.send_signal(signal.SIGKILL)
        printed += process.stdout.read().split()
        assert process.wait() == -signal.SIGKILL
        with saltus.Catalogue(path) as catalogue:
            kept = {row.id for row in catalogue.families()}
            assert kept.issuperset(printed)
            assert len(kept) <= len(printed) + run + 1
            for id in printed[-2:]:
                assert same_columns(catalogue.points(id), real()[0].points)
    assert len(printed) >= 15
    with saltus.Catalogue(path, "a", scene=scene()) as catalogue:
        assert catalogue._connection.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        assert {row.id for row in catalogue.families()}.issuperset(printed)
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("change", CHANGES)
def test_what_is_damaged_is_named(good, change):
    """Oracle: see `require_what_is_damaged_is_named`."""
    require_what_is_damaged_is_named(good, change)
