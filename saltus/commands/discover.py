"""`saltus discover --energy H`: every primitive orbit with a reversal at an energy, within bounds."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from itertools import repeat
from typing import TYPE_CHECKING, Any

from saltus import catalogues, compiling, options, outputs
from saltus.errors import DONE, INTERRUPTED, exit_code, one_line, say
from saltus.options import positive, whole_above_zero
from saltus.terminal import ProgressBar, counted, stability_word, table_lines, terminal_width, wrapped

if TYPE_CHECKING:
    from branches.search.orbit_search import Discovery


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    parser.add_argument("--energy", metavar="H", type=positive, required=True, help="the energy h")
    options.add_shared(parser, "max-quarter-period", "max-impacts")
    parser.add_argument(
        "--ends",
        metavar="PAIRS",
        help="kinds of orbits, as pairs of ends with commas between them: origin-origin (includes the symmetric orbits, origin-rest and "
        "origin-stop), rest-rest, rest-stop, stop-stop (default: origin-origin; the others in a system without odd symmetry)",
    )
    parser.add_argument(
        "--max-starts",
        metavar="N",
        type=whole_above_zero,
        help="most starting states (default: a million, fewer if a mode is fast)",
    )
    outputs.add_arguments(parser, "json", "csv", "npz", "mat")
    parser.add_argument("--catalogue", metavar="FILE", help="report which family of this catalogue each orbit lies on")
    options.add_scene(parser, uses=("springs",))


def run(arguments: argparse.Namespace) -> int:
    """Run the command; return the exit code."""
    files = outputs.outputs_of(arguments)
    scene = options.scene_of(arguments)
    options.report_model(arguments, files, "explain_search", scene.system)

    from branches.search.discovery import check

    longest = scene.bounds["quarter_period"] if arguments.max_quarter_period is None else arguments.max_quarter_period
    ends = None if arguments.ends is None else tuple(arguments.ends.split(","))
    within: dict[str, Any] = {"quarter_period": longest, "impacts": arguments.max_impacts, "ends": ends}
    check(scene.system, arguments.energy, **within)
    if arguments.max_starts is not None:
        within["budget"] = arguments.max_starts

    from saltus.families import discover

    with catalogues.given(arguments, scene) as catalogue:
        compiling.prepare("discover" if scene.system.smooth_forces is None else "smooth discover")
        bounded = arguments.max_impacts or not scene.system.stops
        with ProgressBar(more="" if bounded else "with any number of impacts; --max-impacts bounds the search"):
            found = discover(scene.system, arguments.energy, catalogue=catalogue, **within)
    families, code = _families(found, files.words)
    files.report(options.rest_lines(scene))
    files.report(_table(found, families, terminal_width(files.words)))
    files.report(wrapped(summary(found), terminal_width(files.words), 9))

    from branches.record import discovery_to_json
    from branches.tables import orbit_rows

    ids = [family or "" for family in families or repeat(None, len(found.orbits))]
    texts = {"json": lambda: discovery_to_json(found, families)}
    return max(code, files.write(texts, table=lambda: orbit_rows(list(zip(ids, found.orbits, strict=True)))))


def _families(found: Discovery, stream: Any) -> tuple[Sequence[str | None], int]:
    """The id of each orbit's family, and the exit code: from the catalogue, else, where an orbit has no label to be named by, from
    following it. Empty where no catalogue is given and all orbits have labels."""
    from branches.tracing import follow_family

    families = list(found.families) or [None] * len(found.orbits)
    unnamed = [k for k, orbit in enumerate(found.orbits) if not orbit.label and families[k] is None]
    if not unnamed:
        return found.families, DONE
    try:
        compiling.prepare("continue" if found.system.smooth_forces is None else "smooth")
        with ProgressBar(len(unnamed), "orbits without a label") as bar:
            for count, k in enumerate(unnamed, 1):
                orbit = found.orbits[k]
                try:
                    families[k] = follow_family(orbit.problem, orbit.solution.y, points=1).id
                except Exception as error:
                    if exit_code(error) is None:
                        raise
                    bar.line(f"note   the orbit at alpha = {orbit.alpha:.8g} has no id: {one_line(error)}", stream)
                bar.update(count)
    except KeyboardInterrupt:
        say("interrupted; the search is complete, but not all orbits without a label have the id of their family")
        return families, INTERRUPTED
    return families, DONE


def _table(found: Discovery, families: Sequence[str | None], width: int | None) -> list[str]:
    """The table of the orbits."""
    from branches.record import half_period_impacts

    rows = []
    for orbit, family in zip(found.orbits, families or repeat(None), strict=False):
        velocities = orbit.velocities
        rows.append(
            (
                orbit.label, " ".join(orbit.ends), orbit.sequence, f"{half_period_impacts(orbit):g}", f"{orbit.alpha:.8g}",
                "" if velocities is None else " ".join(f"{v:.6g}" for v in velocities),
                f"{min(orbit.impact_speeds):.4g}" if len(orbit.impact_speeds) else "-",
                f"{orbit.tau:.6g}", stability_word(orbit.stable), *([family or "-"] if families else []),
            )
        )  # fmt: skip
    head = ("label", "ends", "sequence", "impacts", "alpha", "velocities", "slowest impact", "tau", "stable", "family")
    return table_lines(head[: 9 + bool(families)], rows, width=width, columns="lllrrrrrli")


def summary(found: Discovery) -> list[str]:
    """The lines that say how complete a discovery is."""
    from saltus.families import outside_text

    counts = found.counts
    bound = "any number of impacts" if found.impacts is None else f"up to {catalogues.impacts_text(found.impacts)}"
    lines = [
        f"{counted(len(found.orbits), 'orbit')} at h = {found.energy:.10g}, quarter period up to {found.quarter_period:g}, {bound}, "
        f"between the ends {', '.join(found.ends)}",
        f"scan     {counted(counts['starts'], 'start')}: {' and '.join(map(str, found.angles))} angles over half a turn for each far end; "
        f"{found.added} of the orbits are of the second scan alone" if found.angles else f"scan     {counted(counts['starts'], 'start')}, "
        f"intervals: {counts['split']} split, {counts['closed']} closed, {counts['open']} open, "
        f"{counts['resumed']} resumed, {counts['at_grazing']} as narrow as rounding at a grazing; {counted(counts['grazings'], 'grazing')}",
        f"orbits   {counted(counts['crossings'], 'crossing')}, {counts['repeated'] + counts['covers']} of them k-fold covers, "
        f"{counts['polished']} polished, {counted(counts['duplicates'], 'duplicate')}, {counts['inadmissible']} inadmissible, "
        f"{counts['unpolished']} not polished",
    ]
    lines += [
        f"unpolished  ends {' '.join(item.ends)}  sequence {item.sequence or '(none)'}  alpha = {item.alpha:.8g}  "
        f"angle = {item.parameter:.15g}: {item.reason}"
        for item in found.unpolished
    ]
    outside = outside_text(found.system)
    if outside:
        lines.append(f"rest     {outside}")
    unknown = sum(family is None for family in found.families)
    if found.families:
        lie = "lies" if unknown == 1 else "lie"
        lines.append(f"families {len(set(found.families) - {None})} of the catalogue; {counted(unknown, 'orbit')} {lie} on none of it")
    if found.complete:
        lines.append("complete  within these bounds the scan leaves nothing undecided")
        return lines
    why = ["neighbouring starts are compared, which proves nothing (--max-starts)"] if found.angles else []
    if counts["over_budget"]:
        why.append(f"the starts were used up with {counts['over_budget']} intervals left (--max-starts)")
    if counts["open"] > counts["over_budget"]:
        widest = max(found.open, key=lambda opening: opening.width)
        why.append(
            f"{counts['open'] - counts['over_budget']} intervals stay open, the widest {widest.width:.1e} at {widest.parameter:.12g}"
        )
    if counts["unpolished"]:
        why.append(f"{counts['unpolished']} crossings are not polished")
    if counts["one_sided"]:
        why.append(f"{counts['one_sided']} orbits were found from one of their two ends alone")
    return [*lines, "not complete: " + "; ".join(why)]
