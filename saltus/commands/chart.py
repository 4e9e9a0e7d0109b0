"""`saltus chart --in P1,P2 --from FILE`: all curves that start at the events of a branch, and the attractors between them."""

from __future__ import annotations

import argparse
import os
from typing import TYPE_CHECKING

from bvp.expressions import normalised
from saltus import compiling, curves, options, outputs, processes
from saltus.errors import DONE, FAILED, FAILURES, INTERRUPTED, BadInput, refusing, say
from saltus.options import ValueType, whole_above_zero
from saltus.response_starts import check_equations, no_such_parameter, require_same_scene
from saltus.terminal import ProgressBar, counted, table_lines, terminal_width

if TYPE_CHECKING:
    from branches.curves.record import BifurcationCurve
    from branches.forced.branch import ForcedBranch
    from transitions.chart.chart import Chart
    from transitions.chart.curves import Stage
    from transitions.chart.plan import ChartPlan
    from transitions.chart.regions import Regions

MOST_ROWS = 20
"""Rows of the table of regions on the terminal; the files have all."""

_grid = ValueType(
    lambda text: tuple(int(part) for part in text.lower().split("x")),
    lambda found: len(found) == 2 and (found == (0, 0) or all(2 <= count <= 2000 for count in found)),
    "NXxNY, two integers above 1, such as 24x16; 0x0 for no regions",
)
_levels = ValueType(int, lambda value: 0 <= value <= 1000, "an integer of 0 or more, up to 1000")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    parser.add_argument(
        "--in", dest="parameters", metavar="P1,P2[,..]", type=options.names,
        help="the two parameters of the plane; further ones need as many --keep",
    )  # fmt: skip
    parser.add_argument("--from", dest="source", metavar="RESPONSE", help="start at the events of this file of saltus continue --in")
    parser.add_argument(
        "--range", metavar="LO:HI,LO:HI", type=options.value_ranges,
        help="ranges of the two parameters (default: that of the branch; of the other one a factor of 4 around its value)",
    )  # fmt: skip
    parser.add_argument(
        "--keep", metavar="EQUATION", action="append", type=normalised, help='equation that holds in the plane, "c = 0.1*w"; repeatable'
    )  # fmt: skip
    parser.add_argument("--levels", metavar="N", type=_levels, help="levels of P2 on which responses are followed in P1 (default: 3)")
    parser.add_argument("--grid", metavar="NXxNY", type=_grid, help="cells in which attractors are simulated (default: 24x16; 0x0: none)")
    parser.add_argument("--curves", metavar="N", type=whole_above_zero, help="most curves (default: 60)")
    parser.add_argument(
        "--periods", metavar="N", type=options.periods, help="most periods of the loads until a motion has settled (default: 2000)"
    )
    options.add_shared(parser, "workers", "dask")
    outputs.add_arguments(parser, "json", "csv", "npz", "mat", "plot")
    options.add_scene(parser, uses=("ground", "forces", "springs"))


def run(arguments: argparse.Namespace) -> int:
    """Run the command; return the exit code."""
    files = outputs.outputs_of(arguments)
    plan, title, words = _plan(arguments)
    compiling.prepare_for(plan.parametric.system(), "curve", "response", "simulated response", "sweep")

    from transitions.chart.chart import find_chart

    options.report_model(arguments, files, "explain_response", plan.parametric, plan.start)
    width = terminal_width(files.words)
    with processes.executor_of(arguments, plan.grid == (0, 0)) as executor, ProgressBar() as bar:
        files.report([f"chart    {counted(len(plan.events), 'event')} of {arguments.source} in {' and '.join(plan.names[:2])}", *words])
        chart, interrupted = find_chart(
            plan, executor,
            on_curve=lambda number, curve: bar.line(_curve_line(number, curve), files.words),
            on_point=bar.update,
            on_stage=lambda stage: bar.line(_stage_line(stage), files.words),
            on_motion=lambda count: bar.update(count, "motions simulated for the regions"),
        )  # fmt: skip
    if interrupted:
        say("interrupted, with what was computed so far")
    files.report(report_lines(chart, width))
    code = _write(files, chart, title)
    # Of dozens of curves some turn too sharply, and are noted. Those of the branch's own events must be followed.
    own = chart.curves[: chart.stages[0].curves]
    failed = any(end.reason in FAILURES for curve in own for end in curve.ended)
    return INTERRUPTED if interrupted else max(code, FAILED if failed or not chart.curves else DONE)


