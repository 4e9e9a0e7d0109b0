"""`saltus orbit NAME --energy H`: one orbit of a named family, with its impacts, multipliers, quality and shape."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from saltus import catalogue_arguments, outputs, scene_arguments
from saltus.arguments import positive
from saltus.errors import BadInput
from saltus.events_table import stability_word

if TYPE_CHECKING:
    from branches.branch import Branch
    from branches.labels import Name
    from branches.orbit import Orbit
    from saltus.scene import Scene

__all__ = ["add_arguments", "run"]

TOLERANCE = 0.01
"""How far, relatively, a selecting value may be from the orbit that it selects."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    parser.add_argument("name", metavar="NAME", help="S13O00+, U8353-, S73O33-@h=7.33,alpha=1.65, or a family's id")
    parser.add_argument("--energy", metavar="H", type=positive, help="the orbit at this energy h")
    parser.add_argument("--alpha", metavar="A", type=positive, help="the orbit with this quarter period")
    outputs.add_arguments(parser)
    catalogue_arguments.add_file(parser, "take the family from this catalogue, as it was followed, in place of a search")
    scene_arguments.add_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Do what was asked; return the exit code."""
    files = outputs.from_arguments(arguments)

    from branches.labels import parse_name

    name = parse_name(arguments.name)
    for option, said, given in (("--energy", name.h, arguments.energy), ("--alpha", name.alpha, arguments.alpha)):
        if said is not None and given is not None and said != given:
            key = "h" if option == "--energy" else "alpha"
            raise BadInput(f"{arguments.name} says {key} = {said:.10g} and {option} says {given:.10g}: expected one of them")
    energy = arguments.energy if arguments.energy is not None else name.h
    alpha = arguments.alpha if arguments.alpha is not None else name.alpha
    if energy is None and alpha is None:
        raise BadInput(f"which orbit of {name}? expected --energy H or --alpha A")
    scene = scene_arguments.from_arguments(arguments)
    if arguments.model:
        from saltus.model import explain

        for line in explain(scene.system, arguments.name):
            print(f"model  {line}", file=files.words, flush=True)
    orbit = _select(_family(arguments, scene, energy), name, energy, alpha)
    for line in describe(orbit):
        print(line, file=files.words, flush=True)

    from branches.record import orbit_to_csv, orbit_to_json

    def draw(path: Path) -> None:
        from branches.diagram import draw_orbit

        draw_orbit(orbit, path)

    return files.write(json=lambda: orbit_to_json(orbit), csv=lambda: orbit_to_csv(orbit), draw=draw)


def _family(arguments: argparse.Namespace, scene: Scene, energy: float | None) -> Branch:
    """The family as a catalogue has it; else traced over the scene's energies, and past them as far as the energy asked for."""
    if arguments.catalogue is not None:
        with catalogue_arguments.open_file(arguments.catalogue, scene) as catalogue:
            match = catalogue.find(arguments.name)
            if match.kind != "family":
                raise BadInput(f"{arguments.name} is a {match.kind}: it has no impacts; expected the name of an impacting family")
            return catalogue.branch(match.id)
    from saltus.first_run import prepare
    from saltus.progress import ProgressBar
    from saltus.tracing import trace

    prepare()
    low, high = scene.energy
    if energy is not None:
        low, high = min(low, 0.9 * energy), max(high, 1.1 * energy)
    with ProgressBar() as bar:
        return trace(arguments.name, scene=scene, energy=(low, high), on_point=bar.update)


def _select(branch: Branch, name: Name, energy: float | None, alpha: float | None) -> Orbit:
    """Find the one orbit of a family with an energy, with a quarter period, or nearest to both."""
    key, value, other, wish = ("h", energy, "alpha", alpha) if energy is not None else ("alpha", alpha, "h", None)
    assert value is not None
    found = branch.orbits_at(energy=value) if key == "h" else branch.orbits_at(alpha=value)
    # A family carries several labels: where some of its orbits here have the label asked for, the others are not meant.
    found = _distinct([orbit for orbit in found if _has_label(orbit, name)] or found)
    if not found:
        values = branch.points[key]
        raise BadInput(
            f"no orbit of {name} has {key} = {value:.15g}: the family was followed from {key} = {values.min():.15g} to {values.max():.15g}"
        )
    if wish is not None:
        nearest = min(found, key=lambda orbit: abs(getattr(orbit, other) - wish))
        if abs(getattr(nearest, other) - wish) > TOLERANCE * wish:
            raise BadInput(f"no orbit of {name} has {key} = {value:.10g} and {other} = {wish:.10g}; nearest: {_list([nearest])}")
        return nearest
    if len(found) > 1:
        raise BadInput(f"{len(found)} orbits of {name} have {key} = {value:.10g}, expected one of {_list(found)}")
    return found[0]


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


def _list(orbits: list[Orbit]) -> str:
    """Name orbits with the suffix that selects each, with as many digits as tell them apart."""
    for digits in range(6, 18):
        suffixes = {f"@h={orbit.h:.{digits}g},alpha={orbit.alpha:.{digits}g}" for orbit in orbits}
        if len(suffixes) == len(orbits):
            break
    return " ".join(f"{orbit.label}@h={orbit.h:.{digits}g},alpha={orbit.alpha:.{digits}g}" for orbit in orbits)


def describe(orbit: Orbit) -> list[str]:
    """Return the lines that tell an orbit.

    Parameters
    ----------
    orbit : branches.orbit.Orbit

    Returns
    -------
    list of str
    """
    values = {"tau": orbit.tau, "tau_half": orbit.tau_half}
    traces = "".join(f"  {name} = {value:.10g}" for name, value in values.items() if math.isfinite(value))
    lines = [
        f"orbit    {orbit.label}  ends {orbit.ends[0]} {orbit.ends[1]}  word {orbit.word or '(none)'}",
        f"energy   h = {orbit.h:.15g}",
        f"period   T = {orbit.period:.15g}  alpha = T/4 = {orbit.alpha:.15g}",
        f"stable   {stability_word(orbit.stable)}{traces}",
    ]
    lines += [f"multiplier  {value.real:+.12e} {value.imag:+.12e} i  modulus {abs(value):.12e}" for value in orbit.multipliers]
    quality = orbit.quality
    reliable = "reliable" if quality["reliable"] else "NOT RELIABLE"
    trivial, pairing = quality["trivial"], quality["pairing"]
    lines.append(f"quality  {reliable}  trivial {trivial:.1e}  pairing {pairing:.1e}  residual {orbit.residual:.1e}")
    lines.append(f"impacts  {len(orbit.impacts)} in a period")
    lines.append(f"{'time':>20}  stop  {'speed':>20}")
    lines += [f"{impact.time:20.14g}  {impact.stop:<4}  {impact.speed:20.14g}" for impact in orbit.impacts]
    return lines
