"""Test functions of families, the search for events between samples, and links between spectral maxima."""

import math

import numpy as np
import saltus_core as core

from branches.kernels.brackets import scan_tests
from bvp.multipoint import RESULT_INDEX
from continuation.resolution import Sampled
from transitions.kernels import Maxima
from transitions.kernels import link as _link

__all__ = ["half_map_tests", "link", "scan", "distances_from_bounds"]


def _made_up(**entries):
    result = np.zeros(len(RESULT_INDEX))
    for name, value in entries.items():
        result[RESULT_INDEX[name]] = value
    return result


def half_map_tests(phi, speeds, ends, quarters, targets):
    """Return the test functions beside the common ones of an orbit with two degrees of freedom: the entries of its half map phi times the
    product of its impacts' speeds, then the distances of the trace from the targets, times its square. quarters: 1 where a quarter period
    is solved, which has the trace of the half period before the targets; else 2."""
    start, finish = (end == "origin" for end in ends)
    return core.half_map_tests(np.array(phi, float), start, finish, 1.0, quarters, False, speeds, 0.1, np.array(targets, float))


def distances_from_bounds(h, alpha, energy=(0.0, math.inf), longest=math.inf):
    """Return the three functions that vanish where a family leaves a range of energies or reaches the longest quarter period."""
    low, high, longest = (math.log(value) if value else -math.inf for value in (*energy, longest))
    return core.common_tests(_made_up(energy=h, quarter_period=alpha), low, high, longest, core.TANGENT_NOISE)[5:8]


def scan(places, rows, zones, hidden, limit, guard, floor=1e-9):
    """Return the brackets of events between samples, as `continuation.resolution` looks for them.

    places (N,), rows (N, M) : where the test functions were sampled, and their values
    zones (Z, 2), hidden (Z, M) : intervals in which functions are not looked at
    """
    tests = np.shape(rows)[1]
    zone = np.array(zones).reshape(-1, 2), np.array(hidden).reshape(-1, tests)
    room = np.empty((tests, 4, 4)), np.zeros(tests, dtype=np.int64), *np.empty((3, len(places))), np.empty(4, dtype=np.int64)
    sampled = Sampled(np.array(places), np.array(rows), *zone, *room)
    return scan_tests(sampled, np.arange(tests), 0, limit, int(guard), floor)


def link(columns, level, bounds, reach, spacing, drift, step):
    """Return for each spectral maximum the index of the one that follows it, -1 for none (`transitions.stages`)."""
    count = len(columns)
    following, opened = np.empty((2, count), dtype=np.int64)
    _link(Maxima(columns, level, bounds, reach), spacing, drift, step, following, np.empty(count, dtype=np.bool_), opened)
    return following
