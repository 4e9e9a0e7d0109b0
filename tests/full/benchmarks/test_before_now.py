"""Long cases of tests/benchmarks/test_before_now.py."""

from __future__ import annotations

import sys
from pathlib import Path

from benchmarks import before_now
from benchmarks.figures import FIGURES


def test_each_figure_is_measured(monkeypatch, tmp_path):
    """Oracle: the names of the figures, each above zero; AUTO-07p need not be there."""
    monkeypatch.setattr(before_now, "_SECONDS", 0.0)
    found, failed = before_now._points(before_now.Side("now", Path.cwd(), Path(sys.executable)), tmp_path, "")
    assert failed == {}
    assert set(FIGURES) - set(found) <= {"S11O00- at h = 1e4, AUTO-07p"}
    assert min(found.values()) > 0.0
