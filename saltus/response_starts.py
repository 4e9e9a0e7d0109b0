"""Where `saltus continue --in NAME` starts: from rest, from a simulation, or from a file; and what cannot be followed."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bvp.expressions import normalised
from saltus import compiling, curves, inputs, options
from saltus.errors import BadInput, nearest, refusing
from saltus.inputs import file_and_event
from saltus.terminal import ProgressBar, counted

if TYPE_CHECKING:
    from branches.curves.record import BifurcationCurve
    from branches.forced.branch import ForcedBranch, ForcedEvent
    from branches.forced.onwards import ResponseStart
    from bvp.parameters import ParametricSystem
    from transitions.response.path import ParameterPath

__all__ = [
    "ResponseRequest", "add_start_arguments", "check_equations", "check_range", "event_named", "further", "in_names", "kept_lines",
    "no_such_parameter", "prepare_kernels", "refuse_scene", "request_of", "require_same_scene",
    "same_parametric", "starts_of",
]  # fmt: skip

Report = Callable[[Sequence[str]], object]


@dataclass(frozen=True, eq=False)
class ResponseRequest:
    """A response that is asked for.

    Attributes
    ----------
    path : ParameterPath
        Its system, and the parameters that vary; the first one is reported.
    interval : (float, float)
        Range of the first parameter.
    title : str
        Of the scene.
    given : tuple of ForcedBranch
        The branches of the file that it starts from.
    source, event : str or None
        That file, and the event in it.
    point : (BifurcationCurve, int), optional
        The curve that it starts from, and the index of the point.
    """

    path: ParameterPath
    interval: tuple[float, float]
    title: str = ""
    given: tuple[ForcedBranch, ...] = ()
    source: str | None = None
    event: str | None = None
    point: tuple[BifurcationCurve, int] | None = None


def add_start_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options that say in which parameter responses are followed, and where they start."""
    parser.add_argument(
        "--in", dest="parameter", metavar="NAME[,NAME..]", type=options.names,
        help="follow a family of free orbits with as many --keep, or a response to periodic loads, in this parameter, or in 1/NAME; of "
        "several, with one --keep less for a response, the first one is reported",
    )  # fmt: skip
    parser.add_argument(
        "--keep", metavar="EQUATION", action="append", type=normalised,
        help='with --in: equation that holds, such as energy=0.8, "F = 0.3*w**2"; repeatable'
    )
    parser.add_argument("--range", metavar="LO:HI", type=options.value_range, help="with --in: range of the parameter")
    parser.add_argument(
        "--start", dest="begin", metavar="U1,..,V1,..", type=options.finite_list,
        help="with --from simulate: start with these displacements, then velocities (default: rest)",
    )  # fmt: skip
    parser.add_argument("--phase", metavar="X", type=options.finite, help="with --from simulate: phase w t of the start (default: 0)")
    parser.add_argument(
        "--transient", metavar="N", type=options.whole_above_zero,
        help="with --from simulate: most periods of the loads until the motion repeats (default: 20000)",
    )  # fmt: skip


def request_of(arguments: argparse.Namespace) -> ResponseRequest:
    """The response that a command line asks for. What cannot be followed is refused."""
    from transitions.response.path import ParameterPath

    for option, value in (("--start", arguments.begin), ("--phase", arguments.phase), ("--transient", arguments.transient)):
        if value is not None and arguments.start != "simulate":
            raise BadInput(f"{option} is an option of a simulation; expected --from simulate")
    arguments.scene_uses = ("ground", "forces", "springs")
    if arguments.start is None:
        raise BadInput("--from is required with --in: rest, simulate, or a JSON file FILE[:EVENT]")
    names, keep = _names(arguments)
    if arguments.start not in ("rest", "simulate"):
        return _request_of_file(arguments, names, keep)
    scene = options.scene_of(arguments)
    parametric = scene.in_parameters
    _check_system(parametric, arguments.start)
    if arguments.range is None:
        raise BadInput("--range LO:HI is required: the range of the parameter")
    if not names:
        raise BadInput(f"--in NAME is required: the parameter in which the response is followed; known: {', '.join(parametric.names)}")
    parametric = in_names(parametric, names)
    with refusing("--keep"):
        path = ParameterPath(parametric, names, keep).at()
        path.parametric.system(path.values)
    check_range(path.name, path.values[path.name], arguments.range)
    return ResponseRequest(path, arguments.range, scene.title)


