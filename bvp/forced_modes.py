"""The contact modes of orbits under periodic loads, equations (42) and (43): matrices of flights and contact forces."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from bvp.blocks import Blocks, blocks_of, exact_product
from bvp.closures import EndsError
from bvp.modes import reduced_blocks, undamped_modes

if TYPE_CHECKING:
    from bvp.contact_sequence import ContactEvent
    from bvp.system import ImpactSystem

__all__ = ["ForcedMode", "ModeTable", "forced_mode"]


KNOWN = 1000
"""Values of the parameters at which modes are kept."""


class ForcedMode(NamedTuple):
    """The motion while k contacts of a system with n degrees of freedom stick, k = 0 being free flight."""

    blocks: Blocks
    enter: np.ndarray  # (2 n, 2 n) of (u, v)
    leave: np.ndarray  # (2 n, 2 n)
    inverse: np.ndarray  # (n, n) P M^-1
    rows: np.ndarray  # (k, n) gaps of the stops that stick
    lift: np.ndarray  # (n, k) U
    compliance: np.ndarray  # (k, k) (c M^-1 c')^-1
    weight: np.ndarray  # (k,) unit of the forces, with the side of the stop as its sign
    pull: np.ndarray  # (k, 2 n) contact forces of a unit state, with the other sign
    reach: np.ndarray  # (k, n) contact forces of unit loads


def forced_mode(system: Any, contacts: Sequence[int], units: np.ndarray, physical: bool = False) -> ForcedMode:
    """The mode in which the given contacts stick.

    Parameters
    ----------
    system : ImpactSystem
    contacts : sequence of int
    units : (S,) float
        What the contact force of each stop is multiplied by.
    physical : bool
        The state is (u, v) itself, in free flight: smooth forces do not know the modes. `Matrices` are system enough.

    Raises
    ------
    RuntimeError
        Where the gaps of the contacts depend on each other, or no contact mode is left: every coordinate is constant.
    """
    n, k = len(system.mass), len(contacts)
    mass_inverse = np.linalg.inv(system.mass)
    if not k:
        blocks = _physical(system, mass_inverse) if physical else blocks_of(system, *undamped_modes(system.mass, system.stiffness))
        free, none = (blocks, blocks.from_state, blocks.to_state, mass_inverse), np.zeros((0, n))
        return ForcedMode(*free, none, none.T, np.zeros((0, 0)), np.zeros(0), np.zeros((0, 2 * n)), none)
    modes, state = system.modes, np.hstack([system.stiffness, system.damping])
    rows = np.array([system.stops[modes.contact_stop[c]].gap for c in contacts], dtype=float).reshape(k, n)
    along = mass_inverse @ rows.T
    compliance = rows @ along
    if np.linalg.cond(compliance) > 1e12:
        raise RuntimeError("stops stick whose gaps depend on each other")
    compliance = np.linalg.inv(compliance)
    lift = along @ compliance
    inverse = mass_inverse - lift @ along.T
    weight = units[modes.contact_stop[list(contacts)]] * modes.contacts.side[list(contacts)]
    reach = weight[:, None] * (compliance @ along.T)
    basis = np.linalg.qr(rows.T, mode="complete")[0][:, k:]
    blocks, enter, leave = _reduced(system, basis, rows, lift)
    return ForcedMode(blocks, enter, leave, inverse, rows, lift, compliance, weight, reach @ state, reach)


def _physical(system: Any, mass_inverse: np.ndarray) -> Blocks:
    """The motion in (u, v) as one block."""
    n = len(mass_inverse)
    matrix = np.vstack([np.eye(n, 2 * n, n), -mass_inverse @ np.hstack([system.stiffness, system.damping])])
    pair, none, same = np.array([[0, -2 * n]], dtype=np.int64), np.zeros(1), np.eye(2 * n)
    return Blocks("physical", np.eye(n), pair, none, none, matrix, same, same)


def _reduced(system: ImpactSystem, basis: np.ndarray, rows: np.ndarray, lift: np.ndarray) -> tuple[Blocks, np.ndarray, np.ndarray]:
    """Blocks of the motion along `basis`, followed by the gaps that rest, each a block of its own; and the maps from and to (u, v).

    A gap that rests bends the others: their static shape under it is split off. Springs that do not resist a motion do not drive it."""
    n, m = basis.shape
    k = n - m
    mass, damping, stiffness = (exact_product(basis.T, matrix, basis) for matrix in (system.mass, system.damping, system.stiffness))
    left = np.linalg.solve(mass, basis.T @ system.mass) if m else np.zeros((0, n))
    shape = lift - basis @ np.linalg.lstsq(stiffness, basis.T @ system.stiffness @ lift, rcond=1e-13)[0] if m else lift
    enter, leave = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, 2 * n))
    pairs, mean, delta, matrix = np.zeros((0, 2), dtype=np.int64), np.zeros(0), np.zeros(0), np.zeros((2 * n, 2 * n))
    shapes = np.zeros((0, 0))
    if m:
        found = reduced_blocks(system, basis, mass, damping, stiffness)
        pairs, mean, delta, shapes = found.pairs, found.mean, found.delta, found.shapes
        matrix[: 2 * m, : 2 * m] = found.matrix
        two = np.kron(np.eye(2), left)
        two[:m, :n] -= left @ shape @ rows
        enter[: 2 * m] = found.from_state @ two
        leave[:, : 2 * m] = np.kron(np.eye(2), basis) @ found.to_state
    enter[2 * m : 2 * m + k, :n] = rows
    leave[:n, 2 * m : 2 * m + k] = shape
    single = np.array([(2 * m + r, -1) for r in range(2 * k)], dtype=np.int64)
    pairs, mean, delta = np.vstack([pairs, single]), np.pad(mean, (0, 2 * k)), np.pad(delta, (0, 2 * k))
    return Blocks("coupled", shapes, pairs, mean, delta, matrix, leave, enter), enter, leave


class ModeTable:
    """The contact modes of an orbit, with k + 1 flights. The first one is free flight.

    Parameters
    ----------
    system : ImpactSystem
    events : sequence of ContactEvent
        The nodes of the orbit.
    nodes : int
        k + 2.
    units : (S,) float
        What the contact force of each stop is multiplied by.
    smooth : bool
        Whether the system has smooth forces. No stop can stick.
    bouncing : collection of int
        Stops whose restitution is above 0, or varies: they bounce before they stick.

    Attributes
    ----------
    mode : (k + 1,) int64
        The contact mode of each flight.
    kept : (k + 2,) int64
        That in which the impulse of each node acts. Node i is the event at the end of flight i, the last one is at the start.
    release : (k + 2,) int64
        The stop that opens at each node; -1: none.
    opens : (k + 2,) int64
        The contact mode if the stop of an impact without rebound stayed closed; -1 at other nodes.
    summed : (k + 2,) int64
        1: the impact of a node is the first one of a chatter.
    closed : (F, S) bool
        The stops that stick in each contact mode.
    stops : (S, n) float
        The gaps of the stops.
    made : list of ForcedMode
        The modes at the values of the parameters with which the problem was made.

    Raises
    ------
    EndsError
        Where a stop sticks beside smooth forces.
    """

    def __init__(
        self, system: ImpactSystem, events: Sequence[ContactEvent], nodes: int, units: np.ndarray, smooth: bool = False,
        bouncing: Collection[int] = (),
    ):  # fmt: skip
        self._units, self._smooth = units, smooth
        n, stops = system.degrees_of_freedom, len(system.stops)
        self._sets: list[tuple[int, ...]] = [()]
        # Row i of the nodes is the event at the end of flight i. The last two are the first event, or its image: the same stop is closed.
        rows = [*events[1:], *events[:1], *events[:1]]
        mode = [self._index(event.closed) for event in events] or [0] * (nodes - 1)
        self.mode, self.kept = np.array(mode, dtype=np.int64), np.array([*mode, mode[-1]], dtype=np.int64)
        self.release, self.opens = np.full((2, nodes), -1, dtype=np.int64)
        self.summed = np.zeros(nodes, dtype=np.int64)
        self._contact_stop = contact_stop = system.modes.contact_stop
        for i, event in enumerate(rows):
            if event.is_release:
                self.release[i] = contact_stop[event.contact]
            elif event.sticks:
                self.summed[i] = contact_stop[event.contact] in bouncing
            elif system.stops[contact_stop[event.contact]].restitution == 0.0:
                self.opens[i] = self._index(event.closed | {event.contact})
        if smooth and len(self._sets) > 1:
            raise EndsError("a stop that sticks needs linear springs and dampers; expected a sequence of impacts that rebound")
        self._known: dict[tuple[float, ...], tuple[Any, list[ForcedMode]]] = {}
        self.stops = np.array([stop.gap for stop in system.stops], dtype=float).reshape(stops, n)
        self.made = self.modes_of(system)
        self.closed = np.zeros((len(self._sets), stops), dtype=bool)
        for f, contacts in enumerate(self._sets):
            self.closed[f, contact_stop[list(contacts)]] = True

    @property
    def sums_chatter(self) -> bool:
        """Whether an impact of the orbit is the first one of a chatter."""
        return bool(self.summed.any())

    def stopped(self, f: int) -> np.ndarray:
        """The stops that stick in a contact mode, in the order of its forces."""
        return np.asarray(self._contact_stop[list(self._sets[f])])

    def share_known(self, other: ModeTable) -> None:
        """Keep modes together with the table of another problem of the same system and events."""
        self._known = other._known

    def _index(self, closed: Iterable[int]) -> int:
        """Index of a contact mode, which is added."""
        contacts = tuple(sorted(closed))
        if contacts not in self._sets:
            self._sets.append(contacts)
        return self._sets.index(contacts)

    def modes_of(self, system: Any) -> list[ForcedMode]:
        """The contact modes at the masses, dampers and springs of a system."""
        return [forced_mode(system, contacts, self._units, self._smooth) for contacts in self._sets]

    def modes_at(
        self, at: tuple[float, ...], system_at: Callable[[tuple[float, ...]], Any]
    ) -> tuple[Any, list[ForcedMode]]:
        """The system at values of the parameters, and its modes. They are kept: an orbit is evaluated several times."""
        if at not in self._known:
            if len(self._known) >= KNOWN:
                self._known.clear()
            system = system_at(at)
            self._known[at] = system, self.modes_of(system)
        return self._known[at]

    def pushes(self, system: Any, made: Sequence[ForcedMode], gap: np.ndarray) -> np.ndarray:
        """What an impact at each node (k + 2, 2 n) adds to a state, for each unit of speed. gap (k + 2, 2 n): rows of the nodes."""
        found, n = np.zeros_like(gap), len(system.mass)
        for i, row in enumerate(gap[:, :n]):
            if row.any():
                kept = made[self.kept[i]]
                along = kept.inverse @ row if len(kept.rows) else np.linalg.solve(system.mass, row)
                found[i, n:] = along / (row @ along)
        return found
