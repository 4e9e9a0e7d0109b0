"""Discovery with what a catalogue knows: the family of each orbit that is found."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from saltus.errors import BadInput

if TYPE_CHECKING:
    from branches.catalogue import Catalogue
    from branches.discovery.search import Discovery
    from bvp.system import ImpactSystem

__all__ = ["discover", "ids_without_labels"]


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


def ids_without_labels(found: Discovery) -> tuple[str | None, ...]:
    """The ids of the families of those orbits that have no label to be named by.

    Parameters
    ----------
    found : branches.discovery.search.Discovery

    Returns
    -------
    tuple of (str or None)
        One of each orbit: None where it has a label, or its family cannot be followed. Empty where all have labels.
    """
    from branches.tracing import follow_family
    from saltus.first_run import prepare
    from saltus.progress import ProgressBar

    unnamed = [orbit for orbit in found.orbits if not orbit.label]
    if not unnamed:
        return ()
    prepare()
    ids: dict[int, str] = {}
    with ProgressBar(len(unnamed), "orbits without a label") as bar:
        for count, orbit in enumerate(unnamed, 1):
            with suppress(RuntimeError, ValueError):
                ids[id(orbit)] = follow_family(orbit.problem, orbit.solution.y, points=1).id
            bar.update(count)
    return tuple(ids.get(id(orbit)) for orbit in found.orbits)
