"""Multipliers of the stroboscopic map of an orbit, from its flights and saltation matrices.

An impact is the product right left^-1 of two matrices: it takes the velocities f- and the directions along the stop to f+ and their
reflections. Nothing is divided by its speed.

Stops that stick, and impacts that leave no speed, take directions away. A sticking stop takes two, an impact without rebound one. The
multipliers of these directions are exactly zero. The others are those of the map on what is left, which is carried round the orbit in
orthonormal bases, so that small multipliers keep their digits.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from bvp.kernels.periodic_qr import product_eigenvalues
from bvp.kernels.stroboscopic import Stroboscopic, saltation_frames

if TYPE_CHECKING:
    from bvp.contact_sequence import ContactEvent
    from bvp.system import ImpactSystem

__all__ = ["loses_directions", "stroboscopic_multipliers"]


class _Passage(NamedTuple):
    """A flight, and the saltation matrix right left^-1 at its end; None where nothing jumps. held: orthogonal to what is left in the
    flight, (N, 2 k) for k stops that stick. rank: of what is left behind the jump."""

    flight: np.ndarray
    held: np.ndarray
    left: np.ndarray | None
    right: np.ndarray | None
    rank: int


def stroboscopic_multipliers(
    system: ImpactSystem, events: Sequence[ContactEvent], segment: Any, impacts: np.ndarray, factor: Any, scale: np.ndarray,
    work: Stroboscopic,
) -> np.ndarray | None:
    """Multipliers of an orbit whose residual was evaluated last.

    Parameters
    ----------
    system : ImpactSystem
    events : sequence of ContactEvent
        The nodes of the orbit; () where no stop can stick.
    segment : LoadedSegment
    impacts : (k,) int
        The flights that end with an impact.
    factor : Factor
        Its flights and their ends are those of the orbit.
    scale : (2 n,) float
        Sizes of the states.
    work : Stroboscopic

    Returns
    -------
    (2 n,) complex or None
        In no order; None where the iteration does not converge.
    """
    size, nodes = len(scale), len(factor.flights)
    left, right = np.tile(np.eye(size), (2, nodes, 1, 1))
    flights = factor.flights[:, :size, :size] * scale / scale[:, None]
    for i in impacts:
        saltation_frames(segment, i, factor.before[i], scale, left[i], right[i], work)
    ranks = [_rank(system, events[(i + 1) % nodes]) if events else size for i in range(nodes)]
    if min(ranks) < size:
        held = [_held(system, event) * scale[:, None] for event in events]
        jumps = [(left[i], right[i]) if i in impacts % nodes else (None, None) for i in range(nodes)]
        passages = [_Passage(flights[i], held[i], jumps[i][0], jumps[i][1], ranks[i]) for i in range(nodes)]
        return _deficient_eigenvalues(passages, float(segment.closing[0]))
    chain = np.empty((2 * nodes, size, size))
    chain[::2] = left
    chain[1::2] = np.roll(flights, -1, axis=0) @ right
    chain[-1] *= segment.closing[0]
    inverse, matrix, found = np.tile(np.array([1, 0], np.int64), nodes), np.empty((size, size)), np.empty((2, size))
    steps = product_eigenvalues(chain, inverse, np.empty((3, 3)), matrix, found)
    return None if steps < 1 or not np.all(np.isfinite(found)) else found[0] + 1j * found[1]


def loses_directions(system: ImpactSystem, events: Sequence[ContactEvent]) -> bool:
    """Whether a stop sticks along the orbit, or an impact leaves no speed."""
    return any(_rank(system, event) < 2 * system.degrees_of_freedom for event in events)


def _held(system: ImpactSystem, event: ContactEvent) -> np.ndarray:
    """Gaps, and their rates, of the stops that stick behind an event, (2n, 2k)."""
    stops = sorted(int(system.modes.contact_stop[contact]) for contact in event.closed)
    rows = np.array([system.stops[stop].gap for stop in stops]).reshape(-1, system.degrees_of_freedom)
    return np.kron(np.eye(2), rows).T


def _rank(system: ImpactSystem, event: ContactEvent) -> int:
    """Rank of the saltation matrix of an event. A stop that sticks takes two directions, an impact that leaves no speed one."""
    size = 2 * system.degrees_of_freedom
    if event.is_release:
        return size
    stop = system.stops[system.modes.contact_stop[event.contact]]
    return size - 2 * len(event.closed) - (not event.sticks and stop.restitution == 0.0)


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