def _request_of_file(arguments: argparse.Namespace, names: tuple[str, ...], keep: tuple[str, ...]) -> ResponseRequest:
    """The response that goes on from a file."""
    from transitions.response.path import ParameterPath

    source, event = file_and_event(arguments.start)
    if event is not None and arguments.direction is not None and not inputs.is_curve_file(source):
        raise BadInput(f"--direction {arguments.direction}: families lead away from the event {event}; expected no --direction")
    if not os.path.exists(source):
        raise BadInput(f"no file {source}; expected rest, simulate, or a JSON file of saltus continue --in NAME, FILE[:EVENT]")
    if inputs.is_curve_file(source):
        return _request_of_curve(arguments, names, keep, source, event)
    given = inputs.responses_in(source)
    problem = given[0].problem
    title = require_same_scene(arguments, source, problem.parametric)
    if not names:
        names, keep = problem.released, problem.keep
    with refusing("--keep"):
        path = ParameterPath(in_names(problem.parametric, names), names, keep)
    if arguments.range is None and path.name != given[0].name:
        raise BadInput(f"--range LO:HI is required: {source} has no range of {path.name}")
    return ResponseRequest(path, arguments.range or given[0].interval, title, tuple(given), source, event)


def require_same_scene(arguments: argparse.Namespace, source: str, parametric: ParametricSystem) -> str:
    """Refuse a scene that is not the one of a file; return its title, empty without a scene.

    The file has values of its own for the parameters. Only those that the user gives have to agree."""
    if arguments.scene is None and not options.parameters_of(arguments):
        return ""
    arguments.scene_uses = ("ground", "forces", "springs")
    scene = options.scene_of(arguments)
    scene = scene if parametric.forces() else scene.about_rest  # loads are part of the energy of free families
    values, same = parametric.values, same_parametric(scene.in_parameters, parametric)
    asked = options.parameters_of(arguments) if same else {}
    differ = [f"there {name} is {values[name]:.10g}, not {value:.10g}" for name, value in asked.items() if values[name] != value]
    if differ or not same:
        why = f": {', '.join(differ)}" if differ else ""
        raise BadInput(f"{source} has another system than the scene {arguments.scene or 'lee2009'}{why}; expected its scene, or none")
    return scene.title


def same_parametric(given: ParametricSystem, wanted: ParametricSystem) -> bool:
    """Whether two systems are the same at the values of the second one's parameters."""
    from branches.tables import plain

    return given.names == wanted.names and plain(given.replaced(wanted.values).describe()) == plain(wanted.describe())


def refuse_scene(arguments: argparse.Namespace, source: str) -> None:
    """Refuse a scene beside a file that has a system."""
    if arguments.scene is not None or options.parameters_of(arguments):
        raise BadInput(f"--from {source} has a system of its own; expected no --scene and no parameters")


def _request_of_curve(
    arguments: argparse.Namespace, names: tuple[str, ...], keep: tuple[str, ...], source: str, place: str | None
) -> ResponseRequest:
    """The response through a point of a curve."""
    from transitions.response.path import ParameterPath

    refuse_scene(arguments, source)
    curve, index, name = curves.place_named(inputs.curves_in(source), source, place)
    problem = curve.plane.problem
    if problem.ends is not None:
        raise BadInput(f"{source}: the curve is one of free orbits; expected one of responses to periodic loads")
    values = problem.parameters(curve.unknowns[index, : curve.plane.size])
    parametric = in_names(problem.parametric.replaced(values), names)
    with refusing("--keep"):
        path = ParameterPath(parametric, names, keep)
    interval = curves.interval_on(curve, source, path.name, arguments.range)
    check_range(path.name, path.values[path.name], interval, "")
    return ResponseRequest(path, interval, "", (), source, name, (curve, index))


def prepare_kernels(request: ResponseRequest, arguments: argparse.Namespace) -> None:
    """Compile the kernels of responses, and those of a simulation where one is the start."""
    groups = ["response", *(["simulated response"] if arguments.start == "simulate" else [])]
    compiling.prepare_for(request.path.parametric.system(), *groups)


