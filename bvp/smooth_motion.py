"""Contact modes of a system with smooth forces, for simulation: the arrays of `bvp.kernels.smooth_motion`.

While stops S stick, M^-1 of the accelerations is replaced by M^-1 - M^-1 c' (c M^-1 c')^-1 c M^-1 with the rows c of their gaps: then
c_S . u'' = 0, and the force of each stop is (c M^-1 c')^-1 c M^-1 times the sum of all other forces.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from bvp.contact_modes import NEVER, ContactModeTable
from bvp.forcing import BudgetTerms, Forcing
from bvp.kernels.driving import DrivingSources
from bvp.kernels.pieces import ROOM
from bvp.kernels.smooth_motion import SmoothModes
from bvp.kernels.sources import ORDER
from bvp.kernels.taylor import SmoothFlight, make_smooth_flight
from bvp.modes import along_row, balanced, two_parts

if TYPE_CHECKING:
    from bvp.smooth_forces import SmoothForces
    from bvp.system import ImpactSystem

__all__ = ["SmoothModeTable"]

PATHS = 2
"""Flights that are kept."""


class SmoothModeTable(ContactModeTable):
    """As `bvp.contact_modes.ContactModeTable`, with smooth forces."""

    def __init__(self, system: ImpactSystem, forcing: Forcing, terms: BudgetTerms) -> None:
        assert system.smooth_forces is not None
        if system.smooth_forces.called:
            place = system.smooth_forces.called[0]
            raise ValueError(f"the force of {place} is a Python function, which only orbits take; a simulation expects a formula")
        self.forces = system.smooth_forces
        super().__init__(system, forcing, terms)

    def _mode(self, sticking: int) -> dict[str, np.ndarray]:
        return _mode(self.system, self.forces, sticking, self.forcing, self.terms)

    def entered(self, sticking: int, x: np.ndarray) -> np.ndarray:
        """As `ContactModeTable.entered`, with the smooth forces in it, and without their derivatives."""
        n, count = self.system.degrees_of_freedom, len(self.forces.forces)
        z = super().entered(sticking, x)
        z[len(x) : len(x) + count] = self.forces.values(x[:n], x[n : 2 * n])
        return z

    @cached_property
    def _taylor(self) -> SmoothFlight:
        forces, shapes, n = self.forces, self.system.modes.shapes, self.system.degrees_of_freedom
        inputs = np.hstack([forces.inputs[:, :n] @ shapes, forces.inputs[:, n:] @ shapes])
        loads, count = 2 * len(self.forcing.loads), len(forces.forces)
        sources = DrivingSources(
            0, np.zeros((n, loads)), self.forcing.frequency, np.zeros(loads), np.zeros(loads), np.zeros((ORDER + 1, loads)),
            np.zeros(1, dtype=np.int64),
        )  # fmt: skip
        taylor = make_smooth_flight(
            np.zeros((2 * n, 2 * n)), inputs, np.zeros((n, count)), forces.program(), forces.energy_program(), PATHS, sources, ROOM
        )
        coefficients = np.zeros((PATHS, ROOM, ORDER + 1, 2 * n + loads + 3 * count))
        return taylor._replace(paths=taylor.paths._replace(coefficients=coefficients, begins=np.zeros((PATHS, 2 * n + loads + 1))))

    @cached_property
    def stacked(self) -> Any:
        """All modes as `SmoothModes`, with the scratch of their flights."""
        modes = list(self.modes.values())
        return SmoothModes(
            **{name: np.ascontiguousarray(np.stack([mode[name] for mode in modes])) for name in modes[0]},
            **self._of_all,
            weight=np.concatenate([self.terms.weight, np.ones(len(lossy(self.forces)))]),
            part=np.concatenate([self.terms.part, _parts(self.forces, self.terms)]),
            taylor=self._taylor,
            owner=np.full(PATHS, -1, dtype=np.int64),
            current=np.zeros(1, dtype=np.int64),
            polynomials=np.zeros((2, ORDER + 1)),
        )


def lossy(forces: SmoothForces) -> list[int]:
    """The forces that are those of dampers."""
    return [k for k, name in enumerate(forces.dampers) if name]


def _parts(forces: SmoothForces, terms: BudgetTerms) -> np.ndarray:
    """The sums of the energy budget to which the forces of dampers go."""
    return np.array([terms.dampers.index(forces.dampers[k]) for k in lossy(forces)], dtype=np.int64)


def _mode(system: ImpactSystem, forces: SmoothForces, sticking: int, forcing: Forcing, terms: BudgetTerms) -> dict[str, np.ndarray]:
    """The arrays of one contact mode: those of `bvp.contact_modes.contact_mode_of`, and the accelerations `own`, `forced`, `driven`."""
    n, modes, count = system.degrees_of_freedom, system.modes, len(forces.forces)
    shapes, loads = modes.shapes, 2 * len(forcing.loads)
    width = 2 * n + loads
    size = width + 3 * count
    contacts = [c for c in range(len(modes.contacts.side)) if sticking >> c & 1]
    gaps = np.array([stop.gap for stop in system.stops]).reshape(-1, n) @ shapes  # in modal coordinates, whose mass matrix is I
    rows = gaps[modes.contact_stop[contacts]] if contacts else np.zeros((0, n))
    if contacts and np.linalg.cond(rows @ rows.T) > 1e12:
        raise RuntimeError("stops stick whose gaps depend on each other")
    press = np.linalg.solve(rows @ rows.T, rows)  # forces of the sticking stops, from accelerations without them
    hold = np.eye(n) - rows.T @ press
    free = np.zeros((n, size))  # accelerations without the stops
    free[:, :n], free[:, n : 2 * n] = -np.diag(modes.squares), -(shapes.T @ system.damping @ shapes)
    free[:, 2 * n : width] = shapes.T @ forcing.loads.transpose(1, 0, 2).reshape(n, loads)
    free[:, width : width + count] = -(forces.directions @ shapes).T
    matrix = np.zeros((size, size))
    matrix[:n, n : 2 * n] = np.eye(n)
    matrix[n : 2 * n] = hold @ free
    for g, frequency in enumerate(forcing.frequency):
        k = 2 * n + 2 * g
        if frequency > 0.0:
            matrix[k, k + 1], matrix[k + 1, k] = -frequency, frequency
        else:
            matrix[k, k + 1] = 1.0
    for k in range(2 * count):
        matrix[width + k, width + count + k] = 1.0
    side, bound = modes.contacts.side.copy(), modes.contacts.bound.copy()
    gap, rate, push, push_rest = np.zeros((4, len(side), size))
    acceleration = np.zeros_like(gap)
    closed = {int(modes.contact_stop[c]) for c in contacts}
    for c in range(len(side)):
        row = gaps[modes.contact_stop[c]]
        left = hold @ row
        if c in contacts:
            gap[c] = side[c] * (press[contacts.index(c)] @ free)
            rate[c] = gap[c] @ matrix
            side[c], bound[c] = -1.0, 0.0
        elif int(modes.contact_stop[c]) in closed or np.abs(left).max() <= 1e-12 * np.abs(row).max():
            side[c], bound[c] = 1.0, NEVER
        else:
            gap[c, :n] = rate[c, n : 2 * n] = row
            push[c, n : 2 * n] = balanced(left / (row @ left), row)
            if not contacts:
                push[c, n : 2 * n], push_rest[c, n : 2 * n] = two_parts(along_row(row))
        acceleration[c] = rate[c] @ matrix
    leave, to_modes = np.zeros((2, 2 * n, size))
    leave[:n, :n] = leave[n:, n : 2 * n] = shapes
    to_modes[: 2 * n, : 2 * n] = np.eye(2 * n)
    enter, from_modes = np.zeros((2, size, width))
    into = shapes.T @ system.mass
    enter[:n, :n], enter[n : 2 * n, n : 2 * n] = into, hold @ into
    from_modes[:n, :n], from_modes[n : 2 * n, n : 2 * n] = np.eye(n), hold
    enter[2 * n : width, 2 * n :] = from_modes[2 * n : width, 2 * n :] = np.eye(loads)
    units = np.eye(size)
    second = terms.velocity @ leave[n:]
    first = np.array([second[k] if load < 0 else units[2 * n + load] for k, load in enumerate(terms.load)]).reshape(-1, size)
    losses = lossy(forces)
    first = np.vstack([first, units[[width + k for k in losses]]])
    second = np.vstack([second, forces.directions[losses] @ leave[n:]])
    blocks = [(k, n + k) for k in range(n)] + [(k, k + 1) for k in range(2 * n, width, 2)] + [(k, -1) for k in range(width, size)]
    arrays: dict[str, np.ndarray] = {
        **{"pairs": np.array(blocks, dtype=np.int64), "matrix": matrix},
        **{"leave": leave, "enter": enter, "to_modes": to_modes, "from_modes": from_modes},
        **{"gap": gap, "rate": rate, "acceleration": acceleration, "side": side, "bound": bound},
        **{"push": push, "push_rest": push_rest, "first": first, "second": second},
        **{"own": matrix[: 2 * n, : 2 * n], "forced": matrix[n : 2 * n, width : width + count], "driven": matrix[n : 2 * n, 2 * n : width]},
    }
    return {name: array + 0 for name, array in arrays.items()}
