"""What a catalogue survives: killed writers, second writers, full and read-only disks, damage."""

import os
import random
import re
import sqlite3
import subprocess
import sys
import textwrap
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

import saltus
from branches.catalogue import CatalogueDamaged, CatalogueError, CatalogueInUse, Edge, Node
from branches.catalogue.check import check_catalogue
from branches.catalogue.database import translated
from branches.files import WriteFailure
from tests.branches.catalogue.families import real, renamed, same_columns, scene, sql

ROOT = Path(__file__).parents[3]
LIMIT = 400_000
"""Bytes that a file may have, where a test limits them."""
PRIVILEGED = hasattr(os, "geteuid") and os.geteuid() == 0

WRITER = """
    import sys
    sys.path.insert(0, {root!r})
    import saltus
    from tests.branches.catalogue.families import renamed
    branch = saltus.read_branch({branch!r})
    branch.id  # known before the first is added
    with saltus.Catalogue({path!r}, "a", scene=branch.system) as catalogue:
        print("open", flush=True)
        for k in range({first}, {first} + 100000):
            print(catalogue.add(renamed(branch, k)), flush=True)
"""


@pytest.fixture(scope="module")
def branch_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("branch") / "branch.json"
    real()[0].save(path)
    return path


def writer(branch_file, path, first=0):
    """A process that adds families without end and tells the id of each that is kept."""
    script = textwrap.dedent(WRITER.format(root=str(ROOT), branch=str(branch_file), path=str(path), first=first))
    process = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline().strip() == "open"
    return process


def test_a_writer_killed_while_it_makes_the_file(branch_file, tmp_path):
    """Oracle: either no file, an empty one that is refused in words, or a catalogue; the next writer makes one of each."""
    dice = random.Random(3)
    for run in range(3):
        path = tmp_path / f"{run}.sqlite"
        script = f"import saltus, sys; s = saltus.vibro_impact_nes(); print(1, flush=True); saltus.Catalogue({str(path)!r}, 'a', scene=s)"
        process = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, cwd=ROOT)
        process.stdout.readline()
        time.sleep(dice.uniform(0.0, 0.06))
        process.kill()
        process.wait()
        try:
            saltus.Catalogue(path).close()
        except CatalogueError as error:
            assert "empty" in str(error) or "there is no catalogue" in str(error), error
        with saltus.Catalogue(path, "a", scene=scene()) as catalogue:
            assert len(catalogue) == 0


def test_a_second_writer_reads_who_the_first_one_is(branch_file, tmp_path):
    """Oracle: the first's process number; and that readers are let in meanwhile."""
    path = tmp_path / "used.sqlite"
    process = writer(branch_file, path)
    try:
        with pytest.raises(CatalogueInUse, match=rf"being written by process {process.pid} on \S+ since 20\d\d-"):
            saltus.Catalogue(path, "a", scene=scene())
        first = process.stdout.readline().strip()
        with saltus.Catalogue(path) as catalogue:
            assert first in catalogue
    finally:
        process.kill()
        process.wait()
    assert path.with_name(path.name + ".lock").exists()
    with saltus.Catalogue(path, "a", scene=scene()) as catalogue:
        assert first in catalogue
        with pytest.raises(CatalogueInUse, match="this very process"):
            saltus.Catalogue(path, "a", scene=scene())
    assert not path.with_name(path.name + ".lock").exists()


def test_a_forked_worker_leaves_the_writer_alone(tmp_path):
    """Oracle: the file and its lock after a child, which has a copy of all that the parent has, was refused twice and closed its copy."""
    path = tmp_path / "forked.sqlite"
    with saltus.Catalogue(path, "a", scene=scene()) as catalogue:
        child = os.fork()
        if child == 0:
            try:
                with pytest.raises(CatalogueError, match="which was forked from it"):
                    catalogue.add(real()[0])
                with pytest.raises(CatalogueInUse, match=f"process {os.getppid()} on"):
                    saltus.Catalogue(path, "a", scene=scene())
                catalogue.close()
                os._exit(0)
            finally:
                os._exit(1)
        assert os.waitpid(child, 0)[1] == 0
        assert path.with_name(path.name + ".lock").exists()
        catalogue.add(real()[0])
    assert whole(path, 1)


