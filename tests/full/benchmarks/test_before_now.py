"""Long cases of tests/benchmarks/test_before_now.py."""

from __future__ import annotations

import json
import os
import subprocess
import sys

from benchmarks import before_now
from benchmarks.figures import FIGURES


def test_each_figure_is_measured():
    """Oracle: the names of the figures, each above zero; AUTO-07p need not be there."""
    environment = {**os.environ, "PYTHONPATH": os.getcwd()}
    done = subprocess.run([sys.executable, "-c", before_now._FIGURES, "0", ""], env=environment, capture_output=True, text=True, check=True)
    found, failed = json.loads(done.stdout.splitlines()[-1])
    assert failed == {}
    assert set(FIGURES) - set(found) <= {"S11O00- at h = 1e4, AUTO-07p"}
    assert min(found.values()) > 0.0
