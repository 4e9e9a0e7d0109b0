"""`saltus continue --in NAME`: families of orbits under periodic loads, from their start to their files; and what a file of them says."""

from __future__ import annotations

import argparse
import os
import re
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from saltus import compiling, options, outputs
from saltus.errors import DONE, FAILED, BadInput, nearest, one_line
from saltus.terminal import ProgressBar, stability_word, table_lines, terminal_width

if TYPE_CHECKING:
    from branches.forced.branch import ForcedBranch, ForcedEvent
    from branches.tables import Table
    from bvp.forced import ForcedProblem
    from bvp.parameters import ParametricSystem
    from continuation.problem import Step
    from saltus.scene import Scene
    from transitions.sweep.figure import Curve
    from transitions.sweep.runs import AlongParameter

__all__ = ["add_arguments", "draw", "follow", "is_response_file", "is_wanted", "over_sweep", "require_no_loads", "show"]

_OF_IMPACT = re.compile(r"(speed|phase):[1-9]\d*")
MOST_BRANCHES = 50
FAILURES = ("MINIMUM_STEP", "NO_START")
_OTHERS = ("name", "energy", "stop_at", "save", "catalogue")
"""Options of families in the energy."""
_OWN = ("range", "begin", "phase", "uz", "y")
"""Options of responses."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of responses to the parser of `saltus continue`."""
    parser.add_argument("--in", dest="parameter", metavar="NAME", help="follow the response to periodic loads in this parameter")
    parser.add_argument("--range", metavar="LO:HI", type=options.value_range, help="with --in: range of the parameter")
    parser.add_argument(
        "--start", dest="begin", metavar="U1,..,V1,..", type=options.finite_list,
        help="with --from simulate: start with these displacements, then velocities (default: rest)",
    )  # fmt: skip
    parser.add_argument("--phase", metavar="X", type=options.finite, help="with --from simulate: phase w t of the start (default: 0)")
    parser.add_argument("--uz", metavar="VALUES", type=options.finite_list, help="with --in: mark these values of the parameter, X1,X2,..")
    parser.add_argument("--y", metavar="COLUMN", help="with --in: what the figure shows: max:u1, rms:u1, speed, phase:1, share:.., ...")


def is_response_file(path: str) -> bool:
    """Whether a path leads to a JSON file of responses."""
    from transitions.response.files import is_response

    if not os.path.isfile(path):
        return False
    from branches.reading import RecordError, load_json

    try:
        return is_response(load_json(path, "responses"))
    except RecordError:
        return False


def _file_and_event(text: str) -> tuple[str, str | None]:
    """The path and the event of FILE[:EVENT]."""
    if os.path.exists(text) or ":" not in text:
        return text, None
    path, _, event = text.rpartition(":")
    return path, event


def is_wanted(arguments: argparse.Namespace) -> bool:
    """Whether the command line asks for a response. What then does not fit is refused."""
    start = arguments.start or ""
    wanted = arguments.parameter is not None or start in ("rest", "simulate") or is_response_file(_file_and_event(start)[0])
    given = [f"--{name.replace('_', '-').replace('begin', 'start')}" for name in _OWN if getattr(arguments, name) is not None]
    if not wanted and given:
        raise BadInput(f"{given[0]} is an option of a response; expected --in NAME, the parameter in which it is followed")
    if wanted:
        for name in _OTHERS:
            if getattr(arguments, name):
                what = arguments.name if name == "name" else f"--{name.replace('_', '-')}"
                raise BadInput(f"{what} belongs to families in the energy; expected --in NAME with --from and --range alone")
    return wanted


def require_no_loads(scene: Scene) -> None:
    """Refuse a scene whose loads or losses a family in the energy cannot have; say how its response is followed."""
    how = "expected --in NAME, which follows the response to the loads in a parameter, or saltus run"
    if scene.loads:
        from saltus.scene import LOADS

        raise BadInput(f"saltus continue computes motion without loads, and the scene has {LOADS[scene.loads[0]]}; {how}")
    why = scene.system.why_not_conservative()
    if why is not None:
        raise BadInput(f"families in the energy need a conservative system: {why}; expected loads and --in NAME, or saltus run")


