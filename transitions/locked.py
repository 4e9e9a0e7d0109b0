"""A system whose nonlinear energy sink is locked: its gaps are held at zero, by u = T q with q the other coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from bvp.forcing import Constant, Harmonic, Record

if TYPE_CHECKING:
    from bvp.forcing import Force
    from bvp.system import ImpactSystem

__all__ = ["lock", "tie"]

_OUT_OF_REACH = 1e20
"""Bound of the stop that a system without any other keeps, for it has one at least: in units of displacement."""


def tie(system: ImpactSystem, nes: Sequence[int]) -> np.ndarray:
    """T (n, n - k) with u = T q: each NES coordinate moves with the one coordinate beside it in the gap of its stop, c . u = 0; with the
    ground where there is none beside it.

    Raises
    ------
    ValueError
        Where no NES is marked, or a gap does not tell what its coordinate is tied to.
    """
    n = system.degrees_of_freedom
    if not nes:
        raise ValueError("no coordinate is marked as NES, which is what would be locked (in a scene NES under [coordinates])")
    kept = [k for k in range(n) if k not in nes]
    matrix = np.zeros((n, len(kept)))
    matrix[kept, range(len(kept))] = 1.0
    for k in nes:
        hosts = {
            tuple((j, -stop.gap[j] / stop.gap[k]) for j in range(n) if stop.gap[j] and j != k)
            for stop in system.stops
            if stop.gap[k] and not any(stop.gap[j] for j in nes if j != k)
        }
        if len(hosts) != 1 or len(host := next(iter(hosts))) > 1:
            raise ValueError(f"{system.coordinates[k]} cannot be locked: expected one gap, between it and one other coordinate at most")
        for j, ratio in host:
            matrix[k, kept.index(j)] = ratio
    return matrix


def lock(system: ImpactSystem, nes: Sequence[int], forces: Sequence[Force] = ()) -> tuple[ImpactSystem, tuple[Force, ...]]:
    """The system and its loads with the NES locked: T'MT, T'CT, T'KT, T'f, and the stops that are left.

    Parameters
    ----------
    system : ImpactSystem
    nes : sequence of int
    forces : sequence of bvp.forcing loads

    Raises
    ------
    ValueError
        See `tie`; and where no coordinate is left.

    Examples
    --------
    The reference system: the two masses move as one.

    >>> from bvp.system import vibro_impact_nes
    >>> locked, _ = lock(vibro_impact_nes(mu=0.1, lam=0.02), (0,))
    >>> locked.mass, locked.damping, locked.stiffness, locked.coordinates
    (array([[1.1]]), array([[0.02]]), array([[1.]]), ('u2',))
    """
    matrix = tie(system, nes)
    if not matrix.shape[1]:
        raise ValueError("every coordinate is marked as NES: nothing is left to move when it is locked")
    kept = [k for k in range(system.degrees_of_freedom) if k not in nes]
    rows = [np.array(stop.gap) @ matrix for stop in system.stops]
    free = [np.abs(row).max() > 1e-12 * np.abs(stop.gap).max() for row, stop in zip(rows, system.stops, strict=True)]
    stops = tuple(replace(stop, gap=tuple(row)) for stop, row, moves in zip(system.stops, rows, free, strict=True) if moves)
    if not stops:
        row = np.zeros(len(kept))
        row[0] = 1.0
        stops = (replace(system.stops[0], gap=tuple(row), lower=-_OUT_OF_REACH, upper=_OUT_OF_REACH),)
    mass, damping, stiffness = (matrix.T @ part @ matrix for part in (system.mass, system.damping, system.stiffness))
    locked = replace(
        system, mass=mass, damping=damping, stiffness=stiffness, stops=stops, coordinates=tuple(system.coordinates[k] for k in kept),
        absorber=None, primary=None, model=None, parameters=None,
    )  # fmt: skip
    return locked, tuple(_tied(force, matrix) for force in forces)


def _tied(force: Force, matrix: np.ndarray) -> Force:
    """A load with T'f in place of f."""
    if isinstance(force, Constant):
        return Constant(matrix.T @ force.load)
    if isinstance(force, Record):
        return replace(force, load=matrix.T @ force.load)
    assert isinstance(force, Harmonic) and force.cosine is not None and force.sine is not None
    return replace(force, cosine=matrix.T @ force.cosine, sine=matrix.T @ force.sine)
