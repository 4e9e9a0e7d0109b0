"""`saltus plot STUDY --out FILE`: pictures of a study, from its data on disk."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from saltus.arguments import one_of
from saltus.errors import DONE, BadInput, nearest
from saltus.files import check_picture, replacing

if TYPE_CHECKING:
    from transitions.study.study import Best, Study

__all__ = ["add_arguments", "run"]

VIEWS = ("map", "lines", "best")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    parser.add_argument("study", metavar="STUDY", help="folder that saltus study has made")
    parser.add_argument("--out", metavar="FILE", required=True, help="the picture: FILE.png, FILE.pdf or FILE.svg")
    parser.add_argument(
        "--view", metavar="VIEW", type=one_of(*VIEWS),
        help="map: in colours over two parameters; lines: against each parameter; best: about the best run "
        "(default: map where two numbers are varied, else lines)",
    )  # fmt: skip
    parser.add_argument("--value", metavar="NAME", help="what is drawn (default: what --best names)")
    parser.add_argument("--best", metavar="NAME", default="nes_share", help="the best run has the largest of this (default: nes_share)")
    parser.add_argument("--over", metavar="X,Y", help="the two parameters of a map (default: the first two that are numbers)")


def run(arguments: argparse.Namespace) -> int:
    """Do what was asked; return the exit code."""
    check_picture(arguments.out)

    from transitions.study.study import Study
    from transitions.study.summary import numeric_axes

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
        print(f"{len(study)} of {study.plan.count} runs are finished", flush=True)
    for line in describe(study, study.best(best), best):
        print(line, flush=True)

    from transitions.diagram.study_picture import draw_study

    with replacing(arguments.out) as beside:
        draw_study(study, beside, view, **options)
    print(f"wrote  {arguments.out}", flush=True)
    return DONE


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
            raise BadInput(f"--over {text!r}: {name!r} is no number that the study varies{hint}")
    return names[0], names[1]


def describe(study: Study, best: Best, name: str) -> list[str]:
    """The lines that tell the best run and those about it."""
    import numpy as np

    keys = [*study.given]
    rows = [best.run, *best.neighbours.tolist()]
    at = np.searchsorted(study.runs, rows)
    values = study[name]
    lines = [f"best     {name} = {best.value:.6g} in run {best.run}", f"{'run':>9}  {name:>14}" + "".join(f"{key:>14}" for key in keys)]
    for run, place in zip(rows, at, strict=True):
        cells = (study.given[key][place].item() for key in keys)
        given = "".join(f"{cell:>14}" if isinstance(cell, str) else f"{cell:>14.6g}" for cell in cells)
        lines.append(f"{run:>9}  {values[place]:>14.6g}{given}")
    return lines
