"""Long cases of tests/bvp/test_kernel_cache.py."""

from __future__ import annotations

import os
import shutil
import subprocess
import time

import pytest

from bvp.kernels import stored
from tests.bvp import test_kernel_cache as origin

kept = origin.kept
project = origin.project
kept_shared = origin.kept_shared


def test_damaged_files_are_written_anew(kept_shared, tmp_path):
    """Oracle: the value by hand, and files that are loaded again: of two kernels, one is cut and the other overwritten."""
    _, _, run = kept_shared
    first, second = (file for file in (tmp_path / "kept").rglob("*-*") if file.is_file())
    first.write_bytes(first.read_bytes()[: first.stat().st_size // 2])
    second.write_bytes(b"\x80" * second.stat().st_size)
    assert run() == (7.0, False, "")
    assert run() == (7.0, True, "")


def test_a_shared_kernel_is_code_of_its_own(kept_shared, tmp_path):
    """Oracle: the values by hand. It is compiled once, and again when it changes or its file is lost. The declared result is checked."""
    _, inner, run = kept_shared
    text = inner.read_text()

    def files():
        return {file.name: file.stat().st_mtime_ns for file in (tmp_path / "kept").rglob("*-*") if file.is_file()}

    before = files()
    assert sorted(name.split("-")[0] for name in before) == ["inner", "outer"]
    assert run() == (7.0, True, "") and files() == before
    for file in (tmp_path / "kept").rglob("inner-*"):
        file.unlink()
    assert run() == (7.0, False, "")
    after = files()
    assert after.keys() == before.keys() and [name for name in after if after[name] == before[name]] == [
        name for name in before if name.startswith("outer")
    ]
    inner.write_text(text.replace("2.0", "5.0"))
    assert run() == (16.0, False, "")
    inner.write_text(text.replace("float", "integer"))
    with pytest.raises(subprocess.CalledProcessError) as caught:
        run()
    assert "returns float64, and integer is declared" in caught.value.stderr


@pytest.mark.skipif(os.name != "posix", reason="modes of folders are those of POSIX")
def test_a_folder_that_others_can_write_to_is_not_read(kept, tmp_path):
    """Oracle: nothing is loaded from it, nothing is written to it, until it is removed."""
    _, _, run = kept
    folder = tmp_path / "kept/saltus-kernels"
    folder.chmod(0o777)
    before = sorted(folder.rglob("*"))
    assert run() == (7.0, False, "")
    assert sorted(folder.rglob("*")) == before
    shutil.rmtree(folder)
    assert run() == (7.0, False, "") and folder.stat().st_mode & 0o777 == 0o700
    assert run() == (7.0, True, "")


def test_a_folder_that_cannot_be_written_is_read(kept):
    """Oracle: what is there is loaded; what is not there is compiled."""
    copy, inner, run = kept
    (copy / "sitecustomize.py").write_text(
        "import os\ndef refuse(*a, **o): raise PermissionError(13, 'read-only')\nos.replace = os.mkdir = refuse\n"
    )
    assert run(PYTHONPATH=str(copy)) == (7.0, True, "")
    inner.write_text(inner.read_text().replace("2.0", "5.0"))
    assert run(PYTHONPATH=str(copy)) == (16.0, False, "")


def test_folders_that_were_not_used_are_removed(kept, tmp_path):
    """Oracle: folders by hand, one used 29 and one 31 days ago. Loading renews the date of a folder."""
    _, inner, run = kept
    root = tmp_path / "kept/saltus-kernels"
    days = {"old": 31, "recent": 29, **{folder.name: 29 for folder in root.iterdir()}}
    for name, age in days.items():
        (root / name).mkdir(exist_ok=True)
        (root / name / "file").touch()
        os.utime(root / name, (time.time() - age * stored.DAY,) * 2)
    run()
    used = next(root.glob("bvp.kernels.outer-*"))
    assert time.time() - used.stat().st_mtime < stored.DAY and (root / "old").is_dir()
    inner.write_text(inner.read_text() + "\n")
    run()
    assert not (root / "old").exists() and (root / "recent").is_dir() and used.is_dir()
