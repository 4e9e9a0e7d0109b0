"""The one orbit that a name, an energy and a quarter period select: of a family that is traced, or that a catalogue has."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from saltus import catalogue_arguments
from saltus.errors import BadInput

if TYPE_CHECKING:
    from branches.branch import Branch
    from branches.labels import Name
    from branches.orbit import Orbit
    from saltus.scene import Scene

__all__ = ["TOLERANCE", "agreed", "family_of", "list_orbits", "orbits_of", "select"]

TOLERANCE = 0.01
"""How far, relatively, a selecting value may be from the orbit that it selects."""


def agreed(text: str, key: str, said: float | None, option: str, given: float | None) -> float | None:
    """The value that a name or an option gives.

    Raises
    ------
    BadInput
        Where both give one, and they differ.
    """
    if said is not None and given is not None and said != given:
        raise BadInput(f"{text} says {key} = {said:.10g} and {option} says {given:.10g}: expected one of them")
    return said if given is None else given


def family_of(name: str, scene: Scene, energy: float | None, arguments: argparse.Namespace) -> Branch:
    """The family as a catalogue has it; else traced over the scene's energies, and past them as far as the energy asked for."""
    with catalogue_arguments.lookup(name, arguments, scene) as opened:
        if opened is not None:
            match = opened.find(name)
            if match.kind != "family":
                raise BadInput(f"{name} is a {match.kind}: it has no impacts; expected the name of an impacting family")
            return opened.branch(match.id)
    from saltus.first_run import prepare
    from saltus.progress import ProgressBar
    from saltus.tracing import trace

    prepare()
    low, high = scene.energy
    if energy is not None:
        low, high = min(low, 0.9 * energy), max(high, 1.1 * energy)
    with ProgressBar() as bar:
        return trace(name, scene=scene, energy=(low, high), on_point=bar.update)


def select(branch: Branch, name: Name, energy: float | None, alpha: float | None) -> Orbit:
    """Find the one orbit of a family with an energy, with a quarter period, or nearest to both."""
    key, value, other, wish = ("h", energy, "alpha", alpha) if energy is not None else ("alpha", alpha, "h", None)
    assert value is not None
    found = orbits_of(branch, name, energy, alpha)
    if not found:
        values = branch.points[key]
        raise BadInput(
            f"no orbit of {name} has {key} = {value:.15g}: the family was followed from {key} = {values.min():.15g} to {values.max():.15g}"
        )
    if wish is not None:
        nearest = min(found, key=lambda orbit: abs(getattr(orbit, other) - wish))
        if abs(getattr(nearest, other) - wish) > TOLERANCE * wish:
            near = list_orbits([nearest], branch)
            raise BadInput(f"no orbit of {name} has {key} = {value:.10g} and {other} = {wish:.10g}; nearest: {near}")
        return nearest
    if len(found) > 1:
        raise BadInput(f"{len(found)} orbits of {name} have {key} = {value:.10g}, expected one of {list_orbits(found, branch)}")
    return found[0]


def orbits_of(branch: Branch, name: Name, energy: float | None = None, alpha: float | None = None) -> list[Orbit]:
    """The orbits of a family with an energy, or else with a quarter period, that a name can mean."""
    found = branch.orbits_at(energy=energy) if energy is not None else branch.orbits_at(alpha=alpha)
    # A family carries several labels: where some of its orbits here have the label asked for, the others are not meant.
    return _distinct([orbit for orbit in found if _has_label(orbit, name)] or found)


def _distinct(orbits: list[Orbit]) -> list[Orbit]:
    """Each orbit once: a family that turns back on itself passes through the same orbit twice, the second time from its other end."""
    from branches.identity import same_orbit

    kept: list[Orbit] = []
    for orbit in orbits:
        mine = (orbit.problem, orbit.solution.y)
        if not any(abs(other.alpha / orbit.alpha - 1.0) < 1e-9 and same_orbit((other.problem, other.solution.y), mine) for other in kept):
            kept.append(orbit)
    return kept


def _has_label(orbit: Orbit, name: Name) -> bool:
    """Tell whether an orbit has the label of a name."""
    from branches.labels import matches, parse

    return name.label is not None and bool(orbit.label) and matches(name.label, parse(orbit.label))


def list_orbits(orbits: list[Orbit], branch: Branch) -> str:
    """Name orbits of a branch by label, or else by its id, with the suffix that selects each: with as many digits as tell them apart."""
    for digits in range(6, 18):
        suffixes = {f"@h={orbit.h:.{digits}g},alpha={orbit.alpha:.{digits}g}" for orbit in orbits}
        if len(suffixes) == len(orbits):
            break
    return " ".join(f"{orbit.label or branch.id}@h={orbit.h:.{digits}g},alpha={orbit.alpha:.{digits}g}" for orbit in orbits)
