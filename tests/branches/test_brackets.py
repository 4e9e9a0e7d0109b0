"""The compiled search for events inside a step. Oracle: the same functions in Python."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from branches.kernels.brackets import scan_tests
from continuation.resolution import Sampled
from tests.continuation.test_resolution import plain_scan

VALUES = st.one_of(st.floats(-2.0, 2.0), st.sampled_from([0.0, math.nan, math.inf, -math.inf, 1e-9]))


@settings(max_examples=300)
@given(st.lists(st.floats(-0.2, 1.0), min_size=2, max_size=9, unique=True).map(sorted), st.data())
def test_the_compiled_scan_finds_what_python_finds(places, data):
    tests = 3
    rows = data.draw(st.lists(st.lists(VALUES, min_size=tests, max_size=tests), min_size=len(places), max_size=len(places)))
    zones = data.draw(st.lists(st.tuples(st.floats(-0.1, 0.4), st.floats(0.5, 1.1)), max_size=2))
    hidden = [[float(data.draw(st.booleans())) for _ in range(tests)] for _ in zones]
    limit, guard = data.draw(st.sampled_from([0.5, 1.0])), data.draw(st.booleans())
    expected = plain_scan(places, rows, list(range(tests)), zones, hidden, limit, guard)
    zone = np.array(zones).reshape(-1, 2), np.array(hidden).reshape(-1, tests)
    room = np.empty((tests, 4, 4)), np.zeros(tests, dtype=np.int64), *np.empty((3, len(places))), np.empty(4, dtype=np.int64)
    sampled = Sampled(np.array(places), np.array(rows), *zone, *room)
    assert scan_tests(sampled, np.arange(tests), 0, limit, int(guard), 1e-9) == expected