def test_a_reader_is_not_in_the_way_of_a_writer(tmp_path):
    """Oracle: the families before and after, seen by a reader that stays open while the writer adds and closes."""
    path = tmp_path / "read.sqlite"
    with saltus.Catalogue(path, "a", scene=scene()) as catalogue:
        catalogue.add(real()[0])
    with saltus.Catalogue(path) as reader:
        assert len(reader) == 1
        with saltus.Catalogue(path, "a", scene=scene()) as catalogue:
            rows = reader._connection.execute("SELECT position FROM points")
            assert rows.fetchone() == (0,)
            catalogue.add(real()[1])
            assert len(rows.fetchall()) == len(real()[0]) - 1
            assert len(reader) == 2
            rows = reader._connection.execute("SELECT position FROM points")
            assert rows.fetchone() == (0,)
            catalogue._connection.execute("PRAGMA busy_timeout = 100")
        assert same_columns(reader.points(real()[1].id), real()[1].points)
        rows.close()
    with saltus.Catalogue(path, "a", scene=scene()) as catalogue:
        assert len(catalogue) == 2
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


def full(path, families, pages=None):
    """Add families until the disk is full, or the file has so many pages; how many were kept."""
    with saltus.Catalogue(path, "a", scene=scene()) as catalogue:
        if pages is not None:
            catalogue._connection.execute(f"PRAGMA max_page_count = {pages}")
        for k in range(families):
            try:
                catalogue.add(renamed(real()[0], k))
            except WriteFailure as failure:
                of_limit = f"no file may be larger than {LIMIT} bytes here (ulimit -f)"
                assert "no space is left on the device; what it held is complete" in str(failure) or of_limit in str(failure)
                assert "\n" not in str(failure) and str(path) in str(failure)
                break
        else:
            raise AssertionError("the disk never was full")
    return k


def whole(path, count):
    """Whether a file is a catalogue with so many families that all can be read."""
    with saltus.Catalogue(path) as catalogue:
        assert len(catalogue) == count
        assert all(same_columns(catalogue.points(row.id), real()[0].points) for row in catalogue.families()[-3:])
        assert catalogue._connection.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
    return True


@contextmanager
def mounted(directory, options):
    """A small file system of its own; skips where it cannot be mounted."""
    directory.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(directory)], capture_output=True).returncode:
        pytest.skip("no file system can be mounted here")
    try:
        yield
    finally:
        subprocess.run(["umount", str(directory)], check=True)


@pytest.mark.skipif(not PRIVILEGED, reason="mounting needs privileges")
def test_a_full_disk(tmp_path):
    """Oracle: the families that were kept before, on a file system of one megabyte; and that it goes on where there is room."""
    with mounted(tmp_path / "small", "size=1m"):
        path = tmp_path / "small" / "full.sqlite"
        count = full(path, 200)
        assert count > 1 and whole(path, count)


def test_a_limit_on_the_pages_of_the_file(tmp_path):
    """Oracle: the families that were kept before SQLite's own limit, which it reports as a full disk, was reached."""
    path = tmp_path / "limited.sqlite"
    count = full(path, 100, pages=60)
    assert count > 1 and whole(path, count)


def test_a_limit_on_the_size_of_files(branch_file, tmp_path):
    """Oracle: the families that were kept before a limit, set by the system in a process of its own, was reached."""
    path = tmp_path / "limited.sqlite"
    script = textwrap.dedent(f"""
        import resource, sys
        sys.path.insert(0, {str(ROOT)!r})
        import saltus
        from tests.branches.catalogue import test_safety
        test_safety.real = lambda: [branch]
        branch = saltus.read_branch({str(branch_file)!r})
        resource.setrlimit(resource.RLIMIT_FSIZE, ({LIMIT}, {LIMIT}))
        print(test_safety.full({str(path)!r}, 100))
    """)
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 1 and whole(path, int(done.stdout))


