"""The phases that motions of a system have met, stacked in arrays of one size for the kernels."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from bvp.forcing import Forcing
from bvp.kernels.phase import Phases
from bvp.meters import Meters
from bvp.phases import phase_of

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["PhaseTable"]


class PhaseTable:
    """The phases of a system under its loads that a run has met so far, stacked for the kernels; it grows when a run asks for one more."""

    def __init__(self, system: ImpactSystem, forcing: Forcing, meters: Meters) -> None:
        self.system, self.forcing, self.meters = system, forcing, meters
        self.phases = [phase_of(system, 0, forcing, meters)]

    def add(self, held: int) -> None:
        """Make one more phase."""
        self.phases.append(phase_of(self.system, held, self.forcing, self.meters))
        self.__dict__.pop("stacked", None)

    def index(self, held: int) -> int:
        """Its index, or -1."""
        return next((k for k, phase in enumerate(self.phases) if phase.held == held), -1)

    @cached_property
    def stacked(self) -> Phases:
        """All phases in arrays of one size: smaller ones have entries that stay 0, and blocks that act on the last of these alone."""
        count = max(len(phase.pairs) for phase in self.phases)
        size = max(len(phase.matrix) + (len(phase.pairs) < count) for phase in self.phases)
        modes = self.system.modes
        contacts = len(modes.contact_side)
        n, y = self.system.degrees_of_freedom, 2 * len(self.forcing.loads)
        number, meters = len(self.phases), len(self.meters.weight)
        pairs = np.empty((number, count, 2), dtype=np.int64)
        pairs[:] = size - 1, -1
        stacked = {
            "mean": np.zeros((number, count)),
            "delta": np.zeros((number, count)),
            "matrix": np.zeros((number, size, size)),
            "leave": np.zeros((number, 2 * n, size)),
            "enter": np.zeros((number, size, 2 * n + y)),
            "to_modes": np.zeros((number, 2 * n, size)),
            "from_modes": np.zeros((number, size, 2 * n + y)),
            **{key: np.zeros((number, contacts, size)) for key in ("gap", "rate", "acceleration", "push", "push_rest")},
            **{key: np.zeros((number, contacts)) for key in ("side", "bound")},
            **{key: np.zeros((number, meters, size)) for key in ("first", "second")},
        }
        for k, phase in enumerate(self.phases):
            pairs[k, : len(phase.pairs)] = phase.pairs
            for key, array in stacked.items():
                own = getattr(phase, key)
                target = array[k]
                target[tuple(slice(0, length) for length in own.shape)] = own
        reduced = np.array([1.0 / (row @ np.linalg.solve(self.system.mass, row)) for row in (np.array(s.gap) for s in self.system.stops)])
        return Phases(
            held=np.array([phase.held for phase in self.phases], dtype=np.int64),
            pairs=pairs,
            **stacked,
            restitution=modes.contact_restitution,
            contact_mass=reduced[modes.contact_stop],
            contact_stop=modes.contact_stop,
            weight=self.meters.weight,
            part=self.meters.part,
            frequency=self.forcing.frequency,
            breaks=self.forcing.breaks,
            levels=self.forcing.levels,
            shape=np.array([n, len(self.meters.dampers), len(self.system.stops)], dtype=np.int64),
        )
