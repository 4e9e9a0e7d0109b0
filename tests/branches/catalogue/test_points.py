"""The points of a family as an .npz file: to the last bit, and small for a smooth curve."""

import io
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from branches.catalogue.packing import QUERIED, as_floats, as_integers, decode, encode, folded, queried, queried_rows, unfolded
from tests.branches.catalogue.families import real, same_columns

ANY = arrays(np.uint64, array_shapes(min_dims=2, max_dims=2, min_side=0, max_side=12), elements=st.integers(0, 2**64 - 1))


def through(columns, problem):
    """Columns after encoding and decoding; the layout as it comes back from JSON."""
    arrays, layout = encode(columns, problem)
    return decode(arrays, json.loads(json.dumps(layout)), queried(queried_rows(columns)), problem)


def with_states(branch, name, values):
    """The columns of a branch with other numbers in one of them."""
    return {key: array.copy() for key, array in branch.points.items()} | {name: values}


@given(ANY)
def test_any_bits_are_integers(bits):
    """Oracle: the bits of any floating-point number: NaN with its payload, infinities, zeros of both signs."""
    numbers = bits.view(float)
    assert as_floats(as_integers(numbers)).tobytes() == numbers.tobytes()
    assert np.array_equal(unfolded(folded(bits)), bits)


def test_integers_count_the_floats_between_two_numbers():
    """Oracle: numpy's next float, also about zero; small differences of either sign are small integers."""
    values = np.array([1.5, -2.25, 1e-300, 0.0, -3e5])
    steps = as_integers(np.nextafter(values, np.inf)) - as_integers(values)
    assert np.all(steps[[0, 1, 2, 4]] == 1) and np.all(folded(steps)[[0, 1, 2, 4]] == 2)
    assert np.array_equal(folded(np.array([0, -1, 1, -2], np.int64).view(np.uint64)), [0, 1, 2, 3])


@pytest.mark.parametrize("name", ["flight_times", "start_u", "tau_half", "multipliers", "impact_speeds", "residual", "frequency"])
def test_any_numbers_come_back(name):
    """Oracle: the bits of random ones, in columns of each kind: smooth, predicted, and neither."""
    branch = real()[0]
    values = branch.points[name]
    bits = np.random.default_rng(5).integers(0, 2**64, values.nbytes // 8, dtype=np.uint64)
    columns = with_states(branch, name, bits.view(values.dtype).reshape(values.shape))
    back = through(columns, branch.problem)
    assert back[name].tobytes() == columns[name].tobytes() and same_columns(back, columns)


def test_what_others_give_takes_no_room():
    """Oracle: numbers of information: a prediction that is right leaves nothing, noise stays as large as it is, and a parabola in steps
    of a power of two has no third differences."""
    branch = real()[0]
    count = len(branch)
    size = len(encode(branch.points, branch.problem)[0])
    without = {name: values for name, values in branch.points.items() if name not in ("frequency", "frequency_index", "velocities")}
    assert size - len(encode(without, branch.problem)[0]) < 50
    noise = np.random.default_rng(3).standard_normal(count)
    noisy = len(encode(with_states(branch, "frequency", noise), branch.problem)[0])
    assert 0.7 * noise.nbytes < noisy - size < 1.1 * noise.nbytes
    parabola, random = 1.0 + np.arange(count) ** 2 * 2.0**-20, 1.0 + np.random.default_rng(3).random(count)
    small, large = (len(encode(with_states(branch, "tau_half", values), branch.problem)[0]) for values in (parabola, random))
    assert large - small > 0.7 * parabola.nbytes


def test_a_prediction_that_is_off_by_rounding_moves_the_numbers_by_as_much(monkeypatch):
    """Oracle: two neighbouring floats."""
    from branches.catalogue import packing as points

    branch = real()[1]
    arrays, layout = encode(branch.points, branch.problem)
    exact = points.PREDICTIONS["impact_speeds"]
    monkeypatch.setitem(points.PREDICTIONS, "impact_speeds", lambda *given: np.nextafter(exact(*given), np.inf))
    back = decode(arrays, layout, queried(queried_rows(branch.points)), branch.problem)
    assert np.array_equal(back["impact_speeds"], np.nextafter(branch.points["impact_speeds"], np.inf))


def test_numpy_reads_the_array():
    """Oracle: a column that is stored as it is, byte by byte."""
    branch = real()[0]
    arrays, layout = encode(branch.points, branch.problem)
    with np.load(io.BytesIO(arrays)) as file:
        stored = file["bytes"]
    listed = layout["smooth"] + layout["predicted"] + layout["plain"]
    widths = [np.dtype(dtype).itemsize * int(np.prod(shape)) for _, dtype, shape in listed]
    k = [name for name, _, _ in listed].index("residual")
    first = sum(widths[:k])
    assert np.ascontiguousarray(stored[first : first + 8].T).view(float)[:, 0].tobytes() == branch.points["residual"].tobytes()
    assert stored.shape == (sum(widths), len(branch)) and not {name for name, _, _ in listed} & set(QUERIED)


@pytest.mark.parametrize("cut", [slice(0, 0), slice(0, 40), slice(0, -30), slice(10, None)])
def test_a_blob_of_something_else_is_refused(cut):
    """Oracle: ValueError, for parts of a file, for one of another family, and for a column of text."""
    branch, other = real()[:2]
    arrays, layout = encode(branch.points, branch.problem)
    given = queried(queried_rows(branch.points))
    with pytest.raises(ValueError, match="cannot be read"):
        decode(arrays[cut], layout, given, branch.problem)
    with pytest.raises(ValueError, match="has the shape"):
        decode(encode(other.points, other.problem)[0], layout, given, branch.problem)
    with pytest.raises(ValueError, match="expected numbers"):
        encode(with_states(branch, "residual", branch.points["label"]), branch.problem)