def test_a_finished_file_reads_from_a_read_only_medium(tmp_path):
    """Oracle: the points; on a file system mounted read-only where that can be, else in a directory without permissions."""
    with saltus.Catalogue(tmp_path / "here.sqlite", "a", scene=scene()) as catalogue:
        catalogue.add(real()[0])
    assert [entry.name for entry in tmp_path.iterdir()] == ["here.sqlite"]
    with mounted(tmp_path / "medium", "size=4m") if PRIVILEGED else locked(tmp_path / "medium"):
        path = tmp_path / "medium" / "there.sqlite"
        path.write_bytes((tmp_path / "here.sqlite").read_bytes())
        if PRIVILEGED:
            subprocess.run(["mount", "-o", "remount,ro", str(path.parent)], check=True)
        else:
            path.parent.chmod(0o555)
        assert whole(path, 1)
        with pytest.raises(WriteFailure, match="cannot write .*(read-only|permission)"):
            saltus.Catalogue(path, "a", scene=scene())
        with pytest.raises(WriteFailure, match="cannot write .*(read-only|permission)"):
            saltus.Catalogue(path.with_name("new.sqlite"), "a", scene=scene())
        if PRIVILEGED:
            subprocess.run(["mount", "-o", "remount,rw", str(path.parent)], check=True)


@contextmanager
def locked(directory):
    directory.mkdir()
    try:
        yield
    finally:
        directory.chmod(0o755)


def test_a_failure_that_is_passed_over_does_not_keep_half(tmp_path):
    """Oracle: SQLite takes the whole transaction back when the disk is full; what follows in the same block is not kept alone."""
    path = tmp_path / "half.sqlite"
    with saltus.Catalogue(path, "a", scene=scene()) as catalogue:
        catalogue.add(real()[0])
        catalogue._connection.execute("PRAGMA max_page_count = 60")
        with pytest.raises(WriteFailure, match="taken the transaction back|no space"), catalogue.transaction():
            with pytest.raises(WriteFailure, match="no space"):
                for k in range(100):
                    catalogue.add(renamed(real()[0], k))
            catalogue.note("next", 1)
    assert whole(path, 1)


@pytest.mark.skipif(not PRIVILEGED, reason="mounting needs privileges")
def test_a_log_that_was_left_is_not_passed_over(branch_file, tmp_path):
    """Oracle: on a read-only medium the families in the log cannot be had: the words, and no catalogue without them."""
    path = tmp_path / "left.sqlite"
    process = writer(branch_file, path)
    process.stdout.readline()
    process.kill()
    process.wait()
    with mounted(tmp_path / "medium", "size=64m"):
        there = tmp_path / "medium" / path.name
        for ending in ("", "-wal"):
            there.with_name(there.name + ending).write_bytes(path.with_name(path.name + ending).read_bytes())
        subprocess.run(["mount", "-o", "remount,ro", str(there.parent)], check=True)
        with pytest.raises(CatalogueError, match="left.sqlite-wal beside it holds families that a killed writer left"):
            saltus.Catalogue(there)
        subprocess.run(["mount", "-o", "remount,rw", str(there.parent)], check=True)
        with saltus.Catalogue(there) as catalogue:
            assert len(catalogue) > 0


@pytest.fixture
def good(tmp_path):
    """Four families, a linear mode, a dead end, work that is left, and notes."""
    path = tmp_path / "good.sqlite"
    with saltus.Catalogue(path, "a", scene=scene()) as catalogue:
        for branch in real():
            catalogue.add(branch)
        catalogue.add_node(Node("L11+", "linear mode", "L11+", (0.0, 0.1), 1.8))
        catalogue.connect(Edge(real()[0].id, "GR2", "GR", "dead end", None, 14.5, 1.6))
        catalogue.add_work([("a", {"kind": "name"}), ("b", [1.5])])
        catalogue.note("report", {"beyond": 2})
    return path


