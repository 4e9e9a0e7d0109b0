"""Whose energy: the nonlinear energy sink's (NES) and the rest's (LO), in a motion, at any time, held and dissipated.

The NES has its kinetic energy and the springs by which it hangs on the rest; it dissipates in the stops and dampers of the gaps between it
and the rest. All else belongs to the LO (Lee et al., Physica D 238 (2009) 1868, section 3). Where no coordinate is marked, energies have no
shares, and all stops and the dampers across them count as the NES.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from bvp.shares import split_damping

if TYPE_CHECKING:
    from bvp.motion import Motion
    from bvp.system import ImpactSystem

__all__ = ["Sharing", "sharing_of"]


@dataclass(frozen=True, eq=False)
class Sharing:
    """The split of a system's energy and dissipation.

    Attributes
    ----------
    mass, stiffness : (n, n) ndarray or None
        The NES's energy is (v mass v + u stiffness u)/2; None where it has no share of its own.
    why_not : str
        The reason for that, "" else.
    dampers : dict of str to (n, n) ndarray
        The damping matrix in the parts that `bvp.run.run` is to tell apart.
    nes_parts : frozenset of str
        Which of a motion's parts the NES dissipates in.
    sink : bool
        Whether a coordinate is marked as NES.
    """

    mass: np.ndarray | None
    stiffness: np.ndarray | None
    why_not: str
    dampers: Mapping[str, np.ndarray]
    nes_parts: frozenset[str]
    sink: bool = True

    @property
    def names(self) -> tuple[str, str]:
        """What the two that dissipate are called: the NES and the LO, or the stops with the dampers across them and the rest."""
        return ("NES", "LO") if self.sink else ("stops", "rest")

    def energies(self, motion: Motion, times: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Energy, that of the NES, that of the LO, at any times: (j,) each; the last two are NaN where there are no shares."""
        u, v = motion.sample(times)
        whole = np.atleast_1d(motion.system.energy(u, v))
        if self.mass is None or self.stiffness is None:
            none = np.full(len(whole), np.nan)
            return whole, none, none.copy()
        nes = 0.5 * (np.einsum("ji,ik,jk->j", v, self.mass, v) + np.einsum("ji,ik,jk->j", u, self.stiffness, u))
        return whole, nes, whole - nes

    def dissipated(self, motion: Motion, times: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Dissipated by the NES, by the LO, and the work of the loads, up to any times: (j,) each."""
        spent = motion.spent(times)
        own = self._own(motion)
        return spent[:, :-1][:, own].sum(axis=1), spent[:, :-1][:, ~own].sum(axis=1), spent[:, -1]

    def totals(self, dissipated: Mapping[str, float]) -> tuple[float, float]:
        """(NES, LO) of what the parts of a motion have dissipated."""
        nes = sum(value for part, value in dissipated.items() if part in self.nes_parts)
        return nes, sum(value for part, value in dissipated.items() if part not in self.nes_parts)

    def _own(self, motion: Motion) -> np.ndarray:
        return np.array([part in self.nes_parts for part in motion.parts])


def sharing_of(system: ImpactSystem, nes: tuple[int, ...] = (), lo: tuple[int, ...] = ()) -> Sharing:
    """How a system's energy is shared.

    Parameters
    ----------
    system : ImpactSystem
    nes, lo : tuple of int
        Coordinates of the NES and of the LO. One LO coordinate alone: of the springs that hold the NES, that between the two is its own;
        else all of those to other coordinates.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> shared = sharing_of(vibro_impact_nes(lam=0.01), (0,), (1,))
    >>> shared.mass[0, 0], shared.stiffness[0, 1], sorted(shared.nes_parts)
    (np.float64(0.1), np.float64(-0.1), ['gaps', 'stop a'])
    """
    stops = tuple(stop for stop in system.stops if not nes or any(stop.gap[k] for k in nes))
    gaps = split_damping(replace(system, stops=stops))["gaps"] if stops else np.zeros_like(system.damping)
    dampers = {"gaps": gaps, "rest": system.damping - gaps}
    parts = frozenset(["gaps", *(f"stop {stop.name}" for stop in stops)])
    if not nes:
        return Sharing(None, None, "no coordinate is marked as NES", dampers, parts, sink=False)
    mass, stiffness = np.zeros_like(system.mass), np.zeros_like(system.mass)
    for i, k in enumerate(nes):
        if np.any(np.delete(system.mass[k], k)):
            why_not = f"the mass matrix couples {system.coordinates[k]} to others; its kinetic energy has no share of its own"
            return Sharing(None, None, why_not, dampers, parts)
        mass[k, k] = system.mass[k, k]
        for j in lo if len(lo) == 1 else range(len(mass)):
            if j != k and j not in nes[:i]:  # a spring between two coordinates of the NES counts once
                row = np.zeros(len(mass))
                row[k], row[j] = 1.0, -1.0
                stiffness -= system.stiffness[k, j] * np.outer(row, row)
    return Sharing(mass, stiffness + 0.0, "", dampers, parts)
