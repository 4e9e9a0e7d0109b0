"""The first run: kernels that are on disk are recognised, and a cold folder is filled by the second process's own work."""

from __future__ import annotations

import subprocess
import sys

from saltus import first_run


def test_kernels_that_were_used_are_kept_and_nothing_is_started(monkeypatch, capsys):
    """Oracle: after a family was traced the kernels are on disk, and `prepare` must neither speak nor start a process."""
    import saltus

    saltus.trace("S13O00+", saltus.vibro_impact_nes(), energy=(0.5, 0.6))
    monkeypatch.setattr(subprocess, "Popen", lambda *args, **options: (_ for _ in ()).throw(AssertionError("a process was started")))
    first_run.prepare()
    assert capsys.readouterr() == ("", "")


def test_a_second_process_that_cannot_start_is_no_failure(monkeypatch):
    """Oracle: the command goes on where the operating system refuses a process."""

    def refuse(*args, **options):
        raise OSError("no more processes")

    monkeypatch.setattr(subprocess, "Popen", refuse)
    monkeypatch.setattr("branches.kernels.warm.kept", lambda **options: False)
    first_run.prepare()


def test_cold_kernels_start_the_compiling_process(monkeypatch):
    """Oracle: the process is this Python, running `branches.kernels.warm` with this process's paths."""
    seen = {}
    monkeypatch.setattr(subprocess, "Popen", lambda command, **options: seen.update(command=command, env=options["env"]))
    monkeypatch.setattr("branches.kernels.warm.kept", lambda **options: False)
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    first_run.prepare()
    assert seen["command"] == [sys.executable, "-m", "branches.kernels.warm"]
    assert all(path in seen["env"]["PYTHONPATH"] for path in sys.path if path)
