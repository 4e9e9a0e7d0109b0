"""`saltus continue --in NAME`: families of orbits under periodic loads, from their start to their files; and what a file of them says."""

from __future__ import annotations

import argparse
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from bvp.expressions import normalised
from bvp.interrupts import defer_interrupts
from saltus import compiling, options, outputs
from saltus.errors import DONE, FAILED, FAILURES, INTERRUPTED, BadInput, refusing, say
from saltus.inputs import file_and_event, is_curve_file, is_response_file, responses_in
from saltus.response_starts import add_start_arguments, prepare_kernels, request_of, same_parametric, starts_of
from saltus.terminal import ProgressBar, stability_word, table_lines, terminal_width

if TYPE_CHECKING:
    from branches.forced.branch import ForcedBranch, ForcedEvent
    from branches.forced.onwards import Onwards, ResponseStart
    from branches.tables import Table
    from bvp.parameters import ParametricSystem
    from saltus.scene import Scene
    from transitions.sweep.figure import Curve
    from transitions.sweep.runs import AlongParameter

__all__ = [
    "add_arguments", "add_harmonics", "check_column", "check_harmonics", "draw", "follow_forced", "follow_free", "over_sweep", "read",
    "require_no_loads", "show", "wants_parameter", "write",
]  # fmt: skip

_OF_IMPACT = re.compile(r"(speed|phase):[1-9]\d*")
_OTHERS = ("name", "energy", "frequency")
"""Options of families in the energy."""
_FREE_STOPS = ("SN", "BP", "SB", "PD", "RT", "NS", "GR", "IO", "LB", "UZ")
"""Events at which a family of free orbits in a parameter can end on request."""
_STOPS = ("SN", "BP", "SB", "PD", "NS", "GR", "LB", "UZ")
"""Events at which a response can end on request."""
_SWITCHES = ("GR", "SB", "PD", "BP")
_OWN = ("keep", "range", "begin", "phase", "transient", "uz", "x", "y", "through", "branches")
"""Options of responses."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of responses to the parser of `saltus continue`."""
    add_start_arguments(parser)
    parser.add_argument(
        "--uz", metavar="[COLUMN=]VALUES", type=options.marks, action="append",
        help="with --in: mark these values of the parameter, X1,X2,.., or of a column of --y, max:u1=X1,X2,..; repeatable",
    )  # fmt: skip
    parser.add_argument(
        "--through", metavar="TYPES", type=options.names, help="with --in: go on with the families that begin at these events: GR,SB,PD,BP"
    )
    parser.add_argument("--branches", metavar="N", type=options.whole_above_zero, help="with --through: most families (default: 50)")
    parser.add_argument(
        "--x", metavar="COLUMN", type=normalised,
        help="with --in: another horizontal axis of the figure than the parameter",
    )
    add_harmonics(parser)
    parser.add_argument(
        "--y", metavar="COLUMN", type=normalised,
        help="with --in: what the figure shows: max:u1, rms:u1, speed, phase:1, share:.., h, ...",
    )


def add_harmonics(parser: argparse.ArgumentParser) -> None:
    """Add the option ``--harmonics``."""
    parser.add_argument(
        "--harmonics", metavar="K", type=options.whole_above_zero,
        help="columns of the files and a panel of the figure: mean, and amplitudes of harmonics 1 to K of 2 pi/T, of each coordinate",
    )  # fmt: skip


def check_harmonics(arguments: argparse.Namespace, files: outputs.Outputs) -> None:
    """Refuse harmonics that no file would have."""
    if arguments.harmonics is not None and not files.places:
        raise BadInput(f"--harmonics {arguments.harmonics}: no file would have them; expected --json, --csv, --npz, --mat or --plot")


