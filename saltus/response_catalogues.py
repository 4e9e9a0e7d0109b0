"""Catalogues of families in a parameter: keeping what `saltus continue --in` has followed, and `saltus build --in`, which fills one."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

from saltus import __version__, catalogues, options, outputs, processes
from saltus.errors import DONE, FAILED, INTERRUPTED, BadInput, one_line, say
from saltus.response_starts import add_start_arguments, prepare_kernels, request_of, starts_of
from saltus.terminal import ProgressBar, counted, range_text

if TYPE_CHECKING:
    from branches.catalogue import Catalogue, FamilyRow
    from branches.catalogue.rows import SceneRecord
    from branches.forced.branch import ForcedBranch, ForcedEvent
    from branches.forced.onwards import Onwards, ResponseStart
    from bvp.forced import ForcedProblem
    from saltus.response_starts import ResponseRequest

__all__ = ["add_arguments", "fill_catalogue", "place_of_responses", "record_of", "record_of_free", "save_followed", "wants_responses"]

SCHEMA = 2
DEPTH = 3
_OTHERS = {"energy": "--energy", "max_impacts": "--max-impacts", "max_quarter_period": "--max-quarter-period", "named": "--named"}
"""Options of a build of families in the energy."""
_OWN = {"start": "--from", "begin": "--start"} | {name: f"--{name}" for name in ("keep", "range", "phase", "transient", "depth", "points")}
"""Options of a build of responses."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of a build of responses to the parser of `saltus build`."""
    add_start_arguments(parser)
    parser.add_argument("--from", metavar="START", dest="start", help="with --in: rest, simulate, or FILE[:EVENT] of saltus continue --in")
    parser.add_argument(
        "--depth", metavar="N", type=options.whole_above_zero,
        help=f"with --in: follow the families that begin at most N events away from the start (default: {DEPTH})",
    )  # fmt: skip
    parser.add_argument("--points", metavar="N", type=options.whole_above_zero, help="with --in: end each family at N points in total")
    parser.set_defaults(direction="both")


def wants_responses(arguments: argparse.Namespace) -> bool:
    """Whether a build of responses is asked for. What then does not fit is refused."""
    wanted = arguments.parameter is not None
    others, name = (_OTHERS, "families in the energy") if wanted else (_OWN, "responses")
    for option, text in others.items():
        if getattr(arguments, option) is not None:
            more = " with --from and --range" if wanted else ", the parameter in which they are followed"
            raise BadInput(f"{text} belongs to {name}; expected --in NAME{more}")
    return wanted


def record_of(request: ResponseRequest) -> SceneRecord:
    """The scene of a catalogue that keeps a response."""
    from branches.catalogue.rows import SceneRecord
    from branches.tables import plain

    path = request.path
    described = plain(path.parametric.replaced(path.values).describe())
    return SceneRecord(described, title=request.title, parameters={"names": list(path.names), "keep": list(path.keep)})


def record_of_free(problem: ForcedProblem) -> SceneRecord:
    """The scene of a catalogue that keeps a family of free orbits in a parameter."""
    from branches.catalogue.responses import system_of
    from branches.catalogue.rows import SceneRecord

    return SceneRecord(system_of(problem), parameters={"names": list(problem.released), "keep": list(problem.keep)})


def place_of_responses(arguments: argparse.Namespace, record: SceneRecord, source: str | None = None) -> Path:
    """The catalogue to keep families in a parameter in. A place where that is not possible is refused before the work starts. source: the
    file that they go on from."""
    if arguments.catalogue is None and record.is_free:
        raise BadInput("--catalogue FILE is required: the scene's own catalogue is that of families in the energy")
    if arguments.catalogue is None and source is not None and arguments.scene is None:
        raise BadInput(f"--catalogue FILE is required: {source} does not name its scene; expected it, or --scene")
    return catalogues.place_to_save(arguments, record, record.parameters["names"])


def save_followed(place: Path, record: SceneRecord, found: Onwards, starts: Sequence[ResponseStart]) -> tuple[list[str], int]:
    """Keep what was followed from some starts in a catalogue, which is made if there is none, and join it at the events where it begins.

    Returns
    -------
    list of str, int
        Lines about the result, and the exit code.
    """
    from branches.building.responses import edge_of, link_at
    from branches.catalogue import Catalogue
    from branches.catalogue.responses import kept_branch, orbit_of
    from branches.catalogue.widening import CannotWiden
    from branches.forced.known import meeting_place
    from bvp.contact_sequence import joined_sequence

    lines, code = [], DONE
    name = record.parameters["names"][0]
    with Catalogue(place, "a", scene=record, provenance={"saltus": __version__}) as catalogue:
        ids: dict[int, str] = {}
        for number, branch in enumerate(found.branches):
            if any(end.reason == "INTERRUPTED" for end in branch.ended):
                say("a family that was not followed to its ends is not kept in a catalogue")
                continue
            branch = kept_branch(catalogue, branch)
            try:
                lines.append(catalogues.keep_branch(catalogue, place, branch, name, branch.parameter))
            except CannotWiden as refused:
                say(one_line(refused))
                code = FAILED
            else:
                ids[number] = branch.id
        event_in = cache(partial(_event_in, catalogue))  # two images of a family begin at one event
        for source, event, number in _beginnings(found, starts):
            if number not in ids:
                continue
            where = event_in(source, event.type, meeting_place(source, event.point))
            if where is None:
                lines.append(f"note   {place} has no family with {event.id}, where {ids[number]} begins: expected it saved, too")
                continue
            branch = found.branches[number]
            link = link_at(where[0], where[1], joined_sequence(branch.problem.sequence), branch)
            there = orbit_of(branch.problem, branch.unknowns[branch.start])
            catalogue.connect(edge_of(catalogue, replace(link, there=there), ids[number]))
            lines.append(f"edge   {link.source} {link.event}: {link.kind}")
    return lines, code


