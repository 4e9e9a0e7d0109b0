"""Tracing a named family with what the scene says: its system, bounds, energy range, and the names that its literature uses."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from bvp.checks import require_system
from bvp.shown import shown
from saltus.errors import BadInput
from saltus.scene import Scene, load_scene

if TYPE_CHECKING:
    from branches.branch import Branch
    from branches.catalogue import Catalogue
    from bvp.system import ImpactSystem

__all__ = ["trace"]


def trace(
    name: str,
    system: ImpactSystem | None = None,
    *,
    scene: Scene | str | os.PathLike[str] | None = None,
    energy: tuple[float, float] | None = None,
    catalogue: Catalogue | None = None,
    **options: Any,
) -> Branch:
    """Follow the family of periodic orbits that has a name.

    Parameters
    ----------
    name : str
        A label of Lee et al., Physica D 238 (2009) 1868, such as ``S13O00+`` or ``U8353-@h=1.9,alpha=4.9``, or a family's id.
    system : bvp.system.ImpactSystem, optional
        By default the system of the scene.
    scene : Scene or path-like, optional
        Where the bounds of the search and the energy range come from; by default the reference scene. Its pinned names hold
        only for its own system.
    energy : tuple of float, optional
        Lowest and highest energy h; by default those of the scene.
    catalogue : saltus.Catalogue, optional
        Where the name is looked up, in place of a search; the family is followed anew from the orbit that is found there.
    **options
        ``points``, ``direction``, ``stop_at``, ``stop_when`` and the callbacks of `branches.tracing.trace`.

    Returns
    -------
    branches.branch.Branch

    Raises
    ------
    ValueError
        For a name that does not parse, that no orbit or more than one family has, or options that cannot be, in one line.
    RuntimeError
        Where the family cannot be followed for numerical reasons.

    Examples
    --------
    >>> branch = trace("S13O00+", energy=(0.1, 1.0))
    >>> branch.events[0].type, round(branch.events[0].h, 10)
    ('GR', 0.1185078106)
    """
    from branches.tracing import trace as follow

    if not isinstance(scene, Scene):
        scene = load_scene(scene)
    if system is None:
        scene.require_used("saltus.trace")
        system = scene.system
    require_system(system)
    for option in ("pins", "bounds"):
        if not isinstance(options.get(option, {}), Mapping):
            raise BadInput(f"{option} = {shown(options[option])}: expected a mapping")
    energy = scene.energy if energy is None else energy
    pins = {**scene.pins_for(system), **options.pop("pins", {})}
    bounds = {**scene.bounds, **options.pop("bounds", {})}
    if catalogue is not None:
        catalogue.require_system(system.describe())
        return _follow_kept(name, catalogue, energy, pins, **options)
    return follow(name, system, energy=energy, pins=pins, bounds=bounds, **options)


def _follow_kept(
    name: str,
    catalogue: Catalogue,
    energy: tuple[float, float],
    pins: dict[str, dict[str, float]],
    on_start: Callable[[str], object] | None = None,
    **options: Any,
) -> Branch:
    """Follow a family of a catalogue from the point that lies nearest to what the name selects, inside the range of energies."""
    import numpy as np

    match = catalogue.find(name, pins=pins)
    if match.kind != "family":
        raise BadInput(f"{name} is a {match.kind}: it has no impacts; expected the name of an impacting family")
    branch = catalogue.branch(match.id)
    h, alpha = branch.points["h"], branch.points["alpha"]
    inside = np.flatnonzero((h >= energy[0]) & (h <= energy[1]))
    if not len(inside):
        raise BadInput(f"{name} has h = {h.min():.6g} to {h.max():.6g}, outside the energy range {energy[0]:g}:{energy[1]:g}")
    i = branch.start if branch.start in inside else int(inside[0])
    if match.h is not None and match.alpha is not None:
        i = int(inside[np.argmin(np.hypot(np.log(h[inside] / match.h), np.log(alpha[inside] / match.alpha)))])
    if on_start is not None:
        on_start(f"{branch.points['label'][i] or match.id}: point {i} of {match.id} in {catalogue.path}, from h = {h[i]:.10g}")
    return branch.trace(i, energy=energy, rising=bool(h[0] <= h[-1]), **options)