def wants_parameter(arguments: argparse.Namespace) -> bool:
    """Whether the command line asks for a response. What then does not fit is refused."""
    from saltus import free_families

    start = arguments.start or ""
    wanted = arguments.parameter is not None or start == "rest" or is_response_file(file_and_event(start)[0])
    free_state = not wanted and start == "simulate" and free_families.settles_nowhere(arguments)
    wanted = wanted or (start == "simulate" and not free_state)
    if not wanted and is_curve_file(file_and_event(start)[0]):
        raise BadInput(f"--in NAME is required: the parameter in which the family through {start} is followed")
    given = [f"--{name.replace('begin', 'start')}" for name in _OWN if getattr(arguments, name) is not None]
    if free_state and "--start" in given:
        given.remove("--start")
    if not wanted and given:
        source = file_and_event(start)[0]
        if source.endswith(".json") and not os.path.exists(source):
            raise BadInput(f"no file {source}; expected a JSON file of saltus continue --in NAME, FILE[:EVENT]")
        raise BadInput(f"{given[0]} is an option of a response; expected --in NAME, the parameter in which it is followed")
    if not wanted and arguments.stop_at == "UZ":
        raise BadInput("--stop-at UZ: values are marked along a response; expected --in NAME, or another event")
    if wanted:
        free = free_families.wants_free_family(arguments)
        for name in _OTHERS:
            if getattr(arguments, name) and not (free and name == "name"):
                what = arguments.name if name == "name" else f"--{name}"
                raise BadInput(f"{what} belongs to families in the energy; expected --in NAME with --from and --range alone")
        stops, what = (_FREE_STOPS, "a family of free orbits in a parameter") if free else (_STOPS, "a response")
        if arguments.stop_at not in (None, *stops):
            raise BadInput(f"--stop-at {arguments.stop_at}: {what} has no such event; expected one of {', '.join(stops)}")
        for option in given if free else ():
            if option in ("--phase", "--transient") or (option == "--start" and start != "simulate"):
                raise BadInput(f"{option} is where a simulation starts; expected --from simulate")
    return wanted


def require_no_loads(scene: Scene) -> None:
    """Refuse a scene whose loads or losses a family in the energy cannot have; say how its response is followed."""
    motion = ", or saltus run" if scene.system.has_potential else ""
    how = f"expected --in NAME, which follows the response to the loads in a parameter{motion}"
    from bvp.forcing import Constant

    if any(not isinstance(force, Constant) for force in scene.forces):
        from saltus.scene import LOADS

        raise BadInput(f"saltus continue computes motion without loads, and the scene has {LOADS[scene.loads[0]]}; {how}")
    why = scene.system.why_not_conservative()
    if why is not None:
        instead = "--from simulate with --in NAME" if scene.forces and scene.system.stops else "loads and --in NAME"
        raise BadInput(f"families in the energy need a conservative system: {why}; expected {instead}{motion}")


def follow_free(arguments: argparse.Namespace) -> int:
    """Follow a family of free orbits in a parameter and write its files; return the exit code."""
    from saltus import free_families

    if arguments.through is not None or arguments.branches is not None:
        raise BadInput("--through and --branches are options of a response; expected --from FILE:EVENT, one event after the other")
    files = outputs.outputs_of(arguments)
    check_harmonics(arguments, files)
    lines: list[str] = []
    # The catalogue is the one to save in: nothing is looked up there.
    given = argparse.Namespace(**{**vars(arguments), "catalogue": None, "save": False})
    starts, interval, title = free_families.free_start(given, lines.extend)
    problem, keep = starts[0].problem, None
    if arguments.save or arguments.catalogue is not None:
        from saltus import response_catalogues

        record = response_catalogues.record_of_free(problem)
        keep = partial(response_catalogues.save_followed, response_catalogues.place_of_responses(arguments, record), record)
    _check_axes(arguments, problem.parametric, len(problem.sequence) + 2, free=True)
    options.report_model(arguments, files, "explain", problem.system, problem.ends)
    files.report(lines)
    compiling.prepare("parameter", *(["modes"] if problem.degrees_of_freedom > 2 else []))
    return _follow_and_write(starts, interval, arguments, files, title, keep)


def follow_forced(arguments: argparse.Namespace) -> int:
    """Follow a response and write its files; return the exit code."""
    _through(arguments)  # what cannot be followed is refused before the work
    files = outputs.outputs_of(arguments)
    check_harmonics(arguments, files)
    request = request_of(arguments)
    _check_axes(arguments, request.path.parametric, None)
    options.report_model(arguments, files, "explain_response", request.path.parametric, request.path.values)
    keep = None
    if arguments.save or arguments.catalogue is not None:
        from saltus import response_catalogues

        record = response_catalogues.record_of(request)
        keep = partial(response_catalogues.save_followed, response_catalogues.place_of_responses(arguments, record, request.source), record)
    prepare_kernels(request, arguments)
    return _follow_and_write(starts_of(request, arguments, files.report), request.interval, arguments, files, request.title, keep)


