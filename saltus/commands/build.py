"""`saltus build`: find and follow every family of a scene, and keep them in a catalogue."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from saltus import catalogue_arguments, outputs, scene_arguments
from saltus.arguments import energy_range, positive, whole_above_zero
from saltus.errors import DONE, FAILED, INTERRUPTED, say
from saltus.files import STANDARD_OUTPUT, check_writable, write_data
from saltus.printing import words_stream
from saltus.wording import counted

if TYPE_CHECKING:
    from concurrent.futures import Executor
    from pathlib import Path

    from branches.building.bounds import Plan
    from branches.building.build import Progress
    from saltus.progress import ProgressBar
    from saltus.scene import Scene

__all__ = ["add_arguments", "run"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    parser.add_argument("--energy", metavar="LO:HI", type=energy_range, help="energies (default: the scene's)")
    parser.add_argument("--max-quarter-period", metavar="A", type=positive, help="longest quarter period (default: the scene's)")
    parser.add_argument("--max-impacts", metavar="K", type=whole_above_zero, help="most impacts in half a period (default: the scene's)")
    parser.add_argument("--workers", metavar="N", type=whole_above_zero, help="processes that work (default: one a core)")
    parser.add_argument("--dask", metavar="ADDRESS", help="work on a Dask cluster in place of processes")
    catalogue_arguments.add_file(parser, "the catalogue (default: that of the scene in the user's data folder)")
    outputs.add_json(parser)
    scene_arguments.add_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Do what was asked; return the exit code: 1 where something could not be done."""
    if arguments.json is not None:
        check_writable(arguments.json)
    scene = scene_arguments.from_arguments(arguments)
    place = catalogue_arguments.place_to_save(arguments, scene)

    from branches.building.bounds import Bounds, Plan
    from branches.building.work import ends_of
    from branches.discovery.search import check
    from saltus.executors import open_executor

    complete = scene.complete
    bounds = Bounds(
        arguments.energy or complete["energy"],
        arguments.max_quarter_period or complete["quarter_period"],
        arguments.max_impacts or complete["impacts"],
    )
    if arguments.energy is None and arguments.max_quarter_period is None and arguments.max_impacts is None:
        plan = Plan(bounds, Bounds(bounds.energy, scene.quarter_period, scene.impacts), scene.names, scene.pins)
    else:
        plan = Plan.within(bounds)
    check(scene.system, bounds.energy[0], bounds.quarter_period, bounds.impacts, ends_of(scene.system))
    with open_executor(arguments.workers, arguments.dask) as (executor, count):
        return _build(arguments, scene, place, plan, executor, count)


def _build(arguments: argparse.Namespace, scene: Scene, place: Path, plan: Plan, executor: Executor, workers: int) -> int:
    from branches.building.build import build, refuse_other_plan
    from branches.catalogue import Catalogue
    from saltus import __version__
    from saltus.catalogue_records import impacts_text
    from saltus.first_run import prepare
    from saltus.progress import ProgressBar

    words = words_stream(arguments.json == STANDARD_OUTPUT)
    bounds = plan.bounds
    provenance = {"saltus": __version__, "built": plan.plain()}
    with Catalogue(place, "a", scene=scene, provenance=provenance) as catalogue:
        refuse_other_plan(catalogue, plan)
        print(
            f"build  {place}: h {bounds.energy[0]:g} to {bounds.energy[1]:g}, quarter period up to {bounds.quarter_period:g}, "
            f"up to {impacts_text(bounds.impacts)}" + (f", and {len(plan.names)} names" if plan.names else ""),
            file=words, flush=True,
        )  # fmt: skip
        prepare(discovery=True)
        try:
            with ProgressBar(None, "families") as bar:
                report = build(catalogue, plan, executor, workers, lambda progress: _show(bar, progress))
        except KeyboardInterrupt:
            say(f"interrupted; {place} keeps what was finished, and the same command goes on")
            return INTERRUPTED
    for text in report["failed"]:
        print(f"FAILS  {text}", file=words)
    searched = ", ".join(f"{level['energies']} ({level['new']} new)" for level in report["levels"])
    new = report["levels"][-1]["new"]
    settled = "not settled" if new else "settled"
    settled += f": the last energies gave {counted(new, 'new family') if new else 'no new family'}"
    if report["open"]:
        settled += ", but open in h = " + ", ".join(f"{low:.6g}:{high:.6g}" for low, high in report["open"])
    lines = [
        f"done   {counted(report['families'], 'family')}, {counted(report['points'], 'point')}, {counted(report['events'], 'event')}, "
        f"{counted(report['edges'], 'edge')}; {counted(report['beyond'], 'neighbour')} beyond the bounds",
        f"       energies searched: {searched}; {settled}",
        "       with a reversal every family within the bounds is looked for; without one, those that meet one with a reversal",
    ]
    if report["unsettled"]:
        energies = ", ".join(f"{energy:.6g}" for energy in sorted(report["unsettled"]))
        lines.append(f"       starts a rounding error apart part at h = {energies}: there the list may lack an orbit")
    if report["halves"]:
        lines.append(f"       of {counted(report['halves'], 'family')} one side of a branch point was followed; the other is its image")
    digits = report["digits"]
    if digits["orbits"]:
        solved = counted(digits["orbits"], "orbit")
        lines.append(f"       {solved} solved in fifty digits to decide stability, in {digits['seconds']:.1f} s")
    if report["missed"]:
        lines.append(f"       {counted(len(report['missed']), 'event')} missed: `saltus check` lists them")
    if report["lost"]:
        lost = counted(len(report["lost"]), "bifurcation")
        lines.append(f"       at {lost} no new family was found (dead ends of the graph, which say why)")
    if not report["families"]:
        from saltus.empty_bounds import nothing_inside

        lines.append(f"       {nothing_inside(scene.system, bounds, scene.quarter_period)}")
    print("\n".join(lines), file=words)
    if arguments.json is not None:
        _write(arguments.json, {"bounds": bounds.plain(), **report})
    return FAILED if report["failed"] else DONE


def _show(bar: ProgressBar, progress: Progress) -> None:
    bar.update(progress.families, f"{progress.queued} queued, {progress.points} points, {progress.events} events")


def _write(path: str, report: dict[str, Any]) -> None:
    from saltus.catalogue_records import SCHEMA, json_text

    write_data(path, json_text({"schema": SCHEMA, **report}))
