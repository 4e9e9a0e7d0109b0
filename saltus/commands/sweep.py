"""`saltus sweep --in w --range LO:HI`: the brute-force bifurcation diagram of forced motion over one parameter."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from bvp.expressions import normalised
from bvp.texts import listed
from saltus import compiling, options, outputs, processes, responses
from saltus.errors import DONE, FAILED, INTERRUPTED, BadInput, refusing, say
from saltus.options import ValueType, finite_list, value_range, whole_above_zero
from saltus.terminal import ProgressBar, table_lines

if TYPE_CHECKING:
    from saltus.scene import Scene
    from transitions.sweep.runs import SweepPlan, SweepRun
    from transitions.sweep.sweep import Sweep

POINTS = 200
MOST_ROWS = 30
"""Rows of the table on the terminal for each sweep; the files have all values."""

_whole = ValueType(int, lambda value: 0 <= value <= 10**7, "an integer of 0 or more, up to 1e7")
_recorded = ValueType(int, lambda value: 1 <= value <= 10**7, "an integer above 0, up to 1e7")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    parser.add_argument("--in", dest="parameter", metavar="NAME", type=normalised, help="the parameter that changes")
    parser.add_argument("--range", metavar="LO:HI", type=value_range, help="its range")
    parser.add_argument(
        "--points", metavar="N", type=whole_above_zero, default=POINTS, help=f"number of values in the range (default: {POINTS})"
    )
    parser.add_argument("--up", action="store_true", help="sweep from LO to HI (default: both ways)")
    parser.add_argument("--down", action="store_true", help="sweep from HI to LO (default: both ways)")
    parser.add_argument(
        "--transient", metavar="N", type=_whole, default=200, help="periods of the load left out after each change (default: 200)"
    )
    parser.add_argument("--record", metavar="N", type=_recorded, default=100, help="periods of the load that are recorded (default: 100)")
    parser.add_argument(
        "--start",
        metavar="U1,..,V1,..",
        type=finite_list,
        action="append",
        help="start with these displacements, then velocities (default: rest); can be repeated, each start is a sweep",
    )
    parser.add_argument(
        "--y", metavar="WHAT", type=normalised,
        help="measure of the figure: speed (default with stops), strobe:u1, max:u1, ...",
    )
    parser.add_argument("--over", metavar="RESPONSE", help="draw the branches of this JSON file of saltus continue --in NAME --json on top")
    options.add_shared(parser, "workers", "dask")
    outputs.add_arguments(parser, "json", "csv", "npz", "mat", "plot")
    options.add_scene(parser, uses=("ground", "forces", "springs"))


def run(arguments: argparse.Namespace) -> int:
    """Run the command; return the exit code."""
    files = outputs.outputs_of(arguments)
    if arguments.parameter is None:
        raise BadInput("--in NAME is required: the parameter that changes")
    if arguments.range is None:
        raise BadInput("--range LO:HI is required: the range of the parameter")
    if arguments.over is not None and arguments.plot is None:
        raise BadInput("--over draws on the figure; expected --plot FILE")
    if arguments.points < 2:
        raise BadInput(f"--points {arguments.points}: expected 2 at least, the ends of the range")
    scene = options.scene_of(arguments)
    plan = _plan(arguments, scene)

    from bvp.simulate import parts_of
    from transitions.sweep.figure import default_measure, known_column, measures_of
    from transitions.sweep.runs import failures, run_sweeps, sweeps_table

    options.report_model(arguments, files, "explain_motion", scene.system, scene.forces)
    arguments.y = arguments.y or default_measure(scene.system.coordinates, scene.system.modes.contact_letters)
    with refusing("--y"):
        known_column(arguments.y, measures_of(scene.system.coordinates, parts_of(scene.system)), "measure")
    over = responses.over_sweep(arguments.over, plan.at, arguments.range, arguments.y) if arguments.over is not None else []
    compiling.prepare_for(scene.system, "sweep")
    sweeps = len(plan.directions) * max(1, len(plan.starts))
    with ProgressBar(sweeps * plan.points, "values") as bar, processes.executor_of(arguments, sweeps == 1) as executor:
        runs, interrupted = run_sweeps(plan, executor, bar.update)
    if interrupted:
        say("interrupted; the values that were finished are written")
    files.report(_lines(runs, arguments.parameter))
    failed = failures(runs)
    for status, count in failed.items():
        say(f"{count} of {sum(len(run.sweep) for run in runs)} values have no result: {status.value}")

    from branches.tables import csv_text, plain_columns

    table = sweeps_table(runs)
    about = _about(plan, scene, runs)

    def text() -> str:
        columns = plain_columns(table)
        rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
        return outputs.json_text({"schema": outputs.SCHEMA, **about, "points": rows})

    look = {"parameter": arguments.parameter, "y": arguments.y, "title": scene.title, "curves": over}
    figure = "transitions.sweep.figure:sweep_figure", runs, look
    texts = {"json": text, "csv": lambda: csv_text(table)}
    described = json.dumps({"schema": outputs.SCHEMA, **about}, allow_nan=False)
    code = files.write(texts, table=lambda: table, about=lambda: described, figure=figure)
    return INTERRUPTED if interrupted else max(code, FAILED if failed else DONE)


def _plan(arguments: argparse.Namespace, scene: Scene) -> SweepPlan:
    """The sweeps that were asked for; BadInput if the scene or the parameter cannot have them."""
    from transitions.sweep.runs import AlongParameter, SweepPlan, check_plan
    from transitions.sweep.sweep import SweepSettings

    name = arguments.parameter
    for start in arguments.start or ():
        options.state_of("--start", start, scene.system.coordinates)
    directions = [way for way, wanted in (("up", arguments.up), ("down", arguments.down)) if wanted]
    low, high = arguments.range
    plan = SweepPlan(
        at=AlongParameter(scene.in_parameters, name),
        low=low,
        high=high,
        points=arguments.points,
        directions=tuple(directions) or ("up", "down"),
        starts=tuple(np.array(start) for start in arguments.start or ()),
        settings=SweepSettings(arguments.transient, arguments.record),
    )
    with refusing():
        check_plan(plan)
    return plan


def _about(plan: SweepPlan, scene: Scene, runs: list[SweepRun]) -> dict[str, Any]:
    """What holds for all rows."""
    from transitions.study.plan import loads_as_data

    first = runs[0].sweep
    return {
        "system": scene.system.describe(),
        "forces": loads_as_data(scene.forces),
        "parameter": plan.at.name,
        "range": [plan.low, plan.high],
        "transient": plan.settings.transient,
        "record": plan.settings.record,
        "coordinates": list(first.coordinates),
        "contacts": list(first.contacts),
        "parts": list(first.parts),
    }


def _lines(runs: list[SweepRun], parameter: str) -> list[str]:
    """The table of a report: intervals of values with one period and one number of impacts."""
    several = len({run.start for run in runs}) > 1
    cells, left = [], 0
    for run in runs:
        rows = list(_intervals(run.sweep))
        left += max(0, len(rows) - MOST_ROWS)
        name = f"{run.direction} {run.start}" if several else run.direction
        cells += [(name, *row) for row in rows[:MOST_ROWS]]
    lines = table_lines(("sweep", f"{parameter} from", "to", "values", "period", "impacts", "exponent"), cells, columns="lrrrrrr")
    if left:
        lines.append(f"note     {left} more intervals; the files have all values")
    return lines + _remarks(runs)


def _intervals(sweep: Sweep) -> Iterator[tuple[str, ...]]:
    """Rows of the table: consecutive values with one period and one number of impacts."""
    count = np.where(sweep.periods > 0, np.round(sweep.impact_rates * sweep.periods), -1.0)
    changes = np.flatnonzero((np.diff(sweep.periods) != 0) | (np.diff(count) != 0)) + 1
    for part in np.split(np.arange(len(sweep)), changes):
        p = int(sweep.periods[part[0]])
        exponents = sweep.exponents[part]
        finite = exponents[~np.isnan(exponents)]
        impacts = f"{sweep.impact_rates[part].mean():.4g}"
        top = finite.max(initial=-np.inf)
        largest = f"{0.0 if abs(top) < 1e-12 else top:.3g}" if len(finite) else "-"  # the rest is rounding
        yield f"{sweep.values[part[0]]:.6g}", f"{sweep.values[part[-1]]:.6g}", str(len(part)), str(p or "none"), impacts, largest


def _remarks(runs: list[SweepRun]) -> list[str]:
    """What happened to states that could not be carried over as they were."""
    moved = sum(int(np.sum(run.sweep.moved > 0.0)) for run in runs)
    released = sum(sum(map(bool, run.sweep.released)) for run in runs)
    lines = []
    if moved:
        most = max(float(run.sweep.moved.max()) for run in runs)
        lines.append(f"moved    at {moved} values the new stop was beyond the state, which was moved to it, by {most:.3g} at most")
    if released:
        letters = sorted({letter for run in runs for found in run.sweep.released for letter in found})
        lines.append(f"released at {released} values contacts that stuck were pulled open by the new loads: {listed(letters)}")
    return lines
