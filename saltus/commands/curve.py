"""`saltus curve START --in P1,P2`: follow a bifurcation or a grazing in the plane of two parameters."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from bvp.description import RESERVED
from bvp.expressions import normalised
from bvp.interrupts import defer_interrupts
from saltus import compiling, curves, inputs, options, outputs
from saltus.errors import DONE, FAILED, FAILURES, INTERRUPTED, BadInput, computed, one_line, refusing, say
from saltus.inputs import file_and_event
from saltus.options import whole_above_zero
from saltus.response_starts import check_equations, require_same_scene
from saltus.terminal import ProgressBar, terminal_width

if TYPE_CHECKING:
    import numpy as np

    from branches.catalogue.rows import SceneRecord
    from branches.curves.record import BifurcationCurve
    from branches.curves.starting import CurveStart
    from branches.forced.branch import ForcedBranch, ForcedEvent
    from continuation.problem import Event

Window = tuple[tuple[float, float], tuple[float, float]]


class _Given(NamedTuple):
    """What START names: where the curve starts; the curve that goes on; the event of a family, and the family."""

    start: CurveStart
    known: BifurcationCurve | None = None
    begins: tuple[ForcedBranch, ForcedEvent] | None = None


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    parser.add_argument(
        "start", metavar="START", nargs="?",
        help="FILE:EVENT, an event of a JSON file of saltus continue, such as response.json:NS1; FILE[:EVENT] of saltus curve: the curve "
        "goes on in a wider range, or with --to another one there; ID:EVENT or ID of a curve with --catalogue",
    )  # fmt: skip
    parser.add_argument(
        "--in", dest="parameters", metavar="P1,P2[,..]", type=options.names,
        help="the two parameters; of a free family one can be energy or quarter_period; further ones need as many --keep",
    )  # fmt: skip
    parser.add_argument("--range", metavar="LO:HI,LO:HI", type=options.value_ranges, help="ranges of the two parameters")
    parser.add_argument(
        "--keep", metavar="EQUATION", action="append", type=normalised, help='equation that holds along the curve, "c = 0.1*w"; repeatable'
    )  # fmt: skip
    parser.add_argument(
        "--to", metavar="TYPE", choices=("SN", "PD", "SB", "NS", "GR"), help="at an event of a curve: the curve of this type"
    )
    parser.add_argument("--points", metavar="N", type=whole_above_zero, help="end at N points in total")
    parser.add_argument("--direction", metavar="WAY", choices=("up", "down", "both"), help="up: P1 rises at first; down; both (default)")
    outputs.add_arguments(parser, "json", "csv", "npz", "mat", "plot")
    parser.add_argument("--save", action="store_true", help="save the curve in a catalogue of responses, and the family that it starts at")
    parser.add_argument("--catalogue", metavar="FILE", help="the catalogue to keep it in, and in which START is looked up if it is no file")
    options.add_scene(parser, uses=("ground", "forces", "springs"))


def run(arguments: argparse.Namespace) -> int:
    """Run the command; return the exit code."""
    files = outputs.outputs_of(arguments)
    given = _given(arguments)
    start, window = given.start, _window(arguments, given)
    place, record = _place(arguments, given)
    problem = start.plane.problem
    compiling.prepare_for(problem.system, "curve" if problem.ends is None else "free curve")
    from branches.curves.starting import NoCurve
    from branches.curves.tracing import can_go_on, extend_curve, first_point, follow_curve, is_within

    known = given.known if given.known is not None and is_within(given.known, window) else None
    if known is not None and arguments.points is not None and arguments.points <= len(known):
        raise BadInput(f"--points {arguments.points}: the curve has {len(known)} points already, expected more")
    begun = None
    if known is None:
        with refusing(arguments.start, NoCurve):
            begun = first_point(start, window)  # what cannot be followed is refused before anything is printed
    shown_names = (arguments.parameters or start.plane.names)[:2]
    files.report([f"start  {start.origin}: curve {start.code} in {' and '.join(shown_names)}"])
    if begun is not None:
        files.report(_moved(start, begun[1].y))
    if known is not None and not any(can_go_on(known, last, window) for last in (False, True)):
        files.report(["note   the curve ends at events, or where the range ends; nothing is left to follow"])
    curve: BifurcationCurve
    code = DONE
    with defer_interrupts() as interrupt:
        try:
            with refusing(arguments.start, NoCurve), interrupt.released(), ProgressBar(arguments.points) as bar:

                def found(event: Event) -> None:
                    values = start.plane.parameters_at(event.point.y[: start.plane.size])
                    shown = "  ".join(f"{values[start.plane.names.index(name)]:.12g}" for name in shown_names)
                    bar.line(f"  {event.code:<6} {shown}  {event.details.get('note') or ''}".rstrip(), files.words)

                given_options: dict[str, Any] = {
                    "points": arguments.points, "direction": arguments.direction or "both", "on_event": found, "on_point": bar.update
                }  # fmt: skip
                if known is None:
                    curve = follow_curve(start, window, begun=begun, **given_options)
                else:
                    curve = extend_curve(known, window, **given_options)
        except (KeyboardInterrupt, RuntimeError) as error:
            curve, code = computed(error)
        if arguments.parameters is not None:
            curve = replace(curve, axes=tuple(arguments.parameters[:2]))
        files.report(curves.report_lines(curve, terminal_width(files.words)))
        if any(end.reason in FAILURES for end in curve.ended):
            code = max(code, FAILED)
        code = max(code, curves.write(files, [curve], os.path.basename(arguments.start)))
        if place is not None:
            code = max(code, _save(curve, place, record, given, files, code))
    if interrupt.came and code != INTERRUPTED:
        raise KeyboardInterrupt(outputs.WRITTEN)
    return code


def _moved(start: CurveStart, y: np.ndarray) -> list[str]:
    """That the first point of a curve, with unknowns y, is not the event, if an equation to keep does not hold there."""
    if not start.plane.problem.keep[1:]:
        return []
    size = start.plane.size
    known, found = start.plane.values(start.y[:size]), start.plane.values(y[:size])
    apart = [name for name, value in known.items() if abs(found[name] - value) > _MOVED * (abs(value) or 1.0)]
    if not apart:
        return []
    text = ", ".join(f"{name} = {found[name]:.8g} where the event has {known[name]:.8g}" for name in apart)
    return [f"note   an equation to keep does not hold at the event: the curve starts at {text}"]


_MOVED = 1e-6
"""Relative change of a parameter between an event and the start of its curve, above which it is said."""


def _save(
    curve: BifurcationCurve, place: Path, record: SceneRecord | None, given: _Given, files: outputs.Outputs, code: int
) -> int:  # fmt: skip
    """Keep the curve in a catalogue; return the exit code."""
    from branches.catalogue.widening import CannotWiden

    if code == INTERRUPTED:
        say("a curve that was not followed to its ends is not kept in a catalogue")
        return code
    try:
        files.report(curves.save(curve, place, record, given.begins))
    except CannotWiden as refused:
        say(one_line(refused))
        return FAILED
    return DONE


def _place(arguments: argparse.Namespace, given: _Given) -> tuple[Path | None, SceneRecord | None]:
    """The catalogue to save in, if that is asked for, and its scene. A place where that is not possible is refused before the work."""
    if not arguments.save:
        return None, None
    if given.begins is not None:
        from saltus.response_catalogues import place_of_responses, record_of_free

        record = record_of_free(given.begins[0].problem)
        return place_of_responses(arguments, record, file_and_event(arguments.start)[0]), record
    if arguments.catalogue is None:
        raise BadInput(f"--catalogue FILE is required: {arguments.start} does not name the families on the sides of the curve")
    if not os.path.exists(arguments.catalogue):
        raise BadInput(f"there is no catalogue {arguments.catalogue}; expected that of the families on the sides of the curve")
    outputs.check_writable(arguments.catalogue, database=True)
    from branches.catalogue import Catalogue

    with Catalogue(arguments.catalogue, "a") as catalogue:
        if not catalogue.scene.parameters:
            raise BadInput(f"{arguments.catalogue} holds families in the energy; expected a catalogue of responses")
    return Path(arguments.catalogue), None


def _given(arguments: argparse.Namespace) -> _Given:
    """Where the curve starts. What cannot be followed is refused."""
    if arguments.start is None:
        raise BadInput("START is required: FILE:EVENT, an event of a JSON file of saltus continue or saltus curve")
    source, event = file_and_event(arguments.start)
    stored = not os.path.exists(source) and arguments.catalogue is not None
    if not os.path.exists(source) and not stored:
        raise BadInput(f"no file {source}; expected FILE:EVENT, an event of a JSON file of saltus continue or saltus curve")
    if arguments.catalogue is not None and not stored and not arguments.save:
        raise BadInput(f"{source} is a file, and nothing is looked up in a catalogue; expected --save with --catalogue")
    names = arguments.parameters
    if names is not None:
        curves.require_plane(names)
    if stored:
        return _of_catalogue(arguments)
    if inputs.is_curve_file(source):
        return _of_curves(arguments, source, event, inputs.curves_in(source))
    return _of_family(arguments, source, event)


def _of_catalogue(arguments: argparse.Namespace) -> _Given:
    """The start at an event of a family of a catalogue, or a curve of it."""
    from branches.catalogue import Catalogue
    from branches.forced.branch import ForcedBranch

    with Catalogue(arguments.catalogue) as catalogue:
        found, event = curves.in_catalogue(catalogue, arguments.start)
    if not isinstance(found, ForcedBranch):
        return _of_curves(arguments, arguments.start.removesuffix(f":{event}"), event, [found])
    _require_plane(arguments, found.id)
    known = {one.id: (found, one) for one in found.events}
    return _of_response(arguments, found.id, event, known)._replace(begins=None)


def _window(arguments: argparse.Namespace, given: _Given) -> Window:
    """The ranges of the two parameters, in the order of the plane."""
    start = given.start
    if arguments.range is None:
        raise BadInput("--range LO:HI,LO:HI is required: the ranges of the two parameters")
    names = (arguments.parameters or start.plane.names)[:2]
    ranges = dict(zip(names, arguments.range, strict=True))
    values = start.plane.parameters_at(start.y[: start.plane.size]).tolist()
    for name, value in zip(start.plane.names, values, strict=True):
        low, high = ranges[name]
        if not low <= value <= high:
            raise BadInput(f"--range {low:g}:{high:g} of {name} does not contain the start, which has {name} = {value:.10g}")
    first, second = start.plane.names
    return ranges[first], ranges[second]


def _require_plane(arguments: argparse.Namespace, source: str) -> None:
    if arguments.to is not None:
        raise BadInput(f"--to {arguments.to}: {source} is a family; expected an event of a curve, or no --to")
    if arguments.parameters is None:
        raise BadInput("--in P1,P2 is required: the two parameters of the plane")


def _of_family(arguments: argparse.Namespace, source: str, event: str | None) -> _Given:
    """The start at an event of a family."""
    from branches.forced.record import named_events

    _require_plane(arguments, source)
    if inputs.is_response_file(source):
        return _of_response(arguments, source, event, named_events(inputs.responses_in(source)))
    return _of_free_family(arguments, source, event)


def _of_free_family(arguments: argparse.Namespace, source: str, event: str | None) -> _Given:
    """The start at an event of a family in the energy."""
    from branches.curves.free_start import released_of
    from branches.curves.starting import NoCurve, curve_start
    from branches.reading import RecordError, read_branch

    with refusing("", RecordError):
        branch = read_branch(source)
    known = {one.id: one for one in branch.events}
    found = known[inputs.event_named(source, event, known)]
    _require_equations(arguments, True)
    parametric = None
    if arguments.scene is not None or options.parameters_of(arguments):
        scene = options.scene_of(arguments).about_rest
        parametric = scene.in_parameters
        if scene.system.describe() != branch.system.describe():
            name = arguments.scene or "lee2009"
            ways = "its scene with its values (--set NAME=VALUE), or none"
            raise BadInput(f"{source} has another system than the scene {name}; expected {ways}")
    origin = f"{found.id} of {os.path.basename(source)}"
    without = "" if parametric else " without --scene"
    with refusing(f"--in {','.join(arguments.parameters)}{without}"), refusing(f"{source}:{event} cannot be continued", NoCurve):
        problem, y = released_of(branch.orbit(found.point), arguments.parameters, parametric)
        return _Given(curve_start(problem, y, found.type, arguments.parameters, arguments.keep or (), origin=origin))


def _of_response(
    arguments: argparse.Namespace, source: str, event: str | None, known: dict[str, tuple[ForcedBranch, ForcedEvent]]
) -> _Given:  # fmt: skip
    from branches.curves.starting import NoCurve, curve_at

    branch, found = known[inputs.event_named(source, event, known)]
    require_same_scene(arguments, source, branch.problem.parametric)
    _require_equations(arguments, branch.problem.ends is not None)
    origin = f"{found.id} of {os.path.basename(source)}"
    with refusing(f"--in {','.join(arguments.parameters)}"), refusing(f"{source}:{event} cannot be continued", NoCurve):
        return _Given(curve_at(branch, found, arguments.parameters, arguments.keep or (), origin), begins=(branch, found))


def _require_equations(arguments: argparse.Namespace, free: bool) -> None:
    """Refuse another number of equations than the parameters need. free: of a free family, whose orbits have an energy besides."""
    names = arguments.parameters
    wanted = len(names) - 2 + (free and not set(names[:2]) & set(RESERVED))
    check_equations(names, arguments.keep or (), wanted, ", such as --keep energy=0.8" if free and wanted else "")


def _of_curves(arguments: argparse.Namespace, source: str, event: str | None, found: Sequence[BifurcationCurve]) -> _Given:
    """The start on a curve: the curve goes on, or another one starts at an event of it."""
    from branches.curves.starting import NoCurve
    from branches.curves.switching import curve_through
    from branches.curves.tracing import curve_again

    require_same_scene(arguments, source, found[0].plane.problem.parametric)
    if arguments.parameters is not None and set(arguments.parameters) != set(found[0].names):
        raise BadInput(f"--in {','.join(arguments.parameters)}: {source} has {', '.join(found[0].names)}; expected these, or no --in")
    arguments.parameters = arguments.parameters or found[0].shown[0]
    name = os.path.basename(source)
    if event is None:
        if arguments.to is not None:
            raise BadInput(f"--to {arguments.to}: at which event? expected {source}:EVENT")
        if len(found) > 1:
            raise BadInput(f"{source} has {len(found)} curves; expected {source}:EVENT, an event of one of them")
        return _Given(curve_again(found[0], f"the curve of {name}"), known=found[0])
    curve, point, place = curves.place_named(found, source, event)
    if arguments.to is None:
        return _Given(curve_again(curve, f"the curve of {name}"), known=curve)
    with refusing(f"{source}:{event} --to {arguments.to}", NoCurve):
        return _Given(curve_through(curve, point, arguments.to)._replace(origin=f"{place} of {name}"))
