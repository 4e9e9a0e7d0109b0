"""`python -m benchmarks before-now`: what it measures, and what it refuses."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks import before_now, figures
from benchmarks.__main__ import main
from bvp.kernels.stored import cache_root


class Counted:
    """Stands for a side: each process takes as many seconds as there were processes before."""

    def __init__(self):
        self.asked = []

    def processor(self, words, cache, wall=False):
        self.asked.append((tuple(words), wall))
        return float(len(self.asked))


def test_a_first_run_finds_only_what_the_runs_before_it_left(tmp_path):
    """Oracle: the processes by hand; an old cache folder is removed."""
    cache = tmp_path / "cache"
    cache.mkdir()
    side = Counted()
    assert before_now._first(("a",), ("b",))(side, cache) == 2.0
    assert side.asked == [(("a",), False), (("b",), True)] and not cache.exists()


def test_a_warm_run_is_the_least_of_a_few(tmp_path):
    """Oracle: the processes by hand; the first one, which may compile, does not count."""
    side = Counted()
    assert before_now._warm(("a",), repeats=3)(side, tmp_path) == 2.0
    assert len(side.asked) == 4


def test_a_commit_that_does_not_exist_is_named(capsys):
    """Oracle: one line and exit code 2."""
    assert main(["before-now", "--commit", "nonesuch"]) == 2
    assert "nonesuch" in capsys.readouterr().err


def test_the_memory_is_that_of_the_study(tmp_path):
    """Oracle: the bounds of any process that imports numpy, and the files that the study writes."""
    (tmp_path / "saltus-kernels").symlink_to(cache_root())  # nothing is compiled that is there already
    side = before_now.Side("now", Path.cwd(), Path(sys.executable))
    assert 30.0 < before_now._memory(3)(side, tmp_path) < 1000.0


def test_the_table_has_a_row_for_each_figure(monkeypatch, capsys):
    """Oracle: the ratios by hand."""
    monkeypatch.setattr(before_now, "_made", lambda name, commit, place: before_now.Side(name, place, place))
    monkeypatch.setattr(before_now, "_points", lambda side, cache, only: ({"point 3": 4e-6 if side.name == "before" else 1e-6}, {}))
    monkeypatch.setattr(before_now, "ROWS", {"a run": ("s", lambda side, cache: 6.0 if side.name == "before" else 2.0)})
    assert main(["before-now", "--rounds", "2"]) == 0
    out = capsys.readouterr().out
    rows = {line.strip().split("  ")[0]: line.split()[-3:] for line in out.splitlines() if line.lstrip().startswith(("a run", "point 3"))}
    assert rows == {"a run": ["6", "2", "3"], "point 3": ["4", "1", "4"]}


def test_a_figure_that_fails_does_not_cost_the_others(monkeypatch):
    """Oracle: the figures by hand; one without a number has none."""

    def fails(seconds):
        raise ImportError("no module named kernels")

    monkeypatch.setattr(figures, "FIGURES", {"a": (lambda seconds, k: k * seconds, 3), "b": (fails,), "c": (lambda seconds: None,)})
    assert figures.measured(2.0, ["a", "b", "c"]) == ({"a": 6.0}, {"b": "ImportError: no module named kernels"})


def test_the_source_is_counted_in_any_language(tmp_path):
    """Oracle: by hand."""
    (tmp_path / "bvp/core").mkdir(parents=True)
    for name, lines in {"bvp/a.py": 3, "bvp/core/b.hpp": 2, "bvp/core/c.cpp": 5, "bvp/notes.md": 7, "other.py": 11}.items():
        (tmp_path / name).write_text("x\n" * lines, encoding="utf-8")
    side = before_now.Side("now", tmp_path, Path(sys.executable))
    assert before_now._lines(side, tmp_path) == 10 and len(before_now._source(side)) == 3


def test_a_row_that_fails_does_not_cost_the_others(monkeypatch, capsys):
    """Oracle: the rows by hand, and the last line of the process that failed."""

    def fails(side, cache):
        raise subprocess.CalledProcessError(1, ["saltus"], stderr="first\nno room on the disk\n")

    monkeypatch.setattr(before_now, "_made", lambda name, commit, place: before_now.Side(name, place, place))
    monkeypatch.setattr(before_now, "_points", lambda side, cache, only: ({}, {"point 3": "no such name"} if side.name == "now" else {}))
    rows = {"a run": ("s", lambda side, cache: 6.0), "a build": ("s", fails), "other": ("s", lambda side, cache: 1.0)}
    monkeypatch.setattr(before_now, "ROWS", rows)
    assert main(["before-now", "--only", "a "]) == 0
    out = capsys.readouterr().out
    assert "a run" in out and "other" not in out
    assert "Not measured now: point 3. no such name" in " ".join(out.split())
    assert "Not measured: a build. A process ended with code 1 and said: no room on the disk" in " ".join(out.split())


def test_a_build_that_could_not_follow_a_family_is_measured(monkeypatch, tmp_path):
    """Oracle: processes that end with the codes 0, 1 and 2. Only the row of the build takes a 1."""
    side = before_now.Side("now", tmp_path, Path(sys.executable))
    for code in (0, 1, 2):
        monkeypatch.setattr(before_now, "_BUILD", ("-c", f"raise SystemExit({code})"))
        for allowed, measured in ((code < 2, before_now._build), (code == 0, lambda side, cache: side.processor(before_now._BUILD, cache))):
            if allowed:
                assert measured(side, tmp_path) >= 0.0
            else:
                with pytest.raises(subprocess.CalledProcessError):
                    measured(side, tmp_path)
