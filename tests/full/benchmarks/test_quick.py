"""Every benchmark in its quick form. No time is asserted."""

import os
import shutil

import pytest

from benchmarks import hard_cases, kernels
from benchmarks.__main__ import TASKS, main

QUICK = {
    "speed-error": "--quick --out DIR",
    "continuation": "--quick",
    "building": "--small --workers 1",
    "browsing": "4 DIR",
    "sections": "--quick",
    "studies": "--runs 60 --workers 1 --sample 2",
    "forced": "--quick",
    "curves": "--quick",
    "smooth": "--quick",
    "sweeps": "--quick",
    "orbit": "S13O00+ --alpha 1.7 --tolerance 1e-5",
    "hard-cases": "--quick",
    "functions": "--repeats 1",
    "kernels": "",
}
FIRST = {
    "speed-error": "S13O00+, saltus",
    "continuation": "0 inner impacts: points",
    "building": "a build with 1 workers",
    "browsing": "a catalogue of 4 families",
    "sections": "h = 0.06",
    "studies": "60 runs, 1 workers",
    "forced": "1 degrees of freedom, 1 impacts",
    "curves": "oscillator, SN",
    "smooth": "points of cubic_nes",
    "sweeps": "impact_oscillator",
    "orbit": "shooting in nonsmooth time",
    "functions": "compiling",
    "kernels": "found the kernels of 'sections'",
}
"""The first words of progress of those that print some by `report.progress`; the hard cases show that of pytest."""


def test_each_task_is_here():
    """Oracle: the tasks. `before-now` builds two environments: its parts are in test_before_now.py of both folders."""
    assert set(QUICK) == set(TASKS) - {"before-now"}


@pytest.mark.parametrize("task", QUICK)
def test_a_quick_run_ends_and_shows_progress(task, tmp_path, capfd, monkeypatch):
    """Oracle: exit code 0, some lines of results, and a line on standard error before them that names what is measured first;
    the environment is what it was."""
    page, listed = tmp_path / "page.md", tmp_path / "kernels.json"
    shutil.copy(hard_cases.PAGE, page)
    shutil.copy(kernels.LIST, listed)
    found = kernels.recorded({"sections": kernels.EXAMPLES["section"][:1]}) if task == "kernels" else None
    monkeypatch.setattr(hard_cases, "PAGE", page)
    monkeypatch.setattr(kernels, "LIST", listed)
    monkeypatch.setattr(kernels, "recorded", lambda: found)
    environment = dict(os.environ)
    assert main([task, *QUICK[task].replace("DIR", str(tmp_path)).split()]) == 0
    assert dict(os.environ) == environment
    out, err = capfd.readouterr()
    assert len(out.splitlines()) > (1 if task in FIRST and task != "kernels" else 0)
    if task in FIRST:
        assert any(line.strip().startswith(FIRST[task]) for line in err.splitlines()), err
