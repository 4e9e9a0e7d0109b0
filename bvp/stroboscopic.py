"""Multipliers of the stroboscopic map of an orbit, from its flights and saltation matrices.

An impact is the product right left^-1 of two matrices: it takes the velocities f- and the directions along the stop to f+ and their
reflections. Nothing is divided by its speed.

Stops that stick, and impacts that leave no speed, take directions away. A sticking stop takes two, an impact without rebound one. The
multipliers of these directions are exactly zero. The others are those of the map on what is left, which is carried round the orbit in
orthonormal bases, so that small multipliers keep their digits.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import saltus_core as core

from bvp.kernels.forced_sticking import AT_ONCE
from bvp.kernels.newton import set_scale
from bvp.kernels.orbit_multipliers import orbit_multipliers
from bvp.kernels.stroboscopic import make_stroboscopic, saltation_frames

if TYPE_CHECKING:
    from bvp.contact_sequence import ContactEvent
    from bvp.kernels.forced import LoadedSegment
    from bvp.kernels.multipoint import Factor
    from bvp.system import ImpactSystem

__all__ = ["OrbitMultipliers"]


class _Passage(NamedTuple):
    """A flight, and the saltation matrix right left^-1 at its end; None where nothing jumps. held: orthogonal to what is left in the
    flight, (N, 2 k) for k stops that stick. rank: of what is left behind the jump."""

    flight: np.ndarray
    held: np.ndarray
    left: np.ndarray | None
    right: np.ndarray | None
    rank: int


class OrbitMultipliers:
    """The multipliers of the orbits of a forced problem.

    Parameters
    ----------
    system : ImpactSystem
    events : sequence of ContactEvent
        The nodes of the orbit; () where no stop can stick.
    segment : LoadedSegment
    impacts : (k,) int64
        The flights that end with an impact.
    """

    def __init__(self, system: ImpactSystem, events: Sequence[ContactEvent], segment: LoadedSegment, impacts: np.ndarray):
        self._segment, self._impacts, self._size = segment, impacts, 2 * system.degrees_of_freedom
        self._map = make_stroboscopic(segment)
        self._events = (*events[1:], *events[:1])
        self._held = [_held(system, event) for event in events]

    def values(self, y: np.ndarray, factor: Factor, slowest: float) -> np.ndarray | None:
        """The multipliers, (2 n,) complex, in no order; None where an impact grazes, or the iteration does not converge.

        Parameters
        ----------
        y : (u,) float
            The orbit that was evaluated last.
        factor : Factor
            Its flights and their ends.
        slowest : float
            The impact speed, over the size of the velocities, below which an impact grazes.
        """
        ranks = [self._rank(i, event) for i, event in enumerate(self._events)]
        if min(ranks, default=self._size) < self._size:
            return self._deficient(y, factor, slowest, ranks)
        found = self._map.values
        return found[0] + 1j * found[1] if orbit_multipliers(self._segment, y, factor, slowest, self._map) else None

    def _rank(self, i: int, event: ContactEvent) -> int:
        """Rank of the saltation matrix of the event that ends flight i, at the orbit that was evaluated last: its restitution can vary.

        A stop that sticks takes two directions, an impact that leaves no speed one."""
        if event.is_release:
            return self._size
        return self._size - 2 * len(event.closed) - (not event.sticks and self._segment.jump[i] == AT_ONCE)

    def _deficient(self, y: np.ndarray, factor: Factor, slowest: float, ranks: Sequence[int]) -> np.ndarray | None:
        """Where a stop sticks along the orbit, or an impact leaves no speed. ranks: of what is left behind each flight's event."""
        segment, size, nodes = self._segment, self._size, len(factor.flights)
        n = size // 2
        displacement, velocity, _ = set_scale(segment, y, factor)
        scale = np.repeat([displacement, velocity], n)
        passages = []
        for i in range(nodes):
            flight, held = factor.flights[i, :size, :size] * scale / scale[:, None], self._held[i] * scale[:, None]
            passages.append(_Passage(flight, held, None, None, ranks[i]))
        for i in self._impacts.tolist():
            if segment.side[i] * (segment.gap[i, :n] @ factor.before[i, n:size]) < slowest * velocity:
                return None
            left, right = np.eye(size), np.eye(size)
            saltation_frames(segment, i, factor.before[i], scale, left, right, self._map)
            passages[i] = passages[i]._replace(left=left, right=right)
        return _deficient_eigenvalues(passages, float(segment.closing[0]))


def _held(system: ImpactSystem, event: ContactEvent) -> np.ndarray:
    """Gaps, and their rates, of the stops that stick behind an event, (2n, 2k)."""
    stops = sorted(int(system.modes.contact_stop[contact]) for contact in event.closed)
    rows = np.array([system.stops[stop].gap for stop in stops]).reshape(-1, system.degrees_of_freedom)
    return np.kron(np.eye(2), rows).T


def _deficient_eigenvalues(passages: Sequence[_Passage], sign: float) -> np.ndarray | None:
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
    steps, found, _ = core.product_eigenvalues(np.array(factors), np.array(inverse, dtype=np.int64))
    if steps < 1 or not np.all(np.isfinite(found)):
        return None
    return np.concatenate([found, zeros])


def _before(left: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Orthonormal basis of the x for which left x is orthogonal to the columns of `rest`."""
    count = rest.shape[1]
    basis: np.ndarray = np.linalg.qr(left.T @ rest, mode="complete")[0][:, count:] if count else np.eye(len(left))
    return basis
