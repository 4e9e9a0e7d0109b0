"""Discovery with what a catalogue knows: the family of each orbit that is found."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from saltus.errors import BadInput

if TYPE_CHECKING:
    from branches.catalogue import Catalogue
    from branches.discovery.search import Discovery
    from bvp.system import ImpactSystem

__all__ = ["discover"]


def discover(system: ImpactSystem, energy: float, *, catalogue: Catalogue | None = None, **options: Any) -> Discovery:
    """Find every primitive symmetric orbit at an energy, within bounds.

    Parameters
    ----------
    system : bvp.system.ImpactSystem
        Conservative, two degrees of freedom, one stop.
    energy : float
        h > 0.
    catalogue : saltus.Catalogue, optional
        Of the same system: the families of the orbits are looked up in it, and stand in ``families`` of what is returned.
    **options
        ``quarter_period``, ``impacts``, ``ends`` and ``budget`` of `branches.discovery.search.discover`.

    Returns
    -------
    branches.discovery.search.Discovery

    Raises
    ------
    ValueError
        For a system or bounds that cannot be searched, or a catalogue of another system.

    Examples
    --------
    >>> from bvp import vibro_impact_nes
    >>> found = discover(vibro_impact_nes(), 0.3, quarter_period=3.0, impacts=2)
    >>> [orbit.label for orbit in found.orbits], found.families
    (['S11O00-', 'U2111-', 'S13O00+'], ())
    """
    from branches.discovery.search import discover as search

    if options.get("impacts") == 0:
        raise BadInput("at most 0 impacts in half a period: no orbit with impacts has so few, expected 1 or more")
    if catalogue is None:
        return search(system, energy, **options)
    catalogue.require_system(system.describe())
    found = search(system, energy, **options)
    return replace(found, families=tuple(map(catalogue.identify, found.orbits)))