def _write(files: outputs.Outputs, chart: Chart, title: str) -> int:
    """Write the files; return the exit code."""
    from branches.tables import csv_text
    from transitions.chart.files import chart_record, chart_table

    def about() -> str:
        return outputs.json_text({key: value for key, value in chart_record(chart).items() if key != "curves"})

    if not chart.curves and "plot" in files.places:
        say("no figure: the chart has no curve")
        files = outputs.Outputs({kind: path for kind, path in files.places.items() if kind != "plot"}, files.to_stdout, files.words)
    return files.write(
        {"json": lambda: outputs.json_text(chart_record(chart)), "csv": lambda: csv_text(chart_table(chart))},
        table=lambda: chart_table(chart),
        about=about,
        figure=("transitions.chart.figure:chart_figure", chart, {"title": title}),
    )


# What is printed


def _curve_line(number: int, curve: BifurcationCurve) -> str:
    spans = ", ".join(f"{name} = {low:.6g} to {high:.6g}" for name, low, high in zip(curve.names, *curve.span, strict=True))
    return f"curve {number:<3} {curve.code}  {counted(len(curve), 'point')}, {spans}, from {curve.origin}"


def _stage_line(stage: Stage) -> str:
    """What a stage has found."""
    parts = [
        f"{stage.known} on known curves" if stage.known else "",
        f"{stage.outside} out of the range" if stage.outside else "",
        f"{stage.failed} without a curve" if stage.failed else "",
        f"{stage.left} left, --curves N allows more" if stage.left else "",
    ]
    what = counted(stage.starts, "start")
    return f"stage    {stage.name}: {', '.join([what, *filter(None, parts), counted(stage.curves, 'new curve')])}"


def report_lines(chart: Chart, width: int | None) -> list[str]:
    """The tables of a chart: its curves, the points of codimension two, and the regions; and what was not found."""
    first, second = chart.plan.names[:2]
    lines = []
    if chart.curves:
        head = ("curve", "type", "orbits", first, second, "through", "ends")
        lines += table_lines(head, [_curve_row(k, curve) for k, curve in enumerate(chart.curves, 1)], width=width, columns="rltlltt")
    if chart.points:
        rows = [
            (", ".join(point.types), *(f"{value:.12g}" for value in point.place), ", ".join(map(str, point.curves)),
             ", ".join(point.events), point.note)
            for point in chart.points
        ]  # fmt: skip
        lines += ["", *table_lines(("point", first, second, "curves", "events", "remark"), rows, width=width, columns="lrrttt")]
    if chart.regions is not None:
        lines += ["", *_region_lines(chart.regions, width)]
    lines += [f"note     {note}" for note in chart.notes]
    for number, curve in enumerate(chart.curves, 1):
        lines += [f"note     curve {number} ends {end.text}" for end in dict.fromkeys(curve.ended) if end.reason in FAILURES]
    return lines


def _curve_row(number: int, curve: BifurcationCurve) -> tuple[str, ...]:
    from branches.forced.identity import canonical_letters, closure_name

    problem = curve.plane.problem
    spans = [f"{low:.7g}:{high:.7g}" for low, high in zip(*curve.span, strict=True)]
    through = ", ".join(event.id for event in curve.events if event.type != "EP") or "-"
    ends = ", ".join(_end(curve, last) for last in (False, True)) if not curve.closed else "closed"
    return str(number), curve.code, f"{closure_name(problem)}:{canonical_letters(problem)}", *spans, through, ends


def _end(curve: BifurcationCurve, last: bool) -> str:
    """Why a curve ends at one of its ends, in a word."""
    at = len(curve) - 1 if last else 0
    for event in curve.events:
        if event.point == at:
            return "range" if event.type == "EP" else event.id
    return curve.ended[int(last)].reason.lower().replace("_", " ")


def _region_lines(regions: Regions, width: int | None) -> list[str]:
    """The sets of attractors with their parts of the plane, and what was simulated."""
    cells = list(regions.counts.items())
    rows = [
        (f"{100.0 * count / len(regions):.1f} %", str(count), " and ".join(kind.text for kind in kinds))
        for kinds, count in cells[:MOST_ROWS]
    ]
    lines = table_lines(("share", "cells", "attractors in the region"), rows, width=width, columns="rrt")
    if len(cells) > MOST_ROWS:
        rest = sum(count for _, count in cells[MOST_ROWS:])
        lines.append(f"note     {counted(len(cells) - MOST_ROWS, 'more set')} of attractors in {counted(rest, 'cell')}; --json has all")
    size = f"{len(regions.x)} x {len(regions.y)}"
    lines.append(
        f"regions  sampled in {size} cells with {counted(regions.simulated, 'motion')}, of which {regions.unsettled} did not settle"
    )
    lines += [f"without  {counted(count, 'cell')}: {reason}" for reason, count in sorted(regions.reasons.items())]
    return lines


