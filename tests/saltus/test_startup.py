"""The first run: kernels that are on disk are recognised, and a cold folder is filled by the second process's own work."""

from __future__ import annotations

import subprocess
import sys

import pytest

from saltus import processes

TELL = processes._report
"""As it is outside the tests, which are not to depend on what was compiled before them."""


def test_kernels_that_were_used_are_kept_and_nothing_is_started(monkeypatch, capsys):
    """Oracle: after a family was traced the kernels are on disk, and `prepare` must neither speak nor start a process."""
    import saltus

    saltus.trace("S13O00+", saltus.vibro_impact_nes(), energy=(0.5, 0.6))
    monkeypatch.setattr(subprocess, "Popen", lambda *args, **options: (_ for _ in ()).throw(AssertionError("a process was started")))
    processes.prepare()
    assert capsys.readouterr() == ("", "")


def test_a_second_process_that_cannot_start_is_no_failure(monkeypatch):
    """Oracle: the command goes on where the operating system refuses a process."""

    def refuse(*args, **options):
        raise OSError("no more processes")

    monkeypatch.setattr(subprocess, "Popen", refuse)
    monkeypatch.setattr("branches.warm.kept", lambda **options: False)
    processes.prepare()


def test_cold_kernels_start_the_compiling_process(monkeypatch):
    """Oracle: the process is this Python, running `branches.warm` with this process's paths."""
    seen = {}
    monkeypatch.setattr(subprocess, "Popen", lambda command, **options: seen.update(command=command, env=options["env"]))
    monkeypatch.setattr("branches.warm.kept", lambda **options: False)
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    processes.prepare()
    assert seen["command"] == [sys.executable, "-m", "branches.warm"]
    assert all(path in seen["env"]["PYTHONPATH"] for path in sys.path if path)


@pytest.mark.parametrize("missing", ["advance_block", "move", "scan_interval"])
def test_what_a_command_needs_is_looked_for(monkeypatch, missing):
    """Oracle: one kernel is taken for not compiled; who needs it says so, and no other does."""
    from branches.warm import kept

    monkeypatch.setattr("bvp.kernels.compiled.stored", lambda kernel: kernel.py_func.__name__ != missing)
    assert kept() is (missing != "advance_block")
    assert not kept(impulsive=True)
    assert kept(discovery=True) is (missing not in ("advance_block", "scan_interval"))


@pytest.mark.parametrize(
    ("words", "asked"),
    [
        ("impulsive --energy 1:2", {"impulsive": True}),
        ("export fep --plot a.png --catalogue {catalogue} --impulsive", {"impulsive": True}),
        ("discover --energy 1", {"discovery": True}),
        ("continue S13O00+", {}),
    ],
)
def test_commands_ask_for_the_kernels_that_they_use(monkeypatch, catalogue, tmp_path, words, asked):
    """Oracle: the kernels by hand; the command ends where it asks."""
    from saltus.__main__ import main

    seen = {}

    def stop(**kernels):
        seen.update(kernels)
        raise KeyboardInterrupt

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("saltus.processes.prepare", stop)
    assert main(words.format(catalogue=catalogue).split()) == 130
    assert seen == asked


@pytest.mark.parametrize("missing", [False, True])
def test_a_damped_run_says_that_it_compiles(monkeypatch, capsys, missing):
    """Oracle: one line, on a terminal or not, where the kernel is taken for not compiled, else nothing."""
    from bvp.kernels.motion import move

    monkeypatch.setattr("bvp.kernels.compiled.stored", lambda kernel: not missing or kernel.py_func.__name__ != "move")
    monkeypatch.setattr(processes, "_report", TELL)
    processes.report_compiling(move)
    out, err = capsys.readouterr()
    assert out == "" and ("compiling the kernels" in err) is missing