def starts_of(request: ResponseRequest, arguments: argparse.Namespace, report: Report) -> list[ResponseStart]:
    """The orbits from which the families of a request are followed; `report` gets the lines about them."""
    direction = arguments.direction or "both"
    if request.point is not None:
        return _from_curve(request, direction, report)
    if request.given:
        return _from_file(request, direction)
    path = request.path
    report(kept_lines(path.names, path.values, path.parametric.values))
    if arguments.start == "rest":
        return _from_rest(request, direction, report)
    return [_from_simulation(request, arguments, direction, report)]


def kept_lines(names: Sequence[str], found: Mapping[str, float], given: Mapping[str, float]) -> list[str]:
    """The lines about parameters that have other values at the start, by the equations that hold, than in the scene."""
    where = f"{names[0]} = {found[names[0]]:.10g}"
    return [
        f"keep   {name} = {found[name]:.10g} at {where}, from --keep; the scene has {given[name]:.10g}"
        for name in names[1:]
        if abs(found[name] - given[name]) > 1e-12 * abs(given[name])
    ]


def _names(arguments: argparse.Namespace) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The parameters of ``--in`` and the equations of ``--keep``; there is one equation less."""
    names, keep = tuple(arguments.parameter or ()), tuple(arguments.keep or ())
    if keep and not names:
        raise BadInput(f"--keep {keep[0]!r} needs --in NAME1,NAME2: the parameters that vary")
    if names:
        check_equations(names, keep, len(names) - 1, "" if names[1:] else f", and one with --in {names[0]},NAME")
    return names, keep


def check_equations(names: Sequence[str], keep: Sequence[str], wanted: int, more: str = "") -> None:
    """Refuse a parameter that is given twice, and another number of equations than wanted; `more` says what else is possible."""
    given = f"--in {','.join(names)}"
    if len(set(names)) < len(names):
        raise BadInput(f"{given}: a parameter is given twice; expected each of them once")
    if len(keep) != wanted:
        raise BadInput(f"{given} needs {counted(wanted, 'equation') if wanted else 'no'} --keep{more}; received {len(keep)}")


def _check_system(parametric: ParametricSystem, start: str) -> None:
    """Refuse loads without a common period, and a system without periodic loads of which nothing determines an orbit."""
    with refusing():
        if parametric.layout.harmonics:
            return
    loads = "the scene's loads are constant" if parametric.forces() else "the scene has no load"
    conservative = parametric.system().is_conservative
    instead = "a NAME or --from mode:K, with --keep energy=H" if conservative else "--from simulate"
    if start == "rest":
        raise BadInput(f"--from rest is the response to periodic loads, and {loads}; expected a load with amplitude, or {instead}")
    if not parametric.system().stops:
        motion = ", or saltus run" if parametric.system().has_potential else ""
        expected = f"expected [[stops]], or a load with amplitude{motion}"
        raise BadInput(f"--from simulate without periodic loads starts at impacts, and the scene has no stops; {expected}")


def in_names(parametric: ParametricSystem, names: Sequence[str]) -> ParametricSystem:
    """The system in which the names of ``--in`` are parameters: 1/NAME takes the place of NAME. Refuses what is no parameter."""
    known = parametric.names
    for name in names:
        of = name.removeprefix("1/").strip()
        if name.startswith("1/") and name not in known and of in known:
            with refusing(f"--in {name}"):
                parametric = parametric.in_reciprocal(of)
        elif name in parametric.derived:
            raise BadInput(f"--in {name}: it is the expression {parametric.derived[name]}; expected one of {', '.join(known)}")
        elif name not in known:
            raise no_such_parameter(name, known)
    return parametric


def no_such_parameter(name: str, known: Sequence[str]) -> BadInput:
    """The error for a name of ``--in`` that is no parameter."""
    if not known:
        return BadInput(f"--in {name}: no such parameter; the scene has no [parameters]")
    return BadInput(f"--in {name}: no such parameter{nearest(name, known) or '; expected one of ' + ', '.join(known)}")


def check_range(name: str, value: float, interval: tuple[float, float], other: str | None = None) -> None:
    """Refuse a range without the value of the start. other: what else can be done, in words; by default --set."""
    other = f", or --set {name.removeprefix('1/')}=VALUE" if other is None else other
    low, high = interval
    if not low <= value <= high:
        raise BadInput(f"--range {low:g}:{high:g} has not the start's value {name} = {value:g}; expected it inside{other}")


def _from_curve(request: ResponseRequest, direction: str, report: Report) -> list[ResponseStart]:
    """The families through a point of a curve."""
    from transitions.response.curve_points import starts_on_curve

    assert request.point is not None
    curve, index = request.point
    with refusing(f"{request.source}:{request.event}"):
        starts = starts_on_curve(curve, index, request.path, direction)
    sides = f": {len(starts)} families meet at this grazing" if len(starts) > 1 else ""
    report([curves.start_line(curve, index, request.source, request.event) + sides])
    return starts


def _from_rest(request: ResponseRequest, direction: str, report: Report) -> list[ResponseStart]:
    """The response without impacts, where it exists."""
    from transitions.response.tracing import rest_starts

    starts, reasons = rest_starts(request.path, request.interval, direction)
    report([f"note   {reason}" for reason in reasons])
    return starts


def _from_simulation(request: ResponseRequest, arguments: argparse.Namespace, direction: str, report: Report) -> ResponseStart:
    """The orbit on which a simulation settles."""
    from branches.forced.onwards import ResponseStart
    from transitions.response.starting import Unbounded
    from transitions.response.tracing import simulated_start
    from transitions.sweep.settle import MOST

    path = request.path
    u = v = None
    if arguments.begin is not None:
        u, v = options.state_of("--start", arguments.begin, path.parametric.system(path.values).coordinates)
    if not path.parametric.layout.harmonics:
        for option in ("phase", "transient"):
            if getattr(arguments, option) is not None:
                raise BadInput(f"--{option} counts in periodic loads, and the scene has none; expected --start alone")
    most = arguments.transient or MOST
    with refusing(kinds=Unbounded), ProgressBar(most, "periods until the motion repeats") as bar:
        settled, found = simulated_start(path, u, v, phase=arguments.phase or 0.0, most=most, on_progress=bar.update)
    over = "half of the period" if found.problem.half else "the period"
    report([f"start  {settled.text}", f"orbit  solved over {over}; the simulated states are {found.distance:.1e} of its size away from it"])
    return ResponseStart(found.problem, found.y, direction)


def _from_file(request: ResponseRequest, direction: str) -> list[ResponseStart]:
    """The branches of a file beyond their ends, in another range or parameter; or the families that begin at an event."""
    from branches.forced.onwards import ResponseStart
    from branches.forced.tracing import switch_response

    branches, path = request.given, request.path
    same = (path.names, path.keep) == (branches[0].problem.released, branches[0].problem.keep)
    if request.event is None:
        if same:
            return [further(branch, request.interval, direction) for branch in branches]
        with refusing("--keep" if path.keep else f"--in {path.name}"):
            return [ResponseStart(*path.through(branch.problem, branch.unknowns[branch.start]), direction) for branch in branches]
    source, event, name = request.source, request.event, branches[0].name
    if not same:
        raise BadInput(f"--in {path.name}: the events of {source} are those of {name}; expected no --in, or --in {name}")
    key, branch, at = event_named(branches, source, event)
    origin = f"{key} of {source}, {name} = {at.values[name]:.12g}"
    begins = branch, at
    return [ResponseStart(problem, step, "along", origin, begins=begins) for problem, step in switch_response(branch, at)]


def further(branch: ForcedBranch, interval: tuple[float, float], direction: str) -> ResponseStart:
    """A branch beyond its ends; if the range has not all of it, from its point in the range."""
    from branches.forced.onwards import ResponseStart
    from branches.forced.tracing import point_inside

    low, high = interval
    slack = 1e-9 * (branch.parameter.max() - branch.parameter.min())  # an end is located to rounding
    inside = low - slack <= branch.parameter.min() and branch.parameter.max() <= high + slack
    orbit = branch.unknowns[branch.start if inside else point_inside(branch, interval)]
    return ResponseStart(branch.problem, orbit, direction, known=branch if inside else None)


def event_named(branches: Sequence[ForcedBranch], source: str | None, event: str) -> tuple[str, ForcedBranch, ForcedEvent]:
    """The one event that a name means: its name, its branch and itself."""
    from branches.forced.record import named_events

    known = named_events(branches)
    key = inputs.event_named(source, event, known)
    return key, *known[key]