def follow(arguments: argparse.Namespace) -> int:
    """Follow a response and write its files; return the exit code."""
    files = outputs.outputs_of(arguments)
    source, event = _file_and_event(arguments.start) if arguments.start not in (None, "rest", "simulate") else (None, None)
    arguments.scene_uses = ("ground", "forces")
    branches: list[ForcedBranch] = []
    title = ""
    if source is not None:
        from branches.tables import plain
        from transitions.response.files import read_responses

        if not os.path.exists(source):
            raise BadInput(f"no file {source}; expected rest, simulate, or a JSON file of saltus continue --in NAME, FILE[:EVENT]")
        given = read_responses(source)
        parametric = given[0].problem.parametric
        if arguments.scene is not None or options.parameters_of(arguments):
            scene = options.scene_of(arguments)
            title = scene.title
            if plain(_parametric(scene).describe()) != plain(parametric.describe()):
                raise BadInput(f"{source} has another system than the scene {arguments.scene or 'lee2009'}; expected its scene, or none")
    else:
        if arguments.start is None:
            raise BadInput("--from is required with --in: rest, simulate, or a JSON file FILE[:EVENT]")
        if arguments.range is None:
            raise BadInput("--range LO:HI is required: the range of the parameter")
        scene = options.scene_of(arguments)
        title, parametric = scene.title, _parametric(scene)
    for option, value in (("--start", arguments.begin), ("--phase", arguments.phase)):
        if value is not None and arguments.start != "simulate":
            raise BadInput(f"{option} is where a simulation starts; expected --from simulate")
    name = arguments.parameter if source is None or arguments.parameter else given[0].name
    interval = arguments.range or given[0].interval
    _check_parameter(parametric, name, interval, source is None)
    if arguments.y is not None and not _OF_IMPACT.fullmatch(arguments.y):
        from bvp.forced import ForcedProblem

        _check_column(arguments.y, ForcedProblem(parametric, (), (name,)))
    compiling.prepare("response")
    if source is not None:
        starts = _from_file(given, source, event, name, interval)
    elif arguments.start == "rest":
        starts = _from_rest(parametric, name, interval, files.report)
    else:
        starts = [_from_simulation(arguments, parametric, name, files.report)]

    from branches.forced.tracing import follow_response, switch_response

    code = DONE
    waiting = deque(starts)
    with ProgressBar(arguments.points) as bar:
        while waiting:
            problem, start, both = waiting.popleft()
            if arguments.y is not None and not branches:
                _check_column(arguments.y, problem)
            if isinstance(start, np.ndarray) and any(_covers(branch, problem, start) for branch in branches):
                continue
            options_of = {"values": arguments.uz or (), "points": arguments.points, "on_point": bar.update}
            branch = follow_response(problem, start, interval, both=both, **options_of)
            branches.append(branch)
            bar.line("\n".join(report_lines(branch, len(branches), terminal_width(files.words))), files.words)
            code = max(code, FAILED if any(end.reason in FAILURES for end in branch.ended) else DONE)
            # Where impacts exchange their order the family goes on as the next branch.
            exchanges = [event for event in branch.events if event.type == "LB"]
            if len(branches) < MOST_BRANCHES:
                waiting.extend((*onward, False) for event in exchanges for onward in switch_response(branch, event))
    return max(code, _write(files, branches, arguments.y, title))


def show(arguments: argparse.Namespace) -> int:
    """Print what a file of responses has, and draw it; return the exit code."""
    return draw(arguments, arguments.name, None)


def draw(arguments: argparse.Namespace, path: str, y: str | None) -> int:
    """Print the branches of a file of responses, and write the files that are asked for; return the exit code."""
    from transitions.response.files import read_responses

    files = outputs.outputs_of(arguments)
    branches = read_responses(path)
    if y is not None:
        _check_column(y, *(branch.problem for branch in branches))
    for number, branch in enumerate(branches, 1):
        files.report(report_lines(branch, number, terminal_width(files.words)))
    return _write(files, branches, y, "")