Keep = Callable[["Onwards", "Sequence[ResponseStart]"], "tuple[list[str], int]"]
"""Keeps what was followed from some starts in a catalogue: lines about the result, and an exit code."""


def _follow_and_write(
    starts: Sequence[ResponseStart],
    interval: tuple[float, float],
    arguments: argparse.Namespace,
    files: outputs.Outputs,
    title: str,
    keep: Keep | None = None,
) -> int:
    """Follow the families of some starts, and write the files, also of what an interrupted run has computed; return the exit code."""
    from branches.forced.onwards import Onwards

    found = Onwards()
    with defer_interrupts() as interrupt:
        code = DONE
        try:
            with interrupt.released():
                code = _follow_all(starts, interval, arguments, files, found)
        except KeyboardInterrupt as error:
            if not found.branches and getattr(error, "branch", None) is None:
                raise
            say("interrupted, with the points that were computed so far")
            code = INTERRUPTED
            if getattr(error, "branch", None) is not None:
                found.branches.append(error.branch)  # type: ignore[attr-defined]
                files.report(report_lines(found.branches[-1], len(found.branches), terminal_width(files.words)))
        code = max(code, write(files, found.branches, arguments.y, title, arguments.x, harmonics=arguments.harmonics))
        if keep is not None:
            lines, kept = keep(found, starts)
            files.report(lines)
            code = max(code, kept)
    if interrupt.came and code != INTERRUPTED:
        raise KeyboardInterrupt(outputs.WRITTEN)
    return code


def _follow_all(
    starts: Sequence[ResponseStart], interval: tuple[float, float], arguments: argparse.Namespace, files: outputs.Outputs, found: Onwards
) -> int:
    """Follow the families of some starts, and those behind the events that the command line names, into `found`; return the exit code."""
    from branches.forced.onwards import MOST_BRANCHES, follow_onwards, trace_start
    from transitions.response.marks import mark_values

    first = starts[0].problem
    if first.ends is None:
        _check_axes(arguments, first.parametric, len(first.impacts))
    with ProgressBar(arguments.points) as bar:

        def trace(start: ResponseStart) -> tuple[ForcedBranch, list[int]]:
            values, columns = _marks(arguments, start)
            given = {"values": values, "points": arguments.points, "stop_at": arguments.stop_at, "on_point": bar.update}
            branch, ends = trace_start(start, interval, **given)
            for column, wanted in columns.items():
                branch = mark_values(branch, column, wanted)
                ends = [end and len(branch) - 1 for end in ends]
            lines = report_lines(branch, len(found.branches) + 1, terminal_width(files.words))
            bar.line("\n".join(lines), files.words)
            if not ends:
                bar.line("note   the branch ends at events, or where the range ends; nothing is left to follow", files.words)
            return branch, ends

        follow_onwards(starts, trace, through=_through(arguments), most=arguments.branches or MOST_BRANCHES, found=found)
    if found.left:
        files.report([f"left   {found.left} starts were not followed, with {len(found.branches)} families; --branches N allows more"])
    files.report([f"note   {note}" for note in [*found.notes, *_missed(arguments, found.branches)]])
    failed = any(end.reason in FAILURES for branch in found.branches for end in branch.ended)
    return FAILED if failed or found.notes else DONE


def _marks(arguments: argparse.Namespace, start: ResponseStart) -> tuple[tuple[float, ...], dict[str, tuple[float, ...]]]:
    """The values of the parameter, and of each other column, that are marked. A known branch is marked in all its parts."""
    name, impacts, free = start.problem.released[0], len(start.problem.impacts), start.problem.ends is not None
    found: dict[str, tuple[float, ...]] = {}
    for column, values in arguments.uz or ():
        found[column or name] = found.get(column or name, ()) + values
    for column in found:
        check_column("--uz", column, start.problem.parametric, impacts + 2 * free, free)
    own = found.get(name, ())
    return own, {column: values for column, values in found.items() if column != name or start.known is not None}


def _missed(arguments: argparse.Namespace, branches: Sequence[ForcedBranch]) -> list[str]:
    """What is said of values of --uz that no family has."""
    if not (arguments.uz and branches):
        return []
    from transitions.response.marks import missed_values

    return missed_values(branches, [(column or branches[0].name, value) for column, values in arguments.uz for value in values])


def show(arguments: argparse.Namespace) -> int:
    """Print what a file of responses has, and draw it; return the exit code."""
    arguments.x = arguments.y = arguments.harmonics = arguments.beside = None
    return draw(arguments, arguments.name)


