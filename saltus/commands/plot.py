"""`saltus plot STUDY --plot FILE`: figures of a study, or a table of its runs, from its data on disk."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING, Any

from bvp.expressions import normalised
from saltus import inputs, outputs, responses
from saltus.errors import BadInput, nearest
from saltus.terminal import table_lines, terminal_width

if TYPE_CHECKING:
    from branches.tables import Table
    from transitions.study.study import Best, Study

VIEWS = ("map", "lines", "best")
_TABLES = {kind: outputs.KINDS[kind] for kind in ("json", "csv", "npz", "mat")}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    parser.add_argument("study", metavar="STUDY", help="folder of a study, as saltus study made it, or a JSON file of responses")
    outputs.add_arguments(parser, "plot", **{kind: meaning.replace("all data", "the runs") for kind, meaning in _TABLES.items()})
    parser.add_argument(
        "--view", metavar="VIEW", choices=VIEWS,
        help="map: in colours over two parameters; lines: against each parameter; best: about the best run "
        "(default: map where two numbers are varied, else lines)",
    )  # fmt: skip
    parser.add_argument("--value", metavar="NAME", help="the result that is drawn (default: that of --best)")
    parser.add_argument(
        "--best", metavar="NAME", default="nes_share", help="the best run has the largest value of this result (default: nes_share)"
    )
    parser.add_argument("--x", metavar="COLUMN", type=normalised, help="of responses: another horizontal axis than the parameter")
    parser.add_argument(
        "--y", metavar="COLUMN", type=normalised,
        help="of responses: what is drawn over the parameter: max:u1, rms:u1, speed, ...",
    )
    responses.add_harmonics(parser)
    parser.add_argument(
        "--beside", metavar="STUDY", action="append",
        help="with --view lines: draw another study of the same parameters beside; over responses in the frequency of the load: draw the "
        "backbone, a family in the energy of the same masses and springs, from its JSON file; repeatable",
    )
    parser.add_argument("--over", metavar="X,Y", help="the two parameters of a map (default: the first two that are numbers)")


def run(arguments: argparse.Namespace) -> int:
    """Run the command; return the exit code."""
    is_response = inputs.is_response_file(arguments.study)
    given = next((option for option in ("x", "y", "harmonics") if getattr(arguments, option) is not None), None)
    if given and not is_response:
        raise BadInput(f"--{given} is an option of responses; expected a JSON file of saltus continue --in NAME")
    if is_response:
        return responses.draw(arguments, arguments.study)
    files = outputs.outputs_of(arguments)
    if not files.places:
        raise BadInput("missing: --plot, --json, --csv, --npz or --mat (see saltus plot --help)")

    from transitions.study.study import Study, numeric_axes

    study = Study(arguments.study)
    if not len(study):
        raise BadInput(f"no run of {arguments.study} is finished; run saltus study first")
    best, value = arguments.best, arguments.value or arguments.best
    for option, name in (("--best", best), ("--value", value)):
        if name not in study.names:
            raise BadInput(f"{option} {name}: no such result{nearest(name, study.names) or '; expected ' + ', '.join(study.names)}")
    numeric = [axis.name for axis in numeric_axes(study)]
    view = arguments.view or ("map" if len(numeric) >= 2 else "lines")
    if view == "map" and len(numeric) < 2:
        varied = ", ".join(study.plan.names)
        raise BadInput(f"--view map needs two parameters that are numbers; {study.path} varies {varied}: expected --view lines")
    options: dict[str, Any] = {"best": best, "value": value}
    if arguments.over is not None:
        if view != "map":
            raise BadInput("--over names the two parameters of a map; expected --view map")
        options["axes"] = axes = tuple(part.strip() for part in arguments.over.split(","))
        if len(axes) != 2 or len({*axes} & {*numeric}) != 2:
            hint = next((hint for axis in axes if axis not in numeric and (hint := nearest(axis, numeric))), "")
            raise BadInput(f"--over {arguments.over!r}: expected two parameters X,Y of {', '.join(numeric)}{hint}")
    if arguments.beside:
        if view != "lines":
            raise BadInput("--beside draws lines of other studies; expected --view lines")
        options["beside"] = [Study(place) for place in arguments.beside]
    if not study.complete:
        files.report([f"{len(study)} of {study.plan.count} runs are finished"])
    files.report(best_lines(study, study.best(best), best))

    def table() -> Table:
        return {"run": study.runs, **study.given, **{name: study[name] for name in study.names}}

    from branches.tables import table_text

    return files.write(
        {"json": lambda: table_text(table(), "json", "runs")},
        table=table,
        figure=(f"transitions.study.figure:{view}_figure", study, options),
    )


def best_lines(study: Study, best: Best, name: str) -> list[str]:
    """The lines about the best run and its neighbours."""
    import numpy as np

    keys = [*study.given]
    rows = [best.run, *best.neighbours.tolist()]
    at = np.searchsorted(study.runs, rows)
    values = study[name]
    cells = []
    for run, place in zip(rows, at, strict=True):
        given = (study.given[key][place].item() for key in keys)
        cells.append((str(run), f"{values[place]:.6g}", *(value if isinstance(value, str) else f"{value:.6g}" for value in given)))
    head = f"best     {name} = {best.value:.6g} in run {best.run}"
    return [head, *table_lines(("run", name, *keys), cells, width=terminal_width(sys.stdout), columns="r" * (2 + len(keys)))]
