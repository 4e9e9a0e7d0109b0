"""`saltus continue NAME` or `--from START`: follow a family of periodic orbits, and print its special points as they are found.

With ``--in`` it is the response to periodic loads (`saltus.responses`).
"""

from __future__ import annotations

import argparse
import json
from contextlib import nullcontext
from functools import partial
from typing import TYPE_CHECKING

from bvp.interrupts import InterruptHandler, defer_interrupts
from saltus import catalogues, compiling, free_families, options, outputs, responses, starts
from saltus.errors import DONE, FAILED, FAILURES, INTERRUPTED, computed, one_line, say
from saltus.options import energy_range, whole_above_zero
from saltus.terminal import EVENT_COLUMNS, EVENT_ROW, ProgressBar, event_cells

if TYPE_CHECKING:
    from branches.branch import Branch, Ended
    from branches.catalogue import Catalogue
    from branches.orbit import Orbit
    from saltus.scene import Scene

EVENT_TYPES = {
    "SN": "saddle-node (fold)",
    "BP": "branch point",
    "SB": "symmetry breaking",
    "PD": "period doubling",
    "RT": "p:q resonance",
    "NS": "Krein collision",
    "GR": "grazing",
    "IO": "impulsive orbit",
    "LB": "change of label",
    "EP": "end",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    name = "S13O00+, U8353-, S73O33-@h=7.33,alpha=1.65, a family's id or a part of it"
    parser.add_argument("name", metavar="NAME", nargs="?", help=name)
    parser.add_argument(
        "--from",
        metavar="START",
        dest="start",
        help="instead of NAME: mode:K, the family that begins where linear mode K touches the stops; mode:K,cover=N,ENDS:SEQUENCE, another "
        "one that begins there; a JSON file of an orbit or of a family, FILE[@h=..,alpha=..]; FILE:EVENT[,ENDS:SEQUENCE], a family that "
        "begins at an event; with --in: rest, simulate, FILE[:EVENT], or a point of a curve, FILE:EVENT or FILE:#N",
    )
    parser.add_argument("--energy", metavar="LO:HI", type=energy_range, help="range of energies h (default: the scene's)")
    parser.add_argument("--points", metavar="N", type=whole_above_zero, help="end at N points in total")
    parser.add_argument(
        "--direction",
        metavar="WAY",
        choices=("up", "down", "both"),
        help="up: the first step raises h, or the parameter; down: it lowers it; both (default). Folds are followed either way",
    )
    types = ", ".join(f"{code} {words}" for code, words in EVENT_TYPES.items())
    parser.add_argument("--stop-at", metavar="TYPE", choices=(*EVENT_TYPES, "UZ"), help=f"end at the first event of this type: {types}")
    responses.add_arguments(parser)
    options.add_shared(parser, "frequency")
    parser.set_defaults(frequency=None)  # so that a response, which has no such axis, can refuse it
    outputs.add_arguments(parser, "json", "csv", "npz", "mat", "plot")
    parser.add_argument("--save", action="store_true", help="save the family in a catalogue")
    parser.add_argument(
        "--catalogue", metavar="FILE", help="with --save, the catalogue to keep it in (default: the scene's, in the user's data folder)"
    )
    options.add_scene(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; return the exit code."""
    if responses.wants_parameter(arguments):
        return responses.follow_free(arguments) if free_families.wants_free_family(arguments) else responses.follow_forced(arguments)
    files = outputs.outputs_of(arguments)
    responses.check_harmonics(arguments, files)
    arguments.scene_uses = ("ground", "forces", "springs")  # loads are refused below, with what to do
    scene = options.scene_of(arguments).about_rest
    responses.require_no_loads(scene)
    name = starts.name_or_orbit(arguments, scene)
    files.report(options.rest_lines(scene))
    system, orbits = (scene.system, name) if isinstance(name, str) else (name.system, name.ends)
    options.report_model(arguments, files, "explain", system, orbits)
    place = catalogues.place_to_save(arguments, scene) if arguments.save else None
    with defer_interrupts() as interrupt:
        with interrupt.released(), catalogues.lookup(name, arguments, scene) if isinstance(name, str) else nullcontext() as catalogue:
            branch, code = _follow(name, arguments, scene, files, catalogue, interrupt)
        if branch.full_family.others:
            files.report([f"cut    {branch.full_family.cut_text()}"])
        files.report(_warnings(branch))

        import numpy as np

        from branches.record import to_csv, to_json, to_record

        count, written = len(branch.points["h"]), branch
        if arguments.harmonics is not None:
            from branches.harmonics import harmonic_notes, with_harmonics

            written = with_harmonics(branch, arguments.harmonics)
            files.report(harmonic_notes(branch, arguments.harmonics))
        files_code = files.write(
            {"json": lambda: to_json(written), "csv": lambda: to_csv(written)},
            table=lambda: {"family": np.full(count, branch.id), "point": np.arange(count), **written.points},
            about=lambda: json.dumps({key: value for key, value in to_record(written).items() if key != "points"}, allow_nan=False),
            figure=("branches.figures.single:branch_figure", written, {"frequency": arguments.frequency or "index"}),
        )
        code = max(code, files_code)
        if place is not None and any(end.reason == "INTERRUPTED" for end in branch.ended):
            say("a family that was not followed to its ends is not kept in a catalogue")
        elif place is not None:
            from branches.catalogue.widening import CannotWiden

            try:
                files.report([catalogues.save_branch(branch, place, scene)])
            except CannotWiden as refused:
                say(one_line(refused))
                code = max(code, FAILED)
    if interrupt.came and code != INTERRUPTED:
        raise KeyboardInterrupt(outputs.WRITTEN)
    return code


def _follow(
    name: str | Orbit,
    arguments: argparse.Namespace,
    scene: Scene,
    files: outputs.Outputs,
    catalogue: Catalogue | None,
    interrupt: InterruptHandler,
) -> tuple[Branch, int]:
    """Trace the family and print its special points; what an interrupted or failed run has computed is kept."""
    from saltus.families import trace

    if scene.system.smooth_forces is not None:
        compiling.prepare("smooth", *(("smooth discover",) if scene.system.stops else ()))
    else:
        compiling.prepare("continue" if scene.system.degrees_of_freedom == 2 else "modes")
    with ProgressBar(arguments.points) as bar:
        report = partial(bar.line, stream=files.words)

        def end(ended: Ended) -> None:
            interrupt.keep()
            report(f"end    {ended.text}")

        try:
            branch = trace(
                name,
                scene=scene,
                catalogue=catalogue,
                energy=arguments.energy,
                points=arguments.points,
                direction=arguments.direction or "both",
                stop_at=arguments.stop_at,
                on_start=lambda text: report(f"start  {text}\n{EVENT_ROW.format(*EVENT_COLUMNS)}"),
                on_event=lambda event: report(EVENT_ROW.format(*event_cells(event)).rstrip()),
                on_end=end,
                on_point=bar.update,
                normal_forms=True,
            )
        except (KeyboardInterrupt, RuntimeError) as error:
            return computed(error)
    return branch, FAILED if any(end.reason in FAILURES for end in branch.ended) else DONE


def _warnings(branch: Branch) -> list[str]:
    """The lines that say where the multipliers are not reliable."""
    import numpy as np

    # At grazing the multipliers have no bound. The table shows it, and their quality is not in question.
    from bvp.multipliers import TRIVIAL_LOST

    points = branch.points
    uncertain = ~points["reliable"] & np.isfinite(points["multipliers"]).all(axis=1)
    lost = points["trivial"] >= TRIVIAL_LOST
    lines = []
    for which, of, what in (
        (uncertain, "the multipliers", "are not reliable"),
        (lost, "in products of saltation matrices the trivial multiplier", "is lost"),
    ):
        if which.any():
            energies = points["h"][which]
            lines.append(
                f"warning  {of} of {which.sum()} of {len(which)} points {what},"
                f" between h = {energies.min():.8g} and {energies.max():.8g}: see quality in the files"
            )
    return lines
