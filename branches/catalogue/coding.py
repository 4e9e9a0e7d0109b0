"""Columns of float64 as small blobs, and back, bit for bit.

Numbers are mapped to integers in their order. The prediction is taken away, where a formula gives one, then differences of neighbours along
the family are taken, once or several times: what is left is small where the curve is smooth. It is stored by bytes of equal weight, and
compressed. A prediction need not be right: one that is off by rounding, as between machines, moves the numbers by as much.
"""

from __future__ import annotations

import zlib

import numpy as np

__all__ = ["decode", "encode"]

_ORDERS = 5
"""How many orders of differences are tried, from none on."""


def encode(columns: np.ndarray, predicted: np.ndarray | None = None) -> bytes:
    """A blob of columns.

    Parameters
    ----------
    columns : (N, w) float
    predicted : (N, w) float, optional
        Numbers near those of the columns; where one is not finite, nothing is predicted.

    Returns
    -------
    bytes
        The orders of differences, a byte for each column, and the compressed numbers.

    Examples
    --------
    >>> columns = np.sqrt(np.arange(1.0, 1001.0))[:, None]
    >>> np.array_equal(decode(encode(columns), 1000, 1), columns), len(encode(columns)) < 0.7 * columns.nbytes
    (True, True)
    """
    count, width = columns.shape
    left = _integers(columns) - _offsets(count, width, predicted)
    orders = np.zeros(width, np.uint8)
    best = left.copy()
    sizes = _size(left)
    for order in range(1, min(_ORDERS, count)):
        left = np.concatenate([left[:1], left[1:] - left[:-1]])
        now = _size(left)
        better = now < sizes
        orders[better] = order
        best[:, better] = left[:, better]
        sizes = np.minimum(sizes, now)
    planes = np.ascontiguousarray(_folded(best).T).view(np.uint8).reshape(-1, 8).T
    return orders.tobytes() + zlib.compress(planes.tobytes(), 9)


def decode(blob: bytes, count: int, width: int, predicted: np.ndarray | None = None) -> np.ndarray:
    """The inverse of `encode`, (count, width) float.

    Raises
    ------
    ValueError
        For a blob that does not hold so many numbers.
    """
    orders = np.frombuffer(blob[:width], np.uint8)
    try:
        planes = zlib.decompress(blob[width:])
    except zlib.error as error:
        raise ValueError(f"it cannot be decompressed: {error}") from error
    if len(orders) != width or len(planes) != 8 * count * width:
        raise ValueError(f"it holds {len(planes)} bytes, expected {8 * count * width}")
    folded = np.ascontiguousarray(np.frombuffer(planes, np.uint8).reshape(8, -1).T).view("<u8").reshape(width, count).T
    numbers = (folded >> np.uint64(1)) ^ (np.uint64(0) - (folded & np.uint64(1)))
    for order in range(1, int(orders.max(initial=0)) + 1):
        some = orders >= order
        numbers[:, some] = np.cumsum(numbers[:, some], axis=0, dtype=np.uint64)
    return _floats(numbers + _offsets(count, width, predicted))


def _offsets(count: int, width: int, predicted: np.ndarray | None) -> np.ndarray:
    if predicted is None:
        return np.zeros((count, width), np.uint64)
    return _integers(np.where(np.isfinite(predicted), predicted, 0.0))


def _integers(values: np.ndarray) -> np.ndarray:
    """Unsigned integers whose differences, modulo 2^64, count the floats between two values."""
    bits = np.ascontiguousarray(values, "<f8").view("<i8")
    return (bits ^ ((bits >> 63) & np.int64(0x7FFFFFFFFFFFFFFF))).view("<u8")


def _floats(integers: np.ndarray) -> np.ndarray:
    bits = np.ascontiguousarray(integers).view("<i8")
    return (bits ^ ((bits >> 63) & np.int64(0x7FFFFFFFFFFFFFFF))).view("<f8").astype(float)


def _folded(differences: np.ndarray) -> np.ndarray:
    """Small unsigned integers for small differences of either sign."""
    signed = differences.view("<i8")
    return ((signed << 1) ^ (signed >> 63)).view("<u8")


def _size(differences: np.ndarray) -> np.ndarray:
    """Bits that the numbers of each column take, (w,)."""
    return np.log2(_folded(differences).astype(float) + 1.0).sum(axis=0)
