"""Safe files: an old file survives whatever goes wrong, and what cannot be written is refused before the work."""

import errno
import json
import os
import re
import sqlite3
import stat
import threading
from pathlib import Path

import numpy as np
import pytest
import scipy.io

import saltus
from branches.files import WriteFailure, read_input, replacing, write_text
from saltus.errors import BadInput
from saltus.motion.study import read_study_file
from saltus.outputs import check_writable, write_data
from saltus.scene.reading import read_record
from tests.saltus.running import run


def test_a_new_file_has_the_users_mode(tmp_path):
    """Oracle: the mode of a file that Python's open makes."""
    with open(tmp_path / "plain", "w"):
        pass
    write_text(tmp_path / "ours", "text\n")
    assert (tmp_path / "ours").read_bytes() == b"text\n"
    assert (tmp_path / "ours").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_a_replaced_file_keeps_its_mode_and_links(tmp_path):
    """Oracle: mode before; the link still is one."""
    target, link = tmp_path / "target", tmp_path / "link"
    target.write_text("old")
    target.chmod(0o640)
    link.symlink_to(target)
    write_text(link, "new")
    assert link.is_symlink() and target.read_text() == "new"
    assert stat.S_IMODE(target.stat().st_mode) == 0o640


def test_a_link_without_its_folder_names_the_folder(tmp_path):
    """Oracle: where the link leads to."""
    (tmp_path / "link").symlink_to(tmp_path / "gone" / "a.json")
    with pytest.raises(BadInput, match=f"the directory {re.escape(str(tmp_path / 'gone'))} does not exist"):
        check_writable(str(tmp_path / "link"))


def test_a_catalogue_is_no_place_for_a_result(tmp_path):
    """Oracle: its bytes; also where it is only there when the result is, and through a link."""
    target, link = tmp_path / "families.sqlite", tmp_path / "out.json"
    connection = sqlite3.connect(target)
    connection.execute("CREATE TABLE t (x)")
    connection.close()
    link.symlink_to(target)
    before = target.read_bytes()
    for path in (target, link):
        with pytest.raises(BadInput, match="as catalogues are; expected another file"):
            check_writable(str(path))
        with pytest.raises(WriteFailure, match="as catalogues are; expected another file"):
            write_text(path, "{}")
    check_writable(str(target), database=True)
    assert target.read_bytes() == before and link.is_symlink() and len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize("error", [RuntimeError("no"), KeyboardInterrupt(), OSError(errno.ENOSPC, "No space left on device")])
def test_the_old_file_stays_when_the_writer_fails(tmp_path, error):
    """Oracle: the content before; nothing is left beside it."""
    target = tmp_path / "branch.json"
    target.write_text("old")
    expected = WriteFailure if isinstance(error, OSError) else type(error)
    with pytest.raises(expected) as caught, replacing(target) as beside:
        beside.write_text("half of it")
        raise error
    if isinstance(error, OSError):
        assert str(caught.value) == f"cannot write {target}: no space is left on the device"
    assert target.read_text() == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["branch.json"]


def test_the_old_file_stays_when_the_move_fails(tmp_path, monkeypatch):
    """Oracle: the content before."""
    target = tmp_path / "branch.json"
    target.write_text("old")

    def refuse(source, destination):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(os, "replace", refuse)
    with pytest.raises(WriteFailure, match="permission is denied"):
        write_text(target, "new")
    assert target.read_text() == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["branch.json"]


@pytest.mark.skipif(not os.path.exists("/dev/null"), reason="needs a device")
def test_a_device_is_written_to_and_not_replaced():
    """Oracle: /dev/null stays a device."""
    check_writable("/dev/null")
    write_text("/dev/null", "text")
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs the device that is always full")
def test_a_full_device_is_said_in_words():
    """Oracle: /dev/full, which refuses every byte; it stays a device."""
    with pytest.raises(WriteFailure, match="^cannot write /dev/full: no space is left on the device$"):
        write_text("/dev/full", "text")
    assert stat.S_ISCHR(os.stat("/dev/full").st_mode)


@pytest.mark.parametrize(("number", "words"), [(errno.EACCES, "permission is denied"), (errno.EROFS, "the file system is read-only")])
def test_a_directory_that_takes_no_file_is_refused(tmp_path, monkeypatch, number, words):
    """Oracle: the answer of the operating system, by a stand-in, as a privileged user may write anywhere."""

    def refuse(**options):
        raise OSError(number, "refused")

    monkeypatch.setattr("tempfile.NamedTemporaryFile", refuse)
    with pytest.raises(BadInput, match=rf"cannot write .*a\.json: {words}"):
        check_writable(str(tmp_path / "a.json"))


@pytest.fixture
def pipe(tmp_path):
    """A pipe in the file system."""
    path = tmp_path / "pipe"
    os.mkfifo(path)
    return path


READERS = {
    "scene": lambda path: saltus.load_scene(path),
    "study": lambda path: read_study_file(path),
    "branch": lambda path: saltus.read_branch(path),
    "record": lambda path: read_record(Path(path), "a", "[ground]"),
    "catalogue": lambda path: saltus.Catalogue(path),
}


@pytest.mark.skipif(not os.path.exists("/dev/zero"), reason="needs a device without an end")
@pytest.mark.parametrize("what", READERS)
def test_a_device_is_no_input(what):
    """Oracle: /dev/zero, which never ends."""
    with pytest.raises(ValueError, match=r"/dev/zero.*a device, expected (a|the) file"):
        READERS[what]("/dev/zero")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes in the file system")
def test_a_pipe_is_read_and_written_to_its_end(pipe):
    """Oracle: the text."""
    text = 100_000 * "abc"
    writer = threading.Thread(target=write_data, args=(str(pipe), text))
    writer.start()
    found = read_input(pipe)
    writer.join()
    assert found == text.encode()


def test_what_has_no_end_is_refused(monkeypatch, tmp_path):
    """Oracle: the largest size that is read."""
    monkeypatch.setattr("branches.files.MOST_BYTES", 1 << 20)
    (tmp_path / "large").write_bytes(((1 << 20) + 1) * b"a")
    with pytest.raises(OSError, match="it is larger than 1 MB"):
        read_input(tmp_path / "large")
    (tmp_path / "large").write_bytes((1 << 20) * b"a")
    assert len(read_input(tmp_path / "large")) == 1 << 20


def test_a_branch_and_an_orbit_as_arrays(tmp_path, capsys):
    """Oracle: the JSON files of the same run; both readers."""
    files = [word for kind in ("json", "npz", "mat") for word in (f"--{kind}", tmp_path / f"a.{kind}")]
    assert run(capsys, "continue", "S13+", "--energy", "0.3:1", *files)[0] == 0
    record = json.loads((tmp_path / "a.json").read_text())
    arrays, matrices = np.load(tmp_path / "a.npz"), scipy.io.loadmat(tmp_path / "a.mat")
    for name in ("h", "alpha", "arclength", "label"):
        assert arrays[name].tolist() == [point[name] for point in record["points"]]
    assert json.loads(str(arrays["about"]))["events"] == record["events"]
    np.testing.assert_array_equal(matrices["h"][:, 0], arrays["h"])
    assert run(capsys, "orbit", "S13+", "--energy", "0.5", *files)[0] == 0
    orbit = json.loads((tmp_path / "a.json").read_text())["orbit"]
    arrays = np.load(tmp_path / "a.npz")
    assert [arrays["h"][0], arrays["alpha"][0]] == [orbit["h"], orbit["alpha"]]
    assert arrays["impact_times"].tolist() == [impact["time"] for impact in orbit["impacts"]]
