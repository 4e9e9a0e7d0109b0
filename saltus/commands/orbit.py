"""`saltus orbit NAME --energy H`: one orbit of a named family, with its impacts, multipliers, quality and shape."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from saltus import catalogue_arguments, outputs, scene_arguments
from saltus.arguments import one_of, positive
from saltus.errors import BadInput
from saltus.events_table import stability_word
from saltus.orbit_choice import agreed, family_of, select

if TYPE_CHECKING:
    from branches.orbit import Orbit

__all__ = ["add_arguments", "run"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    parser.add_argument("name", metavar="NAME", help="S13O00+, U8353-, S73O33-@h=7.33,alpha=1.65, a family's id or a part of it")
    parser.add_argument("--energy", metavar="H", type=positive, help="the orbit at this energy h")
    parser.add_argument("--alpha", metavar="A", type=positive, help="the orbit with this quarter period")
    parser.add_argument(
        "--method",
        metavar="METHOD",
        type=one_of("exact", "nstt"),
        default="exact",
        help="exact (default), or nstt: shooting in nonsmooth time as in Lee et al. (2009), approximate, without multipliers",
    )
    parser.add_argument("--tolerance", metavar="EPS", type=positive, help="of nstt: matching at half a period, from 1e-13 (default: 1e-6)")
    outputs.add_arguments(parser)
    catalogue_arguments.add_file(parser, "take the family from this catalogue, as it was followed, in place of a search")
    scene_arguments.add_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Do what was asked; return the exit code."""
    files = outputs.from_arguments(arguments)
    if arguments.tolerance is not None and arguments.method == "exact":
        raise BadInput("--tolerance is of an approximate method, and --method is exact: expected --method nstt with it")
    if arguments.tolerance is not None:
        from bvp.nonsmooth_time import LEAST_TOLERANCE

        if arguments.tolerance < LEAST_TOLERANCE:
            raise BadInput(f"--tolerance: received {arguments.tolerance:g}, expected {LEAST_TOLERANCE:g} or more: less is below rounding")

    from branches.labels import parse_name

    scene = scene_arguments.from_arguments(arguments)
    text = catalogue_arguments.named(arguments.name, arguments, scene)
    name = parse_name(text)
    energy = agreed(arguments.name, "h", name.h, "--energy", arguments.energy)
    alpha = agreed(arguments.name, "alpha", name.alpha, "--alpha", arguments.alpha)
    if energy is None and alpha is None:
        raise BadInput(f"which orbit of {name}? expected --energy H or --alpha A")
    if arguments.model:
        from saltus.model import explain

        for line in explain(scene.system, text):
            print(f"model  {line}", file=files.words, flush=True)
    branch = family_of(text, scene, energy, arguments)
    orbit = select(branch, name, energy, alpha)
    if arguments.method == "nstt":
        from bvp.nonsmooth_time import TOLERANCE
        from saltus.nonsmooth_time import approximate

        exact = orbit
        orbit = approximate(exact, arguments.tolerance or TOLERANCE)
    for line in describe(orbit, orbit.label or branch.id):
        print(line, file=files.words, flush=True)
    if arguments.method == "nstt":
        print(f"exact    h = {exact.h:.15g}: off by {orbit.h - exact.h:.1e}", file=files.words, flush=True)

    from branches.record import orbit_to_csv, orbit_to_json

    def draw(path: Path) -> None:
        from branches.diagram import draw_orbit

        draw_orbit(orbit, path)

    return files.write(json=lambda: orbit_to_json(orbit), csv=lambda: orbit_to_csv(orbit), draw=draw)


def describe(orbit: Orbit, name: str) -> list[str]:
    """Return the lines that report an orbit.

    Parameters
    ----------
    orbit : branches.orbit.Orbit
    name : str
        Its label, or the id of its family.

    Returns
    -------
    list of str
    """
    from branches.tracing import HIGHEST
    from bvp.multipliers import TRIVIAL_LOST

    values = {"tau": orbit.tau, "tau_half": orbit.tau_half}
    traces = "".join(f"  {name} = {value:.10g}" for name, value in values.items() if math.isfinite(value))
    lines = [
        f"orbit    {name}  ends {orbit.ends[0]} {orbit.ends[1]}  word {orbit.word or '(none)'}",
        f"energy   h = {orbit.h:.15g}",
        f"period   T = {orbit.period:.15g}  alpha = T/4 = {orbit.alpha:.15g}",
        f"stable   {stability_word(orbit.stable)}{traces}",
    ]
    lines += [f"multiplier  {value.real:+.12e} {value.imag:+.12e} i  modulus {abs(value):.12e}" for value in orbit.multipliers]
    lines.append(_quality_line(orbit))
    if orbit.quality["trivial"] >= TRIVIAL_LOST:
        lines.append("doubt    a product of saltation matrices loses the trivial multiplier; those above are of the saddle-point matrix")
    if orbit.h > HIGHEST:
        lines.append(f"doubt    above h = {HIGHEST:g} the forces of the springs are lost in rounding beside the speeds of the impacts")
    lines.append(f"impacts  {len(orbit.impacts)} in a period")
    lines.append(f"{'time':>20}  stop  {'speed':>20}")
    lines += [f"{impact.time:20.14g}  {impact.stop:<4}  {impact.speed:20.14g}" for impact in orbit.impacts]
    return lines


def _quality_line(orbit: Orbit) -> str:
    """The line that tells how good the numbers are."""
    quality = orbit.quality
    if quality.get("approximate"):
        return (
            f"quality  APPROXIMATE  {quality['method']} ({quality['integrator']})  tolerance {quality['tolerance']:.1e}"
            f"  mismatch {orbit.residual:.1e}  energy drift {quality['drift']:.1e}  no multipliers"
        )
    reliable = "reliable" if quality["reliable"] else "NOT RELIABLE"
    return f"quality  {reliable}  trivial {quality['trivial']:.1e}  pairing {quality['pairing']:.1e}  residual {orbit.residual:.1e}"