def draw(arguments: argparse.Namespace, path: str) -> int:
    """Print the branches of a file of responses, and write the files that are asked for; return the exit code."""
    files = outputs.outputs_of(arguments)
    check_harmonics(arguments, files)
    branches = responses_in(path)
    if arguments.beside and "plot" not in files.places:
        raise BadInput(f"--beside {arguments.beside[0]} is drawn beside the responses; expected --plot FILE")
    impacts = max(branch.speeds.shape[1] for branch in branches)
    _check_axes(arguments, branches[0].problem.parametric, impacts, free=branches[0].problem.ends is not None)
    for number, branch in enumerate(branches, 1):
        files.report(report_lines(branch, number, terminal_width(files.words)))
    backbones = [_backbone(place, branches, arguments) for place in arguments.beside or ()]
    return write(files, branches, arguments.y, "", arguments.x, harmonics=arguments.harmonics, backbones=backbones)


def _backbone(place: str, branches: Sequence[ForcedBranch], arguments: argparse.Namespace) -> Curve:
    """The family of a file as a backbone of responses."""
    from branches.reading import read_branch
    from transitions.response.backbone import backbone
    from transitions.response.figure import default_column

    if arguments.x not in (None, branches[0].name):
        raise BadInput(f"--beside {place}: a backbone is over the frequency; expected no --x {arguments.x}")
    if branches[0].problem.ends is not None:
        raise BadInput(f"--beside {place}: free orbits have no backbone beside them; expected a file of responses to a load")
    family = read_branch(place)
    with refusing(f"--beside {place}"):
        return backbone(family, branches, arguments.y or default_column(branches[0].problem))


def read(paths: Sequence[str]) -> list[ForcedBranch]:
    """The branches of files of responses, all of one system and parameter."""
    from branches.catalogue.responses import system_of
    from branches.catalogue.rows import difference
    from transitions.response.files import read_responses

    found: list[ForcedBranch] = []
    for path in paths:
        branches = read_responses(path)
        first, here = (found or branches)[0].problem, branches[0].problem
        if (here.released, here.keep) != (first.released, first.keep):
            names, others = (",".join((*problem.released, *problem.keep)) for problem in (here, first))
            raise BadInput(f"{path} is in {names}, and {paths[0]} in {others}; expected files in one parameter")
        at = {name: first.values[name] for name in first.released if name in here.parametric.names}
        one, other = system_of(first), system_of(here.sibling(here.sequence, values=here.values | at))
        differs = difference(one, other)
        if differs is not None:
            raise BadInput(f"{path} belongs to another system than {paths[0]}: there {differs}")
        found += branches
    return found


def over_sweep(path: str, at: AlongParameter, interval: tuple[float, float], y: str) -> list[Curve]:
    """The branches of a file of responses as curves over a sweep of the same system; BadInput for those of another one."""
    from transitions.response.figure import curves_over
    from transitions.response.files import read_responses

    branches = read_responses(path)
    name, wanted = at.name, at.parametric
    if name != branches[0].name:
        raise BadInput(f"--over {path} is over {branches[0].name}, expected {name}, the parameter of --in")
    if len(branches[0].problem.released) > 1:
        raise BadInput(f"--over {path} changes {', '.join(branches[0].problem.released)} together; expected {name} alone, as in the sweep")
    fixed = [key for key in wanted.names if key != name]
    same = same_parametric(branches[0].problem.parametric, wanted)
    if not (same and all(branch.problem.values[key] == wanted.values[key] for branch in branches for key in fixed)):
        raise BadInput(f"--over {path} has another system or other parameters than the sweep; expected those of its scene")
    with refusing("--over"):
        curves = curves_over(branches, y)
    low, high = interval
    inside = [(curve.x >= low) & (curve.x <= high) for curve in curves]
    return [replace(curve, y=np.where(part, curve.y, np.nan)) for curve, part in zip(curves, inside, strict=True) if part.any()]


