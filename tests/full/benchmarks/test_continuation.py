"""Long cases of tests/benchmarks/test_continuation.py."""

import dataclasses

import pytest

from benchmarks import cases, continuation
from benchmarks.continuation import held
from benchmarks.points import QUICK
from tests.benchmarks import test_continuation as origin

system = origin.system


def test_each_special_path_is_measured_beside_the_general_one():
    """Oracle: a time of each path of each pair, and their ratio."""
    table = continuation.paths(dataclasses.replace(QUICK, points=4, repeats=1))
    assert len(table.rows) == 3
    for _, special, general, ratio in table.rows:
        assert float(ratio) == pytest.approx(float(general) / float(special), rel=0.02)


def test_memory_counts_the_arrays_and_grows_with_points(system):
    """Oracle: the arrays of the branch are part of what is held; unknowns of twice as many points are twice as many."""
    problem, y = cases.segment(system, 2)
    short, long = (held(problem, y, count) for count in (8, 16))
    assert (short.points, long.points) == (8, 16)
    assert short.arrays < short.kept <= short.most
    assert long.arrays > 1.5 * short.arrays
    assert long.kept > short.kept and long.most > short.most