def read(path):
    """Everything in a catalogue."""
    with saltus.Catalogue(path) as catalogue:
        branches = [catalogue.branch(row.id) for row in catalogue.families()]
        notes = catalogue.work(), catalogue.progress("report"), catalogue.notes("r")
        return branches, notes, catalogue.graph(), catalogue.system, catalogue.provenance


def refused(path):
    """The words with which a file is refused when everything in it is read."""
    with pytest.raises(CatalogueError) as caught:
        read(path)
    assert "\n" not in str(caught.value) and str(path) in str(caught.value)
    return str(caught.value)


def test_what_is_no_catalogue_is_refused(good, tmp_path):
    """Oracle: the words that name what it is instead."""
    path = tmp_path / "other"
    path.write_text("h,alpha\n1,2\n")
    assert "not an SQLite file" in refused(path)
    path.write_bytes(b"")
    assert "empty" in refused(path)
    with pytest.raises(CatalogueError, match="is empty; expected a scene to make a catalogue for"):
        saltus.Catalogue(path, "a")
    path.unlink()
    assert refused(path) == f"there is no catalogue {path}"
    with pytest.raises(CatalogueError, match="^there is no catalogue .*; expected a scene to make one for$"):
        saltus.Catalogue(path, "a")
    assert "directory" in refused(tmp_path)
    sql(path, "CREATE TABLE t (x)")
    assert "something else" in refused(path)


@pytest.mark.parametrize(("version", "said"), [(7, "install a later saltus"), (1, "build it again")])
def test_another_schema_is_refused_by_name(good, version, said):
    """Oracle: both numbers, and what to do; a writer is refused as a reader is, and nothing is changed."""
    sql(good, f"PRAGMA user_version = {version}")
    before = good.read_bytes()
    assert f"is a catalogue of schema {version}; this saltus reads" in refused(good) and said in refused(good)
    with pytest.raises(CatalogueError, match=said):
        saltus.Catalogue(good, "a", scene=scene())
    assert good.read_bytes() == before and [entry.name for entry in good.parent.iterdir()] == [good.name]


def test_a_file_of_something_else_is_left_as_it_is(tmp_path):
    """Oracle: its bytes, after a writer was refused."""
    path = tmp_path / "other.sqlite"
    sql(path, "CREATE TABLE t (x)")
    sql(path, "PRAGMA journal_mode = WAL")
    before = path.read_bytes()
    with pytest.raises(CatalogueError, match="something else"):
        saltus.Catalogue(path, "a", scene=scene())
    assert path.read_bytes() == before and [entry.name for entry in tmp_path.iterdir()] == [path.name]


def test_space_that_is_free_is_given_back(tmp_path):
    """Oracle: the size of a file that never held the work that was finished; both can be read."""
    sizes = []
    for k, count in enumerate((0, 400)):
        path = tmp_path / f"{k}.sqlite"
        with saltus.Catalogue(path, "a", scene=scene()) as catalogue:
            catalogue.add_work((f"{i:05d}", {"seed": "x" * 1000}) for i in range(count))
            catalogue.add(real()[0])
            for i in range(count):
                catalogue.finish(f"{i:05d}")
        assert whole(path, 1)
        sizes.append(path.stat().st_size)
    assert sizes[1] < sizes[0] + 40 * 400


@pytest.mark.parametrize("part", [0.999, 0.9, 0.5, 0.1, 0.001])
def test_a_file_cut_short_is_refused(good, part):
    """Oracle: the words; a writer is refused as a reader is."""
    os.truncate(good, int(part * good.stat().st_size))
    assert re.search("is damaged|is not a catalogue", refused(good))
    if part < 0.99:
        with pytest.raises(CatalogueError, match="is damaged|is not a catalogue"):
            saltus.Catalogue(good, "a", scene=scene())


