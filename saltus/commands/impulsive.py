"""`saltus impulsive --energy LO:HI`: periodic orbits that start with the oscillator's velocity alone, and all such motions as a curve."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from saltus import catalogues, compiling, options, outputs
from saltus.errors import DONE, FAILED
from saltus.options import energy_range, whole_above_zero
from saltus.terminal import ProgressBar, stability_word, table_lines, terminal_width

if TYPE_CHECKING:
    from branches.catalogue import Catalogue
    from branches.search.impulsive_motions import Manifold
    from branches.search.impulsive_orbits import ImpulsiveOrbits
    from branches.tables import Table

SCHEMA = 2
HEADER = ("label", "other side", "energy h", "quarter alpha", "u2_velocity", "impacts", "stable", "family")
COLUMNS = ("label", "family", "h", "alpha", "u2_velocity", "impacts", "other_label", "stable", "ends", "sequence", "residual")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    parser.add_argument("--energy", metavar="LO:HI", type=energy_range, required=True, help="range of energies h")
    options.add_shared(parser, "max-quarter-period", "max-impacts")
    parser.add_argument(
        "--density", metavar="N", type=whole_above_zero, default=100, help="energies in a decade of the curve (default: 100)"
    )
    parser.add_argument("--catalogue", metavar="FILE", help="report which family of this catalogue each periodic orbit lies on")
    outputs.add_arguments(parser, "json", "csv", "npz", "mat", "plot")
    options.add_scene(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; return the exit code."""
    files = outputs.outputs_of(arguments)
    scene = options.scene_of(arguments)
    # Every impulsive orbit runs from the origin to the origin in half a period, as those with a label U do.
    options.report_model(arguments, files, "explain", scene.system, "U11")

    from branches.search.impulsive_motions import impulsive_manifold
    from branches.search.impulsive_orbits import impulsive_orbits

    longest = arguments.max_quarter_period or scene.bounds["quarter_period"]
    with catalogues.given(arguments, scene) as catalogue:
        compiling.prepare("impulsive")
        with ProgressBar():
            found = impulsive_orbits(scene.system, arguments.energy, quarter_period=longest, impacts=arguments.max_impacts)
        entries = records(found, catalogue)
    rows = [
        (
            entry["label"], entry["other_label"], f"{entry['h']:.11g}", f"{entry['alpha']:.11g}", f"{entry['u2_velocity']:.9g}",
            str(entry["impacts"]), stability_word(entry["stable"]), *([entry["family"] or ""] if catalogue is not None else []),
        )
        for entry in entries
    ]  # fmt: skip
    head = HEADER if catalogue is not None else HEADER[:-1]
    files.report(table_lines(head, rows, width=terminal_width(files.words), columns="llrrrrli"))
    files.report(remarks(found))
    curve = None
    if {"json", "plot"} & {*files.places}:
        with ProgressBar() as bar:
            curve = impulsive_manifold(scene.system, arguments.energy, density=arguments.density, on_energy=bar.update)
        files.report(
            [
                f"curve  {len(curve.h)} energies, {int(curve.breaks.sum())} jumps, {curve.periods} periods of the oscillator, "
                f"{curve.window} window, {curve.sampling}",
                *(f"failed  at h = {energy:.10g} {reason}" for energy, reason in curve.failed),
            ]
        )
    figure: outputs.Drawing | None = None
    if "plot" in files.places:
        from branches.figures.atlas_data import atlas_of

        figure = "branches.figures.atlas:atlas_figure", atlas_of(scene.system, (), manifold=curve, impulsive=found), {}
    code = files.write({"json": lambda: impulsive_json(found, entries, curve)}, table=lambda: orbit_table(entries), figure=figure)
    return max(code, FAILED if found.unpolished else DONE)


def records(found: ImpulsiveOrbits, catalogue: Catalogue | None = None) -> list[dict[str, Any]]:
    """Return the orbits as plain data, with the ids of their families in a catalogue."""
    rows = [
        (
            item.label, None if catalogue is None else catalogue.identify(item.orbit), item.h, item.alpha, item.velocity, item.impacts,
            item.other_label, item.orbit.stable, list(item.orbit.ends), item.orbit.sequence, item.orbit.residual,
        )
        for item in found.orbits
    ]  # fmt: skip
    return [dict(zip(COLUMNS, row, strict=True)) for row in rows]


def remarks(found: ImpulsiveOrbits) -> list[str]:
    """Return the lines that say how complete the list is."""
    counts = ", ".join(f"{count} {name}" for name, count in found.counts.items())
    bound = f"quarter period up to {found.quarter_period:g}" + ("" if found.impacts is None else f", up to {found.impacts} impacts")
    state = "complete" if found.complete else "NOT complete"
    lines = [f"{state}  energies {found.energy[0]:.10g} to {found.energy[1]:.10g}, {bound}: {counts}"]
    for gone in found.unpolished:
        lines.append(f"unpolished  between h = {gone.low:.15g} and {gone.high:.15g}, {'-'.join(gone.ends)}: {gone.reason}")
    lines += [f"open  the scan did not close the energies {low:.15g} to {high:.15g}" for low, high in found.open[:10]]
    if len(found.open) > 10:
        lines.append(f"open  and {len(found.open) - 10} more")
    return lines


def impulsive_json(found: ImpulsiveOrbits, entries: list[dict[str, Any]], curve: Manifold | None) -> str:
    """Return the JSON text: `entries` are the `records` of what was found."""
    record = {
        "schema": SCHEMA,
        "system": found.system.describe(),
        "energy": list(found.energy),
        "bounds": {"quarter_period": found.quarter_period, "impacts": found.impacts},
        "complete": found.complete,
        "counts": found.counts,
        "orbits": entries,
        "unpolished": [{"h": [gone.low, gone.high], "ends": list(gone.ends), "reason": gone.reason} for gone in found.unpolished],
        "open": [list(pair) for pair in found.open],
        "manifold": None if curve is None else curve.record(),
    }
    return outputs.json_text(record)


def orbit_table(entries: list[dict[str, Any]]) -> Table:
    """Return the table of `records`: a row for each orbit."""
    import numpy as np

    columns = {name: [entry[name] for entry in entries] for name in COLUMNS}
    columns["family"] = [id or "" for id in columns["family"]]
    columns["stable"] = [-1 if stable is None else int(stable) for stable in columns["stable"]]
    columns["ends"] = ["-".join(ends) for ends in columns["ends"]]
    texts = ("label", "family", "other_label", "ends", "sequence")
    return {name: np.array(values, dtype=str if name in texts else None) for name, values in columns.items()}
