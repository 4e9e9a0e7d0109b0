"""The statistics of a study from its blocks. Oracle: numpy, on all runs at once."""

import tracemalloc

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from transitions.study.summary import quartiles

FIVE = [0.0, 0.25, 0.5, 0.75, 1.0]


@given(st.lists(st.floats(width=64), max_size=60), st.integers(1, 7))
@settings(max_examples=30)
def test_quartiles_are_those_of_numpy(values, size):
    """Any doubles, in parts of any size: equal to the last bit."""
    column = np.array(values)
    finite = column[np.isfinite(column)]
    parts = [{"x": column[k : k + size]} for k in range(0, len(column), size)]
    found = quartiles(lambda: parts, ["x"])
    if not len(finite):
        assert found == {}
        return
    with np.errstate(all="ignore"):  # the difference of two doubles can overflow in both
        assert np.array_equal(found["x"], np.quantile(finite, FIVE), equal_nan=True)


def test_memory_does_not_grow_with_the_runs():
    """Twenty times as many values in twenty times as many parts."""

    def parts(count):
        for seed in range(count):
            yield {"x": np.random.default_rng(seed).lognormal(size=1000)}

    peaks = []
    for count in (4, 80):
        tracemalloc.start()
        found = quartiles(lambda count=count: parts(count), ["x"])
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        everything = np.concatenate([part["x"] for part in parts(count)])
        assert np.array_equal(found["x"], np.quantile(everything, FIVE))
    assert peaks[1] < 1.1 * peaks[0]