def _beginnings(found: Onwards, starts: Sequence[ResponseStart]) -> Iterator[tuple[ForcedBranch, ForcedEvent, int]]:
    """The branch and the event at which a branch with a number begins, of all branches that begin at events."""
    for number, branch in enumerate(found.branches):
        for start in starts:
            if start.begins is not None and branch.problem is start.problem:
                yield *start.begins, number
    for source, id, number in found.links:
        branch = found.branches[source]
        yield branch, next(event for event in branch.events if event.id == id), number


def _event_in(catalogue: Catalogue, source: ForcedBranch, type: str, place: tuple[float, float]) -> tuple[ForcedBranch, ForcedEvent] | None:
    """A branch of a catalogue and its event that is the event of another branch of the family; None if there is none."""
    from branches.catalogue.responses import kept_branch
    from branches.forced.known import events_at

    id = kept_branch(catalogue, source).id
    if id not in catalogue:
        return None
    branch = catalogue.branch(id)
    near = events_at(branch, (type,), place)
    return (branch, near[0]) if near else None


def fill_catalogue(arguments: argparse.Namespace) -> int:
    """Fill a catalogue with the families that begin at the events of others; return the exit code."""
    files = outputs.outputs_of(arguments)
    request = request_of(arguments)
    place = place_of_responses(arguments, record_of(request), request.source)
    prepare_kernels(request, arguments)
    starts = starts_of(request, arguments, files.report)

    from branches.building.responses import ResponsePlan, build_responses, seed_of
    from branches.catalogue import Catalogue

    depth = arguments.depth or DEPTH
    plan = ResponsePlan(request.interval, depth, arguments.points)
    seeds = [seed_of(start.problem, start.orbit, request.interval, depth) for start in starts]
    name, (low, high) = request.path.name, request.interval
    files.report([f"build  {place}: {name} = {low:g} to {high:g}, families up to {counted(depth, 'event')} away"])
    record, made = record_of(request), {"saltus": __version__}
    with _executor(arguments) as (executor, workers), Catalogue(place, "a", scene=record, provenance=made) as kept:
        try:
            with ProgressBar(None, "families") as bar:
                report = build_responses(
                    kept, seeds, plan, executor, workers, lambda row: bar.line(_line(row, name), files.words),
                    lambda families, left: bar.update(families, f"{left} queued"),
                )  # fmt: skip
        except KeyboardInterrupt:
            say(f"interrupted; {place} keeps what was finished, and the same command goes on")
            return INTERRUPTED
    files.report(f"FAILS  {text}" for text in report["failed"])
    files.report(f"lost   {text}" for text in report["lost"])
    things = {"families": "family", "points": "point", "events": "event", "edges": "edge"}
    files.report([
        "done   " + ", ".join(counted(report[key], thing) for key, thing in things.items())
        + f"; {counted(report['left'], 'event')} farther away, or outside the range, not followed"
    ])  # fmt: skip
    about = {"schema": SCHEMA, "range": list(request.interval), "depth": depth}
    return max(files.write({"json": lambda: outputs.json_text({**about, **report})}), FAILED if report["failed"] else DONE)


@contextmanager
def _executor(arguments: argparse.Namespace) -> Iterator[tuple[Executor, int]]:
    """This process, whose kernels are loaded, unless others are asked for: a family takes some tenths of a second."""
    if arguments.workers is None and arguments.dask is None:
        pool = ThreadPoolExecutor(1)
        try:
            yield pool, 1
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
        return
    with processes.open_executor(arguments.workers, arguments.dask) as found:
        yield found


def _line(row: FamilyRow, name: str) -> str:
    """A new family, with the reasons of its ends."""
    ends = " and ".join(dict.fromkeys(text.partition(":")[0] for _, text in row.ended))
    return f"family {row.id}  {name} {range_text(row.h)}, {counted(row.points, 'point')}, {counted(row.events, 'event')}; ends: {ends}"
