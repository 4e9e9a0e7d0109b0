"""`saltus plot STUDY --plot FILE`: figures of a study, or a table of its runs, from its data on disk."""

from __future__ import annotations

import argparse
import sys
from functools import partial
from typing import TYPE_CHECKING, Any

from saltus import outputs
from saltus.errors import BadInput, nearest
from saltus.tables import table_lines, terminal_width

if TYPE_CHECKING:
    from transitions.study.study import Best, Study

__all__ = ["add_arguments", "run"]

VIEWS = ("map", "lines", "best")
_TABLES = {kind: outputs.KINDS[kind] for kind in ("csv", "npz", "mat")}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    parser.add_argument("study", metavar="STUDY", help="folder of a study, as saltus study made it")
    outputs.add_arguments(parser, "plot", **{kind: meaning.replace("all data", "the runs") for kind, meaning in _TABLES.items()})
    parser.add_argument("--out", dest="plot", default=argparse.SUPPRESS, help=argparse.SUPPRESS)
    parser.add_argument(
        "--view", metavar="VIEW", choices=VIEWS,
        help="map: in colours over two parameters; lines: against each parameter; best: about the best run "
        "(default: map where two numbers are varied, else lines)",
    )  # fmt: skip
    parser.add_argument("--value", metavar="NAME", help="the result that is drawn (default: that of --best)")
    parser.add_argument(
        "--best", metavar="NAME", default="nes_share", help="the best run has the largest value of this result (default: nes_share)"
    )
    parser.add_argument("--over", metavar="X,Y", help="the two parameters of a map (default: the first two that are numbers)")


def run(arguments: argparse.Namespace) -> int:
    """Run the command; return the exit code."""
    files = outputs.outputs_of(arguments)
    if not files.places:
        raise BadInput("missing: --plot, --csv, --npz or --mat (see saltus plot --help)")

    from transitions.study.study import Study, numeric_axes

    study = Study(arguments.study)
    if not len(study):
        raise BadInput(f"no run of {arguments.study} is finished; run saltus study first")
    best, value = _result(study, "--best", arguments.best), arguments.value
    value = best if value is None else _result(study, "--value", value)
    numeric = [axis.name for axis in numeric_axes(study)]
    view = arguments.view or ("map" if len(numeric) >= 2 else "lines")
    options: dict[str, Any] = {"best": best, "value": value}
    if arguments.over is not None:
        if view != "map":
            raise BadInput("--over names the two parameters of a map; expected --view map")
        options["axes"] = _pair(arguments.over, numeric)
    if not study.complete:
        files.report([f"{len(study)} of {study.plan.count} runs are finished"])
    files.report(best_lines(study, study.best(best), best))

    plot = partial(outputs.draw, f"transitions.figures.study:{view}_figure", study, **options)
    return files.write(table=lambda: {"run": study.runs, **study.given, **{name: study[name] for name in study.names}}, plot=plot)


def _result(study: Study, option: str, name: str) -> str:
    if name not in study.names:
        raise BadInput(f"{option} {name}: no such result{nearest(name, study.names) or '; expected ' + ', '.join(study.names)}")
    return name


def _pair(text: str, numeric: list[str]) -> tuple[str, str]:
    names = [part.strip() for part in text.split(",")]
    if len(names) != 2 or names[0] == names[1]:
        raise BadInput(f"--over {text!r}: expected two parameters X,Y of {', '.join(numeric)}")
    for name in names:
        if name not in numeric:
            hint = nearest(name, numeric) or f"; expected {', '.join(numeric)}"
            raise BadInput(f"--over {text!r}: {name!r} is not a number that the study varies{hint}")
    return names[0], names[1]


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
