"""A compiled core that is missing, broken or old is said in one line. Oracle: the words and exit codes of new processes."""

import os
import subprocess
import sys

import pytest
import saltus_core

ABSENT = "raise ImportError(\"No module named 'saltus_core'\", name='saltus_core')"
OLD = f"POINT_NAMES = {tuple(saltus_core.POINT_NAMES)}"


def run(folder, core, *words):
    """A process that finds a text in the place of the core."""
    (folder / "saltus_core.py").write_text(core)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), *filter(None, sys.path)])}
    return subprocess.run([sys.executable, "-P", *words], capture_output=True, text=True, env=environment)


@pytest.mark.parametrize(("core", "fault"), [(ABSENT, "cannot be imported"), (OLD, "is older than the program")])
def test_a_command_says_which_command_compiles_the_core(tmp_path, core, fault):
    done = run(tmp_path, core, "-m", "saltus", "discover", "--energy", "1")
    assert done.returncode == 2 and done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"saltus: the compiled core of saltus {fault} (")
    assert "; compile it: " in line and " -m pip install " in line


def test_without_the_core_public_names_are_refused_and_the_help_works(tmp_path):
    done = run(tmp_path, ABSENT, "-c", "import saltus; saltus.trace")
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith("ImportError: the compiled core of saltus cannot be imported (No module named")
    done = run(tmp_path, ABSENT, "-m", "saltus", "--help")
    assert done.returncode == 0 and done.stderr == "" and done.stdout.startswith("usage: saltus")


def test_the_help_loads_nothing_heavy():
    """Oracle: the modules of a new process."""
    seen = "import atexit, sys; atexit.register(lambda: print({'numpy', 'numba', 'scipy', 'sympy'} & set(sys.modules)))"
    code = f"{seen}; from saltus.__main__ import main; main(['--help'])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout.splitlines()[-1] == "set()"
