"""`saltus impulsive --energy LO:HI`: periodic orbits that start with the oscillator's velocity alone, and all such motions as a curve."""

from __future__ import annotations

import argparse
import csv
import io
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from saltus import catalogue_arguments, outputs, scene_arguments
from saltus.arguments import energy_range, positive, whole_above_zero
from saltus.errors import DONE, FAILED
from saltus.events_table import stability_word

if TYPE_CHECKING:
    from branches.catalogue import Catalogue
    from branches.impulsive import ImpulsiveOrbits, Manifold

__all__ = ["add_arguments", "run"]

SCHEMA = 1
HEADER = f"{'label':<20} {'other side':<20} {'energy h':>16} {'quarter alpha':>16} {'u2_velocity':>14} {'impacts':>7}  stable"
COLUMNS = ("label", "family", "h", "alpha", "u2_velocity", "impacts", "other_label", "stable", "ends", "word", "residual")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    parser.add_argument("--energy", metavar="LO:HI", type=energy_range, required=True, help="range of energies h")
    parser.add_argument(
        "--max-quarter-period", metavar="A", type=positive, help="longest quarter period of the periodic orbits (default: the scene's)"
    )
    parser.add_argument("--max-impacts", metavar="K", type=whole_above_zero, help="most impacts in half a period (default: any number)")
    parser.add_argument("--density", metavar="N", type=whole_above_zero, default=100, help="energies a decade of the curve (default: 100)")
    catalogue_arguments.add_file(parser, "tell which family of this catalogue each periodic orbit lies on")
    outputs.add_arguments(parser)
    scene_arguments.add_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Do what was asked; return the exit code."""
    files = outputs.from_arguments(arguments)
    scene = scene_arguments.from_arguments(arguments)
    if arguments.model:
        from saltus.model import explain

        # Every impulsive orbit runs from the origin to the origin in half a period, as those with a label U do.
        for line in explain(scene.system, "U11"):
            print(f"model  {line}", file=files.words, flush=True)

    from branches.impulsive import impulsive_manifold, impulsive_orbits
    from saltus.first_run import prepare
    from saltus.progress import ProgressBar

    longest = arguments.max_quarter_period or scene.quarter_period
    with catalogue_arguments.given(arguments, scene) as catalogue:
        prepare(impulsive=True)
        found = impulsive_orbits(scene.system, arguments.energy, quarter_period=longest, impacts=arguments.max_impacts)
        entries = records(found, catalogue)
    print(HEADER + ("  family" if arguments.catalogue is not None else ""), file=files.words)
    for entry in entries:
        print(
            f"{entry['label']:<20} {entry['other_label']:<20} {entry['h']:>16.11g} {entry['alpha']:>16.11g} "
            f"{entry['u2_velocity']:>14.9g} {entry['impacts']:>7}  {stability_word(entry['stable']):<6}  {entry['family'] or ''}".rstrip(),
            file=files.words,
        )
    for line in remarks(found):
        print(line, file=files.words)
    curve = None
    if arguments.json or arguments.plot:
        with ProgressBar() as bar:
            curve = impulsive_manifold(scene.system, arguments.energy, density=arguments.density, on_energy=bar.update)
        print(
            f"curve  {len(curve.h)} energies, {int(curve.breaks.sum())} jumps, {curve.periods} periods of the oscillator, "
            f"{curve.window} window, {curve.sampling}",
            file=files.words,
        )
        for energy, reason in curve.failed:
            print(f"failed  at h = {energy:.10g} {reason}", file=files.words)

    def draw(path: Path) -> None:
        from branches.diagram.atlas import draw_atlas
        from branches.diagram.atlas_data import atlas_of

        draw_atlas(atlas_of(scene.system, (), manifold=curve, impulsive=found), path)

    code = files.write(json=lambda: to_json(found, entries, curve), csv=lambda: to_csv(entries), draw=draw)
    return max(code, FAILED if found.unpolished else DONE)


def records(found: ImpulsiveOrbits, catalogue: Catalogue | None = None) -> list[dict[str, Any]]:
    """Return the orbits as plain data, with the ids of their families in a catalogue."""
    return [
        {
            "label": orbit.label,
            "family": None if catalogue is None else catalogue.identify(orbit.orbit),
            "h": orbit.h,
            "alpha": orbit.alpha,
            "u2_velocity": orbit.velocity,
            "impacts": orbit.impacts,
            "other_label": orbit.other_label,
            "stable": orbit.orbit.stable,
            "ends": list(orbit.orbit.ends),
            "word": orbit.orbit.word,
            "residual": orbit.orbit.residual,
        }
        for orbit in found.orbits
    ]


def remarks(found: ImpulsiveOrbits) -> list[str]:
    """Return the lines that tell how complete the list is."""
    counts = ", ".join(f"{count} {name}" for name, count in found.counts.items())
    bound = f"quarter period up to {found.quarter_period:g}" + ("" if found.impacts is None else f", up to {found.impacts} impacts")
    state = "settled" if found.settled else "NOT settled"
    lines = [f"{state}  energies {found.energy[0]:g} to {found.energy[1]:g}, {bound}: {counts}"]
    for gone in found.unpolished:
        lines.append(f"unpolished  between h = {gone.low:.15g} and {gone.high:.15g}, {'-'.join(gone.ends)}: {gone.reason}")
    lines += [f"open  the scan did not close the energies {low:.15g} to {high:.15g}" for low, high in found.open[:10]]
    if len(found.open) > 10:
        lines.append(f"open  and {len(found.open) - 10} more")
    return lines


def to_json(found: ImpulsiveOrbits, entries: list[dict[str, Any]], curve: Manifold | None) -> str:
    """Return the JSON text: `entries` are the `records` of what was found."""
    record = {
        "schema": SCHEMA,
        "system": found.system.describe(),
        "energy": list(found.energy),
        "bounds": {"quarter_period": found.quarter_period, "impacts": found.impacts},
        "settled": found.settled,
        "counts": found.counts,
    }
    orbits = ",\n    ".join(json.dumps(entry, allow_nan=False) for entry in entries)
    apart = [{"h": [gone.low, gone.high], "ends": list(gone.ends), "reason": gone.reason} for gone in found.unpolished]
    head = json.dumps(record, allow_nan=False)[:-1]
    tail = {"unpolished": apart, "open": [list(pair) for pair in found.open], "manifold": None if curve is None else curve.record()}
    return f'{head},\n  "orbits": [\n    {orbits}\n  ],\n  {json.dumps(tail, allow_nan=False)[1:]}\n'


def to_csv(entries: list[dict[str, Any]]) -> str:
    """Return the CSV text of `records`: a line of names, a line for each orbit."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for entry in entries:
        row = {**entry, "ends": "-".join(entry["ends"]), "stable": {True: "true", False: "false", None: ""}[entry["stable"]]}
        writer.writerow([_cell(row[name]) for name in COLUMNS])
    return text.getvalue()


def _cell(value: Any) -> Any:
    if value is None:
        return ""
    return repr(value) if isinstance(value, float) else value
