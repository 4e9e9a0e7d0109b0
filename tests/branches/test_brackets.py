"""The compiled search for events inside a step. Oracle: the same functions in Python."""

import math

from hypothesis import given, settings
from hypothesis import strategies as st

from tests.continuation.test_resolution import plain_scan
from tests.lab.functions import scan

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
    assert scan(places, rows, zones, hidden, limit, guard) == expected
