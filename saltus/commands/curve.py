"""`saltus curve START --in P1,P2`: follow a bifurcation or a grazing in the plane of two parameters."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from bvp.interrupts import defer_interrupts
from saltus import compiling, options, outputs
from saltus.errors import DONE, FAILED, INTERRUPTED, BadInput, nearest, one_line, say
from saltus.options import whole_above_zero
from saltus.response_starts import file_and_event
from saltus.terminal import ProgressBar, table_lines, terminal_width

if TYPE_CHECKING:
    from branches.curves.record import BifurcationCurve
    from branches.curves.tracing import CurveStart
    from continuation.problem import Event

FAILURES = ("MINIMUM_STEP", "NO_START")


def _windows(text: str) -> tuple[tuple[float, float], ...]:
    ranges = tuple(options.value_range(part) for part in text.split(","))
    return ranges


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    parser.add_argument(
        "start", metavar="START", nargs="?",
        help="FILE:EVENT, an event of a JSON file of saltus continue, such as response.json:NS1; FILE[:EVENT] of saltus curve: the curve "
        "again, in another range, or with --to another one there",
    )  # fmt: skip
    parser.add_argument(
        "--in", dest="parameters", metavar="P1,P2[,..]", type=options.names,
        help="the two parameters; of a free family one can be energy or quarter_period; further ones need as many --keep",
    )  # fmt: skip
    parser.add_argument("--range", metavar="LO:HI,LO:HI", type=_windows, help="ranges of the two parameters")
    parser.add_argument("--keep", metavar="EQUATION", action="append", help='equation that holds along the curve, "c = 0.1*w"; repeatable')
    parser.add_argument(
        "--to", metavar="TYPE", choices=("SN", "PD", "SB", "NS", "GR"), help="at an event of a curve: the curve of this type"
    )
    parser.add_argument("--points", metavar="N", type=whole_above_zero, help="end at N points in total")
    parser.add_argument("--direction", metavar="WAY", choices=("up", "down", "both"), help="up: P1 rises at first; down; both (default)")
    outputs.add_arguments(parser, "json", "csv", "npz", "mat", "plot")
    options.add_scene(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; return the exit code."""
    files = outputs.outputs_of(arguments)
    start, window, given = _start(arguments)
    compiling.prepare_for(start.plane.problem.system, "curve")
    from branches.curves.files import curves_record, curves_table
    from branches.curves.tracing import NoCurve, follow_curve

    files.report([f"start  {start.origin}: curve {start.code} in {' and '.join(start.plane.names)}"])
    curve: BifurcationCurve | None = None
    code = DONE
    with defer_interrupts() as interrupt:
        try:
            with interrupt.released(), ProgressBar(arguments.points) as bar:

                def found(event: Event) -> None:
                    a, b = start.plane.linearised(event.point.y[: start.plane.size]).parameters
                    bar.line(f"  {event.code:<6} {a:.12g}  {b:.12g}  {event.details.get('note') or ''}".rstrip(), files.words)

                curve = follow_curve(
                    start, window, points=arguments.points, direction=arguments.direction or "both", on_event=found, on_point=bar.update
                )
        except NoCurve as error:
            raise BadInput(f"{arguments.start}: {one_line(error)}") from error
        except (KeyboardInterrupt, RuntimeError) as error:
            curve = getattr(error, "branch", None)
            if curve is None:
                raise
            interrupted = isinstance(error, KeyboardInterrupt)
            say("interrupted, with the points that were computed so far" if interrupted else one_line(error))
            code = INTERRUPTED if interrupted else FAILED
        files.report(report_lines(curve, terminal_width(files.words)))
        if any(end.reason in FAILURES for end in curve.ended):
            code = max(code, FAILED)
        curves = [curve]
        code = max(
            code,
            files.write(
                {"json": lambda: outputs.json_text(curves_record(curves))},
                table=lambda: curves_table(curves),
                about=lambda: outputs.json_text({key: value for key, value in curves_record(curves).items() if key != "curves"}),
                figure=("branches.curves.figure:curve_figure", curves, {"title": given}),
            ),
        )
    if interrupt.came and code != INTERRUPTED:
        raise KeyboardInterrupt(outputs.WRITTEN)
    return code


def report_lines(curve: BifurcationCurve, width: int | None) -> list[str]:
    """The table of a curve's points of codimension two, and its ends."""
    first, second = curve.names
    low, high = curve.span
    lines = [f"curve  {curve.code}: {len(curve)} points, {first} = {low[0]:.8g} to {high[0]:.8g}, {second} = {low[1]:.8g} to {high[1]:.8g}"]
    rows = []
    for event in curve.events:
        a, b = curve.parameters[event.point]
        rows.append((event.id, f"{a:.14g}", f"{b:.14g}", event.status, event.note or ""))
    if rows:
        lines += table_lines(("event", first, second, "status", "remark"), rows, width=width, columns="lrrlt")
    lines += dict.fromkeys(f"end    {end.text}" for end in curve.ended)
    return lines


