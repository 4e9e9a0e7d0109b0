"""Where the runs of a study start that are on orbits: each family is followed once, in the undamped elastic system of its runs."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from saltus.errors import BadInput, one_line

if TYPE_CHECKING:
    from branches.labels import Name
    from branches.orbit import Orbit
    from saltus.scene import Scene
    from transitions.study.plan import Plan
    from transitions.study.runs import Starts

__all__ = ["FamilySeed", "Found", "family_seeds", "find_starts", "starts_of"]

_OF_ORBITS = ("mu", "sigma")
"""Parameters that orbits of the undamped elastic system depend on."""


class FamilySeed(NamedTuple):
    """A family to follow, and the energies at which its orbits are wanted: plain data.

    Attributes
    ----------
    system : str
        Description of the undamped elastic system, as JSON.
    name : str
    energies : tuple of float
    runs : tuple of int
        The run of each.
    bounds : dict
        Of the scene's search for names.
    pins : dict
        The scene's pinned names, where they hold for the system.
    """

    system: str
    name: str
    energies: tuple[float, ...]
    runs: tuple[int, ...]
    bounds: dict[str, Any]
    pins: dict[str, dict[str, float]]


class Found(NamedTuple):
    """The orbits of a family at the energies of a seed: states (k, 2n), NaN for none, and the contacts just left; or why there are none."""

    states: np.ndarray
    leaving: tuple[str, ...]
    error: str = ""


def family_seeds(plan: Plan, scene: Scene) -> list[FamilySeed]:
    """The families of a plan of a scene, with the energies of their runs."""
    from bvp.system import ImpactSystem
    from transitions.study.plan import IMPULSIVE

    names = plan.families
    if names == (IMPULSIVE,):
        return []
    given = plan.values(0, plan.count)
    count = plan.count
    index = given["family"].astype(np.int64) if "family" in given else np.zeros(count, dtype=np.int64)
    energies = given.get("energy", np.full(count, plan.fixed.get("energy", np.nan)))
    if plan.units == "physical":
        energies = energies / given.get("clearance", np.full(count, plan.fixed.get("clearance", 1.0))) ** 2
    varied = [name for name in _OF_ORBITS if name in given]
    rows = np.stack([index.astype(float), *(given[name] for name in varied)], axis=1)
    distinct, which = np.unique(rows, axis=0, return_inverse=True)
    order = np.argsort(which.ravel(), kind="stable")
    parts = np.split(order, np.cumsum(np.bincount(which.ravel()))[:-1])
    seeds = []
    for row, runs in zip(distinct, parts, strict=True):
        name = names[int(row[0])]
        if name == IMPULSIVE:
            continue
        described = {**plan.system, **dict(zip(varied, map(float, row[1:]), strict=True))}
        system = ImpactSystem.from_description(described).underlying
        wanted, pins = tuple(energies[runs].tolist()), scene.underlying.pins_for(system)
        seeds.append(FamilySeed(json.dumps(system.describe()), name, wanted, tuple(runs.tolist()), scene.bounds, pins))
    return seeds


def find_starts(seed: FamilySeed) -> Found:
    """Follow the family of a seed, and take its orbits at the energies.

    Where it has several there, that with the quarter period nearest to the name's is taken.
    """
    from branches.labels import parse_name
    from bvp.system import ImpactSystem
    from saltus.orbit_choice import list_orbits, orbits_of
    from saltus.scene import Scene
    from saltus.tracing import trace

    system = ImpactSystem.from_description(json.loads(seed.system))
    n = system.degrees_of_freedom
    states, leaving = np.full((len(seed.energies), 2 * n), np.nan), [""] * len(seed.energies)
    name = parse_name(seed.name)
    lowest, highest = seed.bounds["energy"]
    low, high = min(lowest, 0.9 * min(seed.energies)), max(highest, 1.1 * max(seed.energies))
    scene = Scene(system=system, pins=seed.pins, **seed.bounds)
    try:
        branch = trace(seed.name, scene=scene, energy=(low, high))
    except (ValueError, RuntimeError) as error:
        return Found(states, tuple(leaving), one_line(error))
    known: dict[float, tuple[np.ndarray, str]] = {}
    for k, energy in enumerate(seed.energies):
        if energy not in known:
            found = orbits_of(branch, name, energy)
            if len(found) > 1 and name.alpha is None:
                listed = list_orbits(found, branch)
                return Found(states, tuple(leaving), f"{len(found)} orbits of {seed.name} have h = {energy:.10g}, expected one of {listed}")
            known[energy] = _state(_nearest(found, name), n)
        states[k], leaving[k] = known[energy]
    return Found(states, tuple(leaving))


def _nearest(found: list[Orbit], name: Name) -> Orbit | None:
    wish = name.alpha
    if wish is None:
        return found[0] if found else None
    return min(found, key=lambda orbit: abs(orbit.alpha - wish), default=None)


def _state(orbit: Orbit | None, n: int) -> tuple[np.ndarray, str]:
    """The start of an orbit, and the contact that it leaves."""
    if orbit is None:
        return np.full(2 * n, np.nan), ""
    if orbit.velocities is not None:
        return np.concatenate([np.zeros(n), orbit.velocities]), ""
    u, v = orbit.sample(np.zeros(1))
    first = orbit.impacts[0] if orbit.impacts and orbit.impacts[0].time == 0.0 else None
    return np.concatenate([u[0], v[0]]), "" if first is None else first.stop


def starts_of(plan: Plan, seeds: list[FamilySeed], found: Mapping[int, Found]) -> Starts | None:
    """The starts of all runs of a plan from what was found for each of its seeds; None where all are impulsive.

    Raises
    ------
    BadInput
        For the first family that was not found, or has several orbits.
    """
    from bvp.system import ImpactSystem
    from transitions.study.runs import Starts

    if not seeds:
        return None
    for k, seed in enumerate(seeds):
        if found[k].error:
            raise BadInput(_told(plan, seed, found[k].error))
    n = ImpactSystem.from_description(plan.system).degrees_of_freedom
    states, leaving = np.full((plan.count, 2 * n), np.nan), np.full(plan.count, "", dtype="<U2")
    for k, seed in enumerate(seeds):
        runs = np.array(seed.runs)
        states[runs] = found[k].states
        leaving[runs] = found[k].leaving
    return Starts(states, leaving)


def _told(plan: Plan, seed: FamilySeed, error: str) -> str:
    """What was wrong with a family, and in which system, where that is varied."""
    described: dict[str, Any] = json.loads(seed.system)
    where = ", ".join(f"{name} = {described[name]:.6g}" for name in _OF_ORBITS if name in plan.names)
    return f"family {seed.name!r}{f' at {where}' if where else ''}: {error}"
