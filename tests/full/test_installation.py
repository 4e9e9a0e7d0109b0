"""The README's two ways of installing, after each other in one copy, with runs between them. Run apart: `python -m pytest tests/full`."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
COPIED = "README.md", "LICENSE", "pyproject.toml", "setup.cfg", "bvp", "branches", "continuation", "transitions", "saltus", "catalogues"


def _files(folder):
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


@pytest.mark.parametrize("order", [(".", "--editable ."), ("--editable .", ".")], ids=["installed first", "editable first"])
def test_both_commands_work_after_each_other_and_leave_nothing(tmp_path, order):
    """Oracle: the same orbit each time, and an environment that holds afterwards the files that it held before.

    The environment finds the dependencies where this one has them. Only setuptools may have to be loaded from a network."""
    copy = tmp_path / "copy"
    copy.mkdir()
    for name in COPIED:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, copy / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(source, copy)
    clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}

    def call(*words, cwd=tmp_path):
        done = subprocess.run(words, cwd=cwd, env=clean, capture_output=True, text=True)
        assert done.returncode == 0, (words, done.stdout, done.stderr)
        return done.stdout

    call(sys.executable, "-m", "venv", str(tmp_path / "environment"))
    scripts = tmp_path / "environment" / ("Scripts" if os.name == "nt" else "bin")
    python, saltus = str(scripts / "python"), str(scripts / "saltus")
    packages = Path(call(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))").strip())
    (packages / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    before = _files(packages) | _files(scripts)

    found = set()
    # A setuptools that builds wheels by itself, or with the package wheel, is used as it is.
    builds = find_spec("setuptools") and (find_spec("wheel") or find_spec("setuptools.command.bdist_wheel"))
    here = ["--no-build-isolation"] if builds else []
    for words in order * 2:
        call(python, "-m", "pip", "install", "--quiet", "--no-deps", *here, *words.split(), cwd=copy)
        found.add(call(saltus, "orbit", "S13O00+", "--alpha", "1.7"))
        place = call(python, "-c", "import bvp.kernels.compiled as module; print(module.__file__)")
        assert Path(place.strip()).is_relative_to(copy if "--editable" in words else packages)
    assert len(found) == 1 and "S13O00+" in found.pop()
    call(python, "-m", "pip", "uninstall", "--yes", "--quiet", "saltus")
    assert _files(packages) | _files(scripts) == before
    assert not [file for kind in ("*.nbi", "*.nbc") for file in copy.rglob(kind)]