# What is asked for


def _plan(arguments: argparse.Namespace) -> tuple[ChartPlan, str, list[str]]:
    """The chart that is asked for, its title, and lines about its ranges. What cannot be computed is refused."""
    names, keep = _names(arguments)
    branches, title = _branches(arguments)
    parametric = branches[0].problem.parametric
    for name in names:
        if name not in parametric.names:
            raise no_such_parameter(name, parametric.names)
    from transitions.chart.plan import GRID, LEVELS, MOST_CURVES, PERIODS, ChartPlan, default_window

    window, words = default_window(branches, names)
    if arguments.range is not None:
        window, words = arguments.range, []
    for name, (low, high) in zip(names, window, strict=False):
        why = parametric.violation({**parametric.values, name: 0.5 * (low + high)})
        if why is not None:
            raise BadInput(f"--range {low:g}:{high:g} of {name}: {why}")
    with refusing(f"--in {','.join(names)}"):
        plan = ChartPlan(
            branches, names, window, keep, LEVELS if arguments.levels is None else arguments.levels, arguments.grid or GRID,
            arguments.curves or MOST_CURVES, arguments.periods or PERIODS,
        )  # fmt: skip
    _check_start(arguments, plan)
    return plan, title or os.path.basename(arguments.source), [f"range    {word}" for word in words]


def _names(arguments: argparse.Namespace) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The parameters and the equations."""
    names, keep = arguments.parameters, tuple(arguments.keep or ())
    if names is None:
        raise BadInput("--in P1,P2 is required: the two parameters of the plane")
    curves.require_plane(names)
    check_equations(names, keep, len(names) - 2)
    return names, keep


def _branches(arguments: argparse.Namespace) -> tuple[list[ForcedBranch], str]:
    """The branches of the file, and the scene's title."""
    from transitions.response.files import read_responses

    source = arguments.source
    if source is None:
        raise BadInput("--from RESPONSE is required: a JSON file of saltus continue --in NAME, whose events start the curves")
    if not os.path.exists(source):
        raise BadInput(f"no file {source}; expected --from RESPONSE, a JSON file of saltus continue --in NAME")
    branches = read_responses(source)
    problem = branches[0].problem
    title = require_same_scene(arguments, source, problem.parametric)
    if not problem.has_clock or problem.ends is not None:
        raise BadInput(f"--from {source} has no responses to periodic loads; a chart needs them: expected saltus curve {source}:EVENT")
    return branches, title


def _check_start(arguments: argparse.Namespace, plan: ChartPlan) -> None:
    """Refuse branches without events for curves, and ranges without them."""
    from branches.curves.starting import CURVES

    source, expected = arguments.source, ", ".join(CURVES)
    events = plan.events
    if not events:
        known = sorted({event.type for branch in plan.branches for event in branch.events})
        raise BadInput(f"--from {source} has no event that can be continued: it has {', '.join(known) or 'none'}; expected {expected}")
    starts = [branch.problem.parameters(branch.unknowns[branch.start]) for branch in plan.branches]
    for name, (low, high) in zip(plan.names, plan.window, strict=False):
        fixed = all(branch.name != name for branch in plan.branches)
        if fixed and not any(low <= values[name] <= high for values in starts):
            raise BadInput(f"--range {low:g}:{high:g} of {name} does not contain the start, which has {name} = {starts[0][name]:.10g}")
    inside = [plan.contains(branch.problem.parameters(branch.unknowns[event.point])) for _, branch, event in events]
    if not any(inside):
        first = plan.names[0]
        places = [float(branch.problem.parameters(branch.unknowns[event.point])[first]) for _, branch, event in events]
        ranges = ",".join(f"{one:g}:{other:g}" for one, other in plan.window)
        where = f"{first} = {min(places):.6g} to {max(places):.6g}"
        raise BadInput(f"--range {ranges} does not contain the start: the events of {source} have {where}")
