"""A catalogue of schema 2, written by an older saltus: it is read as it is, and converted when it is opened to write."""

import os
import shutil
import sqlite3
from pathlib import Path

import numpy as np
import pytest

import saltus
from branches.building.plan import Bounds, BuildPlan, read_seed
from branches.catalogue import Catalogue, CatalogueDamaged, CatalogueError, CatalogueInUse
from branches.catalogue.check import check_catalogue
from tests.branches.catalogue.families import rows, same_columns, scene, sql

KEPT = Path(__file__).with_name("schema2.db")
"""S13O00+ from h = 0.4 to 0.55, the family born at its SB1, a linear mode, a dead end, a piece of work and a note."""

NEITHER_FOUND = ("cannot be seen to close", "has no event", "it is at h =")
"""`check` of the two edges that were made up for the file."""


@pytest.fixture
def path(tmp_path):
    shutil.copy(KEPT, tmp_path / "old.sqlite")
    return tmp_path / "old.sqlite"


def content(path):
    """Everything in a catalogue."""
    with Catalogue(path) as catalogue:
        branches = [catalogue.branch(row.id) for row in catalogue.families()]
        rows = [row._replace(number=0, details="") for row in catalogue.families()]
        spans = [(row.labels, row.stability, row.ended) for row in catalogue.families()]
        notes = catalogue.work(), catalogue.notes(""), vars(catalogue.scene), catalogue.counts()
        return branches, rows, spans, catalogue.edges(), catalogue.nodes, notes


def test_it_is_read(path):
    """Oracles: the equations, by `check`; the branch as it is followed today; the file stays as it was."""
    before = path.read_bytes()
    with Catalogue(path, scene=scene()) as catalogue:
        failures = check_catalogue(catalogue)[1]
        assert all(any(text in failure.text for text in NEITHER_FOUND) for failure in failures), failures
        backbone = catalogue.branch(catalogue.find("S13+").id)
        assert catalogue.scene.reference_points["S73O33-"]["h"] == 7.3348 and catalogue.provenance["schema"] == 2
        assert catalogue.identify(backbone.orbit(3)) == backbone.id
        assert {row.sequence for row in catalogue.families(energy=0.5)} == {"", "-"}
        ((key, seed),) = catalogue.work()
        assert key == "0000001"
        orbit = read_seed(seed, BuildPlan.within(Bounds((0.06, 3.0), 2.0, 3))).value
        assert (orbit.ends, orbit.sequence) == (backbone.ends, backbone.sequence)
        assert catalogue.progress("unfolded 0000001") == [None, False, 2]
    now = saltus.trace("S13O00+", energy=(0.4, 0.55))
    assert [event.id for event in backbone.events] == [event.id for event in now.events]
    for h in (0.45, 0.5):
        mine, theirs = backbone.orbit_at(energy=h), now.orbit_at(energy=h)
        assert mine.alpha == pytest.approx(theirs.alpha, rel=1e-12)
        assert mine.multipliers == pytest.approx(theirs.multipliers, rel=1e-9)
    problem, still = backbone.problem, np.zeros(2 * backbone.problem.unknowns)
    speeds = [problem.step(backbone.unknowns(i), still, 0.0, maximum=0)["speed"] for i in range(len(backbone))]
    assert backbone.points["impact_speeds"].min(axis=1) == pytest.approx(speeds, rel=1e-12)
    assert path.read_bytes() == before and [entry.name for entry in path.parent.iterdir()] == [path.name]


def test_a_writer_converts_it(path):
    """Oracle: what was read before, to the last bit; it is one file of today's schema, and can be added to."""
    before = content(path)
    with Catalogue(path, "a") as catalogue:
        assert catalogue.provenance["schema"] == 3 and catalogue.provenance["created"]
        assert catalogue._select("PRAGMA user_version") == [(3,)]
    after = content(path)
    for one, other in zip(before[0], after[0], strict=True):
        assert same_columns(one.points, other.points)
        assert (one.id, one.events, one.ended, one.start) == (other.id, other.events, other.ended, other.start)
    assert before[1:] == after[1:]
    assert [entry.name for entry in path.parent.iterdir()] == [path.name]
    with Catalogue(path, "a", scene=scene()) as catalogue:
        catalogue.add(saltus.trace("S11O00-", energy=(0.2, 0.4)))
        assert len(catalogue) == 3


