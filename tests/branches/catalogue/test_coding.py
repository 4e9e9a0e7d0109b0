"""Columns as blobs: to the last bit, and small where a curve is smooth."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from branches.catalogue.coding import decode, encode

ANY = arrays(np.uint64, array_shapes(min_dims=2, max_dims=2, min_side=0, max_side=12), elements=st.integers(0, 2**64 - 1))


@given(ANY, ANY)
def test_any_bits_come_back(bits, other):
    """Oracle: the bits themselves, of any floating-point number: NaN with its payload, infinities, zeros of both signs; whatever is
    predicted."""
    columns = bits.view(float)
    assert decode(encode(columns), *columns.shape).tobytes() == columns.tobytes()
    predicted = np.resize(other.view(float), columns.shape) if other.size else None
    assert decode(encode(columns, predicted), *columns.shape, predicted).tobytes() == columns.tobytes()


def test_what_is_foreseen_takes_no_room():
    """Oracle: numbers of information: a polynomial of degree 2 in steps of a power of two has differences that vanish; a prediction that is
    right leaves nothing; noise stays as large as it is."""
    steps = np.arange(1024.0)[:, None]
    assert len(encode(1.0 + steps * 2.0**-12)) < 100
    noise = np.random.default_rng(3).standard_normal((1024, 1))
    assert len(encode(noise, noise)) < 100
    assert 0.8 * noise.nbytes < len(encode(noise)) < 1.02 * noise.nbytes


def test_a_prediction_that_is_off_by_rounding_moves_the_numbers_by_as_much():
    """Oracle: two neighbouring floating-point numbers, also about zero."""
    values = np.array([[1.5], [-2.25], [1e-300], [0.0], [-3e5]])
    blob = encode(values, values)
    again = decode(blob, 5, 1, np.nextafter(values, np.inf))
    assert np.array_equal(again, np.nextafter(values, np.inf))


@pytest.mark.parametrize("blob", [b"", b"\0", b"\0no zlib", encode(np.ones((3, 1))), encode(np.ones((4, 2)))])
def test_a_blob_of_something_else_is_refused(blob):
    """Oracle: ValueError."""
    with pytest.raises(ValueError, match=r"holds|decompressed"):
        decode(blob, 4, 1)
