"""Bounds inside which no family lies: what lies nearest to them."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from branches.building.bounds import Bounds
    from bvp.system import ImpactSystem

__all__ = ["nothing_inside"]


def nothing_inside(system: ImpactSystem, bounds: Bounds, longest: float) -> str:
    """What there is to say where no family lies inside the bounds: the shortest orbit at their lowest or highest energy.

    Parameters
    ----------
    system : bvp.system.ImpactSystem
    bounds : branches.building.bounds.Bounds
    longest : float
        Quarter period up to which is looked: from that of the bounds on, by doubling it until there is an orbit.

    Examples
    --------
    >>> from branches.building.bounds import Bounds
    >>> from bvp.system import vibro_impact_nes
    >>> print(nothing_inside(vibro_impact_nes(), Bounds((0.01, 0.02), 2.0, 3), 10.0))
    nothing lies inside the bounds: no motion reaches a stop below h = 0.05
    """
    from branches.building.work import ends_of
    from branches.discovery.search import discover
    from branches.name_search import least_energy

    told = "nothing lies inside the bounds: "
    least = least_energy(system)
    if bounds.energy[1] <= least:
        return f"{told}no motion reaches a stop below h = {least:.6g}"
    quarter_period = bounds.quarter_period
    while quarter_period < longest:
        quarter_period = min(2.0 * quarter_period, longest)
        found = [
            (orbit.alpha, energy, orbit.label or "-".join(orbit.ends))
            for energy in bounds.energy
            for orbit in discover(system, energy, quarter_period=quarter_period, impacts=bounds.impacts, ends=ends_of(system)).orbits
        ]
        if found:
            alpha, energy, name = min(found)
            shortest = f"the shortest at their lowest and highest energy is {alpha:.6g} ({name}, h = {energy:g})"
            return f"{told}no orbit has so short a quarter period; {shortest}"
    energies = " and at ".join(f"h = {energy:g}" for energy in bounds.energy)
    return f"{told}at {energies} no orbit within the impacts has a quarter period up to {quarter_period:g}"
