"""The points of a family as an .npz file: to the last bit, and small for a smooth curve."""

import io
import json

import numpy as np
import pytest

from branches.catalogue.packing import QUERIED, decode, encode, queried, queried_rows
from tests.branches.catalogue.families import real, same_columns

SPECIAL = np.array([np.nan, -np.nan, np.inf, -np.inf, -0.0, 0.0, 5e-324]).view(np.uint64) | np.array([5, 7, 0, 0, 0, 0, 0], np.uint64)
"""Bits of NaN with a payload, infinities, zeros of both signs, and the smallest number."""


def through(columns, problem):
    """Columns after encoding and decoding; the layout as it comes back from JSON."""
    arrays, layout = encode(columns, problem)
    return decode(arrays, json.loads(json.dumps(layout)), queried(queried_rows(columns)), problem)


def with_states(branch, name, values):
    """The columns of a branch with other numbers in one of them."""
    return {key: array.copy() for key, array in branch.points.items()} | {name: values}


@pytest.mark.parametrize("name", ["flight_times", "start_u", "tau_half", "multipliers", "impact_speeds", "residual", "frequency"])
def test_any_numbers_come_back(name):
    """Oracle: the bits of random and of special ones, in columns of each kind: smooth, predicted, and neither."""
    branch, dice = real()[0], np.random.default_rng(5)
    values = branch.points[name]
    bits = dice.integers(0, 2**64, values.nbytes // 8, dtype=np.uint64)
    bits[::3] = dice.choice(SPECIAL, len(bits[::3]))
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
