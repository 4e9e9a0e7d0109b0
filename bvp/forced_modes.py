"""The contact modes of orbits under periodic loads, equations (42) and (43): matrices of flights and contact forces, and derivatives."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from bvp.blocks import Blocks, blocks_of, exact_product
from bvp.closures import EndsError
from bvp.kernels.flight import Flight
from bvp.kernels.forced_sticking import Sticking, Unstuck, sticking_flight
from bvp.kernels.loads import LoadedFlight, Loads
from bvp.kernels.smooth_loads import SmoothLoadedFlight
from bvp.kernels.summed_chatter import ORDERS, Chatter
from bvp.modes import reduced_blocks, undamped_modes

if TYPE_CHECKING:
    from bvp.contact_sequence import ContactEvent
    from bvp.released_forces import ReleasedForces
    from bvp.system import ImpactSystem

__all__ = ["ForcedMode", "ModeSlopes", "ModeTable", "forced_mode", "mode_slopes"]


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


class ModeSlopes(NamedTuple):
    """Derivatives of a `ForcedMode` by a parameter that changes masses, dampers or springs."""

    inverse: np.ndarray
    change: np.ndarray  # (2 n, 2 n) of the rates of modal states
    drive: np.ndarray  # (2 n, n) of the modal rates of unit loads
    pull: np.ndarray
    reach: np.ndarray


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


def mode_slopes(system: Any, mode: ForcedMode, mass: np.ndarray, damping: np.ndarray, stiffness: np.ndarray) -> ModeSlopes:
    """Derivatives of a mode where M, C and K have the given ones.

    They are those on states whose sticking gaps are constant."""
    n, k = len(system.mass), len(mode.rows)
    state, state_slope = np.hstack([system.stiffness, system.damping]), np.hstack([stiffness, damping])
    inverse = mode.inverse
    mass_inverse = inverse if not k else np.linalg.inv(system.mass)
    turned = -mass_inverse @ mass @ mass_inverse
    reach_slope, slope = mode.reach, turned
    if k:
        along = mass_inverse @ mode.rows.T
        along_slope = turned @ mode.rows.T
        compliance_slope = -mode.compliance @ (mode.rows @ along_slope) @ mode.compliance
        lift_slope = along_slope @ mode.compliance + along @ compliance_slope
        slope = turned - lift_slope @ along.T - mode.lift @ along_slope.T
        reach_slope = mode.weight[:, None] * (compliance_slope @ along.T + mode.compliance @ along_slope.T)
    # In free flight the forces of dampers, which nearly cancel in slow motion, are -M v'.
    forces = state @ mode.leave if k else -system.mass @ mode.leave[n:] @ mode.blocks.matrix
    change = -mode.enter[:, n:] @ (slope @ forces + inverse @ (state_slope @ mode.leave))
    return ModeSlopes(slope, change, mode.enter[:, n:] @ slope, reach_slope @ state + mode.reach @ state_slope, reach_slope)


class ModeTable:
    """The contact modes of an orbit, in the arrays of the kernels. The first one is free flight.

    Parameters
    ----------
    system : ImpactSystem
    events : sequence of ContactEvent
        The nodes of the orbit.
    nodes, width, varying : int
        Rows of nodes, entries of a node; parameters that change masses, dampers or springs.
    loads : Loads
        Those of free flight.
    units : (S,) float
        What the contact force of each stop is multiplied by.
    forces : ReleasedForces, optional
        Smooth forces of the system. No stop can stick.
    bouncing : collection of int
        Stops whose restitution is above 0, or varies: they bounce before they stick.

    Raises
    ------
    EndsError
        Where a stop sticks beside smooth forces.
    """

    def __init__(
        self, system: ImpactSystem, events: Sequence[ContactEvent], nodes: int, width: int, varying: int, loads: Loads, units: np.ndarray,
        forces: ReleasedForces | None = None, bouncing: Collection[int] = (),
    ):
        self.units = units
        self._smooth = forces
        n, stops = system.degrees_of_freedom, len(system.stops)
        self._sets: list[tuple[int, ...]] = [()]
        # Row i of the nodes is the event at the end of flight i. The last two are the first event, or its image: the same stop is closed.
        rows = [*events[1:], *events[:1], *events[:1]]
        mode = [self._index(event.closed) for event in events] or [0] * (nodes - 1)
        self.kept = np.array([*mode, mode[-1]], dtype=np.int64)
        release, opens = np.full((2, nodes), -1, dtype=np.int64)
        summed = np.zeros(nodes, dtype=np.int64)
        for i, event in enumerate(rows):
            if event.is_release:
                release[i] = system.modes.contact_stop[event.contact]
            elif event.sticks:
                summed[i] = system.modes.contact_stop[event.contact] in bouncing
            elif system.stops[system.modes.contact_stop[event.contact]].restitution == 0.0:
                opens[i] = self._index(event.closed | {event.contact})
        self._known: dict[tuple[float, ...], tuple[Any, list[ForcedMode]]] = {}
        self._contact_stop = system.modes.contact_stop
        self.stops = np.array([stop.gap for stop in system.stops], dtype=float).reshape(stops, n)
        self.made = self.modes_of(system)
        modes = len(self._sets)
        if forces is not None and modes > 1:
            raise EndsError("a stop that sticks needs linear springs and dampers; expected a sequence of impacts that rebound")
        blocks = 2 * n if varying else max(len(one.blocks.pairs) for one in self.made)
        closed = np.zeros((modes, stops), dtype=np.int64)
        for f, contacts in enumerate(self._sets):
            closed[f, system.modes.contact_stop[list(contacts)]] = 1
        square, harmonics, count = (2 * n, 2 * n), len(loads.harmonics), len(loads.modal) - 1
        modal = np.zeros((modes, *loads.modal.shape))
        self._forces, rows_of_forces = stops, stops + nodes
        square_node = (width, width)
        chatter = Chatter(
            summed, np.zeros((nodes, *square_node)), np.zeros(nodes), np.zeros((ORDERS + 1, 1 + width, width)),
            np.zeros((1 + width, width)), np.zeros(square_node), np.zeros((4, width)),
        )  # fmt: skip
        self.arrays = Sticking(
            np.array([*mode, 0], dtype=np.int64), release, opens, closed,
            np.zeros((modes, blocks, 2), dtype=np.int64), np.zeros((modes, blocks)), np.zeros((modes, blocks)), np.zeros((modes, *square)),
            np.zeros((modes, *square)), np.zeros((modes, *square)), np.zeros((modes, 2 * n, n)), np.zeros((modes, varying, 2 * n, n)),
            np.zeros((modes, varying, *square)), modal, np.zeros((modes, rows_of_forces, 2 * n)), np.zeros((modes, rows_of_forces, n)),
            np.zeros((varying, modes, rows_of_forces, 2 * n)), np.zeros((varying, modes, rows_of_forces, n)),
            np.zeros((modes, rows_of_forces, 1 + count, harmonics, 2)), np.zeros(width), chatter,
        )  # fmt: skip
        self.kind = Unstuck(0) if modes == 1 else self.arrays
        first = self.arrays
        loads = loads._replace(modal=modal[0])
        self.flight: LoadedFlight | SmoothLoadedFlight = LoadedFlight(
            Flight(first.pairs[0], first.mean[0], first.delta[0], first.matrix[0]), first.enter[0], first.leave[0],
            loads, first.change[0], np.zeros((4, *square)), np.zeros((8, 2 * n)), np.zeros(square), np.zeros((count, 2 * n)),
        )  # fmt: skip
        if forces is not None:
            from bvp.released_forces import released_flight

            self.flight = released_flight(forces, first.matrix[0], first.enter[0], loads, first.change[0], nodes)

    def flight_in(self, flight: int) -> LoadedFlight | SmoothLoadedFlight:
        """What kernels know of a flight of the orbit."""
        if isinstance(self.flight, SmoothLoadedFlight):
            return self.flight
        return sticking_flight.function(self.arrays, self.flight, int(self.arrays.mode[flight]))

    @property
    def sums_chatter(self) -> bool:
        """Whether an impact of the orbit is the first one of a chatter."""
        return bool(self.arrays.chatter.summed.any())

    @property
    def weights(self) -> np.ndarray:
        """Weights of the contact forces of the stops that stick in each mode, (F, S), else 0."""
        found = np.zeros(self.arrays.closed.shape)
        for f, mode in enumerate(self.made):
            found[f, self._contact_stop[list(self._sets[f])]] = mode.weight
        return found

    def sticking(self, flight: int) -> tuple[np.ndarray, np.ndarray]:
        """Gap rows (k, n) of the stops that stick in a flight of the orbit, and the weights (k,) of their forces (`ForcedMode`)."""
        mode = self.made[int(self.arrays.mode[flight])]
        return mode.rows, mode.weight

    def opening(self, flight: int) -> int | None:
        """The place of the stop that opens at the end of a flight among those that stick in it; None where none does."""
        stop = int(self.arrays.release[flight])
        contacts = self._sets[int(self.arrays.mode[flight])]
        return self._contact_stop[list(contacts)].tolist().index(stop) if stop >= 0 else None

    def _index(self, closed: Iterable[int]) -> int:
        """Index of a contact mode, which is added."""
        contacts = tuple(sorted(closed))
        if contacts not in self._sets:
            self._sets.append(contacts)
        return self._sets.index(contacts)

    def modes_of(self, system: Any) -> list[ForcedMode]:
        """The contact modes at the masses, dampers and springs of a system."""
        return [forced_mode(system, contacts, self.units, self._smooth is not None) for contacts in self._sets]

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

    def write(self, system: Any, made: list[ForcedMode], gap: np.ndarray, push: np.ndarray) -> None:
        """Write all that the masses, dampers and springs of a system determine, with its `modes_of`. gap, push: rows of the nodes."""
        arrays, n = self.arrays, len(system.mass)
        inverse = np.linalg.inv(system.mass)
        self.made = made
        for f, mode in enumerate(self.made):
            blocks = mode.blocks
            # Where there are fewer blocks than room the last one stands several times: it does the same again.
            last = np.minimum(np.arange(arrays.pairs.shape[1]), len(blocks.pairs) - 1)
            arrays.pairs[f], arrays.mean[f], arrays.delta[f] = blocks.pairs[last], blocks.mean[last], blocks.delta[last]
            arrays.matrix[f], arrays.enter[f], arrays.leave[f] = blocks.matrix, mode.enter, mode.leave
            arrays.drive[f] = mode.enter[:, n:] @ inverse
            stops = self._contact_stop[list(self._sets[f])]
            arrays.pull[f, stops], arrays.reach[f, stops] = mode.pull, mode.reach
        if self._smooth is not None and isinstance(self.flight, SmoothLoadedFlight):
            self.flight.taylor.push[:] = -arrays.drive[0, n:] @ self._smooth.directions.T
        for i, row in enumerate(gap[:, :n]):
            kept = self.made[self.kept[i]]
            along = kept.inverse @ row if len(kept.rows) else np.linalg.solve(system.mass, row)
            push[i, n : 2 * n] = along / (row @ along) if row.any() else 0.0
            if arrays.chatter.summed[i]:
                arrays.reach[0, self._forces + i] = row @ kept.inverse
                arrays.pull[0, self._forces + i] = row @ kept.inverse @ np.hstack([system.stiffness, system.damping])

    def write_slopes(self, system: Any, j: int, slopes: Sequence[np.ndarray], gap: np.ndarray, push_slope: np.ndarray) -> None:
        """Write the derivatives by parameter j, where M, C and K have the derivatives `slopes`. push_slope: rows of the nodes."""
        arrays, n = self.arrays, len(system.mass)
        found = [mode_slopes(system, mode, *slopes) for mode in self.made]
        for f, slope in enumerate(found):
            arrays.change[f, j], arrays.drive_slope[f, j] = slope.change, slope.drive
            stops = self._contact_stop[list(self._sets[f])]
            arrays.pull_slope[j, f, stops], arrays.reach_slope[j, f, stops] = slope.pull, slope.reach
        if self._smooth is not None and isinstance(self.flight, SmoothLoadedFlight):
            self.flight.taylor.sources.push_slope[j] = -arrays.drive_slope[0, j, n:] @ self._smooth.directions.T
        for i, row in enumerate(gap[:, :n]):
            if row.any():
                along, turned = self.made[self.kept[i]].inverse @ row, found[self.kept[i]].inverse @ row
                push_slope[i, n : 2 * n] = (turned - along * (row @ turned) / (row @ along)) / (row @ along)
                if arrays.chatter.summed[i]:
                    state, state_slope = np.hstack([system.stiffness, system.damping]), np.hstack([slopes[2], slopes[1]])
                    arrays.reach_slope[j, 0, self._forces + i] = turned
                    arrays.pull_slope[j, 0, self._forces + i] = turned @ state + along @ state_slope