def over_sweep(path: str, at: AlongParameter, interval: tuple[float, float], y: str) -> list[Curve]:
    """The branches of a file of responses as curves over a sweep of the same system; BadInput for those of another one."""
    from branches.tables import plain
    from transitions.response.figure import curves_over
    from transitions.response.files import read_responses

    branches = read_responses(path)
    name, wanted = at.name, at.parametric
    if name != branches[0].name:
        raise BadInput(f"--over {path} is over {branches[0].name}, expected {name}, the parameter of --in")
    given = branches[0].problem.parametric
    described = [plain(system.replaced(wanted.values).describe()) if system.names == wanted.names else None for system in (given, wanted)]
    same = described[0] == described[1]
    for branch in branches if same else ():
        same = same and all(branch.problem.values[key] == wanted.values[key] for key in given.names if key != name)
    if not same:
        raise BadInput(f"--over {path} has another system or other parameters than the sweep; expected those of its scene")
    try:
        curves = curves_over(branches, y)
    except ValueError as error:
        raise BadInput(f"--over: {one_line(error)}") from error
    low, high = interval
    inside = [(curve.x >= low) & (curve.x <= high) for curve in curves]
    return [replace(curve, y=np.where(part, curve.y, np.nan)) for curve, part in zip(curves, inside, strict=True) if part.any()]


def _write(files: outputs.Outputs, branches: Sequence[ForcedBranch], y: str | None, title: str) -> int:
    """Write the files of some branches; return the exit code."""
    from branches.tables import csv_text
    from transitions.response.files import to_record
    from transitions.response.measures import response_table

    @cache
    def table() -> Table:
        return response_table(branches)

    return files.write(
        {"json": lambda: outputs.json_text(to_record(branches)), "csv": lambda: csv_text(table())},
        table=table,
        about=lambda: outputs.json_text({key: value for key, value in to_record(branches).items() if key != "branches"}),
        figure=("transitions.response.figure:response_figure", branches, {"y": y, "title": title}),
    )


def _parametric(scene: Scene) -> ParametricSystem:
    from bvp.parameters import ParametricSystem

    return scene.parametric or ParametricSystem.of(scene.system, scene.forces)


def _check_parameter(parametric: ParametricSystem, name: str, interval: tuple[float, float], from_scene: bool) -> None:
    """Refuse what the response cannot have: an unknown parameter, loads without a period, a range without the start's value."""
    if not parametric.forces():
        raise BadInput("--in follows the response to periodic loads, and the scene has none; free orbits are followed without --in")
    try:
        if not parametric.layout.harmonics:
            raise BadInput("--in follows the response to periodic loads, and the scene's are constant; expected one with amplitude")
    except BadInput:
        raise
    except ValueError as error:
        raise BadInput(one_line(error)) from error
    known = parametric.names
    if name in parametric.derived:
        raise BadInput(f"--in {name}: it is the expression {parametric.derived[name]}; expected one of {', '.join(known)}")
    if name not in known:
        raise BadInput(f"--in {name}: no such parameter{nearest(name, known) or '; expected one of ' + ', '.join(known)}")
    low, high = interval
    value = parametric.values[name]
    if from_scene and not low <= value <= high:
        raise BadInput(f"--range {low:g}:{high:g} has not the start's value {name} = {value:g}; expected it inside, or --set {name}=VALUE")


def _check_column(name: str, *problems: ForcedProblem) -> None:
    from transitions.response.figure import require_column

    try:
        require_column(name, problems)
    except ValueError as error:
        raise BadInput(f"--y: {error}") from error


Start = tuple["ForcedProblem", "np.ndarray | Step", bool]
"""A problem, an orbit near which or from which its family is followed, and whether both ways."""


def _from_rest(
    parametric: ParametricSystem, name: str, interval: tuple[float, float], report: Callable[[Sequence[str]], object]
) -> list[Start]:
    """The response without impacts at the scene's value and at both ends of the range, where it exists."""
    from transitions.response.starting import Unbounded, linear_response

    starts: list[Start] = []
    reasons = []
    for value in (parametric.values[name], *interval):
        if parametric.violation({name: value}) is not None:
            continue
        try:
            problem, y, why = linear_response(parametric, name, {name: value})
        except Unbounded as error:
            why = one_line(error)
        else:
            if why is None:
                starts.append((problem, y, True))
                continue
            why = f"the response without impacts at {name} = {value:.10g} is no orbit: {why}"
        if why not in reasons:
            reasons.append(why)
            report([f"note   {why}"])
    if not starts:
        raise RuntimeError(f"there is no response without impacts at {name} = {parametric.values[name]:g} and at the ends of the range")
    return starts