def write(
    files: outputs.Outputs,
    branches: Sequence[ForcedBranch],
    y: str | None,
    title: str,
    x: str | None = None,
    interval: tuple[float, float] | None = None,
    harmonics: int | None = None,
    backbones: Sequence[Curve] = (),
) -> int:
    """Write the files of some branches, with their harmonics up to a number; return the exit code. The figure shows the parameter in an
    interval, and backbones."""
    from branches.harmonics import harmonic_notes
    from branches.tables import csv_text
    from transitions.response.files import responses_record
    from transitions.response.measures import response_table

    @cache
    def table() -> Table:
        return response_table(branches, harmonics)

    @cache
    def record() -> dict[str, Any]:
        return responses_record(branches, harmonics)

    options = {"y": y, "x": x, "title": title, "interval": interval, "harmonics": harmonics, "backbones": backbones}
    if harmonics is not None:
        files.report(note for branch in branches for note in harmonic_notes(branch, harmonics))
    return files.write(
        {"json": lambda: outputs.json_text(record()), "csv": lambda: csv_text(table())},
        table=table,
        about=lambda: outputs.json_text({key: value for key, value in record().items() if key != "branches"}),
        figure=("transitions.response.figure:response_figure", branches, options),
    )


def _check_axes(arguments: argparse.Namespace, parametric: ParametricSystem, impacts: int | None, *, free: bool = False) -> None:
    """Refuse unknown columns of the axes and marks. impacts: None as long as their number is not known."""
    columns = [("--uz", column) for column, _ in getattr(arguments, "uz", None) or ()]
    for option, name in (("--x", arguments.x), ("--y", arguments.y), *columns):
        if name is not None and (impacts is not None or not _OF_IMPACT.fullmatch(name)):
            check_column(option, name, parametric, impacts or 0, free)
    if arguments.x in ("speed", "phase"):
        raise BadInput(f"--x {arguments.x} is a curve for each impact; expected {arguments.x}:1")


def check_column(option: str, name: str, parametric: ParametricSystem, impacts: int, free: bool) -> None:
    from transitions.response.figure import require_column

    with refusing(option):
        require_column(name, parametric, impacts, free)


def _through(arguments: argparse.Namespace) -> tuple[str, ...]:
    """The events behind which it goes on. Where impacts exchange their order it always does: the family continues."""
    wanted = tuple(arguments.through or ())
    if arguments.branches is not None and not wanted:
        raise BadInput("--branches is the largest number of families with --through; expected --through GR,SB,..")
    for code in wanted:
        if code not in _SWITCHES:
            raise BadInput(f"--through {code}: no family begins at such an event; expected some of {', '.join(_SWITCHES)}")
    return (*wanted, "LB")


def report_lines(branch: ForcedBranch, number: int, width: int | None = None) -> list[str]:
    """What is printed of a branch: its sequence and stability, its events, and its ends."""
    from branches.forced.branch import sequence_text
    from branches.released.branch import ReleasedBranch
    from saltus.free_families import limit_lines

    name, problem = branch.name, branch.problem
    span = f"{name} = {branch.parameter.min():.10g} to {branch.parameter.max():.10g}"
    half = ", solved over half the period" if problem.half else ""
    impacts = sequence_text(branch.sequence) + half
    period = f"period {problem.load_periods} of the loads" if problem.has_clock else "free period"
    more: dict[str, str] = {}
    if problem.ends is not None:
        impacts, period = f"{'-'.join(problem.ends)}, sequence {branch.sequence or '(none)'}", " and ".join(problem.keep)
        more = {"h": "energy", "alpha": "quarter_period"}
    lines = [f"branch {number}: {impacts}; {period}; {len(branch)} points, {span}"]
    rows = [_event_row(branch, event, [*more.values()]) for event in branch.events]
    if rows:
        head = ("event", name, *more, "|multiplier|", "stable after", "normal form", "remark")
        lines += table_lines(head, rows, width=width, columns="l" + "r" * (len(head) - 4) + "llt")
    ends = [f"end    {end.text}" for end in branch.ended]
    lines += dict.fromkeys(ends)
    if isinstance(branch, ReleasedBranch):
        lines += limit_lines(branch)
    return lines


def _event_row(branch: ForcedBranch, event: ForcedEvent, more: Sequence[str]) -> tuple[str, ...]:
    behind = branch.stable[event.point + 1] if event.point + 1 < len(branch) else None
    largest = "unbounded" if event.multiplier is None else f"{event.multiplier:.8g}"
    stable = "-" if behind is None else stability_word(int(behind))
    values = [f"{event.values[branch.name]:.14g}", *(f"{event.values[name]:.10g}" for name in more)]
    return event.id, *values, largest, stable, event.normal_form, event.remark
