"""Multipliers of a stroboscopic map without full rank: stops that stick, and impacts that leave no speed, take directions away.

A sticking stop takes two directions, an impact without rebound one. The multipliers of these directions are exactly zero. The others are
those of the map on what is left, which is carried round the orbit in orthonormal bases, so that small multipliers keep their digits.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from bvp.kernels.periodic_qr import product_eigenvalues

__all__ = ["Passage", "deficient_eigenvalues"]


class Passage(NamedTuple):
    """A flight, and the saltation matrix right left^-1 at its end; None where nothing jumps. held: orthogonal to what is left in the
    flight, (N, 2 k) for k stops that stick. rank: of what is left behind the jump."""

    flight: np.ndarray
    held: np.ndarray
    left: np.ndarray | None
    right: np.ndarray | None
    rank: int


def deficient_eigenvalues(passages: Sequence[Passage], sign: float) -> np.ndarray | None:
    """Eigenvalues of sign times the product of some passages, (N,) complex, in no order; None where the iteration does not converge."""
    size = len(passages[0].flight)
    narrow = min(range(len(passages)), key=lambda i: passages[i].rank)
    rank = passages[narrow].rank
    zeros = np.zeros(size - rank, dtype=complex)
    if not rank:
        return zeros
    left, right = passages[narrow].left, passages[narrow].right
    assert left is not None and right is not None
    first: np.ndarray = np.linalg.svd(right @ _before(left, passages[narrow].held))[0][:, :rank]
    basis, factors, inverse = first, [], []
    for passage in (*passages[narrow + 1 :], *passages[: narrow + 1]):
        basis, factor = np.linalg.qr(passage.flight @ basis)
        factors.append(factor)
        inverse.append(0)
        if passage.left is None or passage.right is None:
            continue
        # The basis before the impact, of which `left` makes the directions of the basis: nothing is divided by its speed.
        inside = _before(passage.left, np.linalg.qr(basis, mode="complete")[0][:, rank:])
        factors.append(basis.T @ passage.left @ inside)
        inverse.append(1)
        basis, factor = np.linalg.qr(passage.right @ inside)
        factors.append(factor)
        inverse.append(0)
    factors[-1] = sign * (first.T @ basis @ factors[-1])
    found = np.empty((2, rank))
    steps = product_eigenvalues(
        np.array(factors), np.array(inverse, dtype=np.int64), np.empty((3, 3)), np.empty((rank, rank)), found
    )  # fmt: skip
    if steps < 1 or not np.all(np.isfinite(found)):
        return None
    return np.concatenate([found[0] + 1j * found[1], zeros])


def _before(left: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Orthonormal basis of the x for which left x is orthogonal to the columns of `rest`."""
    count = rest.shape[1]
    basis: np.ndarray = np.linalg.qr(left.T @ rest, mode="complete")[0][:, count:] if count else np.eye(len(left))
    return basis