def test_a_missing_table_is_refused(good):
    """Oracle: its name."""
    sql(good, "DROP TABLE edges")
    assert "no table edges" in refused(good)


POINTS = "its points "
CHANGES = {
    "UPDATE arrays SET npz = zeroblob(length(npz)) WHERE family = 1": POINTS,
    "UPDATE arrays SET npz = 7 WHERE family = 3": POINTS,
    "UPDATE arrays SET npz = substr(npz, 2) WHERE family = 2": POINTS,
    "UPDATE arrays SET crc = crc + 1 WHERE family = 2": POINTS,
    "DELETE FROM arrays WHERE family = 2": POINTS,
    "UPDATE points SET h = h * (1 + 1e-15) WHERE family = 1 AND position = 6": POINTS,
    "UPDATE points SET stable = 1 - stable WHERE family = 1 AND position = 150": POINTS,
    "UPDATE points SET label = 'S11O00-' WHERE family = 1 AND position = 6": POINTS,
    "UPDATE points SET label = NULL WHERE family = 1 AND position = 6": POINTS,
    "UPDATE points SET alpha = 'wide' WHERE family = 1 AND position = 6": POINTS,
    "DELETE FROM points WHERE family = 1 AND position = 6": "{} of {} points",
    "DELETE FROM events WHERE family = 1 AND position = 0": "of 5 events",
    "UPDATE events SET h = 1.0 WHERE family = 1 AND position = 1": "the row '1 1 SB1' of the table events",
    "UPDATE families SET h_low = 0.1 WHERE number = 1": "the row '1 origin-stop+::",
    "UPDATE scene SET value = '{}' WHERE key = 'system'": "the row 'system' of the table scene",
    "DELETE FROM scene WHERE key = 'system'": "system is missing in the table scene",
    "DELETE FROM scene WHERE key = 'reference_points'": "reference_points is missing in the table scene",
    "DELETE FROM provenance WHERE key = 'versions'": "versions is missing in the table provenance",
    "UPDATE work SET value = '[]' WHERE key = 'b'": "'b' of the table work does not fit its checksum",
    "UPDATE work SET key = 'c' WHERE key = 'b'": "'c' of the table work does not fit its checksum",
    "UPDATE work SET crc = 0 WHERE key = 'b'": "'b' of the table work does not fit its checksum",
    "UPDATE progress SET value = '[]' WHERE key = 'report'": "'report' of the table progress does not fit its checksum",
}


@pytest.mark.parametrize("change", [*CHANGES][::3])
def test_what_is_damaged_is_named(good, change):
    """Oracle: see `require_what_is_damaged_is_named`."""
    require_what_is_damaged_is_named(good, change)


def require_what_is_damaged_is_named(good, change):
    """Oracle: the row that was changed; `check` finds the same, and changes nothing."""
    assert sql(good, change) == [1]
    before, text = good.read_bytes(), CHANGES[change].format(len(real()[0]) - 1, len(real()[0]))
    assert text in refused(good)
    with saltus.Catalogue(good) as catalogue:
        failures = check_catalogue(catalogue)[1]
    assert good.read_bytes() == before
    assert any(text in failure.text for failure in failures)


