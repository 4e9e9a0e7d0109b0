"""Long cases of tests/benchmarks/test_before_now.py."""

from __future__ import annotations

import json
import os
import subprocess
import sys

from benchmarks import before_now


def test_the_points_are_measured_for_each_number_of_degrees_of_freedom():
    """Oracle: the names of the figures, each above zero."""
    script = before_now._POINTS.replace("seconds=1.0", "seconds=0.0")
    environment = {**os.environ, "PYTHONPATH": os.getcwd()}
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True)
    found = json.loads(done.stdout.splitlines()[-1])
    assert set(found) == {f"point {n}" for n in (2, 3, 5, 12)} | {f"multipliers {n} {k}" for n in (2, 3, 5, 12) for k in (2, 64)} | {
        name for name in found if name.startswith("S11O00- at h = 1e4")
    }
    assert min(found.values()) > 0.0 and "S11O00- at h = 1e4" in found