def test_work_without_checksums_is_read(path):
    """Oracle: what was read with them; the first catalogues of schema 2 had none for work and notes. The converted file has them."""
    before = content(path)
    sql(path, "ALTER TABLE work DROP COLUMN crc", "ALTER TABLE progress DROP COLUMN crc", "DELETE FROM scene WHERE key = 'rows'")
    assert content(path)[1:] == before[1:]
    Catalogue(path, "a").close()
    assert rows(path, "(SELECT count(crc) FROM work)") == [[(1,)]]
    assert content(path)[1:] == before[1:]


def test_a_conversion_that_fails_leaves_it_as_it_was(path, monkeypatch):
    """Oracle: the bytes of the file, and what was read: after a failure, and while another program reads."""
    before = path.read_bytes()
    monkeypatch.setattr("branches.catalogue.store.CatalogueStore.connect", lambda self, edge: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        Catalogue(path, "a")
    assert path.read_bytes() == before and [entry.name for entry in path.parent.iterdir()] == [path.name]


def test_a_catalogue_of_another_system_is_not_converted(path):
    """Oracle: the bytes of the file."""
    before = path.read_bytes()
    with pytest.raises(CatalogueError, match=r"another system: there mu is 0\.1, not 0\.2"):
        Catalogue(path, "a", scene=saltus.load_scene(mu=0.2))
    assert path.read_bytes() == before and [entry.name for entry in path.parent.iterdir()] == [path.name]


def test_an_old_file_with_an_open_log_is_not_converted(path):
    """Oracle: the words; what was read before, and after a conversion without the other program."""
    before, other = content(path), sqlite3.connect(path)
    other.execute("PRAGMA journal_mode = WAL")
    assert other.execute("SELECT count(*) FROM families").fetchone()[0] > 0
    with pytest.raises(CatalogueInUse, match="is being read by another program; try again when it has finished"):
        Catalogue(path, "a")
    assert content(path)[1:] == before[1:]
    other.close()
    Catalogue(path, "a").close()
    assert content(path)[1:] == before[1:]


def test_a_reader_of_the_old_file_is_not_disturbed(path):
    """Oracle: what the reader saw before."""
    with Catalogue(path) as reader:
        ids = [row.id for row in reader.families()]
        try:
            Catalogue(path, "a").close()
        except CatalogueInUse:
            pass
        assert all(same_columns(reader.branch(id).points, content(path)[0][ids.index(id)].points) for id in ids)


CHANGES = {
    "UPDATE families SET h_low = 0.1 WHERE number = 1": "the table families does not fit",
    "UPDATE blobs SET states = zeroblob(length(states))": "the states of its points do not fit",
    "UPDATE blobs SET others = zeroblob(8)": "the others of its points do not fit",
    "DELETE FROM blobs": "the states of its points do not fit",
    "DELETE FROM points WHERE number = 3": "of 18 points",
    "UPDATE events SET h = 1.0": "the table events does not fit",
    "UPDATE edges SET source_states = zeroblob(48) WHERE source_event = 'SB1'": "the table edges does not fit",
}


@pytest.mark.parametrize("change", CHANGES)
def test_its_damage_is_found(path, change):
    """Oracle: the part that was changed; a writer does not convert it."""
    sql(path, change)
    before = path.read_bytes()
    with pytest.raises(CatalogueDamaged, match=CHANGES[change]):
        content(path)
    with pytest.raises(CatalogueDamaged, match=CHANGES[change]):
        Catalogue(path, "a")
    assert path.read_bytes() == before and os.listdir(path.parent) == [path.name]
