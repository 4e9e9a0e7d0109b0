"""The benchmark of the elementary functions: its tables are complete. No time is asserted."""

import shutil

import pytest

from benchmarks.functions import function_tables


@pytest.mark.skipif(not any(map(shutil.which, ("c++", "g++", "clang++"))), reason="the benchmark needs a C++ compiler")
def test_tables():
    """Oracle: counts, and the sign of a time."""
    functions, flights = function_tables(1)
    assert len(functions.rows) == 17 and all(len(row) == len(functions.columns) for row in functions.rows)
    assert all(float(text) > 0.0 for row in functions.rows for text in row[2:])
    assert [row[0] for row in flights.rows] == ["2", "3", "5", "12"]
    assert all(float(text) > 0.0 for row in flights.rows for text in row[1:])
