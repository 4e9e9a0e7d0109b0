"""Kernels hold no array that they make. Oracle: the counts of arrays made and freed that numba's run time keeps."""

import gc

import numpy as np
import pytest
from numba.core.runtime import _nrt_python, rtsys

from branches.family import Family
from bvp.kernels.flight import Flight, flow_matrix, flow_state
from bvp.multipliers import saddle_point_multipliers
from bvp.system import vibro_impact_nes
from continuation import Settings, follow_both_ways
from tests.branches.traced import traced


@pytest.fixture(autouse=True)
def counting():
    traced("S13O00+")  # the run time exists once a kernel was called
    _nrt_python.memsys_enable_stats()
    yield
    _nrt_python.memsys_disable_stats()


def held():
    gc.collect()
    stats = rtsys.get_allocation_stats()
    return stats.alloc - stats.free


def test_following_families_frees_all_arrays():
    branch = traced("S73O33-")
    y = branch.unknowns(len(branch) // 2)

    def work():
        run = follow_both_ways(Family(branch.problem), y, Settings(maximum_points=60))
        saddle_point_multipliers(branch.orbit(len(branch) // 2).cycle)
        return len(run.points)

    assert work() == 60
    before = held()
    assert work() == 60
    assert held() == before


def test_blocks_of_three_free_their_exponentials():
    """The exponential of a block that is no pair is made in an array of its own."""
    matrix = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-0.1, -1.0, -0.2]])
    flight = Flight(np.array([[0, -3]]), np.array([matrix.trace() / 3.0]), np.zeros(1), matrix)
    out, flow = np.empty(3), np.empty((3, 3))
    z = np.array([1.0, 2.0, 3.0])
    flow_state(flight, z, 0.7, out)
    flow_matrix(flight, 0.7, flow)
    np.testing.assert_allclose(flow @ z, out, rtol=1e-14)
    before = held()
    for _ in range(10):
        flow_state(flight, z, 0.7, out)
        flow_matrix(flight, 0.7, flow)
    assert held() == before


def test_views_of_a_system_outlive_the_kernels():
    """Arrays that only a problem holds are as they were after many calls."""
    branch = traced("S13O00+")
    system = vibro_impact_nes()
    follow_both_ways(Family(branch.problem), branch.unknowns(20), Settings(maximum_points=200))
    np.testing.assert_array_equal(branch.problem.segment.flight.matrix, system.modes.matrix)
    np.testing.assert_array_equal(branch.problem.segment.weights[2:], np.ones(2))