def test_every_flipped_bit_of_the_work_is_noticed(good):
    """Oracle: each bit of a note, one after the other: what is read is what was written, or `check` tells and reading is refused."""
    note = b'report{"beyond": 2}'
    data = good.read_bytes()
    at = data.index(note)
    with saltus.Catalogue(good) as catalogue:
        assert catalogue.notes("report") == [{"beyond": 2}]
    for bit in range(8 * len(note)):
        flipped = bytearray(data)
        flipped[at + bit // 8] ^= 1 << bit % 8
        good.write_bytes(flipped)
        with saltus.Catalogue(good) as catalogue, pytest.raises(CatalogueError):
            catalogue.notes("")
            raise AssertionError(f"bit {bit} is not noticed")


def test_all_that_is_damaged_is_reported(good):
    """Oracle: the rows that were changed, in six tables; the family that was left alone is looked at."""
    sql(
        good,
        "UPDATE families SET h_low = 0.0 WHERE number IN (1, 2)",
        "UPDATE arrays SET npz = zeroblob(8) WHERE family = 3",
        "UPDATE points SET family = 9 WHERE family = 1 AND position = 0",
        "UPDATE edges SET h = 1.0",
        "UPDATE nodes SET h_high = 1.0 WHERE id = 'L11+'",
        "UPDATE provenance SET value = '{}' WHERE key = 'versions'",
    )
    with saltus.Catalogue(good) as catalogue:
        counts, failures = check_catalogue(catalogue)
    assert counts["families"] == 1 and counts["points"] == len(real()[3])
    places = {failure.where for failure in failures}
    assert places == {"file", "points", "nodes", "edges", *(branch.id for branch in real()[:3])}


def test_flipped_bytes_are_noticed(good):
    """Oracle: one byte anywhere: either it is refused or `check` tells it, or nothing that is read has changed (unused space)."""
    data = good.read_bytes()
    dice = random.Random(7)
    noticed = 0
    for _ in range(30):
        at = dice.randrange(100, len(data))
        good.write_bytes(data[:at] + bytes([data[at] ^ (1 << dice.randrange(8))]) + data[at + 1 :])
        try:
            with saltus.Catalogue(good) as catalogue:
                quick = catalogue._connection.execute("PRAGMA quick_check").fetchall() == [("ok",)]
                same = [same_columns(catalogue.points(b.id), b.points) and catalogue.events(b.id) == b.events for b in real()]
                assert (not quick) or all(same)
                noticed += not quick
        except (CatalogueError, sqlite3.DatabaseError) as error:
            assert isinstance(error, CatalogueError) or "malformed" in str(error), error
            noticed += 1
    assert noticed > 15


def test_rows_that_a_family_left_are_damage(good):
    """Oracle: the table that holds them when a family takes the number of the one that is gone; the file keeps what it held."""
    sql(good, "DELETE FROM families WHERE number = 4")
    with saltus.Catalogue(good, "a") as catalogue:
        with pytest.raises(CatalogueDamaged, match=f"{good.name} is damaged: .*points.family"):
            catalogue.add(real()[3])
        assert len(catalogue) == 3


def test_text_that_is_none_is_damage(good):
    """Oracle: bytes that no text has, over a label wherever it stands, and over what a build noted."""
    data = good.read_bytes()
    for text in (b"S13O00+", b"located"):
        assert text in data
        good.write_bytes(data.replace(text, b"\xff" * len(text)))
        with pytest.raises(CatalogueDamaged, match=good.name), saltus.Catalogue(good) as catalogue:
            for row in catalogue.families():
                _ = catalogue.track(row), catalogue.events(row.id)
    good.write_bytes(data)
    with saltus.Catalogue(good, "a") as catalogue:
        catalogue.note("plan", {"bounds": 1})
        with catalogue.transaction():
            catalogue._connection.execute("UPDATE progress SET value = '{\"bou' WHERE key = 'plan'")
        with pytest.raises(CatalogueDamaged, match=f"{good.name}.*'plan'"):
            catalogue.progress("plan")
        with catalogue.transaction():
            catalogue._connection.execute("DELETE FROM points")
        with pytest.raises(CatalogueDamaged, match="points"):
            catalogue.track(catalogue.families()[0])


def test_the_words_of_sqlite_are_the_users(tmp_path):
    """Oracle: an error of each kind is one of ours, with the file's name."""
    for name, kind in (("SQLITE_FULL", WriteFailure), ("SQLITE_BUSY", CatalogueInUse), ("SQLITE_CORRUPT_INDEX", CatalogueDamaged)):
        error = sqlite3.OperationalError("raw words")
        error.sqlite_errorname = name
        with pytest.raises(kind, match="the.sqlite"), translated(Path("the.sqlite")):
            raise error
