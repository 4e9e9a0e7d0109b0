"""Energy shares of the nonlinear energy sink (NES) and of the rest (LO), their losses, and the system with a locked NES.

The NES has its kinetic energy and the springs between it and the rest. It dissipates in the stops between it and the rest, and in the
dampers across these stops or springs. Everything else belongs to the LO (Lee et al., Physica D 238 (2009) 1868, section 3). Without an NES
the energies have no shares; all stops and the dampers across them then take the place of its losses.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bvp.checks import require_system
from bvp.forcing import Force, damping_across
from bvp.motion import Motion
from bvp.smooth_forces import SmoothForces
from bvp.springs import Element
from bvp.system import ImpactSystem, Stop
from bvp.texts import brief

__all__ = ["Sharing", "lock", "sharing_of"]

_OUT_OF_REACH = 1e20  # bound, in units of displacement, of the one stop that a locked system needs if it has no other


@brief
@dataclass(frozen=True, eq=False)
class Sharing:
    """The shares of a system's energy and dissipation.

    Attributes
    ----------
    mass, stiffness : (n, n) ndarray or None
        The NES's energy is (v mass v + u stiffness u)/2. None if it has no share of its own: no coordinate is marked as NES, or the mass
        matrix couples one of these to others.
    dampers : dict of str to (n, n) ndarray
        The damping matrix in the parts that `bvp.simulate.simulate` records separately.
    nes_parts : frozenset of str
        The parts of a motion in which the NES dissipates.
    sink : bool
        Whether a coordinate is marked as NES.
    """

    mass: np.ndarray | None
    stiffness: np.ndarray | None
    dampers: Mapping[str, np.ndarray]
    nes_parts: frozenset[str]
    sink: bool = True
    springs: SmoothForces | None = None
    """The springs on the NES that are not linear."""

    @property
    def names(self) -> tuple[str, str]:
        """Names of the two that dissipate: the NES and the LO; without an NES, the stops (with the dampers across them) and the rest."""
        return ("NES", "LO") if self.sink else ("stops", "rest")

    def energies(self, motion: Motion, times: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Total energy, energy of the NES and energy of the LO at given times, (j,) each. Without shares the last two are NaN."""
        u, v = motion.sample(times)
        total = np.atleast_1d(motion.system.energy(u, v))
        if self.mass is None or self.stiffness is None:
            return total, np.full(len(total), np.nan), np.full(len(total), np.nan)
        nes = 0.5 * (np.einsum("ji,ik,jk->j", v, self.mass, v) + np.einsum("ji,ik,jk->j", u, self.stiffness, u))
        if self.springs is not None:
            nes = nes + self.springs.energy(u)
        return total, nes, total - nes

    def dissipated(self, motion: Motion, times: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The energy that the NES and the LO have dissipated up to any times, and the work of the loads: (j,) each."""
        spent, work = np.split(motion.spent(times), [-1], axis=1)
        own = np.array([part in self.nes_parts for part in motion.parts])
        return spent[:, own].sum(axis=1), spent[:, ~own].sum(axis=1), work[:, 0]

    def totals(self, dissipated: Mapping[str, float]) -> tuple[float, float]:
        """(NES, LO) of the energy that the parts of a motion have dissipated."""
        nes = sum(value for part, value in dissipated.items() if part in self.nes_parts)
        return nes, sum(value for part, value in dissipated.items() if part not in self.nes_parts)


def sharing_of(system: ImpactSystem, nes: tuple[int, ...] = (), lo: tuple[int, ...] = ()) -> Sharing:
    """Share the energy and the damping of a system between its nonlinear energy sink (NES) and its linear oscillator (LO).

    Parameters
    ----------
    system : ImpactSystem
    nes, lo : tuple of int
        Coordinates of the NES and of the LO. With a single LO coordinate, only the spring between it and the NES belongs to the NES; else
        all springs between the NES and other coordinates.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> shared = sharing_of(vibro_impact_nes(lam=0.01), (0,), (1,))
    >>> shared.mass[0, 0], shared.stiffness[0, 1], sorted(shared.nes_parts)
    (np.float64(0.1), np.float64(-0.1), ['gaps', 'stop a'])
    """
    require_system(system, smooth=True)
    stops = tuple(stop for stop in system.stops if not nes or any(stop.gap[k] for k in nes))
    elements = [element for element in (*system.springs, *system.dampers) if _touches(element, nes)]
    if not nes:
        elements = [damper for damper in system.dampers if any(_parallel(damper.row, stop.gap) for stop in stops)]
    gaps = damping_across(system.damping, [np.array(row) for row in (*(stop.gap for stop in stops), *(one.row for one in elements))])
    dampers = {"gaps": gaps, "rest": system.damping - gaps}
    on_nes = [damper.place(system.coordinates) for damper in system.dampers if damper in elements]
    parts = frozenset(["gaps", *on_nes, *(f"stop {stop.name}" for stop in stops)])
    if not nes:
        return Sharing(None, None, dampers, parts, sink=False)
    mass, stiffness, unit = np.zeros_like(system.mass), np.zeros_like(system.mass), np.eye(len(system.mass))
    for i, k in enumerate(nes):
        if np.any(np.delete(system.mass[k], k)):
            return Sharing(None, None, dampers, parts)
        mass[k, k] = system.mass[k, k]
        for j in lo if len(lo) == 1 else range(len(mass)):
            if j not in nes[: i + 1]:  # a spring between two coordinates of the NES counts once
                stiffness -= system.stiffness[k, j] * np.outer(unit[k] - unit[j], unit[k] - unit[j])
    own = tuple(spring for spring in system.springs if spring in elements)
    springs = replace(system, springs=own, dampers=()).smooth_forces if own else None
    return Sharing(mass, stiffness + 0.0, dampers, parts, springs=springs)


def _touches(element: Element, nes: Sequence[int]) -> bool:
    """Whether a spring or damper acts on a coordinate of the NES, as far as its row says."""
    return any(element.row[k] for k in nes) if element.row else False


def _parallel(row: Sequence[float], gap: Sequence[float]) -> bool:
    """Whether a row (n,), which may be missing, is a multiple of a gap (n,)."""
    return bool(row) and np.linalg.matrix_rank(np.array([row, gap])) == 1


def _along(matrix: np.ndarray, element: Element) -> Element | None:
    """A spring or damper of a locked system, u = matrix q; None if it does not move. A ValueError for a potential of all coordinates."""
    if not element.row:
        raise ValueError(f"{element.place()} is an expression of coordinates that are locked; expected a spring between two coordinates")
    row = np.array(element.row) @ matrix
    return replace(element, row=tuple(row.tolist())) if np.abs(row).max() > 1e-12 * np.abs(element.row).max() else None


def lock(system: ImpactSystem, nes: Sequence[int], forces: Sequence[Force] = ()) -> tuple[ImpactSystem, tuple[Force, ...]]:
    """The system and its loads with the NES locked: T'MT, T'CT, T'KT, T'f, and the stops that can still move.

    u = T q, and q are the other coordinates. Each NES coordinate moves with the one other coordinate in the gap of its stop, c . u = 0, or
    stands still if there is none. Without a stop, its spring or damper takes the place of the gap. A ValueError if no NES is marked, a gap
    does not determine the motion of its coordinate, or no coordinate is left.

    Examples
    --------
    The reference system: the two masses move as one.

    >>> from bvp.system import vibro_impact_nes
    >>> locked, _ = lock(vibro_impact_nes(mu=0.1, lam=0.02), (0,))
    >>> locked.mass, locked.damping, locked.stiffness, locked.coordinates
    (array([[1.1]]), array([[0.02]]), array([[1.]]), ('u2',))
    """
    n = system.degrees_of_freedom
    require_system(system, smooth=True)
    if not nes:
        raise ValueError("no coordinate is marked as NES, which is what would be locked (in a scene NES under [coordinates])")
    kept = [k for k in range(n) if k not in nes]
    matrix = np.eye(n)[:, kept]
    for k in nes:
        gaps = [stop.gap for stop in system.stops if stop.gap[k]]
        gaps = gaps or [element.row for element in (*system.springs, *system.dampers) if _touches(element, [k])]
        hosts = {
            tuple((j, -gap[j] / gap[k]) for j in range(n) if gap[j] and j != k) for gap in gaps if not any(gap[j] for j in nes if j != k)
        }
        if len(hosts) != 1 or len(host := next(iter(hosts))) > 1:
            raise ValueError(f"{system.coordinates[k]} cannot be locked: expected one gap, between it and one other coordinate at most")
        for j, ratio in host:
            matrix[k, kept.index(j)] = ratio
    if not kept:
        raise ValueError("every coordinate is marked as NES: nothing is left to move when it is locked")
    rows = [np.array(stop.gap) @ matrix for stop in system.stops]
    free = [np.abs(row).max() > 1e-12 * np.abs(stop.gap).max() for row, stop in zip(rows, system.stops, strict=True)]
    stops = tuple(replace(stop, gap=tuple(row)) for stop, row, moves in zip(system.stops, rows, free, strict=True) if moves)
    springs, dampers = ([_along(matrix, element) for element in elements] for elements in (system.springs, system.dampers))
    left: dict[str, Any] = {"springs": tuple(filter(None, springs)), "dampers": tuple(filter(None, dampers))}
    if not stops:
        stops = (Stop(tuple(np.eye(len(kept))[0]), -_OUT_OF_REACH, _OUT_OF_REACH),)
    mass, damping, stiffness = (matrix.T @ part @ matrix for part in (system.mass, system.damping, system.stiffness))
    locked = replace(
        system, mass=mass, damping=damping, stiffness=stiffness, stops=stops, coordinates=tuple(system.coordinates[k] for k in kept),
        absorber=None, primary=None, model=None, parameters=None, **left,
    )  # fmt: skip
    return locked, tuple(
        replace(force, **{name: matrix.T @ getattr(force, name) for name in ("load", "cosine", "sine") if hasattr(force, name)})
        for force in forces
    )
