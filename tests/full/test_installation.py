"""The README's two commands, after each other in one copy. Run apart: `python -m pytest tests/full`."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = "bvp", "branches", "continuation", "transitions", "saltus", "catalogues"
COPIED = "README.md", "LICENSE", "pyproject.toml", "setup.cfg", "setup.py", "backend.py", "docs", "benchmarks", "tests", *PACKAGES


def commands():
    """The two commands as they stand in the README: for use and for development."""
    section = (ROOT / "README.md").read_text(encoding="utf-8").partition("## Two commands")[2].partition("\n## ")[0]
    found = re.findall(r"```sh\n(.+)\n```", section)
    assert len(found) == 2 and "--plot S13O00+.png" in found[0] and "--editable" in found[1] and "-m pytest" in found[1]
    return found


def _files(folder):
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


@pytest.mark.skipif(os.name != "posix", reason="the commands are those of a POSIX shell")
def test_both_commands_work_after_each_other_and_leave_nothing(tmp_path):
    """Oracle: the same orbit each time, a figure, a core that is compiled once, and an environment that holds afterwards the files that it
    held before.

    The environment finds the dependencies where this one has them. What builds the package is loaded from a network. Of the tests one
    quick file is run."""
    copy = tmp_path / "copy"
    copy.mkdir()
    for name in COPIED:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, copy / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(source, copy)
    clean = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "PYTEST", "VIRTUAL_ENV"))}
    clean["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), clean["PATH"]])  # its python3 is this one
    clean["PYTEST_ADDOPTS"] = "tests/saltus/test_packaging.py"

    def call(command):
        done = subprocess.run(command, shell=True, cwd=copy, env=clean, capture_output=True, text=True)
        assert done.returncode == 0, (command, done.stdout, done.stderr)
        return done.stdout

    call("python3 -m venv .venv")
    scripts = copy / ".venv/bin"
    packages = Path(call(".venv/bin/python -c \"import sysconfig; print(sysconfig.get_path('purelib'))\"").strip())
    (packages / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    before = _files(packages) | _files(scripts)
    orbits, cores = set(), set()
    for which in (0, 1, 0):
        for old in copy.glob("*.png"):
            old.unlink()
        out = call(commands()[which])
        assert (copy / "S13O00+.png").is_file() if which == 0 else re.search(r"\[100%\]", out)
        orbits.add(call(".venv/bin/saltus orbit S13O00+ --alpha 1.7"))
        place = call(".venv/bin/python -P -c 'import bvp.kernels.compiled as module; print(module.__file__)'")
        assert Path(place.strip()).is_relative_to(packages) is (which == 0)
        core = call(".venv/bin/python -P -c 'import saltus_core; print(saltus_core.__file__)'")
        assert Path(core.strip()).is_relative_to(packages if which == 0 else copy / "build")
        cores |= {(file, file.stat().st_mtime_ns) for file in copy.glob("build/core-*/CMakeFiles/saltus_core.dir/*.o")}
    assert {file.name for file, _ in cores} == {f"{file.name}.o" for file in (copy / "bvp" / "core").glob("*.cpp")}
    assert len({file for file, _ in cores}) == len(cores)  # each file was compiled once
    assert len(orbits) == 1 and "S13O00+" in orbits.pop()
    call(".venv/bin/python -m pip uninstall --yes --quiet saltus")
    assert _files(packages) | _files(scripts) == before
    assert not [file for kind in ("*.nbi", "*.nbc") for file in copy.rglob(kind)]
