"""Long cases of tests/benchmarks/test_auto.py."""

import numpy as np
import pytest

from benchmarks.peers.auto import Auto
from benchmarks.peers.auto_files import AutoSettings
from tests.benchmarks.test_auto import needs_auto, orbits, require_forced_orbits


@needs_auto
def test_all_ends_and_inner_impacts():
    """Oracle: saltus's own solution at each point's energy, from the unknowns that AUTO found: they hardly change."""
    seen = set()
    with Auto() as there:
        for problem, first in orbits():
            kind = problem.ends[1], min(problem.inner, 2)
            if kind in seen:
                continue
            seen.add(kind)
            run = there.follow(problem, first, AutoSettings(intervals=6, step=0.001, points=3))
            for point in run.points:
                y = point.unknowns(problem)
                exact = problem.solve(y, energy=point.h).y
                assert np.max(np.abs(y - exact)) < 1e-9 * np.max(np.abs(exact)), (problem.ends, problem.sequence, point.h)
    assert {"origin", "rest", "stop+", "stop-"} == {end for end, _ in seen} and len(seen) >= 5


@needs_auto
@pytest.mark.parametrize("times", [1, 3])
def test_forced_orbits(times):
    """Oracle: see `require_forced_orbits`."""
    require_forced_orbits(times)
