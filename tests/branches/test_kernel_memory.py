"""Kernels hold no array that they make. Oracle: the C library's own count of the bytes in use."""

import ctypes
import gc

import numpy as np
import pytest

from branches.family import Family
from bvp.kernels.flight import Flight, flow_matrix, flow_state
from bvp.multipliers import saddle_point_multipliers
from bvp.multipoint import MultipointProblem
from bvp.system import vibro_impact_nes
from continuation import Settings, follow_both_ways
from tests.branches.traced import traced


class _Information(ctypes.Structure):
    """struct mallinfo2 of glibc."""

    _names = "arena ordblks smblks hblks hblkhd usmblks fsmblks uordblks fordblks keepcost"
    _fields_ = tuple((name, ctypes.c_size_t) for name in _names.split())


def held():
    """Bytes that the C library has handed out."""
    gc.collect()
    try:
        information = ctypes.CDLL(None).mallinfo2
    except (AttributeError, TypeError, OSError):
        pytest.skip("the C library does not count its bytes")
    information.restype = _Information
    found = information()
    return found.uordblks + found.hblkhd


def test_following_families_frees_all_arrays():
    branch = traced("S73O33-")
    y = branch.unknowns(len(branch) // 2)

    def work():
        run = follow_both_ways(Family(branch.problem), y, Settings(maximum_points=60))
        saddle_point_multipliers(branch.orbit(len(branch) // 2).cycle)
        return len(run.points)

    assert work() == 60
    before = held()
    for _ in range(10):
        assert work() == 60
    assert held() < before + 60 * 10 * 48  # less than the record of one array for each point


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
    for _ in range(3000):
        flow_state(flight, z, 0.7, out)
        flow_matrix(flight, 0.7, flow)
    assert held() < before + 3000 * 48  # the record of one array has 48 bytes


def test_views_of_a_system_outlive_the_kernels():
    """Arrays that only a problem holds are as they were after many calls."""
    branch = traced("S13O00+")
    system = vibro_impact_nes()
    follow_both_ways(Family(branch.problem), branch.unknowns(20), Settings(maximum_points=200))
    other = MultipointProblem(system, branch.problem.ends, branch.problem.sequence)
    np.testing.assert_array_equal(branch.problem.start_map, other.start_map)