def _covers(branch: ForcedBranch, problem: ForcedProblem, start: np.ndarray) -> bool:
    """Whether a branch of the response without impacts has the value of a start: there is one such response at a value."""
    value = problem.parameters(start)[branch.name]
    same = not branch.problem.sequence and not problem.sequence
    low, high = branch.parameter.min(), branch.parameter.max()
    slack = 1e-9 * (high - low)  # an end is located to rounding
    return same and bool(low - slack <= value <= high + slack)


def _from_simulation(
    arguments: argparse.Namespace, parametric: ParametricSystem, name: str, report: Callable[[Sequence[str]], object]
) -> Start:
    """The orbit on which a simulation settles."""
    import math

    from bvp.forced import ForcedProblem
    from transitions.response.starting import settled_orbit
    from transitions.sweep.settle import settle

    ForcedProblem(parametric, (), (name,))  # what cannot be followed is refused before the work
    system, n = parametric.system(), parametric.system().degrees_of_freedom
    u = v = None
    if arguments.begin is not None:
        options.require_state("--start", arguments.begin, system.coordinates)
        u, v = arguments.begin[:n], arguments.begin[n:]
    phase = (arguments.phase or 0.0) % (2.0 * math.pi)
    settled = settle(system, parametric.forces(), u, v, phase=phase)
    found = settled_orbit(parametric, name, settled)
    over = "half of the period" if found.problem.half else "the period"
    report([f"start  {settled.text}", f"orbit  solved over {over}; the simulated states are {found.distance:.1e} of its size away from it"])
    return found.problem, found.y, True


def _from_file(
    branches: Sequence[ForcedBranch], source: str, event: str | None, name: str, interval: tuple[float, float]
) -> list[Start]:
    """The branch of a file in another range or parameter, or the families that begin at an event."""
    from branches.forced.tracing import point_inside, switch_response
    from bvp.forced import ForcedProblem
    from transitions.response.files import named_events

    if event is None:
        starts: list[Start] = []
        for branch in branches:
            if name == branch.name:
                starts.append((branch.problem, branch.unknowns[point_inside(branch, interval)], True))
                continue
            y = branch.unknowns[branch.start].copy()
            old = branch.problem
            problem = ForcedProblem(
                old.parametric, old.sequence, (name,), load_periods=old.load_periods, half=old.half, values=old.parameters(y)
            )
            problem.nodes(y)[:, 2 * old.degrees_of_freedom + 1] = problem.values[name]
            starts.append((problem, y, True))
        return starts
    if name != branches[0].name:
        raise BadInput(f"--in {name}: the events of {source} are those of {branches[0].name}; expected no --in, or --in {branches[0].name}")
    known = named_events(branches)
    matches = [key for key in known if key == event or key.rpartition(".")[2].rstrip("0123456789") == event]
    if len(matches) != 1:
        found = f"matches {', '.join(matches)}" if matches else f"no such event{nearest(event, known)}; known: {', '.join(known) or 'none'}"
        raise BadInput(f"{source}:{event}: {found}; expected one of them" if matches else f"{source}:{event}: {found}")
    branch, at = known[matches[0]]
    return [(problem, step, False) for problem, step in switch_response(branch, at)]


def report_lines(branch: ForcedBranch, number: int, width: int | None = None) -> list[str]:
    """What is printed of a branch: its sequence and stability, its events, and its ends."""
    from branches.forced.branch import sequence_text

    name, problem = branch.name, branch.problem
    span = f"{name} = {branch.parameter.min():.10g} to {branch.parameter.max():.10g}"
    half = ", solved over half the period" if problem.half else ""
    impacts = sequence_text(branch.sequence) + half
    lines = [f"branch {number}: {impacts}; period {problem.load_periods} of the loads; {len(branch)} points, {span}"]
    rows = [_event_row(branch, event) for event in branch.events]
    if rows:
        head = ("event", name, "|multiplier|", "stable after", "remark")
        lines += table_lines(head, rows, width=width, columns="lrrlt")
    ends = [f"end    {end.text}" for end in branch.ended]
    return lines + list(dict.fromkeys(ends))


def _event_row(branch: ForcedBranch, event: ForcedEvent) -> tuple[str, ...]:
    behind = branch.stable[event.point + 1] if event.point + 1 < len(branch) else None
    largest = "unbounded" if event.multiplier is None else f"{event.multiplier:.8g}"
    stable = "-" if behind is None else stability_word(int(behind))
    return event.id, f"{event.values[branch.name]:.14g}", largest, stable, event.remark