def _start(arguments: argparse.Namespace) -> tuple[CurveStart, tuple[tuple[float, float], tuple[float, float]], str]:
    """Where the curve starts, the ranges of its parameters, and a title. What cannot be followed is refused."""
    if arguments.start is None:
        raise BadInput("START is required: FILE:EVENT, an event of a JSON file of saltus continue or saltus curve")
    source, event = file_and_event(arguments.start)
    if not os.path.exists(source):
        raise BadInput(f"no file {source}; expected FILE:EVENT, an event of a JSON file of saltus continue or saltus curve")
    names = arguments.parameters
    if names is not None:
        keep = arguments.keep or []
        if len(names) < 2:
            raise BadInput(f"--in {','.join(names)}: a curve lies in the plane of two parameters; received {len(names)}, expected P1,P2")
        if len(set(names)) < len(names):
            raise BadInput(f"--in {','.join(names)}: a parameter is given twice; expected each of them once")
        if len(keep) != len(names) - 2:
            wanted = (
                f"{len(names)} parameters need {len(names) - 2} equations --keep" if len(names) > 2 else "two parameters need no --keep"
            )
            raise BadInput(f"--in {','.join(names)}: {wanted}; received {len(keep)}")
    from branches.curves.files import is_curve_record
    from branches.reading import RecordError, load_json

    try:
        record = load_json(source, "events")
    except RecordError as error:
        raise BadInput(one_line(error)) from error
    start = _of_curve(arguments, source, event, record) if is_curve_record(record) else _of_family(arguments, source, event, record)
    return start, _window(arguments, start), os.path.basename(arguments.start)


def _window(arguments: argparse.Namespace, start: CurveStart) -> tuple[tuple[float, float], tuple[float, float]]:
    """The ranges of the two parameters, in the order of the plane."""
    if arguments.range is None:
        raise BadInput("--range LO:HI,LO:HI is required: the ranges of the two parameters")
    if len(arguments.range) != 2:
        raise BadInput(f"--range has {len(arguments.range)} range{'s' * (len(arguments.range) != 1)}; expected two, LO:HI,LO:HI")
    names = (arguments.parameters or start.plane.names)[:2]
    ranges = dict(zip(names, arguments.range, strict=True))
    values = start.plane.linearised(start.y[: start.plane.size]).parameters.tolist()
    for name, value in zip(start.plane.names, values, strict=True):
        low, high = ranges[name]
        if not low <= value <= high:
            raise BadInput(f"--range {low:g}:{high:g} of {name} does not contain the start, which has {name} = {value:.10g}")
    first, second = start.plane.names
    return ranges[first], ranges[second]


def _of_family(arguments: argparse.Namespace, source: str, event: str | None, record: Any) -> CurveStart:
    """The start at an event of a family."""
    from transitions.response.files import is_response

    if arguments.to is not None:
        raise BadInput(f"--to {arguments.to}: {source} is a family; expected an event of a curve, or no --to")
    if arguments.parameters is None:
        raise BadInput("--in P1,P2 is required: the two parameters of the plane")
    if is_response(record):
        return _of_response(arguments, source, event)
    raise BadInput(f"{source} holds no response; expected a JSON file of saltus continue --in NAME, or of saltus curve")


def _of_response(arguments: argparse.Namespace, source: str, event: str | None) -> CurveStart:
    from branches.curves.tracing import NoCurve, curve_start
    from transitions.response.files import named_events, read_responses

    known = named_events(read_responses(source))
    branch, found = known[_known_event(source, event, known)]
    try:
        return curve_start(
            branch.problem, branch.unknowns[found.point], found.type, arguments.parameters, arguments.keep or (), angle=found.angle,
            origin=f"{found.id} of {os.path.basename(source)}",
        )  # fmt: skip
    except NoCurve as error:
        raise BadInput(f"{source}:{event} cannot be continued: {one_line(error)}") from error
    except ValueError as error:
        raise BadInput(f"--in {','.join(arguments.parameters)}: {one_line(error)}{_near(arguments.parameters, branch)}") from error


def _near(names: Sequence[str], branch: Any) -> str:
    known = branch.problem.parametric.names
    return next((nearest(name, known) or "" for name in names if name not in known), "")


def _known_event(source: str, event: str | None, known: Any) -> str:
    """The name of an event of a file; refused where there is none of this name."""
    if event is None:
        raise BadInput(f"{source}: which event? expected {source}:EVENT with one of {', '.join(known) or 'none'}")
    if event not in known:
        raise BadInput(f"{source} has no event {event}{nearest(event, known)}; it has {', '.join(known) or 'none'}")
    return event


def _of_curve(arguments: argparse.Namespace, source: str, event: str | None, record: Any) -> CurveStart:
    """The start on a curve: the curve again, or another one at an event of it."""
    from branches.curves.files import curves_of
    from branches.curves.tracing import CurveStart, NoCurve, curve_through
    from branches.reading import RecordError

    try:
        curves = curves_of(record, source)
    except RecordError as error:
        raise BadInput(one_line(error)) from error
    if arguments.parameters is not None and set(arguments.parameters) != set(curves[0].names):
        raise BadInput(f"--in {','.join(arguments.parameters)}: {source} has {', '.join(curves[0].names)}; expected these, or no --in")
    known = {
        (f"{number}." if number > 1 else "") + one.id: (curve, one)
        for number, curve in enumerate(curves, 1)
        for one in curve.events
    }  # fmt: skip
    name = os.path.basename(source)
    if event is None:
        if arguments.to is not None:
            raise BadInput(f"--to {arguments.to}: at which event? expected {source}:EVENT with one of {', '.join(known) or 'none'}")
        if len(curves) > 1:
            raise BadInput(f"{source} has {len(curves)} curves; expected {source}:EVENT, an event of one of them")
        curve = curves[0]
        return CurveStart(curve.plane, curve.code, curve.grazing, curve.unknowns[curve.start], f"the curve of {name}")
    curve, found = known[_known_event(source, event, known)]
    if arguments.to is None:
        return CurveStart(curve.plane, curve.code, curve.grazing, curve.unknowns[curve.start], f"the curve of {name}")
    try:
        return curve_through(curve, found.point, arguments.to)._replace(origin=f"{event} of {name}")
    except NoCurve as error:
        raise BadInput(f"{source}:{event} --to {arguments.to}: {one_line(error)}") from error
