"""`saltus orbit NAME --energy H`: one orbit of a named family, with its impacts, multipliers, quality and shape."""

from __future__ import annotations

import argparse
import math
from typing import TYPE_CHECKING

from saltus import catalogues, options, outputs
from saltus.errors import BadInput
from saltus.families import agreed, called, family_named, has_label, impulsive_orbit, select
from saltus.options import positive
from saltus.terminal import stability_word, table_lines

if TYPE_CHECKING:
    from branches.orbit import Orbit


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    parser.add_argument("name", metavar="NAME", help="S13O00+, U8353-, S73O33-@h=7.33,alpha=1.65, a family's id or a part of it")
    parser.add_argument("--energy", metavar="H", type=positive, help="the orbit with this energy h")
    parser.add_argument("--alpha", metavar="A", type=positive, help="the orbit with this quarter period")
    parser.add_argument(
        "--impulsive", action="store_true", help="the impulsive orbit of the family: it begins with the oscillator's velocity alone"
    )
    outputs.add_arguments(parser, "json", "csv", "npz", "mat", "plot")
    parser.add_argument("--catalogue", metavar="FILE", help="take the family from this catalogue, instead of a search")
    options.add_scene(parser, ("springs",))


def run(arguments: argparse.Namespace) -> int:
    """Run the command; return the exit code."""
    files = outputs.outputs_of(arguments)

    from branches.naming.labels import parse_name

    scene = options.scene_of(arguments)
    text = catalogues.named(arguments.name, arguments, scene)
    name = parse_name(text)
    energy = agreed(arguments.name, "h", name.h, "--energy", arguments.energy)
    alpha = agreed(arguments.name, "alpha", name.alpha, "--alpha", arguments.alpha)
    if energy is None and alpha is None and not arguments.impulsive:
        raise BadInput(f"an orbit of {name} needs --energy H, --alpha A or --impulsive")
    options.report_model(arguments, files, "explain", scene.system, text)
    branch = family_named(text, scene, energy, arguments)
    orbit = (impulsive_orbit if arguments.impulsive else select)(branch, name, energy, alpha)
    own = called(name, orbit)
    counted = f" (counted {orbit.label})" if orbit.label and own != orbit.label and not has_label(orbit, name) else ""
    files.report(options.rest_lines(scene))
    files.report(orbit_lines(orbit, (own or branch.id) + counted))

    from branches.record import orbit_to_csv, orbit_to_json
    from branches.tables import orbit_rows

    texts = {"json": lambda: orbit_to_json(orbit), "csv": lambda: orbit_to_csv(orbit)}
    figure = "branches.figures.single:orbit_figure", orbit, {"name": own}
    return files.write(texts, table=lambda: orbit_rows([(branch.id, orbit)]), figure=figure)


def orbit_lines(orbit: Orbit, name: str) -> list[str]:
    """The lines that report an orbit; `name` is its label, or the id of its family."""
    from branches.tracing import HIGHEST
    from bvp.multipliers import TRIVIAL_LOST

    values = {"tau": orbit.tau, "tau_half": orbit.tau_half}
    traces = "".join(f"  {name} = {value:.10g}" for name, value in values.items() if math.isfinite(value))
    lines = [
        f"orbit    {name}  ends {orbit.ends[0]} {orbit.ends[1]}  sequence {orbit.sequence or '(none)'}",
        f"energy   h = {orbit.h:.15g}",
        f"period   T = {orbit.period:.15g}  alpha = T/4 = {orbit.alpha:.15g}",
        f"stable   {stability_word(orbit.stable)}{traces}",
    ]
    lines += [f"multiplier  {value.real:+.12e} {value.imag:+.12e} i  modulus {abs(value):.12e}" for value in orbit.multipliers]
    quality = orbit.quality
    reliable = "reliable" if quality["reliable"] else "NOT RELIABLE"
    defects = f"trivial {quality['trivial']:.1e}  pairing {quality['pairing']:.1e}  residual {orbit.residual:.1e}"
    lines.append(f"quality  {reliable}  {defects}")
    if quality["trivial"] >= TRIVIAL_LOST:
        lines.append("warning  a product of saltation matrices loses the trivial multiplier; those above are of the saddle-point matrix")
    if orbit.h > HIGHEST:
        lines.append(f"warning  above h = {HIGHEST:g} the forces of the springs are lost in rounding beside the speeds of the impacts")
    lines.append(f"impacts  {len(orbit.impacts)} in a period")
    impacts = [(f"{impact.time:.14g}", impact.stop, f"{impact.speed:.14g}") for impact in orbit.impacts]
    return lines + (table_lines(("time", "stop", "speed"), impacts, columns="rlr") if impacts else [])
